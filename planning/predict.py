"""What a course will tell: standard deviations of all parameters and of the tool, before anyone goes to the cell.

The Cramer-Rao bound of the complete model that `ballbar identify` fits (ident.estimator.joint_fit: geometry, clock, corrections with their
priors, the rod's tension as a spline), at samples of the course as a noise-free run would give them. The information of a sample
does not depend on how many are computed, so some hundreds stand for the 1500 that are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cell.arrays import Array
from cell.clock import Clock
from cell.descriptions import Cell
from cell.geometry import BAR_ROWS, Geometry
from ident.complete_fit import FIRST_EXCESS
from ident.corrections import CORRECTIONS
from ident.corrections.base import Correction
from ident.estimator.gauss_newton import inverse
from ident.estimator.model import Evaluation, Model, gearing
from ident.estimator.noise import ExcessNoise
from ident.estimator.normal_equations import normal_equations
from ident.estimator.samples import DWELL_KEPT, Samples
from ident.estimator.unknowns import RecordingStart, Unknowns, complete_unknowns
from ident.loads.gear_loads import MassModel, mass_model
from ident.loads.logged_tension import tension_splines
from ident.options import DEFAULT_SAMPLES
from ident.recording_fit import WIDEST_KNOT_SPACING
from ident.robot.accuracy import accuracy_grid, position_sigma
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.smooth_log import interpolating_log
from planning.course import Course
from planning.request import PlanSensors, PlanTiming, Workspace

EXACT = 1e-9  # [m]
SAMPLES = (
    240  # computed, of DEFAULT_SAMPLES fitted; sigma comes out a few percent above that of all
)


@dataclass(frozen=True, eq=False)
class Predictor:
    """What does not depend on the course."""

    cell: Cell
    masses: MassModel
    sensors: PlanSensors
    timing: PlanTiming
    corrections: tuple[Correction, ...]
    grid: Array  # (G, 6) [rad] poses over which the TCP error counts
    samples: int = SAMPLES

    @property
    def instants(self) -> Array:
        """(N,) [s] of the samples: from just before the robot moves to just after."""
        margin = self.timing.dwell_s - DWELL_KEPT
        return np.linspace(margin, self.timing.duration_s - margin, self.samples)

    @cached_property
    def knots(self) -> csr_array:
        """(K, N) splines of the tension at the samples."""
        return tension_splines(self.instants)

    @cached_property
    def to_knots(self) -> Array:
        """(K, N) least-squares spline of a tension at the samples."""
        return np.asarray(np.linalg.pinv(self.knots.toarray().T))

    @property
    def dilution(self) -> float:
        """Factor on every deviation of noise, so that the samples computed say what those fitted do."""
        return float(np.sqrt(self.samples / DEFAULT_SAMPLES))


@dataclass(frozen=True, eq=False)
class Prediction:
    """What one course tells of one robot."""

    layout: Unknowns
    model: Model
    normal: Array  # (P, P)
    points: tuple[Evaluation, ...]
    geometry: Geometry
    free: UnloadedRobot
    grid: Array

    @cached_property
    def covariance(self) -> Array:
        """(P, P)"""
        return inverse(self.normal)

    @property
    def sigma(self) -> dict[str, float]:
        """[SI] of every unknown but the tension's knots."""
        spread = np.sqrt(np.diag(self.covariance))
        return {
            n: float(v)
            for n, v in zip(self.layout.names, spread, strict=True)
            if not n.startswith("tension")
        }

    @cached_property
    def tcp_sigma(self) -> Array:
        """(G,) [m] of the free robot's tool under its own weight, base aligned."""
        moved = moving(self.layout)
        moves = self.free.jacobian(self.grid, self.layout.shared)
        return position_sigma(
            self.free.tool(self.grid), moves, self.covariance[np.ix_(moved, moved)]
        )


def moving(layout: Unknowns) -> NDArray[np.intp]:
    """Indices of the unknowns that `UnloadedRobot.jacobian` has columns for."""
    return np.asarray(np.r_[0 : layout.shared.size, layout.coefficients], dtype=np.intp)


