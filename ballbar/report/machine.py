"""What the complete model found, as text with sensible digits: corrections, events, rod force, what stands at its prior.

A harmonic's sine and cosine are shown as one amplitude; a compliance as stiffness too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.report.numbers import MISSING, decimals_for, fixed, rms_norm, significant, to_sigma
from ballbar.result.run_data import Joined, RunData, Validation
from ident.estimator.uncertainty import correlated_groups
from ident.held_out import HeldOut
from ident.identify import MOSTLY_PRIOR, CoefficientValue, CorrectionValue, Identification

TENSION_SOURCES = {
    "sensor": "from the force sensor",
    "torque": "from the motor torques",
    "none": "from the geometry alone",
}
_HOW = {
    "sensor": "biases and gains of the sensor fitted, its clock aligned by what it should feel",
    "torque": "friction and gains of the motors fitted; near a reversal of its joint a torque tells nothing, for friction jumps there",
    "none": "no force was logged, or none was asked for; the rod's force is what makes the loop close",
}
_UNITS = {
    "rad": (1e6, "µrad"),
    "rad/(N m)": (1e6, "µrad/(N m)"),
    "m/N": (1e9, "nm/N"),
    "m": (1e6, "µm"),
}  # SI to what is shown
_INVERSE = {"rad/(N m)": "N m/rad", "m/N": "N/m"}
_CARRIERS = {"ripple": "gear ", "encoder": "encoder b"}  # of a harmonic's name


@dataclass(frozen=True)
class CoefficientRow:
    """One coefficient, or one harmonic."""

    name: str
    value: str
    sigma: str
    prior: str
    prior_sigma: str
    information_gain: str
    stiffness: str
    told: bool  # by the data more than by the prior


@dataclass(frozen=True)
class CorrectionTable:
    """One correction."""

    title: str
    unit: str
    stiffness_unit: str  # empty where nothing yields
    rows: tuple[CoefficientRow, ...]


@dataclass(frozen=True)
class RecordingColumn:
    """What one of several recordings has of its own, each with its unit."""

    name: str
    cells: tuple[str, ...]


RECORDING_ROWS = (
    "length",
    "samples",
    "clock offset",
    "clock skew",
    "ball-bar at x, y, z",
    "ball-bar's tilt about x, y",
    "encoder zeros",
    "force in the rod",
    "position residual, rms",
    "angle residual, rms",
    "chi-square per residual",
    "jumps repaired",
)


def correction_tables(result: Identification) -> list[CorrectionTable]:
    """Corrections of the complete model; rows that share a unit share their decimals."""
    return [table for one in result.corrections for table in _tables(one)]


def standing_at_prior(result: Identification) -> list[str]:
    """Names of the kinematic parameters that the data say less about than the prior."""
    return [one.name for one in result.identifiability.dropped if one.reason == "prior"]


def coefficients_at_prior(result: Identification) -> list[CoefficientValue]:
    """Coefficients of the corrections likewise."""
    return [
        value
        for one in result.corrections
        for value in one.coefficients
        if value.information_gain < MOSTLY_PRIOR
    ]


def coefficient_in_words(c: CoefficientValue) -> str:
    """Value and sigma with their unit."""
    factor, unit = _UNITS[c.unit]
    return f"{significant(c.value * factor, 2)} ± {significant(c.sigma * factor, 2)} {unit}"


def groups(result: Identification) -> list[tuple[str, ...]]:
    """Unknowns of robot, ball-bar and corrections that the data tell apart badly."""
    return correlated_groups(result.machine.values, result.machine.names)


def event_rows(data: RunData) -> list[tuple[str, str]]:
    """(recording, what happened) of every jump that was found, held-out recordings too; the name empty for a single recording."""
    several = bool(data.joined or data.validations)
    rows = [
        (one.name if several else "", event.sentence)
        for one in data.fitted
        for event in one.identification.events
    ]
    return rows + [
        (one.outcome.name, event.sentence)
        for one in data.validations
        for event in one.outcome.events
    ]


def tension_sentences(data: RunData) -> list[str]:
    """Where the rod's force came from and how large it was, a sentence each recording."""
    return [
        _tension_sentence(one, named=bool(data.joined))
        for one in data.fitted
        if one.identification.tension.any()
    ]


def recording_columns(joined: Sequence[Joined]) -> list[RecordingColumn]:
    """Of a joint fit: what RECORDING_ROWS names."""
    return [RecordingColumn(one.name, _recording_cells(one)) for one in joined]


