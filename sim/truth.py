"""The truth of what was simulated, in a file of its own beside the recording or the table.

Tests, claims and the report open it; acquisition and identification do not.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from ballbar.cell.arrays import Array
from ballbar.cell.chain import KINDS, Chain
from ballbar.cell.descriptions import Robot
from ballbar.cell.files import write_yaml
from ballbar.cell.geometry import Geometry, table_of_names
from ballbar.cell.rotation import matrix_from_rotvec
from ballbar.cell.schema import Strict
from ballbar.cell.strict_yaml import check_schema, load_yaml, parse_model
from ballbar.sim.errors.plant_errors import ThermalGrowth
from ballbar.sim.errors.sensor_effects import EncoderEffects, ResolverEffects
from ballbar.sim.errors.sensor_errors import ClockStep, LoggerRestart
from ballbar.sim.logging.clocks import RowCounts, WanderCurve
from ballbar.sim.logging.load_logs import DrawnLoads, TrackerTruth
from ballbar.sim.plant.effects import (
    RIGID_ROD,
    MassDistribution,
    PlantEffects,
    Ripple,
    stated_masses,
)
from ballbar.sim.true_robot import TrueArm, TrueMachine

Vector = tuple[float, ...]


class RippleTruth(Strict):
    """Harmonic error of a gear at output angle g: amplitude * sin(cycles * g + phase)."""

    axis: int
    cycles_per_turn: int | float
    amplitude_rad: float
    phase_rad: float

    @classmethod
    def of(cls, ripple: Ripple) -> Self:
        """The harmonic as the truth file states it."""
        return cls(
            axis=ripple.gear + 1,
            cycles_per_turn=ripple.order,
            amplitude_rad=ripple.amplitude,
            phase_rad=ripple.phase,
        )


class BodyTruth(Strict):
    """Mass and centre of mass of a body, in the frame of its description file."""

    mass_kg: float
    com_m: tuple[float, float, float]


class PlantTruth(Strict):
    """Compliance, backlash, ripple, friction and masses of the plant; null, 0 or empty where an
    effect was off.
    """

    gear_stiffness_N_m_per_rad: Vector | None
    gear_backlash_half_width_rad: Vector
    gear_hysteresis_half_width_rad: Vector
    transmission_error: tuple[RippleTruth, ...]
    gear_friction_scale: float
    rod_stiffness_N_per_m: float | None
    rod_backlash_half_width_m: float
    bar_friction_N_m: float
    plate_stiffness_N_per_m: float | None
    base_stiffness_N_per_m: float | None
    bodies: dict[str, BodyTruth] = Field(default_factory=dict)
    thermal_growth: ThermalGrowth | None = None  # its parameters are those at the start
    # keys of the robot's file that it lacks; what is typical of its size stood for them
    typical: tuple[str, ...] = ()

    @property
    def masses(self) -> MassDistribution | None:
        """Masses and centres of all bodies; None where they are those of the files."""
        if not self.bodies:
            return None
        return MassDistribution(
            names=tuple(self.bodies),
            mass=np.array([body.mass_kg for body in self.bodies.values()]),
            centre=np.array([body.com_m for body in self.bodies.values()]),
        )


def plant_truth(machine: TrueMachine) -> PlantTruth:
    """The effects of one machine as the truth file states them."""
    effects = machine.effects
    stiffness, masses = effects.gear_stiffness, effects.masses
    if masses is None and machine.typical.keys:
        masses = stated_masses(machine.cell)
    bodies = {}
    if masses is not None:
        rows = zip(masses.names, masses.mass.tolist(), masses.centre.tolist(), strict=True)
        bodies = {name: BodyTruth(mass_kg=mass, com_m=tuple(com)) for name, mass, com in rows}
    return PlantTruth(
        gear_stiffness_N_m_per_rad=None if stiffness is None else tuple(stiffness.tolist()),
        gear_backlash_half_width_rad=tuple(effects.gear_backlash.tolist()),
        gear_hysteresis_half_width_rad=tuple(effects.gear_hysteresis.tolist()),
        transmission_error=tuple(RippleTruth.of(ripple) for ripple in effects.ripples),
        gear_friction_scale=effects.friction_scale,
        rod_stiffness_N_per_m=None if effects.rod_stiffness == RIGID_ROD else effects.rod_stiffness,
        rod_backlash_half_width_m=effects.rod_backlash,
        bar_friction_N_m=effects.bar_friction,
        plate_stiffness_N_per_m=effects.plate_stiffness,
        base_stiffness_N_per_m=effects.base_stiffness,
        bodies=bodies,
        thermal_growth=effects.growth,
        typical=machine.typical.keys,
    )


class FirstRows(Strict):
    """Times of the first rows of both logs, from the start of the path."""

    robot_s: float
    ballbar_s: float


class LogTruth(Strict):
    """Errors of sensors, clocks and loggers.

    Angles are positive along the DH angle of the joint; times count from the start of the path.
    """

    first_rows: FirstRows
    encoders: dict[str, EncoderEffects] = Field(default_factory=dict)  # of b1.., if any
    resolvers: ResolverEffects | None = None
    # [s] time constant of each motor's filter; that of the first is in the clock offset
    joint_lag_s: Vector = ()
    clock_wander: WanderCurve | None = None  # of the ball-bar's clock
    robot_clock_wander: WanderCurve | None = None
    clock_step: ClockStep | None = None
    restart: LoggerRestart | None = None
    rows: dict[str, RowCounts] = Field(default_factory=dict)  # robot, ballbar
    loads: DrawnLoads = DrawnLoads()
    tracker: TrackerTruth | None = None

    def stated(self) -> dict[str, object]:
        """Plain data without absent entries."""
        filled = {
            key: _filled(value) for key, value in self.model_dump(mode="json").items() if value
        }
        return {key: value for key, value in filled.items() if value}


def _filled(value: Any) -> Any:
    """Plain data without empty entries, at any depth."""
    if isinstance(value, dict):
        return {key: _filled(inner) for key, inner in value.items() if inner not in (None, [], {})}
    return [_filled(inner) for inner in value] if isinstance(value, list) else value


class TrueClock(Strict):
    """The clock's map from the ball-bar's log to the robot's."""

    offset_s: float
    skew: float


