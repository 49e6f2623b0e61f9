"""Effects that no model has, each tested beside a complete fit that its residual contradicts.

An effect moves the residual by known columns S of unknown sizes, the same in all recordings. About
the estimate of a fit with covariance C and Jacobian J the cost falls with them by

    h' W^-1 h,   h = S'r,   W = S'S - S'J C J'S,

whatever the other unknowns do meanwhile. Gravity: loads of the same masses under another direction.
A force at the tool, as of a hose or a cable. Hysteresis: stop operators of each gear's load
(Prandtl-Ishlinskii model: Visintin 1994, ch. 3). Reversal: the way in which each gear turned last
(Dahl 1968), as of backlash that friction takes up. Drift: the zero of a gear in proportion to time.
Sway: a base of the ball-bar that swings, at the frequency at which the residual has its peak.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from cell.arrays import Array
from cell.chain import cross
from cell.descriptions import Cell
from ident.corrections.base import BAR, GEAR
from ident.estimator.fit import Fit
from ident.estimator.model import Evaluation
from ident.estimator.normal_equations import jacobian
from ident.estimator.whitening import Whitening
from ident.loads.gear_loads import mass_model

STEP = 1e-3  # [rad] of the direction of gravity, for a difference
STOPS = (0.03, 0.15)  # of a gear's largest load: widths of its stop operators
TRAVEL = 3e-4  # [rad] over which friction builds up behind a reversal
CYCLES, HIGHEST = (
    3.0,
    4.0,
)  # of a sway: least in a recording, or it looks like a seat that moved; [Hz]
_DEPENDENT = 1e-3  # of a column's power: what is left of one that other unknowns can stand for


@dataclass(frozen=True, eq=False)
class Effect:
    """One effect with what it would explain."""

    cause: str
    remedy: str
    left: float  # share of the cost that it leaves


Columns = list[Array]  # (K, E, N) whitened, of each recording
REMEDIES = {
    "gravity": "Is the robot on a slope or a wall? Write gravity_m_per_s2 into its file",
    "force": "Take off the cable, hose or spring that holds the tool, and record again",
    "hysteresis": "No model here has it: look for a worn reducer or bearing",
    "reversal": "No model here has it: look for a loose key, coupling or belt",
    "sway": "Stand robot and ball-bar on one foundation, away from what shakes it",
    "drift": "Look for a loose resolver or coupling, and let the robot warm up",
}


GEARS = "123456789"  # names of the effect of each


def _cause(name: str, size: Array) -> str:
    """The words for an effect of sizes (K,) SI."""
    if name == "gravity":
        angle = np.rad2deg(np.linalg.norm(size))
        return f"gravity points {angle:.1f} degrees from where the robot's file says"
    if name == "force":
        return f"a force of {np.linalg.norm(size):.0f} N at the tool that no file states"
    if name in ("hysteresis", "reversal"):
        each = np.abs(size.reshape(len(STOPS) if name == "hysteresis" else 1, -1, order="F"))
        gear, urad = int(each.sum(axis=0).argmax()) + 1, 1e6 * each.sum(axis=0).max()
        way = "load" if name == "hysteresis" else "motion"
        return f"hysteresis of the gears along their {way}, most in gear {gear} ({urad:.0f} urad)"
    if name in GEARS:
        return (
            f"the zero of gear {name} drifts, by {1e6 * np.abs(size).max():.0f} urad in a recording"
        )
    swing = 1e6 * np.sqrt((size**2).sum())
    return f"the base of the ball-bar sways at {name} by {swing:.0f} um"


def effects_beside(cell: Cell, fit: Fit) -> list[Effect]:
    """The effects and what each leaves of the residual, the most decisive first."""
    blocks = [list(jacobian(fit.model, fit.linear, k)) for k in range(len(fit.model.recordings))]
    cost, out = sum(float((r * r).sum()) for _, _, r in fit.recorded), []
    for name, columns in _columns(cell, fit):
        count = len(columns[0])
        shared = np.zeros((fit.model.unknowns.count, count))
        power, score = np.zeros((count, count)), np.zeros(count)
        for k, (own, (_, _, residual)) in enumerate(zip(columns, fit.recorded, strict=True)):
            flat = own.reshape(count, -1)
            power += flat @ flat.T
            score += flat @ residual.reshape(-1)
            for block in blocks[k]:
                for c in range(count):
                    scores = block.scores(own[c][:, block.samples], fit.model, k)
                    shared[:, c] += scores.sum(axis=1)
        scale = np.sqrt(np.maximum(np.diag(power), np.finfo(float).tiny))
        rest = (power - shared.T @ fit.covariance @ shared) / np.outer(scale, scale)
        size = -np.linalg.pinv(rest, rcond=_DEPENDENT, hermitian=True) @ (score / scale)
        left = 1.0 + float(size @ (score / scale)) / cost
        remedy = REMEDIES.get(name, REMEDIES["drift" if name in GEARS else "sway"])
        out.append(Effect(_cause(name, size / scale), remedy, left))
    return sorted(out, key=lambda effect: effect.left)


def _columns(cell: Cell, fit: Fit) -> Iterator[tuple[str, Columns]]:
    points = [(point, weights) for point, weights, _ in fit.recorded]
    if fit.model.masses is not None:
        yield "gravity", _gravity(cell, fit)
        compliance = _compliance(fit)
        yield "force", [_force(cell, point, weights, compliance) for point, weights in points]
        stops = [_of_gears(_stops(p), p, w) for p, w in points]
        yield "hysteresis", stops
    turned = [_of_gears(_turned(p)[:, None], p, w) for p, w in points]
    yield "reversal", turned
    for gear in range(len(fit.model.gearing.to_joint)):
        yield (
            str(gear + 1),
            _in_each([w(p.columns[gear : gear + 1]) * _share_of_time(p) for p, w in points]),
        )
    yield _sway(fit)


def _of_gears(signals: Array, point: Evaluation, weights: Whitening) -> Array:
    """(J S, E, N) columns of signals (J, S, N) [rad] of the gears."""
    gears = weights(point.columns[GEAR:BAR])
    return np.concatenate([c * s[:, None] for c, s in zip(gears, signals, strict=True)])


def _gravity(cell: Cell, fit: Fit) -> Columns:
    """Columns per radian by which gravity leans about x and y of the robot's base."""
    out = []
    for k, (point, weights, _) in enumerate(fit.recorded):
        own = []
        for axis in np.eye(3)[:2]:
            turned = Rotation.from_rotvec(STEP * axis).apply(np.array(cell.robot.gravity))
            leaning = replace(cell, robot=replace(cell.robot, gravity=turned))
            other = replace(fit.model, masses=mass_model(leaning))
            moved = other.evaluate(fit.x, k, point.ballbar, replace(point, loads_at=None))
            own.append(weights(moved.closure.error - point.closure.error) / STEP)
        out.append(np.stack(own))
    return out


