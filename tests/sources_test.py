"""Whether the sources keep two rules that no compiler tells of. Each class name of the namespace belongs to one
header: rooms do not see each other's, and the linker takes the inline functions of either for both. And a file is one
idea, of at most 500 lines."""
import collections
import pathlib
import re
import sys

MOST_LINES = 500
DEFINITION = re.compile(r"^(?:class|struct|enum class)\s+(\w+)\b(?!\s*(?:;|::|<))", re.MULTILINE)


def headers_of_names(root):
    found = collections.defaultdict(list)
    for folder in ("include", "src"):
        for header in sorted((root / folder).rglob("*.h")):
            for definition in DEFINITION.finditer(header.read_text()):
                found[definition[1]].append(str(header.relative_to(root)))
    return found


def long_files(root):
    files = [file for folder in ("include", "src", "tools") for ending in ("*.h", "*.cpp")
             for file in sorted((root / folder).rglob(ending))]
    lines = {file: len(file.read_text().splitlines()) for file in files}
    return {str(file.relative_to(root)): count for file, count in lines.items() if count > MOST_LINES}


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    found = headers_of_names(root)
    twice = {name: headers for name, headers in found.items() if len(headers) > 1}
    for name, headers in twice.items():
        print(f"{name}: defined in {' and '.join(headers)}. Rename one")
    too_long = long_files(root)
    for file, lines in too_long.items():
        print(f"{file}: {lines} lines, of at most {MOST_LINES}. Give one of its ideas a file of its own")
    print(f"{len(found)} classes")
    return 1 if twice or too_long or len(found) < 100 else 0


if __name__ == "__main__":
    sys.exit(main())
