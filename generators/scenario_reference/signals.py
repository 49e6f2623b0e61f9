"""Signals that a plot shows of a view, (N,) or (N, K), in display units; joints count from 1."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.sim.logging.load_logs import motor_torques, sensor_rows, tracker_rows
from generators.scenario_reference.runs import View

Signal = Callable[[View], Array]


def time(view: View) -> Array:
    """Times of the view [s]."""
    return view.t


def residual_mm(view: View) -> Array:
    """(N, 3) [mm] tool by the ball-bar's log minus tool by the robot's."""
    return 1e3 * view.residual


def residual_um(view: View) -> Array:
    """(N, 3) [um] tool by the ball-bar's log minus tool by the robot's."""
    return 1e6 * view.residual


def logged_gear_deg(gear: int) -> Signal:
    """Output of one gear by the log [deg]."""
    return lambda view: np.degrees(view.gears[:, gear - 1])


def behind_gear_urad(gear: int) -> Signal:
    """True turn of one gear minus that of the log [urad]."""
    return lambda view: 1e6 * view.behind_gears[:, gear - 1]


def torque(gear: int) -> Signal:
    """Torque of one servo, at its gear's output [N m]."""
    return lambda view: view.torque[:, gear - 1]


def gear_speed(gear: int) -> Signal:
    """Speed of one gear's output by the log [deg/s]."""
    return lambda view: np.degrees(np.gradient(view.gears[:, gear - 1], view.t))


def robot_angle(joint: int, scale: float) -> Signal:
    """One joint angle by the robot's log, [rad] times scale."""
    return lambda view: scale * view.q[:, joint - 1]


def bar_angle(joint: int, scale: float) -> Signal:
    """One ball-bar angle by the log, [rad] times scale."""
    return lambda view: scale * view.b[:, joint - 1]


def true_bar_deg(joint: int) -> Signal:
    """One ball-bar angle as the ball-bar stands [deg]."""
    return lambda view: np.degrees(view.true_angles[1][:, joint - 1])


def bar_error_urad(joint: int) -> Signal:
    """One ball-bar angle, logged minus true [urad]."""
    return lambda view: 1e6 * (view.b[:, joint - 1] - view.true_angles[1][:, joint - 1])


def counts(joint: int) -> Signal:
    """One ball-bar angle by the log [counts]."""
    return lambda view: (
        view.b[:, joint - 1] * (view.simulation.encoders[joint - 1].counts_per_turn / (2.0 * np.pi))
    )


def signal_frequency(joint: int) -> Signal:
    """Frequency of one ball-bar encoder's signal [Hz]."""

    def frequency(view: View) -> Array:
        speed = np.gradient(view.true_angles[1][:, joint - 1], view.t)
        return np.asarray(np.abs(speed) * view.simulation.encoders[joint - 1].lines / (2.0 * np.pi))

    return frequency


def weak_signal(joint: int) -> Signal:
    """Status bits of a weak signal of one ball-bar encoder, 0 or 1."""
    return lambda view: (
        view.simulation.encoders[joint - 1].effects.weak_signal(view.t).astype(np.float64)
    )


def rod_force(view: View) -> Array:
    """[N] tension positive."""
    return view.rod_force


def rod_stretch_um(view: View) -> Array:
    """Stretch of the rod [um]."""
    return 1e6 * view.rod_stretch


def bar_row_time(view: View) -> Array:
    """True times of the ball-bar's rows, lost ones too [s]."""
    return view.simulation.times.bar_true


def robot_row_time(view: View) -> Array:
    """True times of the robot's rows, lost ones too [s]."""
    return view.simulation.times.robot_true


def clock_difference(scale: float) -> Signal:
    """t_robot - t_bar of the rows of the ball-bar's log, each from the first row of its log."""

    def difference(view: View) -> Array:
        times = view.simulation.times
        t_bar = (times.bar_stamp - times.bar_stamp[0]).astype(np.float64) * 1e-9
        return np.asarray(np.round(scale * (times.bar_true - times.robot_true[0] - t_bar), 9))

    return difference


