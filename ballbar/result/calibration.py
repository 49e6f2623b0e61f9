"""A calibration, fresh or read back: what it says of the robot, whatever measured it.

Recordings of a ball-bar identify the robot with the offset plate and the ball-bar, still poses
identify it up to its flange with the targets that it carried. What a result cannot tell is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import starmap
from os import PathLike
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import Chain
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.geometry import Geometry, geometry_of_chain, nominal_chain, parameter_table
from ballbar.cell.load import load_measured_cell, load_robot
from ballbar.cell.payload import Payload, with_payload
from ballbar.cell.placement import Placement
from ballbar.cell.strict_yaml import YamlDocument, check_schema, load_yaml, parse_model
from ballbar.ident.corrections import as_in_result
from ballbar.ident.corrections.joint_harmonics import JOINT_HARMONICS, orders_of
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.options import JointErrors
from ballbar.ident.result import CoefficientEstimate, CorrectionEstimate, Machine, identified_robot
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.identified_kinematics import IdentifiedKinematics, kinematics
from ballbar.ident.robot.pose_covariance import PoseCovariance
from ballbar.result.calibration_schema import (
    LEARNED_HARMONICS,
    POSE_CORRECTIONS,
    SCHEMA,
    CalibrationFile,
)
from ballbar.result.machine_entries import RESTORE, CoefficientEntry
from ballbar.result.names import CALIBRATION
from ballbar.result.recording_entries import CrossValidationEntry
from ballbar.result.run_data import RunData
from ballbar.result.views import Views


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Views):
    """An identified robot: what `identify` returns, and what `load` reads back.

    A fresh one has residuals and report, too, and the covariance of still poses.
    """

    file: CalibrationFile
    path: Path = Path(CALIBRATION)  # to whose folder the descriptions' paths in it are relative
    run: RunData | None = None  # None of one that was read back

    @property
    def of_logs(self) -> bool:
        """Whether a moving robot was logged: without, there is neither ball-bar nor covariance."""
        return bool(self.file.logs)

    @cached_property
    def robot(self) -> Robot:
        """The nominal robot.

        Raises DescriptionError where its file fails.
        """
        if self.run is not None:
            return self.run.identification.robot.robot
        return load_robot(self.file.robot, relative_to=self.path.parent)

    @cached_property
    def chain(self) -> Chain:
        """Identified DH rows: of logs with the tool in the last row, of poses up to the flange.

        What still poses cannot tell is nominal.
        """
        if self.of_logs:
            return self.geometry.robot
        rows = {f.name: getattr(self.nominal_chain, f.name).copy() for f in fields(Chain)}
        for p in arm_parameters(self.robot):
            rows[p.kind][p.row] = self.file.parameters[p.name].value
        return Chain(**rows)

    @cached_property
    def nominal_chain(self) -> Chain:
        """The rows of `chain` as the descriptions have them."""
        return self.nominal.robot if self.of_logs else nominal_chain(self.robot)

    @property
    def sigma(self) -> dict[str, float]:
        """[m, rad] standard deviations of the identified parameters of robot and instrument."""
        entries = self.file.parameters.items()
        return {name: entry.sigma for name, entry in entries if entry.sigma is not None}

    @property
    def tcp_sigma(self) -> float:
        """[m] stated uncertainty of the tool, mean over the workspace or the fitted ranges."""
        return self.file.fit.tcp_sigma_mean_m

    @property
    def ranges(self) -> Array:
        """(J, 2) [rad] angles of each joint that were fitted; (0, 2) where not stated."""
        stated = [[entry.lower_rad, entry.upper_rad] for entry in self.file.ranges]
        return np.array(stated).reshape(-1, 2)

    @property
    def targets(self) -> dict[str, Placement]:
        """Targets of still poses in the flange's frame; of a point only the origin is known."""
        return {name: entry.placement for name, entry in self.file.targets.items()}

    @property
    def geometry(self) -> Geometry:
        """Identified kinematic parameters, base pose and encoder offsets of the first recording.

        Raises InputError for a result of still poses, which has no instrument's rows.
        """
        return self.file_of_logs().geometry()

    @property
    def nominal(self) -> Geometry:
        """Catalogue values of `geometry`."""
        return self.file_of_logs().geometry(nominal=True)

    def cell(self) -> Cell:
        """The cell that the file names.

        Raises InputError for a result of still poses, and DescriptionError where one of its files
        fails, or where its robot is of another structure than the parameters.
        """
        file, table = self.file_of_logs(), self.nominal.table
        if self.run is not None:
            return self.run.identification.robot.cell
        cell = load_measured_cell(
            file.robot, file.instrument, file.plate, relative_to=self.path.parent
        )
        if table != (expected := parameter_table(cell.robot)):
            raise DescriptionError(
                f"{self.path}: parameters: of {table.joints} joints with "
                f"{', '.join(table.hayati) or 'no rbeta'}; robot {file.robot} has "
                f"{expected.joints} joints with {', '.join(expected.hayati)}. {RESTORE}."
            )
        return cell

    @property
    def encoders(self) -> tuple[int, ...]:
        """Encoders of the ball-bar, joints 1..5."""
        return tuple(int(name[1]) for name in self.file_of_logs().logs[0].encoder_directions)

    def machine(self, cell: Cell) -> Machine:
        """The machine with its covariance, to be tried on other recordings.

        cell : as the file names it.

        Raises InputError for a file that is older than the keys `covariance` and `fit.excess`.
        """
        stated, excess = self.file.covariance, self.file.fit.excess
        if stated is None or excess is None:
            raise InputError(
                "the calibration.yaml states no covariance of its parameters, as older versions "
                "wrote it. Identify its recordings again with ballbar identify."
            )
        return Machine(
            robot=self.identified_robot(cell=cell),
            nominal=self.nominal,
            names=stated.names,
            covariance=stated.covariance.of_names,
            excess=ExcessNoise(excess.gear_rad, excess.wrist_rad, excess.bar_rad, excess.rod_m),
            tcp_sigma=self.tcp_sigma,
        )

    def joint_errors(self) -> JointErrors:
        """The joint errors of still poses, to be kept in another identification."""
        corrections = self.file_of_poses().corrections
        entries = corrections.get(LEARNED_HARMONICS, {}) | corrections.get(JOINT_HARMONICS, {})
        return JointErrors(
            tuple(orders_of(entries)), tuple(entry.value for entry in entries.values())
        )

    @property
    def cross_validated(self) -> float:
        """[m] mean error of poses in regions of joint space that were not fitted.

        Raises InputError for a result of logs, which has no such figure.
        """
        return self._validation.mean_m

    @property
    def _validation(self) -> CrossValidationEntry:
        validation = self.file_of_poses().cross_validation
        assert validation is not None  # as the file's schema demands of still poses
        return validation

    def identified_robot(
        self, target: str | None = None, *, cell: Cell | None = None
    ) -> IdentifiedRobot:
        """The identified robot, with its corrections and what is stated of its uncertainty.

        target : of still poses, its name, by default the first. cell : of logs, as the file names
        it, which is read by default.

        Raises InputError for a target that is not in the file, or that logs do not have.
        """
        if target is not None or not self.of_logs:
            poses = None if self.run is None else self.run.identification.poses
            if poses is not None and (target is None or target in self.targets):
                return poses.identified_robot(target)
            return self.robot_of_poses(target)
        if self.run is not None:
            return self.run.identification.robot.identified
        corrections = tuple(starmap(_correction, self.file.corrections.items()))
        cell, stated = cell or self.cell(), self.file.covariance
        if self.file.masses is not None:
            cell = with_payload(cell, self.file.masses.payload)
        robot = identified_robot(cell, self.geometry, self.encoders, corrections)
        if stated is None or not len(self.ranges):
            return robot
        return replace(robot, stated=stated.covariance, ranges=self.ranges)

    def robot_of_poses(self, target: str | None = None) -> IdentifiedRobot:
        """The robot of still poses with what the file states; arguments and errors as above."""
        file, targets = self.file_of_poses(), self.targets
        name = target or next(iter(targets))
        if name not in targets:
            raise InputError(f"target {name!r}: the result has {', '.join(targets)}")
        corrections = tuple(
            as_in_result(POSE_CORRECTIONS[key](self.robot, entries), entries, self.robot)
            for key, entries in file.corrections.items()
        )
        entries = [entry for of_one in file.corrections.values() for entry in of_one.values()]
        return IdentifiedRobot(
            self.robot,
            geometry_of_chain(parameter_table(self.robot), self.chain),
            corrections,
            np.array([entry.value for entry in entries]),
            target=targets[name],
            ranges=self.ranges,
            stated=self._stated_of_poses(len(entries) + 6),
        )

    def _stated_of_poses(self, unknowns: int) -> PoseCovariance:
        """The error of cross-validation, and nothing of what the unknowns are known to.

        Without the noise of what followed a moving robot it is at least what was stated.
        """
        spread = self._spread_of_poses()
        noise = max(0.0, spread**2 - self.tcp_sigma**2 / 3.0)
        return PoseCovariance(
            seat=next(iter(self.file.seats.values())).placement,
            seat_turns=False,
            parameters=np.zeros(0, dtype=np.intp),
            values=np.zeros((unknowns, unknowns)),
            discrepancy=spread,
            white=min(self._validation.white_m or 0.0, float(np.sqrt(noise))),
            factor=self._validation.region_factor,
        )

    def _spread_of_poses(self) -> float:
        """[m] standard deviation of a pose's position along each axis.

        It is that of cross-validation, which contains what the parameters are known to; of lengths
        alone, which judge the direction of the rods, at least the stated uncertainty of the target.
        """
        spread = self._validation.mean_m / np.sqrt(8.0 / np.pi)  # of a normal error, 3 axes
        if all(group.measured == "length" for group in self.file.groups):
            spread = (self.file.fit.tcp_sigma_at_poses_m or self.tcp_sigma) / np.sqrt(3.0)
        return float(max(self._validation.sigma_m, spread))

    def kinematics(
        self,
        target: str | None = None,
        *,
        payload: Payload | None = None,
        tool: Array | None = None,
    ) -> IdentifiedKinematics:
        """Forward and inverse kinematics of the identified robot, its corrections included.

        target : of still poses, its name, by default the first; of one that was measured as a point
            the axes are those of the flange. payload : of logs, mass and centre, in the robot's
            flange frame, of what the flange carries; by default the offset plate. tool : of logs,
            (4, 4) frame of the tool in that of the flange; by default the end of the offset plate.

        Raises InputError for a target that is not in the file, for a payload where the robot's file
        states no masses, and for what this kind of result does not tell.
        """
        if not self.of_logs and not (payload is None and tool is None):
            raise InputError(
                f"{self.path}: is the result of still poses, which are of the payload that was "
                "measured with and of their targets; leave payload and tool out."
            )
        robot = self.identified_robot(target)
        if payload is not None:
            robot.robot.required("links")
        return kinematics(robot, self.nominal_chain, payload=payload, tool=tool)

    def file_of_logs(self) -> CalibrationFile:
        """The file of a moving robot. Raises InputError for a result of still poses."""
        if self.of_logs:
            return self.file
        raise InputError(f"{self.path}: is the result of still poses; here one of logs is needed.")

    def file_of_poses(self) -> CalibrationFile:
        """The file of still poses. Raises InputError for a result of logs."""
        if not self.of_logs:
            return self.file
        raise InputError(
            f"{self.path}: is the result of logs; here one of still poses (poses.yaml) is needed."
        )


