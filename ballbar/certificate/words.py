"""Words, numbers and dates of a certificate in the reader's language."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, get_args

from ballbar.cell.errors import InputError
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
    """The words of a locale."""

    locale: Locale

    def __call__(self, key: str, **values: str) -> str:
        return str(table()[key][LOCALES.index(self.locale)]).format(**values)

    def number(self, value: float, decimals: int) -> str:
        """A number with so many decimals and the locale's mark."""
        return fixed(value, decimals).replace(".", self("decimal_mark"))

    def plain(self, value: float) -> str:
        """A number that somebody wrote, with its own digits."""
        return f"{value:.10g}".replace(".", self("decimal_mark"))

    def millimetres(self, value: float, sigma: float) -> str:
        """A length [m] in mm, down to the second digit of its standard uncertainty [m]."""
        return f"{self.number(value * MM, decimals_for([sigma * MM], digits=2))}\u00a0mm"

    def percent(self, share: float) -> str:
        """A share in percent with one decimal."""
        return self.number(100.0 * share, 1)

    def range(self, low: float, high: float, decimals: int = 0) -> str:
        """Two ends of a range."""
        ends = (self.number(value, decimals) for value in (low, high))
        return self("range", low=next(ends), high=next(ends))


def known_locale(name: str) -> Locale:
    """The locale of this name. Raises InputError where there is none."""
    for locale in LOCALES:
        if locale == name:
            return locale
    raise InputError(f"--locale {name}: there are {', '.join(LOCALES)}.")
