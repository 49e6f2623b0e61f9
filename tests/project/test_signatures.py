"""Calls and signatures in which two arguments could be swapped unnoticed."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache

import pytest

from tests.helpers.source_imports import FILES, ROOT
from tests.helpers.source_imports import nodes as nodes_of

MOST_POSITIONAL = 6  # arguments of a constructor call without their names
MOST_PARAMETERS = 6  # of a function that takes two positional ones of the same annotation


@cache
def nodes() -> list[tuple[str, ast.Call | ast.FunctionDef]]:
    """Every call and function of the product and the examples, with its file."""
    return [
        (str(file.relative_to(ROOT)), node)
        for file in (*FILES.values(), *sorted((ROOT / "examples").glob("*.py")))
        for node in nodes_of(file)
        if isinstance(node, (ast.Call, ast.FunctionDef))
    ]


def long_constructor_calls() -> list[str]:
    """Calls of classes with more positional arguments than MOST_POSITIONAL."""
    return [
        f"{file}:{node.lineno} {ast.unparse(node.func)}: {len(node.args)} positional arguments"
        for file, node in nodes()
        if isinstance(node, ast.Call)
        and len(node.args) > MOST_POSITIONAL
        and ast.unparse(node.func).split(".")[-1].lstrip("_")[:1].isupper()
    ]


def swappable_parameters(node: ast.FunctionDef) -> list[str]:
    """Annotations that several positional parameters share, if there are many parameters."""
    arguments = node.args
    positional = [a for a in (*arguments.posonlyargs, *arguments.args) if a.arg not in _OWN]
    if len(positional) + len(arguments.kwonlyargs) <= MOST_PARAMETERS:
        return []
    annotations = Counter(ast.unparse(a.annotation) for a in positional if a.annotation)
    return [annotation for annotation, count in annotations.items() if count > 1]


_OWN = {"self", "cls"}


def swappable_functions() -> list[str]:
    """Functions of more than MOST_PARAMETERS of which two could be swapped unnoticed."""
    return [
        f"{file}:{node.lineno} {node.name}: several {', '.join(swappable)}"
        for file, node in nodes()
        if isinstance(node, ast.FunctionDef) and (swappable := swappable_parameters(node))
    ]


@pytest.mark.slow
def test_a_constructor_with_many_arguments_is_called_with_their_names() -> None:
    assert long_constructor_calls() == []


@pytest.mark.slow
def test_no_two_of_many_parameters_can_be_swapped_unnoticed() -> None:
    assert swappable_functions() == []


@pytest.mark.parametrize(
    ("signature", "swappable"),
    [
        ("a: int, b: int, c: str, d: bytes, e: set, f: dict, g: list", ["int"]),
        ("a: int, *, b: int, c: str, d: str, e: set, f: dict, g: list", []),
        ("self, a: int, b: int, c: str, d: str, e: set, f: dict", []),
    ],
)
def test_what_can_be_swapped(signature: str, swappable: list[str]) -> None:
    (function,) = ast.parse(f"def f({signature}): ...").body
    assert isinstance(function, ast.FunctionDef)
    assert swappable_parameters(function) == swappable


if __name__ == "__main__":
    print(*long_constructor_calls(), *swappable_functions(), sep="\n")
