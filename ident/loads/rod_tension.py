"""The tension of the rod from what a log says about loads: six equations a sample, one unknown.

    y_k(t) = known_k(t) + sum_j theta_j A_jk(t) + w_k(t) F(t)

`known` are the loads of the mass model without tension, `w` those per newton of it, `A` what the
signal adds of its own: friction and gains of motor torques, biases and gains of a force sensor. F
is eliminated sample by sample, theta follows by least squares with priors, F by weighted least
squares. Motor torque near a reversal of its joint is worthless: friction jumps there
(notes/identification sec. 5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import cross
from ballbar.cell.descriptions import Cell, Key
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.ident.loads.gear_loads import Loads, mass_model, on_ballbar

# [N m] of every gear. What a law of friction leaves is as large in the wrist as in the main axes,
# and no noise: with the 0.3 N m that a wrist's log shows, tensions were found up to 9 % too small,
# and with them gears too soft (notes/identification sec. 7).
TORQUE_SIGMA = 2.0
# Keys of the robot's file without which motor torques do not tell the tension.
TORQUE_NEEDS: tuple[Key, ...] = ("links", "gears", "rotor_inertia_kg_m2")
TORQUE_GAIN = 0.02  # (notes/identification sec. 1)
TORQUE_OFFSET = 0.1  # of the Coulomb friction; assumed
# [rad/s] below it friction is no law's: wider than where it may have either sign, 0.012
# (notes/identification sec. 5), since it builds up over a travel of its own (Dahl 1968)
REVERSAL_SPEED = 0.03
STRIBECK_PRIOR = 0.3  # rise of friction towards rest, of the Coulomb friction
ROTOR_PRIOR = 1.0  # of the file's inertia; one taken as exact draws the masses
FRICTION_WIDTH = 2e-3  # [rad/s] over which the sign of a speed changes
SENSOR_GAIN = 0.01
SENSOR_NOISE = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # [N, N m]
# [N, N m] wide: a sensor is seldom zeroed
SENSOR_BIAS = np.array([20.0, 20.0, 20.0, 2.0, 2.0, 2.0])


@dataclass(frozen=True, eq=False)
class Tension:
    """Rod tension at N samples."""

    force: Array  # (N,) [N]
    sigma: Array  # (N,) [N]
    theta: Array  # (T,) friction, gains, biases
    theta_sigma: Array  # (T,)


def from_motor_torque(
    cell: Cell, torque: Array, carried: Loads, speed: Array, acceleration: Array
) -> Tension:
    """Tension from motor torques.

    torque : (J, N) [N m] at the gears' outputs. carried : loads of the mass model. speed,
    acceleration : (J, N) [rad/s, rad/s^2] of the gears. The result's theta holds J Coulomb
    torques [N m], J viscous coefficients [N m s/rad], J gain errors, J rises of the friction
    towards rest [N m], J rotor inertias at the outputs [kg m^2], J offsets [N m]. An offset is one
    of the current's measurement, or friction that differs with the direction.
    """
    j, n = torque.shape
    gears, rotors = cell.robot.required("gears"), cell.robot.required("rotor_inertia_kg_m2")
    coulomb, viscous, none = gears.coulomb, gears.viscous, np.zeros(j)
    columns = np.zeros((6, j, j, n))
    terms = (friction_sign(speed), speed, torque, stribeck_rise(cell, speed), acceleration)
    columns[:, range(j), range(j)] = (*terms, np.ones_like(speed))
    mean = (coulomb, viscous, none, none, rotors, none)
    gain, rising = np.full(j, TORQUE_GAIN), STRIBECK_PRIOR * coulomb
    offset = TORQUE_OFFSET * coulomb
    return _eliminated(
        torque - carried.gear,
        torque_sigma(cell, speed),
        columns.reshape(-1, j, n),
        carried.gear_per_newton,
        np.concatenate(mean),
        np.concatenate((coulomb, 2.0 * viscous, gain, rising, ROTOR_PRIOR * rotors, offset)),
    )


def friction_sign(speed: Array) -> Array:
    """(J, N) direction, -1 to 1, of Coulomb friction at speeds (J, N) [rad/s]."""
    return np.asarray(speed / np.sqrt(speed**2 + FRICTION_WIDTH**2))


def stribeck_rise(cell: Cell, speed: Array) -> Array:
    """(J, N) share, -1 to 1, of friction's rise towards rest at speeds (J, N) [rad/s]."""
    stribeck = cell.robot.required("gears").stribeck
    return np.asarray(friction_sign(speed) / (1.0 + (speed / stribeck[:, None]) ** 2))


