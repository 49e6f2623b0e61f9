"""calibration.yaml of a robot identified from still poses (schema `ballbar-calibration/2`).

The same file as that of logs: `parameters`, `corrections`, `recordings`, `fit`. Instead of clocks
and encoders it holds seats and targets, the fitted range of every joint, and what cross-validation
says of poses that were not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from ballbar.result.calibration import (
    POSES,
    RESTORE,
    SCHEMA,
    CoefficientEntry,
    ParameterEntry,
    Positive,
    RangeEntry,
    one_of,
)
from ballbar.result.pose_run import PoseRun
from ballbar.result.write_result import write_result
from cell.arrays import Array
from cell.chain import Chain
from cell.descriptions import Robot
from cell.errors import DescriptionError, InputError
from cell.files import copied_description
from cell.geometry import nominal_chain
from cell.load import load_robot
from cell.placement import Placement
from cell.pose_file import pose_file_path
from cell.rotation import matrix_from_rotvec, rotvec_from_matrix
from cell.schema import Strict
from cell.schema_errors import nearest, wrong_key
from cell.strict_yaml import check_schema, load_yaml, parse_model
from ident.corrections import as_in_result
from ident.corrections.base import Correction
from ident.corrections.joint_compliance import gear_compliance
from ident.corrections.joint_harmonics import JOINT_HARMONICS, joint_harmonics, orders_of
from ident.corrections.unit_weights import unit_weights
from ident.estimator.unknowns import arm_parameters
from ident.identify_poses import JointErrors
from ident.robot.identified_arm import IdentifiedArm
from ident.robot.identified_kinematics import IdentifiedKinematics, kinematics_of_arm

Three = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
KNOWN = 0.5  # information gain below which a parameter stands at its prior

# Corrections of a result by name, formed again from the names of their coefficients.
POSE_CORRECTIONS: dict[str, Callable[[Robot, Iterable[str]], Correction]] = {
    "unit_weights": lambda robot, _: unit_weights(robot),
    "joint_compliance": lambda robot, _: gear_compliance(robot),
    JOINT_HARMONICS: lambda _, coefficients: joint_harmonics(orders_of(coefficients)),
}


PoseCorrectionName = Annotated[str, one_of(POSE_CORRECTIONS, "correction of still poses")]


class PlacementEntry(Strict):
    """A seat in the robot's base frame, or a target in the flange's."""

    position_m: Three
    position_sigma_m: Three
    rotation_vector_rad: Three | None = None  # None for a point

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


class GroupEntry(Strict):
    """Poses of one seat and one target."""

    file: str
    measured: str
    seat: str
    target: str
    poses: int
    position_rms_m: float  # distance of measurement and model


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
    quantile_95_m: Positive
    sigma_m: Positive  # along each axis
    region_factor: Positive  # of the 95 % region, over that of chi-square


class PoseHeldOutEntry(Strict):
    """A table of poses that took no part in the identification."""

    name: str
    sentence: str
    acceptable: bool
    poses: int
    mean_m: float
    quantile_95_m: float
    nominal_mean_m: float


class PoseFitEntry(Strict):
    """How the fit went."""

    status: str
    verdict: str
    warnings: tuple[str, ...]
    iterations: int
    unknowns: int
    poses: int
    # at the measured poses, all axes together; older files do not state it
    tcp_sigma_at_poses_m: Positive | None = None
    tcp_sigma_mean_m: float  # extrapolated over the fitted ranges, all axes together
    discrepancy_m: float  # of a fitted pose from the model, along each axis
    residual_mean_m: float
    nominal_mean_m: float  # of the robot as its file has it, seats and targets fitted


class PoseCalibrationFile(Strict):
    """Schema of calibration.yaml with model `poses`."""

    model_config = ConfigDict(populate_by_name=True)  # `schema` is a method of pydantic's

    schema_: Annotated[Literal["ballbar-calibration/2"], Field(alias="schema")]
    robot: str
    instrument: str
    model: Literal["poses"]
    parameters: dict[str, ParameterEntry]
    corrections: dict[PoseCorrectionName, dict[str, CoefficientEntry]] = Field(default_factory=dict)
    orders: tuple[OrderEntry, ...] = ()
    seats: Annotated[dict[str, PlacementEntry], Field(min_length=1)]
    targets: Annotated[dict[str, PlacementEntry], Field(min_length=1)]
    ranges: Annotated[tuple[RangeEntry, ...], Field(min_length=5, max_length=8)]
    recordings: Annotated[tuple[GroupEntry, ...], Field(min_length=1)]
    cross_validation: CrossValidationEntry
    fit: PoseFitEntry
    held_out: tuple[PoseHeldOutEntry, ...] = ()

    @model_validator(mode="after")
    def _recordings_have_their_seats_and_targets(self) -> PoseCalibrationFile:
        for k, group in enumerate(self.recordings):
            for key, known in (("seat", self.seats), ("target", self.targets)):
                if (name := getattr(group, key)) not in known:
                    hint = nearest(name, known, noun="name")
                    raise wrong_key("recordings", k, key, message=f"not in `{key}s`.{hint}")
        return self

    def chain(self, robot: Robot) -> Chain:
        """DH rows of the identified robot; what still poses cannot tell is nominal."""
        nominal = nominal_chain(robot)
        rows = {f.name: getattr(nominal, f.name).copy() for f in fields(Chain)}
        for p in arm_parameters(robot):
            rows[p.kind][p.row] = self.parameters[p.name].value
        return Chain(**rows)

    def joint_errors(self) -> JointErrors:
        """The joint errors, to be kept in another identification."""
        entries = self.corrections.get("joint_harmonics", {})
        return JointErrors(
            tuple(orders_of(entries)), tuple(entry.value for entry in entries.values())
        )

    def arm(self, robot: Robot, target: str | None = None) -> IdentifiedArm:
        """The identified robot with one of its targets, by default the first.

        Its regions are those of cross-validation alone, which the covariance of the parameters is
        part of; where nothing but lengths were measured, they are as wide as the stated uncertainty
        of the target, for cross-validation judges the direction of the rods alone.
        """
        corrections, values = self._corrections(robot)
        name = target or next(iter(self.targets))
        if name not in self.targets:
            raise InputError(f"target {name!r}: the result has {', '.join(self.targets)}")
        seat = next(iter(self.seats.values()))
        validation = self.cross_validation
        spread = validation.mean_m / np.sqrt(8.0 / np.pi)  # of a normal error of three axes
        if all(group.measured == "length" for group in self.recordings):
            stated = self.fit.tcp_sigma_at_poses_m or self.fit.tcp_sigma_mean_m
            spread = stated / np.sqrt(3.0)
        return IdentifiedArm(
            robot=robot,
            chain=self.chain(robot),
            corrections=corrections,
            values=values,
            target=self.targets[name].placement,
            seat=seat.placement,
            seat_turns=False,
            parameters=(),
            covariance=np.zeros((values.size + 6, values.size + 6)),
            discrepancy=max(validation.sigma_m, spread),
            factor=validation.region_factor,
            lower=np.array([r.lower_rad for r in self.ranges]),
            upper=np.array([r.upper_rad for r in self.ranges]),
        )

    def _corrections(self, robot: Robot) -> tuple[tuple[Correction, ...], Array]:
        made: list[Correction] = []
        values: list[float] = []
        for name, entries in self.corrections.items():
            made.append(as_in_result(POSE_CORRECTIONS[name](robot, entries), entries, robot))
            values += [entry.value for entry in entries.values()]
        return tuple(made), np.array(values)


@dataclass(frozen=True, eq=False)
class PoseCalibration:
    """A calibration of still poses as read back, with the robot that it names."""

    file: PoseCalibrationFile
    robot: Robot  # nominal

    @property
    def chain(self) -> Chain:
        """DH rows of the identified robot, up to the flange."""
        return self.file.chain(self.robot)

    @property
    def targets(self) -> dict[str, Placement]:
        """Targets in the flange's frame; of a point only the origin is known."""
        return {name: entry.placement for name, entry in self.file.targets.items()}

    @property
    def lower(self) -> Array:
        """(J,) [rad] least angle of each joint that was fitted."""
        return np.array([entry.lower_rad for entry in self.file.ranges])

    @property
    def upper(self) -> Array:
        """(J,) [rad] largest angle of each joint that was fitted."""
        return np.array([entry.upper_rad for entry in self.file.ranges])

    def arm(self, target: str | None = None) -> IdentifiedArm:
        """The identified robot with one of its targets, by default the first.

        Raises InputError for a target that is not in the file.
        """
        return self.file.arm(self.robot, target)

    def kinematics(self, target: str | None = None) -> IdentifiedKinematics:
        """Forward and inverse kinematics of the identified robot with one of its targets.

        target : its name, by default the first; of one that was measured as a point the axes are
        those of the flange. Raises InputError for a target that is not in the file.
        """
        return kinematics_of_arm(self.arm(target))


