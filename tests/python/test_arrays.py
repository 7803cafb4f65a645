"""Numpy arrays, level sets and meshes in and out, and OpenVDB's own module."""

import math
import unittest
import warnings

import numpy as np

import mpuvdb as mv
from fixture import CENTER, FolderTest, ShapeTest, octahedron, radii, sphere_points

try:
    import openvdb as vdb
except ImportError:
    try:
        import pyopenvdb as vdb
    except ImportError:
        vdb = None


class Meshes(unittest.TestCase):
    def test_no_copy(self):
        mesh = mv.sphere().to_mesh(0.2)
        for view in (mesh.positions, mesh.faces):
            self.assertIs(view.base, mesh)
            self.assertFalse(view.flags.writeable)
        first, second = mesh.faces, mesh.faces
        self.assertTrue(np.shares_memory(first, second))
        self.assertEqual(mesh.positions.dtype, np.float32)
        self.assertEqual(mesh.faces.dtype, np.uint32)

    def test_repair(self):
        corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], float)
        quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        box = mv.mesh(corners, faces, repair=True).level_set(0.05)
        self.assertTrue(np.isclose(box.explained.volume_out, 1, atol=0.01))
        self.assertEqual(box.explained.repair.holes, 0)
        self.assertIsNone(mv.mesh(corners, faces).level_set(0.05).explained.repair)
        # Without its side at x = 1.
        opened = np.delete(faces, [5, 11], axis=0)
        with self.assertRaisesRegex(mv.InputError, "--repair"):
            mv.mesh(corners, opened).level_set(0.05)
        repaired = mv.mesh(mv.Mesh(corners, opened), repair=True).level_set(0.05)
        repair = repaired.explained.repair
        self.assertEqual((repair.holes, repair.dropped, repair.turned), (1, 0, 0))
        self.assertTrue(repaired.check().sound)
        self.assertAlmostEqual(repair.widest_hole, math.sqrt(2), delta=0.2)
        np.testing.assert_allclose(repair.widest_hole_at, (1, 0.5, 0.5), atol=0.05)
        self.assertAlmostEqual(repaired.explained.volume_out, 1, delta=0.02)
        with self.assertRaisesRegex(mv.InputError, "wide near"):
            mv.mesh(corners, opened, repair_holes=1).level_set(0.05)
        # A scaled mesh has scaled walls.
        square = mv.mesh(corners, faces[[0, 6]], thicken=0.2).scale(2).level_set(0.05)
        self.assertEqual(square.explained.repair.sheets, 1)
        self.assertAlmostEqual(square.explained.volume_out, 4 * 0.4, delta=0.8)
        damaged = np.vstack([corners, [[math.nan] * 3]])
        dropped = mv.mesh(damaged, np.vstack([faces, [[0, 1, 8]]]), repair=True).level_set(0.05)
        self.assertEqual(dropped.explained.repair.dropped, 1)
        with self.assertRaisesRegex(mv.UsageError, "thicken"):
            mv.mesh(corners, faces, thicken=-1)

    def test_base(self):
        n = 9
        x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 2, n), indexing="ij")
        height = 0.3 * x  # a ramp, so that the volume is exact
        vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
        a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
        faces = np.concatenate([np.stack([a, a + n, a + n + 1], 1), np.stack([a, a + n + 1, a + 1], 1)])
        voxel = 0.04
        block = mv.mesh(vertices, faces, base=0.5).level_set(voxel)
        self.assertTrue(block.check().sound)
        volume = 2 * (0.5 + 0.15)
        # Edges are rounded: a quarter of a squared voxel times a right angle, along all of them.
        rounding = voxel**2 / 4 * math.pi / 2 * 4 * (1 + 2 + 0.7)
        self.assertAlmostEqual(block.explained.volume_out, volume, delta=rounding)
        lying = mv.mesh(vertices[:, [1, 2, 0]], faces, base=0.5, up=(0, 1, 0)).level_set(voxel)
        self.assertAlmostEqual(lying.explained.volume_out, volume, delta=rounding)
        with self.assertRaisesRegex(mv.UsageError, "base"):
            mv.mesh(vertices, faces, base=0)
        with self.assertRaisesRegex(mv.InputError, "side"):
            mv.mesh(vertices * (1, 1, 0), faces, base=0.5, up=(1, 0, 0))

    def test_views_outlive_the_mesh(self):
        faces = mv.sphere().to_mesh(0.2).faces
        copy = faces.copy()
        for _ in range(3):
            mv.sphere().to_mesh(0.2)
        np.testing.assert_array_equal(faces, copy)

    def test_vertices_are_doubles_about_a_frame(self):
        far = np.array([1e6, -2e6, 3e6])
        vertices, faces = octahedron()
        mesh = mv.Mesh(vertices + far, faces)
        self.assertEqual(mesh.vertices.dtype, np.float64)
        np.testing.assert_allclose(mesh.vertices, vertices + far, atol=1e-7, rtol=0)
        np.testing.assert_allclose(mesh.frame + mesh.positions, mesh.vertices)
        self.assertAlmostEqual(mesh.measure().volume, 4 / 3)
        self.assertEqual(mesh.measure().boundary_edges, 0)

    def test_types_and_strides(self):
        vertices, faces = octahedron()
        expected = mv.Mesh(vertices, faces).vertices
        wide = np.zeros((12, 5), dtype=np.float32)
        wide[::2, 1:4] = vertices
        inputs = {
            "float32": vertices.astype(np.float32),
            "strided": wide[::2, 1:4],
            "column order": np.asfortranarray(vertices),
            "other byte order": vertices.astype(">f8"),
            "integers": vertices.astype(int),
            "lists": vertices.tolist(),
        }
        for name, given in inputs.items():
            with self.subTest(name):
                np.testing.assert_array_equal(mv.Mesh(given, faces).vertices, expected)
        for kind in (np.uint32, np.int32, np.uint8, np.int64):
            with self.subTest(kind):
                np.testing.assert_array_equal(mv.Mesh(vertices, faces.astype(kind)).faces, faces)

    def test_errors(self):
        vertices, faces = octahedron()
        for bad in (faces + 1, faces - 1):
            with self.assertRaisesRegex(mv.InputError, "outside"):
                mv.Mesh(vertices, bad)
        with self.assertRaisesRegex(mv.UsageError, r"\(n, 3\)"):
            mv.Mesh(vertices[:, :2], faces)
        with self.assertRaisesRegex(mv.UsageError, "integers"):
            mv.Mesh(vertices, faces.astype(float))
        with self.assertRaisesRegex(mv.UsageError, "no array"):
            mv.Mesh("vertices", faces)
        with self.assertRaisesRegex(mv.InputError, "finite"):
            mv.Mesh(np.where(vertices > 0, np.nan, vertices), faces)


