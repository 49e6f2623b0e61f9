"""One simulated recording: path, plant, encoders, clocks, device files; and the truth beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cell.descriptions import Cell
from cell.errors import InputError
from cell.files import write_yaml
from cell.geometry import Geometry, nominal_geometry
from cell.load import load_cell
from cell.logs import RobotLog
from cell.strict_yaml import load_model
from sim.errors.sample_errors import refuse_sample_errors
from sim.errors.sensor_effects import (
    EncoderEffects,
    ResolverEffects,
    encoder_effects,
    resolver_effects,
)
from sim.errors.static_errors import true_geometry
from sim.logging.clocks import LogTimes, log_times
from sim.logging.encoders import BarEncoder, motor_angles
from sim.logging.load_logs import drawn_loads, motor_torques, sensor_rows
from sim.logging.log_truth import FirstRows, LogTruth
from sim.logging.loggers import LoggedRows, logged_rows
from sim.logging.writers import write_abb_motor, write_force_torque, write_twincat_plc
from sim.motion import Motion, MotionCallback
from sim.path import Lissajous, PushPull, ReferencePath, reference_path
from sim.plant.effects import PlantEffects, plant_effects
from sim.plant.kinematic_plant import refuse_forces, run_kinematic
from sim.plant.mujoco_plant import run_plant
from sim.recorded_path import recorded_path
from sim.settings import LissajousFile, PathSettings, PushPullFile, SimulationSettings
from sim.streams import stream
from sim.truth import PlantTruth, Truth, plant_truth

BALLBAR_FILES = (
    "raw/ballbarOld.csv",
    "raw/ballbar.csv",
)  # a logger that starts again renames its file (notes/log_formats sec. A.6)
PATH_STEP = 0.01  # [s] grid of the reference path; the command between is a cubic spline
AT_REST = 0.01  # [rad/s] joint speed up to which a recording begins at rest: ten times what its noise leaves after smoothing


@dataclass(frozen=True, eq=False)
class Simulation:
    """What was simulated, before it was logged."""

    cell: Cell
    path: ReferencePath
    motion: Motion
    encoders: tuple[BarEncoder, ...]
    declared: tuple[int, ...]  # sense of each encoder as recording.yaml will state it
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
    """Runs the plant and decides what the loggers will see.

    relative_to : folder of the scenario, for files it names. recorded : the robot's log of path.recording, where there is one.
    on_motion : told of the motion while it is simulated.
    Raises InputError for a scenario that cannot be run.
    """
    refuse_sample_errors(settings.errors)
    chosen = settings.cell
    cell = load_cell(chosen.robot, chosen.ballbar, chosen.plate, relative_to=relative_to)
    nominal = nominal_geometry(cell, np.array(chosen.ballbar_position_m))
    true = true_geometry(
        nominal, settings.errors, plate_sigma=cell.plate.length_sigma, seed=settings.seed
    )
    path = planned_path(settings.path, cell, nominal, relative_to=relative_to, recorded=recorded)
    effects = plant_effects(settings.errors, cell, settings.seed)
    motion = _moved(settings, cell, true, effects, path, on_motion)
    encoders, declared = _encoders(settings, cell)
    resolvers = (
        resolver_effects(settings.errors.resolver_error, seed=settings.seed)
        if settings.errors.resolver_error
        else None
    )
    times = log_times(float(motion.t[-1]), settings.clocks, seed=settings.seed)
    rows = logged_rows(times, settings.clocks, seed=settings.seed)
    logs = _log_truth(settings, encoders, resolvers, times, rows)
    plant = plant_truth(effects)
    truth = _truth(settings, true, motion, encoders, declared, plant, logs)
    return Simulation(cell, path, motion, encoders, declared, resolvers, times, rows, truth)


def write_recording(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    """Writes `folder/raw/*`, the truth as `folder.truth.yaml` beside it, and `folder/recording.yaml` last."""
    motion, times = simulation.motion, simulation.times
    q, _ = motion.at(times.robot_true)
    motors = motor_angles(
        simulation.cell.robot, q, settings.errors, simulation.resolvers, settings.seed
    )
    rows = simulation.rows.robot
    log, sensor, drawn = (
        settings.logs.torque,
        settings.logs.force_sensor,
        simulation.truth.logs.loads,
    )
    torques = (
        motor_torques(simulation.cell.robot, motion, times.robot_true, log, drawn, settings.seed)[
            rows
        ]
        if log
        else None
    )
    write_abb_motor(folder / "raw" / "robot.csv", times.robot_stamp[rows], motors[rows], torques)
    if sensor:
        first, last = float(times.robot_true[0]), float(times.robot_true[-1])
        write_force_torque(
            folder / "raw" / "force.csv",
            *sensor_rows(motion, first, last, sensor, drawn, settings.seed),
        )
    if simulation.encoders:
        _write_ballbar(simulation, settings, folder)
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "recording.yaml", _recording_yaml(simulation, settings))


def _write_ballbar(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    times, seed = simulation.times, settings.seed
    _, b = simulation.motion.at(times.bar_true)
    if outliers := settings.errors.outliers:
        b[:, [e.joint - 1 for e in simulation.encoders]] += outliers.on_ballbar(
            len(b), len(simulation.encoders), seed
        )
    columns, status = {}, {}
    for e in simulation.encoders:
        columns[f"b{e.joint}"] = e.counts(
            b[:, e.joint - 1], times.bar_true, stream(seed, f"encoder_noise_b{e.joint}")
        )
        status[f"s{e.joint}"] = e.status(times.bar_task, times.bar_true)
    for file, rows in zip(_ballbar_files(simulation.rows), simulation.rows.ballbar, strict=True):
        counts = {name: column[rows] for name, column in columns.items()}
        words = {name: column[rows] for name, column in status.items()}
        write_twincat_plc(folder / file, times.bar_stamp[rows], counts, words)


def _ballbar_files(rows: LoggedRows) -> list[str]:
    return list(BALLBAR_FILES[-len(rows.ballbar) :])


def truth_path(folder: Path) -> Path:
    """Where the truth of a simulated recording lies: beside its folder, never inside."""
    return folder.with_name(folder.name + ".truth.yaml")


def planned_path(
    timing: PathSettings,
    cell: Cell,
    nominal: Geometry,
    *,
    relative_to: Path,
    recorded: RobotLog | None = None,
) -> ReferencePath:
    """The reference path of a scenario; arguments as of `simulate`.

    Raises InputError when the mechanism cannot follow it, DescriptionError for a bad path file.
    """
    if timing.kind == "recorded":
        if recorded is None:
            raise InputError(
                f"path.recording = {timing.recording}: its robot log was not handed to the simulation."
            )
        return recorded_path(
            cell.robot, nominal, recorded, duration=timing.duration_s, step=PATH_STEP
        )
    file = relative_to / timing.file
    shape = load_push_pull(file) if timing.kind == "push_pull" else load_lissajous(file)
    return reference_path(
        cell.robot,
        nominal,
        shape,
        duration=timing.duration_s,
        dwell=timing.dwell_s,
        stops=timing.stops,
        step=PATH_STEP,
    )


def load_lissajous(path: Path) -> Lissajous:
    """The path file as radians. Raises DescriptionError."""
    return lissajous(load_model(path, LissajousFile))


def lissajous(file: LissajousFile) -> Lissajous:
    """Its numbers as radians."""
    return Lissajous(
        np.radians(file.centre_deg),
        np.radians(file.amplitude_deg),
        np.array(file.cycles, dtype=float),
        np.radians(file.phase_deg),
    )


def load_push_pull(path: Path) -> PushPull:
    """The path file as radians. Raises DescriptionError."""
    file = load_model(path, PushPullFile)
    return PushPull(np.radians(file.angles_deg), file.travel_m, file.cycles)


def _moved(
    settings: SimulationSettings,
    cell: Cell,
    true: Geometry,
    effects: PlantEffects,
    path: ReferencePath,
    on_motion: MotionCallback | None,
) -> Motion:
    plant = settings.plant
    if plant.kind == "kinematic":
        refuse_forces(settings)
        motion = run_kinematic(cell.robot, true, effects, path)
        if on_motion is not None:
            on_motion(cell, true, motion.t, motion.q, motion.b)
        return motion
    if settings.path.kind == "recorded":
        _refuse_moving_start(path)
    effects = replace(effects, force_sensor=settings.logs.force_sensor is not None)
    return run_plant(
        *(cell, true, effects, path),
        servo=plant.servo,
        timestep=plant.timestep_s,
        gravity_compensation=plant.gravity_compensation,
        on_motion=on_motion,
    )


def _refuse_moving_start(path: ReferencePath) -> None:
    fastest = float(np.abs(path.speed[0]).max())
    if fastest > AT_REST:
        raise InputError(
            f"path.recording: the robot moves at its first row ({np.degrees(fastest):.1f} deg/s), and plant.kind = mujoco starts "
            "from rest. Take a recording that begins at rest, or plant.kind = kinematic."
        )


def _encoders(
    settings: SimulationSettings, cell: Cell
) -> tuple[tuple[BarEncoder, ...], tuple[int, ...]]:
    """Encoders as they are, and the directions that recording.yaml declares; a zero and a sense per joint, fitted or not."""
    rng = stream(settings.seed, "encoder_mounting")
    zeros, directions = rng.uniform(-np.pi, np.pi, 5), rng.choice([-1, 1], 5)
    given, lines = settings.encoders, cell.ballbar.encoder_lines
    effects = {
        j: encoder_effects(settings.errors, j, lines=lines, bits=given.bits, seed=settings.seed)
        for j in given.fitted
    }
    encoders = tuple(
        BarEncoder(
            j,
            lines,
            given.bits,
            int(directions[j - 1]),
            float(zeros[j - 1]),
            given.noise_sigma_rad,
            effects[j],
        )
        for j in given.fitted
    )
    return encoders, tuple(e.sign if given.directions == "declared" else 1 for e in encoders)


def _truth(
    settings: SimulationSettings,
    true: Geometry,
    motion: Motion,
    encoders: tuple[BarEncoder, ...],
    declared: tuple[int, ...],
    plant: PlantTruth,
    logs: LogTruth,
) -> Truth:
    zeros = {f"btheta{e.joint}": true[f"btheta{e.joint}"] + e.zero for e in encoders}
    position, angle = motion.closure()
    return Truth(
        geometry=true.replaced(zeros),
        directions={
            f"b{e.joint}": e.sign * said for e, said in zip(encoders, declared, strict=True)
        },
        offset=settings.clocks.offset_s,
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
) -> LogTruth:
    clocks = settings.clocks
    return LogTruth(
        first_rows=FirstRows(
            robot_s=float(times.robot_true[0]), ballbar_s=float(times.bar_true[0])
        ),
        encoders={f"b{e.joint}": e.effects for e in encoders if e.effects != EncoderEffects()},
        resolvers=resolvers,
        clock_wander=times.wander,
        clock_step=clocks.step,
        restart=clocks.restart,
        loads=drawn_loads(settings.logs, settings.seed),
        rows=rows.counts if clocks.dropped_rows or clocks.duplicated_rows else {},
    )


def _recording_yaml(simulation: Simulation, settings: SimulationSettings) -> dict[str, object]:
    chosen = settings.cell
    sources: dict[str, object] = {"robot": {"files": ["raw/robot.csv"], "dialect": "abb-motor"}}
    if simulation.encoders:
        sources["ballbar"] = {"files": _ballbar_files(simulation.rows), "dialect": "twincat-plc"}
    if settings.logs.force_sensor:
        sources["force"] = {"files": ["raw/force.csv"], "dialect": "force-torque"}
    return {
        "schema": "ballbar-recording/1",
        "kind": "simulated",
        "robot": chosen.robot,
        "ballbar": chosen.ballbar,
        "plate": chosen.plate,
        "sources": sources,
        "encoders": {
            f"b{e.joint}": {"column": f"b{e.joint}", "lines": e.lines, "bits": e.bits, "sign": said}
            for e, said in zip(simulation.encoders, simulation.declared, strict=True)
        },
        "notes": "",
    }
