"""Jobs run by engines: the same bytes as at once, though tasks are killed."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

from fixture import FolderTest

COMMAND = os.environ.get("MPUVDB_COMMAND")


def installed(*programs):
    """Whether all of them are; a test is skipped where an engine is not."""
    return all(shutil.which(program) for program in programs)


def run(*words):
    """The command with these words, ended."""
    return subprocess.run([COMMAND, *map(str, words), "--progress", "none"], capture_output=True, text=True)


class JobTest(FolderTest):
    options = ["--voxels", "260", "--normals", "keep"]

    @classmethod
    def setUpClass(cls):
        # A cloud and its grid, which all tests compare with and none writes.
        folder = tempfile.TemporaryDirectory(prefix="mpuvdb-test-")
        cls.addClassCleanup(folder.cleanup)
        cls.cloud = pathlib.Path(folder.name) / "cloud.ply"
        cls.expected = pathlib.Path(folder.name) / "whole.vdb"
        # Two of its sides are just beyond the border of a tile, so that a small solid has many tiles.
        run("sample", "translate(difference(box(2,1.5,1), cylinder(0.4,3)), 0, 0.5, 0.5)", "-o", cls.cloud,
            "--points", "60000", "--pattern", "random", "--noise", "0.05%").check_returncode()
        run("reconstruct", cls.cloud, "-o", cls.expected, *cls.options).check_returncode()

    def setUp(self):
        super().setUp()
        self.job = self.folder / "a job"  # engines have to quote it
        self.output = self.folder / "made.vdb"

    def call(self, *words, status=0):
        ended = run(*words)
        self.assertEqual(ended.returncode, status, ended.stderr)
        return ended.stdout

    def plan(self, engine):
        self.call("plan", self.cloud, "--job", self.job, "-o", self.output, *self.options, "--engine", engine,
                  "--slots", "5", "--tile-voxels", "128", "--part-points", "3000")

    def assert_same(self):
        self.assertEqual(self.output.read_bytes(), self.expected.read_bytes())
        status = json.loads(self.call("status", self.job, "--json"))
        self.assertEqual(status["done"], status["tasks"])
        self.assertGreaterEqual(status["tasks"], 27)

    def shell(self, command, **options):
        # Engines leave logs where they run.
        return subprocess.run(command, shell=True, capture_output=True, text=True, timeout=300, cwd=self.folder,
                              **options)


@unittest.skipUnless(COMMAND, "the command is not built")
class EngineTest(JobTest):
    def test_a_full_disk_is_said(self):
        self.plan("list")
        small = self.job / "fit"
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(small)], capture_output=True)
        if mounted.returncode != 0:
            self.skipTest("no file system may be mounted here")
        try:
            self.call("tile", self.job, status=6)
            for name in ("full.ply", "full.xyz"):  # streams do not say why they failed
                self.call("sample", "torus(1,0.4)", "-o", small / name, "--points", "20000", status=6)
                self.assertFalse((small / name).exists())
            left = [path.name for path in small.iterdir() if ".tmp" in path.name]
            self.assertEqual(left, [])
        finally:
            subprocess.run(["umount", str(small)], check=True)
        self.call("tile", self.job)  # there is room again

    def test_too_little_memory_for_all_at_once(self):
        cloud = self.folder / "torus.ply"
        self.call("sample", "torus(1,0.4)", "-o", cloud, "--points", "400000", "--pattern", "random")

        def limited(limit):
            """Reconstructs with so much memory; what was said."""
            ended = run("reconstruct", cloud, "-o", self.output, "--voxels", "260", "--max-memory", limit)
            self.assertEqual(ended.returncode, 0, ended.stderr)
            return ended.stderr

        self.assertNotIn("out of core", limited("8G"))
        whole = self.output.read_bytes()
        self.assertIn("out of core", limited("80M"))
        self.assertTrue(self.output.read_bytes() == whole, "the bytes differ")
        self.assertEqual([path.name for path in self.folder.iterdir() if path.name.endswith(".job")], [])
        # A mesh needs the whole.
        self.call("reconstruct", cloud, "-o", self.folder / "b.vdb", "--mesh", self.folder / "b.ply",
                  "--voxels", "260", "--max-memory", "80M", status=5)

    def test_a_full_scratch_disk_is_said(self):
        cloud = self.folder / "torus.ply"
        self.call("sample", "torus(1,0.4)", "-o", cloud, "--points", "800000", "--pattern", "random")
        small = self.folder / "small"
        small.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3M", "none", str(small)], capture_output=True)
        if mounted.returncode != 0:
            self.skipTest("no file system may be mounted here")
        try:
            self.call("plan", cloud, "--job", small / "job", "--voxels", "600", "--max-memory", "80M", status=6)
            self.assertEqual(list(small.iterdir()), [])
        finally:
            subprocess.run(["umount", str(small)], check=True)

    def test_list(self):
        self.plan("list")
        for name in ("1-fit.txt", "2-gather.txt", "3-tiles.txt", "4-merge.txt"):
            for line in reversed((self.job / name).read_text().splitlines()):
                ended = self.shell(line)
                self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assert_same()

    def test_a_folder_and_a_mesh(self):
        self.output = self.folder / "a city"
        self.plan("list")
        for name in ("1-fit.txt", "2-gather.txt", "3-tiles.txt", "4-merge.txt"):
            ended = self.shell(f"sh '{self.job}/{name}'")
            self.assertEqual(ended.returncode, 0, ended.stderr)
        index = json.loads((self.output / "index.json").read_text())
        there = {str(path.relative_to(self.output)) for path in self.output.rglob("*") if path.is_file()}
        self.assertEqual(set(index["files"]), there)
        whole = json.loads(self.call("info", self.expected, "--json"))
        self.assertEqual(sum(tile["active_voxels"] for tile in index["tiles"]), whole["files"][0]["grids"][0]["active_voxels"])
        for level in index["levels"]:
            self.call("check", self.output / level["file"])
        self.call("reconstruct", self.cloud, "-o", self.folder / "whole.vdb", *self.options, "--mesh", self.folder / "whole.ply")
        self.call("merge", self.job, "--mesh", self.folder / "tiles.ply")
        self.assertEqual((self.folder / "tiles.ply").read_bytes(), (self.folder / "whole.ply").read_bytes())
        # What is small and has no extension is a file; what is there already stays what it is.
        self.call("merge", self.job, "-o", self.folder / "city")
        self.assertEqual((self.folder / "city.vdb").read_bytes(), self.expected.read_bytes())
        (self.output / "mine.txt").write_text("mine")
        self.call("merge", self.job, "-o", self.output, status=2)
        self.call("merge", self.expected, "--mesh", self.folder / "no.ply", status=2)
        self.call("merge", self.job, status=2)
        self.call("merge", self.job, "-o", str(self.expected) + "/", status=3)

    def test_a_killed_merge_leaves_no_folder(self):
        self.plan("list")
        for name in ("1-fit.txt", "2-gather.txt", "3-tiles.txt"):
            self.assertEqual(self.shell(f"sh '{self.job}/{name}'").returncode, 0)
        before = sorted(path.name for path in self.folder.iterdir())
        for signals in (1, 2):  # the second ends the process at once
            running = subprocess.Popen([COMMAND, "merge", str(self.job), "-o", f"{self.folder}/city/"],
                                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while not list(self.folder.glob(".city.*")) and running.poll() is None:
                time.sleep(0.005)
            for _ in range(signals):
                running.send_signal(signal.SIGINT)
            self.assertEqual(running.wait(timeout=60), 130)
            self.assertEqual(sorted(path.name for path in self.folder.iterdir()), before)

    @unittest.skipUnless(installed("parallel"), "GNU parallel is not installed")
    def test_parallel(self):
        self.plan("parallel")
        script = f"sh '{self.job}/parallel.sh' -j 2 --halt never"
        # Some task is killed on the way, and the script goes on where it was.
        running = subprocess.Popen(script, shell=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                                   start_new_session=True)
        time.sleep(0.5)
        subprocess.run(["pkill", "-KILL", "-g", str(running.pid), "mpuvdb"])
        running.wait(timeout=300)
        ended = self.shell(script)
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assert_same()

    @unittest.skipUnless(installed("snakemake"), "Snakemake is not installed")
    def test_snakemake(self):
        self.plan("snakemake")
        ended = self.shell(f"snakemake -s '{self.job}/Snakefile' --cores 2 --retries 3")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assert_same()

    def test_openjd(self):
        self.plan("openjd")
        template = json.loads((self.job / "openjd.json").read_text())
        self.assertEqual(template["specificationVersion"], "jobtemplate-2023-09")
        self.assertLessEqual(len(template["name"]), 128)
        names = [step["name"] for step in template["steps"]]
        self.assertEqual(names, ["Fit", "Gather", "Tiles", "Merge"])
        for step, before in zip(template["steps"][1:], names):
            self.assertEqual(step["dependencies"], [{"dependsOn": before}])
        # A runner of one's own: the steps in order, their slots in any.
        for step in template["steps"]:
            action = step["script"]["actions"]["onRun"]
            parameters = step.get("parameterSpace", {}).get("taskParameterDefinitions", [{"range": "0-0"}])
            low, high = map(int, parameters[0]["range"].split("-"))
            for slot in range(high, low - 1, -1):
                words = [word.replace("{{Task.Param.Slot}}", str(slot)) for word in action["args"]]
                ended = subprocess.run([action["command"], *words], capture_output=True, text=True)
                self.assertEqual(ended.returncode, 0, ended.stderr)
        self.assert_same()


@unittest.skipUnless(COMMAND, "the command is not built")
@unittest.skipUnless(installed("slurmctld", "slurmd", "munged", "sbatch"), "Slurm is not installed")
@unittest.skipUnless(os.geteuid() == 0, "Slurm's daemons are started by root alone")
class SlurmTest(JobTest):
    """A cluster of this one machine."""

    def setUp(self):
        super().setUp()
        state = pathlib.Path(self.folder) / "slurm"
        for name in ("state", "spool", "log"):
            (state / name).mkdir(parents=True)
        host = os.uname().nodename
        config = state / "slurm.conf"
        config.write_text(f"""ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
