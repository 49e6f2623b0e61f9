"""How well robot and encoders agree about the rod, at the best of all clock offsets.

Two numbers, without a fit. The nominal robot's tool moves on a sphere about the ball-bar: rms of
its distance from the sphere that fits best, radius free. And two encoders of a gimbal hold the
rod's direction (ballbar.ident.start.lag_scan): the share of its motion that is left unexplained,

    left = (residual variance / variance of the direction)^(overlap / (2 longest overlap)),

0 where the encoders hold the robot's motion, about 1 where they hold anything else. The exponent
keeps a short overlap in which little moves from looking like agreement.

A single length of the cell, or zero of an axis, may put the tool's path on a sphere: its distance
from a centre is linear in the lengths a and d of the nominal robot, plate and tool included, and
the centre, the radius and one parameter at a time are fitted by Gauss-Newton on `|p - o| - r`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, parameter_named, robot_frames
from ballbar.cell.statistics import rms
from ballbar.ident.start.lag_scan import DIRECTION_SIGMA, Pair, PairScan
from ballbar.ident.start.sphere import sphere_candidates

# [s] of both logs; longer logs take longer steps, up to those in which the rod turns by 0.1 rad.
STEP, LONGEST_STEP, ROWS = 0.05, 0.2, 4000
SPHERE_ROWS = 600  # of the robot's log, for a sphere
GIMBALS = {1: (1, 2), 5: (5, 4)}  # turning and tilting joint, by the turning one


@dataclass(frozen=True, eq=False)
class LoggedMotion:
    """Both logs on even steps of their own clocks."""

    step: float  # [s]
    q: Array  # (Nr, J) [rad] robot joint angles
    readings: Array  # (Nb, E) [rad] of the encoders; E is 0 without
    encoders: tuple[int, ...]  # (E,) joints 1..5

    @property
    def gimbals(self) -> tuple[tuple[int, int], ...]:
        """Turning and tilting joint of each gimbal with two encoders."""
        return tuple(pair for pair in GIMBALS.values() if set(pair) <= set(self.encoders))

    def column(self, joint: int) -> Array:
        """(Nb,) [rad] readings of a joint's encoder."""
        return np.asarray(self.readings[:, self.encoders.index(joint)])

    def reversed(self) -> LoggedMotion:
        """The ball-bar's log played backwards: the same motion, but of no robot."""
        return replace(self, readings=self.readings[::-1])


@dataclass(frozen=True, eq=False)
class ToolPath:
    """The path of the nominal robot's tool, and the sphere that fits it best."""

    radius: float  # [m] of the sphere
    rms: float  # [m] of the tool's distance from it
    # [m] of the radius: the errors of a robot that is not calibrated are similar along its path, so
    # the whole path counts as one measurement of each unknown
    radius_sigma: float
    directions: dict[int, Array]  # (Nr, 3) that a gimbal should hold, by its turning joint


def motion_of(
    t: Array, q: Array, t_bar: Array, readings: Array, encoders: tuple[int, ...]
) -> LoggedMotion:
    """Both logs on even steps: t (Nr,) [s], q (Nr, J) [rad]; t_bar (Nb,) [s], readings (Nb, E)."""
    longest = max(np.ptp(t), np.ptp(t_bar)) if encoders else np.ptp(t)
    step = float(np.clip(longest / ROWS, STEP, LONGEST_STEP))
    bar = _even(t_bar, readings, step) if encoders else np.zeros((0, 0))
    return LoggedMotion(step, _even(t, q, step), bar, encoders)


