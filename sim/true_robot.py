"""The true machine of a simulation: what a scenario draws, seed by seed.

A robot that moves is a geometry with plant effects and resolvers (`true_machine`). One that stands
still is an arm that puts a target somewhere at the angles that it shows (`true_arm`):

    shown angles -> gears with their harmonic errors -> yielding under their own weight -> DH rows

Nothing of it is shared with the identification but ballbar.cell.chain.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.bodies import link_bodies
from ballbar.cell.chain import KINDS, Chain, Frames, forward
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.dynamics import joint_torques
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, nominal_geometry
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.load import (
    load_cell,
    load_instrument,
    load_plate,
    load_robot,
    load_telescoping_bar,
)
from ballbar.cell.temperature import Temperature
from ballbar.cell.typical_machine import Spread, motor_turns, with_typical
from ballbar.sim.errors.sensor_effects import ResolverEffects, resolver_effects
from ballbar.sim.errors.static_errors import grown, true_geometry
from ballbar.sim.plant.effects import (
    BACKLASH_IS_HELD,
    PlantEffects,
    Ripple,
    plant_effects,
    plugin_ripples,
)
from ballbar.sim.settings import CellSettings, ErrorSettings, SimulationSettings
from ballbar.sim.streams import stream

# In whose coordinates the path of a tool is stated that nothing holds; it has no mass and no force.
FREE = "drawwire_2m"
_ROUNDS = 4  # of sag; each gains three digits
_PARALLEL = 1e-6  # sine of the twist below which two axes are nominally parallel


@dataclass(frozen=True, eq=False)
class TrueMachine:
    """A cell with the errors of a scenario, which every recording of its seed is of."""

    cell: Cell  # nominal
    instrument: Instrument | None  # in place of a ball-bar
    nominal: Geometry
    true: Geometry
    effects: PlantEffects
    resolvers: ResolverEffects | None
    dynamic: bool  # whether MuJoCo moves it
    typical: Spread = field(default_factory=lambda: Spread(()))  # what of it no file states


def scenario_cell(chosen: CellSettings, *, relative_to: Path | None = None) -> Cell:
    """The descriptions that a scenario names; an instrument as a massless ball-bar, and one that
    follows the target as a wire that does not pull.

    relative_to : folder of the scenario. Raises DescriptionError.
    """
    if chosen.ballbar is not None:
        return load_cell(chosen.robot, chosen.ballbar, chosen.plate, relative_to=relative_to)
    instrument = load_instrument(chosen.measured_by, relative_to=relative_to)
    bar = FREE if instrument.follows else chosen.measured_by
    return Cell(
        load_robot(chosen.robot, relative_to=relative_to),
        load_telescoping_bar(bar, relative_to=relative_to),
        load_plate(chosen.plate, relative_to=relative_to),
    )


def true_machine(settings: SimulationSettings, *, relative_to: Path) -> TrueMachine:
    """The machine of a scenario, drawn. relative_to : folder of the scenario.

    Raises InputError for effects that cannot be together, DescriptionError for a bad file.
    """
    chosen, errors, seed = settings.cell, settings.errors, settings.seed
    cell, typical = scenario_cell(chosen, relative_to=relative_to), Spread(())
    turns, instrument, dynamic = None, None, settings.plant.kind != "kinematic"
    if dynamic:
        robot, typical = with_typical(cell.robot)
        turns = motor_turns(robot) if typical.keys else None
        if typical.keys:
            rng = stream(seed, "typical_machine")
            robot = typical.drawn(robot, rng, settings.plant.typical_spread)
        cell = replace(cell, robot=robot)
    if chosen.instrument is not None:
        instrument = load_instrument(chosen.instrument, relative_to=relative_to)
    nominal = nominal_geometry(cell, chosen.position)
    true = true_geometry(
        nominal,
        errors,
        cell,
        zero_sigma=settings.length.zero_scale * instrument.sigma_zero if instrument else None,
        turns=turns,
        seed=seed,
    )
    return TrueMachine(
        cell=cell,
        instrument=instrument,
        nominal=nominal,
        true=grown(true, cell, chosen),
        effects=plant_effects(errors, cell, seed),
        resolvers=resolver_effects(
            errors.resolver_error, joints=cell.robot.joints, seed=seed, turns=turns
        ),
        dynamic=dynamic,
        typical=typical,
    )


@dataclass(frozen=True, eq=False)
class TrueArm:
    """A robot with its errors."""

    robot: Robot  # nominal
    chain: Chain  # true DH rows
    effects: PlantEffects  # harmonics and stiffness of the gears
    weights: Array  # (J, J) [rad/m] yield of joint j under a unit weight at frame k + 1
    in_order: bool = True  # whether poses come one after the other; else play that none presses
    # counts in the middle

    def rotors(self, q: Array) -> Array:
        """(N, J) [rad] outputs of the gears without load, at shown angles q (N, J) [rad]."""
        return self.effects.gear_outputs(q @ self.robot.joint_to_gear)

    def joints(self, q: Array) -> Array:
        """(N, J) [rad] actual joint angles under the arm's own weight, at shown angles q (N, J).

        Of a gear with backlash the weight tells on which flank it lies, and where friction holds
        it from where the joint came; poses are in the order of time.
        """
        rotors, robot, stiffness = self.rotors(q), self.robot, self.effects.gear_stiffness
        actual = rotors @ robot.gear_to_joint
        play = self.effects.gear_backlash
        if stiffness is None and not self.weights.any():
            return np.asarray(actual)
        came = np.sign(np.diff(rotors, axis=0, prepend=rotors[:1])) * self.in_order
        for _ in range(_ROUNDS):
            frames = forward(self.chain, actual)
            yielded = np.zeros_like(rotors)
            if stiffness is not None:
                bodies = [[link] for link in link_bodies(robot)]
                load = joint_torques(frames, bodies, actual, gravity=robot.gravity)
                load = load.T @ robot.gear_to_joint.T
                yielded -= load / stiffness
                if play.any():
                    held = np.abs(load) < robot.required("gears").coulomb
                    yielded -= play * np.where(held, came, np.sign(load))
            yielded += self._yield_to_unit_weights(frames)
            actual = (rotors + yielded) @ robot.gear_to_joint
        return np.asarray(actual)

    def flange(self, q: Array) -> Frames:
        """Frames of the robot at shown angles q (N, J) [rad]; the last is the flange's."""
        return forward(self.chain, self.joints(q))

    def target(self, q: Array, point: Array) -> Array:
        """(N, 3) [m] place of a point (3,) [m] on the flange, base frame, at shown angles q."""
        frames = self.flange(q)
        return np.asarray(frames.tip.T + np.einsum("ijn,j->ni", frames.rotation(), point))

    def _yield_to_unit_weights(self, frames: Frames) -> Array:
        """(N, J) [rad] what the joints yield under the unit weights."""
        down = self.robot.gravity / np.linalg.norm(self.robot.gravity)
        yielded = np.zeros((frames.tip.shape[1], self.robot.joints))
        for j, k in zip(*np.nonzero(self.weights), strict=True):
            lever = frames.origin[k + 1] - frames.origin[j]
            torque = (frames.z[j] * np.cross(lever, down, axis=0)).sum(axis=0)
            yielded[:, j] += self.weights[j, k] * torque
        return yielded


