"""One machine from several recordings: geometry, corrections, clocks and, where nothing measures it, the force in the rod.

Signed, whitened loop closure (ident.estimator.closure) of every recording, normal equations added up, priors of physical size,
Gauss-Newton with backtracking on the posterior. Corrections displace gears, ball-bar joints, rod and plate; each
coefficient's column is its carrier's own column times the signal it multiplies. Loads are frozen within an iteration but for
their dependence on the tension of the rod, without which the steps oscillate (notes/identification sec. 6, trap 8).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dsyrk
from scipy.sparse import csr_array

from cell.chain import Array, cross
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, PARAMETERS, Geometry
from ident.corrections.base import (
    BAR,
    CARRIERS,
    GEAR,
    PLATE,
    ROD,
    Correction,
    State,
    backlash_transition,
)
from ident.estimator.closure import (
    Closure,
    Whitening,
    bar_joint_jacobian,
    close_loop,
    robot_joint_jacobian,
    rod_jacobian,
    whitening,
)
from ident.estimator.iteration import Iteration, IterationCallback
from ident.estimator.problem import Clock
from ident.estimator.unknowns import Unknowns
from ident.loads.gear_loads import MassModel, loads, no_loads
from ident.signals.smooth_log import SmoothLog, smoothing
from ident.signals.step_fault import StepFault

FLOOR = 1e-7  # [m, rad]
MAX_ITERATIONS = 40
FREEZE_AFTER = 6  # iterations with new weights; then they stay, or loads near a reversal could change them for ever
LOADS_HOLD = (
    1e-5,
    2e-4,
)  # [m, rad] of the geometry, [s] of the clock: what moves the loads by less than a thousandth of a percent
COARSE_SAMPLES, COARSE_SHARE = (
    1500,
    3,
)  # a fit of so many of each recording comes first, where there are so many times more
BLOCK_SAMPLES = 1500
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
    knots: csr_array  # (K, N) tension splines at the samples; K = 0 where no correction needs loads
    tension: Array  # (N,) [N] measured; 0 where nothing did
    gear_noise: Array  # (6, N) or (6, 1) [rad] of the logged angles
    bar_noise: Array  # (5,) [rad]; 0 where no encoder is fitted
    clock_steps: tuple[
        float, ...
    ] = ()  # [s] on the ball-bar's clock, where one of the clocks jumped

    def thinned(self, step: int) -> Track:
        """Every `step`-th sample."""
        knots, noise = self.knots[:, ::step], self.gear_noise[:, ::step]
        return replace(
            self,
            times=self.times[::step],
            knots=knots,
            tension=self.tension[::step],
            gear_noise=noise,
        )

    @property
    def smoothing(self) -> float:
        """[s] over which the logs were smoothed."""
        return smoothing(self.robot, self.bar)

    @property
    def free(self) -> list[int]:
        return [j for j in range(BAR_ROWS) if j + 1 not in self.joints]


@dataclass(frozen=True)
class ExcessNoise:
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
    loads_from: tuple[Geometry, Clock]  # where the loads of the state were computed, if not here
    signals_from: Clock  # likewise signals that no load enters
    speed: Array  # (6, N) [rad/s] of the gears
    gear_to_joint: Array

    @cached_property
    def columns(self) -> Array:
        """(CARRIERS, 6, N) change of the mismatch for a unit of each carrier."""
        columns = np.empty((CARRIERS, *self.closure.error.shape))
        np.einsum(
            "gj,jcn->gcn",
            self.gear_to_joint,
            robot_joint_jacobian(self.closure),
            out=columns[GEAR:BAR],
        )
        columns[BAR:ROD] = bar_joint_jacobian(self.closure)
        columns[ROD], columns[PLATE] = rod_jacobian(self.closure), plate_jacobian(self.closure)
        return columns


def plate_jacobian(closure: Closure) -> Array:
    """(6, N) derivative of the mismatch with respect to the bending of the plate."""
    robot = closure.robot
    arm = 2.0 / 3.0 * closure.geometry["ra6"] * robot.x[-1]
    return -np.concatenate((cross(robot.y[-1], arm), robot.y[-1]))


def make_point(
    model: Model,
    x: Array,
    k: int,
    bar: Array,
    near: Point | None = None,
    *,
    same_loads: bool = False,
) -> Point:
    """Mismatch of recording k at x with ball-bar angles `bar` (N, 5).

    near : a point whose ripple and loads stand in where that makes no difference; same_loads : the loads anyway, while
    the clock is alike.
    """
    track, layout, robot = model.tracks[k], model.unknowns, model.cell.robot
    geometry, clock = layout.geometry(x, k), layout.clock(x, k)
    at = np.clip(robot_times(model, x, k), track.robot.start, track.robot.end)
    q, speed = np.asarray(track.robot.spline(at)), np.asarray(track.robot.speed(at))
    state: State | None = None
    signals: tuple[tuple[Array, ...], ...] = ()
    moved = np.zeros((CARRIERS, track.times.size))
    loads_from, signals_from = (geometry, clock), clock
    if model.corrections:
        alike = near is not None and near.signals_from.alike(clock) and layout.own[k].steps is None
        if (
            near is not None
            and near.state is not None
            and ((alike and same_loads) or _holds(near, geometry, clock, at))
        ):
            carried, loads_from = near.state.loads, near.loads_from
        elif model.masses is None:
            carried = no_loads(q.shape[0])
        else:
            arm = track.robot.arm
            carried = loads(
                model.masses, geometry, q, bar, np.asarray(arm(at, 1)), np.asarray(arm(at, 2))
            )
        gears, turned = (q @ robot.joint_to_gear).T, bar.T + geometry.bar.theta[:, None]
        state = State(
            track.times,
            k,
            gears,
            turned,
            carried,
            tension_at(model, x, k),
            backlash_transition(model.cell),
            model.sharpness,
        )
        known: tuple[tuple[Array, ...], ...] = ((),) * len(model.corrections)
        if near is not None and alike:
            known, signals_from = near.signals, near.signals_from
        signals = tuple(
            old if old and c.slopes is None else tuple(c.signals(state))
            for c, old in zip(model.corrections, known, strict=True)
        )
        _displace(moved, model, x, signals)
    closure = close_loop(
        geometry, q + moved[GEAR:BAR].T @ robot.gear_to_joint, bar + moved[BAR:ROD].T
    )
    if model.corrections:
        closure = replace(
            closure,
            error=closure.error
            + rod_jacobian(closure) * moved[ROD]
            + plate_jacobian(closure) * moved[PLATE],
        )
    return Point(
        closure,
        bar,
        state,
        signals,
        clock,
        loads_from,
        signals_from,
        (speed @ robot.joint_to_gear).T,
        robot.gear_to_joint,
    )


def robot_times(model: Model, x: Array, k: int) -> Array:
    """(N,) [s] on the robot's clock of the samples of recording k; each clock step shifts what follows it."""
    track, layout = model.tracks[k], model.unknowns
    out = layout.clock(x, k).robot_time(track.times)
    steps = layout.own[k].steps
    return out if steps is None else out + x[steps] @ after(track)


