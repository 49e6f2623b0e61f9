"""Gears of a robot whose file states none: their compliance and backlash, with wide priors.

Loads are those of typical masses, of the ball-bar and of the rod's tension. What the arm's true
masses load differently, `unit_weights` has, which stands beside these: compliance times any weight
of the arm is in it. Gears of a small arm are soft enough to yield to the friction of the ball-bar's
joints, too. The priors are what is typical of a robot of this size, and how far published robots
are from it (ballbar.cell.typical_machine).
"""

from __future__ import annotations

from dataclasses import replace

from ballbar.cell.descriptions import Cell
from ballbar.cell.typical_machine import with_typical
from ballbar.ident.corrections.base import GEAR, Coefficient, Correction
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.joint_compliance import joint_compliance

# Of the typical compliance: stiffness and mass of published robots vary by a factor of 1.8, one
# standard deviation. A wider prior leaves the scale of the tension open, and with it the flank of
# the backlash.
SPREAD = 0.8


def typical_compliance(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """One compliance a gear [rad/(N m)], under typical loads."""
    made = _named(joint_compliance(with_typical(cell.robot)[0]), "typical_compliance")
    wide = tuple(replace(c, sigma=SPREAD * c.mean) for c in made.coefficients)
    return replace(made, coefficients=wide)


def typical_backlash(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Half the width of each gear's dead band [rad], on the flank of typical loads."""
    return _named(gear_backlash(with_typical(cell.robot)[0]), "typical_backlash")


def typical_friction(cell: Cell, encoders: tuple[int, ...]) -> Correction:
    """Yield [rad] of each gear to the Coulomb friction of one joint of the ball-bar.

    It is of one size in all of them: 0.05 N m turn the wrist of an arm of 3 kg by 0.05 mrad.
    """
    torque, gears = cell.ballbar.friction_torque, joint_compliance(with_typical(cell.robot)[0])
    yielding = [(i, torque * c.mean) for i, c in enumerate(gears.coefficients)]
    each = [Coefficient(f"typical_friction{i + 1}", "rad", s, s, GEAR + i) for i, s in yielding]
    name, sentence = "typical_friction", "friction of the ball-bar"
    return Correction(name, sentence, tuple(each), lambda state: list(-state.loads.rubbed))


def _named(made: Correction, name: str) -> Correction:
    """A correction of that name, whose coefficients have names of their own."""
    coefficients = tuple(replace(c, name=f"typical_{c.name}") for c in made.coefficients)
    return replace(made, name=name, coefficients=coefficients, made_by=None)
