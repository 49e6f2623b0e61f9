"""Corrections by name: each an error source of the real cell, one file each."""

from __future__ import annotations

from cell.descriptions import Cell, Key, Robot
from ident.corrections.base import Correction, Maker
from ident.corrections.encoder_harmonics import encoder_harmonics
from ident.corrections.gear_backlash import gear_backlash
from ident.corrections.gear_ripple import gear_ripple
from ident.corrections.joint_compliance import joint_compliance
from ident.corrections.plate_bending import plate_bending
from ident.corrections.rod_strain import rod_strain

CORRECTIONS: dict[str, Maker] = {
    "joint_compliance": joint_compliance,
    "gear_backlash": gear_backlash,
    "gear_ripple": gear_ripple,
    "encoder_harmonics": encoder_harmonics,
    "rod_strain": rod_strain,
    "plate_bending": plate_bending,
}

# Keys of the robot's file without which a correction cannot be formed.
REQUIRED: dict[str, tuple[Key, ...]] = {
    "joint_compliance": ("links", "gears"),
    "gear_backlash": ("links", "gears"),
    "gear_ripple": ("gears",),
}


def corrections_without_data(robot: Robot) -> dict[str, list[Key]]:
    """Corrections that the robot's file does not support, each with the keys that it lacks."""
    lacking = {name: [key for key in keys if robot.lacks(key)] for name, keys in REQUIRED.items()}
    return {name: keys for name, keys in lacking.items() if keys}


def correction_named(name: str, cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """A correction for a cell.

    Raises InputError if the robot's file lacks what it needs.
    """
    for key in REQUIRED.get(name, ()):
        cell.robot.required(key)
    return CORRECTIONS[name](cell, encoders)
