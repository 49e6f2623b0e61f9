"""Cramer-Rao prediction of a trajectory: standard deviations of all parameters and of the tool.

The bound is that of the complete model that `ballbar identify` fits (ballbar.ident.complete_fit:
geometry, clock, corrections with their priors, the rod's tension as a spline), at samples of a
noise-free run. The information of a sample does not depend on how many are computed, so some
hundreds represent the 1500 that are fitted. Of a length it fits geometry and clock alone, and so
does the prediction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import BAR_ROWS, Geometry, robot_frames
from ballbar.ident.complete_fit import FIRST_EXCESS, needs_loads
from ballbar.ident.corrections import correction_named, supported_corrections
from ballbar.ident.corrections.base import Correction
from ballbar.ident.estimator.build_unknowns import TENSION_PRIOR, RecordingStart, complete_unknowns
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.model import Evaluation, Model, gearing
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import normal_equations
from ballbar.ident.estimator.sample_times import DWELL_KEPT
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.unknowns import PlacedPoses, Unknowns
from ballbar.ident.loads.gear_loads import MassModel, mass_model
from ballbar.ident.loads.logged_tension import tension_splines
from ballbar.ident.options import DEFAULT_SAMPLES
from ballbar.ident.robot.accuracy import position_sigma
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.signals.smooth_log import WIDEST_KNOT_SPACING, interpolating_log
from ballbar.planning.known import Known
from ballbar.planning.request import PlanSensors, PlanTiming
from ballbar.planning.trajectory import Passage
from ballbar.planning.workspace import Workspace, workspace_grid

EXACT = 1e-9  # [m] prior of a length taken as exact
# Computed, of DEFAULT_SAMPLES fitted; sigma is then a few percent above that of all.
SAMPLES = 240


@dataclass(frozen=True, eq=False)
class Predictor:
    """The part of a prediction that does not depend on the trajectory."""

    cell: Cell
    masses: MassModel | None  # None where no correction needs loads
    sensors: PlanSensors
    timing: PlanTiming
    corrections: tuple[Correction, ...]
    grid: Array  # (G, J) [rad] poses over which the TCP error counts
    samples: int = SAMPLES
    excess: ExcessNoise | None = None  # of a fitted sample, if known better than by the sensors
    exact_scale: bool = True  # whether plate and ba5 are taken as exact
    tension_sigma: float = TENSION_PRIOR  # [N] prior of a knot of the rod's tension
    known: Known | None = None  # from results of the machine

    @property
    def instants(self) -> Array:
        """(N,) [s] times of the samples, from just before the robot moves to just after."""
        margin = self.timing.dwell_s - DWELL_KEPT
        return np.linspace(margin, self.timing.duration_s - margin, self.samples)

    @cached_property
    def knots(self) -> csr_array:
        """(K, N) values of the tension's splines at the samples."""
        return tension_splines(self.instants)

    @cached_property
    def to_knots(self) -> Array:
        """(K, N) map of a tension at the samples to its least-squares spline."""
        return np.asarray(np.linalg.pinv(self.knots.toarray().T))

    @property
    def encoders(self) -> tuple[int, ...]:
        """Ball-bar joints with an encoder; none where the rod's length is sensed."""
        return () if self.cell.ballbar.stroke is not None else self.sensors.encoders

    @property
    def dilution(self) -> float:
        """Factor on noise that gives the computed samples the information of the fitted ones."""
        return float(np.sqrt(self.samples / DEFAULT_SAMPLES))


