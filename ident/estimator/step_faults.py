"""Step faults: an encoder that slips, a clock that is set. Found, located, repaired.

Most show between two rows of a log (ballbar.ident.signals.steps); they are taken out of it at once,
and what the log could not tell of their size is a step parameter of the complete model. The others,
too slow, too small, or while everything stood still, are found in that model's residual. A step at
time tau adds a step to its error channel: encoder angle or time. For every possible tau the
decrease of the cost that a step there would bring, everything else refitted, follows from sums over
the samples behind it, so all instants of all channels cost little more than one fit. The largest
decrease above the threshold becomes a step parameter; then again.

Constants: chosen on the recordings of benchmarks/robustness.py; a threshold of 250 is met by no
fault-free recording of benchmarks/everything_on.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.ident.corrections.base import BAR, ROD, Coefficient, Correction, State
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import jacobian
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.signals.smooth_log import SmoothLog
from ballbar.ident.signals.steps import StepFault

THRESHOLD = 250.0  # decrease of the cost, in units of chi-square per degree of freedom, of a fault
MARGIN = 15  # samples at either end, where a step is little more than a different start
SLIP_PRIOR = 0.1  # [rad] of an encoder's step
EXACT = 1e-9  # [rad] of one whose size is known
ENCODER_JUMPS = "encoder_jumps"
WHOLE, SURE = 0.1, 0.01  # signal periods off a whole number, to be named one; to be held at it
# [rad], [s] a smaller step is something smooth that the model lacks
SMALLEST: dict[Literal["encoder", "clock"], float] = {"encoder": 2e-4, "clock": 2e-3}
MAX_FOUND = 6  # in the residual of one set of recordings
AS_LIKELY = 25.0  # decrease of the cost too, by which distinguishable instants differ
SIMILAR = 0.3  # of a clock step: how close the irregularity of the stamps that it left must come
# Every so many instants are tried first, and all of them where one comes so close to the threshold
_SCANNED, _NEARLY = 4, 0.8
_DEPENDENT = 1e-3  # of the largest: a step whose remainder is smaller can be anywhere


@dataclass(frozen=True, eq=False)
class _Channel:
    """A channel that may have a step: an encoder or the clock."""

    kind: Literal["encoder", "clock"]
    joint: int  # 1..5; 0 for the clock
    column: Array  # (E, N) whitened


def step_faults_in_logs(
    samples: Samples, clock: Clock, recording: int = 0
) -> tuple[StepFault, ...]:
    """Step faults that the logs of one recording showed by themselves and no longer hold.

    clock : as far as it is known. Times are on the ball-bar's clock without its steps.
    """
    if samples.ballbar is None:
        return ()
    faults = []
    for step in samples.ballbar.steps:
        if step.channel is None:
            faults.append(_removed(recording, 0, step.time, step.size))
        elif not samples.measures_length:
            size = float(samples.directions[step.channel]) * step.size
            faults.append(_removed(recording, samples.encoders[step.channel], step.time, size))
    for step in samples.robot.steps:
        if step.channel is None:
            faults.append(_removed(recording, 0, clock.ballbar_time(step.time), -step.size))
    return tuple(faults)


def _removed(recording: int, joint: int, time: float, size: float) -> StepFault:
    """A fault that was taken out of its log; joint 0 is the clock."""
    kind: Literal["encoder", "clock"] = "encoder" if joint else "clock"
    return StepFault(recording, kind, joint, time, size, removed=size)


def find_step_fault(fit: Fit) -> StepFault | None:
    """The step that would lower the cost of a fit most, if any is beyond the threshold."""
    unit = max(1.0, fit.chi2_per_dof)
    best, fault = THRESHOLD * unit, None
    for k, samples in enumerate(fit.model.recordings):
        channels = _channels(fit, k)
        if not channels:
            continue
        columns = np.stack([channel.column for channel in channels])
        residual = fit.linear.residuals[k]
        scores = _sums_from_the_end((columns * residual).sum(axis=1))
        energies = _sums_from_the_end((columns * columns).sum(axis=1))
        if _gains(fit, k, columns, scores, energies, _SCANNED)[0].max() < _NEARLY * best:
            continue
        gains, remainders = _gains(fit, k, columns, scores, energies)
        for channel, score, gain, rest in zip(channels, scores, gains, remainders, strict=True):
            i = int(gain.argmax())
            size = float(score[i] / rest[i])  # what the step would take out
            if gain[i] <= best or abs(size) <= SMALLEST[channel.kind]:
                continue
            best = float(gain[i])
            time = float(0.5 * (samples.times[i - 1] + samples.times[i]))
            if channel.kind == "clock":
                likely = samples.times[gain > gain[i] - AS_LIKELY * unit]
                time = _time_at_a_stamp(samples, fit.clock(k), time, likely, size)
            fault = StepFault(k, channel.kind, channel.joint, time, size)
    return fault


def _channels(fit: Fit, k: int) -> list[_Channel]:
    """The encoders and the clock of recording k."""
    point, weights = fit.linear.evaluations[k], fit.linear.weights[k]
    encoders = fit.model.recordings[k].encoders
    columns = weights(point.columns[BAR:ROD])
    channels = [_Channel("encoder", j, columns[j - 1]) for j in encoders]
    if fit.model.unknowns.own[k].clock is not None:
        channels.append(_Channel("clock", 0, weights(point.time_column)))
    return channels


def _gains(
    fit: Fit, k: int, columns: Array, scores: Array, energies: Array, every: int = 1
) -> tuple[Array, Array]:
    """Decreases of the cost by a step at every so many samples, and energies that no refit absorbs.

    columns : (C, E, N) whitened, of the channels. scores, energies : (C, N) their sums from each
    sample on, with the residual and with themselves. Both results are (C, N / every).
    """
    floor = _DEPENDENT * energies.max(axis=1, keepdims=True)
    rest = energies[:, ::every] - _explained(fit, k, columns, every)
    gains = np.where(rest > floor, scores[:, ::every] ** 2 / np.maximum(rest, floor), 0.0)
    margin = -(-MARGIN // every)
    gains[:, :margin] = gains[:, -margin:] = 0.0
    return gains, rest


def _explained(fit: Fit, k: int, columns: Array, every: int) -> Array:
    """(C, N / every) energy that a refit absorbs of each column (C, E, N) from a sample on."""
    out, beyond = np.empty(columns[:, 0].shape), np.zeros((len(columns), fit.model.unknowns.count))
    for block in jacobian(fit.model, fit.linear, k, from_the_end=True):
        first = -block.samples.start % every
        at = slice(block.samples.start + first, block.samples.stop, every)
        for c, column in enumerate(columns[..., block.samples]):
            behind = _sums_from_the_end(block.scores(column, fit.model, k)) + beyond[c][:, None]
            beyond[c] = behind[:, 0]
            own = np.flatnonzero(behind.any(axis=1))  # not what other recordings alone tell
            tried, covariance = behind[own, first::every], fit.covariance[np.ix_(own, own)]
            out[c, at] = np.einsum("pn,pn->n", tried, covariance @ tried)
    return out[:, ::every]


def _time_at_a_stamp(
    samples: Samples, clock: Clock, time: float, likely: Array, size: float
) -> float:
    """[s] instant of a clock step of `size` [s], from an irregular stamp of either log, if any.

    While everything stands still all instants `likely` (L,) [s] are equally likely, and only the
    stamps tell.
    """
    logs: list[tuple[SmoothLog, float]] = [(samples.robot, -size)]
    if samples.ballbar is not None:
        logs.insert(0, (samples.ballbar, size))
    best = SIMILAR * abs(size)
    for log, step in logs:
        late = np.diff(log.stamps) - log.row_period
        middle = 0.5 * (log.stamps[1:] + log.stamps[:-1])
        if log is samples.robot:
            middle = clock.ballbar_time(middle)
        margin = log.row_period + samples.spacing
        inside = (middle > likely[0] - margin) & (middle < likely[-1] + margin)
        off: Array = np.where(inside, np.abs(late - step), np.inf)
        if off.min() < best:
            best, time = float(off.min()), float(middle[off.argmin()])
    return time


def _sums_from_the_end(values: Array) -> Array:
    """Sums over each sample and all behind it, along the last axis."""
    return np.asarray(np.cumsum(values[..., ::-1], axis=-1)[..., ::-1])


def encoder_slips(faults: Sequence[StepFault]) -> Correction | None:
    """The encoder faults as a correction, one step each; None if there are none."""
    slips = [fault for fault in faults if fault.kind == "encoder"]
    if not slips:
        return None

    def regressors(state: State) -> list[Array]:
        chosen: list[NDArray[np.bool_]] = [
            (state.t >= fault.time) & (state.recording == fault.recording) for fault in slips
        ]
        return [step.astype(float) for step in chosen]

    coefficients = [
        Coefficient(
            name=f"jump{i}_b{fault.joint}",
            unit="rad",
            mean=fault.removed - fault.size if fault.periods else 0.0,
            sigma=EXACT if fault.periods else SLIP_PRIOR,
            channel=BAR + fault.joint - 1,
        )
        for i, fault in enumerate(slips, start=1)
    ]
    return Correction(ENCODER_JUMPS, "encoders that slipped", tuple(coefficients), regressors)


def sized(fit: Fit, faults: Sequence[StepFault], lines: int) -> tuple[StepFault, ...]:
    """The faults with sizes as fitted and times as logged; lines : of an encoder, per turn.

    A step that the log showed and the fit put back was motion: it is no fault.
    """
    return tuple(
        as_logged(replace(fault, size=size), fit.model.recordings[fault.recording].ballbar, lines)
        for fault, size in zip(faults, _sizes(fit, faults), strict=True)
        if abs(size) > SMALLEST[fault.kind]
    )


def with_exact_periods(fit: Fit, faults: Sequence[StepFault], lines: int) -> tuple[StepFault, ...]:
    """The faults, slips by whole signal periods held at that size: nothing of it is left to fit."""
    out = []
    for fault, size in zip(faults, _sizes(fit, faults), strict=True):
        periods = size * lines / (2.0 * np.pi)
        whole = round(periods)
        if fault.kind == "encoder" and whole != 0 and abs(periods - whole) < SURE:
            fault = replace(fault, size=whole * 2.0 * np.pi / lines, periods=whole)  # noqa: PLW2901
        out.append(fault)
    return tuple(out)


def as_logged(fault: StepFault, ballbar: SmoothLog | None, lines: int) -> StepFault:
    """The fault with its time as the ball-bar's log has it; whole signal periods are recognised."""
    steps = [s for s in ballbar.steps if s.channel is None] if ballbar is not None else []
    time = fault.time + sum(step.size for step in steps if step.time < fault.time)
    if fault.kind == "clock":
        return replace(fault, time=time)
    periods = fault.size * lines / (2.0 * np.pi)
    whole = round(periods)
    whole_enough = abs(periods) > 0.5 and abs(periods - whole) < WHOLE
    return replace(fault, time=time, periods=whole if whole_enough else 0)


def _sizes(fit: Fit, faults: Sequence[StepFault]) -> list[float]:
    """[rad, s] what was taken out of the log and what the fit took out beyond that, together."""
    layout, out = fit.model.unknowns, []
    slips, steps = 0, [0] * len(fit.model.recordings)
    for fault in faults:
        if fault.kind == "clock":
            steps[fault.recording] += 1
            tail = f"@{fault.recording + 1}" if len(steps) > 1 else ""
            name = f"clock_step{steps[fault.recording]}{tail}"
        else:
            slips += 1
            name = f"jump{slips}_b{fault.joint}"
        out.append(fault.removed - float(fit.x[layout.names.index(name)]))
    return out
