"""Error sources of the plant: their keys in a scenario.

What they mean for one machine stands in ballbar.sim.plant.effects. Sizes are those of the
description files of robot, ball-bar and plate times `scale`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ballbar.cell.schema import NotNegative, Positive, Strict

Axes = tuple[Annotated[int, Field(ge=1, le=6)], ...]


class JointCompliance(Strict):
    """The gears are elastic."""

    scale: Positive = 1.0
    """Factor on the stiffness of the robot file."""
    spread: NotNegative = 0.0
    """Sigma of its logarithm over the joints."""


class GearBacklash(Strict):
    """The gears have backlash of total width w."""

    kind: Literal["dead_band", "hysteresis"] = "dead_band"
    """Hysteresis adds damping of 4 times stiffness times time step."""
    scale: NotNegative = 1.0
    """Factor on the total width of the robot file."""
    spread: NotNegative = 0.0
    """Sigma of its logarithm over the joints."""


class TransmissionError(Strict):
    """The gears have harmonic errors of the robot file's orders and amplitudes."""

    scale: NotNegative = 1.0
    """Factor on the amplitudes of the robot file."""


class CycloidRipple(Strict):
    """The ratio of cycloid drives ripples (thesis sec. 2.3, Fig. 2.4)."""

    amplitude_rad: NotNegative = 6.0e-5
    """Amplitude at the gear's output."""
    lobes: Positive = 40
    """Cycles per turn of the gear's output."""
    waveform: Literal["harmonic", "cusped"] = "cusped"
    """A sine, or the |sin| of Yang & Blanche 1990."""
    axes: Axes = (1, 2, 3)
    """Axes whose gears have the ripple."""


class SinusoidalGearError(Strict):
    """Motor or gear is not concentric, which adds one sine per turn (thesis sec. 2.3)."""

    amplitude_rad: NotNegative = 1.0e-4
    """Amplitude at the gear's output."""
    side: Literal["input", "output"] = "output"
    """One cycle per turn of the gear's output, or of the motor."""
    axes: Axes = (1, 2, 3, 4, 5, 6)
    """Axes whose gears have the error."""


class UnlistedRipple(Strict):
    """Each gear has one harmonic error more, of an order that the robot file does not list."""

    amplitude_rad: NotNegative = 4.0e-6
    """Amplitude at the gear's output."""


class GearFriction(Strict):
    """The gears have Coulomb, viscous and, if chosen, Stribeck friction on the motor side
    (LuGre model).
    """

    scale: NotNegative = 1.0
    """Factor on all friction of the robot file."""
    stribeck: bool = False
    """Break-away friction exceeds Coulomb friction: a soft servo sticks and slips chaotically."""


class RodStrain(Strict):
    """Rod, gimbal and universal joint of the ball-bar are elastic along the rod, in series."""

    scale: Positive = 1.0
    """Factor on all three stiffnesses of the ball-bar file."""


class RodBacklash(Strict):
    """Gimbal and universal joint of the ball-bar have backlash along the rod."""

    gimbal_m: NotNegative | None = None
    """Total width; by default the ball-bar file's."""
    universal_joint_m: NotNegative | None = None
    """Total width; by default the ball-bar file's."""


class BarFriction(Strict):
    """The bearings of the ball-bar's joints have friction (LuGre model)."""

    torque_N_m: NotNegative | None = None
    """Torque of each joint; by default the ball-bar file's."""


class PlateBending(Strict):
    """The offset plate bends as a cantilever."""

    tip_stiffness_N_per_m: Positive | None = None
    """Stiffness at the tip; by default the plate file's."""


class BaseCompliance(Strict):
    """The base of the ball-bar is elastic, equally in x, y and z."""

    stiffness_N_per_m: Positive = 5.0e7
    """Stiffness."""


class BodyMasses(Strict):
    """Masses and centres of mass of arm, plate and ball-bar deviate from their files."""

    spread: NotNegative = 0.02
    """Sigma of each mass's logarithm; inertias follow."""
    centre_sigma_m: NotNegative = 3.0e-3
    """Sigma of each coordinate of the centres."""


class UndeclaredLoad(Strict):
    """Hoses, cables or an adapter are on the offset plate, which no file states."""

    sigma_kg: NotNegative = 0.4
    """Sigma of the draw whose magnitude is the mass. Assumed."""
    centre_sigma_m: NotNegative = 0.05
    """Sigma of each coordinate of its centre. Assumed."""


class ThermalGrowth(Strict):
    """The links a2 and d4 of the robot grow; its true parameters are those at the start."""

    a2_m: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 4.0e-5
    """Growth of a2 over the recording."""
    d4_m: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 4.0e-5
    """Growth of d4 over the recording."""
    time_constant_s: Positive | None = None
    """Exponential growth; none for a linear one."""


class PlantErrors(Strict):
    """Error sources that act in the plant; each is absent unless named."""

    joint_compliance: JointCompliance | None = None
    """At still poses requires masses and gears in the robot's file."""
    gear_backlash: GearBacklash | None = None
    """Requires joint_compliance."""
    transmission_error: TransmissionError | None = None
    cycloid_ripple: CycloidRipple | None = None
    sinusoidal_gear_error: SinusoidalGearError | None = None
    unlisted_ripple: UnlistedRipple | None = None
    gear_friction: GearFriction | None = None
    rod_strain: RodStrain | None = None
    rod_backlash: RodBacklash | None = None
    bar_friction: BarFriction | None = None
    plate_bending: PlateBending | None = None
    base_compliance: BaseCompliance | None = None
    masses: BodyMasses | None = None
    """Requires masses in the robot's file."""
    payload: UndeclaredLoad | None = None
    """Requires masses in the robot's file."""
    thermal_growth: ThermalGrowth | None = None
