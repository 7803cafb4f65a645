"""Every Python block of the pages runs, in the order in which it stands there."""

import glob
import os
import re
import subprocess
import tempfile
import unittest

SOURCE = os.environ["MPUVDB_SOURCE_DIR"]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_page(page):
    """Run its blocks; the number of them that are Python.

    The first commands of a page make the files that its Python reads.
    """
    with open(os.path.join(SOURCE, page), encoding="utf-8") as file:
        blocks = BLOCK.findall(file.read())
    python = [code for language, code in blocks if language == "python"]
    shell = [code for language, code in blocks if language == "sh"]
    names = {}
    if python and shell:
        if "MPUVDB_COMMAND" not in os.environ:
            raise unittest.SkipTest("needs the command")
        path = os.path.dirname(os.environ["MPUVDB_COMMAND"]) + os.pathsep + os.environ["PATH"]
        subprocess.run(["bash", "-euc", shell[0]], check=True, env=dict(os.environ, PATH=path))
    for n, code in enumerate(python):
        exec(compile(code, f"{page}, Python block {n + 1}", "exec"), names)
    return len(python)


class Readme(unittest.TestCase):
    def test_blocks_run(self):
        pages = ["README.md"] + [os.path.relpath(path, SOURCE) for path in
                                 sorted(glob.glob(os.path.join(SOURCE, "docs", "*.md")))]
        here, blocks = os.getcwd(), 0
        for page in pages:
            with self.subTest(page=page), tempfile.TemporaryDirectory() as folder:
                os.chdir(folder)
                try:
                    blocks += run_page(page)
                finally:
                    os.chdir(here)
        self.assertGreater(blocks, 1)


if __name__ == "__main__":
    unittest.main()
