"""Feasible poses: random axis angles, moved to where the instrument can measure, and screened.

Where the robot has to be brought to the instrument (ballbar.cell.instruments), the target has to
stand at a drawn distance from the seat, at a drawn height over a plane, or in a socket: damped
Gauss-Newton steps of least norm from random angles bring it there. Everything else is a screen:
axis box, distance, aim of seat and target, clearance.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames, joint_screws
from ballbar.cell.errors import InputError
from ballbar.cell.number_text import significant_text
from ballbar.cell.placement import Placement
from ballbar.planning.capsules import smallest_distance
from ballbar.planning.stations import Aim, PoseSetup, Station, nominal_stand, station_frames

STEPS = 25  # Gauss-Newton steps towards a distance or a socket
LONGEST_STEP = 0.3  # [rad] of an axis in one of them
DAMPING = 1e-4  # [m^2] added to the squared lever: no axis runs away near a singular pose
FADING = 0.05  # [m] of the error below which the damping fades
CLOSED = 1e-7  # [m] error of the distance or position at which a pose counts as closed
BATCH = 2000  # poses drawn at a time
MOST_BATCHES = 60  # after which too few feasible poses are an error
FIRST_BATCHES = 8  # without a feasible pose, after which none is expected


@dataclass(frozen=True, eq=False)
class Candidates:
    """Feasible poses of one plan."""

    axes: Array  # (K, J) [rad] the controller's axis angles
    station: NDArray[np.intp]  # (K,) of the setup

    @property
    def size(self) -> int:
        """Number K of the poses."""
        return len(self.axes)

    def part(self, selected: NDArray[np.intp] | NDArray[np.bool_]) -> Candidates:
        """Some of the poses."""
        return Candidates(self.axes[selected], self.station[selected])


def joined(parts: list[Candidates]) -> Candidates:
    """The poses of all parts."""
    return Candidates(
        np.concatenate([part.axes for part in parts]),
        np.concatenate([part.station for part in parts]),
    )


@dataclass(eq=False)
class Screen:
    """Counts of what every limit excluded, for a request that allows too little."""

    drawn: int = 0
    excluded: dict[str, int] = field(default_factory=dict)
    nearest: float = np.inf  # [m] smallest error of a drawn distance, or distance from a socket

    def count(self, limit: str, good: NDArray[np.bool_]) -> None:
        """Add the poses that a limit excluded."""
        self.excluded[limit] = self.excluded.get(limit, 0) + int((~good).sum())

    @property
    def sentence(self) -> str:
        """The number of poses that every limit excluded, as part of a sentence."""
        worst = max(self.excluded, key=lambda limit: self.excluded[limit])
        counts = ", ".join(f"{name} {count}" for name, count in self.excluded.items())
        nearest = ""
        if worst == "reach" and np.isfinite(self.nearest) and self.nearest > CLOSED:
            nearest = f"; the target comes no closer than {significant_text(self.nearest * 1e3)} mm"
        return f"of {self.drawn} drawn, excluded: {counts}; the most by {worst}{nearest}"


def random_candidates(setup: PoseSetup, count: int, rng: np.random.Generator) -> Candidates:
    """Feasible poses, as many for each station. Raises InputError where there are too few."""
    share, request = -(-count // len(setup.stations)), setup.request
    parts = []
    for index, station in enumerate(setup.stations):
        screen, batches, total = Screen(), list[Array](), 0
        for batch in range(1, MOST_BATCHES + 1):
            drawn = rng.uniform(setup.lower, setup.upper, (BATCH, setup.robot.joints))
            batches.append(feasible(setup, index, drawn, rng, screen)[0])
            total += len(batches[-1])
            if total >= share or (batch >= FIRST_BATCHES and not total):
                break
        if total < min(share, request.poses):
            raise InputError(
                f"{request.name}: only {total} poses of {setup.robot.name} can be measured from "
                f"{station.seat} at {station.target}, fewer than the {request.poses} of the plan "
                f"({screen.sentence}). Move the seat, or widen that limit."
            )
        axes = np.concatenate(batches)[:share]
        parts.append(Candidates(axes, np.full(len(axes), index, dtype=np.intp)))
    return joined(parts)


def feasible(
    setup: PoseSetup, index: int, axes: Array, rng: np.random.Generator, screen: Screen
) -> tuple[Array, NDArray[np.intp]]:
    """Poses that can be measured at a station, from where the search for them begins.

    axes : (N, J) [rad] axis angles.
    Returns axis angles (K, J) [rad], and from which of the N each comes (K,).
    """
    station, limit = setup.stations[index], setup.request.limits.clearance_m
    screen.drawn += len(axes)
    axes, open_by = _closed(setup, station, axes, rng)
    frames, kind = station_frames(setup, station, axes), setup.instrument.kind
    if kind.local:
        screen.nearest = min(screen.nearest, float(open_by.min()))
    good = np.ones(len(axes), dtype=bool)
    for name, mask in _masks(setup, station, axes, frames, open_by).items():
        screen.count(name, mask | ~good)
        good &= mask
    screened = np.flatnonzero(good)
    frames = station_frames(setup, station, axes[screened])
    clear = smallest_distance(setup, station, frames, line=kind.sighted) >= limit
    screen.count("clearance_m", clear)
    return axes[screened[clear]], screened[clear]


def _masks(
    setup: PoseSetup, station: Station, axes: Array, frames: Frames, open_by: Array
) -> dict[str, NDArray[np.bool_]]:
    """(N,) whether poses keep each limit but that of clearance.

    open_by : (N,) [m] of the target from where the instrument is to measure it.
    """
    rod = frames.tip - station.origin[:, None]
    length, sighted = np.linalg.norm(rod, axis=0), setup.instrument.kind.sighted
    within = (length >= setup.shortest) & (length <= setup.longest) | (not sighted)
    line = rod if sighted else frames.origin[-2] - station.origin[:, None]
    masks = {
        "reach": (open_by < CLOSED) & within,
        "axis range": ((axes >= setup.lower) & (axes <= setup.upper)).all(axis=1),
        "aim of the seat": _aimed(station.seat_aim, line),
    }
    if sighted:
        looks = np.einsum("ikn,in->kn", frames.rotation(-2), -rod)
        masks["aim of the target"] = _aimed(station.target_aim, looks)
    if setup.instrument.view is not None:
        masks["sight of the board"] = setup.instrument.visible(nominal_stand(station, frames))
    return masks


def _aimed(aim: Aim | None, line: Array) -> NDArray[np.bool_]:
    """(N,) whether lines (3, N) lie within an aim's cone."""
    if aim is None:
        return np.ones(line.shape[1], dtype=bool)
    length = np.maximum(np.linalg.norm(line, axis=0), np.finfo(float).tiny)
    return np.asarray(aim.axis @ line / length >= np.cos(aim.angle))


