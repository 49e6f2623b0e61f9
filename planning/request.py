"""Plan request: cell, region of the ball-bar, encoders, time and limits (`ballbar-plan/1`).

Every limit has a default with its source beside it; assumed ones say so. `load_request` reads
requests for still poses too (ballbar.planning.pose_request).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.descriptions import Robot
from ballbar.cell.extended_yaml import SHIPPED, ExtendableKind, load_extended
from ballbar.cell.load import ballbar_names, load_ballbar, load_robot
from ballbar.cell.schema import Positive, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import parse_model
from ballbar.cell.typical_machine import arm_length
from ballbar.planning.pose_request import POSE_SCHEMA, Cone, PlanName, PosePlanRequest, Seed
from ballbar.planning.workspace import AxisMargin, KeepOut, Region, StatedWorkspace
from ballbar.sim.errors.sensor_errors import EncoderNumber
from ballbar.sim.settings import Vector3


class Cup(Strict):
    """A ball cup of a telescoping bar, and how far the rod may lean in it."""

    axis: Vector3
    """Direction into which the cup opens: of the seat in the base frame, of the target in the
    flange's.
    """
    cone_deg: Cone
    """Largest angle between `axis` and the rod."""

    @model_validator(mode="after")
    def _has_direction(self) -> Cup:
        if not any(self.axis):
            raise wrong_key("axis", message="expected a direction, found zero")
        return self


class PlanCell(Strict):
    """The parts of the cell, and the region of the ball-bar."""

    robot: str
    """A file of cell/robots, or a path that ends in .yaml."""
    ballbar: str | None = None
    """A ball-bar with encoders: a file of cell/instruments, or a path; by default what fits the
    robot's reach.
    """
    instrument: str | None = None
    """In place of `ballbar`: an instrument of a length, such as qc20w_300, or one that follows a
    target on the flange, such as tracker_point.
    """
    tracker: str | None = None
    """Beside a ball-bar with encoders: an instrument that follows a target on the flange; what is
    predicted counts both.
    """
    seat: Cup | None = None
    """Cup on the base of an `instrument`."""
    target: Cup | None = None
    """Cup on the tool, of an `instrument`."""
    ballbar_choices: tuple[str, ...] = ()
    """Ball-bars that may be used instead."""
    plate: str = "plate_250"
    """A file of cell/plates, or a path."""
    ballbar_position_m: Vector3 | None = None
    """Centre of the sphere in the robot's base frame, if it is fixed."""
    ballbar_region_m: Region | None = None
    """Region of it, if it is free; by default in front of the robot, by its reach."""
    keep_out: tuple[KeepOut, ...] = ()
    """Boxes to stay clear of."""
    floor_m: float = 0.0
    """Height of the floor in the robot's base frame."""

    @model_validator(mode="after")
    def _placed(self) -> PlanCell:
        if self.ballbar_position_m is not None and self.ballbar_region_m is not None:
            raise ValueError(
                "give either ballbar_position_m, or ballbar_region_m where the position is free"
            )
        return self

    @model_validator(mode="after")
    def _one_instrument(self) -> PlanCell:
        if self.ballbar is not None and self.instrument is not None:
            raise ValueError(
                "give either ballbar, a ball-bar with encoders, or instrument, which measures its "
                "length"
            )
        for key in ("seat", "target"):
            if self.instrument is None and getattr(self, key) is not None:
                message = "belongs to an instrument; a ball-bar with encoders has no cups"
                raise wrong_key(key, message=message)
        if self.instrument is not None and self.tracker is not None:
            message = "stands beside a ball-bar with encoders; name the other one as instrument"
            raise wrong_key("tracker", message=message)
        if self.instrument is not None and self.ballbar_choices:
            raise wrong_key(
                "ballbar_choices",
                message="belongs to ball-bars with encoders; plan once for each instrument",
            )
        return self

    @property
    def rods(self) -> tuple[str, ...]:
        """Names of the instruments that the path may be planned for."""
        return (self.ballbar or self.instrument or "", *self.ballbar_choices)

    @property
    def region(self) -> tuple[Vector3, Vector3]:
        """Lowest and highest corner of the ball-bar's region; equal where the position is fixed."""
        if self.ballbar_position_m is not None:
            return self.ballbar_position_m, self.ballbar_position_m
        if self.ballbar_region_m is None:
            raise ValueError("neither ballbar_position_m nor ballbar_region_m is given")
        return self.ballbar_region_m.lower, self.ballbar_region_m.upper


class PlanTiming(Strict):
    """Duration of the run and its dwells."""

    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 120.0
    """Whole run with its dwells."""
    dwell_s: Annotated[float, Field(ge=1.0)] = 4.0
    """Dwell at both ends and at each stop, in which the clocks are matched."""
    stops: Annotated[int, Field(ge=0, le=50)] = 2
    """Dwells between the ends."""


