"""Kinds of instruments, one module each, and their descriptions."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import cast

from cell.instruments.base import Kind

_NO_KINDS = {"base"}  # modules of this folder


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of instrument by its name."""
    modules = sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name not in _NO_KINDS)
    every_kind = (importlib.import_module(f"{__name__}.{name}").KIND for name in modules)
    return {kind.name: cast(Kind, kind) for kind in every_kind}


def kind_named(name: str) -> Kind:
    """The kind of this name. Raises KeyError for another."""
    return kinds()[name]