class Points(ShapeTest):
    def test_arrays(self):
        points, normals = sphere_points(20000, 1, CENTER)
        for kind in (np.float32, np.float64):
            with self.subTest(kind):
                shape = mv.points(points.astype(kind), normals.astype(kind), tolerance="0.1%")
                level_set = shape.level_set(0.05)
                self.assert_sound(level_set)
                np.testing.assert_allclose(radii(level_set.to_mesh(), CENTER), 1, atol=5e-3)

    def test_arrays_are_read_in_place(self):
        # Rows of a record array, as PLY libraries have them: no numpy copy has these strides.
        points, normals = sphere_points(5000)
        table = np.zeros(5000, dtype=[("p", "f4", 3), ("n", "f4", 3), ("id", "i4")])
        table["p"], table["n"] = points, normals
        level_set = mv.points(table["p"], table["n"]).level_set(0.1)
        packed = mv.points(table["p"].copy(), table["n"].copy()).level_set(0.1)
        np.testing.assert_array_equal(level_set.to_numpy()[0], packed.to_numpy()[0])

    def test_cleaned_as_the_command_does(self):
        points, normals = sphere_points(5000)
        normals[::50] *= -1
        points[7] = (5, 5, 5)
        points[11] = np.nan
        with self.assertLogs("mpuvdb", "INFO") as logs:
            shape = mv.points(points, normals)
        text = "\n".join(logs.output)
        self.assertIn("not finite", text)
        self.assertIn("1 outliers", text)
        self.assertIn("turned", text)
        np.testing.assert_allclose(radii(shape.to_mesh(0.1)), 1, atol=0.02)
        with self.assertRaisesRegex(mv.InputError, "not finite"):
            mv.points(points, normals, bad_points="fail")

    def test_normals_are_estimated(self):
        points, _ = sphere_points(5000)
        with self.assertLogs("mpuvdb", "INFO") as logs:
            shape = mv.points(points)
        self.assertIn("normals estimated", "\n".join(logs.output))
        np.testing.assert_allclose(radii(shape.to_mesh(0.1)), 1, atol=0.02)

    def test_viewpoint(self):
        # From within, the sphere is a cavity: its normals look at the viewer.
        points, _ = sphere_points(5000)
        with self.assertWarnsRegex(UserWarning, "inward"):
            mv.points(points, viewpoint=(0, 0, 0))

    def test_positions_rounded_far_from_the_origin(self):
        points = np.random.default_rng(1).normal(size=(20000, 3))
        points *= 4 / np.linalg.norm(points, axis=1)[:, None]
        far = points + (412345.678, 5412345.678, 210.5)
        with self.assertWarnsRegex(UserWarning, "0.5 in y.*subtract an offset"):
            mv.points(far.astype(np.float32))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mv.points(far)

    def test_inward_normals(self):
        points, normals = sphere_points(5000)
        with self.assertWarnsRegex(UserWarning, "flip_normals=True"):
            mv.points(points, -normals, orient="keep")
        with self.assertLogs("mpuvdb", "INFO") as logs:
            shape = mv.points(points, -normals)
        self.assertIn("5000 normals looked inward", "\n".join(logs.output))
        self.assertGreater(shape.to_mesh(0.1).measure().volume, 4)
        shape = mv.points(points, -normals, flip_normals=True)
        self.assertGreater(shape.to_mesh(0.1).measure().volume, 4)

    def test_errors(self):
        points, normals = sphere_points(1000)
        cases = {
            "shape": (lambda: mv.points(points[:, :2]), mv.UsageError, r"\(n, 3\)"),
            "count": (lambda: mv.points(points, normals[:10]), mv.UsageError, "10 normals"),
            "empty": (lambda: mv.points(np.zeros((0, 3))), mv.InputError, "no points"),
            "word": (lambda: mv.points(points, outliers="no"), mv.UsageError, "drop, keep"),
            "unit": (lambda: mv.points(points, tolerance="1m"), mv.UsageError, "not a length"),
            "file": (lambda: mv.points("none.ply"), mv.IoError, "none.ply"),
            "file and normals": (lambda: mv.points("a.ply", normals), mv.UsageError, "array"),
        }
        for name, (call, error, text) in cases.items():
            with self.subTest(name), self.assertRaisesRegex(error, text):
                call()


