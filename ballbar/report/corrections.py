"""Corrections of the complete model as text with sensible digits.

A harmonic's sine and cosine are shown as one amplitude; a compliance as stiffness too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.report.numbers import MISSING, capitalised, decimals_for, fixed, significant
from ident.fitted_robot import MOSTLY_PRIOR
from ident.result import CoefficientEstimate, CorrectionEstimate, RobotEstimate

_UNITS = {
    "rad": (1e6, "µrad"),
    "rad/(N m)": (1e6, "µrad/(N m)"),
    "m/N": (1e9, "nm/N"),
    "m": (1e6, "µm"),
    "rad/m": (1e6, "µrad/m"),
    "s": (1e6, "µs"),
    "s^2": (1e6, "ms²"),
    "1": (1e6, "ppm"),
}  # SI to what is shown
_INVERSE = {"rad/(N m)": "N m/rad", "m/N": "N/m"}
_CHANNELS = {
    "ripple": "gear ",
    "encoder": "encoder b",
    "joint": "joint ",
}  # by the name of a harmonic


@dataclass(frozen=True)
class CorrectionTable:
    """One correction."""

    title: str
    unit: str
    stiffness_unit: str  # empty where nothing is elastic
    rows: list[dict[str, str | bool]]  # one coefficient or one harmonic each, by column


def correction_tables(robot: RobotEstimate) -> list[CorrectionTable]:
    """Corrections of the complete model; rows that share a unit share their decimals."""
    return [table for correction in robot.corrections for table in _tables(correction)]


def parameters_at_prior(robot: RobotEstimate) -> list[str]:
    """Names of the kinematic parameters that the data say less about than the prior."""
    return [dropped.name for dropped in robot.dropped if dropped.reason == "prior"]


def coefficients_at_prior(robot: RobotEstimate) -> list[CoefficientEstimate]:
    """Coefficients of the corrections that the data say less about than the prior."""
    coefficients = (c for correction in robot.corrections for c in correction.coefficients)
    return [c for c in coefficients if c.information_gain < MOSTLY_PRIOR]


def coefficient_text(coefficient: CoefficientEstimate) -> str:
    """Value and sigma with their unit."""
    factor, unit = _UNITS[coefficient.unit]
    value, sigma = (significant(v * factor, 2) for v in (coefficient.value, coefficient.sigma))
    return f"{value} ± {sigma} {unit}"


def _tables(correction: CorrectionEstimate) -> list[CorrectionTable]:
    """One table for each unit."""
    tables = []
    for unit in dict.fromkeys(c.unit for c in correction.coefficients):
        factor, shown_unit = _UNITS[unit]
        named = _condensed([c for c in correction.coefficients if c.unit == unit])
        decimals = decimals_for([c.sigma * factor for _, c in named], digits=1)
        rows = [_row(name, c, factor, decimals) for name, c in named]
        title = capitalised(correction.sentence)
        tables.append(CorrectionTable(title, shown_unit, _INVERSE.get(unit, ""), rows))
    return tables


def _condensed(
    coefficients: Sequence[CoefficientEstimate],
) -> list[tuple[str, CoefficientEstimate]]:
    """Sine and cosine of one harmonic as its amplitude; all others as they are."""
    waves: dict[str, list[CoefficientEstimate]] = {}
    for c in coefficients:
        base, _, wave = c.name.rpartition("_")
        waves.setdefault(base if wave in ("sin", "cos") else c.name, []).append(c)
    return [
        (_harmonic_name(base), _amplitude(*pair)) if len(pair) == 2 else (base, pair[0])
        for base, pair in waves.items()
    ]


def _harmonic_name(base: str) -> str:
    """`ripple1_40` as `gear 1, 40 a turn`."""
    channel, _, order = base.partition("_")
    kind = channel.rstrip("0123456789")
    return f"{_CHANNELS[kind]}{channel[len(kind) :]}, {order} a turn"


def _amplitude(sine: CoefficientEstimate, cosine: CoefficientEstimate) -> CoefficientEstimate:
    size, sigma = float(np.hypot(sine.value, cosine.value)), sine.sigma
    if size:
        sigma = float(np.hypot(sine.value * sine.sigma, cosine.value * cosine.sigma)) / size
    return CoefficientEstimate(
        name="",
        unit=sine.unit,
        value=size,
        sigma=sigma,
        prior=0.0,
        prior_sigma=sine.prior_sigma,
        information_gain=min(sine.information_gain, cosine.information_gain),
    )


def _row(name: str, c: CoefficientEstimate, factor: float, decimals: int) -> dict[str, str | bool]:
    stiffness = ""
    if c.unit in _INVERSE:
        stiffness = _grouped(1.0 / c.value, c.sigma / c.value**2) if c.value > 0.0 else MISSING
    return {
        "name": name,
        "value": fixed(c.value * factor, decimals),
        "sigma": fixed(c.sigma * factor, decimals + 1),
        "prior": significant(c.prior * factor),
        "prior_sigma": significant(c.prior_sigma * factor),
        "information_gain": f"{100.0 * c.information_gain:.0f} %",
        "stiffness": stiffness,
        "from_data": c.information_gain > MOSTLY_PRIOR,  # known from them more than from the prior
    }


def _grouped(value: float, sigma: float) -> str:
    """A large number with its sigma, two digits of it, thousands apart: `405 000 ± 4 600`."""
    step = 10.0 ** max(0, int(np.floor(np.log10(sigma))) - 1) if sigma > 0.0 else 1.0
    numbers = (f"{round(v / step) * step:,.0f}".replace(",", "\u202f") for v in (value, sigma))
    return " ± ".join(numbers)
