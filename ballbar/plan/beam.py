"""What offset plate and rod give under load, from first principles: the calculations of thesis secs. 4.5 and 5.3.

Plate: a cantilever of length L, section b wide and h thick, with end load F and own weight w = rho g b h over its length,

    I = b h^3 / 12        tip deflection  F L^3 / (3 E I) + w L^4 / (8 E I)        tip slope  F L^2 / (2 E I) + w L^3 / (6 E I)

(Timoshenko, Strength of Materials). The thesis names material, force and length, neither width nor what "10 urad" means. With 0.10 m of
width, that of the plate in cell/plates, 45 mm deflect by 11 um, which is 11 urad seen from 1 m away, as sec. 4.5 says of the encoders;
the slope at the tip would be six times that. So the deflection was meant, and the width was near 0.11 m.

Rod: a tube of section A in tension stretches by F L / (E A). The thesis gives force, length and result, so only E A follows: 2.8e7 N.
A standard-modulus carbon tube of the mass assumed in cell/ballbars has that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from scipy.optimize import brentq

GRAVITY = 9.81  # [m/s^2] standard gravity, rounded


@dataclass(frozen=True)
class Plate:
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
        """[N/m] over its length."""
        return self.density * GRAVITY * self.width * self.thickness


def tip_deflection(plate: Plate, force: float) -> float:
    """[m] by which the free end sinks under a force [N] there and the plate's own weight."""
    return (
        force * plate.length**3 / 3.0 + plate.weight * plate.length**4 / 8.0
    ) / plate.bending_stiffness


def tip_slope(plate: Plate, force: float) -> float:
    """[rad] by which the free end turns under the same."""
    return (
        force * plate.length**2 / 2.0 + plate.weight * plate.length**3 / 6.0
    ) / plate.bending_stiffness


def width_for(deflection: float, plate: Plate, force: float) -> float:
    """[m] width at which the free end sinks by so much [m]; that under its own weight does not depend on the width."""
    alone = tip_deflection(plate, 0.0)
    return plate.width * (tip_deflection(plate, force) - alone) / (deflection - alone)


def thickness_for(deflection: float, plate: Plate, force: float) -> float:
    """[m] thickness, between 1 mm and 1 m, at which the free end sinks by so much [m]."""

    def excess(thickness: float) -> float:
        return tip_deflection(replace(plate, thickness=thickness), force) - deflection

    return float(brentq(excess, 1e-3, 1.0))


def stretch(force: float, length: float, modulus: float, section: float) -> float:
    """[m] by which a rod of section [m^2] gets longer."""
    return force * length / (modulus * section)


PLATE_FORCE = 100.0  # [N] thesis sec. 4.5: half the handling capacity
PLATE_ALLOWED = 10e-6  # [m] thesis sec. 4.5: "10 urad ... at 1 m distance"
OFFSET_PLATE = Plate(
    length=0.250,  # thesis sec. 4.5
    width=0.100,  # cell/plates/plate_250.yaml, assumed
    thickness=0.045,  # thesis sec. 4.5
    modulus=70e9,  # aluminium alloys, EN 1999-1-1 cl. 3.2.5
    density=2700.0,  # the same
)
STEEL_PLATE = replace(
    OFFSET_PLATE, modulus=210e9, density=7850.0
)  # EN 1993-1-1 cl. 3.2.6, EN 1991-1-1 table A.4
ROD_FORCE = 150.0  # [N] thesis sec. 5.3
ROD_LENGTH = 0.50  # [m] thesis sec. 5.3
# Assumed: 57 % standard fibre of 230 GPa (Toray T700S) along the tube, in epoxy of 3 GPa: rule of mixtures.
ROD_MODULUS = 0.57 * 230e9 + 0.43 * 3e9  # [Pa]
ROD_SECTION = (
    0.35 / 1600.0
)  # [m^2] mass over length of cell/ballbars by the density of the laminate, both assumed

FIGURES: Mapping[str, partial[float]] = {  # SI, by the names that claims use
    "plate_deflection": partial(tip_deflection, OFFSET_PLATE, PLATE_FORCE),
    "plate_slope": partial(tip_slope, OFFSET_PLATE, PLATE_FORCE),
    "plate_width": partial(width_for, PLATE_ALLOWED, OFFSET_PLATE, PLATE_FORCE),
    "plate_thickness": partial(thickness_for, PLATE_ALLOWED, OFFSET_PLATE, PLATE_FORCE),
    "rod_stretch": partial(stretch, ROD_FORCE, ROD_LENGTH, ROD_MODULUS, ROD_SECTION),
}
