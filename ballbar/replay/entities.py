"""Entity paths and timelines of a replay file.

Entities of a recording stand below its root, which is empty for a single recording and `/NAME`
where several were fitted together. What the recordings share, `/notes` and `/parameters`, has no
root. rerun has no unit field, so units stand in entity names and titles.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import rerun as rr

from ballbar.cell.arrays import Array

TIMELINE = "robot_time"  # [s] robot's clock, from the first row of its log
POSE = "pose"  # still poses, counted over all tables

NOTES = "/notes"
PARAMETERS = "/parameters"

# of a recording, below its root
SCENARIO = "/scenario"
CELL = "/cell"
BAR_BODIES = ("stand", "gimbal_b1", "gimbal_b2", "rod_b3", "universal_b4", "universal_b5")
PATH_SO_FAR = "/cell/tool/path_so_far"
NOMINAL_ERROR = "/cell/tool/error_of_nominal_robot"
IDENTIFIED_ERROR = "/cell/tool/error_of_identified_robot"
BEFORE, AFTER = "/residual/before", "/residual/after"
POSITION, ANGLE = "position_um", "angle_urad"
JOINTS = "/robot/joint_angles_deg"
ENCODERS = "/ballbar/encoder_angles_deg"
TCP_ERROR = "/tcp_error"
TCP_BEFORE, TCP_AFTER = "/tcp_error/nominal_um", "/tcp_error/identified_um"
FORCE = "/ballbar/rod_force_N"
FORCE_TRUE, FORCE_IDENTIFIED = f"{FORCE}/true", f"{FORCE}/identified"
STRAIN = "/ballbar/rod_strain_um"
STRAIN_TRUE, STRAIN_IDENTIFIED = f"{STRAIN}/true", f"{STRAIN}/identified"
CLOCK = "/clock/offset_ms"
CLOCK_TRUE, CLOCK_IDENTIFIED = f"{CLOCK}/true", f"{CLOCK}/identified"
CLOCK_ERROR = "/clock/error_us"
COVERED, COVERAGE_SHARE = "/cell/sphere/covered", "/sphere/covered_percent"
LEGEND = "/legend"  # what the arrows in the scene mean, beside it
LANES, EVENT_LOG = "/events/lanes", "/events/log"


@dataclass(frozen=True)
class Branch:
    """A rerun stream whose entities all stand below a root."""

    stream: rr.RecordingStream
    root: str = ""

    def log(self, entity: str, *components: Any, static: bool = False) -> None:
        """Writes one row, as `rr.RecordingStream.log`."""
        self.stream.log(f"{self.root}{entity}", *components, static=static)

    def send_columns(
        self, entity: str, indexes: Iterable[rr.TimeColumn], columns: Iterable[Any]
    ) -> None:
        """Writes many rows, as `rr.RecordingStream.send_columns`."""
        self.stream.send_columns(f"{self.root}{entity}", indexes=indexes, columns=columns)


def root_of(name: str) -> str:
    """The root of a recording; name : may hold `/`, and is empty for a single recording."""
    return "".join(f"/{rr.escape_entity_path_part(part)}" for part in name.split("/") if part)


def at(t: Array) -> list[rr.TimeColumn]:
    """The timeline `robot_time` at instants t (N,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=t)]
