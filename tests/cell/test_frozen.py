"""Descriptions, logs and results cannot be changed, and those that hold arrays have no `==`."""

from __future__ import annotations

import dataclasses
from importlib import import_module

from tests.helpers.source_imports import FILES, part_of

CLASSES = {
    f"{name}.{thing.__qualname__}": thing
    for name in FILES
    if part_of(name) in ("acquisition", "cell", "ident", "sim") and "models" not in name
    for thing in vars(import_module(name)).values()
    if isinstance(thing, type) and thing.__module__ == name and dataclasses.is_dataclass(thing)
}
STATE = {"ballbar.cell.dh_from_axes._Frame"}  # moves along the arm, within its module


def test_a_dataclass_is_frozen_and_compares_no_arrays() -> None:
    """An array has no single truth value, so `==` of what holds one would raise."""
    assert len(CLASSES) > 200
    for name, kind in CLASSES.items():
        parameters = vars(kind)["__dataclass_params__"]
        assert parameters.frozen or name in STATE, name
        holds_arrays = any("Array" in str(field.type) for field in dataclasses.fields(kind))
        assert not (holds_arrays and parameters.eq), name
