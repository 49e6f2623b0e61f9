"""A calibration with its cell, ready for use; and text on what an export of it leaves out."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from ballbar.result.calibration import Calibration, calibration_file, load_calibration
from cell.chain import Chain
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import Parameter
from cell.load import load_measured_cell

EFFECTS = {
    "joint_compliance": "compliance of the gears under the robot's own weight",
    "gear_backlash": "backlash of the gears",
    "gear_ripple": "transmission error and resolver harmonics",
}


@dataclass(frozen=True, eq=False)
class Result:
    """A calibration.yaml as read, with the cell that it names."""

    file: Path
    sha256: str
    calibration: Calibration
    cell: Cell

    @property
    def chain(self) -> Chain:
        """DH rows of the identified robot; the tool is in the last row."""
        return self.calibration.geometry.robot

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The robot's parameters, in the order of the vector."""
        every = self.calibration.geometry.table.parameters
        return tuple(p for p in every if p.side == "robot")

    @property
    def name(self) -> str:
        """Name of the robot, usable as an identifier in every format."""
        return re.sub(r"\W", "_", self.cell.robot.name, flags=re.ASCII)

    @property
    def left_out(self) -> list[str]:
        """Effects of the identified robot beyond its geometry, as text."""
        identified = self.calibration.file.corrections
        effects = [
            f"{effect} ({name}, identified)"
            for name, effect in EFFECTS.items()
            if name in identified
        ]
        return effects or [
            "gear compliance, backlash, transmission error: none was identified, so none is known"
        ]


def load_result(path: Path) -> Result:
    """A result by its calibration.yaml, or by the folder that `run` or `identify` wrote it to.

    Raises InputError when there is none, DescriptionError when it is wrong.
    """
    file = calibration_file(path)
    if not file.is_file():
        raise InputError(
            f"{file}: no such file. Name a calibration.yaml, or the folder that `ballbar identify` "
            "or `ballbar run` wrote."
        )
    calibration = load_calibration(file)
    names = calibration.file
    cell = load_measured_cell(names.robot, names.instrument, names.plate, relative_to=file.parent)
    return Result(file, hashlib.sha256(file.read_bytes()).hexdigest(), calibration, cell)


def parameter_note(result: Result, parameter: Parameter) -> str:
    """Value and standard deviation of a robot parameter, or that it is nominal."""
    entry, unit = result.calibration.file.parameters[parameter.name], parameter.unit
    value = f"{parameter.name} = {entry.value!r} {unit}"
    if entry.identified and entry.sigma is not None:
        return f"{value}, sigma {entry.sigma:.2g} {unit} (nominal {entry.nominal!r})"
    return f"{value}, NOMINAL: not identified"


def notes(result: Result) -> list[str]:
    """Lines for the head of an exported file: source, frames, what is left out, parameters."""
    texts = (result.cell.robot.title, result.file.name, result.calibration.file.fit.status)
    title, name, status = (" ".join(text.split()) for text in texts)  # a comment is one line
    return [
        f"Identified robot {title}, exported by ballbar {version('ballbar-bench')}.",
        f"Source: {name}, sha256 {result.sha256}. Fit: {status}.",
        "Units: m and rad unless a name says otherwise.",
        "Joint angles are those of the DH model (docs/use_of_results.md).",
        "Base: frame 0, z along axis 1. Tool: end of the offset plate, which held the ball-bar.",
        "NOT in this file, which is geometry alone:",
        *(f"  - {effect}" for effect in result.left_out),
        "Effects called identified are in the JSON export; `ballbar correct` accounts for them.",
        "Parameters of the robot and their standard deviations:",
        *(f"  {parameter_note(result, parameter)}" for parameter in result.parameters),
    ]
