"""A calibration with its robot, ready for use; and text on what an export of it leaves out."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import carried_bodies, joined_link, link_bodies
from ballbar.cell.chain import Chain
from ballbar.cell.descriptions import Cell, Link, Robot
from ballbar.cell.foreign_text import comment, one_line
from ballbar.cell.geometry import Parameter, parameter_table
from ballbar.cell.placement import Placement
from ballbar.result.calibration import Calibration, load
from ballbar.result.machine_entries import ParameterEntry

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
    """A calibration.yaml as read, with the robot that it names, whatever measured it."""

    file: Path
    sha256: str
    calibration: Calibration
    cell: Cell | None  # of logs: the robot with ball-bar and plate

    @property
    def robot(self) -> Robot:
        return self.calibration.robot if self.cell is None else self.cell.robot

    @cached_property
    def chain(self) -> Chain:
        """DH rows of the identified robot; of logs the tool is in the last row."""
        return self.calibration.chain

    @cached_property
    def nominal(self) -> Chain:
        """Catalogue values of `chain`."""
        return self.calibration.nominal_chain

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's parameters, in the order of the vector; those of a plate of logs alone."""
        of_plate = "" if self.cell is not None else f"rbeta{self.robot.joints}"
        table = parameter_table(self.robot).parameters
        return tuple(p for p in table if p.side == "robot" and p.name != of_plate)

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
        identified = self.calibration.file.corrections
        return [
            f"{effect} ({name}, identified)"
            for name, effect in EFFECTS.items()
            if name in identified
        ] or [_NO_SAG if self.cell is None else _NO_EFFECTS]

    @property
    def tools(self) -> dict[str, Placement]:
        """Frames in that of the last row, by name: the tool of logs, or flange and targets."""
        last = "flange" if self.cell is None else "tool0"
        targets = self.calibration.targets.items()
        placed = {f"target_{plain_name(name)}": place for name, place in targets}
        return {last: Placement(np.eye(3), np.zeros(3))} | placed

    @property
    def links(self) -> list[Link] | None:
        """Links 1 to J where masses are known; of logs the plate is merged into the last."""
        if self.cell is not None:
            return [joined_link(links) for links in carried_bodies(self.cell)]
        return None if self.robot.links is None else link_bodies(self.robot)

    @property
    def frame_notes(self) -> list[str]:
        """Where base, tool, flange and targets are."""
        if self.cell is not None:
            return [
                "Base: frame 0, z along axis 1. Tool: end of the offset plate, which held the "
                "ball-bar."
            ]
        points = [t for t, entry in self.calibration.file.targets.items() if not entry.turned]
        notes = [
            "Base: frame 0, z along axis 1; its height and heading are a gauge of the seats.",
            "Flange: the robot file's; its place on axis J and turn about it are a gauge of the "
            "targets.",
        ]
        if points:
            notes.append(f"Of target {', '.join(points)} only the position is known, not the turn.")
        return [one_line(note) for note in notes]

    @property
    def range_notes(self) -> list[str]:
        """Ranges of the joints that still poses were fitted over; not stated of logs."""
        names = [f"joint {j}" for j in range(1, self.robot.joints + 1)]
        return self.ranges_of(names, np.ones(len(names)))

    def ranges_of(self, names: Iterable[str], sign: Array) -> list[str]:
        """Lines of `range_notes` by other names of the joints; sign : (J,) of their positions."""
        if self.cell is not None:
            return []
        ends = np.sort(sign[:, None] * np.array(self.calibration.ranges), axis=1).tolist()
        ranges = [
            f"  {name}: {np.rad2deg(low):.1f} to {np.rad2deg(high):.1f} deg "
            f"({low:.4f} to {high:.4f} rad)"
            for name, (low, high) in zip(names, ends, strict=True)
        ]
        return [
            "WARNING: outside the fitted range of a joint the error is unknown and may exceed that "
            "of the nominal robot. Fitted ranges:",
            *ranges,
        ]


def load_result(path: Path) -> Result:
    """A result by its calibration.yaml, or by the folder that `run` or `identify` wrote it to.

    Raises InputError when there is none, DescriptionError when it is wrong.
    """
    calibration = load(path)
    digest = hashlib.sha256(calibration.path.read_bytes()).hexdigest()
    cell = calibration.cell() if calibration.of_logs else None
    return Result(calibration.path, digest, calibration, cell)


def parameter_note(result: Result, parameter: Parameter) -> str:
    """Value and standard deviation of a robot parameter, or that it is nominal."""
    entry, unit = result.entry(parameter), parameter.unit
    value = f"{parameter.name} = {entry.value!r} {unit}"
    if entry.identified and entry.sigma is not None:
        return f"{value}, sigma {entry.sigma:.2g} {unit} (nominal {entry.nominal!r})"
    if entry.value != entry.nominal:
        return f"{value}, known from its prior more than from the data (nominal {entry.nominal!r})"
    return f"{value}, NOMINAL: not identified"


def notes(result: Result) -> list[str]:
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


def noted_text(result: Result, mark: str, comments: Iterable[str], lines: Iterable[str]) -> str:
    """Lines of a file below comments and the notes of the result; mark : of a comment."""
    head = (comment(mark, text) for text in (*comments, *notes(result)))
    return "".join(f"{line}\n" for line in (*head, *lines))


def number(value: float) -> str:
    """All digits of a float64, and no negative zero."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float], between: str = " ") -> str:
    """Numbers with all their digits."""
    return between.join(number(value) for value in values)


def plain_name(name: str) -> str:
    """A name of letters, digits and underscores."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)
