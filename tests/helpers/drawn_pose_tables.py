"""Tables of still poses of a robot with drawn errors: points or lengths."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, forward
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.cell.poses import PoseTable
from ballbar.ident.estimator.build_unknowns import arm_parameters
from tests.helpers.still_poses import group

TARGET = np.array([0.05, -0.03, 0.12])  # [m] of the reflector in the flange's frame
SEAT_TURN = np.array([0.2, -0.1, 0.7])  # [rad]
SEAT = np.array([1.8, -0.9, 0.4])  # [m]


@dataclass(frozen=True, eq=False)
class DrawnRobot:
    """A robot whose parameters differ from the catalogue's."""

    robot: Robot
    chain: Chain
    lower: Array  # (J,) [rad] of the joint angles that are drawn
    upper: Array

    def angles(self, count: int, rng: np.random.Generator) -> Array:
        """(N, J) [rad]"""
        share = rng.random((count, self.robot.joints))
        return np.asarray(self.lower + share * (self.upper - self.lower))


def drawn_robot(
    name: str, rng: np.random.Generator, angle: float = 1e-3, length: float = 3e-4
) -> DrawnRobot:
    """A robot with errors of its parameters, standard deviations angle [rad] and length [m]."""
    robot = load_robot(name)
    nominal = nominal_chain(robot)
    rows = {f.name: getattr(nominal, f.name).copy() for f in fields(Chain)}
    for p in arm_parameters(robot):
        rows[p.kind][p.row] += (length if p.is_length else angle) * rng.standard_normal()
    low = np.maximum(robot.axis_lower, -2.0)
    high = np.minimum(robot.axis_upper, 2.0)
    return DrawnRobot(robot, Chain(**rows), low, high)


def point_table(
    drawn: DrawnRobot,
    q: Array,
    noise: float,
    rng: np.random.Generator,
    *,
    zero: Array | None = None,
    target: Array = TARGET,
    scale: float = 1.0,
    seat: Array = SEAT,
) -> PoseTable:
    """Points that a tracker measures at joint angles q (N, J) [rad] that the controller shows.

    noise : [m] along each axis. zero : (J,) [rad] added to the angles by the robot. scale : of the
    measured values.
    """
    frames = forward(drawn.chain, q + (0.0 if zero is None else zero))
    places = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), target)
    turn = Rotation.from_rotvec(SEAT_TURN).as_matrix()
    values = scale * (places - seat) @ turn + noise * rng.standard_normal((len(q), 3))
    sigma = np.full((len(q), 3), 1e-5)
    measured = group("point", "tracker", q, values, sigma, "reflector", "drawn.csv")
    return PoseTable("drawn", drawn.robot, (measured,))


def length_table(
    drawn: DrawnRobot, q: Array, noise: float, rng: np.random.Generator, seats: Array
) -> PoseTable:
    """Distances of the target from seats (S, 3) [m] in the base frame; poses in equal parts."""
    frames = forward(drawn.chain, q)
    places = frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), TARGET)
    groups = []
    for k, part in enumerate(np.array_split(np.arange(len(q)), len(seats))):
        length = np.linalg.norm(places[part] - seats[k], axis=1)
        read = (length + noise * rng.standard_normal(part.size))[:, None]
        sigma = np.full((part.size, 1), 1e-5)
        own = group("length", f"seat{k}", q[part], read, sigma, "reflector", "drawn.csv")
        groups.append(replace(own, rows=part + 2))
    return PoseTable("drawn", drawn.robot, tuple(groups))
