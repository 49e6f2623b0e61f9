"""A simulated recording as files: device logs, recording.yaml, and the truth beside the folder."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cell.arrays import Array
from cell.dialect import load_dialect
from cell.files import write_yaml
from cell.instrument import Instrument
from cell.recording import TrackerFile
from sim.logging.clocks import BAR_EPOCH_NS, LoggedRows
from sim.logging.encoders import motor_angles, read_counts
from sim.logging.load_logs import motor_torques, sensor_rows
from sim.logging.robot_files import robot_source, write_robot_log
from sim.logging.tracker import tracker_rows
from sim.logging.writers import (
    write_ballbar_log,
    write_force_torque,
    write_lengths,
    write_tracker_points,
)
from sim.settings import SimulationSettings
from sim.streams import stream

if TYPE_CHECKING:
    from sim.simulate import Simulation

SENSOR_EPOCH = 51.0  # [s] up-time of the logger of lengths at its first row


def truth_path(folder: Path) -> Path:
    """File of the truth of a simulated recording: beside its folder, never inside."""
    return folder.with_name(folder.name + ".truth.yaml")


def write_recording(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    """Write `folder/raw/*`, the truth beside the folder, and `folder/recording.yaml` last."""
    _write_robot(simulation, settings, folder)
    if settings.logs.force_sensor:
        _write_force(simulation, settings, folder)
    if simulation.encoders:
        _write_ballbar(simulation, settings, folder)
    if simulation.instrument:
        _write_lengths(simulation, settings, simulation.instrument, folder)
    _write_tracker(simulation, settings, folder)
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "recording.yaml", _recording_yaml(simulation, settings))


def _write_robot(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    robot, times, seed = simulation.cell.robot, simulation.times, settings.recording_seed
    rows = simulation.rows.robot
    q = simulation.motion.shown_at(times.robot_true)
    motors = motor_angles(robot, q, settings.errors, simulation.resolvers, seed)
    torques = None
    if settings.logs.torque:
        torques = motor_torques(
            robot,
            simulation.motion,
            times.robot_true,
            log=settings.logs.torque,
            drawn=simulation.truth.logs.loads,
            seed=seed,
        )[rows]
    write_robot_log(folder, settings.logs, robot, times.robot_stamp[rows], motors[rows], torques)


def _write_force(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    if settings.logs.force_sensor is None:
        return
    times = simulation.times.robot_true
    stamps, readings = sensor_rows(
        simulation.motion,
        float(times[0]),
        float(times[-1]),
        sensor=settings.logs.force_sensor,
        drawn=simulation.truth.logs.loads,
        seed=settings.recording_seed,
    )
    write_force_torque(folder / "raw" / "force.csv", stamps, readings)


def _write_tracker(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    tracker, drawn = settings.logs.tracker, simulation.truth.logs.tracker
    if tracker is None or drawn is None:
        return
    times, seed = simulation.times.robot_true, settings.recording_seed
    stamps, points = tracker_rows(
        simulation.motion,
        float(times[0]),
        float(times[-1]),
        tracker=tracker,
        drawn=drawn,
        seed=seed,
    )
    write_tracker_points(folder / "raw" / "tracker.csv", stamps, points)


def _write_ballbar(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    times, seed = simulation.times, settings.recording_seed
    b = simulation.motion.bar_at(times.bar_true)
    if outliers := settings.errors.outliers:
        fitted = [e.joint - 1 for e in simulation.encoders]
        b[:, fitted] += outliers.on_ballbar(len(b), len(fitted), seed)
    counts, status = {}, {}
    for e in simulation.encoders:
        counts[f"b{e.joint}"] = read_counts(
            e, b[:, e.joint - 1], times.bar_true, settings.errors.signal_noise, seed
        )
        if settings.logs.ballbar.status:
            status[f"b{e.joint}"] = e.status(times.bar_task, times.bar_true)
    files, dialect = _files("ballbar", simulation.rows), load_dialect(settings.logs.ballbar.dialect)
    for file, rows in zip(files, simulation.rows.ballbar, strict=True):
        write_ballbar_log(
            folder / file,
            dialect,
            times.bar_stamp[rows],
            {name: column[rows] for name, column in counts.items()},
            {name: column[rows] for name, column in status.items()},
        )


def _write_lengths(
    simulation: Simulation, settings: SimulationSettings, instrument: Instrument, folder: Path
) -> None:
    times, sensor = simulation.times, settings.length
    sigma = sensor.noise_scale * instrument.sigma_length
    read = instrument.nominal + simulation.motion.stretch_at(times.bar_true)
    read += stream(settings.recording_seed, "length_noise").normal(0.0, sigma, read.shape)
    if sensor.resolution_m:
        read = np.rint(read / sensor.resolution_m) * sensor.resolution_m
    stamps: Array = SENSOR_EPOCH + (times.bar_stamp - BAR_EPOCH_NS).astype(np.float64) * 1e-9
    for file, rows in zip(_files("length", simulation.rows), simulation.rows.ballbar, strict=True):
        write_lengths(folder / file, stamps[rows], read[rows])


def _files(log: str, rows: LoggedRows) -> list[str]:
    """Files of the second log, oldest first.

    A logger that starts again renames its first file (notes/log_formats sec. A.6).
    """
    return [f"raw/{log}Old.csv", f"raw/{log}.csv"][-len(rows.ballbar) :]


def _recording_yaml(simulation: Simulation, settings: SimulationSettings) -> dict[str, object]:
    robot = robot_source(settings.logs, simulation.cell.robot)
    sources: dict[str, object] = {"robot": robot}
    if simulation.encoders:
        sources["ballbar"] = {
            "files": _files("ballbar", simulation.rows),
            "dialect": settings.logs.ballbar.dialect,
        }
    if simulation.instrument:
        sources["length"] = {
            "files": _files("length", simulation.rows),
            "dialect": "length-table",
            "column": "length",
            "unit": "mm",
            "time": "s",
        }
    if settings.logs.force_sensor:
        sources["force"] = {"files": ["raw/force.csv"], "dialect": "force-torque"}
    if tracker := settings.logs.tracker:
        sources["tracker"] = {
            "files": ["raw/tracker.csv"],
            "dialect": "tracker-points",
            "time": "s",
            "unit": "mm",
            "accuracy_m": tracker.noise_m or TrackerFile.model_fields["accuracy_m"].default,
        }
    return {
        "schema": "ballbar-recording/1",
        "kind": "simulated",
        "robot": settings.cell.robot,
        "instrument" if simulation.instrument else "ballbar": settings.cell.measured_by,
        "plate": settings.cell.plate,
        "sources": sources,
        "encoders": {
            f"b{e.joint}": {
                "column": f"b{e.joint}",
                "lines": e.lines,
                "bits": e.bits,
                "sign": e.declared,
            }
            for e in simulation.encoders
        },
        "notes": "",
    }