def after(track: Track) -> Array:
    """(S, N) 1 from each clock step on, 0 before."""
    return (track.times >= np.array(track.clock_steps)[:, None]).astype(float)


def _holds(near: Point, geometry: Geometry, clock: Clock, at: Array) -> bool:
    """Whether the loads of a point are as good at another geometry and clock."""
    (length, time), (there, then) = LOADS_HOLD, near.loads_from
    moved = np.abs(geometry.values - there.values).max()
    return bool(
        moved < length
        and abs(clock.offset - then.offset) + abs(clock.skew - then.skew) * np.ptp(at) < time
    )


def tension_at(model: Model, x: Array, k: int) -> Array:
    """(N,) [N] of the rod at the samples of recording k: what was measured times its gain, and a spline on top."""
    track, layout = model.tracks[k], model.unknowns
    knots = layout.own[k].knots
    gain = 0.0 if layout.gain is None else x[layout.gain]
    out = (1.0 + gain) * track.tension
    return np.asarray(out if knots is None else out + track.knots.T @ x[knots])


def _displace(moved: Array, model: Model, x: Array, signals: tuple[tuple[Array, ...], ...]) -> None:
    """Adds coefficients times signals to the carriers (CARRIERS, N)."""
    values = iter(x[model.unknowns.coefficients])
    for correction, given in zip(model.corrections, signals, strict=True):
        for coefficient, signal in zip(correction.coefficients, given, strict=True):
            moved[coefficient.carrier] += next(values) * signal


