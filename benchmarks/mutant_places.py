"""Single-line faults of the sources: a seeded sample, and the lines that use what each changes.

Operators and their positions are those of cosmic-ray. Left out is what no test can miss or none can
see: arithmetic replaced by operators on bits and comparison by identity, which raise TypeError for
floats, and operators in annotations, which are not executed. Every position is equally likely,
whatever the number of faults it allows.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import parso
from cosmic_ray.ast import ast_nodes
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from parso.tree import NodeOrLeaf

from benchmarks.executed_lines import PACKAGES

ROOT = Path(__file__).parent.parent
_ORDERS = "Eq|NotEq|Lt|LtE|Gt|GtE"
_ARITHMETIC = "Add|Sub|Mul|Div|FloorDiv|Mod|Pow"
_BITS = "RShift|LShift|BitOr|BitAnd|BitXor"
_USED = re.compile(
    rf"core/(ReplaceBinaryOperator_(({_ARITHMETIC})_({_ARITHMETIC})|({_BITS})_({_BITS}))"
    rf"|ReplaceComparisonOperator_(({_ORDERS})_({_ORDERS})|Is_IsNot|IsNot_Is)"
    r"|ReplaceUnaryOperator_(USub_UAdd|Delete_Not)|AddNot|ReplaceTrueWithFalse"
    r"|ReplaceFalseWithTrue|ReplaceAndWithOr|ReplaceOrWithAnd|ReplaceBreakWithContinue"
    r"|ReplaceContinueWithBreak|NumberReplacer|RemoveDecorator"
    r"|ZeroIterationForLoop)"
)
_NODES = {  # kinds of nodes that the many operators look at; the others look at all
    "core/ReplaceBinary": "operator",
    "core/ReplaceComparison": "comparison",
    "core/NumberReplacer": "number",
}
_STARS = {"parameters", "param", "lambdef", "dictorsetmaker"}  # a star there multiplies nothing
OPERATORS = tuple(sorted(name for name in operator_names() if _USED.fullmatch(name)))


@dataclass(frozen=True)
class Mutant:
    """One source file with one fault."""

    file: str  # within the project
    line: int
    column: int
    operator: str
    before: str  # the line, and what it becomes
    after: str
    source: str  # the whole file with the fault


@cache
def target_files() -> list[str]:
    """All files that mutants are taken from, sorted: those of the product."""
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    return sorted(str(file.relative_to(ROOT)) for file in files)


def drawn(count: int, seed: int) -> list[Mutant]:
    """A sample of mutants at different positions; a shorter one is its beginning."""
    rng = np.random.default_rng(seed)
    positions = [
        (file, position, faults)
        for file in target_files()
        for position, faults in sorted(_faults(file).items())
    ]
    sample: list[Mutant] = []
    for index in rng.permutation(len(positions)):
        file, position, faults = positions[index]
        choices = [faults[i] for i in rng.permutation(len(faults))]
        made = (_mutant(file, position, *choice) for choice in choices)
        valid = next((mutant for mutant in made if mutant), None)
        if valid:
            sample.append(valid)
        if len(sample) == count:
            break
    return sample


def _faults(file: str) -> dict[tuple[int, int], list[tuple[str, int]]]:
    """Operators and their occurrences at every position (line, column) of a file."""
    nodes: dict[str, list[NodeOrLeaf]] = {}
    for node in ast_nodes(parso.parse(_text(file))):
        for key in ("", node.type):
            nodes.setdefault(key, []).append(node)
    annotations = _annotations(_tree(file))
    faults: dict[tuple[int, int], list[tuple[str, int]]] = {}
    for name in OPERATORS:
        operator = get_operator(name)()
        kind = next((kind for start, kind in _NODES.items() if name.startswith(start)), "")
        places = [
            (node, start)
            for node in nodes.get(kind, ())
            for start, _ in operator.mutation_positions(node)
        ]
        for occurrence, (node, start) in enumerate(places):
            executed = not any(a <= start < b for a, b in annotations)
            if name == "core/NumberReplacer" or (executed and node.parent.type not in _STARS):
                faults.setdefault(start, []).append((name, occurrence))
    return faults


def _annotations(tree: ast.Module) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    nodes = [
        getattr(node, key, None) for node in ast.walk(tree) for key in ("annotation", "returns")
    ]
    return [_span(node) for node in nodes if isinstance(node, ast.expr)]


def _mutant(file: str, position: tuple[int, int], name: str, occurrence: int) -> Mutant | None:
    """The mutant, or None if it is no Python or none at all."""
    text = _text(file)
    source = mutate_code(text, get_operator(name)(), occurrence)
    assert source is not None
    try:
        if ast.dump(ast.parse(source)) == ast.dump(_tree(file)):  # 5e17 + 1.0 is 5e17
            return None
        compile(source, file, "exec")
    except SyntaxError:
        return None
    removed = name == "core/RemoveDecorator"
    lines = list(zip(text.splitlines(), source.splitlines(), strict=False))
    before, after = next((old, new) for old, new in lines if old != new)
    return Mutant(
        file=file,
        line=position[0],
        column=position[1],
        operator=name.removeprefix("core/"),
        before=text.splitlines()[position[0] - 1].strip() if removed else before.strip(),
        after="" if removed else after.strip(),
        source=source,
    )


@cache
def _text(file: str) -> str:
    return (ROOT / file).read_text()


@cache
def _tree(file: str) -> ast.Module:
    return ast.parse(_text(file))


@cache
def _statements(file: str) -> list[ast.stmt]:
    """All statements of a file, the outer ones before those in them."""
    statements = [node for node in ast.walk(_tree(file)) if isinstance(node, ast.stmt)]
    return sorted(statements, key=lambda node: (node.lineno, -(node.end_lineno or 0)))


def _span(node: ast.expr | ast.stmt) -> tuple[tuple[int, int], tuple[int, int]]:
    """First position of a node and the one after its last, columns in characters as in parso."""
    end_line, end_column = node.end_lineno or node.lineno, node.end_col_offset or 0
    return (node.lineno, node.col_offset), (end_line, end_column)


def lines_of_use(file: str, position: tuple[int, int]) -> set[tuple[str, range]]:
    """Lines within functions that a change at a position shows in.

    Those of the statement itself within a function. A module or a class is executed on import, for
    whatever test comes first: there the lines that use the name which the statement defines.
    """
    return _uses(file, position, set())


def _uses(
    file: str, position: tuple[int, int], seen: set[tuple[str, int]]
) -> set[tuple[str, range]]:
    around = _around(file, position)
    if not around:
        return set()
    statement = around[-1]
    if in_function(file, position):
        return {(file, _own_lines(statement))}
    if (file, statement.lineno) in seen:
        return set()
    seen.add((file, statement.lineno))
    uses = {
        (file, range(node.body[0].lineno, (node.end_lineno or 0) + 1))
        for node in (statement, *getattr(statement, "body", ()))
        if isinstance(node, ast.FunctionDef)  # itself, or a method of the class
    }
    if isinstance(statement, ast.FunctionDef):
        return uses
    for name in _defined(statement):
        for other, place in _mentions(file, name):
            uses |= _uses(other, place, seen)
    return uses


def in_function(file: str, position: tuple[int, int]) -> bool:
    """Whether a position is executed by a call, not on import."""
    return any(isinstance(node, ast.FunctionDef) for node in _around(file, position)[:-1])


def _around(file: str, position: tuple[int, int]) -> list[ast.stmt]:
    """Statements that a position lies in, the outermost first."""
    return [node for node in _statements(file) if _holds(node, position)]


def _holds(node: ast.stmt, position: tuple[int, int]) -> bool:
    decorators = getattr(node, "decorator_list", [])
    start = min([_span(node)[0], *(_span(decorator)[0] for decorator in decorators)])
    return (start[0], 0) <= position < _span(node)[1]


def _own_lines(statement: ast.stmt) -> range:
    """Lines of a statement without those of the statements in it."""
    body = getattr(statement, "body", None)
    last = max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno or 0
    return range(statement.lineno, last + 1)


def _defined(statement: ast.stmt) -> set[str]:
    """Names that a statement of a module or class gives a value."""
    if isinstance(statement, ast.ClassDef):
        return {statement.name}
    return {
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }


def _mentions(file: str, name: str) -> Iterator[tuple[str, tuple[int, int]]]:
    """Files and positions where a name of a file is used, as a name or as an attribute."""
    private = name.startswith("_") or name == "model_config"
    for other in (file,) if private else target_files():
        names, attributes, imported = _identifiers(other)
        for place in attributes.get(name, []):
            yield other, place
        for place in names.get(name, []) if other == file or name in imported else ():
            yield other, place


Places = dict[str, list[tuple[int, int]]]


@cache
def _identifiers(file: str) -> tuple[Places, Places, set[str]]:
    """Positions of the names and attributes that a file uses, and the names that it imports."""
    names: Places = {}
    attributes: Places = {}
    imported: set[str] = set()
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            names.setdefault(node.id, []).append((node.lineno, node.col_offset))
        elif isinstance(node, ast.Attribute):
            attributes.setdefault(node.attr, []).append((node.lineno, node.col_offset))
        elif isinstance(node, ast.ImportFrom):
            imported |= {alias.name for alias in node.names}
    return names, attributes, imported
