"""Imports of the product's source files, read from their syntax trees."""

from __future__ import annotations

import ast
import gc
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from ballbar import PACKAGES

ROOT = Path(__file__).parents[2]


def module_name(file: Path) -> str:
    """Full name of the module in a file of the source tree: `ballbar.cell.x` of `cell/x.py`."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    inside = parts if parts[0] == "ballbar" else ("ballbar", *parts)
    return ".".join(inside).removesuffix(".__init__")


FILES = {
    module_name(file): file for package in PACKAGES for file in (ROOT / package).rglob("*.py")
}  # by the module's full name


def part_of(name: str) -> str:
    """The folder that a module of ours stands in; of another module the first part of its name."""
    first, _, rest = name.partition(".")
    inside = rest.partition(".")[0]
    return inside if first == "ballbar" and inside in PACKAGES else first


@cache
def tree(file: Path) -> ast.Module:
    """The syntax tree of a file, parsed once for all tests; not to be changed.

    Collecting garbage meanwhile takes twice as long as parsing, and there is none.
    """
    gc.disable()
    try:
        return ast.parse(file.read_text(encoding="utf-8"))
    finally:
        gc.enable()


@cache
def nodes(file: Path) -> tuple[ast.AST, ...]:
    """All nodes of the syntax tree of a file, gathered once for all tests."""
    return tuple(ast.walk(tree(file)))


def imported(file: Path) -> set[str]:
    """Parts (`part_of`) of all names that a file imports, also within functions."""
    return {part_of(name) for name in full_names(file)}


def full_names(file: Path) -> set[str]:
    """Names of all modules and objects that a file imports, also within functions."""
    return names_within(tree(file))


def names_within(node: ast.AST) -> set[str]:
    """Full names of all modules and objects that are imported somewhere in a syntax tree."""
    return _names(ast.walk(node))


def reached(module: str) -> set[str]:
    """Modules that are imported with `module`: ours by full name, others by their first part.

    Only imports at the top level count: those within functions and under TYPE_CHECKING run later
    or never. The standard library is left out.
    """
    seen, left = {module}, [module]
    while left:
        name = left.pop()
        parents = {name.rsplit(".", k)[0] for k in range(1, name.count(".") + 1)}
        names = {*_names(tree(FILES[name]).body), *parents}
        new = {known if (known := _ours(n)) else n.split(".")[0] for n in names} - seen
        seen |= new
        left += new & FILES.keys()
    return seen - set(sys.stdlib_module_names)


def _ours(name: str) -> str | None:
    """The module of ours that a name `module` or `module.object` means."""
    return next((n for n in (name, name.rpartition(".")[0]) if n in FILES), None)


def _names(nodes: Iterable[ast.AST]) -> set[str]:
    """Full names of imported modules and objects."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names
