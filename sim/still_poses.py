"""One simulated table of still poses before it is written: poses, plant, readings, and the truth.

poses chosen -> true arm (or MuJoCo with rod or wire) -> readings -> faults -> rows
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import KINDS
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.numerical_inverse import reach_points
from ballbar.cell.temperature import growth_at, temperature_of
from ballbar.sim.corners import pictured, view_of
from ballbar.sim.instrument_readings import (
    logged_axes,
    measured,
    outliers,
    seat_motion,
    seen_from,
    stand_of,
    unsettled,
)
from ballbar.sim.plant.held import hold_with_instrument
from ballbar.sim.pose_choice import Stand, choose_poses
from ballbar.sim.settings import PlacementSettings, PosesSettings, SimulationSettings
from ballbar.sim.streams import stream
from ballbar.sim.true_robot import TrueArm, true_arm
from ballbar.sim.truth import DHRows, PoseTruth, RippleTruth, SeatMotion, TruePlace

PlantKind = Literal["mujoco", "kinematic"]


@dataclass(frozen=True, eq=False)
class SimulatedRows:
    """The rows of a table in the order of time."""

    time: Array  # (N,) [s]
    seat: tuple[str, ...]
    target: tuple[str, ...]
    axes: Array  # (N, J) [rad] as the controller shows them
    # (N, M) [m, rad], M as the kind's `columns`; of pictures (N, C, 2) [px] of the board's corners
    values: Array
    reference: Array  # (N, K, 3) [m] reference points; NaN where they were not read


@dataclass(frozen=True, eq=False)
class PoseSimulation:
    """A table of still poses, and what it was made from."""

    robot: Robot
    instrument: Instrument
    rows: SimulatedRows
    truth: PoseTruth
    plant: str  # what held the robot, and why, in a sentence
    still: Literal[True] = True

    @property
    def figures(self) -> dict[str, object]:
        """The plant that held the robot, and least and largest force along rod or wire [N]."""
        force = self.truth.force_N
        return {"plant": self.plant, "force_N": None if force is None else list(force)}


def simulate_poses(settings: SimulationSettings, *, relative_to: Path) -> PoseSimulation:
    """Simulate a table of still poses.

    relative_to : folder of the scenario, for the files that it names.

    Raises InputError for a scenario that cannot be run, NotAtRestError where a pose is not held.
    """
    errors, seed, stated = settings.errors, settings.seed, settings.needed_poses
    robot = load_robot(settings.cell.robot, relative_to=relative_to)
    instrument = load_instrument(settings.cell.measured_by, relative_to=relative_to)
    if (instrument.camera is None) != (stated.pictures is None):
        raise InputError(
            f"poses.pictures: state it of a camera, and of no other instrument than one; "
            f"cell.instrument is {instrument.name}."
        )
    if stated.pictures is not None:
        instrument = replace(instrument, view=view_of(stated.pictures))
    arm = true_arm(robot, errors, seed, warmth=temperature_of([settings.cell], robot=True))
    kind, sentence = _plant(settings, robot, instrument)
    if stated.reference and instrument.kind.names[:3] != ("x", "y", "z"):
        raise InputError(
            f"poses.reference: {instrument.name} measures a {instrument.measured}, and reads no "
            "reference points. Leave it out, or take a tracker."
        )
    growth, _ = growth_at(temperature_of([settings.cell], robot=False), instrument.expansion)
    seats, targets = _true_seats(stated, instrument, seed, growth), _places(stated.targets)
    chosen = seed if stated.seed is None else stated.seed
    stands = choose_poses(stated, instrument, arm, seats, targets, stream(chosen, "poses"))
    order = np.concatenate([stand.order for stand in stands])
    later = np.repeat([stand.later for stand in stands], [len(stand.q) for stand in stands])
    rows = np.lexsort((later, order))  # of the stands, in the order of the table
    line = np.argsort(rows)  # of the table, from 0, at which each row of the stands is
    wrong = outliers(errors, instrument, order.size, seed)[line]
    measurement = _Measurement(
        settings=settings,
        instrument=instrument,
        arm=arm,
        kind=kind,
        seats=seats,
        targets=targets,
        drift=seat_motion(errors, seed),
        last=max(1, int(order.max())),
    )
    shown, values, force = measurement.readings(stands, wrong)
    if instrument.measured == "length":
        values = values / (1.0 + growth)  # as the marks of a warm scale show them
    poses = np.empty((int(order.max()) + 1, robot.joints))
    poses[order] = shown
    read, early = unsettled(errors, poses, seed)
    settled, hurried = (logged_axes(arm, errors, q, seed)[order] for q in (poses, read))
    too_early = early[order] & (later == later.min())  # at the target that is read first
    axes = np.where(too_early[:, None], hurried, settled)
    names = np.array([(stand.seat, stand.target) for stand in stands for _ in stand.q])[rows]
    return PoseSimulation(
        robot=robot,
        instrument=instrument,
        rows=SimulatedRows(
            time=((order + later / len(targets)) * stated.dwell_s)[rows],
            seat=tuple(names[:, 0].tolist()),
            target=tuple(names[:, 1].tolist()),
            axes=axes[rows],
            values=values[rows],
            reference=measurement.references(stands)[rows],
        ),
        truth=measurement.truth(line[wrong.any(axis=1)], line[too_early], force),
        plant=sentence,
    )


def _plant(
    settings: SimulationSettings, robot: Robot, instrument: Instrument
) -> tuple[PlantKind, str]:
    """Which plant holds the robot, and a sentence that says why."""
    obstacles = []
    if instrument.measured != "length":
        obstacles.append(f"{instrument.name} does not pull at the robot")
    if robot.links is None or robot.gears is None:
        obstacles.append(f"{robot.name}'s file states no masses or no gears")
    elif settings.errors.joint_compliance is None:
        obstacles.append("errors.joint_compliance is absent, and rigid gears do not yield")
    if settings.errors.unit_weights is not None:
        obstacles.append("errors.unit_weights stand for masses that are not known")
    requested = settings.plant.kind
    if requested == "mujoco" and obstacles:
        raise InputError(
            f"plant.kind = mujoco: {'; '.join(obstacles)}. Use plant.kind = kinematic, or auto."
        )
    if requested == "mujoco" or (requested == "auto" and not obstacles):
        return "mujoco", "The poses were held in MuJoCo, in equilibrium with rod or wire."
    why = "as the scenario asks" if requested == "kinematic" else "; ".join(obstacles)
    return "kinematic", f"The poses are kinematic: {why}."


def _true_seats(
    stated: PosesSettings, instrument: Instrument, seed: int, growth: float
) -> dict[str, TruePlace]:
    """The seats; the second of a pair at the fixture's true distance from the first, drawn.

    growth : share by which the fixture is longer than its file says.
    """
    seats = _places(stated.seats)
    if instrument.distance is None or len(seats) != 2:
        return seats
    (first, second), (length, sigma) = seats, instrument.distance
    apart = seats[second].position - seats[first].position
    distance = float(np.linalg.norm(apart))
    if abs(distance - length) > 5.0 * sigma:
        raise InputError(
            f"poses.seats: {first} and {second} are {distance:.4g} m apart, those of "
            f"{instrument.name} {length:g} m. Move one of them."
        )
    true = length + sigma * float(stream(seed, "seat_distance").standard_normal())
    true *= 1.0 + growth
    position = tuple((seats[first].position + apart * (true / distance)).tolist())
    return seats | {second: seats[second].model_copy(update={"position_m": position})}


def _places(stated: tuple[PlacementSettings, ...]) -> dict[str, TruePlace]:
    return {s.name: TruePlace(position_m=s.position_m, rotvec_rad=s.rotvec_rad) for s in stated}


@dataclass(frozen=True, eq=False)
class _Measurement:
    """The true robot, seats and targets while the poses are measured."""

    settings: SimulationSettings
    instrument: Instrument
    arm: TrueArm
    kind: PlantKind
    seats: dict[str, TruePlace]
    targets: dict[str, TruePlace]
    drift: SeatMotion
    last: int  # number of the last pose

    @property
    def _noise_scale(self) -> float:
        noise = self.settings.errors.instrument_noise
        return noise.scale if noise else 0.0

    def _seat(self, stand: Stand) -> tuple[Array, Array]:
        return self.drift.at(self.seats[stand.seat], stand.order / self.last)

    def readings(
        self, stands: tuple[Stand, ...], wrong: Array
    ) -> tuple[Array, Array, tuple[float, float] | None]:
        """Shown angles (K, J) [rad], values (K, M), and least and largest force [N] of all stands.

        Of a camera the values are pixels (K, C, 2). wrong : (K, 3) [m] outliers.
        """
        instrument, plant, scale = self.instrument, self.settings.plant, self._noise_scale
        noise = stream(self.settings.seed, "instrument_noise")
        slide = stream(self.settings.seed, "rod_friction")
        shown, values, forces = [], [], []
        ends = np.cumsum([len(stand.q) for stand in stands])
        for stand, fault in zip(stands, np.split(wrong, ends[:-1]), strict=True):
            seat, q, sag, target = self._seat(stand), stand.q, None, self.targets[stand.target]
            if not instrument.kind.columns:
                play = scale * instrument.sigma_length * noise.standard_normal((len(q), 3))
                q = self._put_into(q, target, seat[0].T + play + fault)
            if self.kind == "mujoco":
                sag, force = hold_with_instrument(
                    self.arm,
                    instrument,
                    plant,
                    seat=self.seats[stand.seat],
                    target=target,
                    q=q,
                    friction=slide.uniform(-plant.rod_friction_N, plant.rod_friction_N, len(q)),
                )
                forces.append(force)
            exact = stand_of(self.arm, q, target, seat, sag)
            shown.append(q)
            if instrument.view is not None:
                moved = replace(exact, rod=exact.rod + fault.T)
                values.append(pictured(instrument, moved, self.settings, noise))
                continue
            read = measured(instrument, exact, scale=scale, rng=noise)
            width = min(3, read.shape[1])
            angles = [unit == "rad" for unit in instrument.kind.units[:width]]
            turned = fault[:, :width] / exact.distance[:, None]
            read[:, :width] += np.where(angles, turned, fault[:, :width])
            values.append(read)
        span = None
        if forces:
            span = float(np.concatenate(forces).min()), float(np.concatenate(forces).max())
        return np.concatenate(shown), np.concatenate(values), span

    def references(self, stands: tuple[Stand, ...]) -> Array:
        """(K, R, 3) [m] readings of R reference points, at each pose with its first target."""
        points = self.settings.needed_poses.reference
        noise = stream(self.settings.seed, "reference_noise")
        readings = []
        for stand in stands:
            read = np.full((len(stand.q), len(points), 3), np.nan)
            if stand.later == 0:
                seat = self._seat(stand)
                for k, point in enumerate(points):
                    exact = seen_from(seat, np.array(point.position_m)[:, None], seat[1])
                    values = measured(self.instrument, exact, scale=self._noise_scale, rng=noise)
                    read[:, k] = values[:, :3]
            readings.append(read)
        return np.concatenate(readings)

    def _put_into(self, q: Array, target: TruePlace, wanted: Array) -> Array:
        """Angles (N, J) [rad] at which a target is where the ball truly lies (N, 3) [m]."""
        robot = self.arm.robot
        q, reached = reach_points(
            robot,
            self.arm.chain,
            point=target.position,
            q=q,
            wanted=wanted,
            lower=robot.axis_lower,
            upper=robot.axis_upper,
            position=lambda angles: self.arm.target(angles, target.position),
        )
        if not reached.all():
            raise InputError(
                f"poses: {int((~reached).sum())} balls cannot be put where errors.outliers or "
                "errors.drift have them. Make these errors smaller."
            )
        return q

    def truth(
        self,
        wrong: NDArray[np.intp],
        too_early: NDArray[np.intp],
        force: tuple[float, float] | None,
    ) -> PoseTruth:
        """The truth; wrong, too_early : lines of the table, from 0."""
        arm, stiffness = self.arm, self.arm.effects.gear_stiffness
        play = arm.effects.gear_backlash
        content = {
            "schema": "ballbar-poses-truth/1",
            "seed": self.settings.seed,
            "robot": arm.robot.name,
            "dh": DHRows(**{kind: tuple(getattr(arm.chain, kind).tolist()) for kind in KINDS}),
            "joint_harmonics": tuple(RippleTruth.of(ripple) for ripple in arm.effects.ripples),
            "unit_weights_rad_per_m": tuple(map(tuple, arm.weights.tolist())),
            "gear_stiffness_N_m_per_rad": None if stiffness is None else tuple(stiffness.tolist()),
            "gear_backlash_half_width_rad": tuple(play.tolist()) if play.any() else None,
            "seats": self.seats,
            "targets": self.targets,
            "drift": self.drift,
            "outliers": tuple(sorted((wrong + 2).tolist())),
            "unsettled": tuple(sorted((too_early + 2).tolist())),
            "plant": self.kind,
            "force_N": force,
        }
        return PoseTruth.model_validate(content)
