"""What the page says of one error source beyond its settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from numpy.typing import ArrayLike

from cell.descriptions import Cell
from generators.scenario_reference.plots import Plot


@dataclass(frozen=True)
class Source:
    """One row of the page."""

    key: str  # in the scenario, with dots
    model: str
    enters: str
    origin: str  # of the default
    in_log: str
    plot: Plot
    what: str = ""  # where the settings have no model of its own
    of_machine: tuple[str, Callable[[Cell], ArrayLike]] | None = (
        None  # unit and sizes of the description files
    )
