"""calibration.yaml: the identified machine (schema `ballbar-calibration/2`), in SI units.

What the recordings share stands once; encoder offsets, base pose and clock stand with each of them,
also when there is only one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, cast

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from ballbar.result.names import CALIBRATION
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.result.write_result import write_result
from cell.arrays import Array
from cell.descriptions import Cell
from cell.errors import DescriptionError, InputError
from cell.files import copied_description
from cell.geometry import Geometry, ParameterTable, parameter_named, parameter_table, table_of_names
from cell.load import load_measured_cell
from cell.payload import TOOL, LinkDeviation, Payload, with_payload
from cell.schema import LARGEST_OTHER, Strict
from cell.schema_errors import Loc, nearest, wrong_key
from cell.statistics import rms
from cell.strict_yaml import check_schema, load_yaml, parse_model
from ident.corrections import OF_MACHINE
from ident.estimator.noise import ExcessNoise
from ident.estimator.unknowns import belongs_to_recording, shared_names
from ident.held_out import HeldOut, LoopClosure
from ident.loads.payload import PayloadEstimate
from ident.result import (
    CoefficientEstimate,
    CorrectionEstimate,
    Machine,
    RobotEstimate,
    unloaded_robot,
)
from ident.robot.tool_covariance import ToolCovariance
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.step_fault import StepFault
from ident.tracker import TrackerCheck

if TYPE_CHECKING:
    from ballbar.result.pose_calibration import PoseCalibration
    from ident.robot.identified_kinematics import IdentifiedKinematics

SCHEMA: Final = "ballbar-calibration/2"
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
ParameterValue = Annotated[float, Field(ge=-1e3, le=1e3)]  # [m] or [rad]
Direction = Literal[-1, 1]  # in which an encoder counts, against the declared one
EncoderName = Annotated[str, Field(pattern=r"^b[1-5]$")]
POSES = "poses"  # `model` of a result of still poses
# Least eigenvalue of a correlation that rounding may leave negative; -1e-15 is seen where a
# covariance has lost a direction.
ROUNDING = 1e-6
RESTORE = "Restore the file as it was written, or identify again"


def one_of(names: Collection[str], what: str) -> AfterValidator:
    """Refuses texts that are none of some names, and says which one may be meant."""

    def check(name: str) -> str:
        if name not in names:
            raise ValueError(f"no {what}.{nearest(name, names, noun='name')}")
        return name

    return AfterValidator(check)


CorrectionName = Annotated[str, one_of(OF_MACHINE, "correction of results")]


class ParameterEntry(Strict):
    """One kinematic parameter; lengths in m, angles in rad."""

    nominal: ParameterValue
    value: ParameterValue
    sigma: float | None = None
    identified: bool


class ClockEntry(Strict):
    """t_robot = offset_s + (1 + skew) * t_ballbar."""

    offset_s: float
    offset_sigma_s: float
    skew: float
    skew_sigma: float


class NoiseEntry(Strict):
    """Standard deviations of one logged row."""

    joint_rad: tuple[NotNegative, ...]
    encoder_rad: dict[EncoderName, NotNegative]
    length_m: NotNegative | None = None  # of a sensed length


class CoefficientEntry(Strict):
    """One coefficient of a correction, SI units."""

    value: float
    sigma: float
    prior: float
    prior_sigma: float
    information_gain: float  # 0: the prior alone; 1: the data alone
    unit: str


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
    clock_offset_s: float  # t_robot = clock_offset_s + (1 + clock_skew) * t_tracker
    clock_skew: float


class TrackerEntry(Strict):
    """An optical tracker that took no part in the identification. Its frame, clock and LED were
    fitted to each robot.
    """

    acceptable: bool  # whether noise, accuracy and stated TCP uncertainty explain the distances
    points: int
    unknowns: int  # of frame, clock and LED that the points determine
    degrees_of_freedom: int
    noise_m: NotNegative  # rms distance by the noise that the log shows
    expected_m: NotNegative  # rms distance by noise, accuracy and stated TCP uncertainty
    identified: PointErrorsEntry
    nominal: PointErrorsEntry


class RecordingEntry(Strict):
    """What one recording has of its own."""

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
    chi2_per_dof: float
    autocorrelation: float
    rank: int
    condition: float
    rod_sigma_m: float  # deviation of the rod from a constant length
    excess: ExcessEntry | None = None  # older files do not state it
    tcp_sigma_mean_m: float  # stated, with the scale
    tcp_sigma_without_scale_mean_m: float | None = None  # older files do not state it


class DroppedEntry(Strict):
    """A parameter left at its nominal value, and why."""

    name: str
    reason: str
    on: tuple[str, ...] = ()


class LinkMassEntry(Strict):
    """How one link deviates from the robot's file, the arm's factor apart."""

    scale: Positive  # of its mass and inertia
    shift_m: tuple[float, float, float]  # of its centre, frame of the robot's file


class MassesEntry(Strict):
    """Masses that the fit took from the torque logs in place of those of the files."""

    tool_kg: Positive
    tool_sigma_kg: Positive
    tool_stated_kg: float
    tool_com_m: tuple[float, float, float]  # robot flange frame
    arm_scale: Positive  # of the masses in the robot's file
    arm_scale_sigma: Positive
    links: tuple[LinkMassEntry, ...] = ()  # of links 1 to J beside that

    @model_validator(mode="after")
    def _is_payload(self) -> MassesEntry:
        _ = self.payload  # which refuses masses that no tool has
        return self

    @property
    def payload(self) -> Payload:
        links = tuple(LinkDeviation(link.scale, np.array(link.shift_m)) for link in self.links)
        return Payload(self.tool_kg, np.array(self.tool_com_m), self.arm_scale, links)


class RangeEntry(Strict):
    """Range of a joint's angle over which the robot was fitted."""

    lower_rad: float
    upper_rad: float

    @model_validator(mode="after")
    def _is_not_reversed(self) -> RangeEntry:
        if self.lower_rad > self.upper_rad:
            raise wrong_key("lower_rad", message=f"expected at most upper_rad, {self.upper_rad:g}")
        return self


