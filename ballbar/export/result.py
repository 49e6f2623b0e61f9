"""The result that is put to use: a calibration with its cell, and in words what it holds and what an export leaves out."""

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
from cell.geometry import PARAMETERS, Parameter
from cell.load import load_cell

EFFECTS = {
    "joint_compliance": "elastic gears under the robot's own weight",
    "gear_backlash": "play of the gears",
    "gear_ripple": "transmission error and resolver harmonics",
}
ROBOT = tuple(p for p in PARAMETERS if p.side == "robot")


@dataclass(frozen=True, eq=False)
class Result:
    """A calibration.yaml as read, with the cell that it names."""

    file: Path
    sha256: str
    calibration: Calibration
    cell: Cell

    @property
    def chain(self) -> Chain:
        """The identified robot, tool in row 6."""
        return self.calibration.geometry.robot

    @property
    def name(self) -> str:
        """Of the robot, fit for an identifier in any format."""
        return re.sub(r"\W", "_", self.cell.robot.name, flags=re.ASCII)

    @property
    def left_out(self) -> list[str]:
        """What the identified robot does beyond its geometry, in words."""
        found = [
            f"{what} ({name}, identified)"
            for name, what in EFFECTS.items()
            if name in self.calibration.file.corrections
        ]
        return found or [
            "elastic gears, play, transmission error: none was identified, so none is known"
        ]


def load_result(path: Path) -> Result:
    """A result by its calibration.yaml, or by the folder that `run` or `identify` wrote it to.

    Raises InputError when there is none, DescriptionError when it is wrong.
    """
    file = calibration_file(path)
    if not file.is_file():
        raise InputError(
            f"{file}: no such file. Name a calibration.yaml, or the folder that `ballbar identify` or `ballbar run` wrote."
        )
    calibration = load_calibration(file)
    named = calibration.file
    cell = load_cell(named.robot, named.instrument, named.plate, relative_to=file.parent)
    return Result(file, hashlib.sha256(file.read_bytes()).hexdigest(), calibration, cell)


def parameter_note(result: Result, parameter: Parameter) -> str:
    """One robot parameter: value, standard deviation, or why it is nominal."""
    entry, unit = result.calibration.file.parameters[parameter.name], parameter.unit
    if entry.identified and entry.sigma is not None:
        return f"{parameter.name} = {entry.value!r} {unit}, sigma {entry.sigma:.2g} {unit} (nominal {entry.nominal!r})"
    return f"{parameter.name} = {entry.value!r} {unit}, NOMINAL: not identified"


def notes(result: Result) -> list[str]:
    """Lines for the head of an exported file: source, frames, what is left out, every parameter with its sigma."""
    fit = result.calibration.file.fit
    lines = [
        f"Identified robot {result.cell.robot.title}, exported by ballbar {version('ballbar-bench')}.",
        f"Source: {result.file.name}, sha256 {result.sha256}. Fit: {fit.status}.",
        "Units: m and rad unless a name says otherwise. Joint angles are those of the DH model (docs/use_of_results.md).",
        "Base: frame 0, z along axis 1. Tool: end of the offset plate, where the ball-bar was held.",
        "NOT in this file, which is geometry alone:",
        *(f"  - {what}" for what in result.left_out),
        "What is called identified there is in the JSON export, and `ballbar correct` takes it into account.",
        "Parameters of the robot and their standard deviations:",
        *(f"  {parameter_note(result, p)}" for p in ROBOT),
    ]
    return [
        " ".join(line.split()) if not line.startswith("  ") else "  " + " ".join(line.split())
        for line in lines
    ]
