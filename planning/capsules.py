"""Distances of an arm as capsules along its DH rows, from itself and its surroundings.

The axes of the capsules run along d and a of every row and, at still poses, from the flange to the
target; the rod or beam is one more capsule from the seat. Bodies between which the chain is shorter
than their radii and a margin always touch and are not compared. Makers publish no hulls of most
robots, so the radii are assumed shares of the chain's length: a screen for a program that is run
slowly first, not a proof. Links that do not lie along their row, as the upper arm of a UR, are not
seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain, Frames
from ballbar.planning.stations import PoseSetup, Station

# Radii as shares of the chain's length. ballbar.planning.clearance has 0.14 of the upper arm for
# the arm of an IRB 2400 and 0.09 for its wrist; the upper arm is 0.31 of the chain.
LINK, LINK_OF_WRIST = 0.045, 0.03
WRIST_ROWS = 3
ROD = 0.02  # [m] radius of a rod's tube and of the stem of a target, assumed
SHORT = 1e-6  # [m] a row that has no body of its own
PARALLEL = 1e-12  # squared sine below which two axes are parallel
FAR = 1.0  # [m] beyond which distances at still poses are not distinguished
BOX_POINTS = 8  # of a capsule's axis that are compared with a box


@dataclass(frozen=True, eq=False)
class Links:
    """The capsules of an arm, from its base on."""

    rows: tuple[tuple[int, int], ...]  # DH row from 0, and 0 along d or 1 along a, of each
    radii: Array  # (S,) [m]
    begin: Array  # (S,) [m] place along the chain
    end: Array  # (S,) [m]

    def with_stem(self, row: int, length: float) -> Links:
        """The links with a target on a stem [m] from the flange, which counts as one more row."""
        if length <= SHORT:
            return self
        last = self.end[-1]
        return Links(
            rows=(*self.rows, (row, 0)),
            radii=np.append(self.radii, ROD),
            begin=np.append(self.begin, last),
            end=np.append(self.end, last + length),
        )


def links_of(chain: Chain) -> Links:
    """The capsules of the rows of a chain that have a length."""
    lengths = np.abs(np.stack((chain.d, chain.a), axis=1))
    rows = tuple((int(row), int(part)) for row, part in np.argwhere(lengths > SHORT))
    total = float(np.abs(chain.a).sum() + np.abs(chain.d).sum())
    wrist = chain.rows - WRIST_ROWS
    end = np.cumsum([lengths[row] for row in rows])
    return Links(
        rows=rows,
        radii=np.array([total * (LINK if row < wrist else LINK_OF_WRIST) for row, _ in rows]),
        begin=end - [lengths[row] for row in rows],
        end=end,
    )


def smallest_distance(setup: PoseSetup, station: Station, frames: Frames, *, line: bool) -> Array:
    """(N,) [m] of the arm from itself, floor, boxes and, if asked, the rod or beam; at most FAR.

    frames : of the arm, the last one that of the target.
    """
    limits, chain = setup.request.limits, setup.chain
    links = links_of(chain).with_stem(chain.rows, float(np.linalg.norm(station.point)))
    axes = _axes(chain, links, frames)
    radii, count = links.radii, len(links.rows)
    distances = [np.full(frames.tip.shape[1], FAR)]
    for s in range(count):
        for t in range(s + 1, count):
            if links.begin[t] - links.end[s] > radii[s] + radii[t] + limits.clearance_m:
                distances.append(segment_distance(*axes[s], *axes[t]) - radii[s] - radii[t])
        if links.rows[s][0] > 0:  # all after the first joint's can come to the floor or to a box
            middle, half = axes[s]
            if limits.floor_m is not None:
                lowest = middle[2] - np.abs(half[2])
                distances.append(lowest - radii[s] - limits.floor_m)
            for box in limits.keep_out:
                low, high = np.array(box.lower_m), np.array(box.upper_m)
                distances.append(_box_distance(middle, half, low, high) - radii[s])
        if line and links.end[-1] - links.end[s] > radii[s] + ROD + limits.clearance_m:
            seat = station.origin[:, None]
            rod = (0.5 * (seat + frames.tip), 0.5 * (frames.tip - seat))
            distances.append(segment_distance(*axes[s], *rod) - radii[s] - ROD)
    return np.asarray(np.min(distances, axis=0))


def _axes(chain: Chain, links: Links, frames: Frames) -> list[tuple[Array, Array]]:
    """Middle and half length (3, N) [m] of the axis of each capsule."""
    axes = []
    for row, part in links.rows:
        corner = frames.tip  # of the stem
        if row < chain.rows:
            corner = frames.origin[row] + chain.d[row] * frames.z[row]
        begin, end = (corner, frames.origin[row + 1]) if part else (frames.origin[row], corner)
        axes.append((0.5 * (begin + end), 0.5 * (end - begin)))
    return axes


def _box_distance(middle: Array, half: Array, low: Array, high: Array) -> Array:
    """(N,) [m] of points along a segment from a box; half their spacing is taken off.

    middle, half : (3, N) [m] of the segment. low, high : (3,) [m] corners of the box.
    """
    points = middle + np.linspace(-1.0, 1.0, BOX_POINTS)[:, None, None] * half
    outside = np.maximum(np.maximum(low[:, None] - points, points - high[:, None]), 0.0)
    spacing = 2.0 * np.linalg.norm(half, axis=0) / (BOX_POINTS - 1)
    return np.asarray(np.linalg.norm(outside, axis=1).min(axis=0) - 0.5 * spacing)


def segment_distance(p: Array, u: Array, q: Array, v: Array) -> Array:
    """(...) [m] distance of segments from p - u to p + u and from q - v to q + v, all (3, ...) [m].

    Ericson 2005, sec. 5.1.9.
    """
    r = p - q
    a, e, b = (u * u).sum(axis=0), (v * v).sum(axis=0), (u * v).sum(axis=0)
    c, f = (u * r).sum(axis=0), (v * r).sum(axis=0)
    a, e = np.maximum(a, SHORT**2), np.maximum(e, SHORT**2)
    slanted = a * e - b * b
    parallel = slanted < PARALLEL * a * e
    s = np.where(parallel, 0.0, (b * f - c * e) / np.where(parallel, 1.0, slanted))
    t = np.clip((b * np.clip(s, -1.0, 1.0) + f) / e, -1.0, 1.0)
    s = np.clip((b * t - c) / a, -1.0, 1.0)
    apart = r + s * u - t * v
    return np.asarray(np.sqrt((apart * apart).sum(axis=0)))
