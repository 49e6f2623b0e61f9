"""Error sources of the plant: what a scenario may ask for, and what that means for one machine.

Gear effects act at the gear, between motor i and its output g_i; `joints = g @ gear_to_joint` carries them through parallel
rod and wrist into the joints. Sizes are those of the robot's, ball-bar's and plate's files times `scale`; what differs from
unit to unit (phases, spread) is drawn from the stream of its source.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from cell.arrays import Array
from cell.descriptions import Cell
from cell.errors import InputError
from cell.schema import Strict
from sim.streams import stream

Scale = Annotated[float, Field(ge=0.0)]
Axes = tuple[Annotated[int, Field(ge=1, le=6)], ...]
RIGID_ROD = (
    1e10  # [N/m] without rod_strain: 0.01 um at 100 N, so that the rod still shows its force
)
CUSP_TERMS = 4  # harmonics of the cusped wave; the rest is 11 % of the peak at the cusp, 4 % at 25 deg, 2 % at 60 deg, 1.5 % further out


class JointCompliance(Strict):
    """Elastic gears: deflection = load / stiffness."""

    scale: Annotated[float, Field(gt=0.0)] = Field(
        1.0, description="Stiffness, times the robot file's."
    )
    spread: Scale = Field(
        0.0, description="Standard deviation of the logarithm of the stiffness over the joints."
    )


class GearBacklash(Strict):
    """Play of the gears: a dead band on the load, or a friction element that leaves a hysteresis of the same width."""

    kind: Literal["dead_band", "hysteresis"] = Field(
        "dead_band",
        description="Hysteresis adds damping of four times the gear's stiffness times the time step.",
    )
    scale: Scale = Field(1.0, description="Total width, times the robot file's.")
    spread: Scale = Field(
        0.0, description="Standard deviation of the logarithm of the width over the joints."
    )


class TransmissionError(Strict):
    """Harmonic error of the gears, orders and amplitudes of the robot file, phases drawn."""

    scale: Scale = Field(1.0, description="Amplitudes, times the robot file's.")


class CycloidRipple(Strict):
    """Gear ratio ripple of cycloid drives (thesis sec. 2.3, Fig. 2.4)."""

    amplitude_rad: Annotated[float, Field(ge=0.0)] = Field(
        6.0e-5, description="At the gear's output."
    )
    lobes: Annotated[float, Field(gt=0.0)] = Field(40, description="Cycles a turn of the output.")
    waveform: Literal["harmonic", "cusped"] = Field(
        "cusped", description="A sine, or |sin| of Yang & Blanche 1990 with zero mean."
    )
    axes: Axes = Field((1, 2, 3), description="Gears that have it.")


class SinusoidalGearError(Strict):
    """One sine a turn of the gear's output or input (thesis sec. 2.3: motor or gear not concentric)."""

    amplitude_rad: Annotated[float, Field(ge=0.0)] = Field(
        1.0e-4, description="At the gear's output."
    )
    side: Literal["input", "output"] = Field(
        "output", description="One cycle a turn of the gear's output, or of the motor."
    )
    axes: Axes = Field((1, 2, 3, 4, 5, 6), description="Gears that have it.")


class GearFriction(Strict):
    """Coulomb, viscous and, if asked for, Stribeck friction on the motor side (LuGre model)."""

    scale: Scale = Field(1.0, description="Of all friction of the robot file.")
    stribeck: bool = Field(
        False,
        description="Break-away friction too: a soft servo then sticks and slips, in a chaotic sequence.",
    )


class RodStrain(Strict):
    """Rod and joints of the ball-bar give way along the rod: strain = force / stiffness."""

    scale: Annotated[float, Field(gt=0.0)] = Field(
        1.0, description="Stiffness, times the ball-bar file's."
    )


class RodBacklash(Strict):
    """Play of the ball-bar's joints along the rod: no force inside it."""

    width_m: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="Total width; default of the ball-bar file."
    )


