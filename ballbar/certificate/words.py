"""Words and numbers of a certificate in the reader's language."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, get_args

from ballbar.cell.strict_yaml import load_yaml
from ballbar.report.numbers import decimals_for, fixed
from ballbar.units import MM

Locale = Literal["en", "de", "sv"]
LOCALES: tuple[Locale, ...] = get_args(Locale)


@cache
def table() -> dict[str, list[str]]:
    """Words of each key, one of each locale."""
    return load_yaml(Path(__file__).with_name("words.yaml")).data


@dataclass(frozen=True)
class Words:
    """The words of a locale, and its numbers."""

    locale: Locale

    def __call__(self, key: str, **values: object) -> str:
        return table()[key][LOCALES.index(self.locale)].format(**values)

    def source(self, name: str) -> str:
        """A row of the uncertainty budget; corrections of the model by their names."""
        known = f"budget_{name}" in table()
        return self(f"budget_{name}") if known else self("correction", name=name)

    def number(self, value: float, decimals: int) -> str:
        return fixed(value, decimals).replace(".", self("decimal_mark"))

    def plain(self, value: float) -> str:
        """A number that somebody wrote, with its own digits."""
        return f"{value:.10g}".replace(".", self("decimal_mark"))

    def measured(self, value: float | None, unit: str) -> str | None:
        """Such a number with its unit; None where it is missing."""
        return None if value is None else f"{self.plain(value)}\u00a0{unit}"

    def length(self, value: float, sigma: float) -> str:
        """A length [m] in mm, down to the second digit of its standard uncertainty [m]."""
        return self.number(value * MM, decimals_for([sigma * MM], digits=2))

    def millimetres(self, value: float, sigma: float) -> str:
        """The same with its unit."""
        return f"{self.length(value, sigma)}\u00a0mm"

    def own(self, sigma: float) -> str:
        """A standard uncertainty [m], or a contribution to one, in mm."""
        return self.millimetres(sigma, sigma)

    def percent(self, share: float) -> str:
        return self.number(100.0 * share, 1)

    def probability(self, probability: float, least: float) -> str:
        """In percent; what hardly any draw shows is stated as a limit."""
        if least <= probability <= 1.0 - least:
            return f"{self.percent(probability)}\u00a0%"
        limit = 1.0 - least if probability > 0.5 else least
        return self("above" if probability > 0.5 else "below", percent=self.percent(limit))

    def extent(self, measured: dict[str, float]) -> str:
        """Seconds and instants of motion, and poses at rest, as far as there are any."""
        counts = {key: self.number(measured[key], 0) for key in ("seconds", "samples", "poses")}
        kinds = {"moving": "samples", "still": "poses"}
        return ", ".join(self(kind, **counts) for kind, key in kinds.items() if measured[key])

    def ranges(self, ends: Iterable[Iterable[float]], factor: float) -> str:
        """Pairs of ends, each `low to high`, times a factor."""
        shown = ([self.number(factor * end, 0) for end in pair] for pair in ends)
        return "; ".join(self("range", low=low, high=high) for low, high in shown)