class ClosureError(Strict):
    """Largest loop-closure error of the plant."""

    position_m: float
    angle_rad: float


class ForceRange(Strict):
    """Least and largest force in the rod."""

    min_N: float
    max_N: float


class Truth(Strict):
    """True parameters of one recording, as its truth file states them.

    The encoder offsets stand in btheta of `geometry`: `b = direction * angle + btheta`, where
    `angle` is the logged one with the declared direction applied. A direction is -1 where the one
    that recording.yaml declares is wrong.
    """

    schema_: Annotated[Literal["ballbar-truth/2"], Field(alias="schema")]
    seed: int
    parameters: dict[str, float]
    directions: dict[str, int]
    clock: TrueClock
    closure: ClosureError
    rod_force: ForceRange
    plant: PlantTruth
    logs: LogTruth

    @property
    def typical_words(self) -> str:
        """Says what of the robot was typical of its size, to follow a sentence; else empty."""
        lacking = ", ".join(self.plant.typical)
        return f"; typical of a robot of its size: {lacking}" if lacking else ""

    @cached_property
    def geometry(self) -> Geometry:
        """True parameters, with the encoders' offsets."""
        table = table_of_names(self.parameters)
        return Geometry(np.array([self.parameters[name] for name in table.names]), table)

    @property
    def plant_sizes(self) -> dict[str, float]:
        """Largest closure error [m] and force in the rod [N], by the keys of limits on them."""
        force = max(-self.rod_force.min_N, self.rod_force.max_N)
        return {"loop_closure_um": self.closure.position_m, "rod_force_N": force}

    def write(self, path: Path) -> None:
        """Write the truth file, whole or not at all."""
        content = self.model_dump(mode="json", by_alias=True)
        if not self.plant.typical:
            content["plant"].pop("typical")
        write_yaml(path, content | {"logs": self.logs.stated()})