def torque_sigma(cell: Cell, speed: Array) -> Array:
    """(J, N) [N m] of a logged torque at speeds (J, N) [rad/s], larger at reversals."""
    coulomb = cell.robot.required("gears").coulomb
    return np.hypot(TORQUE_SIGMA, coulomb[:, None] * np.exp(-((speed / REVERSAL_SPEED) ** 2)))


def without_tension(values: Array, sigma: Array, direction: Array) -> Array:
    """(P, J, N) whitened values less what any tension could explain of them, sample by sample.

    values : (P, J, N). sigma : (J, N). direction : (J, N) of the values per newton.
    """
    w = direction / sigma
    unit, white = w / np.linalg.norm(w, axis=0), values / sigma
    return np.asarray(white - unit * (unit * white).sum(axis=1, keepdims=True))


def from_force_sensor(wrench: Array, known: Array, direction: Array) -> tuple[Tension, float]:
    """Tension from a six-axis sensor at the flange, and the rms of its residual [sigma].

    wrench : (6, N) [N, N m] that plate and ball-bar exert on the flange, flange frame. known,
    direction : as of `on_flange`. The result's theta holds six biases [N, N m], six gain errors.
    """
    columns = np.zeros((12, 6, wrench.shape[1]))
    for k in range(6):
        columns[k, k], columns[6 + k, k] = 1.0, wrench[k]
    prior = np.concatenate((SENSOR_BIAS, np.full(6, SENSOR_GAIN)))
    sigma = np.repeat(SENSOR_NOISE[:, None], wrench.shape[1], axis=1)
    tension = _eliminated(wrench - known, sigma, columns, direction, np.zeros(12), prior)
    left = (
        wrench - known - np.einsum("j,jkn->kn", tension.theta, columns) - direction * tension.force
    ) / sigma
    return tension, float(np.sqrt((left * left).mean()))


def on_flange(cell: Cell, geometry: Geometry, q: Array, b: Array) -> tuple[Array, Array]:
    """Wrench on the flange, flange frame: (6, N) [N, N m] without tension, and per newton of it.

    q (N, J), b (N, 5) : [rad] angles of robot and ball-bar.
    """
    masses = mass_model(cell)
    robot, bar = robot_frames(geometry, q), bar_frames(geometry, b)
    axes = np.stack((robot.x[-1], robot.y[-1], robot.z[-1]))
    from_flange = cell.plate.length * robot.x[-1] + cell.plate.tool_offset * robot.z[-1]
    out = []
    for on_bar in on_ballbar(masses, bar, b):
        force = -on_bar[:3]
        moment = cross(from_flange, force) - on_bar[3:]
        out.append(np.concatenate([(axes * part).sum(axis=1) for part in (force, moment)]))
    weight = cell.plate.mass * np.einsum("ijn,j->in", axes, masses.gravity)
    out[0] += np.concatenate((weight, np.cross(cell.plate.body.com, weight.T).T))
    return out[0], out[1]


def _eliminated(
    y: Array, sigma: Array, columns: Array, direction: Array, mean: Array, prior: Array
) -> Tension:
    white, w = y / sigma, direction / sigma
    design = without_tension(columns, sigma, direction)
    rest = without_tension(y[None], sigma, direction)[0]
    flat = design.reshape(len(columns), -1)
    normal = flat @ flat.T + np.diag(prior**-2.0)
    theta = mean + np.linalg.solve(normal, flat @ (rest.reshape(-1) - mean @ flat))
    left = white - np.einsum("j,jkn->kn", theta, columns / sigma)
    weight = (w * w).sum(axis=0)
    return Tension(
        (w * left).sum(axis=0) / weight,
        1.0 / np.sqrt(weight),
        theta,
        np.sqrt(np.diag(np.linalg.inv(normal))),
    )