def true_arm(
    robot: Robot, errors: ErrorSettings, seed: int, *, warmth: Temperature | None = None
) -> TrueArm:
    """The robot of a scenario of still poses, drawn, as long as it is at a temperature.

    Raises InputError for harmonics of an axis that the robot does not have, and for elastic gears
    where the robot's file has no masses or no gears.
    """
    weights = np.zeros((robot.joints, robot.joints))
    if errors.unit_weights is not None:
        drawn = np.abs(stream(seed, "unit_weights").standard_normal(weights.shape))
        weights = np.triu(drawn) * errors.unit_weights.sigma_rad_per_m
    stiffness, play = _gears(robot, errors, seed)
    effects = PlantEffects(
        gear_stiffness=stiffness, gear_backlash=play, ripples=_harmonics(robot, errors, seed)
    )
    rows = _rows(robot, errors, seed)
    if warmth is not None and robot.expansion is not None:
        growth, _ = warmth.growth(robot.expansion)
        rows |= {kind: (1.0 + growth) * rows[kind] for kind in ("a", "d")}
    return TrueArm(robot, Chain(**rows), effects, weights)


def _gears(robot: Robot, errors: ErrorSettings, seed: int) -> tuple[Array | None, Array]:
    """Stiffness (J,) [N m/rad], None of rigid gears, and half of the play (J,) [rad] of gears."""
    play = np.zeros(robot.joints)
    if (compliance := errors.joint_compliance) is None:
        if errors.gear_backlash is not None:
            raise InputError(BACKLASH_IS_HELD)
        return None, play
    robot.required("links")
    gears = robot.required("gears")
    spread = stream(seed, "pose_joint_compliance").standard_normal(robot.joints)
    stiffness = gears.stiffness * compliance.scale * np.exp(compliance.spread * spread)
    if (gap := errors.gear_backlash) is not None:
        spread = stream(seed, "pose_backlash").standard_normal(robot.joints)
        play = 0.5 * gears.lost_motion * gap.scale * np.exp(gap.spread * spread)
    return stiffness, play


