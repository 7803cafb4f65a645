#!/usr/bin/python3
"""A head cut out of a dragon; a statue with bubbles in it, wrung like a towel.

Ohtake et al., Multi-level partition of unity implicits, Figure 8.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, head, knot, model, save, statue

args = arguments(__doc__, "dragon", "head", "statue")
voxel_size = 1 / args.voxels

dragon = model(args.dragon, knot)
cutter = model(args.head, head).scale(0.5).translate((0.1, 0, 0.1))
save((dragon - cutter).level_set(voxel_size), args.output, "carved.vdb")

random = np.random.default_rng(8)
bubbles = [
    mv.sphere(random.uniform(-0.35, 0.35, 3), random.uniform(0.05, 0.12)) for _ in range(24)
]
# The statue is cut first and twisted then, by half a turn over its height: the bubbles go along.
wrung = mv.difference(model(args.statue, statue), *bubbles).twist(180, axis="y")
# A bubble may cut something off: keep what stands.
save(wrung.level_set(voxel_size).keep_components(count=1), args.output, "wrung.vdb")
