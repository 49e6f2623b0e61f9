"""Kinds of instruments, one module each, and their descriptions."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Sequence
from functools import cache

from ballbar.cell.instruments.base import Kind
from ballbar.cell.plugins import PluginTable

_NO_KINDS = {"base"}  # modules of this folder


@cache
def kinds() -> dict[str, Kind]:
    """Every kind of instrument by its name: those of this folder, then those of plug-ins.

    Raises ValueError for a chain that two of them have, for a chain tells the kind.
    """
    modules = sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name not in _NO_KINDS)
    own: list[Kind] = [importlib.import_module(f"{__name__}.{name}").KIND for name in modules]
    table = PluginTable(
        "instruments", {kind.name: kind for kind in own}, lambda kind: isinstance(kind, Kind)
    )
    refuse_shared_chains([*table.values()])
    return dict(table)


def refuse_shared_chains(every_kind: Sequence[Kind]) -> None:
    """Raises ValueError for a chain of two kinds, or of one that turns without a sensed ball."""
    owners: dict[tuple[str, ...], Kind] = {}
    for kind in every_kind:
        for chain in kind.chains:
            if (owner := owners.setdefault(chain, kind)) is not kind:
                what = f"chain {' '.join(chain)} is that of {owner.name} and of {kind.name}"
                raise ValueError(f"{what}; take it out of one of them")
            if kind.target_turns and chain[-1] != "ball*":
                what = f"kind {kind.name} measures turns, and its chain ends in {chain[-1]}"
                raise ValueError(f"{what}; let it end in ball*, whose sigma_rad is that of turns")


def kind_named(name: str) -> Kind:
    """The kind of this name. Raises KeyError for another."""
    return kinds()[name]