def tool_path(nominal: Geometry, q: Array) -> ToolPath:
    """The tool's path at joint angles q (N, J) [rad] of the nominal robot.

    Raises ValueError where the tool hardly moves.
    """
    poses = robot_frames(nominal, q).poses()
    tip = poses[:, :3, 3]
    sphere = sphere_candidates(tip[:: 1 + len(tip) // SPHERE_ROWS], nominal["bd3"])[0]
    rod = tip - sphere.centre
    distance = np.linalg.norm(rod, axis=1)
    u = rod / distance[:, None]
    v = np.einsum("nij,ni->nj", poses[:, :3, :3], u) * np.array([-1.0, 1.0, 1.0])
    rms = float(np.sqrt(((distance - sphere.radius) ** 2).mean()))
    columns = np.column_stack((u, np.ones(len(u))))
    normal = np.linalg.pinv(columns.T @ columns / len(u), hermitian=True)
    return ToolPath(sphere.radius, rms, rms * float(np.sqrt(normal[3, 3])), {1: u, 5: v})


class Gimbal:
    """Two columns of readings, compared with the direction that they should hold at all lags."""

    def __init__(self, turning: Array, tilting: Array, direction: Array, step: float) -> None:
        """turning, tilting : (Nb,) [rad] readings. direction : (Nr, 3). step : [s]"""
        self._scan = PairScan(Pair(turning, tilting, direction), step)
        self._share = self._scan.overlap / min(turning.size, len(direction))
        gain = self._gain(self._scan.signal, self._scan.residual_variance())
        # (L,) half the log-likelihood gain a sample at each lag; -inf where the overlap is short
        self.gain = np.where(self._scan.usable, self._share * gain, -np.inf)

    def refined(self, lag: int) -> float:
        """The gain at a lag, by its index, between the offsets of the grid."""
        if not self._scan.usable[lag]:
            return 0.0
        signal, variance = self._scan.signal[lag], self._scan.branches(lag)[0].variance
        return float(self._share[lag] * self._gain(signal, np.asarray(variance)))

    def _gain(self, signal: Array, residual: Array) -> Array:
        floor = DIRECTION_SIGMA**2
        return np.asarray(0.5 * np.log((signal + floor) / (residual + floor)))


def left(gimbals: Sequence[Gimbal]) -> float:
    """The unexplained share of the motion at the best common lag, of the gimbal that agrees least.

    gimbals : of the same two logs.
    """
    best = int(np.argmax(np.sum([gimbal.gain for gimbal in gimbals], axis=0)))
    return min(1.0, float(np.exp(-min(gimbal.refined(best) for gimbal in gimbals))))


def left_of(motion: LoggedMotion, path: ToolPath) -> float:
    """The unexplained share of the motion with the encoders as declared."""
    return left(
        [
            Gimbal(motion.column(i), motion.column(j), path.directions[i], motion.step)
            for i, j in motion.gimbals
        ]
    )


def _even(t: Array, values: Array, step: float) -> Array:
    """(N, C) values on even steps."""
    grid = np.arange(t[0], t[-1], step)
    return np.stack([np.interp(grid, t, column) for column in values.T], axis=1)


@dataclass(frozen=True)
class Length:
    """One parameter changed, and how far the tool then is from its sphere."""

    name: str  # as in ballbar.cell.geometry, such as ra2
    change: float  # [m, rad] to add to the file's
    radius: float  # [m] of the sphere
    rms: float  # [m]


def single_lengths(nominal: Geometry, q: Array) -> list[Length]:
    """The path at joint angles q (N, J) [rad] with each length or joint offset changed, best first.

    Raises ValueError where the tool hardly moves.
    """
    points = robot_frames(nominal, q).poses()[:, :3, 3]
    start = sphere_candidates(points, nominal["bd3"])[0]
    table = nominal.table
    kinds = ("a", "d", "theta")
    names = [n for n in table.robot if parameter_named(n).kind in kinds and n not in table.gauge]
    lengths = [_fitted(nominal, q, name, start.centre, start.radius) for name in names]
    return sorted(lengths, key=lambda length: length.rms)


def _fitted(nominal: Geometry, q: Array, name: str, centre: Array, radius: float) -> Length:
    def residual(x: Array) -> Array:
        """(N,) [m] of the tool's distance; x (5,) centre, radius and change of the parameter."""
        changed = nominal.replaced({name: nominal[name] + x[4]})
        points = robot_frames(changed, q).tip.T
        return np.asarray(np.linalg.norm(points - x[:3], axis=1) - x[3])

    fit = least_squares(residual, [*centre, radius, 0.0], method="lm")
    return Length(name, float(fit.x[4]), float(fit.x[3]), rms(fit.fun))
