"""Distances of the arm at still poses, as capsules along its DH rows.

The axes of the capsules run along d and a of every row and from the flange to the target; the rod
or beam is one more capsule from the seat. Bodies between which the chain is shorter than their
radii and the clearance always touch and are not compared. Makers publish no hulls of most robots,
so the radii are assumed shares of the chain's length: a screen for a program that is run slowly
first, not a proof.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cell.arrays import Array
from cell.chain import Frames, forward
from cell.robot_angles import controller_to_joints
from ident.poses.closure import Placement, target_frames
from planning.stations import PoseSetup, Station

# Radii as shares of the chain's length. planning.clearance has 0.14 of the upper arm for the arm
# and 0.09 for the wrist; the upper arm of the IRB 2400 is 0.31 of its chain.
ARM, WRIST = 0.045, 0.03
LAST_ROWS = 3  # that are the wrist
ROD = 0.02  # [m] radius of a rod, planning.clearance, and of the stem of a target, assumed
SHORT = 1e-6  # [m] a row that has no body of its own
FAR = 1.0  # [m] beyond which distances are not distinguished
BOX_POINTS = 8  # of a capsule's axis that are compared with a box


@dataclass(frozen=True, eq=False)
class Arm:
    """The capsules of a robot with one target."""

    rows: tuple[int, ...]  # DH row of each capsule, from 0; the number of rows for the target's
    parts: tuple[int, ...]  # 0 along d, 1 along a, 0 to the target
    radii: Array  # (S,) [m]
    begin: Array  # (S,) [m] place along the chain
    end: Array  # (S,) [m]
    pairs: tuple[tuple[int, int], ...]  # capsules that are compared

    @cached_property
    def moving(self) -> list[int]:
        """Capsules that can come to the floor or to a box: all behind the first joint's."""
        return [s for s, row in enumerate(self.rows) if row > 0]

    def before_line(self, clearance: float) -> list[int]:
        """Capsules that are compared with the rod or beam, which ends at the target."""
        return [
            s
            for s in range(len(self.rows))
            if self.end[-1] - self.end[s] > self.radii[s] + ROD + clearance
        ]


def arm_of(setup: PoseSetup, station: Station) -> Arm:
    """The capsules of the robot with the station's target."""
    chain = setup.chain
    lengths = [
        (i, part, abs(float(v)))
        for i in range(chain.rows)
        for part, v in enumerate((chain.d[i], chain.a[i]))
    ]
    lengths.append((chain.rows, 0, float(np.linalg.norm(station.point))))
    bodies = [body for body in lengths if body[2] > SHORT]
    total = sum(length for _, _, length in lengths[:-1])
    end = np.cumsum([length for _, _, length in bodies])
    radii = np.array([_radius(chain.rows, total, row) for row, _, _ in bodies])
    begin = np.concatenate(([0.0], end[:-1]))
    clearance = setup.request.limits.clearance_m
    pairs = tuple(
        (s, t)
        for s in range(len(bodies))
        for t in range(s + 1, len(bodies))
        if begin[t] - end[s] > radii[s] + radii[t] + clearance
    )
    rows, parts = tuple(b[0] for b in bodies), tuple(b[1] for b in bodies)
    return Arm(rows=rows, parts=parts, radii=radii, begin=begin, end=end, pairs=pairs)


def _radius(rows: int, total: float, row: int) -> float:
    """[m] of the capsule of a DH row; `row` equals `rows` for the target's."""
    if row == rows:
        return ROD
    return total * (ARM if row < rows - LAST_ROWS else WRIST)


def station_frames(setup: PoseSetup, station: Station, axes: Array) -> Frames:
    """Nominal frames at axis angles (N, J) [rad]; the last is that of the target."""
    flange = forward(setup.chain, controller_to_joints(setup.robot, axes))
    return target_frames(flange, Placement(np.eye(3), station.point))


def smallest_distance(
    setup: PoseSetup, station: Station, arm: Arm, frames: Frames, *, line: bool
) -> Array:
    """(N,) [m] of the arm from itself, floor, boxes and, if asked, the rod or beam; at most FAR."""
    limits = setup.request.limits
    ends = _axes(setup, arm, frames)  # (S, 2, 3, N)
    out = np.full(frames.tip.shape[1], FAR)
    for s, t in arm.pairs:
        apart = segment_distance(ends[s], ends[t]) - arm.radii[s] - arm.radii[t]
        np.minimum(out, apart, out=out)
    for s in arm.moving:
        if limits.floor_m is not None:
            np.minimum(out, ends[s, :, 2].min(axis=0) - arm.radii[s] - limits.floor_m, out=out)
        for box in limits.keep_out:
            low, high = np.array(box.lower_m), np.array(box.upper_m)
            np.minimum(out, _box_distance(ends[s], low, high) - arm.radii[s], out=out)
    if line:
        seat = np.repeat(station.origin[:, None], out.size, axis=1)
        rod = np.stack((seat, frames.tip))
        for s in arm.before_line(limits.clearance_m):
            np.minimum(out, segment_distance(ends[s], rod) - arm.radii[s] - ROD, out=out)
    return out


def segment_distance(first: Array, second: Array) -> Array:
    """(N,) [m] between segments (2, 3, N) [m] each (Ericson 2005, sec. 5.1.9)."""
    along, other, between = first[1] - first[0], second[1] - second[0], first[0] - second[0]
    a, e, b = ((u * v).sum(axis=0) for u, v in ((along, along), (other, other), (along, other)))
    c, f = (along * between).sum(axis=0), (other * between).sum(axis=0)
    a, e = np.maximum(a, SHORT**2), np.maximum(e, SHORT**2)
    across = a * e - b * b
    s = np.where(across > 1e-12 * a * e, (b * f - c * e) / np.maximum(across, 1e-300), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((b * s + f) / e, 0.0, 1.0)
    s = np.clip((b * t - c) / a, 0.0, 1.0)
    return np.asarray(np.linalg.norm(between + s * along - t * other, axis=0))


def _axes(setup: PoseSetup, arm: Arm, frames: Frames) -> Array:
    """(S, 2, 3, N) [m] ends of the capsules' axes."""
    chain, out = setup.chain, []
    for row, part in zip(arm.rows, arm.parts, strict=True):
        if row == chain.rows:
            out.append((frames.origin[-2], frames.tip))
            continue
        corner = frames.origin[row] + chain.d[row] * frames.z[row]
        out.append((frames.origin[row], corner) if part == 0 else (corner, frames.origin[row + 1]))
    return np.array(out)


def _box_distance(ends: Array, low: Array, high: Array) -> Array:
    """(N,) [m] of points along a segment (2, 3, N) from a box; half their spacing is taken off."""
    share = np.linspace(0.0, 1.0, BOX_POINTS)[:, None, None]
    points = ends[0] + share * (ends[1] - ends[0])
    outside = np.maximum(np.maximum(low[:, None] - points, points - high[:, None]), 0.0)
    spacing = np.linalg.norm(ends[1] - ends[0], axis=0) / (BOX_POINTS - 1)
    return np.asarray(np.linalg.norm(outside, axis=1).min(axis=0) - 0.5 * spacing)