def pose_calibration(run: PoseRun) -> PoseCalibrationFile:
    """The content of calibration.yaml for still poses, which is checked once it is written."""
    result, description = run.identification, run.folders[0][2].description
    fit, layout, verdict = result.fit, result.fit.model.unknowns, result.verdict
    sigma, gain = result.sigma, result.information_gain
    machine = range(layout.shared.size)
    arm, validation = result.arm(), result.cross_validation
    named = list(layout.names)
    entries: dict[str, dict[str, CoefficientEntry]] = {}
    at = layout.coefficients.start
    for correction in fit.model.corrections:
        own = {}
        for k, c in enumerate(correction.coefficients, start=at):
            own[c.name] = CoefficientEntry.model_construct(
                value=float(fit.x[k]),
                sigma=float(np.sqrt(fit.covariance[k, k])),
                prior=float(layout.mean[k]),
                prior_sigma=float(layout.sigma[k]),
                information_gain=float(1.0 - min(1.0, fit.covariance[k, k] / layout.sigma[k] ** 2)),
                unit=c.unit,
            )
        at += len(correction.coefficients)
        entries[correction.name] = own
    return PoseCalibrationFile.model_construct(
        schema_=SCHEMA,
        robot=description.robot,
        instrument=description.instrument,
        model="poses",
        parameters={
            named[i]: ParameterEntry.model_construct(
                nominal=float(layout.mean[i]),
                value=float(fit.x[i]),
                sigma=sigma[named[i]] if gain[named[i]] > KNOWN else None,
                identified=gain[named[i]] > KNOWN,
            )
            for i in machine
        },
        corrections=entries,
        orders=()
        if result.search is None
        else tuple(
            OrderEntry.model_construct(
                joint=o.joint + 1,
                order=round(o.order),
                score=o.score,
                gain=o.gain,
                aliases=tuple(round(a) for a in o.aliases),
            )
            for o in result.search.orders
        ),
        seats={
            name: _entry(
                layout.seat(fit.x, name), fit.covariance, part, whole=name in layout.framed
            )
            for name, part in layout.seats.items()
        },
        targets={
            name: _entry(
                layout.target(fit.x, name), fit.covariance, part, whole=name in layout.framed
            )
            for name, part in layout.targets.items()
        },
        ranges=tuple(
            RangeEntry.model_construct(lower_rad=float(low), upper_rad=float(high))
            for low, high in zip(arm.lower, arm.upper, strict=True)
        ),
        recordings=tuple(
            GroupEntry.model_construct(
                file=point.still.file,
                measured=point.still.measured,
                seat=point.still.seat,
                target=point.still.target,
                poses=point.still.size,
                position_rms_m=float(np.sqrt((point.closure.error[:3] ** 2).sum(axis=0).mean())),
            )
            for point in fit.linear.evaluations
        ),
        cross_validation=CrossValidationEntry.model_construct(
            mean_m=validation.mean,
            quantile_95_m=validation.quantile,
            sigma_m=validation.sigma,
            region_factor=validation.factor_of_points,
        ),
        fit=PoseFitEntry.model_construct(
            status=verdict.status,
            verdict=verdict.sentence,
            warnings=verdict.warnings,
            iterations=fit.iterations,
            unknowns=layout.count,
            poses=result.table.size,
            tcp_sigma_at_poses_m=float(result.sigma_at_poses.mean()),
            tcp_sigma_mean_m=float(result.tcp_sigma.mean()),
            discrepancy_m=fit.excess.position,
            residual_mean_m=result.residual_means[0],
            nominal_mean_m=result.residual_means[1],
        ),
        held_out=tuple(
            PoseHeldOutEntry.model_construct(
                name=outcome.name,
                sentence=outcome.sentence,
                acceptable=outcome.acceptable,
                poses=outcome.error.size,
                mean_m=float(outcome.error.mean()),
                quantile_95_m=float(np.quantile(outcome.error, 0.95)),
                nominal_mean_m=float(outcome.nominal.mean()),
            )
            for _, _, outcome in run.held_out
        ),
    )