class Files(FolderTest):
    def test_vdb(self):
        file = self.folder / "ball.vdb"
        mv.sphere(CENTER, 0.5).write(file, voxel_size=0.05, metadata={"maker": "test"})
        level_set = mv.LevelSet.read(file)
        self.assertAlmostEqual(level_set.voxel_size, 0.05)
        np.testing.assert_allclose(radii(mv.load(file).to_mesh(0.05), CENTER), 0.5, atol=5e-3)
        level_set.write(str(file), metadata={"other": "text"})
        with self.assertRaisesRegex(mv.UsageError, "metadata 'class'"):
            level_set.write(file, metadata={"class": "fog volume"})
        with self.assertRaisesRegex(mv.InputError, "surface"):
            mv.load(file, grid="density")

    def test_mesh_files(self):
        ball = mv.sphere(CENTER, 0.5)
        for name in ("ball.ply", "ball.obj", "ball.stl"):
            with self.subTest(name):
                file = self.folder / name
                ball.write(file, voxel_size=0.05)
                again = mv.mesh(file).to_mesh(0.05)
                np.testing.assert_allclose(radii(again, CENTER), 0.5, atol=5e-3)
                shape = mv.points([file])
                np.testing.assert_allclose(radii(shape.to_mesh(0.05), CENTER), 0.5, atol=0.01)

    def test_refused(self):
        with self.assertRaisesRegex(mv.UsageError, ".txt: of no kind"):
            mv.sphere().write(self.folder / "ball.txt", voxel_size=0.1)
        with self.assertRaises(mv.IoError) as caught:
            mv.sphere().write(self.folder / "none" / "ball.vdb", voxel_size=0.1)
        self.assertIsInstance(caught.exception, OSError)
        self.assertIsInstance(caught.exception, mv.Error)
        self.assertEqual(list(self.folder.iterdir()), [])


