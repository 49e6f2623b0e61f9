"""Logs of the minute as a reader would hand them over: both clocks, white noise, planted faults."""

from __future__ import annotations

import numpy as np

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import BallBarLog, RobotLog
from ballbar.ident.corrections.gear_ripple import harmonic_orders
from ballbar.ident.recording_fit import Logs
from ballbar.sim.errors.static_errors import THESIS_3_1
from tests.helpers.known_loads import motion_at, tension_at
from tests.helpers.synthetic_recording import CELL, NOMINAL, UNIVERSAL_AND_GIMBAL, closed, minute

LATE = Clock(0.4, 2e-5)  # the ball-bar's log begins 0.4 s after the robot's
NOISE = 1e-5  # [rad] of every row
TRUE = NOMINAL.replaced({name: NOMINAL[name] + e * 1e-3 for name, e in THESIS_3_1.items()})


def minute_logs(
    *,
    encoders: tuple[int, ...] = UNIVERSAL_AND_GIMBAL,
    true: Geometry = NOMINAL,
    compliance: float = 0.0,
    ripple: float = 0.0,
    joint_error: tuple[int, float, float] | None = None,
    slip: tuple[int, float, float] | None = None,
    torque: bool = False,
    robot_noise: float = NOISE,
    seed: int = 0,
    name: str = "",
) -> Logs:
    """Both logs in rows of 10 ms.

    compliance : of the gears, in units of the catalogue's, under `known_loads.tension_at`.
    ripple : [rad] amplitude of the first listed harmonic. joint_error : gear from 0, cycles a turn
    and amplitude [rad] of one more. slip : joint, time on the ball-bar's
    clock [s] and size [rad] of an encoder's slip. torque : whether motor torques are logged.
    robot_noise : [rad] white, of every joint; that of the encoders is NOISE.
    """
    rng, path = np.random.default_rng(seed), minute(0.01)
    motion = motion_at(path.t)
    lag = (
        compliance / CELL.robot.gears.stiffness[:, None] * motion.carried.gears(tension_at(path.t))
    )
    q = closed(true, path.b, path.q) + lag.T @ CELL.robot.gear_to_joint
    gears = q @ CELL.robot.joint_to_gear
    gear, order, _ = harmonic_orders(CELL.robot)[0]
    gears[:, gear] -= ripple * np.sin(order * gears[:, gear])
    if joint_error is not None:
        gear, order, amplitude = joint_error
        gears[:, gear] -= amplitude * np.sin(order * gears[:, gear])
    q = gears @ CELL.robot.gear_to_joint + robot_noise * rng.standard_normal(q.shape)
    torques = motion.torque(tension_at(path.t)).T.copy() if torque else None
    robot = RobotLog(path.t, q, torque=torques)
    if not encoders:
        return Logs(robot, None, name=name)
    rows = path.t >= LATE.offset - 1e-9
    t = LATE.ballbar_time(path.t[rows])
    b = path.b[rows] + NOISE * rng.standard_normal((t.size, 5))
    if slip is not None:
        joint, at, size = slip
        b[t >= at, joint - 1] += size
    return Logs(robot, BallBarLog(t, b[:, [j - 1 for j in encoders]], encoders), name=name)
