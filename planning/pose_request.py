"""Request for a plan of still poses: robot, instrument, seats, targets and limits.

Schema `ballbar-pose-plan/1`. Lists of axes have one value for each axis of the robot.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ballbar.cell.pose_file import KnownDistances
from ballbar.cell.schema import Name, Positive, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.planning.workspace import Axes, AxisMargin, KeepOut, StatedWorkspace
from ballbar.sim.settings import Vector3

POSE_SCHEMA = "ballbar-pose-plan"
Cone = Annotated[float, Field(gt=0.0, le=180.0)]
PlanName = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z][A-Za-z0-9_]{0,23}$",
        description="Name of the plan and of the controller's module.",
    ),
]
Seed = Annotated[int, Field(ge=0, description="Seed of all drawn values.")]


class PlannedBoard(Strict):
    """The board that a camera sees: the seat and the target are the two."""

    file: str
    """Its file (schema `ballbar-board/1`), from the folder of the request."""
    camera: Literal["cell", "flange"] = "cell"
    """Where the camera stands: in the cell, with the board on the flange, or on the flange."""
    tilt_max_deg: Annotated[float, Field(gt=0.0, lt=90.0)] = 50.0
    """Largest angle between the line of sight and the board's normal."""


class SeatEntry(Strict):
    """One placement of the instrument, or one socket."""

    name: Name = "seat"
    """Name of the seat in poses.yaml."""
    position_m: Vector3
    """In the robot's base frame, to a few millimetres."""
    axis: Vector3 | None = None
    """Direction in the base frame about which the instrument can aim, or from which the flange
    comes to a socket.
    """
    cone_deg: Cone = 180.0
    """Largest angle from `axis`."""
    rotvec_rad: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of a camera or board in the base frame, as rotation vector."""


class TargetEntry(Strict):
    """One ball or reflector on the flange."""

    name: Name = "target"
    """Name of the target in poses.yaml."""
    position_m: Vector3
    """In the frame of the flange."""
    axis: Vector3 | None = None
    """Direction in the flange's frame into which the target looks."""
    cone_deg: Cone = 180.0
    """Largest angle between `axis` and the instrument; 30 for a reflector."""
    rotvec_rad: Vector3 = (0.0, 0.0, 0.0)
    """Orientation of a camera or board in the flange's frame, as rotation vector."""


class PosePlanLimits(Strict):
    """Limits that every pose keeps."""

    axis_lower_deg: Axes | None = None
    """Box of the controller's axis angles; by default the axis ranges."""
    axis_upper_deg: Axes | None = None
    axis_margin_deg: AxisMargin = 3.0
    stroke_margin_share: Annotated[float, Field(ge=0.0, lt=0.5)] = 0.1
    """Share of the stroke of a length instrument to keep free at either end."""
    clearance_m: Annotated[float, Field(ge=0.0)] = 0.03
    """Distance of arm, target and rod or beam from each other and the rest."""
    floor_m: float | None = 0.0
    """Height of the floor in the base frame; null where there is none."""
    keep_out: tuple[KeepOut, ...] = ()
    """Boxes to stay clear of."""


class PosePlanRequest(Strict):
    """A request for still poses, such as `scenarios/plans/irb2400_tracker.yaml`."""

    schema_: Annotated[Literal["ballbar-pose-plan/1"], Field(alias="schema")]
    name: PlanName
    robot: str
    """A file of cell/robots, or a path that ends in .yaml."""
    instrument: str
    """A file of cell/instruments, or a path."""
    seats: Annotated[tuple[SeatEntry, ...], Field(min_length=1)]
    """Placements of the instrument."""
    board: PlannedBoard | None = None
    """Board that the pictures of a camera show."""
    targets: Annotated[tuple[TargetEntry, ...], Field(min_length=1)]
    """Targets on the flange. The predicted TCP error is that of the first."""
    distances: tuple[KnownDistances, ...] = ()
    """Known distances between seats, as in poses.yaml."""
    poses: Annotated[int, Field(ge=10, le=500)] = 40
    """Number of poses, over all seats and targets."""
    limits: PosePlanLimits = PosePlanLimits()
    workspace: StatedWorkspace = None
    unexplained_m: Positive = 5e-5
    """Standard deviation of what the model leaves of a position along each axis, beside smooth
    errors of the joints.
    """
    unexplained_rad: Positive = 1e-4
    """The same of a rotation about each axis, where poses are measured."""
    settle_s: Annotated[float, Field(ge=0.0)] = 3.0
    """Time for which the programs wait at each pose."""
    candidates: Annotated[int, Field(ge=200, le=20_000)] = 2000
    """Number of feasible poses from which the plan is selected."""
    seed: Seed = 1

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        for key in ("seats", "targets"):
            names = [part.name for part in getattr(self, key)]
            for i, name in enumerate(names):
                if name in names[:i]:
                    message = f"expected another name than {name!r}, which stands above"
                    raise wrong_key(key, i, "name", message=message)
        return self

    @model_validator(mode="after")
    def _cones_have_axes(self) -> Self:
        for key in ("seats", "targets"):
            for i, part in enumerate(getattr(self, key)):
                if part.cone_deg < 180.0 and part.axis is None:
                    raise wrong_key(key, i, "cone_deg", message="give axis beside cone_deg")
                if part.axis is not None and not any(part.axis):
                    raise wrong_key(key, i, "axis", message="expected a direction, found zero")
        return self
