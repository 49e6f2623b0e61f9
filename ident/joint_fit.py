"""One machine from several recordings: geometry, corrections, clocks and, where nothing measures it, the force in the rod.

Signed, whitened loop closure (ident.closure) of every recording, normal equations added up, priors of physical size,
Gauss-Newton with backtracking on the posterior. Corrections displace gears, ball-bar joints, rod and plate; each
coefficient's column is its carrier's own column times the signal it multiplies. Loads are frozen within an iteration but for
their dependence on the tension of the rod, without which the steps oscillate (identification_facts sec. 6, trap 8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cell.chain import Array, cross
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, PARAMETERS, Geometry
from ident.closure import (
    Closure,
    Whitening,
    bar_joint_jacobian,
    close_loop,
    parameter_jacobian,
    robot_joint_jacobian,
    rod_jacobian,
    whitening,
)
from ident.corrections.base import BAR, CARRIERS, GEAR, PLATE, ROD, Correction, State, play_width
from ident.event import Event
from ident.loads import Loads, MassModel, loads
from ident.problem import Clock
from ident.signals import SmoothLog
from ident.unknowns import Unknowns

FLOOR = 1e-7  # [m, rad]
MAX_ITERATIONS = 40
FREEZE_AFTER = 6  # iterations with new weights; then they stay, or loads near a reversal could change them for ever
FREE_JOINT_STEPS = 2
LINEAR_STEP = 1e-4  # [rad] of a free joint: a smaller one moves the tool by less than 1e-8 of its lever beyond its column


@dataclass(frozen=True, eq=False)
class Track:
    """One recording at its samples."""

    robot: SmoothLog
    bar: SmoothLog | None
    joints: tuple[int, ...]
    signs: Array  # (E,)
    times: Array  # (N,) [s] on the ball-bar's clock (the robot's without encoders)
    knots: Array  # (K, N) tension splines at the samples; K = 0 where no correction needs loads
    tension: Array  # (N,) [N] measured; 0 where nothing did
    gear_noise: Array  # (6, N) or (6, 1) [rad] of the logged angles
    bar_noise: Array  # (5,) [rad]; 0 where no encoder is fitted
    clock_steps: tuple[float, ...] = ()  # [s] on the ball-bar's clock, where one of the clocks jumped

    @property
    def free(self) -> list[int]:
        return [j for j in range(BAR_ROWS) if j + 1 not in self.joints]


@dataclass(frozen=True)
class Excess:
    """Noise beyond what the logs show row by row: standard deviations estimated from the residual."""

    gear: float = 0.0  # [rad] of axes 1-3
    wrist: float = 0.0  # [rad] of axes 4-6
    bar: float = 0.0  # [rad] each ball-bar encoder: sub-divisional error
    rod: float = 0.0  # [m]


@dataclass(frozen=True, eq=False)
class Model:
    """What is fitted."""

    cell: Cell
    masses: MassModel | None  # None where no correction needs loads
    corrections: tuple[Correction, ...]
    unknowns: Unknowns
    tracks: tuple[Track, ...]
    sharpness: float = 1.0


@dataclass(frozen=True, eq=False)
class Point:
    """Everything at one value of the unknowns for one recording."""

    closure: Closure
    bar: Array  # (N, 5) [rad] as read, free joints as found
    state: State | None
    signals: tuple[tuple[Array, ...], ...]  # (N,) each, of every correction
    clock: Clock
    speed: Array  # (6, N) [rad/s] of the gears
    gear_to_joint: Array

    @cached_property
    def columns(self) -> Array:
        """(CARRIERS, 6, N) change of the mismatch for a unit of each carrier."""
        columns = np.empty((CARRIERS, *self.closure.error.shape))
        np.einsum("gj,jcn->gcn", self.gear_to_joint, robot_joint_jacobian(self.closure), out=columns[GEAR:BAR])
        columns[BAR:ROD] = bar_joint_jacobian(self.closure)
        columns[ROD], columns[PLATE] = rod_jacobian(self.closure), plate_jacobian(self.closure)
        return columns


def plate_jacobian(closure: Closure) -> Array:
    """(6, N) derivative of the mismatch with respect to the bending of the plate."""
    robot = closure.robot
    arm = 2.0 / 3.0 * closure.geometry["ra6"] * robot.x[-1]
    return -np.concatenate((cross(robot.y[-1], arm), robot.y[-1]))


def make_point(model: Model, x: Array, k: int, bar: Array, near: Point | None = None) -> Point:
    """Mismatch of recording k at x with ball-bar angles `bar` (N, 5); near : a point whose loads and ripple may stand in."""
    track, layout, robot = model.tracks[k], model.unknowns, model.cell.robot
    geometry, clock = layout.geometry(x, k), layout.clock(x, k)
    at = np.clip(robot_times(model, x, k), track.robot.start, track.robot.end)
    q, speed = np.asarray(track.robot.spline(at)), np.asarray(track.robot.speed(at))
    same = near is not None and near.clock.alike(clock) and layout.own[k].steps is None
    state: State | None = None
    signals: tuple[tuple[Array, ...], ...] = ()
    moved = np.zeros((CARRIERS, track.times.size))
    if model.corrections:
        if same and near is not None and near.state is not None:
            state = replace(near.state, bar=bar.T + geometry.bar.theta[:, None], tension=tension_at(model, x, k))
            signals = tuple(
                old if c.slopes is None else tuple(c.signals(state)) for c, old in zip(model.corrections, near.signals, strict=True)
            )
        else:
            state = _state(model, x, k, geometry, q, speed, at, bar)
            signals = tuple(tuple(c.signals(state)) for c in model.corrections)
        _displace(moved, model, x, signals)
    closure = close_loop(geometry, q + moved[GEAR:BAR].T @ robot.gear_to_joint, bar + moved[BAR:ROD].T)
    if model.corrections:
        closure = replace(closure, error=closure.error + rod_jacobian(closure) * moved[ROD] + plate_jacobian(closure) * moved[PLATE])
    return Point(closure, bar, state, signals, clock, (speed @ robot.joint_to_gear).T, robot.gear_to_joint)


def robot_times(model: Model, x: Array, k: int) -> Array:
    """(N,) [s] on the robot's clock of the samples of recording k; each clock step shifts what follows it."""
    track, layout = model.tracks[k], model.unknowns
    out = layout.clock(x, k).robot_time(track.times)
    steps = layout.own[k].steps
    return out if steps is None else out + x[steps] @ after(track)