class Dense(ShapeTest):
    def test_values_are_distances(self):
        level_set = mv.sphere(CENTER, 0.5).level_set(0.05)
        values, origin = level_set.to_numpy()
        self.assertEqual(values.dtype, np.float32)
        index = np.moveaxis(np.indices(values.shape), 0, -1)
        distance = np.linalg.norm(origin + 0.05 * index - CENTER, axis=-1) - 0.5
        # Active voxels lie within the band, and may reach a little beyond their own distance.
        np.testing.assert_allclose(values, np.clip(distance, -0.15, 0.15), atol=1e-3)

    def test_there_and_back(self):
        for shape in (mv.sphere(CENTER, 0.5), mv.box(size=(1, 1, 1)).shell(0.2)):
            level_set = shape.level_set(0.05)
            values, origin = level_set.to_numpy()
            padded = np.pad(values, 1, constant_values=1)
            again = mv.LevelSet.from_numpy(padded, origin - 0.05, 0.05)
            self.assert_sound(again)
            back, place = again.to_numpy()
            np.testing.assert_array_equal(back, values)
            np.testing.assert_allclose(place, origin)

    def test_refused(self):
        with self.assertRaisesRegex(mv.UsageError, "3"):
            mv.LevelSet.from_numpy(np.zeros((4, 4)), (0, 0, 0), 1)
        with self.assertRaisesRegex(mv.InputError, "border"):
            mv.LevelSet.from_numpy(-np.ones((4, 4, 4)), (0, 0, 0), 1)
        step = np.ones((8, 8, 8))
        step[2:6, 2:6, 2:6] = -1  # as far as the band is wide: no distances
        for _ in range(2):
            with self.assertRaisesRegex(mv.InputError, "no distances"):
                mv.LevelSet.from_numpy(step, (0, 0, 0), 0.1)
            step[2, 2:6, 2:6] = 0  # as numpy.sign makes them
        with self.assertRaisesRegex(mv.InputError, "finite"):
            mv.LevelSet.from_numpy(np.full((4, 4, 4), np.nan), (0, 0, 0), 1)
        with self.assertRaises(mv.UsageError):
            mv.LevelSet.from_numpy(np.ones((4, 4, 4)), (0, 0, 0), 0)
        for far in (1e10, 1e30):
            with self.assertRaisesRegex(mv.LimitError, "from the world's"):
                mv.LevelSet.from_numpy(np.ones((4, 4, 4)), (0, far, 0), 0.05)
        for half_width in (1, 2000, float("nan")):
            with self.assertRaisesRegex(mv.UsageError, "half-width"):
                mv.LevelSet.from_numpy(np.ones((4, 4, 4)), (0, 0, 0), 1, half_width=half_width)

    def test_what_is_no_distance_is_measured_anew(self):
        i, j, k = np.indices((41, 41, 41)) - 20
        voxels = np.sqrt(i**2 + j**2 + k**2) - 10
        with self.assertWarnsRegex(UserWarning, "not distances .* measured anew"):
            anew = mv.LevelSet.from_numpy(voxels, (0, 0, 0), 0.05, half_width=60)
        self.assert_sound(anew)
        self.assertAlmostEqual(anew.half_width, 60, places=4)
        for scale in (0.7, 1.4):
            with self.assertWarnsRegex(UserWarning, "measured anew"):
                anew = mv.LevelSet.from_numpy(voxels * scale, (0, 0, 0), 1, half_width=6)
            grown = anew.offset(3).measure().volume
            # Along a chord between crossings planes are off by 3 / 8 R, voxels.
            self.assertAlmostEqual((grown * 0.75 / math.pi) ** (1 / 3), 13, delta=3 / 80)

    def test_steep_values_are_measured_anew(self):
        i, j, k = np.indices((41, 41, 41)) - 20
        ball = np.sqrt(i**2 + j**2 + k**2) - 10
        for scale in (4, 5, 10, 50, 100, 1e4):
            for half_width in (1.5, 3, 6):
                with self.subTest(scale=scale, half_width=half_width):
                    with self.assertWarnsRegex(UserWarning, "not distances .* measured anew"):
                        anew = mv.LevelSet.from_numpy(
                            ball * scale, (0, 0, 0), 1, half_width=half_width
                        )
                    self.assert_sound(anew)
                    self.assertAlmostEqual(anew.half_width, half_width, places=5)
                    radius = (anew.measure().volume * 0.75 / math.pi) ** (1 / 3)
                    # Along a chord between crossings planes are off by 3 / 8 R, voxels.
                    self.assertAlmostEqual(radius, 10, delta=3 / 80)

    def test_clipped_values_end_the_band(self):
        i, j, k = np.indices((41, 41, 41)) - 20
        ball = np.sqrt(i**2 + j**2 + k**2) - 10
        for clip in (2, 2.9, 3):
            for half_width in (3, 3.01, 6):
                if clip == half_width:
                    continue
                with self.assertWarnsRegex(UserWarning, f"there are {clip}"):
                    made = mv.LevelSet.from_numpy(
                        np.clip(ball, -clip, clip), (0, 0, 0), 1, half_width=half_width
                    )
                self.assertAlmostEqual(made.half_width, half_width, places=5)
                self.assert_sound(made)
                for distance in (4, -4):
                    volume = made.offset(distance).measure().volume
                    radius = (volume * 0.75 / math.pi) ** (1 / 3)
                    # Planes between crossings are off by 3 / 8 R, voxels; R is 6 at least.
                    self.assertAlmostEqual(radius, 10 + distance, delta=3 / 48)

    def test_isosurface_makes_distances(self):
        i, j, k = np.indices((41, 41, 41)) - 20
        voxels = np.sqrt(i**2 + j**2 + k**2) - 10
        mended = mv.LevelSet.isosurface(voxels, 0, inside="below", voxel_size=0.05)
        self.assert_sound(mended)
        # The same values are distances where a voxel is a unit.
        self.assert_sound(mv.LevelSet.from_numpy(voxels, (0, 0, 0), 1))


