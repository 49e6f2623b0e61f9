"""Remarks on recordings: what was repaired or left out, and what the fit shows of the machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import parameter_named
from ballbar.ident.corrections.joint_harmonics import harmonic_name
from ballbar.ident.corrections.link_growth import UNIT
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.order_search import JointOrder
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.evidence import ClosureEvidence, Evidence
from ballbar.ident.least_sizes import (
    LITTLE_LAG,
    LITTLE_RATIO,
    LITTLE_RIPPLE,
    LITTLE_SHIFT,
    LITTLE_TURN,
    not_by_chance,
)
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.result import CorrectionEstimate, RecordingEstimate
from ballbar.ident.signals.smooth_log import LogOutliers
from ballbar.ident.signals.steps import StepFault
from ballbar.ident.verdict import PLAUSIBLE

CLEAR = 5.0  # stated deviations of a lag or ratio that is remarked on
FEW_SAMPLES = 200  # thesis sec. 3.5 wants 750
# [m] error of the rod that is remarked on, unless its file allows more, and in stated deviations
ROD, ROD_SIGMAS = 5e-4, 3.0
# Autocorrelation that is remarked on: it widens a deviation by 5 %; and in its own standard
# deviations for white noise, 1 / sqrt(samples)
CORRELATED, CORRELATED_SIGMAS = 0.05, 2.0
# Standard deviations by which the lengths that give the scale contradict each other: from the
# first, as once in 20 sound machines, it is said; from the second, as once in 370, one is wrong
DOUBTED, CONTRADICTION = 2.0, 3.0


def rod_remark(evidence: ClosureEvidence) -> list[str]:
    """A rigid rod whose length differs from its file; the fit is no worse for it."""
    robot, ballbar = evidence.robot, evidence.robot.cell.ballbar
    length, stated, sigma = robot.geometry["bd3"], robot.nominal["bd3"], robot.sigma.get("bd3")
    if sigma is None or ballbar.stroke is not None:
        return []
    least = max(ROD, ballbar.length_tolerance, ROD_SIGMAS * sigma)
    if not least < abs(length - stated) <= PLAUSIBLE:
        return []  # beyond it the verdict's sentence says so
    return [
        f"the rod comes out {length * 1e3:.2f} mm long, and the file of {ballbar.name} states "
        f"{stated * 1e3:.2f} mm (bd3); is it the ball-bar that was used? Name it, or correct bd3"
    ]


def contradiction_remark(evidence: ClosureEvidence) -> str:
    """How far lengths that are stated as known contradict each other."""
    of = {evidence.robot.nominal.table.plate: "plate ", "bd3": "rod "}
    names = ", ".join(of.get(name, "") + name for name in evidence.lengths_named)
    return (
        f"the lengths that the files state as known{f' ({names})' if names else ''} contradict "
        f"each other by {evidence.lengths_apart:.1f} standard deviations"
    )


def doubted_lengths(evidence: ClosureEvidence) -> Iterator[str]:
    """Known lengths that contradict each other, but not as none of a sound machine do."""
    apart = evidence.lengths_apart
    if DOUBTED < apart <= CONTRADICTION and evidence.lengths_off > LITTLE_SHIFT:
        yield (
            f"{contradiction_remark(evidence)}; the stated uncertainty covers the scale of each. "
            "Measure the rod and the plate again"
        )


def _directions(recording: RecordingEstimate) -> Iterator[str]:
    directions = recording.start.chosen.hypothesis.directions
    for joint, direction in zip(recording.encoders, directions, strict=True):
        if direction < 0:
            yield (
                f"encoder b{joint} counts against its declared direction; the identified one is "
                "used (check `sign` in recording.yaml)"
            )


def recording_remarks(evidence: Evidence) -> Iterator[str]:
    """Encoder directions, samples and autocorrelation of a recording, and what its logs show."""
    closure, recording = evidence.closure, evidence.recording
    if closure is None or recording is None:
        return
    yield from _directions(recording)
    if recording.samples < FEW_SAMPLES:
        yield (
            f"only {recording.samples} samples in the fit; intervals are optimistic (thesis sec. "
            "3.5 wants 750). Record longer, or raise --samples"
        )
    chance = CORRELATED_SIGMAS / np.sqrt(max(1, recording.samples))
    if closure.fit.autocorrelation > max(CORRELATED, chance) and not closure.complete:
        left_out = "elastic gears, backlash, ripple"
        if recording.encoders:
            left_out += ", rod strain, eccentric encoders"
        yield (
            f"neighbouring residuals are correlated ({closure.neighbours}): something is not in "
            f"this model, which is of kinematics alone ({left_out}; --model complete fits them)"
        )
    yield from evidence.remarks


def log_remarks(samples: Samples, faults: Sequence[StepFault]) -> tuple[str, ...]:
    """A sentence for each step fault, each further repair, and the outliers of each log."""
    remarks = [fault.sentence for fault in faults]
    for step in samples.robot.steps:
        if step.channel is not None:
            remarks.append(
                f"robot joint {step.channel + 1} jumped by {step.size * 1e3:+.3f} mrad at row "
                f"{step.row} of its log; taken out of it. Record again if it was not its resolver"
            )
        elif samples.ballbar is None:
            remarks.append(
                f"the robot's clock stepped by {step.size * 1e3:+.1f} ms at row {step.row} of its "
                "log; taken out of it. Do not set clocks while recording"
            )
    remarks += _left_out(
        "robot", samples.robot.outliers, [f"joint {j + 1}" for j in range(samples.joint_noise.size)]
    )
    if samples.ballbar is not None:
        channels = [f"b{joint}" for joint in samples.encoders] or ["length"]
        log = "length" if samples.measures_length else "ball-bar"
        remarks += _left_out(log, samples.ballbar.outliers, channels)
        remarks += [
            f"the length jumped by {step.size * 1e3:+.4f} mm at row {step.row} of its log; taken "
            "out of it. Check the seat and the sensor's cable"
            for step in samples.ballbar.steps
            if samples.measures_length and step.channel is not None
        ]
    return tuple(remarks)


def _left_out(log: str, outliers: LogOutliers, channels: Sequence[str]) -> list[str]:
    if outliers.rows == 0:
        return []
    first = int(outliers.times.argmin())
    rows = f"{outliers.rows:_} of {outliers.of:_} {log} rows".replace("_", " ")
    verb = "is an outlier and was" if outliers.rows == 1 else "are outliers and were"
    return [
        f"{rows} {verb} left out: {channels[outliers.channels[first]]} first at t = "
        f"{outliers.times[first]:.2f} s. A few do no harm; of many, check cable and shield"
    ]


def _ripple(o: JointOrder, values: Mapping[str, float]) -> str:
    """One joint error with its amplitude; empty where it has not lasted, or is small."""
    name = harmonic_name(o.joint, o.order)
    size = np.hypot(values.get(f"{name}_cos", 0.0), values.get(f"{name}_sin", 0.0))
    if size < LITTLE_RIPPLE:
        return ""
    others = f" (or {', '.join(f'{a:g}' for a in o.aliases)})" if o.aliases else ""
    return f"joint {o.joint + 1}: {o.order:g} cycles a turn{others}, {size * 1e6:.0f} urad"


def joint_error_remark(
    orders: Sequence[JointOrder], corrections: Sequence[CorrectionEstimate]
) -> str:
    """The joint errors that were found and lasted, with their amplitudes; empty if there are none.

    corrections : of the result.
    """
    values = {c.name: c.value for correction in corrections for c in correction.coefficients}
    parts = [words for o in orders if (words := _ripple(o, values))]
    if not parts:
        return ""
    return (
        f"joint errors found by evidence: {'; '.join(parts)}. They are in the result; a held-out "
        "recording (--validate) confirms them"
    )


def payload_remark(payload: PayloadEstimate | None) -> str:
    """Remark on masses of the torque logs that replace the file's; else empty."""
    if payload is None or not payload.significant:
        return ""
    gear = int(payload.added_load.argmax())
    return (
        f"the torque log asks for {payload.excess:+.1f} kg at the tool: "
        f"{payload.payload.mass:.1f} kg (2 sigma {2.0 * payload.mass_sigma:.1f}) instead of "
        f"{payload.stated:.1f}, the arm's masses times {payload.payload.arm:.3f}; gear {gear + 1} "
        f"carries {payload.added_load[gear]:.0f} N m rms more. The fit uses these masses; correct "
        "`body` in the plate's file"
    )


