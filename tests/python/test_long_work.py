"""Progress, stopping, and threads."""

import importlib.util
import os
import signal
import sys
import tempfile
import threading
import time
import unittest
import unittest.mock

import numpy as np

import mpuvdb as mv
from fixture import FolderTest, octahedron, sphere_points

LATEST = 0.25  # seconds from the wish to stop until the work has ended
SLACK = float(os.environ.get("MPUVDB_TEST_SLACK", "0.5"))  # for a busy machine
OPENVDB = importlib.util.find_spec("openvdb") or importlib.util.find_spec("pyopenvdb")


def long_shape():
    """Many seconds of work at a voxel size of 0.004."""
    balls = [mv.sphere((0.3 * k, 0, 0), 0.5) for k in range(6)]
    return mv.union(*balls, blend=0.1).shell(0.1)


class Progress(unittest.TestCase):
    def test_stages_and_fractions(self):
        seen = []
        mv.sphere().level_set(0.02, progress=lambda stage, fraction: seen.append((stage, fraction)))
        self.assertIn("sample", [stage for stage, _ in seen])
        self.assertTrue(all(0 <= fraction <= 1 for _, fraction in seen))
        last = None
        for stage, fraction in seen:
            if last and last[0] == stage and fraction > 0:
                self.assertGreaterEqual(fraction, last[1])
            last = (stage, fraction)

    def test_called_on_the_callers_thread(self):
        threads = set()
        mv.sphere().level_set(0.02, progress=lambda *_: threads.add(threading.get_ident()))
        self.assertEqual(threads, {threading.get_ident()})

    def test_false_stops(self):
        calls = []

        def stop(*report):
            calls.append(report)
            return False

        begin = time.monotonic()
        with self.assertRaises(mv.Interrupted):
            long_shape().level_set(0.004, progress=stop)
        self.assertLess(time.monotonic() - begin, 1 + SLACK)
        self.assertEqual(len(calls), 1)

    def test_false_of_numpy_stops(self):
        with self.assertRaises(mv.Interrupted):
            mv.sphere().level_set(0.1, progress=lambda *_: np.False_)

    def test_other_values_do_not(self):
        for value in (None, True, 0, "", np.True_, np.zeros(1)):
            mv.sphere().level_set(0.1, progress=lambda *_: value)

    def test_raising_stops(self):
        def fail(*_):
            raise KeyError("mine")

        with self.assertRaisesRegex(KeyError, "mine"):
            long_shape().level_set(0.004, progress=fail)

    def test_must_be_callable(self):
        with self.assertRaisesRegex(TypeError, "progress"):
            mv.sphere().level_set(0.1, progress=3)

    def test_every_long_call_reports(self):
        ball = mv.sphere().level_set(0.05)
        points, normals = sphere_points(5000)
        calls = {
            "points": lambda p: mv.points(points, normals, progress=p),
            "mesh": lambda p: mv.sphere().to_mesh(0.05, progress=p),
            "check": lambda p: ball.check(progress=p),
            "offset": lambda p: ball.offset(0.1, progress=p),
        }
        for name, call in calls.items():
            with self.subTest(name):
                seen = []
                call(lambda *report: seen.append(report))
                self.assertTrue(seen)


