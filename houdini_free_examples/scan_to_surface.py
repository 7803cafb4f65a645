#!/usr/bin/python3
"""A noisy, colored scan with confidences, far from the origin, becomes a level set with its colors.

Instead of Houdini's Lidar Import, Point Cloud Normal, Point Cloud Surface, VDB from Polygons.
"""

import numpy as np

import mpuvdb as mv
from models import arguments, head, save

args = arguments(__doc__)
random = np.random.default_rng(1)

# A scanner's points: on a head, with noise of a thousandth of its size, worse where it is steep,
# a few outliers, and coordinates of a survey.
offset = np.array([432100.0, 5412300.0, 210.0])
surface = head().level_set(0.01)
rays = random.normal(size=(60000, 3))
rays /= np.linalg.norm(rays, axis=1, keepdims=True)
hits, normals = surface.raycast(3 * rays, -rays)
seen = np.isfinite(hits)
rays, hits, normals = rays[seen], hits[seen], normals[seen]
points = (3 - hits[:, None]) * rays + 0.001 * random.normal(size=(len(rays), 1)) * normals
confidence = np.clip(np.sum(rays * normals, axis=1), 0.05, 1)
colors = np.uint8(255 * (0.5 + 0.5 * normals))
points[:200] += random.normal(scale=0.2, size=(200, 3))

made = mv.reconstruct(
    points + offset, normals=normals, confidence=confidence, colors=colors,
    voxels=args.voxels, attributes=["Cd"],
)
save(made.level_set, args.output, "scan.vdb")
made.write(args.output / "scan.vdb")  # with Cd

print("dropped", made.report["dropped"], "noise {:.5f}".format(made.report["noise"]))
off = np.abs(made.level_set.distance(surface.closest_points(points[200:]) + offset))
print(f"half of the surface within {np.median(off):.5f} of the truth")