class PlanSensors(Strict):
    """Sensors, and standard deviations on which the prediction is based."""

    encoders: tuple[EncoderNumber, ...] = Field((1, 2, 4, 5), min_length=2)
    """Ball-bar joints with an encoder."""
    encoder_sigma_rad: Positive = 1.0e-5
    """Encoder sample: sub-divisional error and noise (notes/plant, 12 urad)."""
    encoder_noise_sigma_rad: Positive = 2.0e-6
    """White noise of the encoders per row."""
    ballbar_rate_hz: Positive = 100.0
    """Rows of the ball-bar per second (thesis sec. 4.6)."""
    robot_sigma_rad: Positive = 5.0e-6
    """Sample of axes 1-3, which ripple models leave; twice that in the wrist."""
    robot_noise_sigma_rad: Positive = 2.0e-6
    """White noise of the robot per row."""
    robot_rate_hz: Positive = 250.0
    """Rows of the robot per second; ABB external log."""
    rod_sigma_m: Positive | None = None
    """Measured rod length; by default the catalogue's tolerance."""
    length_sigma_m: Positive | None = None
    """Sample of a sensed length; by default `sigma_m` of the instrument's file. Taken not to
    average out.
    """


class PlanLimits(Strict):
    """Limits that a path must keep."""

    axis_margin_deg: AxisMargin = 3.0
    axis_speed_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.25
    """Share of each axis's top speed."""
    axis_acceleration_deg_per_s2: Positive = 60.0
    """Acceleration of each axis; assumed, so that inertia stays below a tenth of the weight."""
    tcp_speed_m_per_s: Positive = 0.25
    """Speed of the tool; reduced speed of ISO 10218-1."""
    wrist_margin_deg: Positive = 10.0
    """Distance of axis 5 from its singularity."""
    elbow_margin_deg: Positive = 15.0
    """Distance of the elbow from stretched."""
    shoulder_margin_m: Positive = 0.15
    """Distance of the wrist's centre from axis 1."""
    singular_value: Positive = 0.05
    """In place of the three margins, without parallel axes 2 and 3 and spherical wrist: smallest
    singular value of the Jacobian, lengths in halves of the chain's; assumed (0.06 on the margins
    of an IRB 2400).
    """
    ballbar_margin_deg: Positive = 15.0
    """Distance of b2 and b4 from their singularities (thesis sec. 5.1)."""
    cable_turns: Positive = 1.0
    """Range of each ball-bar joint; the thesis's cables allowed 2 and were in the way."""
    force_N: Positive = 200.0
    """Force in the rod under soft servo, for robots with errors of 1 mm and 1 mrad (a third above
    the thesis's 150 N: notes/plant, experiment). Where the file states no servo, up to 500, by the
    length of the arm.
    """
    clearance_m: Positive = 0.03
    """Distance of robot, plate and rod from each other and everything else."""


# Keys that say nothing of a telescoping bar, by their place: it has neither encoders nor cables nor
# singular angles, and no closed chain, so no force.
OF_BALLBARS = {
    "sensors": (
        "encoders",
        "encoder_sigma_rad",
        "encoder_noise_sigma_rad",
        "ballbar_rate_hz",
        "rod_sigma_m",
    ),
    "limits": ("ballbar_margin_deg", "cable_turns", "force_N"),
}

# Of the arm's length (ballbar.cell.typical_machine): rod of the ball-bar, and lower and upper
# corner of the region of its centre, wider than in the shipped requests, since reach and height of
# arms differ.
ROD_SHARE = 0.32
REGION_SHARES = ((0.3, -0.2, 0.15), (0.8, 0.2, 0.45))
# Limit of the force [N] over the length [m] of arms whose servo is not known: that of PlanLimits up
# to an IRB 2400, and for an NJ 220 that of its request (scenarios/plans).
FORCE_OF_LENGTH = ((1.7, 2.95), (200.0, 500.0))

# Reserves for the motion under soft servo, measured by ballbar.planning.verify: added to margins,
# and factors on rates and force.
RESERVES = {
    **dict.fromkeys(
        ("axis_margin_deg", "wrist_margin_deg", "elbow_margin_deg", "ballbar_margin_deg"), 1.0
    ),
    **dict.fromkeys(("clearance_m", "shoulder_margin_m"), 0.01),
    "singular_value": 0.005,
}
FACTORS = {
    **dict.fromkeys(("axis_speed_share", "tcp_speed_m_per_s", "cable_turns"), 0.9),
    **{"axis_acceleration_deg_per_s2": 0.9, "force_N": 0.8},
}


