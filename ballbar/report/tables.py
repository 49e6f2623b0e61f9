"""Tables of the report: every cell is text with sensible digits, every column or group states its unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.report.numbers import MISSING, decimals_for, fixed, rms, rms_norm, significant
from ballbar.result.compare import Comparison
from cell.arrays import Array
from cell.geometry import INDEX, PARAMETERS, Parameter
from ident.estimator.identifiability import Dependency
from ident.identify import Identification

Z_REMARKABLE = 3.0  # standard deviations; one in 370 for normal errors

_REASONS = {
    "no effect": "it moves nothing that rod or encoders could see in this run",
    "depends on": "in this run a change of it looks exactly like a change of {on}",
    "poorly excited": "the run determines it worse than 2 mm or 2 mrad",
}
_MEANINGS = {
    "no effect": "The run neither confirms nor corrects its catalogue value.",
    "depends on": "Only the combination is determined. What is identified as {on} {carry} its deviation: read these values together.",
    "poorly excited": "Its catalogue value is kept because it is the better knowledge. A path that exercises it more would help.",
}


@dataclass(frozen=True)
class ParameterRow:
    """One identified parameter; empty text where a column does not apply."""

    name: str
    nominal: str
    identified: str
    deviation: str
    sigma: str
    significance: str  # |deviation| over sigma
    true_deviation: str
    error: str
    z: str
    remarkable: bool  # |z| beyond Z_REMARKABLE


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that share their units."""

    title: str
    value_unit: str
    deviation_unit: str
    sigma_unit: str
    rows: tuple[ParameterRow, ...]


@dataclass(frozen=True)
class Leftover:
    """A parameter that stays at its nominal value."""

    name: str
    value: str
    why: str
    meaning: str


def parameter_groups(result: Identification, comparison: Comparison | None) -> list[ParameterGroup]:
    """The identified parameters as robot, ball-bar and base, lengths before angles."""
    members: list[tuple[str, Callable[[Parameter], bool]]] = [
        ("Robot, lengths", lambda p: p.side == "robot" and p.is_length),
        ("Robot, angles", lambda p: p.side == "robot" and not p.is_length),
        ("Ball-bar, lengths", lambda p: p.side == "bar" and p.is_length),
        ("Ball-bar, encoder zeros", lambda p: p.side == "bar" and p.kind == "theta"),
        (
            "Ball-bar, other angles",
            lambda p: p.side == "bar" and not p.is_length and p.kind != "theta",
        ),
        ("Ball-bar base", lambda p: p.side == "base" and p.is_length),
        ("Ball-bar base, tilt", lambda p: p.side == "base" and not p.is_length),
    ]
    identified = [p for p in PARAMETERS if p.name in result.sigma]
    groups = [(title, [p for p in identified if belongs(p)]) for title, belongs in members]
    return [
        _group(title, parameters, result, comparison) for title, parameters in groups if parameters
    ]


def z_rms(result: Identification, comparison: Comparison) -> float:
    """Root mean square of error over stated sigma; near 1 if the intervals are honest."""
    return rms(
        np.array(
            [
                error / result.sigma[name]
                for name, error in comparison.deviations.items()
                if result.sigma[name] > 0.0
            ]
        )
    )


def leftovers(result: Identification) -> list[Leftover]:
    """Parameters that were asked for and stay at nominal, with reason and consequence; those at their priors are not among them."""
    return [
        _leftover(result, one) for one in result.identifiability.dropped if one.reason != "prior"
    ]


def never_asked(result: Identification) -> list[str]:
    """Names of the parameters that no one tried to identify: taken as manufactured."""
    asked = set(result.sigma) | {one.name for one in result.identifiability.dropped}
    unread = {
        f"btheta{j}" for j in range(1, 6) if j not in result.joints
    }  # joints without encoder have no zero
    return [p.name for p in PARAMETERS if p.name not in asked | unread]


def noise_rows(result: Identification, resolution: dict[str, float]) -> list[tuple[str, str, str]]:
    """(signal, noise of one logged row [urad], resolution [urad]); resolution of each encoder in rad by name."""
    joints = [
        (f"robot joint {j + 1}", significant(s * 1e6), MISSING)
        for j, s in enumerate(result.log_noise.joint)
    ]
    noise = {f"b{j}": float(result.log_noise.encoder[j - 1]) for j in result.joints}
    return joints + [
        (f"encoder {name}", significant(s * 1e6), significant(resolution[name] * 1e6))
        for name, s in noise.items()
    ]


