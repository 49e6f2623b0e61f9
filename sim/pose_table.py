"""A simulated table of still poses as files: poses.csv, poses.yaml, the truth beside the folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.files import portable_name, write_whole, write_yaml
from cell.poses import Measured
from sim.recording_files import truth_path
from sim.still_poses import PoseSimulation
from sim.still_settings import PoseSimulationSettings

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
    names = _COLUMNS[simulation.instrument.measured]
    axes = [f"A{k + 1} [deg]" for k in range(simulation.robot.joints)]
    points = [f"{point.name}_{axis} [mm]" for point in settings.poses.reference for axis in "xyz"]
    table: dict[str, object] = {"files": [TABLE], "joints": {"columns": axes, "unit": "deg"}}
    if names:
        values: dict[str, object] = {"columns": list(names), "unit": "mm"}
        if simulation.instrument.measured == "pose":
            values |= {"rotation": "rotvec", "angle_unit": "rad"}
        table["values"] = values
    if points:
        table["reference"] = {"columns": points}
    table |= {
        "seat": {"column": "seat"},
        "target": {"column": "target"},
        "time": {"column": "time [s]", "form": "s"},
    }
    place = {"relative_to": relative_to, "folder": folder}
    content: dict[str, object] = {
        "schema": "ballbar-poses/1",
        "kind": "simulated",
        "robot": portable_name(settings.cell.robot, "robot", **place),
        "instrument": portable_name(settings.cell.instrument, "instrument", **place),
        "tables": [table],
    }
    seats = [place.name for place in settings.poses.seats]
    if simulation.instrument.distance is not None and len(seats) == 2:
        content["distances"] = [{"pairs": [seats]}]
    head = ("time [s]", "seat", "target", *axes, *names, *points)
    write_whole(folder / TABLE, _table(simulation, head, names).encode())
    simulation.truth.write(truth_path(folder))
    write_yaml(folder / "poses.yaml", content)


def _table(simulation: PoseSimulation, head: tuple[str, ...], names: tuple[str, ...]) -> str:
    """The rows as text, below a head; names : of the instrument's columns."""
    rows, lines = simulation.rows, [",".join(head)]
    values = rows.values * [1e3 if "mm" in name else 1.0 for name in names]
    values = np.hstack((values, rows.reference.reshape(len(values), -1) * 1e3))
    axes = np.rad2deg(rows.axes)
    for k, (seat, target) in enumerate(zip(rows.seat, rows.target, strict=True)):
        angles = [f"{angle:.10f}" for angle in axes[k]]  # 2e-12 rad
        read = ["" if np.isnan(value) else f"{value:.8f}" for value in values[k]]
        lines.append(",".join((f"{rows.time[k]:.3f}", seat, target, *angles, *read)))
    return "\n".join(lines) + "\n"
