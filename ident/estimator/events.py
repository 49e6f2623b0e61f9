"""Things that happen at one instant: an encoder that jumps, a clock that jumps. Found, located, repaired.

Most show between two rows of a log (ident.signals.steps); they are taken out of it at once, and what the log could not tell of their
size is a step parameter of the complete model. The others - too slow, too small, or while everything stood still - are found
in that model's residual. A jump at time tau adds a step to its carrier: encoder angle or time. For every possible tau the
decrease of the cost that a step there would bring, everything else refitted, follows from sums over the samples behind it, so
all instants of all carriers cost little more than one fit. The largest decrease above the threshold becomes a step parameter;
then again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from cell.chain import Array
from ident.corrections.base import BAR, GEAR, ROD, Coefficient, Correction, State
from ident.estimator.joint_fit import JointFit, Track, jacobian
from ident.estimator.problem import Clock
from ident.signals.smooth_log import SmoothLog
from ident.signals.step_fault import StepFault

THRESHOLD = 250.0  # decrease of the cost, in units of chi-square per degree of freedom, from which a step is an event
MARGIN = 15  # samples at either end, where a step is little more than a different start
JUMP_PRIOR = 0.1  # [rad] of an encoder
EXACT = 1e-9  # [rad] of one whose size is known
WHOLE, SURE = (
    0.1,
    0.01,
)  # signal periods off a whole number, to be called one and to be taken for one
Kind = Literal["encoder", "clock"]
SMALLEST: dict[Kind, float] = {
    "encoder": 2e-4,
    "clock": 2e-3,
}  # [rad], [s] below it a step is something smooth that the model lacks
MAX_EVENTS = 6  # found in the residual
AS_LIKELY = 25.0  # gain, in units of chi-square per degree of freedom, by which instants must differ to be told apart
LIKE = 0.3  # of a clock step: so close comes the irregularity of the stamps that it left


def step_faults_in_logs(
    robot: SmoothLog,
    bar: SmoothLog | None,
    joints: tuple[int, ...],
    signs: Array,
    clock: Clock,
    recording: int = 0,
) -> tuple[StepFault, ...]:
    """What the logs of one recording showed by themselves and no longer hold, times on the ball-bar's clock without its steps.

    signs : (E,) of the encoders `joints` relative to their declared directions. clock : as far as it is known.
    """
    if bar is None:
        return ()
    found = []
    for one in bar.breaks:
        kind: Kind = "clock" if one.channel is None else "encoder"
        joint, sign = (
            (0, 1.0) if one.channel is None else (joints[one.channel], float(signs[one.channel]))
        )
        found.append(
            StepFault(recording, kind, joint, one.time, sign * one.size, removed=sign * one.size)
        )
    for one in robot.breaks:
        if one.channel is None:
            time = clock.ballbar_time(one.time)
            found.append(StepFault(recording, "clock", 0, time, -one.size, removed=-one.size))
    return tuple(found)


def find_step_fault(fit: JointFit) -> StepFault | None:
    """The step that would lower the cost most, if any is beyond the threshold."""
    best, found = THRESHOLD * max(1.0, fit.chi2_per_dof), None
    for k, (point, weights, residual) in enumerate(
        zip(fit.linear.points, fit.linear.weights, fit.linear.residuals, strict=True)
    ):
        track, layout = fit.model.tracks[k], fit.model.unknowns
        carriers = weights(point.columns)
        candidates: list[tuple[Kind, int, Array]] = [
            ("encoder", j, carriers[BAR:ROD][j - 1]) for j in track.joints
        ]
        if layout.own[k].clock is not None:
            candidates.append(
                ("clock", 0, np.einsum("gen,gn->en", carriers[GEAR:BAR], point.speed))
            )
        columns = np.stack([column for _, _, column in candidates])
        scores, energies = (
            _from_the_end((columns * residual).sum(axis=1)),
            _from_the_end((columns * columns).sum(axis=1)),
        )
        rows = zip(
            candidates, scores, energies, energies - _explained(fit, k, columns), strict=True
        )
        for (kind, joint, _), score, energy, left in rows:
            gain = np.where(
                left > 1e-3 * energy.max(), score**2 / np.maximum(left, 1e-3 * energy.max()), 0.0
            )
            gain[:MARGIN] = gain[-MARGIN:] = 0.0
            i = int(gain.argmax())
            size = float(score[i] / left[i])  # what the step would take out
            if gain[i] > best and abs(size) > SMALLEST[kind]:
                best = float(gain[i])
                time = float(0.5 * (track.times[i - 1] + track.times[i]))
                if kind == "clock":
                    likely = track.times[gain > gain[i] - AS_LIKELY * max(1.0, fit.chi2_per_dof)]
                    time = _at_a_stamp(
                        track, layout.clock(fit.x, k), time, (likely[0], likely[-1]), size
                    )
                found = StepFault(k, kind, joint, time, size)
    return found


def _explained(fit: JointFit, k: int, columns: Array) -> Array:
    """(C, N) how much of each column (C, E, N) of recording k, from each sample on, the unknowns of the fit could make up for."""
    model = fit.model
    out, beyond = np.empty(columns[:, 0].shape), np.zeros((len(columns), model.unknowns.count))
    for block in jacobian(model, fit.x, k, fit.linear.points[k], fit.linear.weights[k]):
        for c, column in enumerate(columns[..., block.samples]):
            behind = _from_the_end(block.against(column, model, k)) + beyond[c][:, None]
            beyond[c] = behind[:, 0]
            out[c, block.samples] = np.einsum("pn,pn->n", behind, fit.covariance @ behind)
    return out


def _at_a_stamp(
    track: Track, clock: Clock, time: float, within: tuple[float, float], size: float
) -> float:
    """[s] the time of a clock step of `size` [s], from the irregular stamp that it left in either log if there is one.

    While everything stands still, all instants `within` are as likely and only the stamps tell.
    """
    assert track.bar is not None
    best = LIKE * abs(size)
    for log, step in ((track.bar, size), (track.robot, -size)):
        late = np.diff(log.stamps) - log.row_period
        middle = 0.5 * (log.stamps[1:] + log.stamps[:-1])
        if log is track.robot:
            middle = clock.ballbar_time(middle)
        margin = log.row_period + float(np.median(np.diff(track.times)))
        off = np.where(
            (middle > within[0] - margin) & (middle < within[1] + margin),
            np.abs(late - step),
            np.inf,
        )
        if off.min() < best:
            best, time = float(off.min()), float(middle[off.argmin()])
    return time


def _from_the_end(values: Array) -> Array:
    """Sums over each sample and all behind it, along the last axis."""
    return np.asarray(np.cumsum(values[..., ::-1], axis=-1)[..., ::-1])


def jumps(events: tuple[StepFault, ...]) -> Correction | None:
    """The encoder events as a correction: one step each, what the log no longer holds left out."""
    chosen = [e for e in events if e.kind == "encoder"]
    if not chosen:
        return None

    def signals(state: State) -> list[Array]:
        return [
            ((state.t >= e.time) & (state.recording == e.recording)).astype(float) for e in chosen
        ]

    coefficients = [
        Coefficient(
            f"jump{i + 1}_b{e.joint}",
            "rad",
            e.removed - e.size if e.periods else 0.0,
            EXACT if e.periods else JUMP_PRIOR,
            BAR + e.joint - 1,
        )
        for i, e in enumerate(chosen)
    ]
    return Correction("encoder_jumps", "encoders that jumped", tuple(coefficients), signals)


def sized(fit: JointFit, events: tuple[StepFault, ...], lines: int) -> tuple[StepFault, ...]:
    """The events with their sizes as fitted and their times as logged; whole signal periods of an encoder with `lines` recognised.

    A jump that the log showed and the fit put back was motion: it is no event.
    """
    return tuple(
        as_logged(replace(event, size=size), fit.model.tracks[event.recording].bar, lines)
        for event, size in zip(events, _sizes(fit, events), strict=True)
        if abs(size) > SMALLEST[event.kind]
    )


def with_exact_periods(
    fit: JointFit, events: tuple[StepFault, ...], lines: int
) -> tuple[StepFault, ...]:
    """The events, those of an encoder that slipped by whole signal periods with that size: nothing is left to be fitted of it."""
    out = []
    for event, size in zip(events, _sizes(fit, events), strict=True):
        periods = size * lines / (2.0 * np.pi)
        whole = round(periods)
        exact = event.kind == "encoder" and whole != 0 and abs(periods - whole) < SURE
        out.append(
            replace(event, size=whole * 2.0 * np.pi / lines, periods=whole) if exact else event
        )
    return tuple(out)


def as_logged(event: StepFault, bar: SmoothLog | None, lines: int) -> StepFault:
    """The event with its time as the ball-bar's log has it, the steps of its clock included; whole signal periods recognised."""
    steps = [one for one in bar.breaks if one.channel is None] if bar is not None else []
    time = event.time + sum(one.size for one in steps if one.time < event.time)
    if event.kind == "clock":
        return replace(event, time=time)
    periods = event.size * lines / (2.0 * np.pi)
    whole = round(periods) if abs(periods) > 0.5 and abs(periods - round(periods)) < WHOLE else 0
    return replace(event, time=time, periods=whole)


def _sizes(fit: JointFit, events: tuple[StepFault, ...]) -> list[float]:
    """[rad, s] what was taken out of the log and what the fit took out beyond that, together."""
    layout, out = fit.model.unknowns, []
    jump, step = 0, [0] * len(fit.model.tracks)
    for event in events:
        if event.kind == "clock":
            where = layout.own[event.recording].steps
            assert where is not None
            added = float(fit.x[where.start + step[event.recording]])
            step[event.recording] += 1
        else:
            jump += 1
            added = float(fit.x[layout.names.index(f"jump{jump}_b{event.joint}")])
        out.append(event.removed - added)
    return out
