"""Things that happen at one instant: an encoder that jumps, a clock that jumps. Found in the residual, located, repaired.

A jump at time tau adds a step to its carrier: encoder angle or time. For every possible tau the decrease of the cost that a
step there would bring, everything else refitted, follows from sums over the samples behind it, so all instants of all
carriers cost little more than one fit. The largest decrease above the threshold becomes a step parameter; then again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from cell.chain import Array
from ident.corrections.base import BAR, GEAR, ROD, Coefficient, Correction, State
from ident.event import Event
from ident.joint_fit import JointFit, jacobian

THRESHOLD = 250.0  # decrease of the cost, in units of chi-square per degree of freedom, from which a step is an event
MARGIN = 15  # samples at either end, where a step is little more than a different start
JUMP_PRIOR = 0.1  # [rad] of an encoder
SMALLEST_JUMP, SMALLEST_STEP = 2e-4, 2e-3  # [rad], [s] below it a step is something smooth that the model lacks
MAX_EVENTS = 6


def find_event(fit: JointFit) -> Event | None:
    """The step that would lower the cost most, if any is beyond the threshold."""
    best, found = THRESHOLD * max(1.0, fit.chi2_per_dof), None
    for k, (point, weights, residual) in enumerate(zip(fit.linear.points, fit.linear.weights, fit.linear.residuals, strict=True)):
        track, layout = fit.model.tracks[k], fit.model.unknowns
        index, columns, slope = jacobian(fit.model, fit.x, k, point, weights)
        carriers = weights(point.columns)
        candidates: list[tuple[Literal["encoder", "clock"], int, Array]] = [("encoder", j, carriers[BAR:ROD][j - 1]) for j in track.joints]
        if layout.own[k].clock is not None:
            candidates.append(("clock", 0, np.einsum("gen,gn->en", carriers[GEAR:BAR], point.speed)))
        knots = layout.own[k].knots
        for kind, joint, column in candidates:
            shared = np.zeros((layout.count, residual.shape[1]))
            shared[index] = (columns * column).sum(axis=1)
            if slope is not None and knots is not None:
                shared[knots] = track.knots * (slope * column).sum(axis=0)
            behind = _from_the_end(shared)
            score, energy = _from_the_end((column * residual).sum(axis=0)), _from_the_end((column * column).sum(axis=0))
            left = energy - np.einsum("pn,pn->n", behind, fit.covariance @ behind)
            gain = np.where(left > 1e-3 * energy.max(), score**2 / np.maximum(left, 1e-3 * energy.max()), 0.0)
            gain[:MARGIN] = gain[-MARGIN:] = 0.0
            i = int(gain.argmax())
            size = float(-score[i] / left[i])
            enough = abs(size) > (SMALLEST_STEP if kind == "clock" else SMALLEST_JUMP)
            if gain[i] > best and enough:
                best = float(gain[i])
                found = Event(k, kind, joint, float(0.5 * (track.times[i - 1] + track.times[i])), size)
    return found


def _from_the_end(values: Array) -> Array:
    """Sums over each sample and all behind it, along the last axis."""
    return np.asarray(np.cumsum(values[..., ::-1], axis=-1)[..., ::-1])


def jumps(events: tuple[Event, ...]) -> Correction | None:
    """The encoder events as a correction: one step each."""
    chosen = [e for e in events if e.kind == "encoder"]
    if not chosen:
        return None

    def signals(state: State) -> list[Array]:
        return [((state.t >= e.time) & (state.recording == e.recording)).astype(float) for e in chosen]

    coefficients = [Coefficient(f"jump{i + 1}_b{e.joint}", "rad", 0.0, JUMP_PRIOR, BAR + e.joint - 1) for i, e in enumerate(chosen)]
    return Correction("encoder_jumps", "encoders that jumped", tuple(coefficients), signals)


def sized(fit: JointFit, events: tuple[Event, ...], lines: int) -> tuple[Event, ...]:
    """The events with their sizes as fitted; whole signal periods of an encoder with `lines` recognised."""
    layout, out = fit.model.unknowns, []
    jump, step = 0, [0] * len(fit.model.tracks)
    for event in events:
        if event.kind == "clock":
            where = layout.own[event.recording].steps
            assert where is not None
            out.append(replace(event, size=float(fit.x[where.start + step[event.recording]])))
            step[event.recording] += 1
            continue
        jump += 1
        size = -float(fit.x[layout.names.index(f"jump{jump}_b{event.joint}")])
        periods = size * lines / (2.0 * np.pi)
        whole = round(periods) if abs(periods) > 0.5 and abs(periods - round(periods)) < 0.1 else 0
        out.append(replace(event, size=size, periods=whole))
    return tuple(out)
