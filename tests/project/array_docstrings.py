"""Which public functions of arrays state shape and unit in their docstrings, by package.

    python -m tests.project.array_docstrings            # the table
    python -m tests.project.array_docstrings ident      # and what is missing in one package

Counted are functions at module level, without underscore, with an array among arguments or results.
A shape reads `(N, 6)`, `(3,)` or `(..., 3, N)`, a unit `[rad]` or `[N m/rad]`; numbers without unit
are called dimensionless or `[-]`. That every array of a function has its own is not checked.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from ballbar import PACKAGES
from tests.helpers.source_imports import FILES, ROOT, tree

SHAPE_TARGET, UNIT_TARGET = 0.70, 0.60  # least shares in every package

_ARRAY = re.compile(r"\b(NDArray|ArrayLike|Array)\b")
_SIZE = r"(?:\.\.\.|[A-Z0-9][A-Z0-9_]*(?: ?[-+*/] ?[A-Z0-9][A-Z0-9_]*)*(?: \[[^\]]*\])?)"
SHAPE = re.compile(rf"\({_SIZE},(?: ?{_SIZE},?)*\)")
_UNIT_WORD = r"(?:[numkM]?(?:m|rad|s|N|Hz|Nm)|kg|g|deg|ppm|counts?|rows|samples|%|sigma|-|1(?=/))"
UNIT = re.compile(rf"\[(?:{_UNIT_WORD}(?:\^-?\d)?(?:[ ,/*]|\bor\b|\band\b)*)+\]|dimensionless")


@dataclass(frozen=True)
class ArrayFunction:
    """A public function with an array among its arguments or results."""

    package: str
    place: str  # file:line name
    shape: bool  # whether the docstring states one
    unit: bool


@cache
def array_functions() -> tuple[ArrayFunction, ...]:
    """All of them, in the order of packages and files."""
    return tuple(_array_functions())


def _array_functions() -> Iterator[ArrayFunction]:
    for file in FILES.values():
        for node in tree(file).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_") and _takes(node):
                text = ast.get_docstring(node) or ""
                name = file.relative_to(ROOT)
                yield ArrayFunction(
                    name.parts[0],
                    f"{name}:{node.lineno} {node.name}",
                    bool(SHAPE.search(text)),
                    bool(UNIT.search(text)),
                )


def _takes(node: ast.FunctionDef) -> bool:
    arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
    annotations = (*(argument.annotation for argument in arguments), node.returns)
    return any(a is not None and _ARRAY.search(ast.unparse(a)) for a in annotations)


def shares(package: str) -> tuple[int, float, float]:
    """Count of a package's array functions, and which share of them states shape, and unit."""
    functions = [f for f in array_functions() if f.package == package]
    count = len(functions)
    return count, sum(f.shape for f in functions) / count, sum(f.unit for f in functions) / count


def main(packages: list[str]) -> None:
    """Prints the table, then the functions of `packages` that lack something."""
    print(
        f"{'package':12} functions  shape  unit   (targets {SHAPE_TARGET:.0%}, {UNIT_TARGET:.0%})"
    )
    for package in PACKAGES:
        count, shape, unit = shares(package)
        print(f"{package:12} {count:9}  {shape:5.0%} {unit:5.0%}")
    for function in array_functions():
        if function.package in packages and not (function.shape and function.unit):
            lacking = ["shape"] * (not function.shape) + ["unit"] * (not function.unit)
            print(f"{function.place}: {' and '.join(lacking)}")


if __name__ == "__main__":
    main(sys.argv[1:])
