"""Deflection of the offset plate and elongation of the rod under load (thesis secs. 4.5 and 5.3).

Cantilever: a cantilever of length L, width b and thickness h, with an end load F and its own weight
w = rho g b h per length,

    I = b h^3 / 12
    tip deflection  F L^3 / (3 E I) + w L^4 / (8 E I)
    tip slope       F L^2 / (2 E I) + w L^3 / (6 E I)

(Timoshenko, Strength of Materials). The thesis names material, force and length, but neither the
width nor the meaning of "10 urad". With a width of 0.10 m, that of the plate in cell/plates, a
thickness of 45 mm deflects by 11 um, which is 11 urad seen from 1 m away, as sec. 4.5 says of the
encoders; the slope at the tip would be six times that. So the deflection was meant, and the width
was near 0.11 m.

Rod: a tube of section A in tension becomes longer by F L / (E A). The thesis gives force, length
and result, from which E A = 2.8e7 N follows: that of a standard-modulus carbon tube of the mass
assumed in cell/instruments.

Sphere: gimbal, rod and universal joint carry one force. The length of the ball-bar therefore
deviates by the sum of their strains s and, where the force changes sign, of the joints' backlash w,

    s_rod + 2 s_joint + 2 w_joint
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from scipy.optimize import brentq

GRAVITY = 9.81  # [m/s^2] standard gravity, rounded


@dataclass(frozen=True)
class Cantilever:
    """A rectangular cantilever."""

    length: float  # [m]
    width: float  # [m]
    thickness: float  # [m]
    modulus: float  # [Pa]
    density: float  # [kg/m^3]

    @property
    def bending_stiffness(self) -> float:
        """[N m^2] E I."""
        return self.modulus * self.width * self.thickness**3 / 12.0

    @property
    def weight(self) -> float:
        """[N/m] own weight per length."""
        return self.density * GRAVITY * self.width * self.thickness


def tip_deflection(plate: Cantilever, force: float) -> float:
    """Deflection [m] of the free end under a force [N] on it and the plate's own weight."""
    moment = force * plate.length**3 / 3.0 + plate.weight * plate.length**4 / 8.0
    return moment / plate.bending_stiffness


def tip_slope(plate: Cantilever, force: float) -> float:
    """Slope [rad] of the free end under a force [N] on it and the plate's own weight."""
    moment = force * plate.length**2 / 2.0 + plate.weight * plate.length**3 / 6.0
    return moment / plate.bending_stiffness


def width_for(deflection: float, plate: Cantilever, force: float) -> float:
    """Width [m] at which the free end deflects by `deflection` [m].

    The deflection under the plate's own weight does not depend on the width.
    """
    alone = tip_deflection(plate, 0.0)
    return plate.width * (tip_deflection(plate, force) - alone) / (deflection - alone)


def thickness_for(deflection: float, plate: Cantilever, force: float) -> float:
    """Thickness [m], between 1 mm and 1 m, at which the free end deflects by `deflection` [m]."""

    def excess(thickness: float) -> float:
        return tip_deflection(replace(plate, thickness=thickness), force) - deflection

    return float(brentq(excess, 1e-3, 1.0))


def stretch(force: float, length: float, modulus: float, section: float) -> float:
    """Elongation [m] of a rod of length [m], modulus [Pa] and section [m^2] under a force [N]."""
    return force * length / (modulus * section)


def sphere_deviation(rod: float, joint: float, backlash: float) -> float:
    """Deviation [m] from the sphere by strain of rod and of each joint and backlash of each [m]."""
    return rod + 2.0 * (joint + backlash)


PLATE_FORCE = 100.0  # [N] thesis sec. 4.5: half the handling capacity
PLATE_ALLOWED = 10e-6  # [m] thesis sec. 4.5: "10 urad ... at 1 m distance"
OFFSET_PLATE = Cantilever(
    length=0.250,  # thesis sec. 4.5
    width=0.100,  # cell/plates/plate_250.yaml, assumed
    thickness=0.045,  # thesis sec. 4.5
    modulus=70e9,  # aluminium alloys, EN 1999-1-1 cl. 3.2.5
    density=2700.0,  # the same
)
# EN 1993-1-1 cl. 3.2.6, EN 1991-1-1 table A.4
STEEL_PLATE = replace(OFFSET_PLATE, modulus=210e9, density=7850.0)
ROD_FORCE = 150.0  # [N] thesis sec. 5.3
ROD_LENGTH = 0.50  # [m] thesis sec. 5.3
# Assumed: 57 % fibre of 230 GPa (Toray T700S) along the tube, in epoxy of 3 GPa: rule of mixtures.
ROD_MODULUS = 0.57 * 230e9 + 0.43 * 3e9  # [Pa]
# Mass per length of cell/instruments by the density of the laminate, both assumed.
ROD_SECTION = 0.35 / 1600.0  # [m^2]
JOINT_STRAIN = 2.8e-6  # [m] thesis sec. 5.3, calculated from bearings and main parts, at ROD_FORCE
MEASURED = 5e-6  # [m] thesis sec. 5.3, bound of strain of the rod, strain and backlash of a joint
_ROD_STRETCH = partial(stretch, ROD_FORCE, ROD_LENGTH, ROD_MODULUS, ROD_SECTION)

CALCULATIONS: Mapping[str, partial[float]] = {  # results in SI units, by the names in claims
    "plate_deflection": partial(tip_deflection, OFFSET_PLATE, PLATE_FORCE),
    "plate_slope": partial(tip_slope, OFFSET_PLATE, PLATE_FORCE),
    "plate_width": partial(width_for, PLATE_ALLOWED, OFFSET_PLATE, PLATE_FORCE),
    "plate_thickness": partial(thickness_for, PLATE_ALLOWED, OFFSET_PLATE, PLATE_FORCE),
    "rod_stretch": _ROD_STRETCH,
    "sphere_calculated": partial(sphere_deviation, _ROD_STRETCH(), JOINT_STRAIN, 0.0),
    "sphere_measured": partial(sphere_deviation, MEASURED, MEASURED, MEASURED),
}
