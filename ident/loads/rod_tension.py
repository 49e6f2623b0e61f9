"""The tension of the rod from what a log says about loads: six equations a sample, one unknown.

    y_k(t) = known_k(t) + sum_j theta_j A_jk(t) + w_k(t) F(t)

`known` are the loads of the mass model without tension, `w` those per newton of it, `A` what the
signal adds of its own: friction and gains of motor torques; biases, gains and the tool's masses of
a force sensor. F is eliminated sample by sample, theta follows by least squares with priors, F by
weighted least squares. Gains multiply the modelled load `known + w F`, so this is repeated with
the F found before: on the signal itself they would run away together to where everything is zero,
and tensions were found 2 % too small from torques, 5 % from a sensor whose gains also have to
explain a tool that is heavier than its file says (notes/identification sec. 7). Motor torque near
a reversal of its joint is worthless: friction jumps there (notes/identification sec. 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import cross
from ballbar.cell.descriptions import Cell, Key
from ballbar.cell.geometry import Geometry, bar_frames, robot_frames
from ballbar.ident.loads.gear_loads import Loads, mass_model, on_ballbar
from ballbar.ident.loads.mass_uncertainty import stated_tool

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
ROUNDS = 3  # of the tension by which gains multiply: each leaves a share of their own size
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
    side, rise = friction_sign(speed), stribeck_rise(cell, speed)
    mean = np.concatenate((coulomb, viscous, none, none, rotors, none))
    gain, rising = np.full(j, TORQUE_GAIN), STRIBECK_PRIOR * coulomb
    offset = TORQUE_OFFSET * coulomb
    prior = np.concatenate((coulomb, 2.0 * viscous, gain, rising, ROTOR_PRIOR * rotors, offset))
    sigma = torque_sigma(cell, speed)

    tension, direction = Tension(np.zeros(n), none, mean, prior), carried.gear_per_newton
    for _ in range(ROUNDS):
        force, offset_column = carried.gears(tension.force), np.ones_like(speed)
        columns[:, range(j), range(j)] = side, speed, force, rise, acceleration, offset_column
        each = _Elimination(columns.reshape(-1, j, n), sigma, direction, mean, prior)
        tension = each.tension(torque - carried.gear)
    return tension


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


@dataclass(frozen=True, eq=False)
class FlangeLoad:
    """Wrench of plate and ball-bar on the flange [N, N m], flange frame."""

    known: Array  # (6, N) without tension
    per_newton: Array  # (6, N) of it
    tool: Array  # (4, 6, N) by a standard deviation of the tool's masses, independent ones

    def eliminated(self, force: Array) -> _Elimination:
        """A sensor's biases, its gain errors under a tension (N,) [N], and the tool's masses."""
        n = force.size
        columns = np.concatenate((np.zeros((12, 6, n)), self.tool))
        columns[range(6), range(6)] = 1.0
        columns[range(6, 12), range(6)] = self.known + self.per_newton * force
        prior = np.concatenate((SENSOR_BIAS, np.full(6, SENSOR_GAIN), np.ones(len(self.tool))))
        sigma = np.repeat(SENSOR_NOISE[:, None], n, axis=1)
        return _Elimination(columns, sigma, self.per_newton, np.zeros(prior.size), prior)


def force_sensor(load: FlangeLoad) -> Callable[[Array, int], tuple[Tension, float]]:
    """The tension from a six-axis sensor at the flange, and the rms of its residual [sigma].

    The function takes the wrench (6, N) [N, N m] that plate and ball-bar exert on the flange, in
    its frame, and how many rounds (ROUNDS); what the first one eliminates is the same for every
    wrench. The tension's theta holds six biases [N, N m], six gain errors, four deviations of the
    tool's masses [sigma].
    """
    first = load.eliminated(np.zeros(load.known.shape[1]))

    def measured(wrench: Array, rounds: int) -> tuple[Tension, float]:
        y, eliminated = wrench - load.known, first
        tension = eliminated.tension(y)
        for _ in range(rounds - 1):
            eliminated = load.eliminated(tension.force)
            tension = eliminated.tension(y)
        explained = eliminated.explained(tension.theta) + load.per_newton * tension.force
        return tension, float(np.sqrt((((y - explained) / eliminated.sigma) ** 2).mean()))

    return measured


def on_flange(cell: Cell, geometry: Geometry, q: Array, b: Array) -> FlangeLoad:
    """The wrench that a force sensor at the flange has to expect.

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
    down = np.einsum("j,ijn->in", masses.gravity, axes)
    of_tool = np.zeros((4, 6, down.shape[1]))  # per kg, and per kg m of the first moment
    of_tool[0, :3] = down
    of_tool[1:, 3:] = np.cross(np.eye(3)[:, None], down.T).transpose(0, 2, 1)
    body = cell.plate.body
    out[0] += np.einsum("k,kin->in", body.mass * np.array([1.0, *body.com]), of_tool)
    return FlangeLoad(out[0], out[1], np.einsum("kl,kin->lin", stated_tool(cell), of_tool))


@dataclass(frozen=True, eq=False)
class _Elimination:
    """Measured values as a tension, sample by sample, and terms theta of all of them."""

    columns: Array  # (T, J, N) of the values by the terms
    sigma: Array  # (J, N)
    direction: Array  # (J, N) of the values per newton
    mean: Array  # (T,) of the terms' priors
    prior: Array  # (T,) standard deviations

    @cached_property
    def _flat(self) -> Array:
        """(T, J N) whitened columns less what any tension could explain."""
        design = without_tension(self.columns, self.sigma, self.direction)
        return design.reshape(len(self.columns), -1)

    @cached_property
    def _normal(self) -> Array:
        return np.asarray(self._flat @ self._flat.T + np.diag(self.prior**-2.0))

    def tension(self, y: Array) -> Tension:
        """The likeliest tension and terms behind values y (J, N)."""
        rest = without_tension(y[None], self.sigma, self.direction)[0].reshape(-1)
        off = self._flat @ (rest - self.mean @ self._flat)
        theta = self.mean + np.linalg.solve(self._normal, off)
        w, left = self.direction / self.sigma, (y - self.explained(theta)) / self.sigma
        weight = (w * w).sum(axis=0)
        return Tension(
            (w * left).sum(axis=0) / weight,
            1.0 / np.sqrt(weight),
            theta,
            np.sqrt(np.diag(np.linalg.inv(self._normal))),
        )

    def explained(self, theta: Array) -> Array:
        """(J, N) of the values by the terms alone."""
        return np.asarray(np.einsum("j,jkn->kn", theta, self.columns))
