"""The parametric model of one or several recordings, evaluated at one value of the unknowns.

Corrections displace error channels of the mechanism: gears, ball-bar joints, rod, plate. Each
coefficient multiplies a regressor, a known function of time (ballbar.ident.corrections). Without
corrections this is the kinematic model of thesis sec. 2, and the channels of the robot are its
joints as logged; with them they are the gears, which parallel rod and wrist couple to the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import BAR_ROWS, Geometry, Parameter
from ballbar.cell.poses import KnownDistance, PoseGroup, PoseTable
from ballbar.ident.corrections.base import (
    BAR,
    BEHIND_GEARS,
    GEAR,
    PLATE,
    ROD,
    Correction,
    State,
    backlash_transition,
)
from ballbar.ident.estimator.closure import Closure, parameter_jacobian
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.observations import Observations, StillPoses, observed
from ballbar.ident.estimator.samples import ArmMotion, Samples
from ballbar.ident.estimator.target_closure import TargetClosure
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.estimator.whitening import Whitening, covariance, whitening
from ballbar.ident.loads.gear_loads import Loads, MassModel, link_masses, loads, no_loads, rubbed

# A smaller change of the geometry [m, rad] or of the clock [s] moves the loads by less than a
# thousandth of a percent, so those of the previous evaluation are reused.
LOADS_GEOMETRY, LOADS_CLOCK = 1e-5, 2e-4
UNMEASURED_STEPS = 2  # Gauss-Newton steps for the unmeasured joints; they converge quadratically
MAX_UNMEASURED_STEP = 0.5  # [rad]
LINEAR_STEP = 1e-4  # [rad] a smaller step moves the tool less than 1e-8 of its lever off its column

Regressors = tuple[tuple[Array, ...], ...]  # (N,) each, of every correction


@dataclass(frozen=True, eq=False)
class Gearing:
    """How the channels of the robot act on its joints."""

    to_joint: Array  # (J, J) joints = channels @ to_joint
    to_gear: Array  # (J, J) its inverse
    transition: Array  # (J,) [N m] load over which each gear changes the flank of its backlash


def joints_as_logged(joints: int) -> Gearing:
    """The channels are the joints of the robot, so many."""
    return Gearing(np.eye(joints), np.eye(joints), np.zeros(joints))


def gearing(robot: Robot) -> Gearing:
    """The channels are the gears of the robot."""
    return Gearing(robot.gear_to_joint, robot.joint_to_gear, backlash_transition(robot))


def still_model(
    table: PoseTable, unknowns: Unknowns, corrections: Sequence[Correction], angle_noise: Array
) -> Model:
    """The model of still poses alone; angle_noise : (J,) [rad] of their joint angles."""
    loaded = any(correction.slopes is not None for correction in corrections)
    return Model(
        gearing=gearing(table.robot),
        masses=link_masses(table.robot) if loaded else None,
        corrections=tuple(corrections),
        unknowns=unknowns,
        recordings=(),
        table=table,
        angle_noise=angle_noise,
    )


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One set of observations at one value of the unknowns."""

    samples: Observations
    closure: Closure | TargetClosure
    ballbar: Array  # (N, 5) [rad] as the encoders read; unmeasured joints as solved for
    gearing: Gearing
    clock: Clock
    robot_time: Array  # (N,) [s] of the samples on the robot's clock
    state: State | None = None  # what the regressors depend on; None without corrections
    regressors: Regressors = ()
    varied: tuple[Parameter, ...] = ()  # parameters of the robot that are channels
    loads_at: tuple[Geometry, Clock] | None = None  # for which the loads were computed
    regressors_at: Clock | None = None  # for which regressors without loads were computed
    # (6, N) [m, rad] by which plate and structure move the tool beside the joints; None: not at all
    yielded: Array | None = None
    bent: Array | float = 0.0  # (N, J) [rad] by which the joints are off the logged angles

    @property
    def recording(self) -> Samples:
        """The observations, a recording. Raises TypeError where they are none."""
        if not isinstance(self.samples, Samples):
            raise TypeError("the observations are no recording")
        return self.samples

    @property
    def bar_closure(self) -> Closure:
        """The closure with a ball-bar. Raises TypeError where there is none."""
        if not isinstance(self.closure, Closure):
            raise TypeError("no ball-bar was observed")
        return self.closure

    @property
    def still(self) -> PoseGroup:
        """The group of still poses that was observed. Raises TypeError where there is none."""
        if not isinstance(self.samples, StillPoses):
            raise TypeError("the observations are no still poses")
        return self.samples.group

    @property
    def target_closure(self) -> TargetClosure:
        """The closure at a target. Raises TypeError where there is none."""
        if not isinstance(self.closure, TargetClosure):
            raise TypeError("no target was observed")
        return self.closure

    @property
    def position_sigma(self) -> Array:
        """(N, D) [m] declared standard deviation of still poses along each direction sensed."""
        return self.target_closure.sight.position_sigma(self.still.sigma)

    @cached_property
    def channel_speed(self) -> Array:
        """(J, N) [rad/s] speed of the robot's channels."""
        speed = self.samples.joint_speed(self.robot_time)
        return (speed @ self.gearing.to_gear).T

    @cached_property
    def columns(self) -> Array:
        """(J + 7, 6, N) change of the loop-closure error for a unit of each error channel."""
        return self.closure.columns(self.gearing.to_joint)

    @cached_property
    def varied_columns(self) -> Array:
        """(V, 6, N) change of the loop-closure error for a unit of each varied parameter."""
        return parameter_jacobian(self.closure, self.varied)

    @property
    def time_column(self) -> Array:
        """(6, N) change of the loop-closure error per second of clock offset."""
        return np.asarray(np.einsum("gcn,gn->cn", self.columns[GEAR:BAR], self.channel_speed))

    @property
    def unmeasured_columns(self) -> Array:
        """(m, 6, N) change of the loop-closure error for a unit of each unmeasured direction."""
        return self.samples.free_columns(self)

    def noise_columns(self, excess: ExcessNoise, uncertain: Array | float = 0.0) -> Array:
        """(K, 6, N) change of the loop-closure error for one sigma of each source of noise.

        uncertain : (J, N) [rad] of the gears beyond log noise and excess noise.
        """
        return self.samples.noise_columns(self, excess, uncertain)

    def with_ballbar_step(self, step: Array) -> Evaluation:
        """After a small step (m, N) [rad] of the unmeasured joints, to first order."""
        ballbar = self.ballbar.copy()
        ballbar[:, self.recording.unmeasured] += step.T
        error = self.closure.error + np.einsum("jcn,jn->cn", self.unmeasured_columns, step)
        return replace(self, ballbar=ballbar, closure=replace(self.closure, error=error))