@dataclass(frozen=True, eq=False, kw_only=True)
class PredictedInformation:
    """Predicted information about one robot by what is observed, moving or still."""

    layout: Unknowns
    normal: Array  # (P, P) information matrix
    robot: IdentifiedRobot
    grid: Array  # (G, J) [rad] poses over which the TCP error counts
    target: str = ""  # of the layout, that is the tool; else the tool of the robot itself is

    @cached_property
    def covariance(self) -> Array:
        """(P, P) [SI] Cramer-Rao bound of the covariance."""
        return inverse(self.normal)

    @property
    def sigma(self) -> dict[str, float]:
        """[SI] standard deviation of every unknown but the tension's knots."""
        spread = np.sqrt(np.diag(self.covariance))
        return {
            n: float(v)
            for n, v in zip(self.layout.names, spread, strict=True)
            if not n.startswith("tension")
        }

    @property
    def prior(self) -> dict[str, float]:
        """[SI] standard deviation of every unknown before anything was observed."""
        return dict(zip(self.layout.names, self.layout.sigma.tolist(), strict=True))

    @property
    def moving(self) -> NDArray[np.intp]:
        """(K,) indices of the unknowns that move the tool."""
        machine = self.layout.machine
        if not self.target:
            return machine
        first = self.layout.targets[self.target].start
        return np.asarray(np.r_[machine, first : first + 3])

    @cached_property
    def tool(self) -> tuple[Array, Array]:
        """(G, 3) [m] the unloaded robot's tool over the grid; (K, 3, G) its motion per unknown."""
        moves = self.robot.jacobian(self.grid, self.layout.shared)
        if self.target:
            turned = self.robot.frames(self.grid).rotation(-2).transpose(1, 0, 2)
            moves = np.concatenate((moves, turned))
        return self.robot.tool(self.grid), moves

    @cached_property
    def tcp_sigma(self) -> Array:
        """(G,) [m] of the tool over the grid, base aligned."""
        return position_sigma(*self.tool, self.covariance[np.ix_(self.moving, self.moving)])


@dataclass(frozen=True, eq=False, kw_only=True)
class PathPrediction(PredictedInformation):
    """Predicted information of one trajectory, and what the next rod tension reuses."""

    model: Model
    points: tuple[Evaluation, ...]


def predictor(
    cell: Cell,
    sensors: PlanSensors,
    timing: PlanTiming,
    workspace: Workspace | None,
    *,
    samples: int = SAMPLES,
    known: Known | None = None,
) -> Predictor:
    """The predictor of a cell with its sensors over a workspace.

    known : from results of the machine, whose corrections and noise it takes.

    Raises InputError for a workspace that the robot does not have.
    """
    names = [] if cell.ballbar.stroke is not None else supported_corrections(cell.robot)
    corrections = tuple(correction_named(name, cell, sensors.encoders) for name in names)
    if known is not None:
        corrections = known.corrections_with(cell, sensors.encoders)
    return Predictor(
        cell=cell,
        masses=mass_model(cell) if needs_loads(corrections) else None,
        sensors=sensors,
        timing=timing,
        corrections=corrections,
        grid=workspace_grid(cell.robot, workspace),
        samples=samples,
        excess=None if known is None else known.excess,
        known=known,
    )


def planned_unknowns(
    on: Predictor,
    nominal: Geometry,
    recordings: Sequence[RecordingStart],
    beside: PlacedPoses | None = None,
) -> tuple[Unknowns, Array]:
    """Unknowns of the complete model, and start (P,) [SI]; the scale is exact if `on` says so.

    `ba5` is equivalent to the plate's length, ra6: 5 um of each are 28 ppm of scale on any path,
    which a plan states apart (ballbar.planning.plan). The `dh` model of a length has no Hayati
    angles.
    """
    layout, x = complete_unknowns(
        on.cell,
        nominal,
        recordings,
        on.corrections,
        gain_sigma=None,
        rod_sigma=on.sensors.rod_sigma_m,
        still=beside,
    )
    if not on.exact_scale:
        return layout, x
    sigma = layout.sigma.copy()
    exact = (
        nominal.table.hayati if on.cell.ballbar.stroke is not None else ("ba5", nominal.table.plate)
    )
    sigma[[layout.names.index(name) for name in exact]] = EXACT
    return replace(layout, sigma=sigma), x


