"""Every Python block of the README runs, in the order in which it stands there."""

import os
import re
import tempfile
import unittest


class Readme(unittest.TestCase):
    def test_blocks_run(self):
        with open(os.environ["MPUVDB_README"], encoding="utf-8") as file:
            blocks = re.findall(r"^```python\n(.*?)^```$", file.read(), re.MULTILINE | re.DOTALL)
        self.assertTrue(blocks)
        names = {}
        here = os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                for block in blocks:
                    exec(compile(block, "README.md", "exec"), names)
            finally:
                os.chdir(here)


if __name__ == "__main__":
    unittest.main()
