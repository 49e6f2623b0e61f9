"""The truth of a simulated table of still poses, in a file of its own beside the folder.

Tests and the comparison open it; acquisition and identification do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from cell.chain import KINDS, Chain
from cell.descriptions import Robot
from cell.files import write_yaml
from cell.schema import Strict
from cell.strict_yaml import check_schema, load_yaml, parse_model
from sim.plant.effects import Ripple
from sim.poses.measurement import SeatMotion
from sim.poses.true_arm import Place, TrueArm
from sim.truth import RippleTruth

SCHEMA = "ballbar-poses-truth/1"
Vector = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class PoseTruth:
    """What a table of still poses was simulated from."""

    arm: TrueArm
    seats: dict[str, Place]
    targets: dict[str, Place]
    drift: SeatMotion
    outliers: tuple[int, ...]  # lines of the table, its header being line 1
    unsettled: tuple[int, ...]  # likewise
    plant: Literal["mujoco", "kinematic"]
    force: tuple[float, float] | None  # [N] least and largest along rod or wire
    seed: int

    def write(self, path: Path) -> None:
        """Write the truth file, whole or not at all."""
        arm = self.arm
        content: dict[str, object] = {
            "schema": SCHEMA,
            "seed": self.seed,
            "robot": arm.robot.name,
            "dh": {kind: getattr(arm.chain, kind).tolist() for kind in KINDS},
            "joint_harmonics": [
                {
                    "axis": r.gear + 1,
                    "cycles_per_turn": r.order,
                    "amplitude_rad": r.amplitude,
                    "phase_rad": r.phase,
                }
                for r in arm.ripples
            ],
            "unit_weights_rad_per_m": arm.weights.tolist(),
            "gear_stiffness_N_m_per_rad": None
            if arm.gear_stiffness is None
            else arm.gear_stiffness.tolist(),
            "seats": {name: _place(place) for name, place in self.seats.items()},
            "targets": {name: _place(place) for name, place in self.targets.items()},
            "drift": {"shift_m": self.drift.shift.tolist(), "turn_rad": self.drift.turn.tolist()},
            "outliers": list(self.outliers),
            "unsettled": list(self.unsettled),
            "plant": self.plant,
            "force_N": None if self.force is None else list(self.force),
        }
        write_yaml(path, content)


def _place(place: Place) -> dict[str, list[float]]:
    return {"position_m": place.position.tolist(), "rotvec_rad": place.rotvec.tolist()}


class _PlaceFile(Strict):
    position_m: Vector
    rotvec_rad: Vector


class _DriftFile(Strict):
    shift_m: Vector
    turn_rad: Vector


class _DHFile(Strict):
    a: Vector
    d: Vector
    alpha: Vector
    theta: Vector
    beta: Vector


class PoseTruthFile(Strict):
    """Schema of the truth file."""

    schema_: Annotated[Literal["ballbar-poses-truth/1"], Field(alias="schema")]
    seed: int
    robot: str
    dh: _DHFile  # [m, rad]
    joint_harmonics: tuple[RippleTruth, ...]
    unit_weights_rad_per_m: tuple[Vector, ...]
    gear_stiffness_N_m_per_rad: Vector | None
    seats: dict[str, _PlaceFile]
    targets: dict[str, _PlaceFile]
    drift: _DriftFile
    outliers: tuple[int, ...]
    unsettled: tuple[int, ...]
    plant: Literal["mujoco", "kinematic"]
    force_N: tuple[float, float] | None


def load_pose_truth(path: Path, robot: Robot) -> PoseTruth:
    """The truth of a simulated table of poses; robot : nominal.

    Raises DescriptionError if the file cannot be read, is wrong, or has another schema.
    """
    document = load_yaml(path)
    check_schema(document, SCHEMA, "Simulate the poses again.")
    file = parse_model(document, PoseTruthFile)
    stiffness = file.gear_stiffness_N_m_per_rad
    ripples = tuple(
        Ripple(r.axis - 1, r.cycles_per_turn, r.amplitude_rad, r.phase_rad)
        for r in file.joint_harmonics
    )
    return PoseTruth(
        arm=TrueArm(
            robot=robot,
            chain=Chain(*(np.array(getattr(file.dh, kind)) for kind in KINDS)),
            ripples=ripples,
            weights=np.array(file.unit_weights_rad_per_m),
            gear_stiffness=None if stiffness is None else np.array(stiffness),
        ),
        seats={name: _read(place) for name, place in file.seats.items()},
        targets={name: _read(place) for name, place in file.targets.items()},
        drift=SeatMotion(np.array(file.drift.shift_m), np.array(file.drift.turn_rad)),
        outliers=file.outliers,
        unsettled=file.unsettled,
        plant=file.plant,
        force=file.force_N,
        seed=file.seed,
    )


def _read(place: _PlaceFile) -> Place:
    return Place(np.array(place.position_m), np.array(place.rotvec_rad))
