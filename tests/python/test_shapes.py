"""Primitives, operators and deformations of shapes."""

import math
import unittest
import warnings

import numpy as np

import mpuvdb as mv
from fixture import CENTER, ShapeTest, octahedron, radii, sphere_points

PI = math.pi


class Primitives(ShapeTest):
    def test_volumes(self):
        cases = {
            "sphere": (mv.sphere((1, 2, 3), 0.5), 4 / 3 * PI * 0.5**3),
            "box": (mv.box((0, 0, 0), (1, 0.8, 0.6)), 0.48),
            "box by size": (mv.box(size=(1, 0.8, 0.6), center=CENTER), 0.48),
            "rounded box": (mv.rounded_box((0, 0, 0), (1, 1, 1), 0.5), 4 / 3 * PI * 0.5**3),
            "ellipsoid": (mv.ellipsoid((0, 0, 0), (0.7, 0.5, 0.4)), 4 / 3 * PI * 0.14),
            "capsule": (mv.capsule((0, 0, 0), (1, 1, 1), 0.3), PI * 0.09 * (math.sqrt(3) + 0.4)),
            "cylinder": (mv.cylinder((0, 0, 0), (0, 1, 0), 0.4), PI * 0.16),
            "cone": (mv.cone((0, 0, 0), (1, 0, 0), 0.5), PI * 0.25 / 3),
            "torus": (mv.torus(0.6, 0.2, axis="x"), 2 * PI**2 * 0.6 * 0.04),
            "half space": (mv.half_space((0, 0, 0), (0, 0, 1)) & mv.sphere(), 2 / 3 * PI),
            "solid": (mv.solid("difference(box(1,1,1), cylinder(0.3,3))"), 1 - PI * 0.09),
        }
        for name, (shape, volume) in cases.items():
            with self.subTest(name):
                self.assert_volume(shape, volume, voxel_size=0.03)

    def test_gyroid_fills_its_share(self):
        # Of random places 0.707 and 0.814 are that near to the gyroid.
        for thickness, share in ((0.125, 0.707), (0.15, 0.814)):
            wall = mv.gyroid(0.5, thickness) & mv.box(size=(1, 1, 1))
            self.assertAlmostEqual(wall.level_set(0.03).measure().volume, share, delta=0.01)

    def test_places(self):
        low, high = mv.sphere(CENTER, 0.5).bounds
        np.testing.assert_allclose((low + high) / 2, CENTER)
        np.testing.assert_allclose(high - low, 1)
        low, high = mv.cone((0, 0, 0), (0, 0, 2), 1).translate((0, 0, 1)).bounds
        self.assertAlmostEqual(low[2], 1, delta=0.01)
        self.assertAlmostEqual(high[2], 3, delta=0.01)
        self.assertTrue(np.isinf(mv.half_space((0, 0, 0), (0, 0, 1)).bounds[0]).any())

    def test_wrong_calls_say_how_to_call(self):
        calls = {
            "sphere": [(0.35,), (0, 0, 0, 1), (0.35, (1, 0, 0))],
            "ellipsoid": [(1, 2, 3), ((1, 2, 3),)],
            "torus": [(), (1,), ((0, 0, 0), 1, 0.3), (1, 0.3, "z")],
            "capsule": [(0.1, 1), (0, 1, 0.1)],
            "cylinder": [(0.1, 1), ((0, 0, 0), 1, 0.1)],
            "cone": [(0.5, 1), ((0, 0), (0, 1), 0.5)],
            "box": [(1,), (1, 1, 1), (-1, 1)],
            "rounded_box": [(1, 0.1), ((1, 1, 1), 0.1)],
            "half_space": [("z",), ((0, 0, 1),), (0, (0, 0, 1))],
            "gyroid": [(), (1,)],
            "solid": [(), (mv.sphere(),)],
            "function": [(abs, 1, 1), (abs, ((-1, -1, -1), (1, 1, 1)))],
        }
        for name, wrong in calls.items():
            for arguments in wrong:
                with self.subTest(name, arguments=arguments):
                    with self.assertRaises(TypeError) as caught:
                        getattr(mv, name)(*arguments)
                    said = str(caught.exception)
                    self.assertIn(f"Write {name}(", said)
                    self.assertNotIn("numpy", said)
                    # What it tells to write can be written.
                    for example in said.split("Write ")[1].split(";")[0].split(" or "):
                        self.assertIsInstance(eval("mv." + example, {"mv": mv}), mv.Shape)
        with self.assertRaisesRegex(TypeError, r"^sphere\(0.35\): .* sphere\(radius=0.5\)"):
            mv.sphere(0.35)
        with self.assertRaisesRegex(TypeError, r"^cone\(height=2\)"):
            mv.cone(height=2)
        with self.assertRaisesRegex(TypeError, "by: Vector"):
            mv.sphere().translate(1, 2, 3)
        self.assertIn("center: Vector", mv.sphere.__doc__)

    def test_sizes_out_of_range_say_which(self):
        nan, inf, o, z = math.nan, math.inf, (0, 0, 0), (0, 0, 1)
        s, bounds = mv.sphere(), ((-1, -1, -1), (1, 1, 1))
        grid = s.level_set(0.2)
        # What is said: the argument, and its value.
        for bad in (-1, 0, nan, inf):
            sizes = {
                "sphere: radius": lambda: mv.sphere(radius=bad),
                "torus: ring_radius": lambda: mv.torus(bad, 0.1),
                "torus: tube_radius": lambda: mv.torus(1, bad),
                "capsule: radius": lambda: mv.capsule(o, z, bad),
                "cylinder: radius": lambda: mv.cylinder(o, z, bad),
                "cone: radius": lambda: mv.cone(o, z, bad),
                "gyroid: its period": lambda: mv.gyroid(bad, 0.1),
                "gyroid: its thickness": lambda: mv.gyroid(1, bad),
                "function: steepness": lambda: mv.function(len, bounds, bad),
                "shell: thickness": lambda: s.shell(bad),
                "shell: thickness ": lambda: grid.shell(bad),
                "taper: start_factor": lambda: s.taper(bad, 1),
                "taper: end_factor": lambda: s.taper(1, bad),
                "warp: stretch": lambda: s.warp(lambda p: p, bounds, bad),
            }
            for what, call in sizes.items():
                with self.subTest(what, value=bad):
                    with self.assertRaisesRegex(mv.UsageError, f"^{what.strip()} is {bad}.*above 0"):
                        call()
            vectors = {
                "ellipsoid: radii": lambda: mv.ellipsoid(o, (1, bad, 1)),
                "box: size": lambda: mv.box(size=(1, bad, 1)),
            }
            for what, call in vectors.items():
                with self.subTest(what, value=bad):
                    said = rf"^{what} is \(1, {bad}, 1\).*above 0"
                    with self.assertRaisesRegex(mv.UsageError, said):
                        call()
        for bad in (nan, inf):
            numbers = {
                "offset: distance": lambda: s.offset(bad),
                "twist: degrees_per_unit": lambda: s.twist(bad),
                "bend: degrees_per_unit": lambda: s.bend(bad),
                "rotate: degrees": lambda: s.rotate(bad),
                "morph: t": lambda: s.morph(s, bad),
                "blend radius": lambda: mv.blend_union(s, s, bad),
            }
            for what, call in numbers.items():
                with self.subTest(what, value=bad):
                    with self.assertRaisesRegex(mv.UsageError, f"^{what} is {bad}"):
                        call()
            for what, call in {
                "sphere: center": lambda: mv.sphere((0, bad, 0)),
                "capsule: b": lambda: mv.capsule(o, (0, bad, 0), 1),
                "translate: by": lambda: s.translate((0, bad, 0)),
                "twist: axis": lambda: s.twist(1, axis=(0, bad, 0)),
            }.items():
                with self.subTest(what, value=bad):
                    with self.assertRaisesRegex(mv.UsageError, rf"^{what} is \(0, {bad}, 0\)"):
                        call()
        for call, said in {
            lambda: mv.torus(0.1, 1): "tube_radius is 1.*less than ring_radius, which is 0.1",
            lambda: mv.rounded_box(o, (1, 1, 1), 0.6): "radius is 0.6.*from 0 to 0.5",
            lambda: mv.union(s, s, blend=-2): "blend radius is -2",
            lambda: s.scale((1, 0, 1)): r"factor is \(1, 0, 1\)",
            lambda: s.bend(400): "degrees_per_unit is 400.*180",
            lambda: s.taper(1, 2, start=1, end=0): "start is 1 and end is 0",
            lambda: s.smooth(iterations=0): "0 iterations",
            lambda: s.smooth(width=0): "width is 0",
        }.items():
            with self.assertRaisesRegex(mv.UsageError, said):
                call()
        # A fillet for which no band is wide enough: bands hold 1000 voxels.
        for far in (mv.union(s, s, blend=100), mv.blend_union(s, s, "3000%")):
            with self.assertRaisesRegex(mv.LimitError, "blend radius.*at most 49.85"):
                far.level_set(0.05)
        self.assert_volume(mv.rounded_box(o, (1, 1, 1)), 1)

    def test_blend_takes_any_number_or_text(self):
        a, b = mv.sphere(), mv.sphere((1.2, 0, 0))
        for blend in (1, 1.0, np.float32(1), np.int64(1)):
            self.assertIn("blend 1", mv.union(a, b, blend=blend).explain(0.1))
        self.assertIn("blend", mv.difference(a, b, blend="1%").explain(0.1))
        with self.assertRaisesRegex(TypeError, "^blend: give a number"):
            mv.union(a, b, blend=None)

    def test_function_gets_many_points(self):
        sizes = []

        def ball(points):
            sizes.append(points.shape)
            return np.linalg.norm(points - CENTER, axis=1) - 0.5

        shape = mv.function(ball, (CENTER - 0.6, CENTER + 0.6), 1)
        level_set = shape.level_set(0.03)
        self.assert_sound(level_set)
        np.testing.assert_allclose(radii(level_set.to_mesh(), CENTER), 0.5, atol=2e-3)
        self.assertTrue(all(s[1] == 3 for s in sizes))
        self.assertEqual(max(s[0] for s in sizes), 512)

    def test_function_is_cut_off_at_its_bounds(self):
        lower = mv.function(lambda p: p[:, 2], ((-1, -1, -1), (1, 1, 1)), steepness=1.0)
        level_set = lower.level_set(0.1)
        self.assert_sound(level_set)
        # A grid rounds the cut's edges off within a voxel.
        self.assertAlmostEqual(level_set.measure().volume, 4, delta=16 * 0.1**2)
        values, origin = level_set.to_numpy()
        corner = np.rint((np.array([1.1, 1.1, 0.1]) - origin) / 0.1).astype(int)
        self.assertAlmostEqual(values[tuple(corner)], 0.1 * np.sqrt(3), delta=1e-4)
        mesh = lower.to_mesh(0.1)
        np.testing.assert_allclose(mesh.vertices.min(0), (-1, -1, -1), atol=1e-3)
        np.testing.assert_allclose(mesh.vertices.max(0), (1, 1, 0), atol=1e-3)
        # The same where only a part is asked for, and after a motion.
        part = (lower & mv.sphere((1, 1, 0), 0.5)).level_set(0.05)
        self.assert_sound(part)
        self.assertAlmostEqual(part.measure().volume, np.pi * 0.5**3 / 6, delta=4e-3)
        turned = lower.rotate(30).twist(degrees_per_unit=20, axis="z").level_set(0.05)
        self.assert_sound(turned)
        self.assertAlmostEqual(turned.measure().volume, 4, delta=0.02)

    def test_warp_that_leaves_its_bounds_is_refused(self):
        endless = mv.sphere(radius=0.5).warp(
            lambda p: p * np.array([0.0, 1.0, 1.0]), ((-1, -1, -1), (1, 1, 1)), stretch=1.0
        )
        with self.assertRaisesRegex(mv.InputError, "leaves its bounds"):
            endless.level_set(0.1)

    def test_warp_from_nowhere_is_refused(self):
        def torn(points):
            return np.where(points[:, :1] > 0.3, np.nan, points)

        for inverse in (torn, lambda points: points * np.nan):
            warped = mv.sphere(radius=0.5).warp(inverse, ((-1, -1, -1), (1, 1, 1)), stretch=1.0)
            with self.assertRaisesRegex(mv.InputError, "comes from is not finite"):
                warped.level_set(0.1)

    def test_function_errors(self):
        bounds = ((-1, -1, -1), (1, 1, 1))

        def raises(points):
            raise KeyError("mine")

        with self.assertRaisesRegex(KeyError, "mine"):
            mv.function(raises, bounds, 1).level_set(0.1)
        with self.assertRaisesRegex(mv.InputError, "shape"):
            mv.function(lambda points: 0.0, bounds, 1).level_set(0.1)
        with self.assertRaisesRegex(mv.InputError, "not finite"):
            mv.function(lambda points: np.full(len(points), np.nan), bounds, 1).level_set(0.1)
        with self.assertRaises(mv.UsageError):
            mv.function(3, bounds, 1)
        with self.assertRaises(mv.UsageError):
            mv.function(len, ((1, 1, 1), (0, 0, 0)), 1)


