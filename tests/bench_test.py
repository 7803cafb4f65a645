"""The benchmark suite at its smallest: it runs, and says what it promises to say.

    bench_test.py SUITE BUILD_FOLDER
"""
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

SUITE, BUILD = sys.argv[1:3]


class BenchTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with tempfile.TemporaryDirectory() as folder:
            plot = os.path.join(folder, "plot.svg")
            cls.ended = subprocess.run(
                [sys.executable, SUITE, "--tiny", "--runs", "1", "--build", BUILD, "--svg", plot],
                capture_output=True, text=True, check=False)
            cls.plot = ElementTree.parse(plot) if os.path.exists(plot) else None

    def test_measures_every_series(self):
        self.assertEqual(self.ended.returncode, 0, self.ended.stderr)
        series = json.loads(self.ended.stdout)["series"]
        self.assertEqual([s["varied"] for s in series],
                         ["points", "voxels", "tolerance", "threads"])
        for one in series:
            for case in one["cases"]:
                for key in ("ns_per_point", "ns_per_cell", "ns_per_active_voxel", "peak_bytes"):
                    self.assertGreater(case[key], 0)
                for stage in ("read", "sort", "fit", "sample", "write"):
                    self.assertIn(stage, case["stages"])
            self.assertIn(f"by {one['varied']}", self.ended.stderr)

    def test_fits_exponents(self):
        voxels = json.loads(self.ended.stdout)["series"][1]
        self.assertEqual([case["voxels"] for case in voxels["cases"]], [30, 60])
        for power in voxels["exponents"].values():
            self.assertTrue(math.isfinite(power))
        # Twice the voxels are four times the band.
        active = [case["active_voxels"] for case in voxels["cases"]]
        self.assertAlmostEqual(math.log2(active[1] / active[0]), 2, delta=0.3)

    def test_compares_with_yardsticks_where_they_are_built(self):
        if not os.path.exists(os.path.join(BUILD, "tools/bench/yardsticks")):
            self.skipTest("built without MPUVDB_BENCH")
        for one in json.loads(self.ended.stdout)["series"]:
            yards = one["yardsticks"]["ns_per_unit"]
            for name in ("createLevelSetSphere", "volumeToMesh", "csgUnionCopy", "memoryCopy",
                         "meshToVolume"):
                self.assertGreater(yards[name], 0)

    def test_plots(self):
        lines = self.plot.getroot().findall("{http://www.w3.org/2000/svg}polyline")
        self.assertGreater(len(lines), 4 * 4)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
