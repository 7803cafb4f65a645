"""The benchmarks by script at their smallest: they run, and say what they promise to say.

    bench_test.py SUITE BUILD_FOLDER
"""
import importlib.machinery
import importlib.util
import json
import math
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as ElementTree

SUITE, BUILD = sys.argv[1:3]
FOLDER = os.path.dirname(SUITE)


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


@unittest.skipUnless(os.path.exists(os.path.join(BUILD, "tools/bench/fidelity_measure")),
                     "built without MPUVDB_BENCH")
class FidelityTest(unittest.TestCase):
    def run_set(self, name, *more):
        with tempfile.TemporaryDirectory() as folder:
            tables = os.path.join(folder, "accuracy.md")
            ended = subprocess.run(
                [sys.executable, os.path.join(FOLDER, "fidelity"), "--set", name, "--tiny",
                 "--build", BUILD, "--markdown", tables, *more],
                capture_output=True, text=True, check=False)
            self.assertEqual(ended.returncode, 0, ended.stderr)
            with open(tables, encoding="utf-8") as file:
                self.assertIn("| condition | there rms |", file.read())
        told = json.loads(ended.stdout)
        self.assertIn("there rms", ended.stderr)
        return told

    def check_exact(self, told, solids, conditions):
        self.assertEqual([(c["solid"], c["condition"]) for c in told["cases"]],
                         [(s, c) for c in conditions for s in solids])
        for case in told["cases"]:
            ours = case["mpuvdb"]
            self.assertNotIn("failed", ours)
            self.assertLess(ours["error"], 0.02)
            self.assertLess(ours["there"]["rms"], ours["there"]["max"])
            self.assertLess(ours["back"]["rms"], ours["back"]["max"])
            self.assertGreater(ours["cpu_seconds"], 0)
        for row in told["summary"]:
            self.assertGreater(row["there"]["rms"], 0)

    def test_develop_set(self):
        told = self.run_set("develop", "--conditions", "exact,misaligned,uneven")
        self.check_exact(told, ["torus"], ["exact", "misaligned", "uneven"])
        exact, misaligned, _ = (case["mpuvdb"] for case in told["cases"])
        self.assertEqual(exact["genus"], 1)
        self.assertLess(exact["error"], 1e-3)
        self.assertLess(exact["error"], misaligned["error"])

    def test_validation_set(self):
        told = self.run_set("validate", "--conditions", "exact,scanned,outliers")
        self.check_exact(told, ["part", "twist"], ["exact", "scanned", "outliers"])
        self.assertEqual([case["truth"] for case in told["cases"][:2]],
                         [{"components": 1, "genus": 1}, {"components": 1, "genus": 0}])
        twist = told["cases"][1]["mpuvdb"]
        self.assertTrue(twist["as_truth"])
        self.assertLess(twist["error"], 1e-3)

    def test_failures_are_recorded(self):
        for name in "develop", "validate":
            told = self.run_set(name, "--conditions", "exact", "--mpuvdb", "/bin/false")
            for case in told["cases"]:
                self.assertIn("false ended with status 1", case["mpuvdb"]["failed"])


class SensitivityTest(unittest.TestCase):
    TEXT = """// constexpr double kNot = 1;
constexpr double kPlain = 0.5;
/// Share of the points. [tuned: a test;
/// the same at 0.1]
constexpr double kAbove = 0.25, kTwo = 2;
static constexpr std::size_t kMany = 1'000; // points [tuned: a test]
constexpr float kSingle = 2; ///< [tuned: a test]
inline constexpr int kOne = 1;
constexpr double kTurn = 2 * kPlain;
"""

    @classmethod
    def setUpClass(cls):
        sys.dont_write_bytecode = True
        loader = importlib.machinery.SourceFileLoader("sensitivity",
                                                      os.path.join(FOLDER, "sensitivity"))
        cls.module = importlib.util.module_from_spec(
            importlib.util.spec_from_loader("sensitivity", loader))
        loader.exec_module(cls.module)
        cls.found = cls.module.constants_in(cls.TEXT, "src/points/some.cpp")

    def test_finds_constants(self):
        self.assertEqual([(c.name, c.line, c.is_tagged, c.is_number) for c in self.found],
                         [("kPlain", 2, False, True), ("kAbove", 5, True, True),
                          ("kTwo", 5, True, True), ("kMany", 6, True, True),
                          ("kSingle", 7, True, True), ("kOne", 8, False, True),
                          ("kTurn", 9, False, False)])

    def test_scales_what_it_finds(self):
        def scaled(name, factor):
            one = next(c for c in self.found if c.name == name)
            before, after = self.TEXT, self.module.rewritten(self.TEXT, one, factor)
            changed = [b for a, b in zip(before.split("\n"), after.split("\n")) if a != b]
            self.assertEqual(len(changed), 1)
            return changed[0]
        self.assertEqual(scaled("kPlain", 1.4), "constexpr double kPlain = 0.7;")
        self.assertEqual(scaled("kTwo", 0.7), "constexpr double kAbove = 0.25, kTwo = 1.4;")
        self.assertTrue(scaled("kMany", 0.7).startswith("static constexpr std::size_t kMany = 700;"))
        self.assertTrue(scaled("kSingle", 1.4).startswith("constexpr float kSingle = 2.8f;"))
        self.assertEqual(scaled("kOne", 1.4), "inline constexpr int kOne = 2;")
        with self.assertRaisesRegex(ValueError, "kOne: is 1, and a whole number stays at least 1"):
            scaled("kOne", 0.7)

    def test_chooses_by_name(self):
        def names(wanted):
            return [c.name for c in self.module.chosen(self.found, wanted)]
        self.assertEqual(names("some.cpp:kPlain"), ["kPlain"])
        self.assertEqual(names("src/points/*:k*"), ["kAbove", "kTwo", "kMany", "kSingle"])
        with self.assertRaisesRegex(ValueError, "there is no such constant"):
            names("src/points/some.cpp:kNone")
        with self.assertRaisesRegex(ValueError, r"is 2 \* kPlain, not a number"):
            names("src/points/some.cpp:kTurn")
        with self.assertRaisesRegex(ValueError, "is not FILE:NAME"):
            names("kPlain")

    def test_finds_tags_of_the_sources(self):
        tagged = [c for c in self.module.all_constants(self.module.ROOT) if c.is_tagged]
        self.assertGreater(len(tagged), 3)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
