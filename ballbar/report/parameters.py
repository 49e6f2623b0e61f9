"""Tables of parameters and of corrections: cells are text with sensible digits, with their units.

A harmonic's sine and cosine are shown as one amplitude; a compliance as stiffness too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.geometry import Parameter, parameter_named
from ballbar.ident.fitted_robot import MOSTLY_PRIOR
from ballbar.ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    Identification,
    RecordingEstimate,
    RobotEstimate,
)
from ballbar.report.numbers import MISSING, capitalised, decimals_for, fixed, listed, significant
from ballbar.result.compare import Comparison
from ballbar.units import MM, UM

_UNITS = {
    "rad": (1e6, "µrad"),
    "rad/(N m)": (1e6, "µrad/(N m)"),
    "m/N": (1e9, "nm/N"),
    "m": (1e6, "µm"),
    "rad/m": (1e6, "µrad/m"),
    "s": (1e6, "µs"),
    "s^2": (1e6, "ms²"),
    "1": (1e6, "ppm"),
}  # SI to what is shown; others, of plug-ins, are shown as they are
_INVERSE = {"rad/(N m)": "N m/rad", "m/N": "N/m"}
_CHANNELS = {
    "ripple": "gear ",
    "encoder": "encoder b",
    "joint": "joint ",
}  # by the name of a harmonic
Z_REMARKABLE = 3.0  # standard deviations; 1 in 370 for normal errors

_REASONS = {
    "no effect": "it moves nothing that rod or encoders could see in this run",
    "depends on": "in this run a change of it looks exactly like a change of {on}",
    "poorly excited": "the run determines it worse than 2 mm or 2 mrad",
}
_MEANINGS = {
    "no effect": "The run neither confirms nor corrects its catalogue value.",
    "depends on": (
        "Only the combination is determined. What is identified as {on} {carry} its deviation: "
        "read these values together."
    ),
    "poorly excited": (
        "Its catalogue value is kept because it is the better knowledge. A path that exercises it "
        "more would help."
    ),
}


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that share their units."""

    title: str
    value_unit: str
    deviation_unit: str
    sigma_unit: str
    rows: list[dict[str, str | bool]]  # by column; empty text where one does not apply


def is_encoder_offset(p: Parameter) -> bool:
    """Whether a parameter is the offset of a ball-bar encoder."""
    return p.side == "bar" and p.kind == "theta"


_GROUPS: tuple[tuple[str, Callable[[Parameter], bool]], ...] = (
    ("Robot, lengths", lambda p: p.side == "robot" and p.is_length),
    ("Robot, angles", lambda p: p.side == "robot" and not p.is_length),
    ("Ball-bar, lengths", lambda p: p.side == "bar" and p.is_length),
    (
        "Ball-bar, angles",
        lambda p: p.side == "bar" and not p.is_length and not is_encoder_offset(p),
    ),
    ("Encoder offsets", is_encoder_offset),
    ("Base position", lambda p: p.side == "base" and p.is_length),
    ("Base tilt", lambda p: p.side == "base" and not p.is_length),
)


def parameter_groups(
    estimate: RobotEstimate | RecordingEstimate, comparison: Comparison | None
) -> list[ParameterGroup]:
    """The identified parameters of the machine or of a recording, lengths before angles."""
    identified = [p for p in estimate.geometry.table.parameters if p.name in estimate.sigma]
    groups = [(title, [p for p in identified if belongs(p)]) for title, belongs in _GROUPS]
    return [_group(title, group, estimate, comparison) for title, group in groups if group]


def left_at_nominal(robot: RobotEstimate) -> list[tuple[str, str, str, str]]:
    """Name, value, reason and consequence of what was requested and stays at nominal.

    Those at their priors are not among them.
    """
    rows = []
    for dropped in robot.dropped:
        name, reason, value = dropped.name, dropped.reason, MISSING  # the clock has none
        if reason == "prior":
            continue
        if name in robot.nominal.table.index:
            nominal = robot.nominal[name]
            value = f"{fixed(np.degrees(nominal), 4)} deg"
            if parameter_named(name).is_length:
                value = f"{fixed(nominal * MM, 3)} mm"
        carry = "carries" if len(dropped.on) == 1 else "carry"
        words = {"on": listed(dropped.on) or "other parameters", "carry": carry}
        why, meaning = _REASONS.get(reason, reason), _MEANINGS.get(reason, "")
        rows.append((name, value, why.format(**words), meaning.format(**words)))
    return rows


