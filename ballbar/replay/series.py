"""The curves of a recording: angles, residuals, TCP error, rod force and elongation, clock.

The unit of each stands in the entity's name. The truth of a simulated run is its true tool, beside
the identified and the nominal one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, islice

import numpy as np
import rerun as rr

from ballbar import figure_style
from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.cell.rigid_fit import kabsch
from ballbar.ident.result import RecordingEstimate, RobotEstimate
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.replay import entities
from ballbar.report.colours import (
    AFTER_COLOUR,
    BEFORE_COLOUR,
    LINES,
    TRUE_COLOUR,
    WARNING_COLOUR,
    Colour,
    shades,
)
from ballbar.report.motion import CellMotion, mechanism_angles, on_robot_clock, thinning
from ballbar.result.run_data import FittedRecording
from ballbar.sim.simulate import Simulation
from ballbar.units import MS, UM, URAD, US


@dataclass(frozen=True, eq=False)
class Series:
    """Curves of one plot."""

    t: Array  # (N,) [s] robot's clock
    values: Array  # (N, C), unit as in the entity's name
    names: Sequence[str]  # (C,) as the legend shows them
    colours: Sequence[Colour]  # (C,)


def _residual_series(estimate: RecordingEstimate, *, angles: bool) -> dict[str, Series]:
    """Loop-closure error before and after; angles : whether there are any: a length sees none."""
    series = {}
    for entity, residuals, colour in (
        (entities.BEFORE, estimate.before, figure_style.BEFORE),
        (entities.AFTER, estimate.after, figure_style.AFTER),
    ):
        t, when = on_robot_clock(estimate, residuals.t), entity.rpartition("/")[2]
        style = [f"{axis} {when}" for axis in "xyz"], shades(colour)
        series[f"{entity}/{entities.POSITION}"] = Series(t, residuals.position * UM, *style)
        if angles:
            series[f"{entity}/{entities.ANGLE}"] = Series(t, residuals.angle * URAD, *style)
    return series


def recording_series(
    fitted: FittedRecording, motion: CellMotion, robot: RobotEstimate
) -> dict[str, Series]:
    """Every plot of a recording that needs no truth, by entity."""
    estimate, log = fitted.estimate, fitted.recording.ballbar_log
    joints = [f"q{i + 1}" for i in range(motion.q.shape[1])]
    colours = list(islice(cycle(LINES), len(joints)))
    series = {entities.JOINTS: Series(motion.t, np.degrees(motion.q), joints, colours)}
    if log is not None:
        rows = np.arange(0, log.t.size, thinning(log.t))
        series[entities.ENCODERS] = Series(
            on_robot_clock(estimate, log.t[rows]),
            np.degrees(mechanism_angles(estimate, log)[rows]),
            [f"b{joint}" for joint in log.joints],
            [LINES[joint - 1] for joint in log.joints],
        )
    series |= _residual_series(estimate, angles=fitted.recording.length_log is None)
    if estimate.clock is not None:
        offset = motion.t - estimate.clock.ballbar_time(motion.t)
        series[entities.CLOCK_IDENTIFIED] = _curve(
            motion.t, offset * MS, "identified", AFTER_COLOUR
        )
    return series | _rod_series(estimate, robot)


def truth_series(
    simulation: Simulation, estimate: RecordingEstimate, truth: TrueTool, t: Array
) -> dict[str, Series]:
    """The plots of a simulated recording against the truth, at instants t (N,) [s]."""
    before, after = (
        np.linalg.norm(error, axis=1) * UM
        for error in (truth.nominal_error, truth.identified_error)
    )
    series = {
        entities.TCP_BEFORE: _curve(t, before, "nominal", BEFORE_COLOUR),
        entities.TCP_AFTER: _curve(t, after, "identified", AFTER_COLOUR),
    }
    if truth.rod_force.any():  # a kinematic plant knows no forces
        series[entities.FORCE_TRUE] = _curve(t, truth.rod_force, "true", TRUE_COLOUR)
    if truth.rod_force.any() and simulation.instrument is None:
        series[entities.STRAIN_TRUE] = _curve(t, truth.rod_strain * UM, "true", TRUE_COLOUR)
    return series | clock_error_series(simulation, estimate, t)


def clock_error_series(
    simulation: Simulation, estimate: RecordingEstimate, t: Array
) -> dict[str, Series]:
    """True clock offset, and the error of the identified one, at instants t (N,) [s].

    The offset is the robot's time minus the ball-bar's, each counted from the first row of its log.
    """
    if estimate.clock is None:
        return {}
    times = simulation.times
    stamps = (times.bar_stamp - times.bar_stamp[0]) * 1e-9
    true_time = np.interp(t, times.robot_stamp - times.robot_stamp[0], times.robot_true)
    inside = (true_time >= times.bar_true[0]) & (true_time <= times.bar_true[-1])
    t = t[inside]
    actual = t - np.interp(true_time[inside], times.bar_true, stamps)
    error = t - estimate.clock.ballbar_time(t) - actual
    return {
        entities.CLOCK_TRUE: _curve(t, actual * MS, "true", TRUE_COLOUR),
        entities.CLOCK_ERROR: _curve(t, error * US, "identified minus true", WARNING_COLOUR),
    }


def _curve(t: Array, values: Array, name: str, colour: Colour) -> Series:
    return Series(t, values[:, None], [name], [colour])


def _rod_series(estimate: RecordingEstimate, robot: RobotEstimate) -> dict[str, Series]:
    """Force and elongation of the rod by the complete model; elongation without backlash."""
    if estimate.tension is None:
        return {}
    t, force = on_robot_clock(estimate, estimate.after.t), estimate.tension
    series = {entities.FORCE_IDENTIFIED: _curve(t, force, "identified", AFTER_COLOUR)}
    for coefficient in (c for correction in robot.corrections for c in correction.coefficients):
        if coefficient.name == "rod_compliance":
            elongation = coefficient.value * force * UM
            series[entities.STRAIN_IDENTIFIED] = _curve(t, elongation, "identified", AFTER_COLOUR)
    return series


def log_series(stream: entities.Branch, entity: str, series: Series) -> None:
    """Writes the curves of one plot."""
    # MinMax: zoomed out, the viewer would draw averages, and hide a single bad sample
    style = rr.SeriesLines(names=series.names, colors=series.colours, aggregation_policy="MinMax")
    stream.log(entity, style, static=True)
    columns = rr.Scalars.columns(scalars=series.values)
    stream.send_columns(entity, indexes=entities.at(series.t), columns=columns)


@dataclass(frozen=True, eq=False)
class TrueTool:
    """True tool position, and the errors of two models at the true joint angles, bases aligned."""

    position: Array  # (N, 3) [m] carried into the base frame of the identified robot
    nominal_error: Array  # (N, 3) [m] nominal robot's tool position minus the true one
    identified_error: Array  # (N, 3) [m]
    rod_force: Array  # (N,) [N] tension positive
    rod_strain: Array  # (N,) [m] axial elongation of the rod


def true_tool(simulation: Simulation, estimate: RecordingEstimate, t: Array) -> TrueTool:
    """The truth at instants t (N,) [s] of the robot's clock."""
    times = simulation.times
    true_time = np.interp(t, times.robot_stamp - times.robot_stamp[0], times.robot_true)
    q = simulation.motion.shown_at(true_time)
    truth, grid = simulation.truth.geometry, accuracy_grid(simulation.cell.robot)
    actual = robot_frames(truth, q).tip.T
    rotation, shift = base_alignment(estimate.geometry, truth, grid)
    nominal_rotation, nominal_shift = base_alignment(estimate.nominal, truth, grid)
    nominal = robot_frames(estimate.nominal, q).tip.T @ nominal_rotation.T + nominal_shift
    return TrueTool(
        position=(actual - shift) @ rotation,
        nominal_error=nominal - actual,
        identified_error=robot_frames(estimate.geometry, q).tip.T @ rotation.T + shift - actual,
        rod_force=np.interp(true_time, simulation.motion.t, simulation.motion.rod_force),
        rod_strain=np.interp(true_time, simulation.motion.t, simulation.motion.rod_stretch),
    )


def base_alignment(model: Geometry, truth: Geometry, grid: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and shift (3,) [m] that carry the model's base frame onto the true one.

    The best over joint angles grid (G, 6) [rad]. Without it a gauge would show as an error:
    parameters held fixed (`rd1`, `rtheta1`) leave the base where it is not.
    """
    predicted, actual = robot_frames(model, grid).tip.T, robot_frames(truth, grid).tip.T
    rotation = kabsch(predicted - predicted.mean(axis=0), actual - actual.mean(axis=0))
    return rotation, actual.mean(axis=0) - rotation @ predicted.mean(axis=0)
