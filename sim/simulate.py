"""One simulated recording before it is written: path, plant, encoders, clocks, and the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.logs import RobotLog
from ballbar.sim.errors.sample_errors import refuse_sample_errors
from ballbar.sim.errors.sensor_effects import EncoderEffects, ResolverEffects, encoder_effects
from ballbar.sim.errors.static_errors import set_without_strain
from ballbar.sim.logging.clocks import LoggedRows, LogTimes, log_times, logged_rows
from ballbar.sim.logging.encoders import BarEncoder, joint_lags, with_lags
from ballbar.sim.logging.load_logs import drawn_loads, drawn_tracker
from ballbar.sim.logging.robot_files import robot_period
from ballbar.sim.motion import Motion, MotionCallback
from ballbar.sim.path import ReferencePath
from ballbar.sim.path_files import scenario_path
from ballbar.sim.plant.effects import Plant, servo_gains
from ballbar.sim.plant.instrument_plant import run_with_instrument
from ballbar.sim.plant.kinematic_plant import (
    check_stroke,
    refuse_forces,
    run_free,
    run_kinematic,
    with_growth,
)
from ballbar.sim.plant.mujoco_plant import run_plant
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.streams import stream
from ballbar.sim.true_robot import TrueMachine, true_machine
from ballbar.sim.truth import (
    ClosureError,
    FirstRows,
    ForceRange,
    LogTruth,
    TrueClock,
    Truth,
    plant_truth,
)

# [rad/s] joint speed up to which a recording begins in a dwell: ten times what its noise leaves
# after smoothing
AT_REST = 0.01


@dataclass(frozen=True, eq=False)
class Simulation:
    """One run before it was logged."""

    cell: Cell
    instrument: Instrument | None  # in place of a ball-bar
    path: ReferencePath
    motion: Motion
    encoders: tuple[BarEncoder, ...]
    resolvers: ResolverEffects | None
    times: LogTimes
    rows: LoggedRows
    truth: Truth
    still: Literal[False] = False

    @property
    def follower(self) -> Instrument | None:
        """The instrument that follows a target on the robot; None where another one measures."""
        return self.instrument if self.instrument and self.instrument.follows else None

    @property
    def plant(self) -> str:
        """How well the plant closed its loop, and the force in the rod."""
        closure, force = self.truth.closure, self.truth.rod_force
        return (
            f"plant: loop closed within {closure.position_m * 1e6:.3f} um and "
            f"{closure.angle_rad * 1e6:.3f} urad, rod force {force.min_N:.0f} to "
            f"{force.max_N:.0f} N{self.truth.typical_words}"
        )

    @property
    def figures(self) -> dict[str, object]:
        """Largest loop-closure error of the plant, and the range of the force in the rod, SI."""
        closure, force = self.truth.closure, self.truth.rod_force
        plant = {
            "closure_position_m": float(closure.position_m),
            "closure_angle_rad": float(closure.angle_rad),
            "rod_force_min_N": float(force.min_N),
            "rod_force_max_N": float(force.max_N),
        }
        return {"plant": plant}


def simulate(
    settings: SimulationSettings,
    *,
    relative_to: Path,
    recorded: RobotLog | None = None,
    machine: TrueMachine | None = None,
    on_motion: MotionCallback | None = None,
) -> Simulation:
    """Run the plant and decide which rows the loggers will write.

    relative_to : folder of the scenario, for the files that it names. recorded : the robot's log of
        path.recording, where there is one. machine : in place of the one that the scenario draws,
        for instance the same with one part exchanged. on_motion : called with each stretch of the
        motion.

    Raises InputError for a scenario that cannot be run.
    """
    refuse_sample_errors(settings.errors)
    seed = settings.recording_seed
    if machine is None:
        machine = true_machine(settings, relative_to=relative_to)
    cell, instrument, robot = machine.cell, machine.instrument, machine.cell.robot
    period = robot_period(settings.logs, robot)
    path = scenario_path(
        settings.needed_path, cell, machine.nominal, relative_to=relative_to, recorded=recorded
    )
    if settings.cell.ballbar_set == "without_strain":
        machine = replace(machine, true=set_without_strain(machine.true, path.q[:1]))
    run = _in_mujoco if machine.dynamic else _kinematic
    motion = run(settings, machine, path, on_motion)
    motion = with_growth(motion, robot, machine.effects, free=instrument is not None)
    lags = joint_lags(settings.errors.joint_lag, joints=robot.joints, seed=settings.seed)
    motion = with_lags(motion, robot, lags)
    if instrument and not instrument.follows:
        check_stroke(instrument, motion)
    encoders = () if instrument else _encoders(settings, cell)
    times = log_times(
        float(motion.t[-1]),
        settings.clocks,
        period=period,
        task=settings.logs.ballbar.task_s,
        rate=settings.length.rate_hz if instrument else None,
        seed=seed,
    )
    rows = logged_rows(times, settings.clocks, seed=seed)
    return Simulation(
        cell=cell,
        instrument=instrument,
        path=path,
        motion=motion,
        encoders=encoders,
        resolvers=machine.resolvers,
        times=times,
        rows=rows,
        truth=_truth(settings, machine, motion, encoders, times, rows, lags),
    )


def _kinematic(
    settings: SimulationSettings,
    machine: TrueMachine,
    path: ReferencePath,
    on_motion: MotionCallback | None,
) -> Motion:
    """The motion of the kinematic plant."""
    refuse_forces(settings)
    run = run_free if machine.instrument else run_kinematic
    motion = run(machine.cell.robot, machine.true, machine.effects, path)
    if on_motion is not None:
        b = np.column_stack((motion.b, motion.rod_stretch)) if machine.instrument else motion.b
        on_motion(machine.cell, machine.true, motion.t, motion.q, b)
    return motion


def _in_mujoco(
    settings: SimulationSettings,
    machine: TrueMachine,
    path: ReferencePath,
    on_motion: MotionCallback | None,
) -> Motion:
    """The motion of the dynamic plant."""
    chosen, robot = settings.plant, machine.cell.robot
    fastest = float(np.abs(path.speed[0]).max())
    if settings.needed_path.kind == "recorded" and fastest > AT_REST:
        raise InputError(
            f"path.recording: the robot moves at its first row ({np.degrees(fastest):.1f} deg/s), "
            "and plant.kind = mujoco starts from rest. Take a recording that begins at rest, or "
            "plant.kind = kinematic."
        )
    effects = replace(machine.effects, force_sensor=settings.logs.force_sensor is not None)
    plant = Plant(machine.cell, machine.true, effects, servo_gains(robot, chosen.servo))
    run = run_plant
    if machine.instrument:
        run = partial(run_with_instrument, instrument=machine.instrument, forces=chosen)
    return run(
        plant,
        path,
        timestep=chosen.timestep_s,
        gravity_compensation=chosen.gravity_compensation,
        on_motion=on_motion,
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
    machine: TrueMachine,
    motion: Motion,
    encoders: tuple[BarEncoder, ...],
    times: LogTimes,
    rows: LoggedRows,
    lags: Array,
) -> Truth:
    """The truth of a run. lags : (J,) or (0,) [s] of the filters of the motors' angles."""
    true, clocks = motion.geometry, settings.clocks
    offsets = {f"btheta{e.joint}": true[f"btheta{e.joint}"] + e.offset for e in encoders}
    geometry = true.replaced(offsets)
    position, angle = motion.closure()
    logs = LogTruth(
        first_rows=FirstRows(
            robot_s=float(times.robot_true[0]), ballbar_s=float(times.bar_true[0])
        ),
        encoders={f"b{e.joint}": e.effects for e in encoders if e.effects != EncoderEffects()},
        resolvers=machine.resolvers,
        joint_lag_s=tuple(lags.tolist()),
        clock_wander=times.wander,
        robot_clock_wander=times.robot_wander,
        clock_step=clocks.step,
        restart=clocks.restart,
        loads=drawn_loads(settings.logs, len(motion.q[0]), settings.seed),
        tracker=drawn_tracker(settings.tracker(machine.instrument), settings.seed),
        rows=rows.counts if clocks.dropped_rows or clocks.duplicated_rows else {},
    )
    content = {
        "schema": "ballbar-truth/2",
        "seed": settings.seed,
        "parameters": dict(zip(geometry.table.names, geometry.values.tolist(), strict=True)),
        "directions": {f"b{e.joint}": e.direction * e.declared for e in encoders},
        "clock": TrueClock(offset_s=clocks.offset_s + sum(lags[:1].tolist()), skew=clocks.skew),
        "closure": ClosureError(position_m=float(position.max()), angle_rad=float(angle.max())),
        "rod_force": ForceRange(
            min_N=float(motion.rod_force.min()), max_N=float(motion.rod_force.max())
        ),
        "plant": plant_truth(machine),
        "logs": logs,
    }
    return Truth.model_validate(content)