class Isosurface(ShapeTest):
    def setUp(self):
        i, j, k = np.indices((41, 41, 41)) * 0.05 - 1
        self.density = 1.5 - 2 * np.sqrt(i**2 + j**2 + k**2)  # 0.5 at radius 0.5
        self.place = {"origin": (-1, -1, -1), "voxel_size": 0.05}

    def test_density(self):
        ball = mv.LevelSet.isosurface(self.density, 0.5, **self.place)
        self.assert_sound(ball)
        # Crossings between voxels are linear, off by h^2 / 8r; vertices lie between crossings up to
        # the diagonal of a voxel's face apart, off by twice that.
        bound = 3 * 0.05**2 / (8 * 0.5)
        np.testing.assert_allclose(radii(ball.to_mesh()), 0.5, rtol=0, atol=bound)
        same = mv.LevelSet.isosurface(-self.density, -0.5, inside="below", **self.place)
        np.testing.assert_array_equal(ball.to_numpy()[0], same.to_numpy()[0])

    def test_refused(self):
        with self.assertRaisesRegex(mv.UsageError, "voxel_size"):
            mv.LevelSet.isosurface(self.density)
        with self.assertRaisesRegex(mv.UsageError, "inside"):
            mv.LevelSet.isosurface(self.density, inside="between", **self.place)
        with self.assertRaisesRegex(mv.InputError, "border"):
            mv.LevelSet.isosurface(self.density, -1, **self.place)
        with self.assertRaisesRegex(mv.InputError, "nothing is above 2"):
            mv.LevelSet.isosurface(self.density, 2, **self.place)


