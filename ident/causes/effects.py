"""Effects that no model has, each tested beside a complete fit that its residual contradicts.

An effect moves the residual by known columns S of unknown sizes, the same in all recordings. About
the estimate of a fit with covariance C and Jacobian J the cost falls with them by

    h' W^-1 h,   h = S'r,   W = S'S - S'J C J'S,

whatever the other unknowns do meanwhile. Hysteresis: stop operators of each gear's load
(Prandtl-Ishlinskii model: Visintin 1994, ch. 3). Reversal: the way in which each gear turned last
(Dahl 1968), as of backlash that friction takes up. Drift: the zero of a gear in proportion to time;
its rival, without words, is the zero that is another one in each recording.
Sway: a base of the ball-bar that swings, at the frequency at which the residual has its peak.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.corrections.base import BAR, GEAR
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import Evaluation
from ballbar.ident.estimator.normal_equations import jacobian, products
from ballbar.ident.estimator.whitening import Whitening
from ballbar.ident.loads.gear_loads import stop

STOPS = (0.03, 0.15)  # of a gear's largest load: widths of its stop operators
TRAVEL = 3e-4  # [rad] over which friction builds up behind a reversal
CYCLES = 3.0  # of a sway in a recording, at least: with fewer it looks like a seat that moved
HIGHEST = 4.0  # [Hz] of a sway
_DEPENDENT = 1e-3  # of a column's power: what is left of one that other unknowns can stand for


@dataclass(frozen=True, eq=False)
class Effect:
    """One effect with what it would explain."""

    cause: str  # empty of a machine that changed between recordings, which others name
    remedy: str
    left: float  # share of the cost that it leaves


Columns = list[Array]  # (K, E, N) whitened, of each recording
Words = Callable[[Array], str]  # the cause by the sizes (K,) SI of the columns


def effects_beside(fit: Fit) -> list[Effect]:
    """The effects and what each leaves of the residual, the most decisive first."""
    blocks = [list(jacobian(fit.model, fit.linear, k)) for k in range(len(fit.model.recordings))]
    cost, out = sum(float((r * r).sum()) for _, _, r in fit.recorded), []
    for words, remedy, columns in _columns(fit):
        count = len(columns[0])
        shared = np.zeros((fit.model.unknowns.count, count))
        power, score = np.zeros((count, count)), np.zeros(count)
        for k, (own, (_, _, residual)) in enumerate(zip(columns, fit.recorded, strict=True)):
            flat = own.reshape(count, -1)
            power += flat @ flat.T
            score += flat @ residual.reshape(-1)
            shared += np.stack([products(fit.model, k, blocks[k], c) for c in own], axis=1)
        scale = np.sqrt(np.maximum(np.diag(power), np.finfo(float).tiny))
        rest = (power - shared.T @ fit.covariance @ shared) / np.outer(scale, scale)
        size = least_sizes(rest, score / scale)
        left = 1.0 + float(size @ (score / scale)) / cost
        out.append(Effect(words(size / scale), remedy, left))
    return sorted(out, key=lambda effect: effect.left)


def least_sizes(information: Array, score: Array) -> Array:
    """(K,) sizes that lower the cost most, 0 in directions that other unknowns can stand for.

    information : (K, K) W of columns of unit power. score : (K,) h. What is left of a column that
    is another unknown's is rounding, and whatever it seems to explain is none.
    """
    values, directions = np.linalg.eigh(information)
    own = directions[:, values > _DEPENDENT]
    return np.asarray(-own @ ((own.T @ score) / values[values > _DEPENDENT]))


def _columns(fit: Fit) -> Iterator[tuple[Words, str, Columns]]:
    """Words, remedy and columns of every effect."""
    points = [(point, weights) for point, weights, _ in fit.recorded]
    if fit.model.masses is not None:
        stops = [_of_gears(_stops(p), p, w) for p, w in points]
        remedy = "No model here has it: look for a worn reducer or bearing"
        yield partial(_hysteresis, "load"), remedy, stops
    turned = [_of_gears(_turned(p)[:, None], p, w) for p, w in points]
    remedy = "No model here has it: look for a loose key, coupling or belt"
    yield partial(_hysteresis, "motion"), remedy, turned
    remedy = "Look for a loose resolver or coupling, and let the robot warm up"
    for gear in range(len(fit.model.gearing.to_joint)):
        zero = [w(p.columns[gear : gear + 1]) for p, w in points]
        if len(points) > 1:
            yield (lambda _: ""), "", _in_each(zero)
        times = [p.recording.times for p, _ in points]
        own = [z * (t - t[0]) / np.ptp(t) for z, t in zip(zero, times, strict=True)]
        yield partial(_drift, gear + 1), remedy, _in_each(own)
    frequency, sway = _sway(fit)
    remedy = "Stand robot and ball-bar on one foundation, away from what shakes it"
    yield partial(_swing, frequency), remedy, sway


def _hysteresis(way: str, size: Array) -> str:
    each = np.abs(size).reshape(-1, len(STOPS) if way == "load" else 1).sum(axis=1)
    gear = int(each.argmax())
    return (
        f"hysteresis of the gears along their {way}, most in gear {gear + 1} "
        f"({1e6 * each[gear]:.0f} urad)"
    )


def _drift(gear: int, size: Array) -> str:
    return f"the zero of gear {gear} drifts by {1e6 * np.abs(size).max():.0f} urad"


def _swing(frequency: float, size: Array) -> str:
    swing = 1e6 * np.linalg.norm(size)
    return f"the base of the ball-bar sways at {frequency:.3g} Hz by {swing:.0f} um"


def _of_gears(signals: Array, point: Evaluation, weights: Whitening) -> Array:
    """(J S, E, N) columns of signals (J, S, N) [rad] of the gears."""
    gears = weights(point.columns[GEAR:BAR])
    return np.concatenate([c * s[:, None] for c, s in zip(gears, signals, strict=True)])


def _stops(point: Evaluation) -> Array:
    """(J, S, N) -1 to 1: stop operators of the gears' loads."""
    assert point.state is not None
    load = point.state.loads.gears(point.state.tension)
    largest = np.abs(load).max(axis=1)
    return np.stack([stop(load / (share * largest)[:, None]) for share in STOPS], axis=1)


