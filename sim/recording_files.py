"""Files of a simulation, and the truth beside their folder.

A recording is device logs and recording.yaml, a table of still poses is poses.csv and poses.yaml.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.dialect import Dialect, load_dialect
from ballbar.cell.files import beside, write_whole, write_yaml
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.temperature import Temperatures
from ballbar.sim.corners import image_name, write_pictures
from ballbar.sim.logging.clocks import BAR_EPOCH_NS, LoggedRows
from ballbar.sim.logging.encoders import motor_angles, read_counts
from ballbar.sim.logging.load_logs import motor_torques, sensor_rows, tracker_rows
from ballbar.sim.logging.robot_files import robot_source, write_robot_log
from ballbar.sim.settings import SimulationSettings
from ballbar.sim.streams import stream

if TYPE_CHECKING:
    from ballbar.sim.simulate import Simulation
    from ballbar.sim.still_poses import PoseSimulation

_DC_FILETIME = 125_911_584_000_000_000  # [100 ns] from 1601 to 2000
SENSOR_EPOCH = 51.0  # [s] up-time of the logger of lengths at its first row
TABLE = "poses.csv"
TURNS = ("rx", "ry", "rz")  # columns of a target's rotation vector [rad]


def truth_path(folder: Path) -> Path:
    """File of the truth of a simulated recording: beside its folder, never inside."""
    return beside(folder, ".truth.yaml")


def write_recording(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    """Write `folder/raw/*`, the truth beside the folder, and `folder/recording.yaml` last."""
    logs, drawn, seed = settings.logs, simulation.truth.logs, settings.recording_seed
    motion, robot_rows, raw = simulation.motion, simulation.times.robot_true, folder / "raw"
    first, last = float(robot_rows[0]), float(robot_rows[-1])
    _write_robot(simulation, settings, folder)
    if sensor := logs.force_sensor:
        stamps, readings = sensor_rows(
            motion, first, last, sensor=sensor, drawn=drawn.loads, seed=seed
        )
        _write_table(raw / "force.csv", "time,fx,fy,fz,tx,ty,tz", "%.5f", stamps, readings)
    if simulation.encoders:
        _write_ballbar(simulation, settings, folder)
    follower = simulation.follower
    if simulation.instrument and follower is None:
        _write_lengths(simulation, settings, simulation.instrument, folder)
    tracker = settings.tracker(follower)
    if tracker and drawn.tracker:
        stamps, values = tracker_rows(
            motion,
            (first, last),
            tracker=tracker,
            drawn=drawn.tracker,
            seed=seed,
            instrument=follower,
        )
        values[:, :3] *= 1e3
        head = ",".join(("time", "x", "y", "z", *TURNS)[: 1 + values.shape[1]])
        form = "%.5f" if follower is None else "%.8f"
        _write_table(raw / "tracker.csv", head, form, stamps, values)
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "recording.yaml", _recording_yaml(simulation, settings))


def _write_robot(simulation: Simulation, settings: SimulationSettings, folder: Path) -> None:
    robot, times, seed = simulation.cell.robot, simulation.times, settings.recording_seed
    rows, torques = simulation.rows.robot, None
    q = simulation.motion.shown_at(times.robot_true)
    motors = motor_angles(robot, q, settings.errors, simulation.resolvers, seed)
    if log := settings.logs.torque:
        loads = simulation.truth.logs.loads
        torques = motor_torques(
            robot, simulation.motion, times.robot_true, log=log, drawn=loads, seed=seed
        )[rows]
    write_robot_log(folder, settings.logs, robot, times.robot_stamp[rows], motors[rows], torques)


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
        _write_counts(
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
        _write_table(folder / file, "time,length", "%.7f", stamps[rows], read[rows] * 1e3)


def _write_counts(
    path: Path,
    dialect: Dialect,
    stamps: NDArray[np.int64],
    counts: Mapping[str, NDArray[np.uint32]],
    status: Mapping[str, NDArray[np.int64]],
) -> None:
    """Write a ball-bar log: time, counters and status words, lines that end in CRLF.

    stamps : (N,) [ns] distributed clock time since 2000-01-01. counts : (N,) uint32 counter values
        by column name. status : (N,) words by encoder, for the columns of the dialect. Source:
        notes/log_formats secs. A.6, A.7.
    """
    words = {name: status[encoder] for encoder, name in dialect.status.items() if encoder in status}
    columns: dict[str, NDArray[np.integer[Any]]] = {**counts, **words}
    if dialect.container == "twincat-scope":
        write_whole(path, _scope_export(stamps, columns))
        return
    rows = np.column_stack((stamps, *(c.astype(np.int64) for c in columns.values())))
    separator = dialect.separators[0]
    lines = [
        separator.join((dialect.time.column, *columns)),
        *(separator.join(map(str, row)) for row in rows.tolist()),
    ]
    write_whole(path, ("\r\n".join(lines) + "\r\n").encode("ascii"))


def _scope_export(
    stamps: NDArray[np.int64], columns: Mapping[str, NDArray[np.integer[Any]]]
) -> bytes:
    """An export of TwinCAT Scope: channels with one column of times, ms from its start."""
    start, end = (int(stamp) // 100 + _DC_FILETIME for stamp in stamps[[0, -1]])
    elapsed = (stamps - stamps[0]).astype(np.float64) * 1e-6  # [ms]
    step = f"{np.median(np.diff(elapsed)):g}"
    count = len(columns)
    metadata = {
        "Name": list(columns),
        "SymbolComment": [""] * count,
        "Data-Type": ["UINT32"] * count,
        "SampleTime[ms]": [step] * count,
        "VariableSize": ["4"] * count,
        "Offset": ["0"] * count,
        "ScaleFactor": ["1"] * count,
        "BitMask": ["0xffffffffffffffff"] * count,
        "Unit": ["(None)"] * count,
        "Unit ScaleFactor": ["1"] * count,
        "Unit Offset": ["0"] * count,
    }
    head = [
        "Name\tballbar",
        "File\tballbar.csv",
        f"Starttime of export\t{start}",
        f"Endtime of export\t{end}",
        "",
        "",
        *("\t".join((key, *values)) for key, values in metadata.items()),
        "",
    ]
    values = np.column_stack([c.astype(np.int64) for c in columns.values()])
    rows = [
        "\t".join((f"{time:g}", *map(str, row)))
        for time, row in zip(elapsed.tolist(), values.tolist(), strict=True)
    ]
    return ("\n".join([*head, *rows]) + "\n").encode("ascii")


def _write_table(path: Path, head: str, form: str, stamps: Array, values: Array) -> None:
    """Write a table of text: stamps (N,) [s] to a microsecond, then values (N,) or (N, K)."""
    rows = np.column_stack((stamps, values))
    line = ",".join(("%.6f", *[form] * (rows.shape[1] - 1)))
    lines = [head, *(line % tuple(row) for row in rows.tolist())]
    write_whole(path, ("\n".join(lines) + "\n").encode("ascii"))


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
    if simulation.instrument and simulation.follower is None:
        sources["length"] = {
            "files": _files("length", simulation.rows),
            "dialect": "length-table",
            "column": "length",
            "unit": "mm",
            "time": "s",
        }
    if settings.logs.force_sensor:
        sources["force"] = {"files": ["raw/force.csv"], "dialect": "force-torque"}
    if tracker := settings.tracker(follower := simulation.follower):
        turns = follower is not None and follower.kind.target_turns
        stated = {"accuracy_m": tracker.noise_m} if tracker.noise_m and follower is None else {}
        sources["tracker"] = {
            "files": ["raw/tracker.csv"],
            "dialect": "tracker-points",
            "time": "s",
            "unit": "mm",
            **({"rotation": {"columns": list(TURNS), "form": "rotvec"}} if turns else {}),
            **stated,
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
        **_temperatures(settings),
        "notes": "",
    }


def _temperatures(settings: SimulationSettings) -> dict[str, float]:
    """The stated temperatures, by their keys."""
    values = ((key, getattr(settings.cell, key)) for key in Temperatures.model_fields)
    return {key: value for key, value in values if value is not None}


def write_poses(simulation: PoseSimulation, settings: SimulationSettings, folder: Path) -> None:
    """Write the table, the truth beside the folder, and `folder/poses.yaml` last."""
    kind, stated = simulation.instrument.kind, settings.needed_poses
    shown = {"m": "mm", "rad": "rad"}
    names = tuple(f"{n} [{shown[u]}]" for n, u in zip(kind.names, kind.units, strict=True))
    axes = [f"A{k + 1} [deg]" for k in range(simulation.robot.joints)]
    points = [f"{point.name}_{axis} [mm]" for point in stated.reference for axis in "xyz"]
    table: dict[str, object] = {"files": [TABLE], "joints": {"columns": axes, "unit": "deg"}}
    if stated.pictures is not None:
        table["pictures"] = write_pictures(stated.pictures, simulation.rows.values, folder)
        names = ()
    elif names:
        values: dict[str, object] = {"columns": list(names)}
        values |= {"unit": "mm"} if "m" in kind.units else {}
        values |= {"rotation": "rotvec"} if kind.target_turns else {}
        values |= {"angle_unit": "rad"} if "rad" in kind.units else {}
        table["values"] = values
    if points:
        table["reference"] = {"columns": points}
    table |= {
        "seat": {"column": "seat"},
        "target": {"column": "target"},
        "time": {"column": "time [s]", "form": "s"},
    }
    content: dict[str, object] = {
        "schema": "ballbar-poses/1",
        "kind": "simulated",
        "robot": settings.cell.robot,
        "instrument": settings.cell.measured_by,
        "tables": [table],
        **_temperatures(settings),
    }
    seats = [place.name for place in stated.seats]
    if simulation.instrument.distance is not None and len(seats) == 2:
        content["distances"] = [{"pairs": [seats]}]
    image = ("image",) if stated.pictures is not None else ()
    head = ("time [s]", "seat", "target", *axes, *names, *points, *image)
    write_whole(folder / TABLE, _table(simulation, head, names).encode())
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "poses.yaml", content)


def _table(simulation: PoseSimulation, head: tuple[str, ...], names: tuple[str, ...]) -> str:
    """The rows as text, below a head; names : of the instrument's columns."""
    rows, lines = simulation.rows, [",".join(head)]
    pictured = rows.values.ndim == 3
    values = rows.values[:, : len(names)].reshape(len(rows.time), -1)
    values = values * [1e3 if "mm" in name else 1.0 for name in names]
    values = np.hstack((values, rows.reference.reshape(len(values), -1) * 1e3))
    axes = np.rad2deg(rows.axes)
    for k, (seat, target) in enumerate(zip(rows.seat, rows.target, strict=True)):
        angles = [f"{angle:.10f}" for angle in axes[k]]  # 2e-12 rad
        read = ["" if np.isnan(value) else f"{value:.8f}" for value in values[k]]
        image = (image_name(k),) if pictured else ()
        lines.append(",".join((f"{rows.time[k]:.3f}", seat, target, *angles, *read, *image)))
    return "\n".join(lines) + "\n"