class CovarianceEntry(Strict):
    """Stated covariance of the machine, SI units; what is not named was taken as exact."""

    names: tuple[str, ...]  # parameters of robot and instrument, then all coefficients
    # one standard deviation of each direction of masses: mass [kg] and first moment [kg m] of the
    # tool, then mass (relative) and centre [m] of each link
    masses: tuple[tuple[float, ...], ...]
    held: tuple[str, ...] = ()  # parameters of the instrument that the fit took as exact
    lower: tuple[str, ...]  # rows of the lower triangle: names, held, directions of masses

    @model_validator(mode="after")
    def _is_covariance(self) -> CovarianceEntry:
        unknowns = (*self.names, *self.held, *(f"mass {k + 1}" for k in range(len(self.masses))))
        if len(self.lower) != len(unknowns):
            raise wrong_key(
                "lower",
                message=f"expected {len(unknowns)} rows, one for each of names, held and masses, "
                f"found {len(self.lower)}. {RESTORE}",
            )
        values = self.covariance.values
        # of what the fit took as exact the files may say that it is
        exact = ~values.any(axis=1) & np.isin(unknowns, self.held)
        for k in np.flatnonzero((np.diag(values) <= 0.0) & ~exact):
            raise wrong_key(
                "lower",
                int(k),
                message=f"expected a variance of {unknowns[k]} above 0 as the last number. "
                f"{RESTORE}",
            )
        scale = np.sqrt(np.where(exact, 1.0, np.diag(values)))
        if not _is_positive(values / np.outer(scale, scale) + ROUNDING * np.eye(len(values))):
            raise wrong_key(
                "lower",
                message="these numbers are no covariance: some combination of the unknowns would "
                f"have a negative variance. {RESTORE}",
            )
        return self

    @cached_property
    def covariance(self) -> ToolCovariance:
        values = np.zeros((len(self.lower), len(self.lower)))
        for k, row in enumerate(self.lower):
            values[k, : k + 1] = values[: k + 1, k] = _numbers_of_row(k, row)
        masses = np.array(self.masses) if self.masses else np.zeros((0, 0))
        return ToolCovariance(self.names, masses, values, self.held)


