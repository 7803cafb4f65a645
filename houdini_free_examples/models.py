"""What the scripts beside this file share: their arguments, and models to play with.

Every script takes files of your own (scans, meshes, level sets) and makes up models where none is
given, so that it runs on a bare machine, too.
"""

import argparse
import pathlib

import numpy as np

import mpuvdb as mv


def arguments(text, *inputs):
    """The command line: files (all optional), where results go, and how fine they are."""
    parser = argparse.ArgumentParser(description=text)
    for name in inputs:
        parser.add_argument(name, nargs="?", help="points, mesh or level set; default: made up")
    parser.add_argument("-o", "--output", default=".", type=pathlib.Path, help="folder of results")
    parser.add_argument("--voxels", default=200, type=int, help="across a model (default: 200)")
    return parser.parse_args()


def unit(shape):
    """The shape about the origin, its longest side 1 long: models of all sizes fit each other."""
    low, high = shape.bounds
    return shape.translate(-(low + high) / 2).scale(1 / max(high - low))


def model(file, make_up):
    """What is in the file, or what make_up() makes, in unit size."""
    if file is None:
        return unit(make_up())
    return unit(mv.load(file) if file.endswith(".vdb") else mv.points(file))


def save(level_set, folder, name):
    """Write a level set, and say what it is like."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / name
    level_set.write(file)
    state = "sound" if level_set.check() else "NOT SOUND"
    volume = level_set.measure().volume
    print(f"{file}: {level_set.active_voxels} voxels, volume {volume:.4f}, {state}")


def knot(tube=0.35, count=30000):
    """Points on a trefoil knot with their normals, as a scanner would give them."""
    random = np.random.default_rng(11)
    along, around = random.uniform(0, 2 * np.pi, (2, count))

    def path(t):
        ring = 2 + np.cos(3 * t)
        return np.stack([ring * np.cos(2 * t), ring * np.sin(2 * t), np.sin(3 * t)], axis=1)

    # Two directions across the path at each place: the tube goes around it in their plane.
    tangent = path(along + 1e-4) - path(along - 1e-4)
    side = np.cross(tangent, path(along) * (1, 1, 0))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, tangent / np.linalg.norm(tangent, axis=1, keepdims=True))
    normals = np.cos(around)[:, None] * side + np.sin(around)[:, None] * up
    return mv.points(path(along) + tube * normals, normals)


def rabbit():
    """A toy rabbit that looks against x, its ears up along y."""
    body = mv.ellipsoid((0, 0, 0), (0.5, 0.4, 0.35))
    head = mv.sphere((-0.45, 0.4, 0), 0.25)
    ears = [mv.capsule((-0.45, 0.6, z), (-0.45, 1.05, 2 * z), 0.07) for z in (-0.1, 0.1)]
    tail = mv.sphere((0.55, -0.1, 0), 0.14)
    feet = [mv.capsule((0.1, -0.35, z), (-0.3, -0.35, z), 0.11) for z in (-0.2, 0.2)]
    return mv.union(body, head, tail, *ears, *feet, blend=0.08)


def head():
    """A toy head that looks along z."""
    skull = mv.ellipsoid((0, 0, 0), (0.38, 0.5, 0.42))
    nose = mv.capsule((0, 0.08, 0.4), (0, -0.08, 0.5), 0.05)
    ears = [mv.ellipsoid((x, 0, 0), (0.05, 0.12, 0.08)) for x in (-0.39, 0.39)]
    neck = mv.cylinder((0, -0.7, -0.05), (0, -0.3, -0.05), 0.2)
    eyes = [mv.sphere((x, 0.1, 0.4), 0.07) for x in (-0.15, 0.15)]
    mouth = mv.capsule((-0.1, -0.2, 0.42), (0.1, -0.2, 0.42), 0.03)
    return mv.difference(mv.union(skull, nose, neck, *ears, blend=0.04), *eyes, mouth, blend=0.02)


def statue():
    """A toy figure that stands upright along y."""
    base = mv.cylinder((0, 0, 0), (0, 0.1, 0), 0.35)
    coat = mv.cone((0, 0.05, 0), (0, 1.4, 0), 0.35)
    arms = [mv.capsule((0, 0.9, 0), (x, 0.55, 0.1), 0.07) for x in (-0.35, 0.35)]
    face = mv.sphere((0, 1.25, 0), 0.2)
    return mv.union(base, coat, face, *arms, blend=0.05)
