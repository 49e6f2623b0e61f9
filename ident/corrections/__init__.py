"""Corrections by name: each an error source of the real cell, one file each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest

from ballbar.cell.descriptions import Cell, Key, Robot
from ballbar.cell.errors import InputError
from ballbar.cell.plugins import PluginTable
from ballbar.ident.corrections.base import Correction, Maker, of_robot
from ballbar.ident.corrections.bearing_tilt import bearing_tilt
from ballbar.ident.corrections.encoder_harmonics import encoder_harmonics
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.gear_ratio import GEAR_RATIO, gear_ratio, gears_of
from ballbar.ident.corrections.gear_ripple import gear_ripple
from ballbar.ident.corrections.gear_softening import GEAR_SOFTENING, gear_softening, knees_of
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.joint_harmonics import JOINT_HARMONICS, joint_harmonics, orders_of
from ballbar.ident.corrections.joint_lag import joint_lag
from ballbar.ident.corrections.link_growth import link_growth
from ballbar.ident.corrections.plate_bending import plate_bending
from ballbar.ident.corrections.remounted_tool import remounted_tool
from ballbar.ident.corrections.rod_elongation import ROD_ELONGATION, rod_elongation
from ballbar.ident.corrections.rod_strain import rod_strain
from ballbar.ident.corrections.typical_gears import (
    typical_backlash,
    typical_compliance,
    typical_friction,
)
from ballbar.ident.corrections.unit_weights import unit_weights

OWN: dict[str, Maker] = {
    "joint_compliance": of_robot(joint_compliance),
    "gear_backlash": of_robot(gear_backlash),
    "gear_ripple": of_robot(gear_ripple),
    "encoder_harmonics": encoder_harmonics,
    "rod_strain": rod_strain,
    "plate_bending": plate_bending,
    "unit_weights": of_robot(unit_weights),
    "typical_compliance": typical_compliance,
    "typical_backlash": typical_backlash,
    "typical_friction": typical_friction,
    "bearing_tilt": bearing_tilt,
    "joint_lag": of_robot(joint_lag),
    GEAR_RATIO: gear_ratio,
}
# With those of plug-ins, which a fit has where they are named.
CORRECTIONS = PluginTable("corrections", OWN)

# What holds for single recordings, by cell and number of recordings.
OF_RECORDINGS: dict[str, Callable[[Cell, int], Correction]] = {
    "link_growth": link_growth,
    "remounted_tool": remounted_tool,
}

# Left out of the complete model until the data ask for them: few machines need them.
ON_EVIDENCE = ("joint_lag", GEAR_RATIO, "link_growth", "remounted_tool")

# Keys of the robot's file without which a correction cannot be formed.
REQUIRED: dict[str, tuple[Key, ...]] = {
    "joint_compliance": ("links", "gears"),
    "gear_backlash": ("links", "gears"),
    "gear_ripple": ("gears",),
    "bearing_tilt": ("links",),
}


# Of the rod and the encoders of a ball-bar; where the length is sensed neither is in the model.
OF_RIGID_ROD = (
    *("encoder_harmonics", "rod_strain", "plate_bending"),
    *("typical_compliance", "typical_backlash", "typical_friction"),
)

# What stands for a correction that the robot's file does not support, and for that one only.
SUBSTITUTES = {
    **dict.fromkeys(("unit_weights", "typical_compliance", "typical_friction"), "joint_compliance"),
    "typical_backlash": "gear_backlash",
}


def supported_corrections(robot: Robot, *, rod_sensed: bool = False) -> list[str]:
    """Names of the corrections of a robot's complete model: those that its file supports.

    rod_sensed : whether a length is measured in place of a ball-bar's angles.
    """
    without = corrections_without_data(robot)
    return [
        name
        for name in OWN
        if name not in without
        and name not in ON_EVIDENCE
        and (name not in SUBSTITUTES or SUBSTITUTES[name] in without)
        and not (rod_sensed and name in OF_RIGID_ROD)
    ]


def corrections_on_evidence(robot: Robot, recordings: int) -> list[str]:
    """Names of the corrections that a robot's complete model may need beside those."""
    without = corrections_without_data(robot)
    several = recordings > 1
    return [n for n in ON_EVIDENCE if n not in without and (several or n != "remounted_tool")]


def corrections_without_data(robot: Robot) -> dict[str, list[Key]]:
    """Corrections that the robot's file does not support, each with the keys that it lacks."""
    lacking = {name: [key for key in keys if robot.lacks(key)] for name, keys in REQUIRED.items()}
    return {name: keys for name, keys in lacking.items() if keys}


def correction_named(
    name: str, cell: Cell, encoders: tuple[int, ...], recordings: int = 1
) -> Correction:
    """A correction for a cell.

    Raises InputError if the robot's file lacks what it needs, the cell has no rigid rod, or a
    plug-in makes one of another name.
    """
    for key in REQUIRED.get(name, ()):
        cell.robot.required(key)
    if name in OF_RIGID_ROD and cell.ballbar.stroke is not None:
        raise InputError(
            f"correction {name} is of a ball-bar with a rigid rod, and {cell.ballbar.name} "
            "measures a length. Leave it out."
        )
    if name in OF_RECORDINGS:
        made = OF_RECORDINGS[name](cell, recordings)
    else:
        made = CORRECTIONS[name](cell, encoders)
    if made.name != name:
        raise InputError(f"plug-in {name}: its correction calls itself {made.name}. Rename it.")
    return replace(made, made_by=partial(correction_named, name, cell, encoders, recordings))


# The machine's, which results keep: slips and remounted tools are a recording's.
OF_MACHINE = PluginTable(
    "corrections", dict.fromkeys((*OWN, JOINT_HARMONICS, GEAR_SOFTENING, ROD_ELONGATION))
)


def belongs_to_machine(correction: Correction) -> bool:
    """Whether a correction is the machine's."""
    return correction.name in OF_MACHINE


def correction_of_result(
    name: str, coefficients: Sequence[str], cell: Cell, encoders: tuple[int, ...]
) -> Correction:
    """A correction of a result, formed again; coefficients : their names.

    Raises InputError if the robot's file lacks what it needs, KeyError for an unknown name.
    """
    if name == JOINT_HARMONICS:
        return joint_harmonics(orders_of(coefficients))
    if name == GEAR_SOFTENING:
        return gear_softening(cell.robot, knees_of(coefficients))
    if name == ROD_ELONGATION:
        return rod_elongation(cell)
    if name == GEAR_RATIO:
        gears = [i for i in gears_of(coefficients) if i < cell.robot.joints]
        return gear_ratio(cell, encoders, gears)
    return correction_named(name, cell, encoders)


def as_in_result(made: Correction, coefficients: Iterable[str], robot: Robot) -> Correction:
    """A correction, if its coefficients are those of a result, in that order.

    coefficients : names in the result. Raises InputError where they are others, or of a joint that
    the robot does not have.
    """
    expected = [c.name for c in made.coefficients]
    for k, (here, there) in enumerate(zip_longest(coefficients, expected), start=1):
        if here != there:
            raise InputError(
                f"corrections.{made.name}: coefficient {k} is {here or 'nothing'}, expected "
                f"{there or 'nothing more'} of robot {robot.title}. The order counts. Restore the "
                "file as it was written, or identify again if the robot's file was changed since."
            )
    for c in made.coefficients:
        if isinstance(c.channel, int) and c.channel >= robot.joints:
            raise InputError(
                f"corrections.{made.name}.{c.name}: robot {robot.title} has {robot.joints} joints"
            )
    return made