def _compliance(fit: Fit) -> Array:
    """(J,) [rad/(N m)] of the gears, as identified; 0 where it is none of the unknowns."""
    values = dict(zip(fit.model.unknowns.names, fit.x.tolist(), strict=True))
    joints = len(fit.model.gearing.to_joint)
    return np.array([
        values.get(f"compliance{i}", values.get(f"typical_compliance{i}", 0.0))
        for i in range(1, joints + 1)
    ])  # fmt: skip


def _force(cell: Cell, point: Evaluation, weights: Whitening, compliance: Array) -> Array:
    """Columns per newton along x, y, z at the tool."""
    frames = point.bar_closure.robot
    joints, tip = len(compliance), frames.tip
    forces = [axis[:, None] + np.zeros_like(tip) for axis in np.eye(3)]
    torque = np.array([
        [(frames.z[j] * cross(tip - frames.origin[j], force)).sum(axis=0) for force in forces]
        for j in range(joints)
    ])  # fmt: skip
    gears = np.einsum("gj,jsn->gsn", cell.robot.gear_to_joint, torque)
    columns = _of_gears(compliance[:, None, None] * gears, point, weights)
    return np.asarray(columns.reshape(joints, 3, *columns.shape[1:]).sum(axis=0))


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


def stop(x: Array) -> Array:
    """(J, N) what is left of signals (J, N) within a band of -1 to 1 that they drag along."""
    state, out = np.zeros(len(x)), np.zeros_like(x)
    for k, step in enumerate(np.diff(x, axis=1, prepend=x[:, :1]).T):
        state = np.clip(state + step, -1.0, 1.0)
        out[:, k] = state
    return out


def _sway(fit: Fit) -> tuple[str, Columns]:
    """The frequency, and columns per metre of the base of the ball-bar along x, y, z."""
    longest = max(np.ptp(point.recording.times) for point, _, _ in fit.recorded)
    frequencies = np.arange(CYCLES / longest, HIGHEST, 0.25 / longest)
    power, bases = np.zeros(frequencies.size), []
    for point, weights, residual in fit.recorded:
        columns = np.zeros((3, 6, residual.shape[1]))
        columns[range(3), range(3)] = 1.0
        base = weights(columns)
        bases.append(base)
        score = (base * residual).sum(axis=1)  # (3, N)
        turn = np.exp(2j * np.pi * frequencies[:, None] * point.recording.times)
        power += (np.abs(score @ turn.T) ** 2).sum(axis=0)
    best = frequencies[int(power.argmax())]
    own = []
    for base, (point, _, _) in zip(bases, fit.recorded, strict=True):
        angle = 2.0 * np.pi * best * point.recording.times
        own.append(np.concatenate([base * np.cos(angle), base * np.sin(angle)]))
    return f"{best:.3g} Hz", _in_each(own)


def _share_of_time(point: Evaluation) -> Array:
    """(N,) 0 to 1 along a recording."""
    t = point.recording.times
    return np.asarray((t - t[0]) / (t[-1] - t[0]))


def _in_each(own: Columns) -> Columns:
    """Columns (K, E, N) of each recording as ones that have a size of their own in each."""
    out = []
    for k, columns in enumerate(own):
        apart = np.zeros((len(own), *columns.shape))
        apart[k] = columns
        out.append(apart.reshape(-1, *columns.shape[1:]))
    return out