def covariances(
    track: Track, columns: Array, excess: ExcessNoise, uncertain: Array | float
) -> Array:
    """(6, 6, N) covariance of the mismatch; uncertain : (6, N) [rad] of the gears where play changes sides."""
    gears = np.sqrt(
        track.gear_noise**2
        + np.repeat([excess.gear, excess.wrist], 3)[:, None] ** 2
        + np.square(uncertain)
    )
    fitted = np.array([j + 1 in track.joints for j in range(BAR_ROWS)])
    bars = np.where(fitted, np.hypot(track.bar_noise, excess.bar), 0.0)
    spread = np.concatenate(
        (
            columns[GEAR:BAR] * gears[:, None, :],
            columns[BAR:ROD] * bars[:, None, None],
            columns[ROD:PLATE] * excess.rod,
        )
    )
    out = np.asarray(np.einsum("kin,kjn->ijn", spread, spread))
    for i in range(6):
        out[i, i] += FLOOR**2
    return out


def weigh(model: Model, point: Point, k: int, excess: ExcessNoise, x: Array) -> Whitening:
    """Frozen weights of recording k."""
    track = model.tracks[k]
    spread = covariances(track, point.columns, excess, backlash_uncertainty(model, x, point))
    return whitening(spread, point.columns[BAR:ROD][track.free])


def backlash_uncertainty(model: Model, x: Array, point: Point) -> Array | float:
    """(6, N) [rad] how little is known of where a gear lies in its play: all of it near a reversal of the load."""
    names = [c.name for correction in model.corrections for c in correction.coefficients]
    if point.state is None or "backlash1" not in names:
        return 0.0
    first = model.unknowns.coefficients.start + names.index("backlash1")
    half = np.abs(x[first : first + 6])[:, None]
    return np.asarray(half * (1.0 - point.state.load_sign() ** 2))


def settle(
    model: Model,
    x: Array,
    k: int,
    bar: Array,
    excess: ExcessNoise,
    frozen: Whitening | None,
    near: Point | None,
) -> tuple[Point, Whitening]:
    """The point of recording k with its joints without encoder where they absorb most of the mismatch."""
    track = model.tracks[k]
    point = make_point(model, x, k, bar, near)
    weights = frozen or weigh(model, point, k, excess, x)
    for _ in range(FREE_JOINT_STEPS if track.free else 0):
        step = np.clip(weights.free_step(point.closure.error), -0.5, 0.5)
        bar = bar.copy()
        bar[:, track.free] += step.T
        if np.abs(step).max() < LINEAR_STEP:
            error = point.closure.error + np.einsum(
                "jcn,jn->cn", point.columns[BAR:ROD][track.free], step
            )
            return replace(point, bar=bar, closure=replace(point.closure, error=error)), weights
        point = make_point(model, x, k, bar, point, same_loads=True)
        weights = frozen or weigh(model, point, k, excess, x)
    return point, weights


@dataclass(frozen=True, eq=False)
class Columns:
    """Whitened derivatives at some samples of one recording, the knots of the tension left out."""

    samples: slice
    index: NDArray[np.intp]  # (p,) into the unknowns
    values: Array  # (p, E, n)
    slope: Array | None  # (E, n) per newton of tension; None where it is not in the model

    def against(self, vector: Array, model: Model, k: int) -> Array:
        """(P, n) every unknown's column times a whitened vector (E, n), sample by sample, the knots included."""
        out, knots = np.zeros((model.unknowns.count, vector.shape[1])), model.unknowns.own[k].knots
        out[self.index] = (self.values * vector).sum(axis=1)
        if self.slope is not None and knots is not None:
            out[knots] = (
                model.tracks[k].knots[:, self.samples] * (self.slope * vector).sum(axis=0)
            ).toarray()
        return out