def held_out_groups(
    validations: Sequence[Validation],
) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Of each held-out recording its name and rows: (what, nominal robot, identified robot), each with its unit."""
    return [(one.outcome.name, _held_out_rows(one.outcome)) for one in validations]


def _held_out_rows(one: HeldOut) -> list[tuple[str, str, str]]:
    nominal, identified = one.nominal, one.identified
    sizes = [
        ("position, rms", nominal.position_rms, identified.position_rms, "mm"),
        ("position, largest", nominal.position_max, identified.position_max, "mm"),
        ("angle, rms", nominal.angle_rms, identified.angle_rms, "mrad"),
    ]
    return [
        *(
            (what, f"{significant(before * 1e3)} {unit}", f"{significant(after * 1e3)} {unit}")
            for what, before, after, unit in sizes
        ),
        (
            "times what noise explains",
            significant(nominal.ratio, 2),
            significant(identified.ratio, 2),
        ),
        (
            "times what noise and stated uncertainty explain",
            MISSING,
            significant(one.normalised_innovation, 2),
        ),
        ("samples", "", str(one.samples)),
    ]


def _tables(correction: CorrectionValue) -> list[CorrectionTable]:
    """One table for each unit."""
    found = []
    for unit in dict.fromkeys(c.unit for c in correction.coefficients):
        members = [c for c in correction.coefficients if c.unit == unit]
        factor, shown = _UNITS[unit]
        named = _condensed(members)
        decimals = decimals_for([c.sigma * factor for _, c in named], digits=1)
        rows = tuple(_row(name, c, factor, decimals) for name, c in named)
        title = correction.sentence[0].upper() + correction.sentence[1:]
        found.append(CorrectionTable(title, shown, _INVERSE.get(unit, ""), rows))
    return found


def _condensed(members: Sequence[CoefficientValue]) -> list[tuple[str, CoefficientValue]]:
    """Sine and cosine of one harmonic as its amplitude; all others as they are."""
    waves: dict[str, list[CoefficientValue]] = {}
    for c in members:
        base, _, wave = c.name.rpartition("_")
        waves.setdefault(base if wave in ("sin", "cos") else c.name, []).append(c)
    return [
        (_harmonic_name(base), _amplitude(*pair)) if len(pair) == 2 else (base, pair[0])
        for base, pair in waves.items()
    ]


def _harmonic_name(base: str) -> str:
    """`ripple1_40` as `gear 1, 40 a turn`."""
    carrier, _, order = base.partition("_")
    kind = carrier.rstrip("0123456789")
    return f"{_CARRIERS[kind]}{carrier[len(kind) :]}, {order} a turn"


def _amplitude(sine: CoefficientValue, cosine: CoefficientValue) -> CoefficientValue:
    size = float(np.hypot(sine.value, cosine.value))
    spread = (
        float(np.hypot(sine.value * sine.sigma, cosine.value * cosine.sigma)) / size
        if size
        else sine.sigma
    )
    return CoefficientValue(
        "",
        sine.unit,
        size,
        spread,
        0.0,
        sine.prior_sigma,
        min(sine.information_gain, cosine.information_gain),
    )


def _row(name: str, c: CoefficientValue, factor: float, decimals: int) -> CoefficientRow:
    stiffness = ""
    if c.unit in _INVERSE:
        stiffness = f"{_grouped(1.0 / c.value, c.sigma / c.value**2)}" if c.value > 0.0 else MISSING
    return CoefficientRow(
        name,
        fixed(c.value * factor, decimals),
        fixed(c.sigma * factor, decimals + 1),
        significant(c.prior * factor),
        significant(c.prior_sigma * factor),
        f"{100.0 * c.information_gain:.0f} %",
        stiffness,
        c.information_gain > MOSTLY_PRIOR,
    )


def _grouped(value: float, sigma: float) -> str:
    """A large number with its sigma, two digits of it, thousands apart: `405 000 ± 4 600`."""
    step = 10.0 ** max(0, int(np.floor(np.log10(sigma))) - 1) if sigma > 0.0 else 1.0
    numbers = (f"{round(v / step) * step:,.0f}".replace(",", "\u202f") for v in (value, sigma))
    return " ± ".join(numbers)


def _tension_sentence(one: Joined, *, named: bool) -> str:
    found = one.identification
    name = f"{one.name}: " if named else ""
    force = f"{fixed(found.tension.min(), 0)} to {fixed(found.tension.max(), 0)} N"
    return f"{name}{force}, {TENSION_SOURCES[found.tension_source]} ({_HOW[found.tension_source]})."


def _recording_cells(one: Joined) -> tuple[str, ...]:
    found, length = one.identification, one.recording.robot_log.t[-1]
    offset, skew = MISSING, MISSING
    if found.clock is not None:
        sigma = found.clock_sigma
        offset = f"{to_sigma(found.clock.offset * 1e3, sigma[0] * 1e3)} ± {significant(sigma[0] * 1e3, 2)} ms"
        skew = f"{to_sigma(found.clock.skew * 1e6, sigma[1] * 1e6)} ± {significant(sigma[1] * 1e6, 2)} ppm"
    geometry = found.geometry
    return (
        f"{length:.0f} s",
        str(found.after.t.size),
        offset,
        skew,
        f"{', '.join(fixed(geometry[name] * 1e3, 2) for name in ('ox', 'oy', 'oz'))} mm",
        f"{', '.join(fixed(geometry[name] * 1e3, 2) for name in ('otx', 'oty'))} mrad",
        f"{', '.join(fixed(np.degrees(geometry[f'btheta{j}']), 2) for j in found.joints)} deg"
        if found.joints
        else MISSING,
        TENSION_SOURCES[found.tension_source] if found.tension.any() else MISSING,
        f"{significant(rms_norm(found.after.position) * 1e6)} µm",
        f"{significant(rms_norm(found.after.angle) * 1e6)} µrad",
        significant(float((found.whitened**2).mean()), 2),
        str(len(found.events)),
    )
