"""What tests of the module share."""

import pathlib
import tempfile
import unittest

import numpy as np

import mpuvdb as mv

CENTER = np.array([0.3, -0.2, 0.1])


def sphere_points(count, radius=1.0, center=(0.0, 0.0, 0.0)):
    """Evenly spread (n, 3) points on a sphere, and their normals."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    angle = k * np.pi * (3 - np.sqrt(5))
    across = np.sqrt(1 - z * z)
    normals = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)
    return center + radius * normals, normals


def octahedron():
    vertices = np.array(
        [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float
    )
    faces = np.array(
        [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    )
    return vertices, faces


def radii(mesh, center=(0.0, 0.0, 0.0)):
    return np.linalg.norm(mesh.vertices - np.asarray(center), axis=1)


class FolderTest(unittest.TestCase):
    """Each test has a folder of its own."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="mpuvdb-test-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)


class ShapeTest(unittest.TestCase):
    def assert_sound(self, level_set):
        report = level_set.check()
        self.assertTrue(report.sound, [f.what for f in report.findings])

    def assert_volume(self, shape, expected, relative=0.02, voxel_size=0.04):
        level_set = shape.level_set(voxel_size) if isinstance(shape, mv.Shape) else shape
        self.assert_sound(level_set)
        volume = level_set.to_mesh().measure().volume
        self.assertAlmostEqual(volume / expected, 1, delta=relative)