class Operators(ShapeTest):
    def setUp(self):
        self.a = mv.box(size=(1, 1, 1))
        self.b = mv.box(size=(1, 1, 1), center=(0.5, 0, 0))

    def test_operators(self):
        self.assert_volume(self.a | self.b, 1.5)
        self.assert_volume(self.a & self.b, 0.5)
        self.assert_volume(self.a ^ self.b, 1)
        self.assert_volume(self.a - self.b, 0.5)

    def test_functions(self):
        c = mv.box(size=(1, 1, 1), center=(0, 0.5, 0))
        self.assert_volume(mv.union(self.a, self.b, c), 2)
        self.assert_volume(mv.intersection(self.a, self.b, c), 0.25)
        self.assert_volume(mv.difference(self.a, self.b, c), 0.25)

    def test_operator_and_function_agree_to_the_bit(self):
        ours = (self.a - self.b).level_set(0.05).to_numpy()[0]
        theirs = mv.difference(self.a, self.b).level_set(0.05).to_numpy()[0]
        np.testing.assert_array_equal(ours, theirs)

    def test_blend_tells_where_it_has_no_room(self):
        a, b = mv.sphere(radius=0.85), mv.sphere((1, 0, 0), 0.85)
        with self.assertWarnsRegex(UserWarning, "up to 0.7 thick at .*0.35 has"):
            mv.intersection(a, b, blend=0.5).level_set(0.05)
        with self.assertWarnsRegex(UserWarning, "changed nothing"):
            mv.intersection(a, b, blend=1.5).level_set(0.05)

    def test_blend_fills_the_crease(self):
        plate = mv.box((-1, -1, -0.2), (1, 1, 0))
        post = mv.cylinder((0, 0, -0.2), (0, 0, 1), 0.4)
        sharp = (plate | post).to_mesh(0.04).measure().volume
        blended = mv.blend_union(plate, post, radius=0.2).to_mesh(0.04).measure().volume
        # The fillet's section is (1 - pi/4) r^2, its way around the post a bit over 2 pi 0.4.
        self.assertTrue(0.02 < blended - sharp < 0.035, blended - sharp)
        same = mv.union(plate, post, blend="0%").to_mesh(0.04).measure().volume
        self.assertEqual(same, sharp)

    def test_other_operands(self):
        with self.assertRaises(TypeError):
            self.a | 3
        with self.assertRaises(TypeError):
            mv.union(self.a, "b")
        with self.assertRaises(mv.UsageError):
            mv.union()

    def test_level_sets_are_shapes(self):
        half = self.b.level_set(0.04)
        self.assert_volume(self.a - half, 0.5)
        self.assert_volume(half | self.a, 1.5)
        self.assert_volume(half & half, 1)


    def test_level_sets_bring_their_voxel_size(self):
        ball = mv.sphere(radius=0.5).level_set(0.05)
        cut = ball - mv.box(size=(0.4, 0.4, 2)).level_set(0.02)
        self.assertAlmostEqual(cut.level_set().voxel_size, 0.02, places=6)
        self.assertEqual(
            len(cut.to_mesh().faces), len(cut.to_mesh(voxel_size=cut.level_set().voxel_size).faces)
        )
        with self.assertRaisesRegex(mv.UsageError, "voxel_size"):
            mv.sphere().level_set()

    def test_meshes_of_formulas_have_their_edges(self):
        # Near the edges of a turned box; the grid alone leaves them up to 0.03 voxels off.
        h = 0.04
        box = mv.box(size=(1, 0.8, 0.6)).rotate(33, (1, 2, 3))
        low, high = np.array((-0.5, -0.4, -0.3)), np.array((0.5, 0.4, 0.3))
        axis = np.array((1, 2, 3)) / math.sqrt(14)
        angle = math.radians(33)
        cross = np.array(((0, -axis[2], axis[1]), (axis[2], 0, -axis[0]), (-axis[1], axis[0], 0)))
        turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        at_home = np.asarray(box.to_mesh(h).vertices, float) @ turn
        off = np.abs(np.maximum(low - at_home, at_home - high).max(axis=1))
        self.assertLess(off.max(), 0.02 * h)

    def test_voxels_are_not_multiplied_unasked(self):
        fine = mv.sphere((1.2, 0, 0), 0.025).level_set(0.0025)
        both = mv.union(fine, mv.sphere((0, 0, 0), 1).level_set(0.1))
        for make in (both.level_set, both.to_mesh):
            with self.assertRaisesRegex(mv.LimitError, "64 times .* voxel_size"):
                make()
        self.assertIn("union", both.explain())
        self.assert_volume(both, 4 / 3 * PI, voxel_size=0.03)