def _rows(robot: Robot, errors: ErrorSettings, seed: int) -> dict[str, Array]:
    """DH rows with their drawn errors."""
    rows = {kind: np.zeros(robot.joints) for kind in KINDS}
    for kind in ("a", "d", "alpha", "theta"):
        rows[kind] += getattr(robot, kind)
    if (sizes := errors.geometry) is not None:
        deviations = stream(seed, "geometry").standard_normal((len(KINDS), robot.joints))
        parallel = np.abs(np.sin(robot.alpha)) < _PARALLEL
        parallel[-1] = False  # no axis follows the last row
        for kind, z in zip(KINDS, deviations, strict=True):
            sigma = sizes.sigma_m if kind in ("a", "d") else sizes.sigma_rad
            rows[kind] += sigma * z * (parallel if kind == "beta" else True)
    if (zeros := errors.joint_zeros) is not None:
        rows["theta"] += zeros.sigma_rad * stream(seed, "joint_zeros").standard_normal(robot.joints)
    return rows


def _harmonics(robot: Robot, errors: ErrorSettings, seed: int) -> tuple[Ripple, ...]:
    """The stated and the drawn harmonic errors of the gears."""
    stated = errors.joint_harmonics
    if beyond := [harmonic.axis for harmonic in stated if harmonic.axis > robot.joints]:
        raise InputError(
            f"errors.joint_harmonics: axis {beyond[0]}, but {robot.name} has {robot.joints} axes."
        )
    phases = stream(seed, "joint_harmonics").uniform(0.0, 2.0 * np.pi, len(stated))
    ripples = [
        Ripple(h.axis - 1, h.order, h.amplitude_rad, float(phase))
        for h, phase in zip(stated, phases, strict=True)
    ]
    if (drawn := errors.drawn_harmonics) is not None:
        rng = stream(seed, "drawn_harmonics")
        gears = rng.integers(0, robot.joints, drawn.count)
        orders = rng.integers(1, drawn.order_max + 1, drawn.count)
        phases = rng.uniform(0.0, 2.0 * np.pi, drawn.count)
        ripples += [
            Ripple(int(gear), float(order), drawn.amplitude_rad, float(phase))
            for gear, order, phase in zip(gears, orders, phases, strict=True)
        ]
    return (*ripples, *plugin_ripples(errors, robot.joints, seed))