class LevelSets(ShapeTest):
    def setUp(self):
        self.ball = mv.sphere(radius=0.5).level_set(0.05)

    def test_properties(self):
        self.assertAlmostEqual(self.ball.voxel_size, 0.05)
        self.assertAlmostEqual(self.ball.half_width, 3, places=5)
        self.assertGreater(self.ball.memory, 4 * self.ball.active_voxels)
        self.assertIn("LevelSet", repr(self.ball))

    def test_voxels_are_a_unit(self):
        np.testing.assert_allclose(radii(self.ball.offset("2vx").to_mesh()), 0.6, atol=5e-3)
        self.assert_volume(self.ball.shell("4vx"), 4 / 3 * np.pi * (0.125 - 0.027))
        self.assertAlmostEqual(self.ball.resample("0.5vx").voxel_size, 0.025)

    def test_band(self):
        wide = self.ball.with_half_width(6)
        self.assertAlmostEqual(wide.half_width, 6, places=5)
        self.assert_sound(wide)

    def test_measure(self):
        measured = self.ball.measure()
        self.assertAlmostEqual(measured.volume, 4 / 3 * np.pi / 8, delta=0.005)
        self.assertAlmostEqual(measured.area, np.pi, delta=0.03)
        self.assertEqual((measured.surfaces, measured.genus), (1, 0))
        np.testing.assert_allclose(measured.bounds[0], -0.5, atol=0.01)

    def test_components(self):
        two = (mv.sphere(radius=0.5) | mv.sphere((2, 0, 0), 0.3)).level_set(0.05)
        parts = two.components()
        self.assertEqual(len(parts), 2)
        self.assertGreater(parts[0][1], parts[1][1])
        np.testing.assert_allclose(radii(parts[1][0].to_mesh(), (2, 0, 0)), 0.3, atol=5e-3)
        self.assertEqual(len(two.keep_components(count=1).components()), 1)
        self.assertEqual(len(two.keep_components(min_volume=0.2).components()), 1)
        for count in (0, -1):
            with self.assertRaisesRegex(ValueError, f"count {count}: must be at least 1"):
                two.keep_components(count=count)

    def test_findings(self):
        values, origin = self.ball.to_numpy()
        values[np.unravel_index(np.argmin(abs(values - 0.05)), values.shape)] = 0.15
        pierced = mv.LevelSet.from_numpy(np.pad(values, 1, constant_values=1), origin, 0.05)
        report = pierced.check()
        self.assertFalse(report)
        self.assertTrue(report.findings[0].what)
        self.assertEqual(len(report.findings[0].voxel), 3)

    def test_check_refuses_what_is_no_tolerance(self):
        ball = mv.sphere().level_set(0.2)
        for tolerance in (math.nan, -1):
            with self.assertRaisesRegex(mv.UsageError, "gradient_tolerance"):
                ball.check(tolerance)


