"""What the mechanism really did, over true time: the common output of all plants and the input of all encoders."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicSpline

from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry
from cell.rotation import rotvec_from_matrix
from sim.plant.deflection import deflect

# Told of each stretch while it is simulated: cell, true parameters, instants (K,) [s], robot (K, 6) and ball-bar angles (K, 5) [rad].
# A stretch begins where the one before ended.
MotionCallback = Callable[[Cell, Geometry, Array, Array, Array], None]

CLOSURE_STRIDE = 10  # the loop's error changes with the motion, over tenths of seconds; every tenth millisecond shows its maximum


@dataclass(frozen=True, eq=False)
class Motion:
    """One run on a uniform grid of true time. Before its start and after its end everything stands still."""

    t: Array  # (K,) [s]
    q: Array  # (K, 6) [rad] robot joint angles
    shown: Array  # (K, 6) [rad] joint angles that the motors show: without what the gears add
    b: Array  # (K, 5) [rad] ball-bar joint angles, mechanical (encoder zeros and errors not in them)
    rod_stretch: Array  # (K,) [m]
    rod_force: Array  # (K,) [N] tension positive
    geometry: Geometry  # true parameters; btheta holds the mechanical errors only
    torque: Array | None = (
        None  # (K, 6) [N m] of the servos, at the gears' outputs, in the step that ends at t
    )
    wrench: Array | None = (
        None  # (K, 6) [N, N m] that plate and ball-bar exert on the flange, flange frame, where measured
    )
    plate: Array = field(
        default_factory=lambda: np.zeros(1)
    )  # (K,) or (1,) [rad] bending of the offset plate
    base: Array = field(
        default_factory=lambda: np.zeros((1, 3))
    )  # (K, 3) or (1, 3) [m] shift of the ball-bar's base

    def at(self, times: Array) -> tuple[Array, Array]:
        """Shown joint angles (N, 6) and ball-bar angles (N, 5) [rad] at any true times (N,) [s]."""
        inside = np.clip(times, self.t[0], self.t[-1])
        both = CubicSpline(self.t, np.concatenate((self.shown, self.b), axis=1))(inside)
        return both[:, :6], both[:, 6:]

    def closure(self) -> tuple[Array, Array]:
        """Loop-closure error over the run from the angles alone, by DH: (K / CLOSURE_STRIDE,) [m] and [rad].

        What rod, plate and base give way is taken into account; independent of the plant that made the motion.
        """
        some = slice(None, None, CLOSURE_STRIDE)
        n = self.t[some].size
        plate, base = np.broadcast_to(self.plate[some], n), np.broadcast_to(self.base[some], (n, 3))
        ends = deflect(
            self.geometry,
            self.q[some],
            self.b[some],
            stretch=self.rod_stretch[some],
            plate=plate,
            base=base,
        )
        turned = np.einsum("ikn,jkn->ijn", ends.bar.rotation(), ends.tool_rotation)
        return np.linalg.norm(ends.bar.tip - ends.tool, axis=0), np.linalg.norm(
            rotvec_from_matrix(turned), axis=0
        )
