#!/usr/bin/python3
"""A figure is hollowed to a wall of 2 mm with a drain hole, measured, and written as STL.

Instead of Houdini's VDB Reshape SDF, VDB Combine and Convert VDB.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, save, statue

args = arguments(__doc__)
height, wall = 80.0, 2.0  # mm
voxel_size = height / args.voxels

figure = statue()
low, high = figure.bounds
figure = figure.translate((0, -low[1], 0)).scale(height / (high[1] - low[1]))
hollow = figure.shell(wall, wall="inward")
drain = mv.cylinder((0, -1, 0), (0, 2 * wall, 0), 2.5)
part = (hollow - drain).level_set(voxel_size)
save(part, args.output, "hollow.vdb")

mesh = part.to_mesh()
mesh.write(args.output / "hollow.stl")
report = mesh.measure()
print(f"{report.triangles} triangles, {report.boundary_edges} open edges, genus {report.genus:.0f}")
print(f"{report.volume / 1000:.1f} of {figure.level_set(voxel_size).measure().volume / 1000:.1f} cm3")

# The wall, by rays from outside towards its middle: into the wall, and out of it.
directions = np.random.default_rng(4).normal(size=(2000, 3))
origins = (0, height / 2, 0) + 10 * height * directions
hits, normals = part.raycast(origins, (0, height / 2, 0) - origins)
met = np.isfinite(hits)
entries = origins[met] + hits[met, None] * ((0, height / 2, 0) - origins[met])
thickness, _ = part.raycast(entries - 1e-3 * normals[met], -normals[met])
print(f"wall of {np.median(thickness):.2f} mm by {met.sum()} rays")