def _closed(
    setup: PoseSetup, station: Station, axes: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Axis angles (N, J) [rad] moved to where the target has drawn values, and what is left (N,)
    [m].

    Those of an instrument that sees the target wherever it is stay as they are.
    """
    kind, seat = setup.instrument.kind, Placement(np.eye(3), station.origin)
    if not kind.local:
        return axes, np.zeros(len(axes))
    values = rng.uniform(setup.shortest, setup.longest, (len(axes), kind.columns))
    axes, left = axes.copy(), np.empty(len(axes))
    open_ = np.arange(len(axes))
    for step_number in range(STEPS + 1):
        frames = station_frames(setup, station, axes[open_])
        sight = kind.sight(values[open_], seat, frames.tip)
        error = np.einsum("din,in->nd", sight.directions, sight.point - frames.tip)
        left[open_] = np.abs(error).max(axis=1)
        still = left[open_] > 0.1 * CLOSED
        open_, error = open_[still], error[still]
        if not open_.size or step_number == STEPS:
            break
        motion = joint_screws(frames)[: frames.x_link.shape[0], :3, still]
        levers = np.einsum("din,jin->ndj", sight.directions[:, :, still], motion)
        levers = levers @ setup.robot.controller_to_joint.T
        # the damping fades as the pose closes
        damping = DAMPING * np.minimum(1.0, np.linalg.norm(error, axis=1) / FADING)[:, None, None]
        square = levers @ levers.transpose(0, 2, 1) + damping * np.eye(error.shape[1])
        step = np.einsum("nej,ne->nj", levers, np.linalg.solve(square, error[:, :, None])[:, :, 0])
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
        axes[open_] = np.clip(axes[open_] + step, setup.lower, setup.upper)
    return axes, left