class BarFriction(Strict):
    """Bearing friction of the ball-bar's joints (LuGre model)."""

    torque_N_m: Annotated[float, Field(ge=0.0)] | None = Field(
        None, description="Of each joint; default of the ball-bar file."
    )


class PlateBending(Strict):
    """The offset plate as a cantilever: a hinge a third of its length from the sixth axis."""

    tip_stiffness_N_per_m: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Default of the plate file."
    )


class BaseCompliance(Strict):
    """The ball-bar's base gives way alike in x, y and z."""

    stiffness_N_per_m: Annotated[float, Field(gt=0.0)] = Field(
        5.0e7, description="Assumed: a steel adapter on a bolted plate."
    )


class PlantErrors(Strict):
    """Error sources that act in the plant; each absent unless named."""

    joint_compliance: JointCompliance | None = None
    gear_backlash: GearBacklash | None = Field(None, description="Needs joint_compliance.")
    transmission_error: TransmissionError | None = None
    cycloid_ripple: CycloidRipple | None = None
    sinusoidal_gear_error: SinusoidalGearError | None = None
    gear_friction: GearFriction | None = None
    rod_strain: RodStrain | None = None
    rod_backlash: RodBacklash | None = None
    bar_friction: BarFriction | None = None
    plate_bending: PlateBending | None = None
    base_compliance: BaseCompliance | None = None


@dataclass(frozen=True)
class Ripple:
    """One harmonic of one gear: delta = amplitude * sin(order * g + phase), g its output angle."""

    gear: int  # from 0
    order: float  # cycles a turn of the output
    amplitude: float  # [rad]
    phase: float  # [rad]


@dataclass(frozen=True, eq=False)
class PlantEffects:
    """What is wrong with one machine."""

    gear_stiffness: Array | None = None  # (6,) [N m/rad]; None: rigid gears
    gear_backlash: Array = field(
        default_factory=lambda: np.zeros(6)
    )  # (6,) [rad] half width of the dead band
    gear_hysteresis: Array = field(
        default_factory=lambda: np.zeros(6)
    )  # (6,) [rad] half width of the loop
    ripples: tuple[Ripple, ...] = ()
    friction_scale: float = 0.0  # of the robot file's gear friction
    stribeck: bool = False  # whether break-away friction is above Coulomb friction
    rod_stiffness: float = RIGID_ROD  # [N/m] rod and ball-bar joints in series
    rod_backlash: float = 0.0  # [m] half width
    bar_friction: float = 0.0  # [N m]
    plate_stiffness: float | None = None  # [N/m] at the tip; None: rigid
    base_stiffness: float | None = None  # [N/m]; None: rigid
    force_sensor: bool = False  # whether the flange's force and torque are measured

    def transmission_error(self, gears: Array) -> Array:
        """(N, 6) [rad] delta of each gear at output angles (N, 6): the motor shows g - delta(g)."""
        delta = np.zeros_like(gears)
        for ripple in self.ripples:
            delta[:, ripple.gear] += ripple.amplitude * np.sin(
                ripple.order * gears[:, ripple.gear] + ripple.phase
            )
        return delta


