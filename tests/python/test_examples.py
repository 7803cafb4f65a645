"""The scripts of houdini_free_examples, on models that they make up and on real scans."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import numpy as np

import mpuvdb as mv
from fixture import FolderTest

SCRIPTS = pathlib.Path(os.environ["MPUVDB_EXAMPLES"])
COMMAND = os.environ.get("MPUVDB_COMMAND")
BLENDER = shutil.which("blender")
# Prints a line for each grid that Blender reads of the files named: the file and the grid.
READ_GRIDS = """
import bpy, pathlib, sys
for path in sys.argv[sys.argv.index("--") + 1:]:
    bpy.ops.object.volume_import(filepath=path)
    volume = bpy.context.object.data
    volume.grids.load()
    if volume.grids.error_message:
        sys.exit(f"{path}: {volume.grids.error_message}")
    for grid in volume.grids:
        print("GRID", pathlib.Path(path).name, grid.name)
"""
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


class Recipes(ScriptTest):
    """The scripts of Houdini's recipes: what they claim, read from what they print and write; and
    where Blender is installed it opens all their grids."""

    def tearDown(self):
        files = sorted(self.folder.glob("*.vdb"))
        if BLENDER and files:
            call = [BLENDER, "-b", "--python-exit-code", "1", "--python-expr", READ_GRIDS, "--"]
            ended = subprocess.run([*call, *map(str, files)], capture_output=True, text=True)
            self.assertEqual(ended.returncode, 0, ended.stdout + ended.stderr)
            for file in files:
                self.assertIn(f"GRID {file.name} ", ended.stdout)
        super().tearDown()

    def number(self, text, pattern):
        found = re.search(pattern, text)
        self.assertIsNotNone(found, f"{pattern} is not in: {text}")
        return float(found.group(1))

    def run_shell(self, name):
        path = os.path.dirname(COMMAND) + os.pathsep + os.environ["PATH"]
        environment = {
            **os.environ,
            "PATH": path,
            "PYTHON": sys.executable,
            "OUTPUT": str(self.folder),
            "VOXELS": "60",
        }
        return self.output_of([str(SCRIPTS / name)], environment)

    def test_scan_to_surface(self):
        text = self.run_script("scan_to_surface.py", voxels=60)
        # Noise of a thousandth, averaged; voxels of a sixtieth.
        self.assertLess(self.number(text, r"within (\S+) of"), 0.0005)
        self.assertAlmostEqual(self.number(text, r"noise (\S+)"), 0.001, delta=0.0003)
        self.made("scan.vdb")

    def test_particles_to_fluid(self):
        text = self.run_script("particles_to_fluid.py", voxels=60)
        shares = [float(s) for s in re.findall(r"(\S+) % of their volume", text)]
        self.assertEqual(len(shares), 4)
        self.assertLess(max(shares) - min(shares), 2)
        self.assertTrue(all(abs(share - 100) < 5 for share in shares), shares)

    def test_boolean_kitbash(self):
        text = self.run_script("boolean_kitbash.py", voxels=100)
        self.assertLess(self.number(text, r"\| - 1\|: (\S+)"), 0.05)
        self.made("kitbash.vdb")

    def test_hollow_for_print(self):
        text = self.run_script("hollow_for_print.py", voxels=80)
        self.assertIn(" 0 open edges", text)
        self.assertAlmostEqual(self.number(text, r"wall of (\S+) mm"), 2, delta=0.1)
        self.made("hollow.vdb")

    def test_fillet_blend(self):
        text = self.run_script("fillet_blend.py", voxels=160)
        # The thinnest pipe's radius is nine voxels; both ways interpolation errs.
        self.assertLess(self.number(text, r"joint: (\S+) voxels"), 0.05)
        self.assertGreater(self.number(text, r"fillet: (\S+)"), 0.003)

    def test_twist_tower(self):
        text = self.run_script("twist_tower.py", voxels=60)
        self.assertLess(self.number(text, r"\| - 1\|: (\S+)"), 0.1)
        self.made("tower.vdb")
        self.made("tower_bent.vdb")

    @unittest.skipIf(COMMAND is None, "the command is not built")
    def test_morph_sequence(self):
        self.run_shell("morph_sequence.sh")
        self.assert_between("change.{:04}.vdb", 8)

    @unittest.skipIf(COMMAND is None, "the command is not built")
    def test_lookdev_handoff(self):
        text = self.run_shell("lookdev_handoff.sh")
        for name in ("surface", "density", "Cd"):
            self.assertIn(f"name: {name}", text)
        for name in ("lookdev.glb", "lookdev.usda"):
            self.assertTrue((self.folder / name).exists())

    @unittest.skipIf(COMMAND is None, "the command is not built")
    def test_farm_tiles(self):
        text = self.run_shell("farm_tiles.sh")
        self.assertIn("the same bytes as at once", text)
        self.made("farm.vdb")

    @unittest.skipIf(COMMAND is None, "the command is not built")
    def test_scan_to_print(self):
        text = self.run_shell("scan_to_print.sh")
        for fact in ("boundary_edges: 0", "self_intersections: 0"):
            self.assertIn(fact, text)
        # A shell of 2 between balls of 20 and 18, cut at 17 below the middle.
        def below(radius):
            height = radius - 17
            return np.pi * height**2 * (radius - height / 3)

        whole = 4 / 3 * np.pi * (20**3 - 18**3)
        expected = whole - below(20) + below(18)
        self.assertAlmostEqual(self.made("print.vdb") / expected, 1, delta=0.02)


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
        self.run_script("blended_busts.py", *files)
        self.assertGreater(self.made("busts_smooth.vdb"), self.made("busts_sharp.vdb") * 1.002)

    def test_head_to_head(self):
        files = self.scan("clouds/igea.ply"), self.scan("clouds/bimba_no_normals.ply")
        self.run_script("head_to_head.py", *files)
        self.assert_between("heads.{:04}.vdb", 5)

    def test_carved_and_twisted(self):
        names = "bunny/bun_zipper.ply", "clouds/igea.ply", "clouds/kitten.xyz"
        self.run_script("carved_and_twisted.py", *map(self.scan, names), voxels=60)
        self.assertGreater(self.made("wrung.vdb"), 0.05)


if __name__ == "__main__":
    unittest.main()