def offset_remark(payload: PayloadEstimate | None) -> str:
    """That logged torques are off by a constant; else empty."""
    if payload is None or not payload.offsets:
        return ""
    each = [f"gear {gear} by {offset:+.0f} N m" for gear, offset in payload.offsets.items()]
    return (
        f"logged torques have an offset: {', '.join(each)}. It is in the fit; set the zero of the "
        "current's sensor, or look for a spring or a balancer that the robot's file does not have"
    )


def lag_remark(fit: Fit, sigma: Array) -> str:
    """That some gears are logged later or earlier than the first; else empty.

    sigma : (P,) stated deviations of the unknowns.
    """
    late = [
        f"gear {gear} {abs(lag) * 1e3:.1f} ms {'late' if lag > 0 else 'early'}"
        for gear, lag in _gears(fit, sigma, "lag", LITTLE_LAG)
    ]
    if not late:
        return ""
    return f"against the first gear's the angles are logged late or early: {', '.join(late)}"


def wrong_ratios(fit: Fit, sigma: Array) -> str:
    """The gears that turn otherwise than logged, with by how much; else empty.

    sigma : (P,) stated deviations of the unknowns.
    """
    wrong = _gears(fit, sigma, "ratio", LITTLE_RATIO)
    return ", ".join(f"gear {g} turns {1.0 + off:.5f} times as far as logged" for g, off in wrong)