def after(track: Track) -> Array:
    """(S, N) 1 from each clock step on, 0 before."""
    return (track.times >= np.array(track.clock_steps)[:, None]).astype(float)


def _state(model: Model, x: Array, k: int, geometry: Geometry, q: Array, speed: Array, at: Array, bar: Array) -> State:
    track = model.tracks[k]
    gears = (q @ model.cell.robot.joint_to_gear).T
    if model.masses is None:
        zero = np.zeros((6, q.shape[0]))
        nothing = Loads(zero, zero, zero[0], zero[0])
        return State(track.times, k, gears, bar.T + geometry.bar.theta[:, None], nothing, zero[0], play_width(model.cell), model.sharpness)
    acceleration = np.asarray(track.robot.spline(at, 2))
    carried = loads(model.masses, geometry, q, bar, speed, acceleration)
    return State(
        track.times,
        k,
        gears,
        bar.T + geometry.bar.theta[:, None],
        carried,
        tension_at(model, x, k),
        play_width(model.cell),
        model.sharpness,
    )


def tension_at(model: Model, x: Array, k: int) -> Array:
    """(N,) [N] of the rod at the samples of recording k: what was measured times its gain, and a spline on top."""
    track, layout = model.tracks[k], model.unknowns
    knots = layout.own[k].knots
    gain = 0.0 if layout.gain is None else x[layout.gain]
    out = (1.0 + gain) * track.tension
    return np.asarray(out if knots is None else out + x[knots] @ track.knots)


