#!/usr/bin/python3
"""One head becomes another (or whatever is given) in five frames.

Ohtake et al., Multi-level partition of unity implicits, Figure 14.
"""

from models import arguments, head, model, rabbit, save

args = arguments(__doc__, "first", "second")
voxel_size = 1 / args.voxels
# Sampled once, and not once for each frame.
first = model(args.first, head).level_set(voxel_size).shape("first")
second = model(args.second, rabbit).level_set(voxel_size).shape("second")

frames = 5
for frame in range(1, frames + 1):
    between = first.morph(second, (frame - 1) / (frames - 1))
    save(between.level_set(voxel_size), args.output, f"heads.{frame:04}.vdb")
