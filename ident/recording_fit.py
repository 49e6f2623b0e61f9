"""One recording fitted by kinematics alone: smooth, start, identifiable subset, whitened fit.

It is the result of the `dh` model, and where the complete model starts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, nominal_geometry
from ballbar.cell.inverse import UnreachableError
from ballbar.cell.logs import BallBarLog, ForceLog, LengthLog, RobotLog, TrackerLog
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.identifiability import Identifiability, candidates, identifiable
from ballbar.ident.estimator.model import Model, joints_as_logged
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.priors import declared_names, of_robot, priors, with_tails
from ballbar.ident.estimator.sample_times import sample_times
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.estimator.variance_components import rod_deviation
from ballbar.ident.loads.rod_tension import TORQUE_NEEDS
from ballbar.ident.options import SILENT, FitOptions, ForceSource, Listener
from ballbar.ident.signals.smooth_log import SmoothLog, motion_of
from ballbar.ident.start.automatic import Hypothesis, Start, StartError, automatic_start

BEYOND = 0.010  # [m] rms of what kinematics leave; all that corrections explain is below 1 mm
ROD_SIGMA_START = 2e-6  # [m] 36 N on 1.8e7 N/m, until the residuals say better


@dataclass(frozen=True, eq=False)
class Logs:
    """The logs of one recording, as read."""

    robot: RobotLog
    ballbar: BallBarLog | None  # None for a ball-bar without encoders
    force: ForceLog | None = None  # of a sensor at the flange
    name: str = ""
    length: LengthLog | None = None  # of a telescoping bar or a draw-wire, in place of `ballbar`
    tracker: TrackerLog | None = None  # beside a ball-bar; by itself it is start.followed's

    def force_source(self, requested: ForceSource, robot: Robot) -> str:
        """Source of the rod's tension: `sensor`, `torque`, `none`, or `instrument` of a length.

        Motor torques tell it only of a robot whose masses, friction and rotors are known.
        """
        if self.length is not None:
            return "instrument"
        if requested in ("auto", "sensor") and self.force is not None:
            return "sensor"
        known = not any(robot.lacks(key) for key in TORQUE_NEEDS)
        if requested == "torque" or (requested == "auto" and known):
            return "none" if self.robot.torque is None else "torque"
        return "none"


@dataclass(frozen=True, eq=False)
class RecordingFit:
    """One recording fitted with the `dh` model."""

    logs: Logs
    nominal: Geometry
    start: Start
    subset: Identifiability
    fit: Fit
    iterations: int  # of the chosen hypothesis and the fits together

    @property
    def samples(self) -> Samples:
        return self.fit.model.recordings[0]

    @property
    def geometry(self) -> Geometry:
        return self.fit.geometry()

    @property
    def as_built(self) -> Geometry:
        """The fitted geometry with the robot's lengths of its file, for the loads of gears.

        Kinematics alone stretch the lengths of a large robot that sags by up to 14 mm, all by one
        factor; built ones are off by 1 mm.
        """
        every = [p for p in self.nominal.table.parameters if p.side == "robot" and p.is_length]
        return self.geometry.replaced({p.name: self.nominal[p.name] for p in every})

    @property
    def clock(self) -> Clock:
        return self.fit.clock()


def fit_recording(
    cell: Cell,
    logs: Logs,
    options: FitOptions,
    listener: Listener = SILENT,
    *,
    known: Hypothesis | None = None,
) -> RecordingFit:
    """The `dh` fit of one recording; known : how its logs are to be read, which is searched else.

    Raises StartError when its logs cannot be brought together, InputError for the log of a robot
    with another number of axes.
    """
    axes, stated = logs.robot.q.shape[1], cell.robot.joints
    if axes != stated:
        raise InputError(
            f"the robot's log has {axes} joint angles, robot {cell.robot.name} has {stated} axes. "
            "Name the robot that was recorded."
        )
    listener.progress("smoothing both logs")
    robot, ballbar, encoders = smoothed(logs, cell.ballbar.length)
    excess = ExcessNoise(rod=ROD_SIGMA_START)
    nominal = nominal_geometry(cell, np.zeros(3))
    listener.progress("aligning the logs and finding the ball-bar")
    spacing = (robot.end - robot.start) / options.samples
    start = automatic_start(
        robot,
        ballbar,
        encoders,
        nominal,
        excess,
        spacing=spacing,
        zero_sigma=cell.ballbar.length_tolerance,
        known=known,
    )
    chosen = start.chosen
    listener.progress("fitting")
    times = sample_times(robot, ballbar, chosen.fit.clock(), options.samples)
    directions, first_spacing = chosen.hypothesis.directions, float(times[1] - times[0])
    samples = samples_of(robot, ballbar, encoders, directions, times, spacing=first_spacing)
    geometry, clock = chosen.fit.geometry(), chosen.fit.clock()
    if samples.measures_length:
        samples = samples.with_noise_held(clock)
    try:
        requested = candidates(nominal.table, encoders, declared=declared_names(cell))
        subset = identifiable_parameters(samples, geometry, clock, excess, nominal, requested)
    except UnreachableError as error:
        raise StartError(str(error)) from None
    fitted, free = np.concatenate((subset.parameters, subset.weak)), subset.parameters
    prior = priors(cell, nominal.table, fitted)
    if samples.measures_length:
        free = np.array([i for i in free if np.isinf(prior[fitted == i][0])])
    else:
        prior[: free.size] = np.inf
    begin = _on_nominal(geometry, nominal, free)  # the means of the priors are nominal
    first = fit_kinematics(samples, begin, clock, fitted, excess, prior_sigma=prior)
    if samples.measures_length:
        samples = samples.with_noise_held(first.clock())
    iterations = chosen.fit.iterations + first.iterations
    if is_beyond(first):  # of no robot: other noise would not help
        return RecordingFit(logs, nominal, start, subset, first, iterations)
    off = (first.geometry().values - nominal.values)[fitted]
    own = of_robot(nominal.table, [nominal.table.parameters[i] for i in fitted])
    final = fit_kinematics(
        samples,
        _on_nominal(first.geometry(), nominal, free),
        first.clock(),
        fitted,
        ExcessNoise(rod=rod_deviation(first)),
        prior_sigma=np.where(own, with_tails(prior, off), prior),
    )
    iterations += final.iterations
    return RecordingFit(logs, nominal, start, subset, final, iterations)


def is_beyond(fit: Fit) -> bool:
    """Whether a fit of kinematics ended nowhere, far beyond the size of any correction."""
    return not fit.converged and rms(fit.linear.evaluations[0].closure.error[:3]) > BEYOND


def smoothed(
    logs: Logs, rod_length: float = 0.0
) -> tuple[SmoothLog, SmoothLog | None, tuple[int, ...]]:
    """Both logs as splines, and the encoders of the ball-bar.

    A sensed length is given as the rod's extension [m] beyond its nominal `rod_length` [m].
    """
    robot = motion_of(logs.robot, logs.robot.q)
    if logs.length is not None:
        return robot, motion_of(logs.length, logs.length.length[:, None] - rod_length), ()
    if logs.ballbar is None:
        return robot, None, ()
    return robot, motion_of(logs.ballbar, logs.ballbar.angles), logs.ballbar.joints


def nominal_robot_fit(recording: RecordingFit, samples: Samples) -> Fit:
    """The nominal robot with encoder offsets, base position and clock fitted to samples of it.

    What a user without calibration would see.
    """
    fit = recording.fit
    own = candidates(recording.nominal.table, samples.encoders)[: len(samples.encoders) + 3]
    begin = _on_nominal(recording.geometry, recording.nominal, own)
    return fit_kinematics(samples, begin, recording.clock, own, fit.excess, negligible=1e-2)


def identifiable_parameters(
    samples: Samples,
    geometry: Geometry,
    clock: Clock,
    excess: ExcessNoise,
    nominal: Geometry,
    requested: NDArray[np.intp] | None = None,
) -> Identifiability:
    """The parameters that a recording determines, at an estimate of geometry and clock.

    nominal : catalogue geometry. requested : indices into the table; by default those of the
    thesis (ballbar.ident.estimator.identifiability.candidates). Raises UnreachableError when the
    nominal robot reaches none of the poses.
    """
    seen = clock if samples.has_clock else None
    layout, x = kinematic_unknowns(geometry, seen, np.zeros(0, dtype=np.intp))
    model = Model(joints_as_logged(nominal.table.joints), None, (), layout, (samples,))
    point = model.evaluate(x, 0, samples.ballbar_angles(geometry, clock))
    if requested is None:
        requested = candidates(nominal.table, samples.encoders)
    return identifiable(point, excess, nominal, requested)


def _on_nominal(geometry: Geometry, nominal: Geometry, parameters: NDArray[np.intp]) -> Geometry:
    """The nominal geometry with the fitted parameters and the base position of an estimate."""
    values = nominal.values.copy()
    taken = [*parameters, *(nominal.table.index[name] for name in ("ox", "oy", "oz"))]
    values[taken] = geometry.values[taken]
    return nominal.with_values(values)
