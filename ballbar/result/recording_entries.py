"""Recordings and fit in calibration.yaml: what each has of its own, and how well the model fits.

All are in SI units. Recordings are logs of a moving robot or tables of still poses. A key that only
one of these kinds gives is marked with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, Discriminator, Field, Tag

from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.cell.schema import Strict
from ballbar.ident.cameras import CameraEstimate
from ballbar.result.machine_entries import From, ParameterEntry, Positive

LOGS: Final = "logs"  # a kind of recordings
POSES: Final = "poses"
NotNegative = Annotated[float, Field(ge=0.0)]
Three = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Direction = Literal[-1, 1]  # in which an encoder counts, against the declared one
EncoderName = Annotated[str, Field(pattern=r"^b[1-5]$")]
T = TypeVar("T")


@dataclass(frozen=True)
class Of:
    """Mark of a key that only results with recordings of one kind have."""

    kind: str
    needed: bool = True  # whether they all have it


OfLogs = Annotated[T | None, Of(LOGS)]
OfPoses = Annotated[T | None, Of(POSES)]


def marks_of(model: type[BaseModel]) -> Iterator[tuple[str, Of]]:
    """The keys of a part that only one kind of recordings gives, each with its mark."""
    for name, field in model.model_fields.items():
        yield from ((name, mark) for mark in field.metadata if isinstance(mark, Of))


class ClockEntry(Strict):
    """t_robot = offset_s + (1 + skew) * t_instrument; the offset holds a constant latency."""

    offset_s: float
    offset_sigma_s: float
    skew: float
    skew_sigma: float


class NoiseEntry(Strict):
    """Standard deviations of one logged row."""

    joint_rad: tuple[NotNegative, ...]
    encoder_rad: dict[EncoderName, NotNegative]
    length_m: NotNegative | None = None  # of a sensed length


class StepFaultEntry(Strict):
    """A step of an encoder or a clock that was found and repaired."""

    kind: Literal["encoder", "clock"]
    joint: int
    time_s: float
    size: float  # [rad] or [s]
    periods: int


class ResidualEntry(Strict):
    """Residuals of one recording."""

    samples: Annotated[int, Field(ge=0)]
    equations: Annotated[int, Field(ge=0)]
    chi2: NotNegative  # sum of squares of the whitened residuals
    position_rms_m: NotNegative  # of the norm
    angle_rms_rad: NotNegative  # of the norm


class PointErrorsEntry(Strict):
    """Distances between the points of a tracker and those of one robot."""

    rms_m: NotNegative
    largest_m: NotNegative
    # t_robot = clock_offset_s + (1 + clock_skew) * t_tracker
    clock_offset_s: Annotated[float, From("clock.offset")]
    clock_skew: Annotated[float, From("clock.skew")]


class TrackerEntry(Strict):
    """An optical tracker that took no part in the identification. Its frame, clock and LED were
    fitted to each robot.
    """

    acceptable: bool  # whether noise, accuracy and stated TCP uncertainty explain the distances
    points: Annotated[int, From("t.size")]
    # of frame, clock and LED that the points determine
    unknowns: Annotated[int, From("identified.unknowns")]
    degrees_of_freedom: Annotated[int, From("degrees")]
    noise_m: NotNegative  # rms distance by the noise that the log shows
    expected_m: NotNegative  # rms distance by noise, accuracy and stated TCP uncertainty
    identified: PointErrorsEntry
    nominal: PointErrorsEntry


class GrowthEntry(Strict):
    """Growth of a link during a recording."""

    length_m: float
    sigma_m: NotNegative


class RecordingEntry(Strict):
    """Clock, noise, residuals and parameters of one recording of a moving robot."""

    name: str  # of its folder
    encoder_directions: dict[EncoderName, Direction]
    clock: ClockEntry | None = None
    parameters: dict[str, ParameterEntry]  # encoder offsets and base pose
    noise: NoiseEntry
    residuals: ResidualEntry
    tension_source: str = ""
    step_faults: tuple[StepFaultEntry, ...] = ()
    tracker: TrackerEntry | None = None
    temperature_C: float | None = None  # as recording.yaml states it
    # of each long link while it lasted; absent where it was not fitted
    growth: dict[str, GrowthEntry] | None = None


class PlacementEntry(Strict):
    """A seat in the robot's base frame, or a target in the flange's."""

    position_m: Annotated[Three, From("placement.origin")]
    position_sigma_m: Annotated[Three, From("sigma")]
    rotation_vector_rad: Three | None = None  # None for a point
    rotation_sigma_rad: Three | None = None  # about each axis; None of an older file too

    @property
    def turned(self) -> bool:
        """Whether its orientation is known."""
        return self.rotation_vector_rad is not None

    @property
    def placement(self) -> Placement:
        """The frame; a point is not turned."""
        turn = np.array(self.rotation_vector_rad or (0.0, 0.0, 0.0))
        rotation = matrix_from_rotvec(turn[:, None])[:, :, 0]
        return Placement(rotation, np.array(self.position_m))


class LensEntry(Strict):
    """One value of a lens or a board, before and after anything was measured."""

    value: float
    sigma: NotNegative
    stated: float
    stated_sigma: NotNegative


class CameraEntry(Strict):
    """Lens of a camera [px, and distortion], and how its board differs from the board's file:
    relative sizes, and sag [m] over half of its size.
    """

    noise_px: Positive  # of a corner
    values: dict[str, LensEntry]


def camera_entries(cameras: Mapping[str, CameraEstimate]) -> dict[str, CameraEntry]:
    """The entries of cameras by their names."""
    entries, keys = {}, list(LensEntry.model_fields)
    for name, camera in cameras.items():
        known = np.column_stack((camera.values, camera.sigma, camera.errors.declared)).tolist()
        values = {
            value: LensEntry(**dict(zip(keys, row, strict=True)))
            for value, row in zip(camera.errors.names, known, strict=True)
        }
        entries[name] = CameraEntry(noise_px=camera.errors.noise, values=values)
    return entries


class GroupEntry(Strict):
    """Poses of one seat and one target."""

    file: str
    measured: str
    seat: str
    target: str
    poses: int
    position_rms_m: float  # distance of measurement and model
    clock: ClockEntry | None = None  # of an instrument that followed a moving robot


class OrderEntry(Strict):
    """A joint error that was found by evidence."""

    joint: int  # from 1
    order: int  # cycles a turn; candidates at still poses are whole
    score: float
    gain: float
    aliases: tuple[int, ...] = ()


class CrossValidationEntry(Strict):
    """Errors of poses in regions of joint space that were not fitted."""

    mean_m: Positive
    quantile_95_m: Annotated[Positive, From("quantile")]
    sigma_m: Positive  # along each axis
    white_m: NotNegative | None = None  # part of it that is noise of what followed the robot
    # of the 95 % region, over that of chi-square
    region_factor: Annotated[Positive, From("factor_of_points")]


class ClosureEntry(Strict):
    """How far robot and ball-bar disagree about the tool."""

    position_rms_m: float
    position_max_m: float
    angle_rms_rad: float
    ratio: float  # residual over what noise explains


class HeldOutEntry(Strict):
    """A recording that took no part in the identification."""

    name: str  # of its folder
    sentence: str
    acceptable: bool
    samples: int
    identified: ClosureEntry
    normalised_innovation: float  # residual over what noise and the stated uncertainty explain
    nominal: ClosureEntry
    step_faults: tuple[StepFaultEntry, ...]
    tracker: TrackerEntry | None = None


class PoseHeldOutEntry(Strict):
    """A table of poses that took no part in the identification."""

    name: str
    sentence: str
    acceptable: bool
    poses: int
    mean_m: float
    quantile_95_m: float
    nominal_mean_m: float


class ExcessEntry(Strict):
    """Standard deviations of noise beyond what the logs show."""

    gear_rad: NotNegative  # of axes 1 to 3
    wrist_rad: NotNegative  # of the axes behind them
    bar_rad: NotNegative  # of each ball-bar encoder
    rod_m: NotNegative


class FitEntry(Strict):
    """How the fit went."""

    status: str
    verdict: str
    warnings: tuple[str, ...]
    iterations: int
    unknowns: int
    chi2_per_dof: OfLogs[float] = None
    autocorrelation: OfLogs[float] = None
    rank: OfLogs[int] = None
    condition: OfLogs[float] = None
    rod_sigma_m: OfLogs[float] = None  # deviation of the rod from a constant length
    # older files do not state it
    excess: Annotated[ExcessEntry | None, Of(LOGS, needed=False)] = None
    poses: OfPoses[int] = None
    # at the measured poses, all axes together; older files do not state it
    tcp_sigma_at_poses_m: Annotated[Positive | None, Of(POSES, needed=False)] = None
    # stated, all axes together: of logs with the scale, of poses over the fitted ranges
    tcp_sigma_mean_m: float
    # older files do not state it
    tcp_sigma_without_scale_mean_m: Annotated[float | None, Of(LOGS, needed=False)] = None
    discrepancy_m: OfPoses[float] = None  # of a fitted pose from the model, along each axis
    residual_mean_m: OfPoses[float] = None
    # of the robot as its file has it, seats and targets fitted
    nominal_mean_m: OfPoses[float] = None


def _tag(log: type[Strict], poses: type[Strict], entry: object) -> str:
    """Which of two classes an entry is of: a mapping that was read, or an object to be written."""
    marks = poses.model_fields.keys() - log.model_fields.keys()
    of_poses = isinstance(entry, poses) or (isinstance(entry, dict) and bool(marks & entry.keys()))
    return (poses if of_poses else log).__name__


AnyRecording = Annotated[
    Annotated[RecordingEntry, Tag("RecordingEntry")] | Annotated[GroupEntry, Tag("GroupEntry")],
    Discriminator(lambda entry: _tag(RecordingEntry, GroupEntry, entry)),
]
AnyHeldOut = Annotated[
    Annotated[HeldOutEntry, Tag("HeldOutEntry")]
    | Annotated[PoseHeldOutEntry, Tag("PoseHeldOutEntry")],
    Discriminator(lambda entry: _tag(HeldOutEntry, PoseHeldOutEntry, entry)),
]