def stamp_error(scale: float) -> Signal:
    """Stamp minus true time of the rows of the robot's log, both from the first row."""

    def error(view: View) -> Array:
        times = view.simulation.times
        return np.asarray(
            scale
            * (times.robot_stamp - times.robot_stamp[0] - times.robot_true + times.robot_true[0])
        )

    return error


def robot_file_time(view: View) -> Array:
    """True times of the rows in the robot's file, but the first [s]."""
    rows = view.simulation.rows.robot
    return np.asarray(view.simulation.times.robot_true[rows[1:]])


def robot_file_interval_ms(view: View) -> Array:
    """Stamp of each row in the robot's file minus that of the row before [ms]."""
    rows = view.simulation.rows.robot
    return np.asarray(1e3 * np.diff(view.simulation.times.robot_stamp[rows]))


def _bar_file_rows(view: View) -> Array:
    return np.concatenate(view.simulation.rows.ballbar)


def bar_file_time(view: View) -> Array:
    """True times of the rows in the ball-bar's files, but the first [s]."""
    return np.asarray(view.simulation.times.bar_true[_bar_file_rows(view)[1:]])


def bar_file_interval_ms(view: View) -> Array:
    """Stamp of each row in the ball-bar's files minus that of the row before [ms]."""
    return np.asarray(
        1e-6 * np.diff(view.simulation.times.bar_stamp[_bar_file_rows(view)]).astype(np.float64)
    )


def logged_and_true_torque(view: View) -> Array:
    """(N, 2) [N m at the motor] of axis 1."""
    log, robot = view.run.settings.logs.torque, view.simulation.cell.robot
    assert log is not None
    logged = motor_torques(
        robot,
        view.simulation.motion,
        view.t,
        log=log,
        drawn=view.simulation.truth.logs.loads,
        seed=view.run.settings.seed,
    )[:, 0]
    return np.stack((logged, view.torque[:, 0] * robot.transmission[0, 0]), axis=1)


def sensor_time(view: View) -> Array:
    """Stamps of the force sensor's rows, the first at 1 s [s]."""
    stamps, _ = _sensor(view)
    return np.asarray(stamps - stamps[0] + 1.0)


def sensor_force_and_truth(view: View) -> Array:
    """(N, 2) [N] along the flange's x."""
    _, readings = _sensor(view)
    motion = view.simulation.motion
    assert motion.wrench is not None
    return np.stack(
        (readings[:, 0], np.interp(sensor_time(view), motion.t, motion.wrench[:, 0])), axis=1
    )


def _sensor(view: View) -> tuple[Array, Array]:
    sensor = view.run.settings.logs.force_sensor
    assert sensor is not None
    return sensor_rows(
        view.simulation.motion,
        1.0 - sensor.offset_s,
        59.0,
        sensor=sensor,
        drawn=view.simulation.truth.logs.loads,
        seed=view.run.settings.seed,
    )


def tracker_time(view: View) -> Array:
    """Stamps of the tracker's rows, the first at 1 s [s]."""
    stamps, _ = _tracker(view)
    return np.asarray(stamps - stamps[0] + 1.0)


def tracker_error_um(view: View) -> Array:
    """Measured minus true x of the LED [um]."""
    return np.asarray((_tracker(view)[1] - _tracker(view, noise_m=0.0)[1])[:, 0] * 1e6)


def _tracker(view: View, **changes: float) -> tuple[Array, Array]:
    tracker, drawn = view.run.settings.logs.tracker, view.simulation.truth.logs.tracker
    assert tracker is not None
    assert drawn is not None
    first = 1.0 - tracker.offset_s
    chosen, seed = tracker.model_copy(update=changes), view.run.settings.seed
    return tracker_rows(
        view.simulation.motion, (first, 59.0), tracker=chosen, drawn=drawn, seed=seed
    )
