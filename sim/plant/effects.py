"""Elasticity, backlash, ripple, friction and masses of one simulated machine, drawn by a scenario.

Gear effects act at the gear, between motor i and its output g_i; `joints = g @ gear_to_joint` maps
them through parallel rod and wrist into the joints. What differs from unit to unit (phases, spread)
is drawn from the stream of its source.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cell.arrays import Array
from cell.descriptions import BallBar, Cell, Link, Robot, ServoGains
from cell.errors import InputError
from cell.geometry import Geometry
from sim.errors.plant_errors import (
    BodyMasses,
    CycloidRipple,
    Payload,
    PlantErrors,
    RodBacklash,
    ThermalGrowth,
)
from sim.streams import stream

RIGID_ROD = (
    1e10  # [N/m] without rod_strain: 0.01 um at 100 N, so that the rod still shows its force
)
# Harmonics of the cusped wave; the others amount to 11 % of the peak at the cusp, 4 % at 25 deg,
# 2 % at 60 deg and 1.5 % further away.
CUSP_TERMS = 4
_ROUNDS = 4  # of the gears' harmonics; each gains three digits
UNLISTED_ORDERS = range(3, 39)  # cycles per turn of the output; between those of the files


@dataclass(frozen=True)
class Ripple:
    """One harmonic of one gear: delta = amplitude * sin(order * g + phase), g its output angle."""

    gear: int  # from 0
    order: float  # cycles per turn of the output
    amplitude: float  # [rad]
    phase: float  # [rad]


@dataclass(frozen=True, eq=False)
class PlantEffects:
    """Elasticity, backlash, ripple, friction and masses of one machine."""

    gear_stiffness: Array | None = None  # (J,) [N m/rad]; None: rigid gears
    # (J,) [rad] half widths of the dead band and of the hysteresis loop
    gear_backlash: Array = field(default_factory=lambda: np.zeros(6))
    gear_hysteresis: Array = field(default_factory=lambda: np.zeros(6))
    ripples: tuple[Ripple, ...] = ()
    friction_scale: float = 0.0  # factor on the gear friction of the robot file
    stribeck: bool = False  # whether break-away friction is above Coulomb friction
    rod_stiffness: float = RIGID_ROD  # [N/m] rod and ball-bar joints in series
    rod_backlash: float = 0.0  # [m] half width
    bar_friction: float = 0.0  # [N m]
    plate_stiffness: float | None = None  # [N/m] at the tip; None: rigid
    base_stiffness: float | None = None  # [N/m]; None: rigid
    masses: Masses | None = None  # None: those of the files
    growth: ThermalGrowth | None = None  # of the links; None: their lengths are constant
    force_sensor: bool = False  # whether the flange's force and torque are measured

    @property
    def without_backlash(self) -> PlantEffects:
        """The same machine with no play in gears and rod."""
        return replace(self, gear_backlash=np.zeros_like(self.gear_backlash), rod_backlash=0.0)

    def transmission_error(self, gears: Array) -> Array:
        """(N, J) [rad] error delta of each gear at output angles g (N, J) [rad].

        The motor shows g - delta(g).
        """
        delta = np.zeros_like(gears)
        for ripple in self.ripples:
            delta[:, ripple.gear] += ripple.amplitude * np.sin(
                ripple.order * gears[:, ripple.gear] + ripple.phase
            )
        return delta

    def gear_outputs(self, shown: Array) -> Array:
        """(N, J) [rad] output angles of gears whose motors show angles (N, J) [rad]."""
        gears = shown
        for _ in range(_ROUNDS):
            gears = shown + self.transmission_error(gears)
        return gears


def plant_effects(errors: PlantErrors, cell: Cell, seed: int) -> PlantEffects:
    """The machine that a scenario describes; what differs from unit to unit is drawn.

    Raises InputError for backlash in rigid gears.
    """
    if errors.gear_backlash is not None and errors.joint_compliance is None:
        raise InputError(
            "errors.gear_backlash: needs joint_compliance beside it, since a rigid gear with "
            "backlash has no equilibrium. Add joint_compliance: {}, or leave gear_backlash out."
        )
    robot, bar = cell.robot, cell.ballbar
    compliance, gap = errors.joint_compliance, errors.gear_backlash
    stiffness, none = None, np.zeros(robot.joints)
    dead_band = hysteresis = none
    if compliance is not None:
        rng = stream(seed, "joint_compliance")
        stiffness = _spread(
            robot.required("gears").stiffness * compliance.scale, compliance.spread, rng
        )
    if gap is not None:
        rng = stream(seed, "lost_motion")  # named as the catalogue figure
        half_width = 0.5 * _spread(robot.required("gears").lost_motion * gap.scale, gap.spread, rng)
        dead_band, hysteresis = (
            (half_width, none) if gap.kind == "dead_band" else (none, half_width)
        )
    backlash, friction, plate = errors.rod_backlash, errors.bar_friction, errors.plate_bending
    return PlantEffects(
        gear_stiffness=stiffness,
        gear_backlash=dead_band,
        gear_hysteresis=hysteresis,
        ripples=_ripples(errors, cell, seed),
        friction_scale=errors.gear_friction.scale if errors.gear_friction else 0.0,
        stribeck=errors.gear_friction is not None and errors.gear_friction.stribeck,
        rod_stiffness=bar.axial_stiffness * errors.rod_strain.scale
        if errors.rod_strain
        else RIGID_ROD,
        rod_backlash=0.5 * _play(backlash, bar) if backlash else 0.0,
        bar_friction=_default(friction.torque_N_m, bar.friction_torque) if friction else 0.0,
        plate_stiffness=_default(plate.tip_stiffness_N_per_m, cell.plate.tip_stiffness)
        if plate
        else None,
        base_stiffness=errors.base_compliance.stiffness_N_per_m if errors.base_compliance else None,
        masses=_masses(errors, cell, seed),
        growth=errors.thermal_growth,
    )


def _masses(errors: PlantErrors, cell: Cell, seed: int) -> Masses | None:
    masses = drawn_masses(errors.masses, cell, stream(seed, "masses")) if errors.masses else None
    if errors.payload is None:
        return masses
    return (masses or stated_masses(cell)).with_payload(errors.payload, stream(seed, "payload"))


def _ripples(errors: PlantErrors, cell: Cell, seed: int) -> tuple[Ripple, ...]:
    ripples: list[Ripple] = []
    joints = cell.robot.joints
    if (table := errors.transmission_error) is not None:
        rng = stream(seed, "transmission_error")
        for gear, harmonics in enumerate(cell.robot.required("gears").harmonics):
            ripples += [
                Ripple(gear, order, table.scale * size, float(rng.uniform(0.0, 2.0 * np.pi)))
                for order, size in harmonics
            ]
    if (cycloid := errors.cycloid_ripple) is not None:
        phases = stream(seed, "cycloid_ripple").uniform(0.0, 2.0 * np.pi, joints)
        for axis in cycloid.axes:
            ripples += _cycloid(axis - 1, cycloid, float(phases[axis - 1]))
    if (sine := errors.sinusoidal_gear_error) is not None:
        phases = stream(seed, "sinusoidal_gear_error").uniform(0.0, 2.0 * np.pi, joints)
        for axis in sine.axes:
            order = (
                1.0
                if sine.side == "output"
                else 1.0 / abs(float(cell.robot.transmission[axis - 1, axis - 1]))
            )
            ripples.append(Ripple(axis - 1, order, sine.amplitude_rad, float(phases[axis - 1])))
    if (unlisted := errors.unlisted_ripple) is not None:
        ripples += _unlisted(unlisted.amplitude_rad, cell.robot, stream(seed, "unlisted_ripple"))
    return _merged(ripples)


def _unlisted(amplitude: float, robot: Robot, rng: np.random.Generator) -> list[Ripple]:
    listed = robot.gears.harmonics if robot.gears else ((),) * robot.joints
    ripples = []
    for gear, harmonics in enumerate(listed):
        orders = sorted(set(UNLISTED_ORDERS) - {order for order, _ in harmonics})
        order, phase = float(rng.choice(orders)), float(rng.uniform(0.0, 2.0 * np.pi))
        ripples.append(Ripple(gear, order, amplitude, phase))
    return ripples


def _merged(ripples: list[Ripple]) -> tuple[Ripple, ...]:
    """Sum of the harmonics of equal gear and order; each one costs 0.1 us per simulation step."""
    sums: dict[tuple[int, float], complex] = {}
    for r in ripples:
        sums[r.gear, r.order] = sums.get((r.gear, r.order), 0j) + r.amplitude * np.exp(1j * r.phase)
    return tuple(
        Ripple(gear, order, abs(z), float(np.angle(z))) for (gear, order), z in sums.items()
    )


def _cycloid(gear: int, cycloid: CycloidRipple, phase: float) -> list[Ripple]:
    """Harmonics of a sine, or of |sin(x/2)| with zero mean and unit peak, x = lobes * g + phase.

    The latter is -2 sum_k cos(k x) / (4 k^2 - 1).
    """
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
    return nominal * np.exp(spread * rng.standard_normal(nominal.size))


def _play(stated: RodBacklash, bar: BallBar) -> float:
    gimbal, universal_joint = bar.joint_backlash
    return _default(stated.gimbal_m, gimbal) + _default(stated.universal_joint_m, universal_joint)


def _default(stated: float | None, usual: float) -> float:
    return usual if stated is None else stated


@dataclass(frozen=True, eq=False)
class Plant:
    """One machine to simulate."""

    cell: Cell  # nominal, which the servo's feed-forward knows
    geometry: Geometry  # true parameters; encoder offsets belong to the encoders and are not here
    effects: PlantEffects
    gains: ServoGains

    @property
    def loaded(self) -> Cell:
        """The cell with its true masses."""
        masses = self.effects.masses
        return self.cell if masses is None else masses.on(self.cell)


def servo_gains(robot: Robot, name: str, *, key: str = "plant.servo") -> ServoGains:
    """The gain set of a robot with that name.

    key : of the file that names it, for the message. Raises InputError if there is no such set.
    """
    gains = robot.required("servo")
    if name not in gains:
        raise InputError(
            f"{key} = {name!r}: robot {robot.name} has no such gain set; it has {', '.join(gains)}"
        )
    return gains[name]


@dataclass(frozen=True, eq=False)
class Masses:
    """Mass and centre of every body; centres in the frames of the description files."""

    names: tuple[str, ...]
    mass: Array  # (B,) [kg]
    centre: Array  # (B, 3) [m]

    def on(self, cell: Cell) -> Cell:
        """The cell with these masses; inertias about the centres grow with their mass."""
        links = [
            Link(mass, centre, link.inertia * (mass / link.mass if link.mass else 1.0))
            for link, mass, centre in zip(
                _bodies(cell), self.mass.tolist(), self.centre, strict=True
            )
        ]
        joints, robot = cell.robot.joints, cell.robot
        base = robot.required("links")[0]
        return replace(
            cell,
            robot=replace(robot, links=(base, *links[:joints])),
            plate=replace(cell.plate, body=links[joints]),
            ballbar=replace(cell.ballbar, links=tuple(links[joints + 1 :])),
        )

    def with_payload(self, payload: Payload, rng: np.random.Generator) -> Masses:
        """These bodies with a drawn payload on the plate."""
        i, z = self.names.index("plate"), rng.standard_normal(4)
        more = abs(payload.sigma_kg * z[0])
        mass, centre = self.mass.copy(), self.centre.copy()
        mass[i] += more
        centre[i] += payload.centre_sigma_m * z[1:] * more / mass[i]
        return replace(self, mass=mass, centre=centre)


def stated_masses(cell: Cell) -> Masses:
    """The masses and centres of the files."""
    bodies = _bodies(cell)
    return Masses(
        names=(
            *(f"link{i + 1}" for i in range(cell.robot.joints)),
            "plate",
            *(f"bar{i + 1}" for i in range(len(cell.ballbar.links))),
        ),
        mass=np.array([body.mass for body in bodies]),
        centre=np.stack([body.com for body in bodies]),
    )


def drawn_masses(errors: BodyMasses, cell: Cell, rng: np.random.Generator) -> Masses:
    """The masses and centres of the files with drawn deviations."""
    stated = stated_masses(cell)
    z = rng.standard_normal((len(stated.names), 4))
    return replace(
        stated,
        mass=stated.mass * np.exp(errors.spread * z[:, 0]),
        centre=stated.centre + errors.centre_sigma_m * z[:, 1:],
    )


def _bodies(cell: Cell) -> list[Link]:
    return [*cell.robot.required("links")[1:], cell.plate.body, *cell.ballbar.links]