@unittest.skipIf(vdb is None, "OpenVDB's Python module is not installed")
class PyOpenVdb(ShapeTest):
    def test_there(self):
        level_set = (mv.box(size=(1, 1, 1)).translate(CENTER)).level_set(0.05)
        grid = level_set.to_pyopenvdb()
        self.assertIsInstance(grid, vdb.FloatGrid)
        self.assertEqual(grid.activeVoxelCount(), level_set.active_voxels)
        self.assertAlmostEqual(grid.background, 0.15, places=6)
        voxel = grid.transform.worldToIndex(tuple(CENTER))
        values = grid.getConstAccessor()
        deep = values.probeValue(tuple(round(v) for v in voxel))
        self.assertEqual(deep, (-grid.background, False))

    def test_and_back(self):
        level_set = mv.sphere(CENTER, 0.5).level_set(0.04, half_width=4)
        again = mv.LevelSet.from_pyopenvdb(level_set.to_pyopenvdb())
        np.testing.assert_array_equal(again.to_numpy()[0], level_set.to_numpy()[0])
        np.testing.assert_allclose(again.origin, level_set.origin)
        self.assertEqual(again.active_voxels, level_set.active_voxels)
        self.assert_sound(again)

    def test_their_sphere(self):
        grid = vdb.createLevelSetSphere(radius=0.5, center=tuple(CENTER), voxelSize=0.05)
        shape = mv.LevelSet.from_pyopenvdb(grid).shape()
        np.testing.assert_allclose(radii(shape.to_mesh(0.05), CENTER), 0.5, atol=5e-3)

    def test_refused(self):
        with self.assertRaisesRegex(mv.InputError, "not a level set"):
            mv.LevelSet.from_pyopenvdb(vdb.FloatGrid(1.0))
        with self.assertRaisesRegex(mv.UsageError, "BoolGrid"):
            mv.LevelSet.from_pyopenvdb(vdb.BoolGrid())
        with self.assertRaisesRegex(mv.UsageError, "int"):
            mv.LevelSet.from_pyopenvdb(3)

    def test_what_was_copied_from_an_array_is_taken(self):
        own = mv.sphere(radius=0.5).level_set(0.05)
        values = np.full((40, 40, 40), 0.15, np.float32)
        own.to_pyopenvdb().copyToArray(values, ijk=(-20, -20, -20))
        grid = vdb.FloatGrid(0.15)
        grid.copyFromArray(values, ijk=(-20, -20, -20))
        grid.gridClass = vdb.GridClass.LEVEL_SET
        grid.transform = vdb.createLinearTransform(voxelSize=0.05)
        taken = mv.LevelSet.from_pyopenvdb(grid)
        self.assertEqual(taken.active_voxels, own.active_voxels)
        self.assert_sound(taken)
        self.assert_sound(taken.offset("2vx"))
        grid.background = 1.0
        with self.assertWarnsRegex(UserWarning, "promises a band of 20 voxels"):
            self.assert_sound(mv.LevelSet.from_pyopenvdb(grid))

    def test_what_is_not_finite_is_refused(self):
        for bad in (math.nan, math.inf):
            voxel = mv.sphere().level_set(0.2).to_pyopenvdb()
            voxel.getAccessor().setValueOn((5, 0, 0), bad)
            with self.assertRaisesRegex(mv.InputError, "1 values are not finite .*voxel 5, 0, 0"):
                mv.LevelSet.from_pyopenvdb(voxel)
            tile = mv.sphere().level_set(0.2).to_pyopenvdb()
            tile.fill((64, 64, 64), (71, 71, 71), bad, False)
            with self.assertRaisesRegex(mv.InputError, "about voxel 64, 64, 64 are not finite"):
                mv.LevelSet.from_pyopenvdb(tile)
            mask = vdb.FloatGrid(0.0)
            mask.getAccessor().setValueOn((0, 0, 0), bad)
            with self.assertRaisesRegex(mv.InputError, "not finite"):
                mv.sphere().level_set(0.2).smooth(mask=mask)

    def test_masked_smoothing(self):
        mask = vdb.FloatGrid(0.0)
        mask.transform = vdb.createLinearTransform(voxelSize=0.05)
        mask.fill((-100, -100, 0), (100, 100, 100), 1.0)
        cube = mv.box(size=(1, 1, 1))

        def corners(shape):
            """How far those below and those above reach out."""
            vertices = shape.to_mesh(0.05).vertices
            reach = np.linalg.norm(vertices, axis=1)
            return reach[vertices[:, 2] < -0.3].max(), reach[vertices[:, 2] > 0.3].max()

        below, above = corners(cube)
        smooth_below, smooth_above = corners(cube.smooth(iterations=3, mask=mask))
        self.assertAlmostEqual(smooth_below, below, places=6)
        self.assertLess(smooth_above, above - 0.02)


if __name__ == "__main__":
    unittest.main()