def not_requested(robot: RobotEstimate) -> list[str]:
    """Names of the machine's parameters that nobody tried to identify: taken as manufactured."""
    tried = set(robot.sigma) | {dropped.name for dropped in robot.dropped}
    machine = (
        p for p in robot.geometry.table.parameters if p.side != "base" and not is_encoder_offset(p)
    )
    return [p.name for p in machine if p.name not in tried]


def taken_as_nominal(estimate: RecordingEstimate) -> list[str]:
    """Names of a recording's own parameters that it does not determine."""
    names = [f"btheta{joint}" for joint in estimate.encoders]
    names += [p.name for p in estimate.geometry.table.parameters if p.side == "base"]
    return [name for name in names if name not in estimate.sigma]


def parameter_count(result: Identification) -> int:
    """Number of identified parameters, those of every recording included."""
    return len(result.robot.sigma) + sum(len(r.sigma) for r in result.recordings)


def _group(
    title: str,
    parameters: Sequence[Parameter],
    estimate: RobotEstimate | RecordingEstimate,
    comparison: Comparison | None,
) -> ParameterGroup:
    """Digits follow the smallest sigma of the group: one of it in the value, two in the sigma."""
    is_length, rows = parameters[0].is_length, list[dict[str, str | bool]]()
    to_value, value_unit = (MM, "mm") if is_length else (180.0 / np.pi, "deg")
    large, small = ("mm", "µm") if is_length else ("mrad", "µrad")
    sigmas = np.array([estimate.sigma[p.name] for p in parameters])
    value_digits = decimals_for(sigmas * to_value, digits=1)
    deviation_digits = decimals_for(sigmas * MM, digits=1)
    sigma_digits = decimals_for(sigmas * UM, digits=2)
    for parameter, sigma in zip(parameters, sigmas.tolist(), strict=True):
        name = parameter.name
        value, nominal = estimate.geometry[name], estimate.nominal[name]
        in_catalogue = parameter.side != "base" and not is_encoder_offset(parameter)
        deviation = value - nominal if in_catalogue else None
        error = comparison.deviations.get(name) if comparison else None
        true_deviation = deviation - error if deviation is not None and error is not None else None
        z = error / sigma if error is not None and sigma > 0.0 else None
        significance = None if deviation is None or sigma == 0.0 else abs(deviation) / sigma
        rows.append(
            {
                "name": name,
                "nominal": fixed(nominal * to_value, value_digits) if in_catalogue else MISSING,
                "identified": fixed(value * to_value, value_digits),
                "deviation": _scaled(deviation, MM, deviation_digits),
                "sigma": fixed(sigma * UM, sigma_digits),
                "significance": significant(significance, 2),
                "true_deviation": _scaled(true_deviation, MM, deviation_digits),
                "error": _scaled(error, UM, sigma_digits),
                "z": fixed(z, 1, sign=True),
                "remarkable": z is not None and abs(z) > Z_REMARKABLE,
            }
        )
    return ParameterGroup(title, value_unit, large, small, rows)


def _scaled(value: float | None, factor: float, decimals: int) -> str:
    return MISSING if value is None else fixed(value * factor, decimals, sign=True)


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
    factor, unit = _UNITS.get(coefficient.unit, (1.0, coefficient.unit))
    value, sigma = (significant(v * factor, 2) for v in (coefficient.value, coefficient.sigma))
    return f"{value} ± {sigma} {unit}"


def _tables(correction: CorrectionEstimate) -> list[CorrectionTable]:
    """One table for each unit."""
    tables = []
    for unit in dict.fromkeys(c.unit for c in correction.coefficients):
        factor, shown_unit = _UNITS.get(unit, (1.0, unit))
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
    """`ripple1_40` as `gear 1, 40 a turn`; another name as it is."""
    channel, _, order = base.partition("_")
    kind = channel.rstrip("0123456789")
    if kind not in _CHANNELS:
        return base
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
