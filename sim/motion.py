"""What the mechanism really did, over true time: the common output of all plants and the input of all encoders."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from cell.chain import Array
from cell.geometry import Geometry, bar_frames, robot_frames
from cell.inverse import pose_mismatch


@dataclass(frozen=True, eq=False)
class Motion:
    """One run on a uniform grid of true time. Before its start and after its end everything stands still."""

    t: Array  # (K,) [s]
    q: Array  # (K, 6) [rad] robot joint angles
    b: Array  # (K, 5) [rad] ball-bar joint angles, mechanical (encoder zeros and errors not in them)
    rod_stretch: Array  # (K,) [m]
    rod_force: Array  # (K,) [N] tension positive
    geometry: Geometry  # true parameters; btheta holds the mechanical errors only

    def at(self, times: Array) -> tuple[Array, Array]:
        """Robot angles (N, 6) and ball-bar angles (N, 5) [rad] at any true times (N,) [s]."""
        inside = np.clip(times, self.t[0], self.t[-1])
        both = CubicSpline(self.t, np.concatenate((self.q, self.b), axis=1))(inside)
        return both[:, :6], both[:, 6:]

    def closure(self) -> tuple[Array, Array]:
        """Loop-closure error over the run from the angles alone, by DH: (K,) [m] and (K,) [rad].

        The rod's own stretch is taken into account; independent of the plant that made the motion.
        """
        robot = robot_frames(self.geometry, self.q)
        rigid = bar_frames(self.geometry, self.b)
        stretched = replace(rigid, origin=rigid.origin + self.rod_stretch * rigid.z[2])
        error = pose_mismatch(stretched.rotation(), stretched.tip, robot)
        return np.linalg.norm(error[:3], axis=0), np.linalg.norm(error[3:], axis=0)