def tightened(limits: PlanLimits) -> PlanLimits:
    """Limits that a plan keeps so that the run under soft servo keeps the given ones."""
    reserved = {key: getattr(limits, key) + reserve for key, reserve in RESERVES.items()}
    reserved |= {key: getattr(limits, key) * factor for key, factor in FACTORS.items()}
    return limits.model_copy(update=reserved)


class PlanRequest(Strict):
    """A plan request, such as the files of scenarios/plans."""

    schema_: Annotated[Literal["ballbar-plan/1"], Field(alias="schema")]
    name: PlanName
    cell: PlanCell
    timing: PlanTiming = PlanTiming()
    sensors: PlanSensors = PlanSensors()
    limits: PlanLimits = PlanLimits()
    workspace: StatedWorkspace = None
    servo: str = "soft"
    """A gain set of the robot's file, for a ball-bar with encoders."""
    start_from: tuple[str, ...] = ()
    """Path files with which the search begins, relative to this file; without a position of the
    ball-bar, in the middle of the region.
    """
    cycles_max: Annotated[int, Field(ge=1, le=12)] = 5
    """Largest number of cycles of a ball-bar joint in one run."""
    seed: Seed = 1

    @model_validator(mode="after")
    def _keys_are_of_the_instrument(self) -> PlanRequest:
        if not self.telescoping:
            if self.sensors.length_sigma_m is not None:
                message = "belongs to an instrument that measures its length (cell.instrument)"
                raise wrong_key("sensors", "length_sigma_m", message=message)
            return self
        wrong: list[tuple[str, ...]] = [("servo",)] if "servo" in self.model_fields_set else []
        for part, keys in OF_BALLBARS.items():
            stated = getattr(self, part).model_fields_set
            wrong += [(part, key) for key in keys if key in stated]
        if wrong:
            message = (
                "belongs to a ball-bar with encoders (cell.ballbar); a telescoping bar has no "
                "encoders, cables or force in the rod. Leave it out"
            )
            raise wrong_key(*wrong[0], message=message)
        return self

    @property
    def telescoping(self) -> bool:
        """Whether the path is for an instrument that measures its length."""
        return self.cell.instrument is not None


# Requests for a path and for still poses.
REQUESTS = ExtendableKind(
    what="request",
    shipped=SHIPPED / "plans",
    files=("start_from",),
    descriptions=(
        *("cell.robot", "cell.ballbar", "cell.instrument", "cell.tracker", "cell.ballbar_choices"),
        "cell.plate",
        *("robot", "instrument"),
    ),
)


def load_request(path: Path, *, overrides: Sequence[str] = ()) -> PlanRequest | PosePlanRequest:
    """The checked request for a path or for still poses, by the schema that its file states.

    overrides : texts `KEY=VALUE`, such as `seed=2`, that replace values of the file.

    Files that a request for a path names stand relative to it. Raises DescriptionError naming file,
    line and key.
    """
    document = load_extended(path, REQUESTS, overrides=overrides)
    if str(document.data.get("schema")).startswith(f"{POSE_SCHEMA}/"):
        return parse_model(document, PosePlanRequest)
    request = parse_model(document, PlanRequest)
    cell = request.cell

    def located(name: str | None) -> str | None:
        return str(path.parent / name) if name is not None and name.endswith(".yaml") else name

    keys = ("robot", "ballbar", "instrument", "tracker", "plate")
    files: dict[str, object] = {key: located(getattr(cell, key)) for key in keys}
    files["ballbar_choices"] = tuple(map(located, cell.ballbar_choices))
    named = request.model_copy(update={"cell": cell.model_copy(update=files)})
    return completed(named, load_robot(str(files["robot"])))


def completed(request: PlanRequest, robot: Robot) -> PlanRequest:
    """The request with a ball-bar, a region and a limit of the force that fit the robot's size.

    What the request states itself stays, and so does the limit of a robot whose servo is known.
    """
    cell, limits, length = request.cell, request.limits, arm_length(robot)
    chosen: dict[str, object] = {}
    if not (cell.ballbar or cell.instrument):
        bars = {name: load_ballbar(name).length for name in ballbar_names()}
        chosen["ballbar"] = min(bars, key=lambda name: abs(bars[name] - ROD_SHARE * length))
    if not (cell.ballbar_position_m or cell.ballbar_region_m):
        lower, upper = (tuple(length * share for share in corner) for corner in REGION_SHARES)
        chosen["ballbar_region_m"] = Region(lower=lower, upper=upper)
    if robot.lacks("servo") and "force_N" not in limits.model_fields_set:
        force = round(float(np.interp(length, *FORCE_OF_LENGTH)))
        limits = limits.model_copy(update={"force_N": force})
    return request.model_copy(update={"cell": cell.model_copy(update=chosen), "limits": limits})
