"""The truth of a simulated recording: true parameters and drawn errors, in a file of their own.

Tests, claims and the report open it; acquisition and identification do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from cell.files import write_yaml
from cell.geometry import Geometry, table_of_names
from cell.schema import Strict
from cell.strict_yaml import check_schema, load_yaml, parse_model
from sim.errors.plant_errors import ThermalGrowth
from sim.logging.log_truth import LogTruth
from sim.plant.effects import RIGID_ROD, PlantEffects, Ripple
from sim.plant.masses import Masses

SCHEMA = "ballbar-truth/2"


class RippleTruth(Strict):
    """Harmonic error of a gear at output angle g: amplitude * sin(cycles * g + phase)."""

    axis: int
    cycles_per_turn: float
    amplitude_rad: float
    phase_rad: float


class BodyTruth(Strict):
    """Mass and centre of mass of a body, in the frame of its description file."""

    mass_kg: float
    com_m: tuple[float, float, float]


class PlantTruth(Strict):
    """Compliance, backlash, ripple, friction and masses of the plant; null, 0 or empty where an
    effect was off.
    """

    gear_stiffness_N_m_per_rad: tuple[float, ...] | None
    gear_backlash_half_width_rad: tuple[float, ...]
    gear_hysteresis_half_width_rad: tuple[float, ...]
    transmission_error: tuple[RippleTruth, ...]
    gear_friction_scale: float
    rod_stiffness_N_per_m: float | None
    rod_backlash_half_width_m: float
    bar_friction_N_m: float
    plate_stiffness_N_per_m: float | None
    base_stiffness_N_per_m: float | None
    bodies: dict[str, BodyTruth] = Field(default_factory=dict)
    thermal_growth: ThermalGrowth | None = None  # its parameters are those at the start

    @property
    def masses(self) -> Masses | None:
        """Masses and centres of all bodies; None where they are those of the files."""
        if not self.bodies:
            return None
        return Masses(
            names=tuple(self.bodies),
            mass=np.array([body.mass_kg for body in self.bodies.values()]),
            centre=np.array([body.com_m for body in self.bodies.values()]),
        )


def plant_truth(effects: PlantEffects) -> PlantTruth:
    """The effects of one machine as the truth file states them."""
    stiffness = effects.gear_stiffness
    return PlantTruth(
        gear_stiffness_N_m_per_rad=None if stiffness is None else tuple(stiffness.tolist()),
        gear_backlash_half_width_rad=tuple(effects.gear_backlash.tolist()),
        gear_hysteresis_half_width_rad=tuple(effects.gear_hysteresis.tolist()),
        transmission_error=tuple(_ripple_truth(ripple) for ripple in effects.ripples),
        gear_friction_scale=effects.friction_scale,
        rod_stiffness_N_per_m=None if effects.rod_stiffness == RIGID_ROD else effects.rod_stiffness,
        rod_backlash_half_width_m=effects.rod_backlash,
        bar_friction_N_m=effects.bar_friction,
        plate_stiffness_N_per_m=effects.plate_stiffness,
        base_stiffness_N_per_m=effects.base_stiffness,
        bodies=_bodies(effects.masses),
        thermal_growth=effects.growth,
    )


def _bodies(masses: Masses | None) -> dict[str, BodyTruth]:
    if masses is None:
        return {}
    rows = zip(masses.names, masses.mass.tolist(), masses.centre.tolist(), strict=True)
    return {name: BodyTruth(mass_kg=mass, com_m=tuple(com)) for name, mass, com in rows}


def _ripple_truth(ripple: Ripple) -> RippleTruth:
    return RippleTruth(
        axis=ripple.gear + 1,
        cycles_per_turn=ripple.order,
        amplitude_rad=ripple.amplitude,
        phase_rad=ripple.phase,
    )


@dataclass(frozen=True, eq=False)
class Truth:
    """True parameters of one recording.

    The encoder offsets stand in btheta of `geometry`: `b = direction * angle + btheta`, where
    `angle` is the logged one with the declared direction applied.
    """

    geometry: Geometry
    directions: dict[str, int]  # -1 where the direction that recording.yaml declares is wrong
    offset: float  # [s]
    skew: float  # [1]
    seed: int
    closure_position: float  # [m] largest loop-closure error of the plant
    closure_angle: float  # [rad]
    rod_force_min: float  # [N]
    rod_force_max: float  # [N]
    plant: PlantTruth
    logs: LogTruth

    def write(self, path: Path) -> None:
        """Write the truth file, whole or not at all."""
        content: dict[str, object] = {
            "schema": SCHEMA,
            "seed": self.seed,
            "parameters": dict(
                zip(self.geometry.table.names, self.geometry.values.tolist(), strict=True)
            ),
            "directions": dict(self.directions),
            "clock": {"offset_s": self.offset, "skew": self.skew},
            "closure": {"position_m": self.closure_position, "angle_rad": self.closure_angle},
            "rod_force": {"min_N": self.rod_force_min, "max_N": self.rod_force_max},
            "plant": self.plant.model_dump(mode="json"),
            "logs": self.logs.stated(),
        }
        write_yaml(path, content)


class _Clock(Strict):
    offset_s: float
    skew: float


class _Closure(Strict):
    position_m: float
    angle_rad: float


class _Force(Strict):
    min_N: float
    max_N: float


class TruthFile(Strict):
    """Schema of the truth file."""

    schema_: Annotated[Literal["ballbar-truth/2"], Field(alias="schema")]
    seed: int
    parameters: dict[str, float]
    directions: dict[str, int]
    clock: _Clock
    closure: _Closure
    rod_force: _Force
    plant: PlantTruth
    logs: LogTruth


def load_truth(path: Path) -> Truth:
    """The truth of a simulated recording.

    Raises DescriptionError if the file cannot be read, is wrong, or has another schema.
    """
    document = load_yaml(path)
    check_schema(document, SCHEMA, "Simulate the recording again.")
    file = parse_model(document, TruthFile)
    table = table_of_names(file.parameters)
    return Truth(
        geometry=Geometry(np.array([file.parameters[name] for name in table.names]), table),
        directions=file.directions,
        offset=file.clock.offset_s,
        skew=file.clock.skew,
        seed=file.seed,
        closure_position=file.closure.position_m,
        closure_angle=file.closure.angle_rad,
        rod_force_min=file.rod_force.min_N,
        rod_force_max=file.rod_force.max_N,
        plant=file.plant,
        logs=file.logs,
    )