def predict(
    on: Predictor,
    trajectory: Passage,
    tension: Array,
    previous: PathPrediction | None = None,
    *,
    beside: PlacedPoses | None = None,
    unexplained: ExcessNoise | None = None,
) -> PathPrediction:
    """The prediction of a trajectory.

    tension : (N,) [N] of the rod at the trajectory's times. previous : prediction of the same
        trajectory with another tension, whose loads per newton are reused. beside : what a tracker
        beside the ball-bar measures, and what the model leaves unexplained of it.
    """
    samples = samples_along(on, trajectory)
    begin = RecordingStart(
        samples.encoders,
        trajectory.nominal,
        Clock(0.0, 0.0) if samples.has_clock else None,
        samples.splines.shape[0],
        on.tension_sigma,
    )
    layout, x = planned_unknowns(on, trajectory.nominal, [begin], beside)
    knots, t = layout.own[0].knots, samples.times
    if knots is not None:
        x[knots] = on.to_knots @ np.interp(t, trajectory.t, tension)
    table, excess = None if beside is None else beside.table, excess_noise(on)
    model = Model(
        gearing(on.cell.robot), on.masses, on.corrections, layout, (samples,), table=table
    )
    bars = [np.stack([np.interp(t, trajectory.t, angle) for angle in trajectory.b.T], axis=1)]
    if unexplained is not None:
        excess = replace(excess, position=unexplained.position, rotation=unexplained.rotation)
        bars.append(np.zeros((0, 0)))
    points = previous.points if previous else ()
    linear = normal_equations(model, x, bars, excess, previous=points)
    return PathPrediction(
        layout=layout,
        model=model,
        normal=linear.normal + (before(on, layout) - np.diag(layout.sigma**-2.0)),
        points=linear.evaluations,
        robot=IdentifiedRobot(on.cell, trajectory.nominal, on.corrections, x[layout.coefficients]),
        grid=on.grid,
    )


def before(on: Predictor, layout: Unknowns) -> Array:
    """(P, P) information before the trajectory: priors, and what results say."""
    if on.known is None:
        return np.diag(layout.sigma**-2.0)
    return on.known.normal(layout, on.cell)


def excess_noise(on: Predictor) -> ExcessNoise:
    """Excess noise of a computed sample: that of the results, or else of the sensors.

    With a sensed length it is the larger of both: its sensor's noise is white in a log, so a result
    finds no excess there, and model dh fits none to the joints.
    """
    s = on.sensors
    length = FIRST_EXCESS.rod if s.length_sigma_m is None else s.length_sigma_m
    of_sensors = ExcessNoise(
        s.robot_sigma_rad, 2.0 * s.robot_sigma_rad, s.encoder_sigma_rad, length
    )
    fitted = on.excess or of_sensors
    if s.length_sigma_m is not None:
        fitted = ExcessNoise(*map(max, astuple(fitted), astuple(of_sensors)))
    return ExcessNoise(*(on.dilution * sigma for sigma in astuple(fitted)))


def samples_along(on: Predictor, trajectory: Passage) -> Samples:
    """The samples of a noise-free run along a trajectory, with the noise of the sensors."""
    s, f = on.sensors, on.dilution
    fitted = [j - 1 for j in on.encoders]
    moving = on.timing.duration_s - 2.0 * on.timing.dwell_s
    spacing = min(moving / DEFAULT_SAMPLES, WIDEST_KNOT_SPACING)
    robot_noise, bar_noise = (
        f * sigma * np.sqrt(min(1.0, 1.0 / (rate * spacing)))
        for sigma, rate in (
            (s.robot_noise_sigma_rad, s.robot_rate_hz),
            (s.encoder_noise_sigma_rad, s.ballbar_rate_hz),
        )
    )
    noise = np.zeros(BAR_ROWS)
    noise[fitted] = bar_noise
    t = trajectory.t
    sensed = trajectory.b[:, fitted]
    if not fitted:  # of a sensed length the second log is the rod's extension
        rod = robot_frames(trajectory.nominal, trajectory.q).tip.T - trajectory.nominal.origin
        sensed = np.linalg.norm(rod, axis=1)[:, None] - trajectory.nominal["bd3"]
    second = interpolating_log(t, sensed, np.zeros(sensed.shape[1]))
    silent = not fitted and on.cell.ballbar.stroke is None
    return Samples(
        robot=interpolating_log(t, trajectory.q, np.zeros(trajectory.q.shape[1])),
        ballbar=None if silent else second,
        encoders=on.encoders,
        directions=np.ones(len(fitted)),
        times=on.instants,
        joint_noise=np.full(on.cell.robot.joints, robot_noise),
        encoder_noise=noise,
        tension=np.zeros(on.instants.size),
        splines=on.knots if on.masses is not None else csr_array((0, on.instants.size)),
    )
