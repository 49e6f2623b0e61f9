"""Still poses of a drawn robot, simulated: geometry, sag, joint errors and the instrument's noise.

The robot's errors are drawn from the distributions below and are no part of a prediction: what an
identification makes of the poses is compared with the robot itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames, forward
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.placement import Placement, target_frames
from ballbar.cell.poses import PoseTable
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.robot.accuracy import TcpError, position_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.planning.feasible_poses import Candidates
from ballbar.planning.pose_information import expected_group
from ballbar.planning.stations import PoseSetup, Station

LENGTH, ANGLE = 3e-4, 1e-3  # [m], [rad] sigma of DH parameters
SAG = 2e-4  # [rad/m] sigma of a coefficient of ballbar.ident.corrections.unit_weights
RIPPLE, ORDERS = 2e-5, (1, 2, 3)  # [rad] amplitude of each order of each joint
PLACED = 5e-3  # [m], [rad] sigma of seats and targets about where the request has them


@dataclass(frozen=True, eq=False)
class DrawnRobot:
    """A robot with errors, and where seats and targets really are."""

    setup: PoseSetup
    chain: Chain
    coefficients: Array
    seats: dict[str, Placement]
    targets: dict[str, Placement]

    def frames(self, q: Array, target: str) -> Frames:
        """Frames at joint angles q (N, J) [rad]; the last is that of the target."""
        robot = self.setup.robot
        corrections = _corrections(self.setup)
        true = IdentifiedRobot(robot, robot_geometry(robot), corrections, self.coefficients)
        return target_frames(forward(self.chain, true.joints(q)), self.targets[target])

    def measured(self, poses: Candidates, rng: np.random.Generator) -> PoseTable:
        """The values that the instrument measures at poses, with its noise."""
        setup = self.setup
        groups = []
        for k in np.unique(poses.station):
            station: Station = setup.stations[k]
            axes = poses.axes[poses.station == k]
            group = expected_group(setup, station, axes)
            q = controller_to_joints(setup.robot, axes)
            frames, seat = self.frames(q, station.target), self.seats[station.seat]
            rod = seat.rotation.T @ (frames.tip - seat.origin[:, None])
            values = group.values
            if group.measured == "length":
                values = np.linalg.norm(rod, axis=0)[:, None]
            elif group.measured == "point":
                values = rod.T
            elif group.measured == "pose":
                turned = np.einsum("ji,jkn->ikn", seat.rotation, frames.rotation())
                values = np.concatenate((rod, rotvec_from_matrix(turned))).T
            noise = group.sigma[:, : values.shape[1]] * rng.standard_normal(values.shape)
            groups.append(replace(group, values=values + noise))
        return PoseTable(setup.request.name, setup.robot, tuple(groups), setup.distances)

    def error_of(self, arm: IdentifiedRobot) -> TcpError:
        """TCP error of an identified robot over the workspace, base aligned."""
        grid, target = self.setup.grid, self.setup.stations[0].target
        return position_error(arm.frames(grid).tip.T, self.frames(grid, target).tip.T)


def drawn_robot(
    setup: PoseSetup, rng: np.random.Generator, *, ripple: float = RIPPLE
) -> DrawnRobot:
    """A robot with every error drawn; ripple : [rad] amplitude of the joint errors."""
    rows = {
        kind: getattr(setup.chain, kind).copy() for kind in ("a", "d", "alpha", "theta", "beta")
    }
    for parameter in arm_parameters(setup.robot):
        sigma = LENGTH if parameter.is_length else ANGLE
        rows[parameter.kind][parameter.row] += sigma * rng.standard_normal()
    weights, harmonics = _corrections(setup)
    sag = SAG * np.abs(rng.standard_normal(len(weights.coefficients)))
    turns = ripple * rng.standard_normal(len(harmonics.coefficients))
    return DrawnRobot(
        setup=setup,
        chain=Chain(**rows),
        coefficients=np.concatenate((sag, turns)),
        seats={s.seat: _placed(s.origin, rng) for s in setup.stations},
        targets={s.target: _placed(s.point, rng) for s in setup.stations},
    )


def _corrections(setup: PoseSetup) -> tuple:  # type: ignore[type-arg]
    orders = [(joint, order) for joint in range(setup.robot.joints) for order in ORDERS]
    return unit_weights(setup.robot), joint_harmonics(orders)


def _placed(origin: Array, rng: np.random.Generator) -> Placement:
    turn = matrix_from_rotvec(PLACED * rng.standard_normal((3, 1)))[:, :, 0]
    return Placement(turn, origin + PLACED * rng.standard_normal(3))
