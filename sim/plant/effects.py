"""Elasticity, backlash, ripple, friction and masses of one simulated machine, drawn by a scenario.

Gear effects act at the gear, between motor i and its output g_i; `joints = g @ gear_to_joint` maps
them through parallel rod and wrist into the joints. What differs from unit to unit (phases, spread)
is drawn from the stream of its source.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Link, Robot, ServoGains
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry
from ballbar.cell.schema import Strict
from ballbar.sim.errors.base import sources_of
from ballbar.sim.errors.plant_errors import PlantErrors, ThermalGrowth
from ballbar.sim.streams import stream

RIGID_ROD = (
    1e10  # [N/m] without rod_strain: 0.01 um at 100 N, so that the rod still shows its force
)
# Harmonics of the cusped wave; the others amount to 11 % of the peak at the cusp, 4 % at 25 deg,
# 2 % at 60 deg and 1.5 % further away.
CUSP_TERMS = 4
BACKLASH_IS_HELD = (
    "errors.gear_backlash: needs joint_compliance beside it, since a rigid gear with backlash has "
    "no equilibrium. Add joint_compliance: {}, or leave gear_backlash out."
)
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
class MassDistribution:
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
    masses: MassDistribution | None = None  # None: those of the files
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


def plant_effects(errors: PlantErrors, cell: Cell, seed: int) -> PlantEffects:
    """The machine that a scenario describes; what differs from unit to unit is drawn.

    Raises InputError for backlash in rigid gears.
    """
    if errors.gear_backlash is not None and errors.joint_compliance is None:
        raise InputError(BACKLASH_IS_HELD)
    robot, bar = cell.robot, cell.ballbar
    stiffness, dead_band, hysteresis = None, np.zeros(robot.joints), np.zeros(robot.joints)
    if (compliance := errors.joint_compliance) is not None:
        z = stream(seed, "joint_compliance").standard_normal(robot.joints)
        catalogue = robot.required("gears").stiffness * compliance.scale
        stiffness = catalogue * np.exp(compliance.spread * z)
    if (gap := errors.gear_backlash) is not None:
        z = stream(seed, "lost_motion").standard_normal(robot.joints)  # as in the catalogue
        width = robot.required("gears").lost_motion * gap.scale * np.exp(gap.spread * z)
        if gap.kind == "dead_band":
            dead_band = 0.5 * width
        else:
            hysteresis = 0.5 * width
    friction, gears, base = errors.bar_friction, errors.gear_friction, errors.base_compliance
    play, plate = 0.0, None
    if (rod := errors.rod_backlash) is not None:
        gimbal, universal_joint = bar.joint_backlash
        play = _default(rod.gimbal_m, gimbal) + _default(rod.universal_joint_m, universal_joint)
    if (bending := errors.plate_bending) is not None:
        plate = _default(bending.tip_stiffness_N_per_m, cell.plate.tip_stiffness)
    strain = errors.rod_strain
    return PlantEffects(
        gear_stiffness=stiffness,
        gear_backlash=dead_band,
        gear_hysteresis=hysteresis,
        ripples=_ripples(errors, cell, seed),
        friction_scale=gears.scale if gears else 0.0,
        stribeck=gears is not None and gears.stribeck,
        rod_stiffness=bar.axial_stiffness * strain.scale if strain else RIGID_ROD,
        rod_backlash=0.5 * play,
        bar_friction=_default(friction.torque_N_m, bar.friction_torque) if friction else 0.0,
        plate_stiffness=plate,
        base_stiffness=base.stiffness_N_per_m if base else None,
        masses=_masses(errors, cell, seed),
        growth=errors.thermal_growth,
    )


def _default(stated: float | None, usual: float) -> float:
    return usual if stated is None else stated


def _masses(errors: PlantErrors, cell: Cell, seed: int) -> MassDistribution | None:
    """The masses and centres of the files with drawn deviations, and a drawn payload."""
    if errors.masses is None and errors.payload is None:
        return None
    masses = stated_masses(cell)
    if (sizes := errors.masses) is not None:
        z = stream(seed, "masses").standard_normal((len(masses.names), 4))
        masses = replace(
            masses,
            mass=masses.mass * np.exp(sizes.spread * z[:, 0]),
            centre=masses.centre + sizes.centre_sigma_m * z[:, 1:],
        )
    if (payload := errors.payload) is not None:
        z = stream(seed, "payload").standard_normal(4)
        i, more = masses.names.index("plate"), abs(payload.sigma_kg * z[0])
        mass, centre = masses.mass.copy(), masses.centre.copy()
        mass[i] += more
        centre[i] += payload.centre_sigma_m * z[1:] * more / mass[i]
        masses = replace(masses, mass=mass, centre=centre)
    return masses


def stated_masses(cell: Cell) -> MassDistribution:
    """The masses and centres of the files."""
    bodies = _bodies(cell)
    return MassDistribution(
        names=(
            *(f"link{i + 1}" for i in range(cell.robot.joints)),
            "plate",
            *(f"bar{i + 1}" for i in range(len(cell.ballbar.links))),
        ),
        mass=np.array([body.mass for body in bodies]),
        centre=np.stack([body.com for body in bodies]),
    )


def _ripples(errors: PlantErrors, cell: Cell, seed: int) -> tuple[Ripple, ...]:
    """Harmonics of all sources; each one costs 0.1 us per simulation step, so equal ones are one.

    A cusped wave is |sin(x/2)| with zero mean and unit peak, x = lobes * g + phase, which is
    -2 sum_k cos(k x) / (4 k^2 - 1).
    """
    ripples: list[Ripple] = []
    joints, gears = cell.robot.joints, cell.robot.gears
    if (table := errors.transmission_error) is not None:
        rng = stream(seed, "transmission_error")
        for gear, harmonics in enumerate(cell.robot.required("gears").harmonics):
            ripples += [
                Ripple(gear, order, table.scale * size, float(rng.uniform(0.0, 2.0 * np.pi)))
                for order, size in harmonics
            ]
    if (cycloid := errors.cycloid_ripple) is not None:
        size, lobes = cycloid.amplitude_rad, float(cycloid.lobes)
        drawn = stream(seed, "cycloid_ripple").uniform(0.0, 2.0 * np.pi, joints)
        for axis in cycloid.axes:
            phase = float(drawn[axis - 1])
            if cycloid.waveform == "harmonic":
                ripples.append(Ripple(axis - 1, lobes, size, phase))
                continue
            for k in range(1, CUSP_TERMS + 1):
                share = -2.0 * size / (4 * k * k - 1)
                ripples.append(Ripple(axis - 1, k * lobes, share, k * phase + 0.5 * np.pi))
    if (sine := errors.sinusoidal_gear_error) is not None:
        drawn = stream(seed, "sinusoidal_gear_error").uniform(0.0, 2.0 * np.pi, joints)
        for axis in sine.axes:
            turns = abs(float(cell.robot.transmission[axis - 1, axis - 1]))
            order = 1.0 if sine.side == "output" else 1.0 / turns
            ripples.append(Ripple(axis - 1, order, sine.amplitude_rad, float(drawn[axis - 1])))
    if (unlisted := errors.unlisted_ripple) is not None:
        rng = stream(seed, "unlisted_ripple")
        for gear, harmonics in enumerate(gears.harmonics if gears else ((),) * joints):
            orders = sorted(set(UNLISTED_ORDERS) - {order for order, _ in harmonics})
            order, phase = float(rng.choice(orders)), float(rng.uniform(0.0, 2.0 * np.pi))
            ripples.append(Ripple(gear, order, unlisted.amplitude_rad, phase))
    ripples += plugin_ripples(errors, joints, seed)
    sums: dict[tuple[int, float], complex] = {}
    for r in ripples:
        sums[r.gear, r.order] = sums.get((r.gear, r.order), 0j) + r.amplitude * np.exp(1j * r.phase)
    return tuple(
        Ripple(gear, order, abs(z), float(np.angle(z))) for (gear, order), z in sums.items()
    )


def plugin_ripples(errors: Strict, joints: int, seed: int) -> list[Ripple]:
    """Harmonics that the error sources of plug-ins add; joints : of the robot."""
    sources = sources_of(errors)
    return [Ripple(*r) for n, s in sources for r in s.ripples(joints, stream(seed, n))]


def _bodies(cell: Cell) -> list[Link]:
    return [*cell.robot.required("links")[1:], cell.plate.body, *cell.ballbar.links]
