"""One simulated table of still poses before it is written: poses, plant, readings, and the truth.

poses chosen -> true arm (or MuJoCo with rod or wire) -> readings -> faults -> rows
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.descriptions import Robot
from cell.errors import InputError
from cell.instrument import Instrument
from cell.load import load_instrument, load_robot
from cell.numerical_inverse import reach_points
from sim.poses.choice import Stand, choose_poses
from sim.poses.held import hold_with_instrument
from sim.poses.measurement import (
    Reading,
    SeatMotion,
    logged_axes,
    measured,
    outliers,
    reading,
    seat_motion,
    unsettled,
)
from sim.poses.settings import PlacementSettings, PoseSimulationSettings
from sim.poses.true_arm import Place, TrueArm, true_arm
from sim.poses.truth import PoseTruth
from sim.streams import stream

PlantKind = Literal["mujoco", "kinematic"]


@dataclass(frozen=True, eq=False)
class PoseRows:
    """The rows of a table in the order of time."""

    time: Array  # (N,) [s]
    seat: tuple[str, ...]
    target: tuple[str, ...]
    axes: Array  # (N, J) [rad] as the controller shows them
    values: Array  # (N, M) [m, rad], M as in cell.poses.COLUMNS
    reference: Array  # (N, K, 3) [m] reference points; NaN where they were not read


@dataclass(frozen=True, eq=False)
class PoseSimulation:
    """A table of still poses, and what it was made from."""

    robot: Robot
    instrument: Instrument
    rows: PoseRows
    truth: PoseTruth
    plant: str  # what held the robot, and why, in a sentence


@dataclass(frozen=True, eq=False)
class _Rows:
    """Where the poses of all stands come in the table; K rows in the order of the stands."""

    order: NDArray[np.intp]  # (K,) number of the pose in the measurement
    later: NDArray[np.intp]  # (K,) how many targets were measured before, at the same pose
    place: NDArray[np.intp]  # (K,) row in the table
    parts: tuple[slice, ...]  # of each stand


def simulate_poses(settings: PoseSimulationSettings, *, relative_to: Path) -> PoseSimulation:
    """Simulate a table of still poses.

    relative_to : folder of the scenario, for the files that it names.

    Raises InputError for a scenario that cannot be run, NotAtRestError where a pose is not held.
    """
    robot = load_robot(settings.cell.robot, relative_to=relative_to)
    instrument = load_instrument(settings.cell.instrument, relative_to=relative_to)
    arm = true_arm(robot, settings.errors, settings.seed)
    kind, sentence = _plant(settings, robot, instrument)
    if settings.poses.reference and instrument.measured not in ("point", "pose"):
        raise InputError(
            f"poses.reference: {instrument.name} measures a {instrument.measured}, and reads no "
            "reference points. Leave it out, or take a tracker."
        )
    seats = _true_seats(settings, instrument)
    targets = _places(settings.poses.targets)
    chosen = settings.seed if settings.poses.seed is None else settings.poses.seed
    rng = stream(chosen, "poses")
    stands = choose_poses(settings.poses, instrument, arm, seats, targets, rng)
    rows = _rows(stands, tuple(targets))
    faults = outliers(settings.errors, instrument, rows.order.size, settings.seed)[rows.place]
    motion = seat_motion(settings.errors, settings.seed)
    world = _World(
        settings=settings,
        instrument=instrument,
        arm=arm,
        seats=seats,
        targets=targets,
        motion=motion,
        kind=kind,
        rows=rows,
        faults=faults,
    )
    return _as_simulation(world, stands, *world.measured(stands), sentence)


def _plant(
    settings: PoseSimulationSettings, robot: Robot, instrument: Instrument
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
    wanted = settings.plant.kind
    if wanted == "mujoco" and obstacles:
        raise InputError(
            f"plant.kind = mujoco: {'; '.join(obstacles)}. Use plant.kind = kinematic, or auto."
        )
    if wanted == "mujoco" or (wanted == "auto" and not obstacles):
        return "mujoco", "The poses were held in MuJoCo, in equilibrium with rod or wire."
    why = "as the scenario asks" if wanted == "kinematic" else "; ".join(obstacles)
    return "kinematic", f"The poses are kinematic: {why}."


def _true_seats(settings: PoseSimulationSettings, instrument: Instrument) -> dict[str, Place]:
    """The seats; the second of a pair at the fixture's true distance from the first, drawn."""
    seats = _places(settings.poses.seats)
    if instrument.distance is None or len(seats) != 2:
        return seats
    (first, second), (length, sigma) = seats, instrument.distance
    apart = seats[second].position - seats[first].position
    stated = float(np.linalg.norm(apart))
    if abs(stated - length) > 5.0 * sigma:
        raise InputError(
            f"poses.seats: {first} and {second} are {stated:.4g} m apart, those of "
            f"{instrument.name} {length:g} m. Move one of them."
        )
    true = length + sigma * float(stream(settings.seed, "seat_distance").standard_normal())
    moved = Place(seats[first].position + apart * (true / stated), seats[second].rotvec)
    return seats | {second: moved}


def _places(stated: tuple[PlacementSettings, ...]) -> dict[str, Place]:
    return {s.name: Place(np.array(s.position_m), np.array(s.rotvec_rad)) for s in stated}