class Interrupts(FolderTest):
    def setUp(self):
        super().setUp()
        # Shells start what is in the background with Ctrl-C ignored, and Python leaves it so.
        self.addCleanup(signal.signal, signal.SIGINT, signal.signal(signal.SIGINT, signal.default_int_handler))

    def interrupt(self, work, after=0.4):
        """Seconds from SIGINT until work() has raised KeyboardInterrupt."""
        sent = []

        def send():
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Timer(after, send)
        timer.start()
        try:
            with self.assertRaises(KeyboardInterrupt):
                work()
            return time.monotonic() - sent[0]
        finally:
            timer.cancel()
            timer.join()

    def test_evaluation(self):
        shape = long_shape()
        seconds = self.interrupt(lambda: shape.level_set(0.003))
        self.assertLess(seconds, LATEST + SLACK)

    def test_writing_leaves_nothing(self):
        self.interrupt(lambda: long_shape().write(self.folder / "a.vdb", voxel_size=0.003))
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_python_function(self):
        shape = mv.function(
            lambda p: np.linalg.norm(p, axis=1) - 1, ((-1.1,) * 3, (1.1,) * 3), 1
        )
        seconds = self.interrupt(lambda: shape.level_set(0.004))
        self.assertLess(seconds, LATEST + SLACK)

    def test_arrays(self):
        side = np.linspace(-1, 1, 300, dtype=np.float32) ** 2
        density = 0.7 - np.sqrt(side[:, None, None] + side[None, :, None] + side[None, None])
        far_apart = (mv.sphere((-3, -3, -3)) | mv.sphere((3, 3, 3))).level_set(0.0125)
        calls = {
            "isosurface": lambda: mv.LevelSet.isosurface(density, 0, voxel_size=2 / 299),
            "to_numpy": far_apart.to_numpy,
        }
        for name, call in calls.items():
            with self.subTest(name):
                self.assertLess(self.interrupt(call, after=0.05), LATEST + SLACK)

    def test_files(self):
        file = self.folder / "a.vdb"
        mv.sphere().level_set(0.002).write(file)
        for after in (0.05, 0.3):
            with self.subTest(after):
                seconds = self.interrupt(lambda: mv.LevelSet.read(file), after)
                self.assertLess(seconds, LATEST + SLACK)

    @unittest.skipIf(OPENVDB is None, "OpenVDB's Python module is not installed")
    def test_exchange_leaves_nothing(self):
        """Nor is the wish to stop swallowed, whenever it comes."""
        ball = mv.sphere().level_set(0.05)

        def exchange():
            for _ in range(300):
                mv.LevelSet.from_pyopenvdb(ball.to_pyopenvdb())

        with unittest.mock.patch.object(tempfile, "tempdir", str(self.folder)):
            for k in range(12):
                self.interrupt(exchange, after=0.1 + 0.0037 * k)
                self.assertEqual(list(self.folder.iterdir()), [])

    @unittest.skipIf(OPENVDB is None, "OpenVDB's Python module is not installed")
    def test_exchange_works_after_an_import_that_was_interrupted(self):
        """Python keeps such a module, whose specification it had not come to."""
        ball = mv.sphere().level_set(0.1)
        ball.to_pyopenvdb()
        module = sys.modules[OPENVDB.name]
        with unittest.mock.patch.object(module, "__spec__", None):
            again = mv.LevelSet.from_pyopenvdb(ball.to_pyopenvdb())
        self.assertEqual(again.active_voxels, ball.active_voxels)

    def test_the_next_call_works(self):
        self.interrupt(lambda: long_shape().level_set(0.003), after=0.2)
        self.assertGreater(mv.sphere().level_set(0.1).active_voxels, 100)


class Threads(unittest.TestCase):
    def test_python_goes_on(self):
        """Other threads of Python run while a level set is made."""
        ticks = []
        done = threading.Event()

        def tick():
            while not done.is_set():
                ticks.append(time.monotonic())
                time.sleep(0.005)

        thread = threading.Thread(target=tick)
        thread.start()
        long_shape().level_set(0.02)
        done.set()
        thread.join()
        self.assertGreater(len(ticks), 5)

    def test_many_at_once(self):
        def ball(points):
            return np.linalg.norm(points, axis=1) - 0.5

        shared = mv.union(mv.sphere(radius=0.4), mv.mesh(*octahedron()).scale(0.5), blend=0.05)
        shapes = [
            shared,
            shared.offset(0.1),
            mv.function(ball, ((-0.6,) * 3, (0.6,) * 3), 1),
            mv.box(size=(1, 1, 1)).twist(90) - shared,
        ]
        expected = [shape.level_set(0.05).to_numpy()[0] for shape in shapes]
        results = {}

        def work(k):
            results[k] = shapes[k % len(shapes)].level_set(0.05).to_numpy()[0]

        threads = [threading.Thread(target=work, args=(k,)) for k in range(16)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(results), 16)
        for k, values in results.items():
            np.testing.assert_array_equal(values, expected[k % len(shapes)])

    def test_errors_stay_in_their_thread(self):
        caught = []

        def work():
            try:
                mv.sphere().level_set(-1)
            except mv.UsageError as error:
                caught.append(error)

        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        mv.sphere().level_set(0.1)
        for thread in threads:
            thread.join()
        self.assertEqual(len(caught), 4)


if __name__ == "__main__":
    unittest.main()
