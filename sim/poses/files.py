"""A simulated table of still poses as files: poses.csv, poses.yaml, the truth beside the folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.files import portable_name, write_whole, write_yaml
from cell.poses import Measured
from sim.poses.settings import PoseSimulationSettings
from sim.poses.simulate import PoseSimulation
from sim.recording_files import truth_path

TABLE = "poses.csv"
# columns of each kind of instrument
_COLUMNS: dict[Measured, tuple[str, ...]] = {
    "length": ("length [mm]",),
    "point": ("x [mm]", "y [mm]", "z [mm]"),
    "pose": ("x [mm]", "y [mm]", "z [mm]", "rx [rad]", "ry [rad]", "rz [rad]"),
    "socket": (),
}


def write_poses(
    simulation: PoseSimulation, settings: PoseSimulationSettings, folder: Path, *, relative_to: Path
) -> None:
    """Write the table, the truth beside the folder, and `folder/poses.yaml` last.

    relative_to : folder of the scenario; descriptions of one's own that it names are copied.
    """
    write_whole(folder / TABLE, _table(simulation, settings).encode())
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "poses.yaml", _poses_yaml(simulation, settings, relative_to, folder))


def _axis_columns(simulation: PoseSimulation) -> list[str]:
    return [f"A{k + 1} [deg]" for k in range(simulation.robot.joints)]


def _reference_columns(settings: PoseSimulationSettings) -> list[str]:
    return [f"{point.name}_{axis} [mm]" for point in settings.poses.reference for axis in "xyz"]


def _table(simulation: PoseSimulation, settings: PoseSimulationSettings) -> str:
    rows, names = simulation.rows, _COLUMNS[simulation.instrument.measured]
    points = _reference_columns(settings)
    lines = [",".join(("time [s]", "seat", "target", *_axis_columns(simulation), *names, *points))]
    values = rows.values * [1e3 if "mm" in name else 1.0 for name in names]
    values = np.hstack((values, rows.reference.reshape(len(values), -1) * 1e3))
    axes = np.rad2deg(rows.axes)
    for k, (seat, target) in enumerate(zip(rows.seat, rows.target, strict=True)):
        angles = [f"{angle:.10f}" for angle in axes[k]]  # 2e-12 rad
        read = ["" if np.isnan(value) else f"{value:.8f}" for value in values[k]]
        lines.append(",".join((f"{rows.time[k]:.3f}", seat, target, *angles, *read)))
    return "\n".join(lines) + "\n"


def _poses_yaml(
    simulation: PoseSimulation, settings: PoseSimulationSettings, relative_to: Path, folder: Path
) -> dict[str, object]:
    place = {"relative_to": relative_to, "folder": folder}
    instrument = simulation.instrument
    names = _COLUMNS[instrument.measured]
    table: dict[str, object] = {
        "files": [TABLE],
        "joints": {"columns": _axis_columns(simulation), "unit": "deg"},
    }
    if names:
        values: dict[str, object] = {"columns": list(names), "unit": "mm"}
        if instrument.measured == "pose":
            values |= {"rotation": "rotvec", "angle_unit": "rad"}
        table["values"] = values
    if settings.poses.reference:
        table["reference"] = {"columns": _reference_columns(settings)}
    table |= {
        "seat": {"column": "seat"},
        "target": {"column": "target"},
        "time": {"column": "time [s]", "form": "s"},
    }
    content: dict[str, object] = {
        "schema": "ballbar-poses/1",
        "kind": "simulated",
        "robot": portable_name(settings.cell.robot, "robot", **place),
        "instrument": portable_name(settings.cell.instrument, "instrument", **place),
        "tables": [table],
    }
    seats = [place.name for place in settings.poses.seats]
    if instrument.distance is not None and len(seats) == 2:
        content["distances"] = [{"pairs": [seats]}]
    return content