class Surfaces(ShapeTest):
    def test_offset(self):
        ball = mv.sphere(radius=0.5)
        np.testing.assert_allclose(radii(ball.offset(0.2).to_mesh(0.04)), 0.7, atol=4e-3)
        percent = 100 * 0.1 / math.sqrt(3)  # the diagonal of the box is sqrt(3)
        np.testing.assert_allclose(radii(ball.offset(f"-{percent}%").to_mesh(0.04)), 0.4, atol=4e-3)

    def test_voxels_say_nothing_to_a_shape(self):
        with self.assertRaisesRegex(mv.UsageError, "no voxels"):
            mv.sphere().offset("2vx")
        with self.assertRaisesRegex(mv.UsageError, "not a length"):
            mv.sphere().offset("2 meters")

    def test_shell(self):
        def hollow(outer, inner):
            return 4 / 3 * PI * (outer**3 - inner**3)

        ball = mv.sphere(radius=0.5)
        self.assert_volume(ball.shell(0.2), hollow(0.5, 0.3))
        self.assert_volume(ball.shell(0.2, wall="outward"), hollow(0.7, 0.5))
        self.assert_volume(ball.shell(0.2, wall="centered"), hollow(0.6, 0.4))
        with self.assertRaisesRegex(mv.UsageError, "inward, outward, centered"):
            ball.shell(0.2, wall="inwards")

    def test_smooth_rounds_corners(self):
        cube = mv.box(size=(1, 1, 1))
        for name in ("mean", "gaussian", "median", "curvature"):
            with self.subTest(name):
                round_cube = cube.smooth(name, iterations=3).level_set(0.04)
                self.assertLess(radii(round_cube.to_mesh()).max(), math.sqrt(0.75) - 0.02)

    def test_morph(self):
        small, large = mv.sphere(radius=0.4), mv.sphere(radius=0.6)
        np.testing.assert_allclose(radii(small.morph(large, 0.5).to_mesh(0.04)), 0.5, atol=4e-3)
        with self.assertRaises(mv.UsageError):
            small.morph(large, 1.5)

    def test_explain_names_the_parts(self):
        text = (mv.sphere() - mv.box(size=(1, 1, 1)).offset(0.1)).explain(0.05)
        for word in ("difference", "sphere", "box", "offset", "MB"):
            self.assertIn(word, text)

    def test_memory_is_known_before(self):
        with self.assertRaises(mv.LimitError):
            mv.sphere().level_set(0.001, max_bytes=1000000)


    def test_nobody_takes_more_than_the_machine_has(self):
        for call in ("level_set", "to_mesh"):
            with self.assertRaisesRegex(mv.LimitError, "limit"):
                getattr(mv.sphere(), call)(3e-5)
        with self.assertRaisesRegex(mv.LimitError, "limit"):
            mv.sphere().write("never.vdb", 3e-5)

    def test_nothing_left_is_a_warning(self):
        wire = mv.capsule((0, 0.05, 0.05), (2, 0.05, 0.05), 0.06)
        ball = mv.sphere().level_set(0.1)
        for call in (
            lambda: wire.level_set(0.1),
            lambda: mv.sphere().level_set(1e9),
            lambda: ball.offset(-2),
            lambda: (mv.sphere() & mv.sphere(center=(9, 0, 0))).level_set(0.1),
        ):
            with self.assertWarnsRegex(UserWarning, "nothing is left"):
                self.assertEqual(call().active_voxels, 0)
        with self.assertWarnsRegex(UserWarning, "nothing is left"):
            nothing = mv.sphere().offset(-2).level_set(0.1)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            nothing.offset(0.1)