CryptoType=crypto/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
StateSaveLocation={state}/state
SlurmdSpoolDir={state}/spool
SlurmctldPidFile={state}/slurmctld.pid
SlurmdPidFile={state}/slurmd.pid
SlurmctldLogFile={state}/log/slurmctld
SlurmdLogFile={state}/log/slurmd
SlurmctldPort=16817
SlurmdPort=16818
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
ReturnToService=2
SchedulerParameters=sched_interval=1,batch_sched_delay=0
MinJobAge=3600
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={os.cpu_count()} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
""")
        (state / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")
        self.environment = dict(os.environ, SLURM_CONF=str(config))
        munge = state / "munge"
        munge.mkdir(mode=0o755)
        (munge / "key").write_bytes(os.urandom(128))
        (munge / "key").chmod(0o400)
        socket = "/run/munge/munge.socket.2"
        os.makedirs("/run/munge", exist_ok=True)
        os.chmod("/run/munge", 0o755)
        self.daemons = []
        self.addCleanup(self.stop_daemons)
        if not os.path.exists(socket):
            self.start(["munged", "-F", "--force", f"--key-file={munge}/key", f"--pid-file={munge}/pid",
                        f"--log-file={munge}/log", f"--seed-file={munge}/seed", f"--socket={socket}"])
            self.wait_for(lambda: os.path.exists(socket), "munge")
        self.start(["slurmctld", "-D", "-f", str(config)])
        self.start(["slurmd", "-D", "-f", str(config)])
        self.wait_for(lambda: "idle" in self.slurm("sinfo -h -o %T").stdout, "an idle node")

    def start(self, words):
        log = open(self.folder / (words[0] + ".out"), "wb")
        self.daemons.append(subprocess.Popen(words, stdout=log, stderr=log, env=self.environment))
        log.close()

    def stop_daemons(self):
        self.slurm("scancel -u root")
        for daemon in reversed(self.daemons):
            daemon.terminate()
            try:
                daemon.wait(timeout=20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def slurm(self, command):
        return self.shell(command, env=self.environment)

    def wait_for(self, condition, what, seconds=60):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:  # a machine without control groups, or with other daemons
                logs = [path.read_text(errors="replace")[-500:] for path in self.folder.glob("*.out")]
                self.skipTest(f"Slurm does not start here: no {what}: {logs}")
            time.sleep(0.2)

    def test_a_job_with_kills(self):
        self.plan("slurm")
        ended = self.slurm(f"sh '{self.job}/slurm/submit.sh'")
        self.assertEqual(ended.returncode, 0, ended.stderr)
        killed = set()

        def kill_one_of(verb):
            """SIGKILL the first process of a verb that is seen; its task is done again."""
            for process in pathlib.Path("/proc").glob("[0-9]*"):
                try:
                    words = (process / "cmdline").read_bytes().decode().split("\0")
                except OSError:
                    continue
                if len(words) > 2 and words[0] == COMMAND and words[1] == verb and words[2] == str(self.job):
                    os.kill(int(process.name), signal.SIGKILL)
                    killed.add(verb)
                    return

        end = time.monotonic() + 280
        while not self.output.exists() and time.monotonic() < end:
            for verb in ("tile", "merge"):
                if verb not in killed:
                    kill_one_of(verb)
            time.sleep(0.05)
        self.assertIn("tile", killed)
        self.assertTrue(self.output.exists(), self.slurm("squeue -t all").stdout)
        self.assert_same()


if __name__ == "__main__":
    unittest.main()