def write_pose_calibration(path: Path, run: PoseRun) -> None:
    """Write calibration.yaml, whole or not at all, and a robot's file of the user's beside it.

    Raises RefusedResultError as `write_result`.
    """
    file = pose_calibration(run)
    if file.robot.endswith(".yaml"):
        named = pose_file_path(run.folders[0][1]).parent / file.robot
        file = file.model_copy(update={"robot": copied_description(path.parent, "robot", named)})
    write_result(path, file, load_pose_calibration)


def load_pose_calibration(path: Path) -> PoseCalibration:
    """Read a calibration.yaml of still poses, and the robot's file that it names.

    Raises DescriptionError naming file, line and key.
    """
    document = load_yaml(path)
    check_schema(document, SCHEMA, "Identify the poses again with ballbar identify.")
    if document.data.get("model") != POSES:
        raise DescriptionError(
            f"{path}: is the result of logs; here one of still poses (poses.yaml) is needed."
        )
    file = parse_model(document, PoseCalibrationFile)
    robot = load_robot(file.robot, relative_to=path.parent)
    if len(file.ranges) != robot.joints:
        raise DescriptionError(
            f"{path}: ranges of {len(file.ranges)} joints, robot {file.robot} has {robot.joints}. "
            "Was the robot's file changed since?"
        )
    expected = {p.name for p in arm_parameters(robot)}
    for name in sorted(expected.symmetric_difference(file.parameters)):
        what = "missing" if name in expected else "no parameter that still poses tell"
        raise DescriptionError(
            f"{document.place_of(('parameters', name))}: parameters.{name}: {what} of robot "
            f"{file.robot}. {RESTORE}."
        )
    return PoseCalibration(file, robot)


def _entry(place: Placement, covariance: Array, part: slice, *, whole: bool) -> PlacementEntry:
    deviations = np.sqrt(np.diag(covariance)[part][:3])
    turn = rotvec_from_matrix(place.rotation[:, :, None])[:, 0]
    return PlacementEntry.model_construct(
        position_m=tuple(place.origin.tolist()),
        position_sigma_m=tuple(deviations.tolist()),
        rotation_vector_rad=tuple(turn.tolist()) if whole else None,
    )