class Motions(ShapeTest):
    def setUp(self):
        self.rod = mv.box((0, -0.2, -0.1), (1, 0.2, 0.1))

    def assert_box(self, shape, low, high):
        vertices = shape.to_mesh(0.02).vertices
        np.testing.assert_allclose(vertices.min(axis=0), low, atol=0.01)
        np.testing.assert_allclose(vertices.max(axis=0), high, atol=0.01)

    def test_rigid(self):
        self.assert_box(self.rod.translate((1, 2, 3)), (1, 1.8, 2.9), (2, 2.2, 3.1))
        self.assert_box(self.rod.rotate(90), (-0.2, 0, -0.1), (0.2, 1, 0.1))
        self.assert_box(self.rod.rotate(90, axis="y"), (-0.1, -0.2, -1), (0.1, 0.2, 0))
        self.assert_box(self.rod.rotate(180, origin=(1, 0, 0)), (1, -0.2, -0.1), (2, 0.2, 0.1))
        for axis in ((0, 0, -5), "-z"):
            self.assert_box(self.rod.rotate(-90, axis=axis), (-0.2, 0, -0.1), (0.2, 1, 0.1))

    def test_scale(self):
        self.assert_box(self.rod.scale(2), (0, -0.4, -0.2), (2, 0.4, 0.2))
        self.assert_box(self.rod.scale((2, 1, 1), origin=(1, 0, 0)), (-1, -0.2, -0.1), (1, 0.2, 0.1))
        with self.assertRaises(mv.UsageError):
            self.rod.scale(0)

    def test_matrix(self):
        matrix = np.eye(4)
        matrix[:3, 3] = (1, 2, 3)
        self.assert_box(self.rod.transform(matrix), (1, 1.8, 2.9), (2, 2.2, 3.1))
        with self.assertRaisesRegex(mv.UsageError, "last row"):
            self.rod.transform(matrix.T)

    def test_twist_keeps_the_volume(self):
        bar = mv.box(size=(0.6, 0.4, 1))
        self.assert_volume(bar.twist(degrees_per_unit=90, axis="z"), 0.24)

    def test_bend_and_taper(self):
        bar = mv.box((-0.1, -0.1, 0), (0.1, 0.1, 2))
        bent = bar.bend(45, side="x")  # a quarter of a circle of radius 4 / pi
        self.assert_volume(bent, 0.08, relative=0.04, voxel_size=0.02)  # edges are rounded
        end = bent.to_mesh(0.02).vertices
        self.assertAlmostEqual(end[:, 0].max(), 4 / PI, delta=0.02)
        tapered = bar.taper(1, 0.5)
        self.assert_volume(tapered, 0.08 * 7 / 12, relative=0.04, voxel_size=0.02)

    def test_warp(self):
        ball = mv.sphere(radius=0.5)
        sheared = ball.warp(
            lambda p: p - np.stack([0.5 * p[:, 2], 0 * p[:, 1], 0 * p[:, 2]], axis=1),
            ((-1, -0.6, -0.6), (1, 0.6, 0.6)),
            stretch=1.3,
        )
        self.assert_volume(sheared, 4 / 3 * PI * 0.125)
        self.assertAlmostEqual(
            sheared.to_mesh(0.04).vertices[:, 0].max(), 0.5 * math.sqrt(1.25), delta=0.01
        )