def _displace(moved: Array, model: Model, x: Array, signals: tuple[tuple[Array, ...], ...]) -> None:
    """Adds coefficients times signals to the carriers (CARRIERS, N)."""
    values = iter(x[model.unknowns.coefficients])
    for correction, given in zip(model.corrections, signals, strict=True):
        for coefficient, signal in zip(correction.coefficients, given, strict=True):
            moved[coefficient.carrier] += next(values) * signal


def covariances(track: Track, columns: Array, excess: Excess, uncertain: Array | float) -> Array:
    """(6, 6, N) covariance of the mismatch; uncertain : (6, N) [rad] of the gears where play changes sides."""
    gears = np.sqrt(track.gear_noise**2 + np.repeat([excess.gear, excess.wrist], 3)[:, None] ** 2 + np.square(uncertain))
    fitted = np.array([j + 1 in track.joints for j in range(BAR_ROWS)])
    bars = np.where(fitted, np.hypot(track.bar_noise, excess.bar), 0.0)
    spread = np.concatenate(
        (columns[GEAR:BAR] * gears[:, None, :], columns[BAR:ROD] * bars[:, None, None], columns[ROD:PLATE] * excess.rod)
    )
    rows = spread.transpose(2, 1, 0)
    out: Array = (rows @ rows.transpose(0, 2, 1)).transpose(1, 2, 0).copy()
    for i in range(6):
        out[i, i] += FLOOR**2
    return out


def weigh(model: Model, point: Point, k: int, excess: Excess, x: Array) -> Whitening:
    """Frozen weights of recording k."""
    track = model.tracks[k]
    spread = covariances(track, point.columns, excess, play_uncertainty(model, x, point))
    return whitening(spread, point.columns[BAR:ROD][track.free])


def play_uncertainty(model: Model, x: Array, point: Point) -> Array | float:
    """(6, N) [rad] how little is known of where a gear lies in its play: all of it near a reversal of the load."""
    names = [c.name for correction in model.corrections for c in correction.coefficients]
    if point.state is None or "play1" not in names:
        return 0.0
    first = model.unknowns.coefficients.start + names.index("play1")
    half = np.abs(x[first : first + 6])[:, None]
    return np.asarray(half * (1.0 - point.state.load_sign() ** 2))


def settle(model: Model, x: Array, k: int, bar: Array, excess: Excess, frozen: Whitening | None) -> tuple[Point, Whitening]:
    """The point of recording k with its joints without encoder where they absorb most of the mismatch."""
    track = model.tracks[k]
    point = make_point(model, x, k, bar)
    weights = frozen or weigh(model, point, k, excess, x)
    for _ in range(FREE_JOINT_STEPS if track.free else 0):
        step = np.clip(weights.free_step(point.closure.error), -0.5, 0.5)
        bar = bar.copy()
        bar[:, track.free] += step.T
        if np.abs(step).max() < LINEAR_STEP:
            error = point.closure.error + np.einsum("jcn,jn->cn", point.columns[BAR:ROD][track.free], step)
            return replace(point, bar=bar, closure=replace(point.closure, error=error)), weights
        point = make_point(model, x, k, bar, point)
        weights = frozen or weigh(model, point, k, excess, x)
    return point, weights