def _gears(fit: Fit, sigma: Array, kind: str, least: float) -> Iterator[tuple[str, float]]:
    """Gears with an unknown of this kind that is clear and at least of this size, and its value."""
    for name, value, deviation in zip(fit.model.unknowns.names, fit.x, sigma, strict=True):
        gear = name.removeprefix(kind)
        if gear != name and gear.isdigit() and abs(value) > max(least, CLEAR * deviation):
            yield gear, float(value)


def loaded_otherwise(payload: PayloadEstimate | None) -> str:
    """Other loads or unlike tools that the torque logs show; else empty."""
    if payload is None or payload.undeclared or not payload.each:
        return "" if payload is None else payload.undeclared
    masses = " kg, ".join(f"recording {k} for {m:.1f}" for k, m in enumerate(payload.each, 1))
    return (
        f"the recordings are not of one tool: by its torque log {masses} kg at the flange. "
        "Identify them one by one, each with its own `body` in the plate's file"
    )


def change_remarks(fit: Fit, covariance: Array) -> list[str]:
    """Remarks on changes between or during the recordings: a remounted tool, links that grew.

    covariance : (P, P) stated, of the unknowns.
    """
    place, out = {name: i for i, name in enumerate(fit.model.unknowns.names)}, []
    for k in range(1, len(fit.model.recordings)):
        moved = {
            name.removeprefix("remount_").partition("@")[0]: i
            for name, i in place.items()
            if name.startswith("remount_") and name.endswith(f"@{k + 1}")
        }
        at = list(moved.values())
        if not at or not not_by_chance(fit.x[at], covariance[np.ix_(at, at)]):
            continue
        lengths = [i for name, i in moved.items() if parameter_named(name).is_length]
        shift = float(np.linalg.norm(fit.x[lengths]))
        turn = float(np.linalg.norm(fit.x[[i for i in at if i not in lengths]]))
        if shift >= LITTLE_SHIFT or turn >= LITTLE_TURN:
            out.append(
                f"the tool sits elsewhere in recording {k + 1} than in the first, by "
                f"{shift * 1e6:.0f} um and {turn * 1e6:.0f} urad: it was remounted, or yields. "
                "The result is for its seat in the first one"
            )
    for k in range(len(fit.model.recordings)):
        for link, (size, sigma) in growth_of_links(fit, covariance, k).items():
            if abs(size) >= LITTLE_SHIFT and not_by_chance(
                np.array([size]), np.array([[sigma**2]])
            ):
                out.append(
                    f"{link} grew by {size * 1e6:+.0f} um during recording {k + 1}: it warmed up. "
                    "The result is the robot at the start of the first one; warm it up before"
                )
    return out


def growth_of_links(fit: Fit, covariance: Array, k: int) -> dict[str, tuple[float, float]]:
    """Growth [m] of each long link during recording k, and its standard deviation.

    covariance : (P, P) stated, of the unknowns. Empty where the fit has no such unknowns.
    """
    place, out = {name: i for i, name in enumerate(fit.model.unknowns.names)}, {}
    time = fit.model.recordings[k].times[-1] / UNIT
    power = np.array([time, time * time])
    for name, line in place.items():
        if name.startswith("growth_") and name.endswith(f"_line@{k + 1}"):
            at = [line, place[name.replace("_line", "_square")]]
            sigma = float(np.sqrt(power @ covariance[np.ix_(at, at)] @ power))
            link = name.removeprefix("growth_r").partition("_")[0]
            out[link] = (float(power @ fit.x[at]), sigma)
    return out
