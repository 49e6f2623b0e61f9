"""Size of the product and of its tests: lines, lines of code, long modules, long functions.

    python -m tests.project.size             what `make check` prints
    python -m tests.project.size PACKAGE...  the same of each folder named

Code lines are those that hold a token: no docstrings, comments or blank lines.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ballbar import PACKAGES
from tests.helpers.source_imports import ROOT, nodes

LONG_MODULE = 350  # lines
SHORT_FUNCTION = 22  # lines, docstring included


@dataclass(frozen=True)
class Size:
    """Size of a set of Python files."""

    lines: int
    code: int
    modules: dict[Path, int]  # lines of each
    functions: dict[str, int]  # lines of each function, by file and name
    classes: Counter[str]  # how many public classes have each name


def size_of(*folders: str) -> Size:
    """Size of all Python files below the folders."""
    modules, functions, code = {}, {}, 0
    classes: Counter[str] = Counter()
    for file in sorted(file for folder in folders for file in Path(folder).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        modules[file] = len(text.splitlines())
        every = nodes(ROOT / file)
        code += code_lines(text, every)
        for node in every:
            if isinstance(node, ast.FunctionDef):
                functions[f"{file}:{node.name}"] = (node.end_lineno or 0) - node.lineno + 1
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes[node.name] += 1
    return Size(sum(modules.values()), code, modules, functions, classes)


def code_lines(text: str, nodes: Sequence[ast.AST]) -> int:
    """Number of lines with a token that is no docstring, comment or line end.

    The syntax tree is asked for texts of several lines alone: the tokens themselves take seconds.
    """
    lines = {
        number
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    }
    for node in nodes:
        if isinstance(node, ast.Constant | ast.JoinedStr):
            lines.update(range(node.lineno, (node.end_lineno or 0) + 1))
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            first = node.body[0]
            lines -= set(range(first.lineno, (first.end_lineno or 0) + 1))
    return len(lines)


def main() -> None:
    """Prints the sizes."""
    product, tests = size_of(*(sys.argv[1:] or PACKAGES)), size_of("tests")
    above = [n for n in product.modules.values() if n > LONG_MODULE]
    short = sum(n <= SHORT_FUNCTION for n in product.functions.values())
    longest, name = max((n, name) for name, n in product.functions.items())
    twice = sorted(name for name, count in product.classes.items() if count > 1)
    print(f"product: {product.lines} lines, {product.code} of code; tests: {tests.lines} lines")
    print(f"{len(above)} modules over {LONG_MODULE} lines, longest {max(product.modules.values())}")
    share = short / len(product.functions)
    print(f"{share:.1%} of functions within {SHORT_FUNCTION} lines, longest {longest}: {name}")
    print(f"{len(twice)} public class names more than once: {' '.join(twice)}")


if __name__ == "__main__":
    main()