def _is_positive(matrix: Array) -> bool:
    """Whether a symmetric matrix is positive definite."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def _numbers_of_row(k: int, row: str) -> list[float]:
    """The numbers of row k, from 0, of a lower triangle."""
    try:
        numbers = list(map(float, row.split()))
        extremes = (min(numbers), max(numbers), sum(numbers))  # the sum of a NaN is one
    except ValueError:  # also of an empty row
        numbers, extremes = [], (0.0, 0.0, 0.0)
    if len(numbers) != k + 1 or not all(abs(number) <= LARGEST_OTHER for number in extremes):
        raise wrong_key(
            "lower",
            k,
            message=f"expected numbers, {k + 1} finite ones with spaces between. {RESTORE}",
        )
    return numbers


class CalibrationFile(Strict):
    """Schema of calibration.yaml."""

    model_config = ConfigDict(populate_by_name=True)  # `schema` is a method of pydantic's

    schema_: Annotated[Literal["ballbar-calibration/2"], Field(alias="schema")]
    robot: str
    instrument: str
    plate: str
    model: Literal["dh", "complete"]
    parameters: dict[str, ParameterEntry]  # of robot and instrument
    dropped: tuple[DroppedEntry, ...] = ()
    corrections: dict[CorrectionName, dict[str, CoefficientEntry]] = Field(default_factory=dict)
    masses: MassesEntry | None = None  # absent where those of the files were used
    ranges: tuple[RangeEntry, ...] = ()  # of the joints; older files do not state them
    covariance: CovarianceEntry | None = None  # likewise
    recordings: Annotated[tuple[RecordingEntry, ...], Field(min_length=1)]
    fit: FitEntry
    held_out: tuple[HeldOutEntry, ...] = ()

    @model_validator(mode="after")
    def _is_of_one_mechanism(self) -> CalibrationFile:
        """Parameters, ranges, masses and covariance are of the same joints and unknowns."""
        _check_names(("parameters",), self.parameters, lambda name: not belongs_to_recording(name))
        table = table_of_names(self.parameters)
        _check_complete(("parameters",), self.parameters, shared_names(table))
        own = [name for name in table.names if belongs_to_recording(name)]
        for k, recording in enumerate(self.recordings):
            place = ("recordings", k, "parameters")
            _check_names(place, recording.parameters, belongs_to_recording)
            _check_complete(place, recording.parameters, own)
        counts: dict[Loc, int] = {("ranges",): len(self.ranges)}
        if self.masses is not None:
            counts["masses", "links"] = len(self.masses.links)
        for loc, count in counts.items():
            if count not in (0, table.joints):
                raise wrong_key(
                    *loc,
                    message=f"expected one for each of the {table.joints} joints that `parameters` "
                    f"has, found {count}",
                )
        if self.covariance is not None:
            self._check_unknowns(self.covariance, table)
        return self

    def _check_unknowns(self, stated: CovarianceEntry, table: ParameterTable) -> None:
        """The covariance names parameters in the order of the table, then all coefficients."""
        names, shared = set(stated.names), shared_names(table)
        coefficients = [name for entries in self.corrections.values() for name in entries]
        expected = {
            "names": [*(n for n in shared if n in names), *coefficients],
            "held": [n for n in shared if n in stated.held and n not in names],
        }
        for key, order in expected.items():
            for k, pair in enumerate(zip_longest(getattr(stated, key), order)):
                if pair[0] != pair[1]:
                    raise wrong_key(
                        *("covariance", key, k)[: 3 if pair[0] else 2],
                        message=f"expected {pair[1] or 'no further name'} as name {k + 1}: each "
                        "name once, parameters in the order ra, rd, ralpha, rtheta, rbeta, ba, bd, "
                        f"balpha, then the coefficients in the order of `corrections`. {RESTORE}",
                    )
        size = TOOL + 4 * table.joints
        for k, direction in enumerate(stated.masses):
            if len(direction) != size:
                raise wrong_key(
                    *("covariance", "masses", k),
                    message=f"expected {size} numbers, of the tool and of {table.joints} links, "
                    f"found {len(direction)}",
                )

    def geometry(self, recording: int = 0, *, nominal: bool = False) -> Geometry:
        """All kinematic parameters, base pose and encoder offsets those of one recording."""
        entries = self.parameters | self.recordings[recording].parameters
        table = table_of_names(entries)
        values = [entries[k].nominal if nominal else entries[k].value for k in table.names]
        return Geometry(np.array(values), table)

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the identified parameters, those of the first recording included."""
        entries = self.parameters | self.recordings[0].parameters
        return tuple(name for name in table_of_names(entries).names if entries[name].identified)