def jacobian(model: Model, x: Array, k: int, point: Point, weights: Whitening) -> tuple[NDArray[np.intp], Array, Array | None]:
    """Indices (p,) into the unknowns and their whitened columns (p, E, N), the knots of the tension left out; and the column
    (E, N) of the tension itself, None where it is not in the model."""
    layout, track = model.unknowns, model.tracks[k]
    n = track.times.size
    places = list(range(layout.own[k].place.start, layout.own[k].place.stop))
    zeros = list(range(layout.own[k].zeros.start, layout.own[k].zeros.stop))
    chosen = [*layout.shared, *layout.zero_parameters[k], *_PLACE_INDEX]
    index = [*range(layout.shared.size), *zeros, *places]
    geometric = weights(parameter_jacobian(point.closure, [PARAMETERS[i] for i in chosen]))
    parts, slope = [geometric], None
    carriers = weights(point.columns)
    if point.state is not None:
        columns = np.empty((layout.coefficients.stop - layout.coefficients.start, *carriers.shape[1:]))
        carried = [c.carrier for correction in model.corrections for c in correction.coefficients]
        for i, signal in enumerate(s for given in point.signals for s in given):
            np.multiply(carriers[carried[i]], signal, out=columns[i])
        parts.append(columns)
        index += list(range(layout.coefficients.start, layout.coefficients.stop))
        if layout.gain is not None or layout.own[k].knots is not None:
            slope = _tension_column(model, x, point, carriers)
        if layout.gain is not None and slope is not None:
            parts.append((slope * track.tension)[None])
            index.append(layout.gain)
    clock = layout.own[k].clock
    if clock is not None:
        shift = np.einsum("gen,gn->en", carriers[GEAR:BAR], point.speed)
        parts.append(np.stack((shift, shift * track.times)))
        index += [clock.start, clock.start + 1]
        steps = layout.own[k].steps
        if steps is not None:
            parts.append(shift * after(track)[:, None, :])
            index += list(range(steps.start, steps.stop))
    return np.array(index, dtype=np.intp), np.concatenate(parts).reshape(len(index), -1, n), slope


def _tension_column(model: Model, x: Array, point: Point, carriers: Array) -> Array:
    """(E, N) whitened change of the mismatch per newton of rod tension."""
    assert point.state is not None
    moved = np.zeros((CARRIERS, point.bar.shape[0]))
    values = x[model.unknowns.coefficients]
    i = 0
    for correction in model.corrections:
        slopes = correction.slopes(point.state) if correction.slopes else None
        for j, coefficient in enumerate(correction.coefficients):
            if slopes is not None:
                moved[coefficient.carrier] += values[i] * slopes[j]
            i += 1
    used = np.flatnonzero(np.abs(moved).max(axis=1) > 0.0)
    return np.asarray(np.einsum("cen,cn->en", carriers[used], moved[used]))


_PLACE_INDEX = [i for i, p in enumerate(PARAMETERS) if p.side == "base"]


@dataclass(frozen=True, eq=False)
class Linear:
    """Normal equations at one value of the unknowns, and what they were made of."""

    points: tuple[Point, ...]
    weights: tuple[Whitening, ...]
    residuals: tuple[Array, ...]  # (E, N) each, whitened
    normal: Array  # (P, P) with the prior
    gradient: Array  # (P,)
    cost: float  # with the prior


def linearise(model: Model, x: Array, bars: Sequence[Array], excess: Excess, frozen: Sequence[Whitening] = ()) -> Linear:
    """Normal equations of all recordings and the prior; frozen : weights of each recording to be kept."""
    layout = model.unknowns
    normal = np.diag(layout.sigma**-2.0)
    gradient = (x - layout.mean) / layout.sigma**2
    cost = float(gradient @ (x - layout.mean))
    points, weights, residuals = [], [], []
    for k in range(len(model.tracks)):
        point, weight = settle(model, x, k, bars[k], excess, frozen[k] if frozen else None)
        residual = weight(point.closure.error)
        index, columns, slope = jacobian(model, x, k, point, weight)
        flat = columns.reshape(index.size, -1)
        normal[np.ix_(index, index)] += flat @ flat.T
        gradient[index] += flat @ residual.reshape(-1)
        cost += float((residual * residual).sum())
        if slope is not None and (knots := layout.own[k].knots) is not None:
            _add_knots(model.tracks[k].knots, knots, index, columns, slope, residual, normal, gradient)
        points.append(point)
        weights.append(weight)
        residuals.append(residual)
    return Linear(tuple(points), tuple(weights), tuple(residuals), normal, gradient, cost)


