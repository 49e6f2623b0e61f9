"""The parametric model of one or several recordings, evaluated at one value of the unknowns.

Corrections displace error channels of the mechanism: gears, ball-bar joints, rod, plate. Each
coefficient multiplies a regressor, a known function of time (ident.corrections). Without
corrections this is the kinematic model of thesis sec. 2, and the channels of the robot are its
joints as logged; with them they are the gears, which parallel rod and wrist couple to the joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cell.arrays import Array
from cell.clock import Clock
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, Geometry, Parameter
from cell.robot_angles import by_axis
from ident.corrections.base import (
    BAR,
    BEHIND_GEARS,
    GEAR,
    PLATE,
    ROD,
    Correction,
    State,
    backlash_transition,
)
from ident.estimator.closure import (
    Closure,
    bar_joint_jacobian,
    beside_rod,
    close_loop,
    parameter_jacobian,
    plate_jacobian,
    pointing_bar,
    robot_joint_jacobian,
    rod_jacobian,
)
from ident.estimator.noise import ExcessNoise
from ident.estimator.samples import Samples
from ident.estimator.unknowns import Unknowns
from ident.estimator.whitening import Whitening, covariance, whitening
from ident.loads.gear_loads import Loads, MassModel, loads, no_loads

# A smaller change of the geometry [m, rad] or of the clock [s] moves the loads by less than a
# thousandth of a percent, so those of the previous evaluation are reused.
LOADS_GEOMETRY, LOADS_CLOCK = 1e-5, 2e-4
UNMEASURED_STEPS = 2  # Gauss-Newton steps for the unmeasured joints; they converge quadratically
MAX_UNMEASURED_STEP = 0.5  # [rad]
LINEAR_STEP = 1e-4  # [rad] a smaller step moves the tool less than 1e-8 of its lever off its column


@dataclass(frozen=True, eq=False)
class Gearing:
    """How the channels of the robot act on its joints."""

    to_joint: Array  # (J, J) joints = channels @ to_joint
    to_gear: Array  # (J, J) its inverse
    transition: Array  # (J,) [N m] load over which each gear changes the flank of its backlash


def joints_as_logged(joints: int) -> Gearing:
    """The channels are the joints of the robot, so many."""
    return Gearing(np.eye(joints), np.eye(joints), np.zeros(joints))


def gearing(cell: Cell) -> Gearing:
    """The channels are the gears of the robot."""
    robot = cell.robot
    return Gearing(robot.gear_to_joint, robot.joint_to_gear, backlash_transition(cell))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One recording at one value of the unknowns."""

    samples: Samples
    closure: Closure
    ballbar: Array  # (N, 5) [rad] as the encoders read; unmeasured joints as solved for
    gearing: Gearing
    clock: Clock
    robot_time: Array  # (N,) [s] of the samples on the robot's clock
    state: State | None = None  # what the regressors depend on; None without corrections
    regressors: tuple[tuple[Array, ...], ...] = ()  # (N,) each, of every correction
    varied: tuple[Parameter, ...] = ()  # parameters of the robot that are channels
    loads_at: tuple[Geometry, Clock] | None = None  # for which the loads were computed
    regressors_at: Clock | None = None  # for which regressors without loads were computed
    # (6, N) [m, rad] by which plate and structure move the tool beside the joints; None: not at all
    yielded: Array | None = None

    @cached_property
    def channel_speed(self) -> Array:
        """(J, N) [rad/s] speed of the robot's channels."""
        speed = self.samples.joint_speed(self.robot_time)
        return (speed @ self.gearing.to_gear).T

    @cached_property
    def columns(self) -> Array:
        """(J + 7, 6, N) change of the loop-closure error for a unit of each error channel."""
        joints = robot_joint_jacobian(self.closure)
        columns = np.empty((len(joints) + BEHIND_GEARS, *self.closure.error.shape))
        np.einsum("gj,jcn->gcn", self.gearing.to_joint, joints, out=columns[GEAR:BAR])
        columns[BAR:ROD] = bar_joint_jacobian(self.closure)
        columns[ROD], columns[PLATE] = rod_jacobian(self.closure), plate_jacobian(self.closure)
        return columns

    @cached_property
    def varied_columns(self) -> Array:
        """(V, 6, N) likewise for a unit of each varied parameter."""
        return parameter_jacobian(self.closure, self.varied)

    @property
    def time_column(self) -> Array:
        """(6, N) change of the loop-closure error per second of clock offset."""
        return np.asarray(np.einsum("gcn,gn->cn", self.columns[GEAR:BAR], self.channel_speed))

    @property
    def unmeasured_columns(self) -> Array:
        """(m, 6, N) change of the loop-closure error per radian of each unmeasured joint.

        Where the length is measured: per metre or radian of what the joints can move together.
        """
        if self.samples.measures_length:
            return beside_rod(self.closure)
        return np.asarray(self.columns[BAR:ROD][self.samples.unmeasured])

    def with_ballbar_step(self, step: Array) -> Evaluation:
        """After a small step (m, N) [rad] of the unmeasured joints, to first order."""
        ballbar = self.ballbar.copy()
        ballbar[:, self.samples.unmeasured] += step.T
        error = self.closure.error + np.einsum("jcn,jn->cn", self.unmeasured_columns, step)
        return replace(self, ballbar=ballbar, closure=replace(self.closure, error=error))