class TruePlace(Strict):
    """A seat in the robot's base frame, or a target in the flange's."""

    position_m: Vector
    rotvec_rad: Vector = (0.0, 0.0, 0.0)

    @property
    def position(self) -> Array:
        """(3,) [m]"""
        return np.array(self.position_m)

    @property
    def rotation(self) -> Array:
        """(3, 3)"""
        return matrix_from_rotvec(np.array(self.rotvec_rad)[:, None])[:, :, 0]

    def still(self, count: int) -> tuple[Array, Array]:
        """Origin (3, N) and rotation (3, 3, N), N times."""
        return np.tile(self.position[:, None], count), np.tile(self.rotation[..., None], count)


class SeatMotion(Strict):
    """How the seats move against the robot's base from the first pose to the last.

    They turn about the base's origin.
    """

    shift_m: Vector
    turn_rad: Vector

    def at(self, seat: TruePlace, share: Array) -> tuple[Array, Array]:
        """Origin (3, N) and rotation (3, 3, N) of a seat at shares (N,) of the whole time."""
        turn = matrix_from_rotvec(np.array(self.turn_rad)[:, None] * share)
        shift = np.array(self.shift_m)[:, None] * share
        origin = np.einsum("ijn,j->in", turn, seat.position) + shift
        return origin, np.einsum("ijn,jk->ikn", turn, seat.rotation)


class DHRows(Strict):
    """DH parameters of all rows [m, rad]."""

    a: Vector
    d: Vector
    alpha: Vector
    theta: Vector
    beta: Vector


class PoseTruth(Strict):
    """The truth of a table of still poses, as its truth file states it.

    Outliers and unsettled poses are lines of the table, its header being line 1. The force is the
    least and the largest along rod or wire.
    """

    schema_: Annotated[Literal["ballbar-poses-truth/1"], Field(alias="schema")]
    seed: int
    robot: str
    dh: DHRows
    joint_harmonics: tuple[RippleTruth, ...]
    unit_weights_rad_per_m: tuple[Vector, ...]
    gear_stiffness_N_m_per_rad: Vector | None
    gear_backlash_half_width_rad: Vector | None = None
    seats: dict[str, TruePlace]
    targets: dict[str, TruePlace]
    drift: SeatMotion
    outliers: tuple[int, ...]
    unsettled: tuple[int, ...]
    plant: Literal["mujoco", "kinematic"]
    force_N: tuple[float, float] | None

    def arm(self, robot: Robot) -> TrueArm:
        """The true arm, at poses in any order. robot : nominal."""
        stiffness, play = self.gear_stiffness_N_m_per_rad, self.gear_backlash_half_width_rad
        ripples = tuple(
            Ripple(r.axis - 1, r.cycles_per_turn, r.amplitude_rad, r.phase_rad)
            for r in self.joint_harmonics
        )
        return TrueArm(
            robot=robot,
            chain=Chain(*(np.array(getattr(self.dh, kind)) for kind in KINDS)),
            effects=PlantEffects(
                gear_stiffness=None if stiffness is None else np.array(stiffness),
                gear_backlash=np.array(play or [0.0] * robot.joints),
                ripples=ripples,
            ),
            weights=np.array(self.unit_weights_rad_per_m),
            in_order=False,
        )

    @property
    def plant_sizes(self) -> dict[str, float]:
        """None: no loop is closed."""
        return {}

    def write(self, path: Path) -> None:
        """Write the truth file, whole or not at all."""
        write_yaml(path, self.model_dump(mode="json", by_alias=True))


def load_truth(path: Path) -> Truth | PoseTruth:
    """The truth of a simulated recording, or of a simulated table of still poses.

    Raises DescriptionError if the file cannot be read, is wrong, or has another schema.
    """
    document = load_yaml(path)
    for schema in ("ballbar-truth/2", "ballbar-poses-truth/1"):
        check_schema(document, schema, "Simulate it again.")
    if document.data.get("schema") == "ballbar-poses-truth/1":
        return parse_model(document, PoseTruth)
    return parse_model(document, Truth)