def jacobian(model: Model, x: Array, k: int, point: Point, weights: Whitening) -> Iterator[Columns]:
    """The derivatives of recording k, block after block from the end: all at once they would be the largest thing in memory."""
    layout, track, own = model.unknowns, model.tracks[k], model.unknowns.own[k]
    chosen = [PARAMETERS[i] for i in (*layout.shared, *layout.zero_parameters[k], *_PLACE_INDEX)]
    parts = [slice(0, layout.shared.size), own.zeros, own.place, layout.coefficients]
    parts += [slice(layout.gain, layout.gain + 1)] if layout.gain is not None else []
    parts += [
        part
        for part in (own.clock, own.steps if own.clock is not None else None)
        if part is not None
    ]
    index = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    carriers = weights(point.columns)
    carried = [c.carrier for correction in model.corrections for c in correction.coefficients]
    signals = [signal for given in point.signals for signal in given]
    loaded = point.state is not None and (layout.gain is not None or own.knots is not None)
    slope = _tension_column(model, x, point, carriers) if loaded else None
    shift = np.einsum("gen,gn->en", carriers[GEAR:BAR], point.speed)
    for first in reversed(range(0, track.times.size, BLOCK_SAMPLES)):
        some = slice(first, first + BLOCK_SAMPLES)
        values = np.empty((index.size, carriers.shape[1], carriers[..., some].shape[2]))
        weights.part(some).jacobian(point.closure.part(some), chosen, values[: len(chosen)])
        rest = iter(values[len(chosen) :])
        for carrier, signal in zip(carried, signals, strict=True):
            np.multiply(carriers[carrier, :, some], signal[some], out=next(rest))
        if layout.gain is not None:
            assert slope is not None
            np.multiply(slope[:, some], track.tension[some], out=next(rest))
        if own.clock is not None:
            next(rest)[:] = shift[:, some]
            np.multiply(shift[:, some], track.times[some], out=next(rest))
            for behind in after(track) if own.steps is not None else ():
                np.multiply(shift[:, some], behind[some], out=next(rest))
        yield Columns(some, index, values, None if slope is None else slope[:, some])


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


def linearise(
    model: Model,
    x: Array,
    bars: Sequence[Array],
    excess: ExcessNoise,
    frozen: Sequence[Whitening] = (),
    near: Sequence[Point] = (),
) -> Linear:
    """Normal equations of all recordings and the prior; frozen : weights of each recording to be kept; near : points to borrow from."""
    layout = model.unknowns
    normal = np.diag(layout.sigma**-2.0)
    gradient = (x - layout.mean) / layout.sigma**2
    cost = float(gradient @ (x - layout.mean))
    points, weights, residuals = [], [], []
    for k in range(len(model.tracks)):
        point, weight = settle(
            model, x, k, bars[k], excess, frozen[k] if frozen else None, near[k] if near else None
        )
        residual = weight(point.closure.error)
        cost += float((residual * residual).sum())
        for block in jacobian(model, x, k, point, weight):
            _add(block, residual[:, block.samples], normal, gradient)
            if block.slope is not None and (knots := layout.own[k].knots) is not None:
                _add_knots(
                    model.tracks[k].knots[:, block.samples],
                    knots,
                    block,
                    residual[:, block.samples],
                    normal,
                    gradient,
                )
        points.append(point)
        weights.append(weight)
        residuals.append(residual)
    return Linear(tuple(points), tuple(weights), tuple(residuals), normal, gradient, cost)


def cost_at(model: Model, x: Array, linear: Linear) -> tuple[float, list[Point]]:
    """Posterior cost at x under frozen weights, and the points there."""
    layout = model.unknowns
    cost = float((((x - layout.mean) / layout.sigma) ** 2).sum())
    points = [
        make_point(model, x, k, point.bar, point, same_loads=True)
        for k, point in enumerate(linear.points)
    ]
    for point, weight in zip(points, linear.weights, strict=True):
        residual = weight(point.closure.error)
        cost += float((residual * residual).sum())
    return cost, points


def _add(block: Columns, residual: Array, normal: Array, gradient: Array) -> None:
    """Adds one block to the normal equations."""
    flat = block.values.reshape(block.index.size, -1)
    half = dsyrk(1.0, flat.T, trans=1)  # the upper triangle
    normal[np.ix_(block.index, block.index)] += half + np.triu(half, 1).T
    gradient[block.index] += flat @ residual.reshape(-1)