def _check_names(place: Loc, entries: Iterable[str], belongs: Callable[[str], bool]) -> None:
    """Each name stands for a parameter, and for one of those that belong here."""
    for name in entries:
        try:
            parameter_named(name)
        except KeyError:
            raise wrong_key(*place, name, message="no parameter has this name") from None
        if not belongs(name):
            raise wrong_key(
                *place,
                name,
                message="this parameter does not belong here: encoder offsets and base pose stand "
                "with each recording, all others in `parameters`",
            )


def _check_complete(place: Loc, entries: Iterable[str], expected: Sequence[str]) -> None:
    """No parameter is missing of the mechanism that the entries describe."""
    present = {name: parameter_named(name) for name in entries}
    missing = [parameter_named(name) for name in expected if name not in present]
    extra = [name for name in present if name not in expected]
    if missing:
        first = missing[0]
        row = [p for p in missing if (p.side, p.row) == (first.side, first.row)]
        beside = [n for n, p in present.items() if (p.side, p.row) == (first.side, first.row)]
        listed = ", ".join(p.name for p in row)
        others = f" beside {', '.join(beside)}" if beside else ""
        remove = f", or remove {', '.join(beside)}" if len(beside) < len(row) else ""
        raise wrong_key(*place, message=f"without {listed}{others}. Add what is missing{remove}")
    if extra:
        raise wrong_key(*place, extra[0], message="no parameter of this mechanism. Remove it")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibration as read back."""

    file: CalibrationFile
    folder: Path = Path()  # to which the descriptions' paths in the file are relative

    @staticmethod
    def load(path: Path | str) -> Calibration | PoseCalibration:
        """A calibration.yaml, or the one in a folder: of logs, or of still poses.

        Raises DescriptionError naming file, line and key.
        """
        from ballbar.result.pose_calibration import load_pose_calibration  # noqa: PLC0415  circular

        file = calibration_file(Path(path))
        return load_pose_calibration(file) if holds_pose_result(file) else load_calibration(file)

    @property
    def geometry(self) -> Geometry:
        """Identified kinematic parameters, base pose and encoder offsets of the first recording."""
        return self.file.geometry()

    @property
    def nominal(self) -> Geometry:
        """Catalogue values likewise."""
        return self.file.geometry(nominal=True)

    def cell(self) -> Cell:
        """The cell that the file names.

        Raises DescriptionError where one of its files fails, or where its robot is of another
        structure than the parameters.
        """
        file, table = self.file, self.nominal.table
        cell = load_measured_cell(file.robot, file.instrument, file.plate, relative_to=self.folder)
        if table != (expected := parameter_table(cell.robot)):
            raise DescriptionError(
                f"{self.folder / CALIBRATION}: parameters: of {table.joints} joints with "
                f"{', '.join(table.hayati) or 'no rbeta'}; robot {file.robot} has "
                f"{expected.joints} joints with {', '.join(expected.hayati)}. {RESTORE}."
            )
        return cell

    def kinematics(
        self, *, payload: Payload | None = None, tool: Array | None = None
    ) -> IdentifiedKinematics:
        """Forward and inverse kinematics of the identified robot, its corrections included.

        payload : mass and centre, in the robot's flange frame, of what the flange carries; by
            default the offset plate. tool : (4, 4) frame of the tool in that of the flange; by
            default the end of the offset plate.

        Raises InputError for a payload where the robot's file states no masses.
        """
        # an identification writes calibrations and does without still poses
        from ident.robot.identified_kinematics import kinematics_of_robot  # noqa: PLC0415

        cell = self.cell()
        if payload is not None:
            cell.robot.required("links")
        covariance = self.file.covariance
        return kinematics_of_robot(
            self.unloaded_robot(cell),
            self.nominal,
            payload=payload,
            tool=tool,
            covariance=None if covariance is None else covariance.covariance,
            ranges=np.array([[r.lower_rad, r.upper_rad] for r in self.file.ranges]),
        )

    def unloaded_robot(self, cell: Cell) -> UnloadedRobot:
        """The identified robot without ball-bar; cell : as the file names it."""
        corrections = tuple(
            CorrectionEstimate(
                name,
                "",
                tuple(
                    CoefficientEstimate(name=key, **entry.model_dump())
                    for key, entry in entries.items()
                ),
            )
            for name, entries in self.file.corrections.items()
        )
        if self.file.masses is not None:
            cell = with_payload(cell, self.file.masses.payload)
        return unloaded_robot(cell, self.geometry, self.encoders, corrections)

    @property
    def encoders(self) -> tuple[int, ...]:
        """Encoders of the ball-bar, joints 1..5."""
        return tuple(int(name[1]) for name in self.file.recordings[0].encoder_directions)

    def machine(self, cell: Cell) -> Machine:
        """The machine with its covariance, to be tried on other recordings; cell : as above.

        Raises InputError for a file that is older than the keys `covariance` and `fit.excess`.
        """
        stated, excess = self.file.covariance, self.file.fit.excess
        if stated is None or excess is None:
            raise InputError(
                "the calibration.yaml states no covariance of its parameters, as older versions "
                "wrote it. Identify its recordings again with ballbar identify."
            )
        return Machine(
            robot=self.unloaded_robot(cell),
            nominal=self.nominal,
            names=stated.names,
            covariance=stated.covariance.of_names,
            excess=ExcessNoise(excess.gear_rad, excess.wrist_rad, excess.bar_rad, excess.rod_m),
            tcp_sigma=self.file.fit.tcp_sigma_mean_m,
        )


def calibration_of(data: RunData) -> CalibrationFile:
    """The content of calibration.yaml for a run, which is checked once it is written."""
    result, description = data.identification, data.recordings[0].recording.description
    robot, fit, verdict = result.robot, result.fit, result.verdict
    shared = shared_names(robot.nominal.table)
    return CalibrationFile.model_construct(
        schema_=SCHEMA,
        robot=description.robot,
        instrument=description.measured_by,
        plate=description.plate,
        model=result.model,
        parameters=_parameters(shared, robot.nominal, robot.geometry, robot.sigma),
        dropped=tuple(
            DroppedEntry.model_construct(name=d.name, reason=d.reason, on=d.on)
            for d in robot.dropped
        ),
        corrections=_corrections(robot),
        masses=masses_entry(robot.payload),
        ranges=tuple(
            RangeEntry.model_construct(lower_rad=float(low), upper_rad=float(high))
            for low, high in zip(robot.lower, robot.upper, strict=True)
        ),
        covariance=covariance_entry(robot.tool),
        recordings=tuple(_recording(fitted) for fitted in data.recordings),
        fit=FitEntry.model_construct(
            status=verdict.status,
            verdict=verdict.sentence,
            warnings=verdict.warnings,
            iterations=fit.iterations,
            unknowns=fit.unknowns,
            chi2_per_dof=fit.chi2_per_dof,
            autocorrelation=fit.autocorrelation,
            rank=fit.rank,
            condition=fit.condition,
            rod_sigma_m=fit.excess.rod,
            tcp_sigma_mean_m=float(robot.tcp.sigma.mean()),
            tcp_sigma_without_scale_mean_m=float(robot.tcp.without_scale.mean()),
            excess=ExcessEntry.model_construct(
                gear_rad=fit.excess.gear,
                wrist_rad=fit.excess.wrist,
                bar_rad=fit.excess.bar,
                rod_m=fit.excess.rod,
            ),
        ),
        held_out=tuple(_held_out(validation.outcome) for validation in data.validations),
    )


def write_calibration(path: Path, data: RunData) -> None:
    """Write calibration.yaml, whole or not at all, and the descriptions that it names beside it.

    Raises RefusedResultError as `write_result`.
    """
    file, recorded = calibration_of(data), data.recordings[0].folder
    own = {
        key: copied_description(path.parent, key, recorded / name)
        for key in ("robot", "instrument", "plate")
        if (name := getattr(file, key)).endswith(".yaml")
    }
    write_result(path, file.model_copy(update=own), load_calibration)


def _parameters(
    names: Iterable[str], nominal: Geometry, value: Geometry, sigma: dict[str, float]
) -> dict[str, ParameterEntry]:
    return {
        name: ParameterEntry.model_construct(
            nominal=nominal[name],
            value=value[name],
            sigma=sigma.get(name),
            identified=name in sigma,
        )
        for name in names
    }


def _corrections(robot: RobotEstimate) -> dict[str, dict[str, CoefficientEntry]]:
    return {
        correction.name: {
            c.name: CoefficientEntry.model_construct(
                value=c.value,
                sigma=c.sigma,
                prior=c.prior,
                prior_sigma=c.prior_sigma,
                information_gain=c.information_gain,
                unit=c.unit,
            )
            for c in correction.coefficients
        }
        for correction in robot.corrections
    }


def covariance_entry(covariance: ToolCovariance) -> CovarianceEntry:
    """A covariance as text that reads back bit by bit."""
    rows = [row[: k + 1].tolist() for k, row in enumerate(covariance.values)]
    return CovarianceEntry.model_construct(
        names=covariance.names,
        masses=tuple(tuple(row) for row in covariance.masses.tolist()),
        held=covariance.held,
        lower=tuple(" ".join(map(repr, row)) for row in rows),
    )


def masses_entry(estimate: PayloadEstimate | None) -> MassesEntry | None:
    """The masses that a fit took from torque logs; None where it took those of the files."""
    if estimate is None:
        return None
    x, y, z = estimate.payload.com.tolist()
    links = [(link.scale, *link.shift.tolist()) for link in estimate.payload.links]
    return MassesEntry.model_construct(
        tool_kg=estimate.payload.mass,
        tool_sigma_kg=estimate.mass_sigma,
        tool_stated_kg=estimate.stated,
        tool_com_m=(x, y, z),
        arm_scale=estimate.payload.arm,
        arm_scale_sigma=estimate.arm_sigma,
        links=tuple(
            LinkMassEntry.model_construct(scale=scale, shift_m=(a, b, c))
            for scale, a, b, c in links
        ),
    )


def _recording(fitted: FittedRecording) -> RecordingEntry:
    estimate = fitted.estimate
    clock, after = estimate.clock, estimate.after
    names = [f"b{joint}" for joint in estimate.encoders]
    own = [name for name in estimate.geometry.table.names if belongs_to_recording(name)]
    directions = cast(tuple[Direction, ...], estimate.directions)
    noise = estimate.noise.encoder[[joint - 1 for joint in estimate.encoders]]
    return RecordingEntry.model_construct(
        name=estimate.name,
        encoder_directions=dict(zip(names, directions, strict=True)),
        clock=None
        if clock is None
        else ClockEntry.model_construct(
            offset_s=clock.offset,
            offset_sigma_s=estimate.clock_sigma[0],
            skew=clock.skew,
            skew_sigma=estimate.clock_sigma[1],
        ),
        parameters=_parameters(own, estimate.nominal, estimate.geometry, estimate.sigma),
        noise=NoiseEntry.model_construct(
            joint_rad=tuple(estimate.noise.joint.tolist()),
            encoder_rad=dict(zip(names, noise.tolist(), strict=True)),
            length_m=estimate.noise.length or None,
        ),
        residuals=ResidualEntry.model_construct(
            samples=estimate.samples,
            equations=int(estimate.whitened.size),
            chi2=float((estimate.whitened**2).sum()),
            position_rms_m=rms(np.linalg.norm(after.position, axis=1)),
            angle_rms_rad=rms(np.linalg.norm(after.angle, axis=1)),
        ),
        tension_source=estimate.tension_source,
        step_faults=_step_faults(estimate.step_faults),
        tracker=_tracker(estimate.tracker),
        temperature_C=fitted.recording.description.temperature_C,
    )


def _step_faults(faults: Sequence[StepFault]) -> tuple[StepFaultEntry, ...]:
    return tuple(
        StepFaultEntry.model_construct(
            kind=f.kind, joint=f.joint, time_s=f.time, size=f.size, periods=f.periods
        )
        for f in faults
    )


def _tracker(check: TrackerCheck | None) -> TrackerEntry | None:
    if check is None:
        return None
    identified, nominal = (
        PointErrorsEntry.model_construct(
            rms_m=errors.rms,
            largest_m=errors.largest,
            clock_offset_s=errors.clock.offset,
            clock_skew=errors.clock.skew,
        )
        for errors in (check.identified, check.nominal)
    )
    return TrackerEntry.model_construct(
        acceptable=check.acceptable,
        points=check.t.size,
        unknowns=check.identified.unknowns,
        degrees_of_freedom=check.degrees,
        noise_m=check.noise,
        expected_m=check.expected,
        identified=identified,
        nominal=nominal,
    )


def _held_out(outcome: HeldOut) -> HeldOutEntry:
    return HeldOutEntry.model_construct(
        name=outcome.name,
        sentence=outcome.sentence,
        acceptable=outcome.acceptable,
        samples=outcome.samples,
        identified=_closure(outcome.identified),
        normalised_innovation=outcome.normalised_innovation,
        nominal=_closure(outcome.nominal),
        step_faults=_step_faults(outcome.step_faults),
        tracker=_tracker(outcome.tracker),
    )


def _closure(closure: LoopClosure) -> ClosureEntry:
    return ClosureEntry.model_construct(
        position_rms_m=closure.position_rms,
        position_max_m=closure.position_max,
        angle_rms_rad=closure.angle_rms,
        ratio=closure.ratio,
    )


def calibration_file(path: Path) -> Path:
    """The file itself, or the one in a folder that `run` or `identify` wrote."""
    return path / CALIBRATION if path.is_dir() else path


def existing_calibration(path: Path) -> Path:
    """As `calibration_file`. Raises InputError where there is none."""
    file = calibration_file(path)
    if not file.is_file():
        raise InputError(f"{file}: no such file. Name a calibration.yaml, or its folder.")
    return file


def holds_pose_result(path: Path) -> bool:
    """Whether a calibration.yaml is the result of still poses rather than of logs."""
    return load_yaml(path).data.get("model") == POSES


def load_calibration(path: Path) -> Calibration:
    """Read the calibration.yaml of logs.

    Raises DescriptionError naming file, line and key; an older schema is refused by name.
    """
    document = load_yaml(path)
    check_schema(document, SCHEMA, "Identify the recording again with ballbar identify.")
    if document.data.get("model") == POSES:
        raise DescriptionError(
            f"{path}: is the result of still poses; here one of logs is needed. "
            "Calibration.load reads both."
        )
    return Calibration(parse_model(document, CalibrationFile), path.parent)