def load(path: str | PathLike[str]) -> Calibration:
    """The calibration in a calibration.yaml, or in the folder that `run` or `identify` wrote.

    Raises InputError where there is none, else DescriptionError naming file, line and key; an older
    schema is refused by name.
    """
    file = Path(path) / CALIBRATION if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise InputError(
            f"{file}: no such file. Name a calibration.yaml, or the folder that `ballbar identify` "
            "or `ballbar run` wrote."
        )
    document = load_yaml(file)
    check_schema(document, SCHEMA, "Identify the recording again with ballbar identify.")
    calibration = Calibration(parse_model(document, CalibrationFile), file)
    if not calibration.of_logs:
        _check_robot(calibration, document)
    return calibration


def _check_robot(calibration: Calibration, document: YamlDocument) -> None:
    """A result of still poses has the joints and the parameters of the robot that it names."""
    file, robot = calibration.file, calibration.robot
    if len(file.ranges) != robot.joints:
        wrong = f"ranges of {len(file.ranges)} joints, robot {file.robot} has {robot.joints}."
        raise DescriptionError.at(calibration.path, wrong, "Was the robot's file changed since?")
    expected = {p.name for p in arm_parameters(robot)}
    for name in sorted(expected.symmetric_difference(file.parameters)):
        what = "missing" if name in expected else "no parameter that still poses tell"
        raise DescriptionError(
            f"{document.place_of(('parameters', name))}: parameters.{name}: {what} of robot "
            f"{file.robot}. {RESTORE}."
        )


def _correction(name: str, entries: dict[str, CoefficientEntry]) -> CorrectionEstimate:
    estimates = (CoefficientEstimate(name=k, **entry.model_dump()) for k, entry in entries.items())
    return CorrectionEstimate(name, "", tuple(estimates))