class Meshes(ShapeTest):
    def test_octahedron(self):
        shape = mv.mesh(*octahedron())
        self.assert_volume(shape, 4 / 3)
        self.assert_volume(mv.mesh(mv.Mesh(*octahedron())) - mv.half_space((0, 0, 0), (0, 0, 1)), 2 / 3)

    def test_vertices_need_faces(self):
        for source in (np.zeros((3, 3)), 3):
            with self.assertRaisesRegex(mv.UsageError, "with them faces"):
                mv.mesh(source)


class Explained(ShapeTest):
    """What was made, held against what it was made of."""

    def test_points(self):
        points, normals = sphere_points(5000)
        made = mv.points(points, normals).level_set(0.05)
        report = made.explained
        self.assertIsInstance(report, mv.PointsExplained)
        self.assertTrue(report.sound, report.findings)
        self.assertEqual(report.points, 5000)
        self.assertEqual(report.within, 1)
        self.assertEqual((report.parts, report.cavities), (1, 0))
        self.assertAlmostEqual(report.volume, 4 / 3 * PI, delta=0.05)
        self.assertIsNone(report.mesh_volume)
        self.assertIn("PointsExplained", repr(report))

    def test_points_that_fill_a_solid(self):
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 21)] * 3), axis=-1).reshape(-1, 3)
        filled = grid[np.linalg.norm(grid, axis=1) < 1]
        with self.assertWarnsRegex(UserWarning, "fill a solid"):
            made = mv.points(filled).level_set(0.1)
        self.assertFalse(made.explained.sound)

    def test_meshes(self):
        made = mv.mesh(*octahedron()).level_set(0.04)
        report = made.explained
        self.assertIsInstance(report, mv.MeshExplained)
        self.assertTrue(report.sound, report.findings)
        self.assertAlmostEqual(report.volume_in, 4 / 3, places=5)
        self.assertLess(abs(report.volume_out - report.volume_in), report.volume_explained)
        self.assertEqual((report.parts_in, report.parts_out), (1, 1))
        self.assertEqual((report.cavities_in, report.cavities_out), (0, 0))

    def test_thin_walls(self):
        vertices, faces = octahedron()
        with self.assertWarnsRegex(UserWarning, "too thin for voxels"):
            made = mv.mesh(vertices * (1, 1, 0.02), faces).level_set(0.1)
        self.assertFalse(made.explained.sound)

    def test_operations_have_nothing_to_hold_against(self):
        made = mv.mesh(*octahedron()).level_set(0.1)
        self.assertIsNone(made.offset(0.1).explained)
        self.assertIsNone(mv.sphere(radius=1).level_set(0.1).explained)


if __name__ == "__main__":
    unittest.main()
