"""particles(): arrays and files of particles to level sets, with the grids beside them."""

import pathlib
import tempfile
import unittest

import mpuvdb as mv
import numpy as np

UNIT_BALL = (3 / (4 * np.pi)) ** (1 / 3)  # radius of a ball of unit volume


def pool(nx, ny, nz, jitter=0.2, seed=1):
    """Centers a unit apart, off their places by up to the jitter: each takes a unit of volume."""
    places = np.stack(np.meshgrid(*map(np.arange, (nx, ny, nz)), indexing="ij"), -1).reshape(-1, 3)
    return places + 0.5 + np.random.default_rng(seed).uniform(-jitter, jitter, places.shape)


class Particles(unittest.TestCase):
    def test_volume_and_soundness(self):
        centers = pool(16, 16, 10)
        made = mv.particles(centers, UNIT_BALL)
        self.assertTrue(made.level_set.check().sound)
        solid = made.level_set.measure()
        self.assertAlmostEqual(solid.volume / len(centers), 1, delta=0.04)
        self.assertEqual(solid.surfaces, 1)
        self.assertAlmostEqual(made.report["voxel_size"], UNIT_BALL / 2, places=6)
        self.assertEqual(made.grids, [])
        self.assertIn("2560 particles", repr(made))

    def test_types_strides_and_measured_radius(self):
        centers = pool(8, 8, 8, 0.1)
        doubles = mv.particles(centers)
        floats = mv.particles(np.asfortranarray(centers.astype(np.float32)))
        self.assertAlmostEqual(doubles.report["spacing"], 1, delta=0.05)
        self.assertAlmostEqual(
            doubles.level_set.measure().volume, floats.level_set.measure().volume, delta=0.1
        )

    def test_spheres_and_radii(self):
        made = mv.particles(
            np.array([[0.0, 0, 0], [5, 0, 0]]), np.array([1.0, 0.5]), surface="spheres", voxel_size=0.1
        )
        solid = made.level_set.measure()
        self.assertEqual(solid.surfaces, 2)
        self.assertAlmostEqual(solid.volume, 4 / 3 * np.pi * 1.125, delta=0.05)

    def test_velocities_colors_and_scalars(self):
        centers = pool(8, 8, 8)
        velocities = np.tile([1.0, -2.0, 0.5], (len(centers), 1))
        made = mv.particles(
            centers,
            UNIT_BALL,
            velocities,
            colors=np.full((len(centers), 3), 255, np.uint8),
            scalars={"age": np.full(len(centers), 3.0)},
        )
        self.assertEqual(made.grids, ["v", "Cd", "age"])
        indices, v = made.voxels("v")
        self.assertEqual(indices.shape, v.shape)
        np.testing.assert_allclose(v, np.broadcast_to([1, -2, 0.5], v.shape), atol=1e-5)
        np.testing.assert_allclose(made.voxels("Cd")[1], 1, atol=1e-5)
        np.testing.assert_allclose(made.voxels("age")[1], 3, atol=1e-5)
        with self.assertRaises(mv.UsageError):
            made.voxels("mass")
        self.assertEqual(mv.particles(centers, UNIT_BALL, velocities, velocity=False).grids, [])

    def test_attributes_of_arrays_are_chosen_by_name(self):
        centers = pool(8, 8, 8)
        of = {
            "colors": np.full((len(centers), 3), 255, np.uint8),
            "scalars": {"age": np.full(len(centers), 3.0), "id": np.arange(len(centers))},
        }
        for names in (["Cd"], ["age"], ["Cd", "id"]):
            made = mv.particles(centers, UNIT_BALL, attributes=names, **of)
            self.assertEqual(made.grids, names)
        for names in (["heat"], ["age", "heat"]):
            with self.assertRaisesRegex(mv.UsageError, "no 'heat'"):
                mv.particles(centers, UNIT_BALL, attributes=names, **of)
        with self.assertRaisesRegex(mv.UsageError, "Give it as colors"):
            mv.particles(centers, UNIT_BALL, attributes=["Cd"])

    def test_files(self):
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder, "drops.ply")
            file.write_text(
                "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
                "property float z\nproperty float pscale\nproperty float vx\nproperty float vy\n"
                "property float vz\nend_header\n0 0 0 0.5 1 2 3\n4 0 0 0.25 1 2 3\n"
            )
            made = mv.particles(file)
            self.assertEqual(made.report["largest_radius"], 0.5)
            self.assertEqual(made.grids, ["v"])
            written = pathlib.Path(folder, "drops.vdb")
            made.write(written)
            self.assertTrue(mv.load(written).level_set().check().sound)
            self.assertGreater(len(made.to_mesh().faces), 100)
            with self.assertRaises(mv.InputError):
                mv.particles(file, attributes=["temperature"])

    def test_bad_input(self):
        centers = pool(3, 3, 3)
        for radius in (0.0, -1.0):
            with self.assertRaises(mv.UsageError):
                mv.particles(centers, radius)
            with self.assertRaises(mv.InputError):
                mv.particles(centers, np.full(len(centers), radius))
        with self.assertRaises(mv.InputError):
            mv.particles(np.zeros((0, 3)))
        with self.assertRaises(mv.UsageError):
            mv.particles(centers, np.ones(4))
        with self.assertRaises(mv.UsageError):
            mv.particles(centers, UNIT_BALL, np.ones((4, 3)))
        with self.assertRaises(mv.UsageError):
            mv.particles(centers, UNIT_BALL, surface="lumpy")
        with self.assertRaises(mv.LimitError):
            mv.particles(centers, UNIT_BALL, voxel_size=0.002, max_bytes=100_000_000)

    def test_progress_stops(self):
        with self.assertRaises(mv.Interrupted):
            mv.particles(pool(20, 20, 20), UNIT_BALL, progress=lambda stage, fraction: False)


if __name__ == "__main__":
    unittest.main()