def cost_at(model: Model, x: Array, linear: Linear) -> float:
    """Posterior cost at x under frozen weights."""
    layout = model.unknowns
    cost = float((((x - layout.mean) / layout.sigma) ** 2).sum())
    for k, (point, weight) in enumerate(zip(linear.points, linear.weights, strict=True)):
        residual = weight(make_point(model, x, k, point.bar, point).closure.error)
        cost += float((residual * residual).sum())
    return cost


def _add_knots(
    splines: Array, knots: slice, index: NDArray[np.intp], columns: Array, slope: Array, residual: Array, normal: Array, gradient: Array
) -> None:
    """Adds the knots of one recording to the normal equations: each column is `slope` times a spline, so none is formed."""
    mixed = splines @ np.einsum("pen,en->pn", columns, slope).T
    normal[knots, index] += mixed
    normal[index, knots] += mixed.T
    normal[knots, knots] += (splines * (slope * slope).sum(axis=0)) @ splines.T
    gradient[knots] += splines @ (slope * residual).sum(axis=0)


@dataclass(frozen=True, eq=False)
class JointFit:
    """The outcome."""

    model: Model
    x: Array  # (P,)
    linear: Linear
    covariance: Array  # (P, P) as if the residual were white
    excess: Excess
    iterations: int
    converged: bool
    events: tuple[Event, ...] = ()

    @property
    def degrees(self) -> int:
        """Equations less what the data determined."""
        data = sum(r.size for r in self.linear.residuals)
        prior = np.diag(self.covariance) / self.model.unknowns.sigma**2
        return int(data - (self.model.unknowns.count - prior.sum()))

    @property
    def chi2_per_dof(self) -> float:
        return float(sum((r * r).sum() for r in self.linear.residuals) / self.degrees)


def minimise(
    model: Model, x: Array, bars: Sequence[Array], excess: Excess, *, negligible: float = 1e-2, max_iterations: int = MAX_ITERATIONS
) -> JointFit:
    """Gauss-Newton from x with backtracking.

    negligible : predicted decrease of the cost, in units of the cost per degree of freedom, that ends the search.
    """
    now = linearise(model, x, bars, excess)
    iterations, converged = 0, False
    while True:
        step = newton_step(now.normal, now.gradient, model.unknowns.sigma)
        decrease = -float(now.gradient @ step)
        equations = sum(r.size for r in now.residuals)
        converged = decrease < negligible * max(1.0, now.cost / equations)
        if converged or iterations == max_iterations:
            break
        iterations += 1
        share = 1.0
        while (trial := cost_at(model, x + share * step, now)) >= now.cost and share > 1e-4:
            share *= 0.5
        if trial >= now.cost:
            break
        x = x + share * step
        settled = now.cost - trial < negligible * max(1.0, now.cost / equations)
        now = linearise(model, x, [p.bar for p in now.points], excess, now.weights if iterations >= FREEZE_AFTER else ())
        if settled:
            converged = True
            break
    scaled = now.normal * np.outer(model.unknowns.sigma, model.unknowns.sigma)
    covariance = cho_solve(cho_factor(scaled), np.eye(x.size)) * np.outer(model.unknowns.sigma, model.unknowns.sigma)
    return JointFit(model, x, now, covariance, excess, iterations, converged)


def newton_step(normal: Array, gradient: Array, sigma: Array) -> Array:
    """Step of the normal equations, scaled by the priors."""
    scaled = normal * np.outer(sigma, sigma)
    return np.asarray(-sigma * cho_solve(cho_factor(scaled), sigma * gradient))
