"""reconstruct(): arrays and files in, and the same bytes whichever way they come."""

import os
import subprocess
import unittest

import numpy as np

import mpuvdb as mv
from fixture import FolderTest, sphere_points


def same(a, b):
    """Whether two level sets have the same bytes."""
    (va, oa), (vb, ob) = a.to_numpy(), b.to_numpy()
    return va.shape == vb.shape and np.array_equal(va, vb) and np.array_equal(oa, ob)


class Reconstruct(FolderTest):
    def setUp(self):
        super().setUp()
        points, normals = sphere_points(5000)
        self.points, self.normals = points.astype(np.float32), normals.astype(np.float32)

    def test_arrays_of_any_layout_give_the_same_bytes(self):
        made = mv.reconstruct(self.points, self.normals, voxel_size=0.05)
        table = np.zeros(len(self.points), dtype=[("p", "f4", 3), ("c", "u1", 3), ("n", "f4", 3)])
        table["p"], table["n"] = self.points, self.normals
        for points, normals in (
            (table["p"], table["n"]),
            (self.points.astype(np.float64), self.normals),
            (np.asfortranarray(self.points), self.normals[::-1][::-1]),
        ):
            other = mv.reconstruct(points, normals, voxel_size=0.05)
            self.assertTrue(same(made.level_set, other.level_set))

    def test_shapes_give_the_same_bytes_at_every_half_width(self):
        for half_width in (3.0, 8.0, 20.0):
            made = mv.reconstruct(self.points, self.normals, voxel_size=0.05, half_width=half_width)
            shape = mv.points(self.points, self.normals, voxel_size=0.05)
            grid = shape.level_set(0.05, half_width=half_width)
            self.assertTrue(same(made.level_set, grid), half_width)
            self.assertTrue(grid.check().sound)

    @unittest.skipUnless("MPUVDB_COMMAND" in os.environ, "there is no command beside the module")
    def test_the_command_gives_the_same_bytes(self):
        colors = np.full((len(self.points), 3), [200, 30, 7], np.uint8)
        text = "".join(
            " ".join(repr(float(x)) for x in (*p, *n)) + " 200 30 7\n"
            for p, n in zip(self.points, self.normals)
        )
        (self.folder / "ball.xyz").write_text(text)
        for half_width in (3, 12):
            subprocess.run(
                [os.environ["MPUVDB_COMMAND"], "reconstruct", "ball.xyz", "-o", "ball.vdb",
                 "--voxel-size", "0.05", "--half-width", str(half_width)],
                cwd=self.folder, check=True, capture_output=True)
            made = mv.reconstruct(
                self.points, self.normals, colors=colors, voxel_size=0.05, half_width=half_width)
            self.assertEqual(made.grids, ["Cd"])
            made.write(self.folder / "own.vdb")
            own, theirs = self.folder / "own.vdb", self.folder / "ball.vdb"
            self.assertEqual(own.read_bytes(), theirs.read_bytes(), half_width)

    def test_what_is_asked_for_comes_beside(self):
        colors = np.tile(np.array([255, 0, 0], dtype=np.uint8), (len(self.points), 1))
        made = mv.reconstruct(
            self.points, self.normals, colors=colors, scalars={"heat": np.full(len(colors), 7.0)},
            voxel_size=0.05, coverage=True, attributes=["Cd", "heat"])
        self.assertEqual(made.grids, ["coverage", "Cd", "heat"])
        indices, values = made.voxels("Cd")
        self.assertEqual(indices.shape, (made.level_set.active_voxels, 3))
        np.testing.assert_allclose(values[:, 0], 1, atol=1e-3)
        np.testing.assert_allclose(made.voxels("heat")[1], 7, atol=1e-5)
        self.assertTrue((made.voxels("coverage")[1] == 1).all())
        self.assertEqual(made.report["points"], len(self.points))
        self.assertEqual(made.report["dropped"], {})
        self.assertGreater(made.report["coverage_spacing"], 0)
        made.write(self.folder / "ball.vdb")
        self.assertTrue(same(mv.LevelSet.read(self.folder / "ball.vdb"), made.level_set))
        self.assertGreater(len(made.to_mesh().faces), 0)
        with self.assertRaisesRegex(mv.UsageError, "coverage=True"):
            made.voxels("cold")

    def test_what_does_not_fit_is_refused(self):
        with self.assertRaisesRegex(mv.UsageError, "normals"):
            mv.reconstruct(self.points, self.normals[:-1])
        with self.assertRaisesRegex(mv.UsageError, r"\(n, 3\)"):
            mv.reconstruct(self.points[:, :2])
        with self.assertRaises(mv.LimitError):
            mv.reconstruct(self.points, self.normals, voxel_size=0.01, max_bytes=1 << 20)


if __name__ == "__main__":
    unittest.main()