def predictor(
    cell: Cell,
    sensors: PlanSensors,
    timing: PlanTiming,
    workspace: Workspace | None,
    *,
    samples: int = SAMPLES,
) -> Predictor:
    """For a cell, its sensors, and the workspace that counts."""
    grid = accuracy_grid(cell.robot)
    if workspace is not None:
        box = replace(
            cell.robot,
            accuracy_lower=np.radians(workspace.lower_deg),
            accuracy_upper=np.radians(workspace.upper_deg),
        )
        grid = accuracy_grid(box)
    made = tuple(make(cell, sensors.encoders) for make in CORRECTIONS.values())
    return Predictor(cell, mass_model(cell), sensors, timing, made, grid, samples)


def planned_unknowns(
    on: Predictor, nominal: Geometry, recordings: Sequence[RecordingStart]
) -> tuple[Unknowns, Array]:
    """Those of the complete model, the plate's length taken as exact.

    `ba5` is that length in other words (ra6 against it): 5 um are 20 ppm of scale whatever the path, stated apart (planning.plan).
    """
    layout, x = complete_unknowns(
        on.cell,
        nominal,
        recordings,
        on.corrections,
        measured_force=False,
        rod_sigma=on.sensors.rod_sigma_m,
    )
    sigma = layout.sigma.copy()
    sigma[layout.names.index("ba5")] = EXACT
    return replace(layout, sigma=sigma), x


def predict(
    on: Predictor, course: Course, tension: Array, near: Prediction | None = None
) -> Prediction:
    """Of a course with a rod tension (N_course,) [N]. near : of the same course with another tension, whose loads per newton are taken."""
    samples = _samples(on, course)
    begin = RecordingStart(
        samples.encoders, course.nominal, Clock(0.0, 0.0), samples.splines.shape[0]
    )
    layout, x = planned_unknowns(on, course.nominal, [begin])
    knots, t = layout.own[0].knots, samples.times
    if knots is not None:
        x[knots] = on.to_knots @ np.interp(t, course.t, tension)
    model = Model(gearing(on.cell), on.masses, on.corrections, layout, (samples,))
    bar = np.stack([np.interp(t, course.t, angle) for angle in course.b.T], axis=1)
    previous = near.points if near else ()
    linear = normal_equations(model, x, [bar], _excess(on), previous=previous)
    free = UnloadedRobot(on.cell, course.nominal, on.corrections, x[layout.coefficients])
    return Prediction(
        layout, model, linear.normal, linear.evaluations, course.nominal, free, on.grid
    )


def predictions(on: Predictor, course: Course, tensions: Array) -> tuple[Prediction, ...]:
    """Of a course with each of the rod tensions (R, N_course) [N]."""
    found: list[Prediction] = []
    for tension in tensions:
        found.append(predict(on, course, tension, found[0] if found else None))
    return tuple(found)


def _excess(on: Predictor) -> ExcessNoise:
    f, s = on.dilution, on.sensors
    return ExcessNoise(
        f * s.robot_sigma_rad,
        2.0 * f * s.robot_sigma_rad,
        f * s.encoder_sigma_rad,
        f * FIRST_EXCESS.rod,
    )


def _samples(on: Predictor, course: Course) -> Samples:
    """The samples of a noise-free run along a course, with the noise of the sensors."""
    s, f = on.sensors, on.dilution
    fitted = [j - 1 for j in s.encoders]
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
    robot = interpolating_log(course.t, course.q, np.zeros(course.q.shape[1]))
    return Samples(
        robot=robot,
        ballbar=interpolating_log(course.t, course.b[:, fitted], np.zeros(len(fitted))),
        encoders=s.encoders,
        directions=np.ones(len(fitted)),
        times=on.instants,
        joint_noise=np.full(6, robot_noise),
        encoder_noise=noise,
        tension=np.zeros(on.instants.size),
        splines=on.knots,
    )
