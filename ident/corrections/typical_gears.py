"""Gears of a robot whose file states none: their compliance and backlash, with wide priors.

Loads are those of typical masses, of the ball-bar and of the rod's tension. What the arm's true
masses load differently, `unit_weights` has, which stands beside these two: compliance times any
weight of the arm is in it. The priors are what is typical of a robot of this size, and how far
published robots are from it (cell.typical_machine).
"""

from __future__ import annotations

from dataclasses import replace

from cell.descriptions import Cell
from cell.typical_machine import with_typical
from ident.corrections.base import Correction, remade
from ident.corrections.gear_backlash import gear_backlash
from ident.corrections.joint_compliance import gear_compliance

# Of the typical compliance: stiffness and mass of published robots vary by a factor of 1.8, one
# standard deviation. A wider prior leaves the scale of the tension open, and with it the flank of
# the backlash.
SPREAD = 0.8


@remade
def typical_compliance(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """One compliance a gear [rad/(N m)], under typical loads."""
    made = _named(gear_compliance(with_typical(cell.robot)[0]), "typical_compliance")
    wide = tuple(replace(c, sigma=SPREAD * c.mean) for c in made.coefficients)
    return replace(made, coefficients=wide)


@remade
def typical_backlash(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Half the width of each gear's dead band [rad], on the flank of typical loads."""
    typical = replace(cell, robot=with_typical(cell.robot)[0])
    return _named(gear_backlash(typical, encoders), "typical_backlash")


def _named(made: Correction, name: str) -> Correction:
    """A correction of that name, whose coefficients have names of their own."""
    coefficients = tuple(replace(c, name=f"typical_{c.name}") for c in made.coefficients)
    return replace(made, name=name, coefficients=coefficients)