@dataclass(frozen=True, eq=False)
class Model:
    """Corrections, unknowns and samples of a fit."""

    gearing: Gearing
    masses: MassModel | None  # None where no correction needs loads
    corrections: tuple[Correction, ...]
    unknowns: Unknowns
    recordings: tuple[Samples, ...]
    sharpness: float = (
        1.0  # below 1 the backlash changes flanks over a wider load; for continuation
    )

    @cached_property
    def varied(self) -> tuple[Parameter, ...]:
        """The parameters of the robot that are channels of corrections."""
        channels = (c.channel for correction in self.corrections for c in correction.coefficients)
        return tuple(dict.fromkeys(c for c in channels if isinstance(c, Parameter)))

    def robot_times(self, x: Array, k: int) -> Array:
        """(N,) [s] on the robot's clock of the samples of recording k, clock steps included."""
        samples, steps = self.recordings[k], self.unknowns.own[k].steps
        t = self.unknowns.clock(x, k).robot_time(samples.times)
        if steps is not None:
            t = t + x[steps] @ samples.after_clock_steps()
        return np.clip(t, samples.robot.start, samples.robot.end)

    def tension(self, x: Array, k: int) -> Array:
        """(N,) [N] of the rod at the samples of recording k: measured times gain, plus spline."""
        samples, knots, gain = self.recordings[k], self.unknowns.own[k].knots, self.unknowns.gain
        out = (1.0 + (0.0 if gain is None else x[gain])) * samples.tension
        return np.asarray(out if knots is None else out + samples.splines.T @ x[knots])

    def evaluate(
        self,
        x: Array,
        k: int,
        ballbar: Array,
        previous: Evaluation | None = None,
        *,
        hold_loads: bool = False,
    ) -> Evaluation:
        """Loop-closure error of recording k at x (P,), ball-bar angles (N, 5) [rad].

        Where the length is measured, the bar points at the tool whatever the angles.

        previous : an evaluation nearby. Its loads are reused where geometry and clock moved less
        than LOADS_GEOMETRY and LOADS_CLOCK, its regressors where they do not depend on loads and
        the clocks are alike. hold_loads : reuse the loads whenever the clocks are alike, as a trial
        step within one iteration does.
        """
        samples, layout = self.recordings[k], self.unknowns
        geometry, clock = layout.geometry(x, k), layout.clock(x, k)
        at = self.robot_times(x, k)
        q = samples.joint_angles(at)
        if samples.measures_length:
            ballbar = pointing_bar(geometry, q, samples.extension)
        if not self.corrections:
            closure = close_loop(geometry, q, ballbar)
            return Evaluation(samples, closure, ballbar, self.gearing, clock, at)
        same_clock = (
            previous is not None
            and previous.regressors_at is not None
            and previous.regressors_at.alike(clock)
            and layout.own[k].steps is None
        )
        reusable = previous if same_clock else None
        carried, loads_at = self._loads(
            k, previous, geometry, clock, ballbar, hold=hold_loads and same_clock, at=at
        )
        state = State(
            t=samples.times,
            recording=k,
            gears=(q @ self.gearing.to_gear).T,
            bar=ballbar[:, :BAR_ROWS].T + geometry.bar.theta[:, None],
            loads=carried,
            tension=self.tension(x, k),
            width=self.gearing.transition,
            gear_speed=(samples.robot.speed(at) @ self.gearing.to_gear).T,
            gear_acceleration=(samples.robot.arm(at, 2) @ self.gearing.to_gear).T,
            sharpness=self.sharpness,
        )
        regressors = self._regressors(state, reusable)
        moved, varied = self._displacements(x, regressors, at.size)
        joints = q + moved[GEAR:BAR].T @ self.gearing.to_joint
        if samples.measures_length:
            closure = close_loop(geometry, joints, pointing_bar(geometry, joints, ballbar[:, -1]))
        else:
            closure = close_loop(geometry, joints, ballbar + moved[BAR:ROD].T)
        error = closure.error + rod_jacobian(closure) * moved[ROD]
        plate = plate_jacobian(closure) * moved[PLATE]
        structure = np.einsum("vcn,vn->cn", parameter_jacobian(closure, self.varied), varied)
        error += plate
        error += structure
        return Evaluation(
            samples=samples,
            closure=replace(closure, error=error),
            ballbar=ballbar,
            gearing=self.gearing,
            clock=clock,
            robot_time=at,
            state=state,
            regressors=regressors,
            varied=self.varied,
            loads_at=loads_at,
            regressors_at=reusable.regressors_at if reusable else clock,
            yielded=-(plate + structure),
        )

    def weights(self, x: Array, evaluation: Evaluation, excess: ExcessNoise) -> Whitening:
        """Weights of one recording from its noise, at an evaluation."""
        uncertain = self.backlash_uncertainty(x, evaluation)
        scaled = noise_columns(evaluation, excess, uncertain)
        return whitening(covariance(scaled), evaluation.unmeasured_columns)

    def solved(
        self,
        x: Array,
        k: int,
        ballbar: Array,
        excess: ExcessNoise,
        *,
        weights: Whitening | None = None,
        previous: Evaluation | None = None,
    ) -> tuple[Evaluation, Whitening]:
        """Recording k with its unmeasured joints solved for, and its weights.

        weights : those to be kept, if any.
        """
        samples = self.recordings[k]
        point = self.evaluate(x, k, ballbar, previous)
        used = weights or self.weights(x, point, excess)
        # a bar that points at the tool leaves its joints nothing to absorb
        for _ in range(
            0 if samples.measures_length or not samples.unmeasured else UNMEASURED_STEPS
        ):
            step = used.unmeasured_step(point.closure.error)
            step = np.clip(step, -MAX_UNMEASURED_STEP, MAX_UNMEASURED_STEP)
            stepped = point.with_ballbar_step(step)
            if np.abs(step).max() < LINEAR_STEP:
                return stepped, used
            point = self.evaluate(x, k, stepped.ballbar, point, hold_loads=True)
            used = weights or self.weights(x, point, excess)
        return point, used

    def tension_column(self, x: Array, evaluation: Evaluation) -> Array:
        """(6, N) change of the loop-closure error per newton of rod tension."""
        out = np.zeros(evaluation.closure.error.shape)
        if evaluation.state is None:
            return out
        slopes = tuple(
            tuple(c.slopes(evaluation.state)) if c.slopes else (0.0,) * len(c.coefficients)
            for c in self.corrections
        )
        moved, varied = self._displacements(x, slopes, evaluation.robot_time.size)
        used = np.flatnonzero(np.abs(moved).max(axis=1) > 0.0)
        out += np.einsum("ckn,cn->kn", evaluation.columns[used], moved[used])
        out += np.einsum("vkn,vn->kn", evaluation.varied_columns, varied)
        return out

    def _loads(
        self,
        k: int,
        previous: Evaluation | None,
        geometry: Geometry,
        clock: Clock,
        ballbar: Array,
        *,
        hold: bool,
        at: Array,
    ) -> tuple[Loads, tuple[Geometry, Clock]]:
        """Loads of recording k, and the geometry and clock that they were computed for."""
        if previous is not None and previous.state is not None and previous.loads_at is not None:
            past, then = previous.loads_at
            drift = abs(clock.offset - then.offset) + abs(clock.skew - then.skew) * np.ptp(at)
            moved = np.abs(geometry.values - past.values).max()
            if hold or (moved < LOADS_GEOMETRY and drift < LOADS_CLOCK):
                return previous.state.loads, previous.loads_at
        if self.masses is None:
            return no_loads(len(self.gearing.to_joint), at.size), (geometry, clock)
        log = self.recordings[k].robot
        q, speed, acceleration = (
            np.asarray(f) for f in (log.spline(at), log.arm(at, 1), log.arm(at, 2))
        )
        return loads(self.masses, geometry, q, ballbar, speed, acceleration), (geometry, clock)

    def _regressors(
        self, state: State, previous: Evaluation | None
    ) -> tuple[tuple[Array, ...], ...]:
        """Regressors of every correction; those without loads are taken from `previous`, if any."""
        known = previous.regressors if previous else ((),) * len(self.corrections)
        return tuple(
            old if old and c.slopes is None else tuple(c.regressors(state))
            for c, old in zip(self.corrections, known, strict=True)
        )

    def _displacements(
        self, x: Array, signals: tuple[tuple[Array | float, ...], ...], samples: int
    ) -> tuple[Array, Array]:
        """Coefficients times `signals`, of every correction: displacements of the error channels.

        (J + 7, samples) of gears, ball-bar, rod and plate; (V, samples) of the varied parameters.
        """
        moved = np.zeros((len(self.gearing.to_joint) + BEHIND_GEARS, samples))
        varied = np.zeros((len(self.varied), samples))
        values = iter(x[self.unknowns.coefficients])
        for correction, own in zip(self.corrections, signals, strict=True):
            for coefficient, signal in zip(correction.coefficients, own, strict=True):
                channel = coefficient.channel
                if isinstance(channel, Parameter):
                    varied[self.varied.index(channel)] += next(values) * signal
                else:
                    moved[channel] += next(values) * signal
        return moved, varied

    def backlash_uncertainty(self, x: Array, evaluation: Evaluation) -> Array | float:
        """(J, N) [rad] uncertainty of each gear's flank: the half width near a load reversal."""
        names = [c.name for correction in self.corrections for c in correction.coefficients]
        if evaluation.state is None or "backlash1" not in names:
            return 0.0
        first = self.unknowns.coefficients.start + names.index("backlash1")
        half = np.abs(x[first : first + len(self.gearing.to_joint)])[:, None]
        return np.asarray(half * (1.0 - evaluation.state.load_sign() ** 2))


