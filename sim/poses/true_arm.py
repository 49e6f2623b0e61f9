"""The robot of a simulation as it really is: where it puts a target at the angles that it shows.

    shown angles -> gears with their harmonic errors -> yielding under their own weight -> DH rows

Nothing of it is shared with the identification but cell.chain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.bodies import link_bodies
from cell.chain import KINDS, Chain, Frames, forward
from cell.descriptions import Robot
from cell.dynamics import joint_torques
from cell.errors import InputError
from cell.rotation import matrix_from_rotvec
from sim.plant.effects import Ripple
from sim.poses.settings import PoseErrors
from sim.streams import stream

_ROUNDS = 4  # of harmonics and sag; each gains three digits
_PARALLEL = 1e-6  # sine of the twist below which two axes are nominally parallel


@dataclass(frozen=True, eq=False)
class Place:
    """A seat in the robot's base frame, or a target in the flange's."""

    position: Array  # (3,) [m]
    rotvec: Array  # (3,) [rad]

    @property
    def rotation(self) -> Array:
        """(3, 3)"""
        return matrix_from_rotvec(self.rotvec[:, None])[:, :, 0]


@dataclass(frozen=True, eq=False)
class TrueArm:
    """A robot with its errors."""

    robot: Robot  # nominal
    chain: Chain  # true DH rows
    ripples: tuple[Ripple, ...]  # of the gears
    weights: Array  # (J, J) [rad/m] yield of joint j under a unit weight at frame k + 1
    gear_stiffness: Array | None  # (J,) [N m/rad]; None: rigid gears

    def rotors(self, q: Array) -> Array:
        """(N, J) [rad] outputs of the gears without load, at shown angles q (N, J) [rad]."""
        shown = q @ self.robot.joint_to_gear
        outputs = shown
        for _ in range(_ROUNDS):
            error = np.zeros_like(shown)
            for r in self.ripples:
                error[:, r.gear] += r.amplitude * np.sin(r.order * outputs[:, r.gear] + r.phase)
            outputs = shown + error
        return np.asarray(outputs)

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] actual joint angles under the arm's own weight, at shown angles q (N, J)."""
        rotors, robot = self.rotors(q), self.robot
        actual = rotors @ robot.gear_to_joint
        if self.gear_stiffness is None and not self.weights.any():
            return np.asarray(actual)
        for _ in range(_ROUNDS):
            frames = forward(self.chain, actual)
            yielded = np.zeros_like(rotors)
            if self.gear_stiffness is not None:
                bodies = [[link] for link in link_bodies(robot)]
                held = joint_torques(frames, bodies, actual, gravity=robot.gravity)
                yielded -= held.T @ robot.gear_to_joint.T / self.gear_stiffness
            yielded += _of_weights(frames, self.weights, robot)
            actual = (rotors + yielded) @ robot.gear_to_joint
        return np.asarray(actual)

    def flange(self, q: Array) -> Frames:
        """Frames of the robot at shown angles q (N, J) [rad]; the last is the flange's."""
        return forward(self.chain, self.joints(q))

    def target(self, q: Array, point: Array) -> Array:
        """(N, 3) [m] place of a point (3,) [m] on the flange, base frame, at shown angles q."""
        frames = self.flange(q)
        return np.asarray(frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point))


def true_arm(robot: Robot, errors: PoseErrors, seed: int) -> TrueArm:
    """The robot of a scenario, drawn.

    Raises InputError for harmonics of an axis that the robot does not have, and for elastic gears
    where the robot's file has no masses or no gears.
    """
    stiffness = None
    if (compliance := errors.joint_compliance) is not None:
        robot.required("links")
        spread = stream(seed, "pose_joint_compliance").standard_normal(robot.joints)
        catalogue = robot.required("gears").stiffness * compliance.scale
        stiffness = catalogue * np.exp(compliance.spread * spread)
    weights = np.zeros((robot.joints, robot.joints))
    if errors.unit_weights is not None:
        drawn = np.abs(stream(seed, "unit_weights").standard_normal(weights.shape))
        weights = np.triu(drawn) * errors.unit_weights.sigma_rad_per_m
    return TrueArm(
        robot, _geometry(robot, errors, seed), _ripples(robot, errors, seed), weights, stiffness
    )


def nominal_arm(robot: Robot) -> TrueArm:
    """The robot as its file has it."""
    return true_arm(robot, PoseErrors(), 0)


def _geometry(robot: Robot, errors: PoseErrors, seed: int) -> Chain:
    rows = {kind: np.zeros(robot.joints) for kind in KINDS}
    for kind in ("a", "d", "alpha", "theta"):
        rows[kind] += getattr(robot, kind)
    if (sizes := errors.geometry) is not None:
        drawn = stream(seed, "geometry").standard_normal((len(KINDS), robot.joints))
        parallel = np.abs(np.sin(robot.alpha)) < _PARALLEL
        parallel[-1] = False  # no axis follows the last row
        for kind, each in zip(KINDS, drawn, strict=True):
            sigma = sizes.sigma_m if kind in ("a", "d") else sizes.sigma_rad
            rows[kind] += sigma * each * (parallel if kind == "beta" else True)
    return Chain(**rows)


def _ripples(robot: Robot, errors: PoseErrors, seed: int) -> tuple[Ripple, ...]:
    out = []
    phases = stream(seed, "joint_harmonics").uniform(0.0, 2.0 * np.pi, len(errors.joint_harmonics))
    for harmonic, phase in zip(errors.joint_harmonics, phases, strict=True):
        if harmonic.axis > robot.joints:
            raise InputError(
                f"errors.joint_harmonics: axis {harmonic.axis}, but {robot.name} has "
                f"{robot.joints} axes."
            )
        out.append(Ripple(harmonic.axis - 1, harmonic.order, harmonic.amplitude_rad, float(phase)))
    if (drawn := errors.drawn_harmonics) is not None:
        rng = stream(seed, "drawn_harmonics")
        gears = rng.integers(0, robot.joints, drawn.count)
        orders = rng.integers(1, drawn.order_max + 1, drawn.count)
        for gear, order, phase in zip(
            gears, orders, rng.uniform(0.0, 2.0 * np.pi, drawn.count), strict=True
        ):
            out.append(Ripple(int(gear), float(order), drawn.amplitude_rad, float(phase)))
    return tuple(out)


def _of_weights(frames: Frames, weights: Array, robot: Robot) -> Array:
    """(N, J) [rad] what the joints yield under unit weights (J, J) [rad/m]."""
    down = robot.gravity / np.linalg.norm(robot.gravity)
    out = np.zeros((frames.tip.shape[1], robot.joints))
    for j, k in zip(*np.nonzero(weights), strict=True):
        lever = frames.origin[k + 1] - frames.origin[j]
        torque = (frames.z[j] * np.cross(lever, down, axis=0)).sum(axis=0)
        out[:, j] += weights[j, k] * torque
    return out
