"""Candidates: Lissajous parameters of the five ball-bar angles and the position of the ball-bar.

For a search, a candidate is a genome of numbers from 0 to 1. Centre, amplitude and phase of each
angle are continuous; the cycles per run are one of 1 to `cycles_max`. b2 and b4 stay on one side of
their singularities by construction: the amplitude is a share of the room on either side of the
centre.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import BAR_ROWS
from ballbar.planning.request import PlanRequest, tightened
from ballbar.sim.path import Lissajous, RodHarmonic

SIDED = (1, 3)  # b2 and b4: negative, as in the path files of this project
AMPLITUDES = slice(BAR_ROWS, 2 * BAR_ROWS)  # shares of the room, among the numbers of a genome
DECIMALS, POSITION_DECIMALS = 2, 3  # of degrees and of metres in files
WIDEST = np.pi  # [rad] largest amplitude of b1, b3 and b5, where the cables allow it
# [rad] the same of a telescoping bar: of wider paths an arm reaches a fifth as many (UR10e)
WIDEST_FREE = 0.5 * np.pi
# A sensed length has to vary, or nothing tells its log's clock. Two harmonics of its path, as in
# scenarios/paths/irb2400_telescoping.yaml: share of the swing, cycles per second, phase [rad]
SWING, LARGEST_SWING = 0.125, 0.005  # share of the stroke, and [m], to each side
HARMONICS = ((0.6, 0.34, 0.0), (0.4, 0.19, 1.0))


@dataclass(frozen=True, eq=False)
class PathCandidate:
    """One path and the position of the ball-bar."""

    shape: Lissajous
    position: Array  # (3,) [m] sphere centre, robot base frame


@dataclass(frozen=True, eq=False)
class Space:
    """The search space of candidates."""

    lower: Array  # (3,) [m] of the ball-bar's position
    upper: Array  # (3,) [m]
    margin: float  # [rad] of b2, b4
    widest: float  # [rad] largest amplitude that the cables allow
    cycles: int
    rod: tuple[RodHarmonic, ...] = ()  # of every candidate, where the rod's length is sensed

    @property
    def size(self) -> int:
        """Length S of a genome: centre, amplitude, phase and cycles of five angles; position."""
        return 4 * BAR_ROWS + 3

    def candidate(self, genome: Array) -> PathCandidate:
        """The candidate of a genome (S,) [-], each number folded into 0 to 1."""
        shapes, positions = self.many(genome[None])
        return PathCandidate(shape_of(shapes, 0), positions[0])

    def many(self, genomes: Array) -> tuple[Lissajous, Array]:
        """Lissajous parameters (M, 5) and positions (M, 3) [m] of genomes (M, S) [-]."""
        genomes = folded(genomes)
        middle, share, phase, cycles = (
            genomes[:, BAR_ROWS * k : BAR_ROWS * (k + 1)] for k in range(4)
        )
        centre = np.pi * (2.0 * middle - 1.0)
        room = np.full_like(centre, self.widest)
        for k in SIDED:
            low, high = -np.pi + self.margin, -self.margin
            centre[:, k] = low + (high - low) * middle[:, k]
            room[:, k] = np.minimum(centre[:, k] - low, high - centre[:, k])
        whole_cycles = 1.0 + np.floor(np.clip(cycles, 0.0, 1.0 - 1e-9) * self.cycles)
        position = self.lower + (self.upper - self.lower) * genomes[:, 4 * BAR_ROWS :]
        shapes = Lissajous(centre, share * room, whole_cycles, 2.0 * np.pi * phase, self.rod)
        return shapes, position


def shape_of(shapes: Lissajous, k: int | NDArray[np.intp]) -> Lissajous:
    """The k-th of Lissajous parameters (M, 5), or several of them."""
    parts = ("centre", "amplitude", "cycles", "phase")
    return replace(shapes, **{name: getattr(shapes, name)[k] for name in parts})


def genome_of(space: Space, candidate: PathCandidate) -> Array:
    """(S,) [-] genome of a candidate, or of the nearest one that the space holds."""
    shape = candidate.shape
    flip = shape.amplitude < 0.0
    centre = np.remainder(shape.centre + np.pi, 2.0 * np.pi) - np.pi
    middle, room = 0.5 * (centre / np.pi + 1.0), np.full(BAR_ROWS, space.widest)
    for k in SIDED:
        low, high = -np.pi + space.margin, -space.margin
        middle[k] = (centre[k] - low) / (high - low)
        room[k] = min(centre[k] - low, high - centre[k])
    share = np.abs(shape.amplitude) / np.maximum(room, 1e-9)
    phase = np.remainder(shape.phase + np.pi * flip, 2.0 * np.pi) / (2.0 * np.pi)
    cycles = (shape.cycles - 0.5) / space.cycles
    free = space.upper > space.lower
    extent = np.where(free, space.upper - space.lower, 1.0)
    position = np.where(free, (candidate.position - space.lower) / extent, 0.0)
    genome = np.concatenate((middle, share, phase, cycles, position))
    return np.asarray(np.clip(genome, 0.0, 1.0))


def rounded(candidate: PathCandidate) -> PathCandidate:
    """The candidate as files will state it, so that what is evaluated is what is written."""
    shape = candidate.shape
    centre, amplitude, phase = (
        np.radians(np.degrees(v).round(DECIMALS))
        for v in (shape.centre, shape.amplitude, shape.phase)
    )
    return PathCandidate(
        Lissajous(centre, amplitude, shape.cycles, phase, shape.rod),
        candidate.position.round(POSITION_DECIMALS),
    )


def space_of(request: PlanRequest, stroke: tuple[float, float] | None = None) -> Space:
    """The search space of a request; stroke : [m] shortest and longest length that is sensed."""
    low, high = request.cell.region
    limits = tightened(request.limits)
    cable = float(np.pi * limits.cable_turns)  # half of the range from end to end
    free = request.telescoping  # of singular angles and of cables
    return Space(
        lower=np.array(low),
        upper=np.array(high),
        margin=0.0 if free else np.radians(limits.ballbar_margin_deg),
        widest=WIDEST_FREE if free else min(WIDEST, cable),
        cycles=request.cycles_max,
        rod=() if stroke is None else _rod(stroke, request.timing.duration_s),
    )


def _rod(stroke: tuple[float, float], duration: float) -> tuple[RodHarmonic, ...]:
    """Harmonics of the rod over a path of `duration` seconds, within a stroke [m]."""
    swing = min(LARGEST_SWING, SWING * (stroke[1] - stroke[0]))
    return tuple(
        RodHarmonic(float(f"{share * swing:.3g}"), max(1, round(rate * duration)), phase)
        for share, rate, phase in HARMONICS
    )


def folded(genomes: Array) -> Array:
    """Genomes (..., S) [-] reflected at 0 and 1, so that a search has no boundary."""
    return np.asarray(1.0 - np.abs(np.mod(genomes, 2.0) - 1.0))
