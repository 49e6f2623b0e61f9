"""Motor torques of a minute, of a machine with other loads than its files state."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.loads.gear_loads import loads, mass_model
from ballbar.ident.loads.logged_tension import LoggedTorque
from tests.helpers.known_loads import motion_at, tension_at
from tests.helpers.synthetic_recording import CELL, NOMINAL

T = np.arange(0.0, 60.0, 0.08)
GAINS = np.array([0.01, -0.02, 0.015, 0.0, -0.01, 0.02])


def logged(true: Cell, *, seed: int = 1) -> LoggedTorque:
    """Torques of a machine with other masses, friction and rotors than the files state."""
    motion, gears = motion_at(T), true.robot.required("gears")
    to_gear = true.robot.joint_to_gear
    q, b = motion.q, motion.b
    speed, acceleration = (
        np.gradient(q, T, axis=0),
        np.gradient(np.gradient(q, T, axis=0), T, axis=0),
    )
    carried, felt = (
        loads(mass_model(cell), NOMINAL, q=q, b=b, speed=speed, acceleration=acceleration)
        for cell in (CELL, true)
    )
    at_gears = (speed @ to_gear).T
    friction = 1.3 * gears.coulomb[:, None] * np.tanh(at_gears / 1e-3)
    friction += 0.6 * gears.viscous[:, None] * at_gears
    rotors = 1.4 * true.robot.required("rotor_inertia_kg_m2")[:, None] * (acceleration @ to_gear).T
    noise: Array = np.random.default_rng(seed).standard_normal(friction.shape)
    torque = (1.0 + GAINS[:, None]) * felt.gears(tension_at(T)) + friction + rotors + 0.5 * noise
    return LoggedTorque(T, torque, q, at_gears, (acceleration @ to_gear).T, carried, b)