def _turned(point: Evaluation) -> Array:
    """(J, N) -1 to 1: the way in which each gear turned last."""
    logged = point.samples.joint_angles(point.robot_time) @ point.gearing.to_gear
    return stop(logged.T / TRAVEL)


def _sway(fit: Fit) -> tuple[float, Columns]:
    """The frequency [Hz], and columns per metre of the base of the ball-bar along x, y, z."""
    longest = max(np.ptp(point.recording.times) for point, _, _ in fit.recorded)
    lowest, step = CYCLES / longest, 0.25 / longest
    most = int(np.sqrt(HIGHEST / step)) + 1
    power, bases = np.zeros((most, most)), []
    for point, weights, residual in fit.recorded:
        columns = np.zeros((3, 6, residual.shape[1]))
        columns[range(3), range(3)] = 1.0
        base = weights(columns)
        bases.append(base)
        score = (base * residual).sum(axis=1)  # (3, N)
        # every frequency is the lowest, a multiple of `most` steps, and up to so many steps
        turn = 2j * np.pi * step * point.recording.times
        fine = np.exp(turn * np.arange(most)[:, None])
        coarse = score[:, None] * np.exp(turn * (lowest / step + most * np.arange(most)[:, None]))
        power += (np.abs(coarse @ fine.T) ** 2).sum(axis=0)
    best = lowest + step * int(power.reshape(-1)[: -int((lowest - HIGHEST) // step)].argmax())
    own = []
    for base, (point, _, _) in zip(bases, fit.recorded, strict=True):
        angle = 2.0 * np.pi * best * point.recording.times
        own.append(np.concatenate([base * np.cos(angle), base * np.sin(angle)]))
    return float(best), _in_each(own)


def _in_each(own: Columns) -> Columns:
    """Columns (K, E, N) of each recording as ones that have a size of their own in each."""
    out = []
    for k, columns in enumerate(own):
        apart = np.zeros((len(own), *columns.shape))
        apart[k] = columns
        out.append(apart.reshape(-1, *columns.shape[1:]))
    return out
