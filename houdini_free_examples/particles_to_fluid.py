#!/usr/bin/python3
"""A splash of particles becomes a smooth surface with velocities, frame by frame, volume kept.

Instead of Houdini's Particle Fluid Surface, or VDB from Particles, VDB Reshape SDF, VDB Smooth SDF.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, save

args = arguments(__doc__)
spacing = 4 / args.voxels  # of the particles; voxels are half of it
random = np.random.default_rng(2)

# A block of water falls into a pool, in four frames of a twelfth of a second.
x, y, z = np.meshgrid(*[np.arange(0, 1, spacing)] * 3)
grid = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
grid += random.uniform(-0.2, 0.2, grid.shape) * spacing
pool = grid[grid[:, 2] < 0.3]
drop = grid[np.linalg.norm(grid - 0.5, axis=1) < 0.25] + (0, 0, 0.6)

particles = np.vstack([pool, drop])
for frame in range(1, 5):
    time = (frame - 1) / 12
    fall = np.array([0, 0, -4.9 * time * time])
    centers = np.vstack([pool, drop + fall])
    velocities = np.zeros_like(centers)
    velocities[len(pool) :, 2] = -9.8 * time
    water = mv.particles(
        centers, radius=0.62 * spacing, velocities=velocities, voxel_size=spacing / 2
    )
    save(water.level_set, args.output, f"fluid.{frame:04}.vdb")
    water.write(args.output / f"fluid.{frame:04}.vdb")  # with v, for motion blur
    share = water.level_set.measure().volume / (len(centers) * spacing**3)
    print(f"frame {frame}: {len(centers)} particles, {100 * share:.1f} % of their volume")
