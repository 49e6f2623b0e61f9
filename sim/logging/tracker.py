"""An optical tracker beside the cell: it logs where an LED on the tool is.

Such as the Nikon K600 of thesis sec. 5.3. The tracker has a frame and a clock of its own and
measures the true tool, deflection included; nothing else in the recording depends on it.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cell.arrays import Array
from cell.clock import Clock
from cell.rotation import matrix_from_rotvec
from cell.schema import Strict
from sim.motion import Motion
from sim.streams import stream

LedCoordinate = Annotated[float, Field(ge=-1.0, le=1.0)]
TRACKER_EPOCH = 83.0  # [s] up-time of the tracker at its first row
DISTANCE = 3.0  # [m] of the tracker from the robot's base; assumed


class OpticalTracker(Strict):
    """An optical tracker logs the position of an LED on the tool, in its own frame, with its own
    rate and clock. The result is validated by it; no fit uses it.
    """

    rate_hz: Annotated[float, Field(ge=10.0, le=10_000.0)] = 100.0
    """Rows per second. Assumed."""
    noise_m: Annotated[float, Field(ge=0.0, le=0.01)] = 9.0e-5
    """Standard deviation of white noise along each axis (thesis sec. 5.3: below 90 um)."""
    led_m: Annotated[tuple[LedCoordinate, ...], Field(min_length=3, max_length=3)] = (
        -0.05,
        0.04,
        0.03,
    )
    """The LED in the tool's frame: x along the plate, away from the flange, from the centre of the
    universal joint. Assumed.
    """
    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0)] = 0.2
    """Time from the first row of the robot to the first of the tracker."""
    skew: Annotated[float, Field(ge=-2e-3, le=2e-3)] = 0.0
    """Seconds that the robot's clock gains in each second of the tracker's."""


class TrackerTruth(Strict):
    """The drawn frame of the tracker in the robot's base frame, and its clock and LED."""

    position_m: tuple[float, ...]
    rotation_vector_rad: tuple[float, ...]
    led_m: tuple[float, ...]
    offset_s: float
    skew: float

    def seen(self, points: Array) -> Array:
        """(N, 3) [m] in the tracker's frame of points (N, 3) [m] in the robot's base frame."""
        turn = matrix_from_rotvec(np.array(self.rotation_vector_rad)[:, None])[:, :, 0]
        return np.asarray((points - np.array(self.position_m)) @ turn)


def drawn_tracker(tracker: OpticalTracker | None, seed: int) -> TrackerTruth | None:
    """A tracker at a place and in an orientation that are drawn; None without one."""
    if tracker is None:
        return None
    rng = stream(seed, "tracker_frame")
    direction, quaternion = rng.standard_normal(3), rng.standard_normal(4)
    turn, axis = 2.0 * np.arctan2(np.linalg.norm(quaternion[1:]), quaternion[0]), quaternion[1:]
    return TrackerTruth(
        position_m=tuple((DISTANCE * direction / np.linalg.norm(direction)).tolist()),
        rotation_vector_rad=tuple((turn * axis / np.linalg.norm(axis)).tolist()),
        led_m=tracker.led_m,
        offset_s=tracker.offset_s,
        skew=tracker.skew,
    )


def tracker_rows(
    motion: Motion,
    first: float,
    last: float,
    *,
    tracker: OpticalTracker,
    drawn: TrackerTruth,
    seed: int,
) -> tuple[Array, Array]:
    """Stamps (N,) [s] on the tracker's clock and points (N, 3) [m] in its frame.

    first, last : [s] true times of the robot's first and last row; the tracker logs as long.
    """
    rows = int((last - first) * tracker.rate_hz) + 1
    elapsed = np.arange(rows, dtype=np.float64) / tracker.rate_hz
    times = first + Clock(drawn.offset_s, drawn.skew).robot_time(elapsed)
    rotation, tool = motion.tool_at(times)
    led = tool + np.einsum("ijn,j->in", rotation, np.array(drawn.led_m))
    points = drawn.seen(led.T)
    noise = stream(seed, "tracker_noise").normal(0.0, tracker.noise_m, points.shape)
    return TRACKER_EPOCH + elapsed, np.asarray(points + noise)
