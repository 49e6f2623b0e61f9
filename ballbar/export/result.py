"""A calibration with its robot, ready for use; and text on what an export of it leaves out."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ballbar.export.links import joined_link
from ballbar.result.calibration import Calibration
from ballbar.result.machine_entries import ParameterEntry
from cell.bodies import carried_bodies, link_bodies
from cell.chain import Chain
from cell.descriptions import Cell, Link, Robot
from cell.foreign_text import one_line
from cell.geometry import Parameter, nominal_chain, parameter_table
from cell.placement import Placement

EFFECTS = {
    "joint_compliance": "compliance of the gears under the robot's own weight",
    "gear_backlash": "backlash of the gears",
    "gear_ripple": "transmission error and resolver harmonics",
    "unit_weights": "sag of the joints under the arm's weight",
    "joint_harmonics": "joint errors that repeat with each turn",
    "learned_harmonics": "joint errors kept from another result",
}
_NO_EFFECTS = "gear compliance, backlash, transmission error: none was identified, so none is known"
_NO_SAG = "sag of the joints, joint errors: none was identified, so none is known"


@dataclass(frozen=True, eq=False)
class Result:
    """A calibration.yaml of logs as read, with the cell that it names."""

    file: Path
    sha256: str
    calibration: Calibration
    cell: Cell

    @property
    def robot(self) -> Robot:
        return self.cell.robot

    @property
    def chain(self) -> Chain:
        """DH rows of the identified robot; the tool is in the last row."""
        return self.calibration.geometry.robot

    @property
    def nominal(self) -> Chain:
        """Catalogue rows likewise."""
        return self.calibration.nominal.robot

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's parameters, in the order of the vector."""
        every = self.calibration.geometry.table.parameters
        return tuple(p for p in every if p.side == "robot")

    def entry(self, parameter: Parameter) -> ParameterEntry:
        """Value and standard deviation of a parameter."""
        return self.calibration.file.parameters[parameter.name]

    @property
    def name(self) -> str:
        """Name of the robot, usable as an identifier in every format."""
        return plain_name(self.robot.name)

    @property
    def status(self) -> str:
        return self.calibration.file.fit.status

    @property
    def left_out(self) -> list[str]:
        """Effects of the identified robot beyond its geometry, as text."""
        return _effects(self.calibration.file.corrections) or [_NO_EFFECTS]

    @property
    def tools(self) -> dict[str, Placement]:
        """Frames of the tool in that of the last row, by name."""
        return {"tool0": Placement(np.eye(3), np.zeros(3))}

    @property
    def links(self) -> list[Link] | None:
        """Links 1 to J, the plate merged into the last."""
        return [joined_link(links) for links in carried_bodies(self.cell)]

    @property
    def frame_notes(self) -> list[str]:
        """Where base and tool are."""
        return [
            "Base: frame 0, z along axis 1. Tool: end of the offset plate, which held the ball-bar."
        ]

    @property
    def range_notes(self) -> list[str]:
        """Ranges of the axes outside of which nothing is known: not stated of logs."""
        return []


