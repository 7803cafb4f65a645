"""The scripts of houdini_free_examples, on models that they make up and on real scans."""

import os
import pathlib
import subprocess
import sys
import unittest

import numpy as np

import mpuvdb as mv
from fixture import FolderTest

SCRIPTS = pathlib.Path(os.environ["MPUVDB_EXAMPLES"])
COMMAND = os.environ.get("MPUVDB_COMMAND")
DATA = os.environ.get("MPUVDB_DATA_DIR")


class ScriptTest(FolderTest):
    def run_script(self, name, *files, voxels=40):
        call = [sys.executable, str(SCRIPTS / name), *files, "--voxels", str(voxels)]
        return self.output_of([*call, "-o", str(self.folder)], os.environ)

    def output_of(self, call, environment):
        ended = subprocess.run(call, capture_output=True, text=True, env=environment)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assertNotIn("NOT SOUND", ended.stdout)
        return ended.stdout

    def made(self, name, components=1):
        """The volume of a result that is sound and of so many parts."""
        level_set = mv.LevelSet.read(self.folder / name)
        report = level_set.check()
        self.assertTrue(report, [finding.what for finding in report.findings])
        self.assertEqual(len(level_set.components()), components)
        return level_set.measure().volume

    def assert_between(self, name, frames):
        """Volumes go from one to the other; half-way nothing has torn off."""
        volumes = [self.made(name.format(frame)) for frame in range(1, frames + 1)]
        low, high = min(volumes[0], volumes[-1]), max(volumes[0], volumes[-1])
        for volume in volumes:
            self.assertGreater(volume, 0.8 * low)
            self.assertLess(volume, 1.1 * high)


class MadeUp(ScriptTest):
    def test_knot_offsets(self):
        plan = self.run_script("knot_offsets.py", voxels=60)
        self.assertIn("offset 0.05", plan)
        # A tube of radius r along a path of length l has volume pi r^2 l.
        t = np.linspace(0, 2 * np.pi, 5000)
        ring = 2 + np.cos(3 * t)
        path = np.stack([ring * np.cos(2 * t), ring * np.sin(2 * t), np.sin(3 * t)], axis=1)
        tube = 0.35
        unit = 1 / (max(np.ptp(path, axis=0)) + 2 * tube)
        length = unit * np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        radii = unit * tube + np.array((-0.025, 0, 0.025, 0.05))
        expected = np.pi * (radii**2).sum() * length
        self.assertAlmostEqual(self.made("knot_offsets.vdb", components=4) / expected, 1, delta=0.03)

    def test_blended_busts(self):
        self.run_script("blended_busts.py")
        sharp, smooth = self.made("busts_sharp.vdb"), self.made("busts_smooth.vdb")
        self.assertGreater(smooth, sharp * 1.002)
        self.assertLess(smooth, sharp * 1.1)
        self.made("busts_coat.vdb")

    def test_head_to_head(self):
        self.run_script("head_to_head.py")
        self.assert_between("heads.{:04}.vdb", 5)

    @unittest.skipIf(COMMAND is None, "the command is not built")
    def test_octahedron_to_cube(self):
        path = os.path.dirname(COMMAND) + os.pathsep + os.environ["PATH"]
        environment = {**os.environ, "PATH": path, "OUTPUT": str(self.folder), "VOXELS": "40"}
        self.output_of([str(SCRIPTS / "octahedron_to_cube.sh")], environment)
        self.assertAlmostEqual(self.made("morph.0001.vdb"), 4 / 3 * 1.2**3, delta=0.05)
        self.assertAlmostEqual(self.made("morph.0007.vdb"), 1.4**3, delta=0.05)
        self.assert_between("morph.{:04}.vdb", 7)
        self.assertEqual(len(list(self.folder.glob("morph.*.png"))), 7)

    def test_carved_and_twisted(self):
        self.run_script("carved_and_twisted.py", voxels=60)
        self.assertGreater(self.made("carved.vdb"), 0.01)
        self.assertGreater(self.made("wrung.vdb"), 0.03)


@unittest.skipIf(DATA is None, "MPUVDB_DATA_DIR names no folder of real scans")
class RealScans(ScriptTest):
    """The same scripts on the models of the paper, as far as they are there."""

    def scan(self, name):
        file = pathlib.Path(DATA) / name
        if not file.exists():
            self.skipTest(f"{file} is not there")
        return str(file)

    def test_blended_busts(self):
        files = self.scan("bunny/bun_zipper.ply"), self.scan("clouds/igea.ply")
        self.run_script("blended_busts.py", *files, voxels=60)
        self.assertGreater(self.made("busts_smooth.vdb"), self.made("busts_sharp.vdb") * 1.002)

    def test_head_to_head(self):
        files = self.scan("clouds/igea.ply"), self.scan("clouds/bimba_no_normals.ply")
        self.run_script("head_to_head.py", *files, voxels=60)
        self.assert_between("heads.{:04}.vdb", 5)

    def test_carved_and_twisted(self):
        names = "bunny/bun_zipper.ply", "clouds/igea.ply", "clouds/kitten.xyz"
        self.run_script("carved_and_twisted.py", *map(self.scan, names), voxels=60)
        self.assertGreater(self.made("wrung.vdb"), 0.05)


if __name__ == "__main__":
    unittest.main()