def _add_knots(
    splines: csr_array,
    knots: slice,
    block: Columns,
    residual: Array,
    normal: Array,
    gradient: Array,
) -> None:
    """Adds the knots of one recording to the normal equations: each column is `slope` times a spline, so none is formed."""
    assert block.slope is not None
    mixed = splines @ np.einsum("pen,en->np", block.values, block.slope)
    normal[knots, block.index] += mixed
    normal[block.index, knots] += mixed.T
    normal[knots, knots] += (
        (splines * (block.slope * block.slope).sum(axis=0)) @ splines.T
    ).toarray()
    gradient[knots] += splines @ (block.slope * residual).sum(axis=0)


@dataclass(frozen=True, eq=False)
class JointFit:
    """The outcome."""

    model: Model
    x: Array  # (P,)
    linear: Linear
    covariance: Array  # (P, P) as if the residual were white
    excess: ExcessNoise
    iterations: int
    converged: bool
    events: tuple[StepFault, ...] = ()

    @property
    def degrees(self) -> int:
        """Equations less what the data determined."""
        data = sum(r.size for r in self.linear.residuals)
        prior = np.diag(self.covariance) / self.model.unknowns.sigma**2
        return int(data - (self.model.unknowns.count - prior.sum()))

    @property
    def chi2_per_dof(self) -> float:
        return float(sum((r * r).sum() for r in self.linear.residuals) / self.degrees)


def approach(model: Model, x: Array, bars: Sequence[Array], excess: ExcessNoise) -> Array:
    """Unknowns after a fit of a few of very many samples: most of the way for a fraction of the time."""
    step = min(t.times.size for t in model.tracks) // COARSE_SAMPLES
    if step < COARSE_SHARE:
        return x
    thin = replace(model, tracks=tuple(t.thinned(step) for t in model.tracks))
    return minimise(thin, x, [b[::step] for b in bars], excess, negligible=1e-2).x


def minimise(
    model: Model,
    x: Array,
    bars: Sequence[Array],
    excess: ExcessNoise,
    *,
    negligible: float = 1e-4,
    max_iterations: int = MAX_ITERATIONS,
    on_iteration: IterationCallback | None = None,
) -> JointFit:
    """Gauss-Newton from x with backtracking.

    negligible : predicted decrease of the cost for each unknown, in units of the cost per degree of freedom, that ends the
        search; 1e-4 leaves them on average a hundredth of their standard deviations from the minimum.
    on_iteration : is told of the start and of each iteration.
    """
    now = linearise(model, x, bars, excess)
    iterations, converged = 0, False
    if on_iteration:
        on_iteration(_iteration(model, x, now))
    while True:
        step = newton_step(now.normal, now.gradient, model.unknowns.sigma)
        decrease = -float(now.gradient @ step)
        enough = negligible * x.size * max(1.0, now.cost / sum(r.size for r in now.residuals))
        converged = decrease < enough
        if converged or iterations == max_iterations:
            break
        iterations += 1
        share = 1.0
        cost, points = cost_at(model, x + step, now)
        while cost >= now.cost and share > 1e-4:
            share *= 0.5
            cost, points = cost_at(model, x + share * step, now)
        if cost >= now.cost:
            break
        x = x + share * step
        settled = now.cost - cost < enough
        now = linearise(
            model,
            x,
            [p.bar for p in now.points],
            excess,
            now.weights if iterations >= FREEZE_AFTER else (),
            points,
        )
        if on_iteration:
            on_iteration(_iteration(model, x, now))
        if settled:
            converged = True
            break
    scaled = now.normal * np.outer(model.unknowns.sigma, model.unknowns.sigma)
    covariance = cho_solve(cho_factor(scaled), np.eye(x.size)) * np.outer(
        model.unknowns.sigma, model.unknowns.sigma
    )
    return JointFit(model, x, now, covariance, excess, iterations, converged)


def _iteration(model: Model, x: Array, now: Linear) -> Iteration:
    layout, size = model.unknowns, sum(r.size for r in now.residuals)
    return Iteration(
        layout.geometry(x, 0),
        layout.clock(x, 0),
        model.tracks[0].times,
        now.points[0].closure.error,
        now.cost / size,
    )


def newton_step(normal: Array, gradient: Array, sigma: Array) -> Array:
    """Step of the normal equations, scaled by the priors."""
    scaled = normal * np.outer(sigma, sigma)
    return np.asarray(-sigma * cho_solve(cho_factor(scaled), sigma * gradient))
