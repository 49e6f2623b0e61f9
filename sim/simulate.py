"""One simulated recording before it is written: path, plant, encoders, clocks, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import Geometry, nominal_geometry
from cell.instrument import Instrument
from cell.logs import RobotLog
from sim.errors.sample_errors import refuse_sample_errors
from sim.errors.sensor_effects import (
    EncoderEffects,
    ResolverEffects,
    encoder_effects,
    resolver_effects,
)
from sim.errors.static_errors import true_geometry
from sim.logging.clocks import LogTimes, log_times
from sim.logging.encoders import BarEncoder
from sim.logging.joint_lag import joint_lags, with_lags
from sim.logging.load_logs import drawn_loads
from sim.logging.log_truth import FirstRows, LogTruth
from sim.logging.loggers import LoggedRows, logged_rows
from sim.logging.robot_files import robot_period
from sim.logging.tracker import drawn_tracker
from sim.motion import Motion, MotionCallback
from sim.path import ReferencePath
from sim.path_files import scenario_path
from sim.plant.description import Plant, servo_gains
from sim.plant.effects import PlantEffects, plant_effects
from sim.plant.instrument_plant import run_with_instrument
from sim.plant.kinematic_plant import refuse_forces, run_kinematic
from sim.plant.measured_motion import check_stroke, run_free
from sim.plant.mjcf import ROBOT_JOINTS
from sim.plant.mujoco_plant import run_plant
from sim.plant.thermal_growth import with_growth
from sim.scenario_cell import scenario_cell, scenario_instrument
from sim.settings import SimulationSettings
from sim.streams import stream
from sim.truth import PlantTruth, Truth, plant_truth

# [rad/s] joint speed up to which a recording begins in a dwell: ten times what its noise leaves
# after smoothing
AT_REST = 0.01


@dataclass(frozen=True, eq=False)
class Simulation:
    """One run before it was logged."""

    cell: Cell
    instrument: Instrument | None  # that measures a length; None for a ball-bar
    path: ReferencePath
    motion: Motion
    encoders: tuple[BarEncoder, ...]
    resolvers: ResolverEffects | None
    times: LogTimes
    rows: LoggedRows
    truth: Truth


def simulate(
    settings: SimulationSettings,
    *,
    relative_to: Path,
    recorded: RobotLog | None = None,
    on_motion: MotionCallback | None = None,
) -> Simulation:
    """Run the plant and decide which rows the loggers will write.

    relative_to : folder of the scenario, for the files that it names. recorded : the robot's log of
        path.recording, where there is one. on_motion : called with each stretch of the motion.

    Raises InputError for a scenario that cannot be run.
    """
    refuse_sample_errors(settings.errors)
    chosen, errors, seed = settings.cell, settings.errors, settings.seed
    cell = scenario_cell(chosen, relative_to=relative_to)
    instrument = scenario_instrument(chosen, relative_to=relative_to)
    period = robot_period(settings.logs, cell.robot)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    true = true_geometry(
        nominal,
        errors,
        plate_sigma=cell.plate.length_sigma,
        transmission=cell.robot.transmission,
        zero_sigma=settings.length.zero_scale * instrument.sigma_zero if instrument else None,
        seed=seed,
    )
    path = scenario_path(settings.path, cell, nominal, relative_to=relative_to, recorded=recorded)
    effects = plant_effects(errors, cell, seed)
    plant = _Plant(settings, cell, instrument, true, effects)
    lags = joint_lags(errors.joint_lag, joints=cell.robot.joints, seed=seed)
    motion = with_lags(plant.motion(path, on_motion=on_motion), cell.robot, lags)
    if instrument:
        check_stroke(instrument, motion)
    encoders = () if instrument else _encoders(settings, cell)
    resolvers = resolver_effects(errors.resolver_error, joints=cell.robot.joints, seed=seed)
    rate = settings.length.rate_hz if instrument else None
    times = log_times(
        float(motion.t[-1]),
        settings.clocks,
        period=period,
        task=settings.logs.ballbar.task_s,
        rate=rate,
        seed=settings.recording_seed,
    )
    rows = logged_rows(times, settings.clocks, seed=settings.recording_seed)
    logs = _log_truth(settings, encoders, resolvers, times, rows, lags)
    return Simulation(
        cell=cell,
        instrument=instrument,
        path=path,
        motion=motion,
        encoders=encoders,
        resolvers=resolvers,
        times=times,
        rows=rows,
        truth=_truth(settings, motion, encoders, plant_truth(effects), logs),
    )


@dataclass(frozen=True, eq=False)
class _Plant:
    """The plant that a scenario chooses."""

    settings: SimulationSettings
    cell: Cell
    instrument: Instrument | None
    true: Geometry
    effects: PlantEffects

    def motion(self, path: ReferencePath, *, on_motion: MotionCallback | None) -> Motion:
        kinematic = self.settings.plant.kind == "kinematic"
        motion = (self._kinematic if kinematic else self._mujoco)(path, on_motion)
        free = self.instrument is not None
        return with_growth(motion, self.cell.robot, self.effects, free=free)

    def _kinematic(self, path: ReferencePath, on_motion: MotionCallback | None) -> Motion:
        refuse_forces(self.settings)
        run = run_free if self.instrument else run_kinematic
        motion = run(self.cell.robot, self.true, self.effects, path)
        if on_motion is not None:
            b = np.column_stack((motion.b, motion.rod_stretch)) if self.instrument else motion.b
            on_motion(self.cell, self.true, motion.t, motion.q, b)
        return motion

    def _mujoco(self, path: ReferencePath, on_motion: MotionCallback | None) -> Motion:
        chosen, robot = self.settings.plant, self.cell.robot
        if robot.joints != len(ROBOT_JOINTS):
            raise InputError(
                f"plant.kind = mujoco: the dynamic plant is built for {len(ROBOT_JOINTS)} axes, "
                f"robot {robot.name} has {robot.joints}. Use plant.kind = kinematic."
            )
        if self.settings.path.kind == "recorded":
            _refuse_moving_start(path)
        sensed = self.settings.logs.force_sensor is not None
        effects, gains = (
            replace(self.effects, force_sensor=sensed),
            servo_gains(robot, chosen.servo),
        )
        plant = Plant(self.cell, self.true, effects, gains)
        run = run_plant
        if self.instrument:
            run = partial(run_with_instrument, instrument=self.instrument, forces=chosen)
        return run(
            plant,
            path,
            timestep=chosen.timestep_s,
            gravity_compensation=chosen.gravity_compensation,
            on_motion=on_motion,
        )


def _refuse_moving_start(path: ReferencePath) -> None:
    fastest = float(np.abs(path.speed[0]).max())
    if fastest > AT_REST:
        raise InputError(
            f"path.recording: the robot moves at its first row ({np.degrees(fastest):.1f} deg/s), "
            "and plant.kind = mujoco starts from rest. Take a recording that begins at rest, or "
            "plant.kind = kinematic."
        )


def _encoders(settings: SimulationSettings, cell: Cell) -> tuple[BarEncoder, ...]:
    """The fitted encoders; offset and direction are drawn for every joint, fitted or not."""
    rng = stream(settings.seed, "encoder_mounting")
    offsets, directions = rng.uniform(-np.pi, np.pi, 5), rng.choice([-1, 1], 5)
    given, lines = settings.encoders, cell.ballbar.encoder_lines
    return tuple(
        BarEncoder(
            joint=j,
            lines=lines,
            bits=given.bits,
            direction=int(directions[j - 1]),
            declared=int(directions[j - 1]) if given.directions == "declared" else 1,
            offset=float(offsets[j - 1]),
            noise_sigma=given.noise_sigma_rad,
            effects=encoder_effects(
                settings.errors, j, lines=lines, bits=given.bits, seed=settings.seed
            ),
        )
        for j in given.fitted
    )


def _truth(
    settings: SimulationSettings,
    motion: Motion,
    encoders: tuple[BarEncoder, ...],
    plant: PlantTruth,
    logs: LogTruth,
) -> Truth:
    true = motion.geometry
    offsets = {f"btheta{e.joint}": true[f"btheta{e.joint}"] + e.offset for e in encoders}
    position, angle = motion.closure()
    return Truth(
        geometry=true.replaced(offsets),
        directions={f"b{e.joint}": e.direction * e.declared for e in encoders},
        offset=settings.clocks.offset_s + sum(logs.joint_lag_s[:1]),
        skew=settings.clocks.skew,
        seed=settings.seed,
        closure_position=float(position.max()),
        closure_angle=float(angle.max()),
        rod_force_min=float(motion.rod_force.min()),
        rod_force_max=float(motion.rod_force.max()),
        plant=plant,
        logs=logs,
    )


def _log_truth(
    settings: SimulationSettings,
    encoders: tuple[BarEncoder, ...],
    resolvers: ResolverEffects | None,
    times: LogTimes,
    rows: LoggedRows,
    lags: Array,
) -> LogTruth:
    clocks = settings.clocks
    first = FirstRows(robot_s=float(times.robot_true[0]), ballbar_s=float(times.bar_true[0]))
    return LogTruth(
        first_rows=first,
        encoders={f"b{e.joint}": e.effects for e in encoders if e.effects != EncoderEffects()},
        resolvers=resolvers,
        joint_lag_s=tuple(lags.tolist()),
        clock_wander=times.wander,
        robot_clock_wander=times.robot_wander,
        clock_step=clocks.step,
        restart=clocks.restart,
        loads=drawn_loads(settings.logs, settings.seed),
        tracker=drawn_tracker(settings.logs.tracker, settings.seed),
        rows=rows.counts if clocks.dropped_rows or clocks.duplicated_rows else {},
    )