def residual_rows(before: Array, after: Array, factor: float) -> list[tuple[str, str, str, str]]:
    """(component, rms before, rms after, largest after) of (N, 3) residuals, times `factor`."""
    rows = [
        (
            name,
            significant(rms(b) * factor),
            significant(rms(a) * factor),
            significant(float(np.abs(a).max()) * factor),
        )
        for name, b, a in zip("xyz", before.T, after.T, strict=True)
    ]
    largest = float(np.linalg.norm(after, axis=1).max())
    return [
        *rows,
        (
            "norm",
            significant(rms_norm(before) * factor),
            significant(rms_norm(after) * factor),
            significant(largest * factor),
        ),
    ]


def tcp_row(name: str, error: Array, without_scale: Array | None) -> tuple[str, str, str, str, str]:
    """(name, mean, 95th percentile, largest, mean without scale) in mm."""
    mean, quantile, largest = (
        significant(float(v) * 1e3) for v in (error.mean(), np.quantile(error, 0.95), error.max())
    )
    return (
        name,
        mean,
        quantile,
        largest,
        MISSING if without_scale is None else significant(float(without_scale.mean()) * 1e3),
    )


def names_in_words(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else ""


def _group(
    title: str, parameters: list[Parameter], result: Identification, comparison: Comparison | None
) -> ParameterGroup:
    """Digits follow the smallest sigma of the group: one digit of it in the value, two in the sigma."""
    is_length = parameters[0].is_length
    to_value, value_unit = (1e3, "mm") if is_length else (180.0 / np.pi, "deg")
    units = (value_unit, "mm", "µm") if is_length else (value_unit, "mrad", "µrad")
    sigmas = [result.sigma[p.name] for p in parameters]
    digits = _Digits(
        decimals_for([s * to_value for s in sigmas], digits=1),
        decimals_for([s * 1e3 for s in sigmas], digits=1),
        decimals_for([s * 1e6 for s in sigmas], digits=2),
    )
    rows = tuple(_row(p, result, comparison, to_value, digits) for p in parameters)
    return ParameterGroup(title, *units, rows)


@dataclass(frozen=True)
class _Digits:
    """Decimals of the columns of one group."""

    value: int
    deviation: int
    sigma: int


def _row(
    parameter: Parameter,
    result: Identification,
    comparison: Comparison | None,
    to_value: float,
    digits: _Digits,
) -> ParameterRow:
    name = parameter.name
    sigma, value, nominal = result.sigma[name], result.geometry[name], result.nominal[name]
    in_catalogue = parameter.side != "base" and not (
        parameter.side == "bar" and parameter.kind == "theta"
    )
    deviation = value - nominal if in_catalogue else None
    error = comparison.deviations.get(name) if comparison else None
    true_deviation = deviation - error if deviation is not None and error is not None else None
    z = error / sigma if error is not None and sigma > 0.0 else None
    return ParameterRow(
        name,
        fixed(nominal * to_value, digits.value) if in_catalogue else MISSING,
        fixed(value * to_value, digits.value),
        _scaled(deviation, 1e3, digits.deviation),
        fixed(sigma * 1e6, digits.sigma),
        MISSING if deviation is None or sigma == 0.0 else significant(abs(deviation) / sigma, 2),
        _scaled(true_deviation, 1e3, digits.deviation),
        _scaled(error, 1e6, digits.sigma),
        fixed(z, 1, sign=True),
        z is not None and abs(z) > Z_REMARKABLE,
    )


def _scaled(value: float | None, factor: float, decimals: int) -> str:
    return MISSING if value is None else fixed(value * factor, decimals, sign=True)


def _leftover(result: Identification, one: Dependency) -> Leftover:
    on = names_in_words(one.on) or "other parameters"
    words = {"on": on, "carry": "carries" if len(one.on) == 1 else "carry"}
    why, meaning = _REASONS.get(one.reason, one.reason), _MEANINGS.get(one.reason, "")
    return Leftover(
        one.name, _nominal_text(result, one.name), why.format(**words), meaning.format(**words)
    )


def _nominal_text(result: Identification, name: str) -> str:
    if name not in INDEX:  # the clock
        return MISSING
    parameter = PARAMETERS[INDEX[name]]
    return (
        f"{fixed(result.nominal[name] * 1e3, 3)} mm"
        if parameter.is_length
        else f"{fixed(np.degrees(result.nominal[name]), 4)} deg"
    )
