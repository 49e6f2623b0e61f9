"""A candidate: Lissajous parameters of the five ball-bar angles and where the ball-bar stands; as numbers from 0 to 1 for a search.

Of each angle: middle, swing and phase are continuous, whole cycles a run are one of 1 to `cycles_max`. b2 and b4 stay on one side
of their singularities by construction: the swing is a share of the room on either side of the middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.geometry import BAR_ROWS
from planning.request import PlanRequest, tightened
from sim.path import Lissajous

SIDED = (1, 3)  # b2 and b4: negative, as in the path files of this project
DECIMALS, POSITION_DECIMALS = 2, 3  # of degrees and of metres in files
WIDEST = np.pi  # swing of b1, b3 and b5, where the cables allow it


@dataclass(frozen=True, eq=False)
class Candidate:
    """One path and the place of the ball-bar."""

    shape: Lissajous
    position: Array  # (3,) [m] sphere centre, robot base frame


@dataclass(frozen=True, eq=False)
class Space:
    """Where candidates come from."""

    lower: Array  # (3,) [m] of the ball-bar's place
    upper: Array  # (3,) [m]
    margin: float  # [rad] of b2, b4
    widest: float  # [rad] largest swing, cables counted
    cycles: int

    @property
    def size(self) -> int:
        """Numbers of a candidate: middle, swing, phase, cycles of five angles, and the place."""
        return 4 * BAR_ROWS + 3

    def candidate(self, z: Array) -> Candidate:
        """Of numbers z (size,), each folded into 0 to 1."""
        lissajous, position = self.many(z[None])
        return Candidate(
            Lissajous(
                lissajous.centre[0], lissajous.amplitude[0], lissajous.cycles[0], lissajous.phase[0]
            ),
            position[0],
        )

    def many(self, z: Array) -> tuple[Lissajous, Array]:
        """Lissajous parameters (M, 5) and positions (M, 3) of M rows z (M, size)."""
        z = folded(z)
        middle, swing, phase, cycles = (z[:, BAR_ROWS * k : BAR_ROWS * (k + 1)] for k in range(4))
        centre = np.pi * (2.0 * middle - 1.0)
        room = np.full_like(centre, self.widest)
        for k in SIDED:
            low, high = -np.pi + self.margin, -self.margin
            centre[:, k] = low + (high - low) * middle[:, k]
            room[:, k] = np.minimum(centre[:, k] - low, high - centre[:, k])
        whole = 1.0 + np.floor(np.clip(cycles, 0.0, 1.0 - 1e-9) * self.cycles)
        position = self.lower + (self.upper - self.lower) * z[:, 4 * BAR_ROWS :]
        return Lissajous(centre, swing * room, whole, 2.0 * np.pi * phase), position


def numbers_of(space: Space, candidate: Candidate) -> Array:
    """The numbers (size,) that give a candidate, or the nearest to it that the space holds."""
    shape = candidate.shape
    flip = shape.amplitude < 0.0
    centre = np.remainder(shape.centre + np.pi, 2.0 * np.pi) - np.pi
    middle, room = 0.5 * (centre / np.pi + 1.0), np.full(BAR_ROWS, space.widest)
    for k in SIDED:
        low, high = -np.pi + space.margin, -space.margin
        middle[k] = (centre[k] - low) / (high - low)
        room[k] = min(centre[k] - low, high - centre[k])
    phase = np.remainder(shape.phase + np.pi * flip, 2.0 * np.pi) / (2.0 * np.pi)
    wide = np.where(space.upper > space.lower, space.upper - space.lower, 1.0)
    place = np.where(space.upper > space.lower, (candidate.position - space.lower) / wide, 0.0)
    swing = np.abs(shape.amplitude) / np.maximum(room, 1e-9)
    return np.asarray(
        np.clip(
            np.concatenate((middle, swing, phase, (shape.cycles - 0.5) / space.cycles, place)),
            0.0,
            1.0,
        )
    )


def rounded(candidate: Candidate) -> Candidate:
    """As it will stand in the files, so that what is judged, checked and exported is what is written."""
    shape = candidate.shape
    centre, amplitude, phase = (
        np.radians(np.degrees(v).round(DECIMALS))
        for v in (shape.centre, shape.amplitude, shape.phase)
    )
    return Candidate(
        Lissajous(centre, amplitude, shape.cycles, phase),
        candidate.position.round(POSITION_DECIMALS),
    )


def space_of(request: PlanRequest) -> Space:
    """The search space of a request."""
    low, high = request.cell.region
    limits = tightened(request.limits)
    cable = np.pi * limits.cable_turns  # half of the end-to-end range
    return Space(
        np.array(low),
        np.array(high),
        np.radians(limits.ballbar_margin_deg),
        min(WIDEST, float(cable)),
        request.cycles_max,
    )


def folded(z: Array) -> Array:
    """Numbers reflected at 0 and 1, so that a search knows no edge."""
    return np.asarray(1.0 - np.abs(np.mod(z, 2.0) - 1.0))
