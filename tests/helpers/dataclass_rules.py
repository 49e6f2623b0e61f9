"""Rules of the dataclasses of a package: none can be changed, none that holds arrays has `==`."""

from __future__ import annotations

import ast

from tests.helpers.source_imports import FILES, part_of, tree

STATE = {  # what goes on while a command runs
    "ballbar.cell.dh_from_axes._Frame",
    "ballbar.planning.feasible_poses.Screen",
    "ballbar.planning.search.SearchProgress",
    "ballbar.rehearsal.day.Day",
    "ballbar.rehearsal.live.LivePath",
    "ballbar.terminal._Detail",
}


def assert_frozen(package: str, *, least: int) -> None:
    """No dataclass can be changed, and `==` is not defined where it would compare arrays.

    An array has no single truth value, so `==` of what holds one would raise. Sources are read,
    since importing all of the application takes half a minute.
    least : dataclasses that the package has, or nothing would be looked at.
    """
    looked_at = 0
    for name, file in FILES.items():
        if part_of(name) != package or "models" in name:
            continue
        for kind in tree(file).body:
            options = _options(kind)
            if isinstance(kind, ast.ClassDef) and options is not None:
                looked_at += 1
                place = f"{name}.{kind.name}"
                assert options.get("frozen", False) or place in STATE, place
                fields = [line for line in kind.body if isinstance(line, ast.AnnAssign)]
                holds_arrays = any("Array" in ast.unparse(field.annotation) for field in fields)
                assert not (holds_arrays and options.get("eq", True)), place
    assert looked_at > least


def _options(kind: ast.AST) -> dict[str, bool] | None:
    """Options of the decorator `dataclass` of a class; None if it is none."""
    for mark in kind.decorator_list if isinstance(kind, ast.ClassDef) else ():
        if ast.unparse(mark).split("(")[0] in {"dataclass", "dataclasses.dataclass"}:
            given = mark.keywords if isinstance(mark, ast.Call) else []
            return {str(each.arg): ast.literal_eval(each.value) for each in given}
    return None
