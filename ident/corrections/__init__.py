"""Corrections by name: each an error source of the real cell, one file each."""

from __future__ import annotations

from ident.corrections.base import Maker
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
