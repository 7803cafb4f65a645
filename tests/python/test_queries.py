"""Questions to level sets and shapes: arrays in, arrays out."""

import threading
import unittest

import numpy as np

import mpuvdb as mv

VOXEL = 0.05


def places(count, reach=2.0, seed=1):
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


class Queries(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.ball = mv.sphere().level_set(VOXEL)
        cls.points = places(5000)
        cls.radii = np.linalg.norm(cls.points, axis=1)

    def test_distance(self):
        distances = self.ball.distance(self.points)
        self.assertEqual((distances.shape, distances.dtype), ((5000,), np.float64))
        away = self.radii > 2 * VOXEL
        np.testing.assert_allclose(distances[away], self.radii[away] - 1, atol=3e-3 * VOXEL)

    def test_gradient_and_closest_points(self):
        gradients = self.ball.gradient(self.points)
        closest = self.ball.closest_points(self.points)
        self.assertEqual((gradients.shape, closest.shape), ((5000, 3), (5000, 3)))
        np.testing.assert_allclose(np.linalg.norm(gradients, axis=1), 1, atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(closest, axis=1), 1, atol=5e-3 * VOXEL)
        distances = self.ball.distance(self.points)
        np.testing.assert_allclose(
            self.points - distances[:, None] * gradients, closest, atol=1e-4 * VOXEL
        )

    def test_contains(self):
        inside = self.ball.contains(self.points)
        self.assertEqual(inside.dtype, np.bool_)
        clear = np.abs(self.radii - 1) > 1e-3 * VOXEL
        np.testing.assert_array_equal(inside[clear], (self.radii < 1)[clear])

    def test_raycast(self):
        origins = np.array([[0, 0, 3.0], [0, 0, 0], [0, 0, 3], [3, 3, 3]])
        directions = np.array([[0, 0, -2.0], [1, 0, 0], [0, 0, 1], [-1, -1, -1]])
        hits, normals = self.ball.raycast(origins, directions)
        expected = [1, 1, np.inf, 3 - 1 / np.sqrt(3)]
        np.testing.assert_allclose(hits, expected, atol=1e-3 * VOXEL)
        np.testing.assert_allclose(normals[0], [0, 0, 1], atol=1e-3)
        np.testing.assert_allclose(normals[1], [1, 0, 0], atol=1e-3)
        self.assertTrue(np.isnan(normals[2]).all())

    def test_shapes_are_sharp(self):
        box = mv.box(size=(2, 2, 2), center=(0, 0, 0)).rotate(20, axis=(1, 2, 3))
        corner = box.closest_points(np.array([[4.0, 4, 4]]), voxel_size=VOXEL)
        self.assertAlmostEqual(np.linalg.norm(corner), np.sqrt(3), delta=1e-2 * VOXEL)
        self.assertTrue(box.contains([[0.9, 0, 0]], voxel_size=VOXEL)[0])
        with self.assertRaisesRegex(mv.UsageError, "voxel_size"):
            box.distance([[0.0, 0, 0]])

    def test_another_voxel_size_is_another_answer(self):
        shape = mv.sphere()
        point = np.array([[0.3, 0.2, 0.1]])
        coarse, fine = (shape.distance(point, voxel_size=v)[0] for v in (0.4, 0.02))
        exact = np.linalg.norm(point) - 1
        self.assertLess(abs(fine - exact), abs(coarse - exact))
        self.assertEqual(fine, shape.distance(point, voxel_size=0.02)[0])

    def test_types_and_strides(self):
        wide = np.zeros((50, 7), dtype=np.float32)
        wide[:, 2:5] = self.points[:50]
        expected = self.ball.distance(wide[:, 2:5].astype(float))
        for given in (wide[:, 2:5], np.asfortranarray(wide[:, 2:5]), wide[:, 2:5].tolist()):
            np.testing.assert_array_equal(self.ball.distance(given), expected)
        self.assertEqual(self.ball.distance(np.zeros((0, 3))).shape, (0,))

    def test_refusals(self):
        with self.assertRaisesRegex(mv.UsageError, r"\(n, 3\)"):
            self.ball.distance(np.zeros((4, 2)))
        with self.assertRaisesRegex(mv.UsageError, "direction"):
            self.ball.raycast(np.zeros((1, 3)), np.zeros((1, 3)))
        with self.assertRaisesRegex(mv.UsageError, "2 origins"):
            self.ball.raycast(np.zeros((2, 3)), np.ones((1, 3)))

    def test_not_finite(self):
        distances = self.ball.distance([[np.nan, 0, 0], [np.inf, 0, 0]])
        self.assertTrue(np.isnan(distances).all())

    def test_from_many_threads(self):
        fresh = mv.sphere().level_set(VOXEL)
        found = [None] * 4

        def ask(n):
            found[n] = fresh.distance(self.points)

        threads = [threading.Thread(target=ask, args=(n,)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        for one in found:
            np.testing.assert_array_equal(one, found[0])

    def test_stops(self):
        with self.assertRaises(mv.Interrupted):
            mv.sphere().level_set(0.02).distance(
                places(2_000_000, 3.0), progress=lambda stage, fraction: False
            )


if __name__ == "__main__":
    unittest.main()
