"""Whether each class name of the namespace belongs to one header: rooms do not see each other's, so that no compiler
tells of two, and the linker takes the inline functions of either for both."""
import collections
import pathlib
import re
import sys

DEFINITION = re.compile(r"^(?:class|struct|enum class)\s+(\w+)\b(?!\s*(?:;|::|<))", re.MULTILINE)


def headers_of_names(root):
    found = collections.defaultdict(list)
    for folder in ("include", "src"):
        for header in sorted((root / folder).rglob("*.h")):
            for definition in DEFINITION.finditer(header.read_text()):
                found[definition[1]].append(str(header.relative_to(root)))
    return found


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    found = headers_of_names(root)
    twice = {name: headers for name, headers in found.items() if len(headers) > 1}
    for name, headers in twice.items():
        print(f"{name}: defined in {' and '.join(headers)}. Rename one")
    print(f"{len(found)} classes")
    return 1 if twice or len(found) < 100 else 0


if __name__ == "__main__":
    sys.exit(main())