def plant_effects(errors: PlantErrors, cell: Cell, seed: int) -> PlantEffects:
    """The machine that a scenario describes, everything drawn that differs from unit to unit.

    Raises InputError for play in rigid gears.
    """
    if errors.gear_backlash is not None and errors.joint_compliance is None:
        raise InputError(
            "errors.gear_backlash: needs joint_compliance beside it; play without a spring has no place to rest."
        )
    gears, bar = cell.robot.gears, cell.ballbar
    compliance, lost = errors.joint_compliance, errors.gear_backlash
    stiffness = width = None
    if compliance is not None:
        stiffness = _spread(
            gears.stiffness * compliance.scale, compliance.spread, stream(seed, "joint_compliance")
        )
    if lost is not None:
        width = 0.5 * _spread(
            gears.lost_motion * lost.scale, lost.spread, stream(seed, "lost_motion")
        )
    none = np.zeros(6)
    dead_band = width if lost is not None and lost.kind == "dead_band" else None
    backlash, friction, plate = errors.rod_backlash, errors.bar_friction, errors.plate_bending
    return PlantEffects(
        gear_stiffness=stiffness,
        gear_backlash=none if dead_band is None else dead_band,
        gear_hysteresis=none if width is None or dead_band is not None else width,
        ripples=_ripples(errors, cell, seed),
        friction_scale=errors.gear_friction.scale if errors.gear_friction else 0.0,
        stribeck=errors.gear_friction is not None and errors.gear_friction.stribeck,
        rod_stiffness=bar.axial_stiffness * errors.rod_strain.scale
        if errors.rod_strain
        else RIGID_ROD,
        rod_backlash=0.5 * _default(backlash.width_m, bar.backlash) if backlash else 0.0,
        bar_friction=_default(friction.torque_N_m, bar.friction_torque) if friction else 0.0,
        plate_stiffness=_default(plate.tip_stiffness_N_per_m, cell.plate.tip_stiffness)
        if plate
        else None,
        base_stiffness=errors.base_compliance.stiffness_N_per_m if errors.base_compliance else None,
    )


def _ripples(errors: PlantErrors, cell: Cell, seed: int) -> tuple[Ripple, ...]:
    ripples: list[Ripple] = []
    if (table := errors.transmission_error) is not None:
        rng = stream(seed, "transmission_error")
        for gear, harmonics in enumerate(cell.robot.gears.harmonics):
            ripples += [
                Ripple(gear, order, table.scale * size, float(rng.uniform(0.0, 2.0 * np.pi)))
                for order, size in harmonics
            ]
    if (cycloid := errors.cycloid_ripple) is not None:
        phases = stream(seed, "cycloid_ripple").uniform(0.0, 2.0 * np.pi, 6)
        for axis in cycloid.axes:
            ripples += _cycloid(axis - 1, cycloid, float(phases[axis - 1]))
    if (sine := errors.sinusoidal_gear_error) is not None:
        phases = stream(seed, "sinusoidal_gear_error").uniform(0.0, 2.0 * np.pi, 6)
        for axis in sine.axes:
            order = (
                1.0
                if sine.side == "output"
                else 1.0 / abs(float(cell.robot.transmission[axis - 1, axis - 1]))
            )
            ripples.append(Ripple(axis - 1, order, sine.amplitude_rad, float(phases[axis - 1])))
    return _merged(ripples)


def _merged(ripples: list[Ripple]) -> tuple[Ripple, ...]:
    """Harmonics of one gear and order added up to one: each costs the simulation a tenth of a microsecond a step."""
    sums: dict[tuple[int, float], complex] = {}
    for r in ripples:
        sums[r.gear, r.order] = sums.get((r.gear, r.order), 0j) + r.amplitude * np.exp(1j * r.phase)
    return tuple(
        Ripple(gear, order, abs(z), float(np.angle(z))) for (gear, order), z in sums.items()
    )


def _cycloid(gear: int, cycloid: CycloidRipple, phase: float) -> list[Ripple]:
    """A sine, or -2 sum cos(k x) / (4 k^2 - 1): |sin(x/2)| with zero mean and unit peak, x = lobes * g + phase."""
    if cycloid.waveform == "harmonic":
        return [Ripple(gear, cycloid.lobes, cycloid.amplitude_rad, phase)]
    terms = range(1, CUSP_TERMS + 1)
    return [
        Ripple(
            gear,
            k * cycloid.lobes,
            -2.0 * cycloid.amplitude_rad / (4 * k * k - 1),
            k * phase + 0.5 * np.pi,
        )
        for k in terms
    ]


def _spread(nominal: Array, spread: float, rng: np.random.Generator) -> Array:
    return nominal * np.exp(spread * rng.standard_normal(6))


def _default(asked: float | None, usual: float) -> float:
    return usual if asked is None else asked