def noise_columns(
    evaluation: Evaluation, excess: ExcessNoise, uncertain: Array | float = 0.0
) -> Array:
    """(J + 7, 6, N) change of the loop-closure error for one sigma of each channel's noise.

    The last one is of the stamps, which displace all channels of a log at once.
    uncertain : (J, N) [rad] of the robot's channels beyond log noise and excess noise.
    """
    samples, columns = evaluation.samples, evaluation.columns
    logged = samples.joint_noise[:, None]
    beyond = by_axis(len(logged), main=excess.gear, wrist=excess.wrist)[:, None]
    robot = np.sqrt(logged**2 + beyond**2 + np.square(uncertain))
    measured = np.array([j + 1 in samples.encoders for j in range(BAR_ROWS)])
    ballbar = np.where(measured, np.hypot(samples.encoder_noise, excess.bar), 0.0)
    out = np.empty_like(columns)
    np.multiply(columns[GEAR:BAR], robot[:, None, :], out=out[GEAR:BAR])
    np.multiply(columns[BAR:ROD], ballbar[:, None, None], out=out[BAR:ROD])
    np.multiply(columns[ROD], np.hypot(excess.rod, samples.length_noise), out=out[ROD])
    np.multiply(evaluation.time_column, samples.stamp_noise, out=out[PLATE])
    return out
