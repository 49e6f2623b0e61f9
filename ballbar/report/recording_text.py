"""Clock, alignment, encoder directions and force in the rod of one recording, as text."""

from __future__ import annotations

from dataclasses import dataclass

from ballbar.cell.clock import UNSEEN_OFFSET, UNSEEN_SKEW
from ballbar.cell.number_text import NOT_DETERMINED, duration_text
from ballbar.ident.result import RecordingEstimate
from ballbar.ident.start.automatic import Start
from ballbar.report.numbers import fixed, listed, significant, to_sigma
from ballbar.result.compare import Comparison
from ballbar.units import MS, PPM, US

TENSION_SOURCES = {
    "sensor": "from the force sensor",
    "torque": "from the motor torques",
    "none": "from the geometry alone",
    "instrument": "from the length",
}
_METHODS = {
    "sensor": "biases and gains of the sensor fitted, its clock aligned with the load predicted",
    "torque": (
        "friction and gains of the motors fitted; near a reversal of its joint a torque is not "
        "used, for friction is discontinuous there"
    ),
    "none": (
        "no force was logged, or none was requested; the rod's force is what makes the loop close"
    ),
    "instrument": "fitted as a constant, the spring of the sensor and the friction of its slide",
}


@dataclass(frozen=True)
class ClockRow:
    """Clock offset or skew, each with its unit."""

    name: str
    value: str
    sigma: str
    error: str  # against the truth; empty where it is not known


def clock_rows(estimate: RecordingEstimate, comparison: Comparison | None) -> list[ClockRow]:
    """Offset and skew; empty without a second clock."""
    if (clock := estimate.clock) is None:
        return []
    offset_sigma, skew_sigma = estimate.clock_sigma
    offset_error, skew_error = (comparison.offset, comparison.skew) if comparison else (None, None)
    offset = f"{to_sigma(clock.offset * MS, offset_sigma * MS)} ms"
    skew = f"{to_sigma(clock.skew * PPM, skew_sigma * PPM)} ppm"
    return [
        ClockRow(
            "offset",
            offset if offset_sigma <= UNSEEN_OFFSET else NOT_DETERMINED,
            duration_text(offset_sigma).replace("us", "µs"),
            _signed(offset_error, "µs"),
        ),
        ClockRow(
            "skew",
            skew if skew_sigma <= UNSEEN_SKEW else NOT_DETERMINED,
            f"{significant(skew_sigma * PPM, 2)} ppm",
            _signed(skew_error, "ppm"),
        ),
    ]


def start_rows(start: Start) -> list[tuple[str, str, str]]:
    """Offset, cost and overlap of the chosen way to align the logs and of its rivals.

    Empty where it has none.
    """
    if not start.ambiguous:
        return []
    return [
        (
            f"{significant(candidate.fit.clock().offset, 4)} s",
            significant(candidate.cost),
            f"{significant(candidate.overlap)} s",
        )
        for candidate in (start.chosen, *start.rivals)
    ]


def direction_sentences(estimate: RecordingEstimate) -> list[str]:
    """Directions of the encoders as identified; those of b2 and b4 are a gauge."""
    directions = dict(zip(estimate.encoders, estimate.directions, strict=True))
    gauge = [joint for joint in directions if joint in (2, 4)]
    seen = {joint: sign for joint, sign in directions.items() if joint not in gauge}
    findings = {
        "direction as declared": [joint for joint, sign in seen.items() if sign > 0],
        "direction opposite to the declared one; the identified one is used": [
            joint for joint, sign in seen.items() if sign < 0
        ],
        "direction taken as declared: it cannot be observed, and does not change the result": gauge,
    }
    return [
        f"{listed([f'b{joint}' for joint in joints])}: {finding}."
        for finding, joints in findings.items()
        if joints
    ]


def tension_sentence(estimate: RecordingEstimate) -> str:
    """Smallest and largest force, tension positive; empty where no loads were needed."""
    if estimate.tension is None:
        return ""
    least, most = (
        fixed(float(force), 0) for force in (estimate.tension.min(), estimate.tension.max())
    )
    source = estimate.tension_source
    return f"{least} to {most} N, {TENSION_SOURCES[source]} ({_METHODS[source]})."


def _signed(error: float | None, unit: str) -> str:
    """An error [s] or [1] in µs or ppm."""
    return "" if error is None else f"{significant(error * US, 2, sign=True)} {unit}"
