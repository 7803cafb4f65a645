#!/usr/bin/python3
"""Parts of different resolution are joined, cut and repeated; what comes out has exact distances.

Instead of Houdini's VDB from Polygons, VDB Combine (union, intersection, difference; resample B to
A) and VDB Renormalize SDF.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, save

args = arguments(__doc__)
voxel_size = 2 / args.voxels

# Parts as files come: the plate finely sampled, the tower four times as coarsely.
plate = mv.rounded_box((-1, -1, -0.1), (1, 1, 0.1), 0.05).level_set(voxel_size)
tower = mv.cylinder((0, 0, 0), (0, 0, 0.9), 0.35).level_set(4 * voxel_size)

bolts = [
    mv.cylinder((x, y, -1), (x, y, 1), 0.12) for x in (-0.7, 0.7) for y in (-0.7, 0.7)
]
bore = mv.cylinder((0, 0, -1), (0, 0, 2), 0.2)
gills = [mv.box((-1, -0.04, z), (1, 0.04, z + 0.08)) for z in (0.3, 0.5, 0.7)]

kit = mv.difference(plate | tower, bore, *bolts, *gills)
made = kit.level_set(voxel_size)
save(made, args.output, "kitbash.vdb")
report = made.check()
print(f"half-width {made.half_width}, mean of ||grad| - 1|: {report.mean_gradient_error:.4f}")
print(f"genus {made.measure().genus:.0f}")
