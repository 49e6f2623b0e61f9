"""Where an identified robot puts its tool when it stands free: geometry, gears and its own weight.

The figure that compares calibrations: the position of the tool at logged joint angles, without ball-bar, at rest. Elastic
gears yield to the weight of arm and plate, play lies on the side that the weight presses it to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.chain import joint_screws, screw
from cell.descriptions import Cell
from cell.geometry import PARAMETERS, Geometry, robot_frames
from ident.corrections.base import BAR, CARRIERS, GEAR, Correction, State, backlash_transition
from ident.loads.gear_loads import Loads, mass_model, own_weight

UNDECIDED = np.array(
    [3.0, 3.0, 3.0, 0.15, 0.15, 0.15]
)  # [N m] load under which play counts in the middle (notes/identification sec. 1)


def backlash_sides(load: Array) -> Array:
    """(6, N) side, -1, 0 or 1, on which gears at rest lie under a load (6, N) [N m]; 0 where the load hardly decides."""
    return np.where(np.abs(load) < UNDECIDED[:, None], 0.0, np.sign(load))


@dataclass(frozen=True, eq=False)
class UnloadedRobot:
    """A robot without ball-bar."""

    cell: Cell
    geometry: Geometry
    corrections: tuple[Correction, ...] = ()
    values: Array | None = None  # of all coefficients, correction after correction

    def tool(self, q: Array) -> Array:
        """(N, 3) [m] position of the tool, robot base frame, at logged joint angles q (N, 6) [rad]."""
        return robot_frames(self.geometry, self.joints(q)).tip.T

    def joints(self, q: Array) -> Array:
        """(N, 6) [rad] what the joints really are when the log says q."""
        if self.values is None or not self.corrections:
            return q
        moved = np.zeros((CARRIERS, len(q)))
        values = iter(self.values)
        for carrier, signal in self._signals(q):
            moved[carrier] += next(values) * signal
        return np.asarray(q + moved[GEAR:BAR].T @ self.cell.robot.gear_to_joint)

    def jacobian(self, q: Array, parameters: NDArray[np.intp]) -> Array:
        """(P + C, 3, N) change of the tool per unit of robot parameters (indices into PARAMETERS) and coefficients."""
        frames = robot_frames(self.geometry, self.joints(q))
        columns = [
            screw(frames, PARAMETERS[i].kind, PARAMETERS[i].row)[:3]
            if PARAMETERS[i].side == "robot"
            else np.zeros((3, len(q)))
            for i in parameters
        ]
        if self.corrections:
            gears = np.einsum(
                "gj,jcn->gcn", self.cell.robot.gear_to_joint, joint_screws(frames)[:, :3]
            )
            columns += [
                gears[c] * s if c < BAR else np.zeros((3, len(q))) for c, s in self._signals(q)
            ]
        return np.stack(columns)

    def _signals(self, q: Array) -> list[tuple[int, Array]]:
        n = len(q)
        weight, none = own_weight(mass_model(self.cell), self.geometry, q), np.zeros((6, n))
        gears = (q @ self.cell.robot.joint_to_gear).T
        state = State(
            np.zeros(n),
            -1,
            gears,
            np.zeros((5, n)),
            Loads(weight, none, none[0], none[0]),
            none[0],
            backlash_transition(self.cell),
            sides=backlash_sides(weight),
        )
        return [
            (c.carrier, s)
            for cor in self.corrections
            for c, s in zip(cor.coefficients, cor.signals(state), strict=True)
        ]