def _rows(stands: tuple[Stand, ...], targets: tuple[str, ...]) -> _Rows:
    order = np.concatenate([stand.order for stand in stands])
    numbers = [np.full(len(s.q), targets.index(s.target)) for s in stands]
    later = np.concatenate(numbers)
    place = np.empty(order.size, dtype=np.intp)
    place[np.lexsort((later, order))] = np.arange(order.size)
    ends = np.cumsum([len(s.q) for s in stands])
    parts = tuple(slice(end - len(s.q), end) for s, end in zip(stands, ends.tolist(), strict=True))
    return _Rows(order, later, place, parts)


@dataclass(frozen=True, eq=False)
class _World:
    """What is true while the poses are measured."""

    settings: PoseSimulationSettings
    instrument: Instrument
    arm: TrueArm
    seats: dict[str, Place]
    targets: dict[str, Place]
    motion: SeatMotion
    kind: PlantKind
    rows: _Rows
    faults: Array  # (K, 3) [m] outliers

    def measured(self, stands: tuple[Stand, ...]) -> tuple[Array, Array, Array | None]:
        """Shown angles (K, J) [rad], values (K, M) and force (K,) [N] of all stands."""
        errors, seed, rows = self.settings.errors, self.settings.seed, self.rows
        noise = stream(seed, "instrument_noise")
        slide = stream(seed, "rod_friction")
        scale = errors.instrument_noise.scale if errors.instrument_noise else 0.0
        shown, values, forces = [], [], []
        last = max(1, int(rows.order.max()))
        for stand, part in zip(stands, rows.parts, strict=True):
            seat = self.motion.at(self.seats[stand.seat], stand.order / last)
            q, sag, target = stand.q, None, self.targets[stand.target]
            if self.instrument.measured == "socket":
                play = scale * self.instrument.sigma_length * noise.standard_normal((len(q), 3))
                q = self._put_into(q, target, seat[0].T + play + self.faults[part])
            if self.kind == "mujoco":
                limit = self.settings.plant.rod_friction_N
                held = hold_with_instrument(
                    self.arm,
                    self.instrument,
                    self.settings.plant,
                    seat=self.seats[stand.seat],
                    target=target,
                    q=q,
                    friction=slide.uniform(-limit, limit, len(q)),
                )
                sag = held.joints
                forces.append(held.force)
            exact = reading(self.arm, q, target, seat, sag)
            each = measured(self.instrument, exact, scale=scale, rng=noise)
            width = min(3, each.shape[1])
            each[:, :width] += self.faults[part, :width]
            shown.append(q)
            values.append(each)
        force = np.concatenate(forces) if forces else None
        return np.concatenate(shown), np.concatenate(values), force

    def references(self, stands: tuple[Stand, ...]) -> Array:
        """(K, R, 3) [m] readings of R reference points, at each pose with its first target."""
        errors, rows, places = self.settings.errors, self.rows, self.settings.poses.reference
        noise = stream(self.settings.seed, "reference_noise")
        scale = errors.instrument_noise.scale if errors.instrument_noise else 0.0
        out = np.full((rows.order.size, len(places), 3), np.nan)
        last = max(1, int(rows.order.max()))
        for stand, part in zip(stands, rows.parts, strict=True):
            if stand.target != self.settings.poses.targets[0].name:
                continue
            origin, rotation = self.motion.at(self.seats[stand.seat], stand.order / last)
            for k, place in enumerate(places):
                exact = Reading(np.array(place.position_m)[:, None] - origin, rotation, rotation)
                read = measured(self.instrument, exact, scale=scale, rng=noise)
                out[part, k] = read[:, :3]
        return out

    def _put_into(self, q: Array, target: Place, wanted: Array) -> Array:
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


def _as_simulation(
    world: _World,
    stands: tuple[Stand, ...],
    shown: Array,
    values: Array,
    force: Array | None,
    sentence: str,
) -> PoseSimulation:
    settings, rows, arm = world.settings, world.rows, world.arm
    errors, seed = settings.errors, settings.seed
    poses = np.empty((int(rows.order.max()) + 1, arm.robot.joints))
    poses[rows.order] = shown
    read, early = unsettled(errors, poses, seed)
    settled, hurried = (logged_axes(arm, errors, q, seed) for q in (poses, read))
    first = rows.later == min(rows.later)  # the one that is read first
    too_early = early[rows.order] & first
    axes = np.where(too_early[:, None], hurried[rows.order], settled[rows.order])
    seats = [stand.seat for stand in stands for _ in stand.q]
    targets = [stand.target for stand in stands for _ in stand.q]
    share = rows.later / len(world.targets)
    at = np.argsort(rows.place)  # of each row of the table
    wrong = world.faults.any(axis=1)
    return PoseSimulation(
        robot=arm.robot,
        instrument=world.instrument,
        rows=PoseRows(
            time=((rows.order + share) * settings.poses.dwell_s)[at],
            seat=tuple(seats[k] for k in at),
            target=tuple(targets[k] for k in at),
            axes=axes[at],
            values=values[at],
            reference=world.references(stands)[at],
        ),
        truth=PoseTruth(
            arm=arm,
            seats=world.seats,
            targets=world.targets,
            drift=world.motion,
            outliers=tuple(sorted((rows.place[wrong] + 2).tolist())),
            unsettled=tuple(sorted((rows.place[too_early] + 2).tolist())),
            plant=world.kind,
            force=None if force is None else (float(force.min()), float(force.max())),
            seed=seed,
        ),
        plant=sentence,
    )