@dataclass(frozen=True, eq=False)
class PoseResult:
    """A calibration.yaml of still poses as read, with the robot that it names."""

    file: Path
    sha256: str
    calibration: Calibration

    @property
    def robot(self) -> Robot:
        return self.calibration.robot

    @cached_property
    def chain(self) -> Chain:
        """DH rows of the identified robot, up to the flange."""
        return self.calibration.chain

    @cached_property
    def nominal(self) -> Chain:
        """Catalogue rows likewise."""
        return nominal_chain(self.robot)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's parameters, in the order of the vector."""
        last = f"rbeta{self.robot.joints}"  # of the ball-bar's plate
        every = parameter_table(self.robot).parameters
        return tuple(p for p in every if p.side == "robot" and p.name != last)

    def entry(self, parameter: Parameter) -> ParameterEntry:
        """Value and standard deviation of a parameter; a gauge stands at its nominal value."""
        stated = self.calibration.file.parameters.get(parameter.name)
        nominal = float(getattr(self.nominal, parameter.kind)[parameter.row])
        return stated or ParameterEntry(nominal=nominal, value=nominal, identified=False)

    @property
    def name(self) -> str:
        """Name of the robot, usable as an identifier in every format."""
        return plain_name(self.robot.name)

    @property
    def status(self) -> str:
        return self.calibration.file.fit.status

    @property
    def left_out(self) -> list[str]:
        """Effects of the identified robot beyond its geometry, as text."""
        return _effects(self.calibration.file.corrections) or [_NO_SAG]

    @property
    def tools(self) -> dict[str, Placement]:
        """Flange and targets in the frame of the last row, by name."""
        flange = {"flange": Placement(np.eye(3), np.zeros(3))}
        targets = self.calibration.targets
        return flange | {f"target_{plain_name(name)}": place for name, place in targets.items()}

    @property
    def links(self) -> list[Link] | None:
        """Links 1 to J where the robot's file states masses."""
        return None if self.robot.links is None else link_bodies(self.robot)

    @property
    def frame_notes(self) -> list[str]:
        """Where base, flange and targets are."""
        points = [t for t, entry in self.calibration.file.targets.items() if not entry.turned]
        notes = ["Base: frame 0, z along axis 1; its height and heading are a gauge of the seats."]
        notes.append(
            "Flange: the robot file's; its place on axis J and turn about it are a gauge of the "
            "targets."
        )
        if points:
            notes.append(f"Of target {', '.join(points)} only the position is known, not the turn.")
        return [one_line(note) for note in notes]

    @property
    def range_notes(self) -> list[str]:
        """Ranges of the axes that were fitted."""
        low, high = self.calibration.ranges.T
        each = [
            f"  joint {j + 1}: {np.rad2deg(low[j]):.1f} to {np.rad2deg(high[j]):.1f} deg "
            f"({float(low[j])!r} to {float(high[j])!r} rad)"
            for j in range(self.robot.joints)
        ]
        return [
            "WARNING: outside the fitted range of a joint the error is unknown and may exceed that "
            "of the nominal robot. Fitted ranges:",
            *each,
        ]


AnyResult = Result | PoseResult


def load_result(path: Path) -> AnyResult:
    """A result by its calibration.yaml, or by the folder that `run` or `identify` wrote it to.

    Raises InputError when there is none, DescriptionError when it is wrong.
    """
    calibration = Calibration.load(path)
    file = calibration.path
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    if calibration.of_logs:
        return Result(file, digest, calibration, calibration.cell())
    return PoseResult(file, digest, calibration)


def parameter_note(result: AnyResult, parameter: Parameter) -> str:
    """Value and standard deviation of a robot parameter, or that it is nominal."""
    entry, unit = result.entry(parameter), parameter.unit
    value = f"{parameter.name} = {entry.value!r} {unit}"
    if entry.identified and entry.sigma is not None:
        return f"{value}, sigma {entry.sigma:.2g} {unit} (nominal {entry.nominal!r})"
    if entry.value != entry.nominal:
        return f"{value}, known from its prior more than from the data (nominal {entry.nominal!r})"
    return f"{value}, NOMINAL: not identified"


def notes(result: AnyResult) -> list[str]:
    """Lines for the head of an exported file: source, frames, what is left out, parameters."""
    texts = (result.robot.title, result.file.name, result.status)
    title, name, status = (one_line(text) for text in texts)
    return [
        f"Identified robot {title}, exported by ballbar {version('ballbar-bench')}.",
        f"Source: {name}, sha256 {result.sha256}. Fit: {status}.",
        "Units: m and rad unless a name says otherwise.",
        "Joint angles are those of the DH model (docs/use_of_results.md).",
        *result.frame_notes,
        *result.range_notes,
        "NOT in this file, which is geometry alone:",
        *(f"  - {effect}" for effect in result.left_out),
        "Effects called identified are in the JSON export; `ballbar correct` accounts for them.",
        "Parameters of the robot and their standard deviations:",
        *(f"  {parameter_note(result, parameter)}" for parameter in result.parameters),
    ]


def plain_name(name: str) -> str:
    """A name of letters, digits and underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _effects(corrections: Mapping[str, object]) -> list[str]:
    return [
        f"{effect} ({name}, identified)" for name, effect in EFFECTS.items() if name in corrections
    ]
