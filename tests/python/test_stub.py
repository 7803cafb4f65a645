"""The stub mpuvdb.pyi says what the module has: names, members, parameters."""

import ast
import inspect
import os
import re
import unittest

import mpuvdb as mv

STUB = os.environ["MPUVDB_STUB"]
OPERATORS = {"__init__", "__bool__", "__or__", "__and__", "__sub__", "__xor__"}


def public(names):
    return {n for n in names if not n.startswith("_") or n in OPERATORS}


def stub_functions(nodes):
    return {n.name: n for n in nodes if isinstance(n, ast.FunctionDef)}


def stub_parameters(function):
    a = function.args
    names = [x.arg for x in a.posonlyargs + a.args if x.arg != "self"]
    if a.vararg:
        names.append("*args")  # pybind11 knows no other name
    return names + [x.arg for x in a.kwonlyargs]


def module_parameters(function):
    """Those of the signature that stands first in the docstring."""
    signature = function.__doc__.splitlines()[0]
    inside = signature[signature.index("(") + 1 : signature.rindex(") ->")]
    names = re.findall(r"(?:^|, )(\*?\w+)(?=:|, |$)", inside)
    return [n for n in names if n not in ("self", "*")]


class Stub(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        with open(STUB, encoding="utf-8") as file:
            cls.tree = ast.parse(file.read()).body
        cls.functions = stub_functions(cls.tree)
        cls.classes = {n.name: n for n in cls.tree if isinstance(n, ast.ClassDef)}

    def test_same_names(self):
        there = public(vars(mv))
        self.assertEqual(there, set(self.functions) | set(self.classes))

    def test_same_members(self):
        for name, node in self.classes.items():
            with self.subTest(name):
                kind = getattr(mv, name)
                if issubclass(kind, BaseException):
                    bases = {b.id for b in node.bases}
                    self.assertEqual(bases, {b.__name__ for b in kind.__bases__})
                    continue
                members = public(vars(kind))
                if "__init__" not in stub_functions(node.body):
                    members.discard("__init__")  # pybind11 adds one that raises
                self.assertEqual(members, set(stub_functions(node.body)))

    def check_parameters(self, name, function, stub):
        with self.subTest(name):
            self.assertEqual(module_parameters(function), stub_parameters(stub))

    def test_same_parameters(self):
        for name, stub in self.functions.items():
            self.check_parameters(name, getattr(mv, name), stub)
        for kind, node in self.classes.items():
            for name, stub in stub_functions(node.body).items():
                member = inspect.getattr_static(getattr(mv, kind), name)
                decorators = {d.id for d in stub.decorator_list}
                self.assertEqual(isinstance(member, property), "property" in decorators)
                if isinstance(member, property) or name == "__bool__":
                    continue
                self.check_parameters(f"{kind}.{name}", getattr(getattr(mv, kind), name), stub)

    def test_all_is_documented(self):
        for name in self.functions:
            self.assertGreater(len(getattr(mv, name).__doc__.splitlines()), 2, name)
        for kind in self.classes:
            self.assertTrue(getattr(mv, kind).__doc__, kind)
            for name, member in vars(getattr(mv, kind)).items():
                if not name.startswith("_"):
                    self.assertTrue(member.__doc__, f"{kind}.{name}")


if __name__ == "__main__":
    unittest.main()
