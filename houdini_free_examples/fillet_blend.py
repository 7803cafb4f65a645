#!/usr/bin/python3
"""Pipes are joined with a fillet of a radius in world units; away from the joint nothing changes.

Instead of Houdini's VDB Combine and VDB Smooth SDF with an alpha mask.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, save

args = arguments(__doc__)
voxel_size = 2.4 / args.voxels
radius = 0.12

pipes = [
    mv.capsule((-1, 0, 0), (1, 0, 0), 0.2),
    mv.capsule((0, -1, 0), (0, 1, 0), 0.17),
    mv.capsule((0, 0, -1), (0, 0, 1), 0.14),
]
sharp = mv.union(*pipes).level_set(voxel_size)
smooth = mv.union(*pipes, blend=radius).level_set(voxel_size)
save(sharp, args.output, "pipes_sharp.vdb")
save(smooth, args.output, "pipes_fillet.vdb")

# Away from the joint by more than the fillet reaches, the two surfaces are the same.
places = np.random.default_rng(5).uniform(-1.2, 1.2, (20000, 3))
surface = sharp.closest_points(places)
surface = surface[np.abs(surface).max(axis=1) > 0.6]
change = np.abs(smooth.distance(surface))
print(f"largest change away from the joint: {change.max() / voxel_size:.4f} voxels")
print(f"volume of the fillet: {smooth.measure().volume - sharp.measure().volume:.5f}")
