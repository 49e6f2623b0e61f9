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
    """The gears are elastic: deflection = load / stiffness."""

    scale: Positive = 1.0
    """Factor on the stiffness of the robot file."""
    spread: NotNegative = 0.0
    """Standard deviation of the logarithm of the stiffness over the joints."""


class GearBacklash(Strict):
    """The gears have backlash: a dead band, or a friction element whose hysteresis is as wide."""

    kind: Literal["dead_band", "hysteresis"] = "dead_band"
    """Dead band on the load, or hysteresis. Hysteresis adds damping of four times the gear's
    stiffness times the time step.
    """
    scale: NotNegative = 1.0
    """Factor on the total width of the robot file."""
    spread: NotNegative = 0.0
    """Standard deviation of the logarithm of the width over the joints."""


class TransmissionError(Strict):
    """The gears have harmonic errors with the orders and amplitudes of the robot file.
    Their phases are drawn.
    """

    scale: NotNegative = 1.0
    """Factor on the amplitudes of the robot file."""


class CycloidRipple(Strict):
    """The ratio of cycloid drives ripples (thesis sec. 2.3, Fig. 2.4)."""

    amplitude_rad: NotNegative = 6.0e-5
    """Amplitude at the gear's output."""
    lobes: Positive = 40
    """Cycles per turn of the gear's output."""
    waveform: Literal["harmonic", "cusped"] = "cusped"
    """A sine, or the |sin| of Yang & Blanche 1990 with zero mean."""
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
    """Each gear has one harmonic error more, of an order that the robot file does not list.
    Orders, 3 to 38 cycles a turn of the output, and phases are drawn.
    """

    amplitude_rad: NotNegative = 4.0e-6
    """Amplitude at the gear's output."""


class GearFriction(Strict):
    """The gears have Coulomb, viscous and, if chosen, Stribeck friction on the motor side
    (LuGre model).
    """

    scale: NotNegative = 1.0
    """Factor on all friction of the robot file."""
    stribeck: bool = False
    """Whether break-away friction exceeds Coulomb friction. A soft servo then sticks and slips in a
    chaotic sequence.
    """


class RodStrain(Strict):
    """Rod, gimbal and universal joint of the ball-bar are elastic along the rod, in series.
    Elongation = force / stiffness.
    """

    scale: Positive = 1.0
    """Factor on all three stiffnesses of the ball-bar file."""


class RodBacklash(Strict):
    """The joints of the ball-bar have backlash along the rod, within which it carries no force.
    One force passes through both, so their widths add up.
    """

    gimbal_m: NotNegative | None = None
    """Total width of the gimbal; by default that of the ball-bar file."""
    universal_joint_m: NotNegative | None = None
    """Total width of the universal joint; by default that of the ball-bar file."""


class BarFriction(Strict):
    """The bearings of the ball-bar's joints have friction (LuGre model)."""

    torque_N_m: NotNegative | None = None
    """Friction torque of each joint; by default that of the ball-bar file."""


class PlateBending(Strict):
    """The offset plate bends as a cantilever: a hinge a third of its length from axis 6."""

    tip_stiffness_N_per_m: Positive | None = None
    """Stiffness at the tip; by default that of the plate file."""


class BaseCompliance(Strict):
    """The base of the ball-bar is elastic, with the same stiffness in x, y and z."""

    stiffness_N_per_m: Positive = 5.0e7
    """Stiffness; assumed for a steel adapter on a bolted plate."""


class BodyMasses(Strict):
    """Masses and centres of mass of the robot's links, the plate and the ball-bar's links deviate
    from their files; each is drawn.
    """

    spread: NotNegative = 0.02
    """Standard deviation of the logarithm of each mass; inertias follow."""
    centre_sigma_m: NotNegative = 3.0e-3
    """Standard deviation of each coordinate of the centres of mass."""


class UndeclaredLoad(Strict):
    """Something is mounted on the offset plate that no file states: hoses, cables, an adapter.
    Mass and place are drawn.
    """

    sigma_kg: NotNegative = 0.4
    """Mass: the magnitude of a normal draw with this deviation. Assumed."""
    centre_sigma_m: NotNegative = 0.05
    """Standard deviation of each coordinate of its centre about that of the plate. Assumed."""


class ThermalGrowth(Strict):
    """The links a2 and d4 of the robot grow while it warms up during the recording.
    Its true parameters are those at the start.
    """

    a2_m: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 4.0e-5
    """Growth of a2 from the start to the end of the recording."""
    d4_m: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 4.0e-5
    """Growth of d4 from the start to the end of the recording."""
    time_constant_s: Positive | None = None
    """Time constant of an exponential growth; none for a linear one."""


class PlantErrors(Strict):
    """Error sources that act in the plant; each is absent unless named."""

    joint_compliance: JointCompliance | None = None
    """At still poses it requires masses and gears in the robot's file."""
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