@dataclass(frozen=True, eq=False)
class Model:
    """Corrections, unknowns and observations of a fit: recordings, then groups of still poses."""

    gearing: Gearing
    masses: MassModel | None  # None where no correction needs loads
    corrections: tuple[Correction, ...]
    unknowns: Unknowns
    recordings: tuple[Samples, ...]
    # below 1 the backlash changes flanks over a wider load; for continuation
    sharpness: float = 1.0
    table: PoseTable | None = None  # still poses
    angle_noise: Array | float = 0.0  # (J,) [rad] of their joint angles, by their rounding

    @cached_property
    def parts(self) -> tuple[Observations, ...]:
        """Everything that was observed."""
        groups = () if self.table is None else self.table.groups
        noise = np.broadcast_to(self.angle_noise, len(self.gearing.to_joint))
        return (*self.recordings, *(observed(group, noise) for group in groups))

    @property
    def poses(self) -> PoseTable:
        """The still poses. Raises ValueError where there are none."""
        if self.table is None:
            raise ValueError("the model has no still poses")
        return self.table

    @property
    def distances(self) -> tuple[KnownDistance, ...]:
        """Known distances between seats."""
        return () if self.table is None else self.table.distances

    @cached_property
    def varied(self) -> tuple[Parameter, ...]:
        """The parameters of the robot that are channels of corrections."""
        channels = (c.channel for correction in self.corrections for c in correction.coefficients)
        return tuple(dict.fromkeys(c for c in channels if isinstance(c, Parameter)))

    @cached_property
    def resting(self) -> dict[int, tuple[State, Regressors]]:
        """State and regressors of every part without ball-bar.

        By the nominal robot at the angles as given: what the fit changes would not be seen.
        """
        out, gears = {}, self.gearing
        for k, part in enumerate(self.parts):
            if isinstance(part, StillPoses):
                state = part.state(
                    self.masses, self.unknowns.fixed, gears.to_gear, gears.transition
                )
                out[k] = state, self._regressors(state, None)
        return out

    def at_rest(self, x: Array) -> tuple[Evaluation, ...]:
        """Every group of still poses at the unknowns x (P,), where there is nothing else."""
        return tuple(self.evaluate(x, k, np.zeros((0, 0))) for k in range(len(self.parts)))

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
        """Loop-closure error of part k at x (P,), ball-bar angles (N, 5) [rad].

        Where the length is measured, the bar points at the tool whatever the angles. Loads are
        those of the arm as it is bent: gears that yield by 10 mrad turn them by a hundredth, more
        than the noise sees.

        previous : an evaluation nearby, where the arm is bent as here. Its loads are reused where
        geometry and clock moved less than LOADS_GEOMETRY and LOADS_CLOCK, its regressors where
        they do not depend on loads and the clocks agree. hold_loads : reuse the loads whenever the
        clocks agree, as a trial step within one iteration does.
        """
        samples, layout = self.parts[k], self.unknowns
        geometry, clock, at = samples.mechanism(layout, x, k)
        q = samples.joint_angles(at)
        ballbar = samples.bar_angles(geometry, q, ballbar)
        if not self.corrections:
            closure = samples.close(layout, x, geometry, q, ballbar)
            return Evaluation(samples, closure, ballbar, self.gearing, clock, at)
        loads_at, regressors_at = None, None
        if isinstance(samples, StillPoses):
            state, regressors = self.resting[k]
        else:
            same_clock = (
                previous is not None
                and previous.regressors_at is not None
                and previous.regressors_at.alike(clock)
                and layout.own[k].steps is None
            )
            reusable = previous if same_clock else None
            motion = samples.arm_motion(at)
            motion = replace(motion, q=motion.q + (0.0 if previous is None else previous.bent))
            carried, loads_at = self._loads(
                motion, previous, geometry, clock, ballbar, hold=hold_loads and same_clock, at=at
            )
            bar = ballbar[:, :BAR_ROWS] + geometry.bar.theta
            state = self._state(x, k, q, bar, carried, motion)
            regressors = self._regressors(state, reusable)
            regressors_at = reusable.regressors_at if reusable else clock
        moved, varied = self._displacements(x, regressors, at.size)
        bent = moved[GEAR:BAR].T @ self.gearing.to_joint
        bar = ballbar.copy()
        bar[:, :BAR_ROWS] += moved[BAR:ROD].T
        closure = samples.close(layout, x, geometry, q + bent, bar)
        error = closure.error + closure.rod_column * moved[ROD]
        plate = closure.plate_column * moved[PLATE]
        structure = np.einsum("vcn,vn->cn", parameter_jacobian(closure, self.varied), varied)
        error += plate
        error += structure
        point = Evaluation(
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
            regressors_at=regressors_at,
            yielded=-(plate + structure),
            bent=bent,
        )
        if previous is not None or not isinstance(samples, Samples) or self.masses is None:
            return point
        return self.evaluate(x, k, ballbar, replace(point, loads_at=None))

    def weights(self, x: Array, evaluation: Evaluation, excess: ExcessNoise) -> Whitening:
        """Weights of one recording from its noise, at an evaluation."""
        uncertain = self.backlash_uncertainty(x, evaluation)
        scaled = evaluation.noise_columns(excess, uncertain)
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
        point = self.evaluate(x, k, ballbar, previous)
        used = weights or self.weights(x, point, excess)
        part = self.parts[k]
        solved = isinstance(part, Samples) and part.solved_joints
        for _ in range(UNMEASURED_STEPS if solved else 0):
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

    def _state(
        self, x: Array, k: int, q: Array, bar: Array, carried: Loads, motion: ArmMotion
    ) -> State:
        """State of recording k at joint angles q (N, J) and ball-bar angles (N, 5) [rad]."""
        return State(
            t=self.recordings[k].times,
            recording=k,
            gears=(q @ self.gearing.to_gear).T,
            bar=bar.T,
            loads=carried,
            tension=self.tension(x, k),
            width=self.gearing.transition,
            gear_speed=(motion.logged_speed @ self.gearing.to_gear).T,
            gear_acceleration=(motion.acceleration @ self.gearing.to_gear).T,
            sharpness=self.sharpness,
        )

    def _loads(
        self,
        motion: ArmMotion,
        previous: Evaluation | None,
        geometry: Geometry,
        clock: Clock,
        ballbar: Array,
        *,
        hold: bool,
        at: Array,
    ) -> tuple[Loads, tuple[Geometry, Clock]]:
        """Loads along a motion, and the geometry and clock that they were computed for."""
        if previous is not None and previous.state is not None and previous.loads_at is not None:
            past, then = previous.loads_at
            drift = abs(clock.offset - then.offset) + abs(clock.skew - then.skew) * np.ptp(at)
            moved = np.abs(geometry.values - past.values).max()
            if hold or (moved < LOADS_GEOMETRY and drift < LOADS_CLOCK):
                return previous.state.loads, previous.loads_at
        if self.masses is None:
            return no_loads(len(self.gearing.to_joint), at.size), (geometry, clock)
        now = loads(
            self.masses,
            geometry,
            q=motion.q,
            b=ballbar,
            speed=motion.speed,
            acceleration=motion.acceleration,
        )
        if "typical_friction" in [c.name for c in self.corrections]:
            now = replace(now, rubbed=rubbed(self.masses, geometry, motion.q, ballbar))
        return now, (geometry, clock)

    def _regressors(self, state: State, previous: Evaluation | None) -> Regressors:
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
        first = next((k for k, name in enumerate(names) if name.endswith("backlash1")), None)
        if evaluation.state is None or first is None:
            return 0.0
        first += self.unknowns.coefficients.start
        half = np.abs(x[first : first + len(self.gearing.to_joint)])[:, None]
        return np.asarray(half * (1.0 - evaluation.state.load_sign() ** 2))
