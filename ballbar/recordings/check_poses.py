"""`ballbar check` of still poses: what a poses.yaml holds, as text or as data for JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from acquisition.pose_tables import PoseImport
from acquisition.report import report_lines
from ballbar.units import MM
from cell.arrays import Array
from cell.errors import InputError
from cell.pose_file import PosesFile
from cell.poses import PoseGroup
from cell.robot_angles import joints_to_axes

GROUPS_SHOWN = 40
_NAMES = ("x", "y", "z", "rx", "ry", "rz")


def holds_poses(path: Path) -> bool:
    """Whether a folder or file is a table of still poses rather than a recording.

    Raises InputError for a folder that holds both.
    """
    if not path.is_dir():
        return path.suffix == ".yaml" and path.name != "recording.yaml"
    poses = (path / "poses.yaml").exists()
    if poses and (path / "recording.yaml").exists():
        raise InputError(
            f"{path}: holds poses.yaml and recording.yaml. Name {path / 'poses.yaml'}, or move the "
            "recording into a folder of its own."
        )
    return poses


def explain_pose_lines(description: PosesFile) -> list[str]:
    """How each file will be read: columns and units, as poses.yaml declares them."""
    lines = []
    for table in description.tables:
        joints, values = table.joints, table.values
        kind = "controller's axis angles" if joints.angles == "axes" else "DH joint angles"
        lines += [
            *(f"{file}:" for file in table.files),
            f"  joints: {_listed(joints.columns)}; {kind}, in {joints.unit or 'the header unit'}",
        ]
        if values is not None:
            units = [values.unit or "the header unit", values.angle_unit, values.rotation]
            words = ", ".join(unit for unit in units if unit)
            lines.append(f"  values: {_listed(values.columns)}; in {words}")
        if table.reference is not None:
            lines.append(f"  reference points: {_listed(table.reference.columns)}; as the values")
        lines.append(f"  instrument {table.instrument or description.instrument}")
    return lines


def pose_lines(read: PoseImport) -> list[str]:
    """Lines of text: files, repairs, warnings, poses by seat and target, axis ranges."""
    table = read.table
    groups = [f"  {_group_line(group)}" for group in table.groups[:GROUPS_SHOWN]]
    if len(table.groups) > GROUPS_SHOWN:
        groups.append(f"  and {len(table.groups) - GROUPS_SHOWN} more groups")
    distances = [
        f"  {d.seats[0]} to {d.seats[1]}: {d.length * MM:.6g} mm, sigma {d.sigma * MM:.3g} mm"
        for d in table.distances
    ]
    return [
        *report_lines(read.report),
        "POSES",
        f"  {_count(table.size, 'pose')} of {table.robot.title} in "
        f"{_count(len(table.groups), 'group')}: {_count(len(table.seats), 'seat')}, "
        f"{_count(len(table.targets), 'target')}",
        *groups,
        *(["DISTANCES", *distances] if distances else []),
        "AXES",
        *(f"  {line}" for line in _axis_lines(read)),
    ]


def pose_data(read: PoseImport) -> dict[str, Any]:
    """The import report with groups, known distances and axis ranges, as plain data for JSON."""
    table, axes = read.table, _axes(read)
    data = read.report.to_dict()
    data["poses"] = {
        "robot": table.robot.name,
        "instrument": read.description.instrument,
        "poses": table.size,
        "seats": list(table.seats),
        "targets": list(table.targets),
        "groups": [
            {
                "file": group.file,
                "seat": group.seat,
                "target": group.target,
                "measured": group.measured,
                "poses": group.size,
                "lower": group.values.min(axis=0).tolist(),
                "upper": group.values.max(axis=0).tolist(),
                "sigma_median": np.median(group.sigma, axis=0).tolist(),
                "duration_s": None if group.time is None else float(np.ptp(group.time)),
            }
            for group in table.groups
        ],
        "distances": [
            {"seats": list(d.seats), "length_m": d.length, "sigma_m": d.sigma}
            for d in table.distances
        ],
        "axis_lower_rad": axes.min(axis=0).tolist(),
        "axis_upper_rad": axes.max(axis=0).tolist(),
    }
    return data


def _group_line(group: PoseGroup) -> str:
    """One group: seat, target, number of poses, ranges and median sigma."""
    line = (
        f"seat {group.seat}, target {group.target}: {_count(group.size, 'pose')}, {group.measured}"
    )
    lower, upper = group.values.min(axis=0), group.values.max(axis=0)
    names = ("length",) if group.measured == "length" else _NAMES[:3]
    ranges = [
        f"{name} {low * MM:.4g} to {high * MM:.4g}"
        for name, low, high in zip(names, lower, upper, strict=False)
    ]
    sigma = np.median(group.sigma[:, :3], axis=0).max() * MM
    line += f"; {', '.join(ranges)} mm" if ranges else ""
    return f"{line}; sigma {sigma:.3g} mm"


def _axes(read: PoseImport) -> Array:
    """(N, J) [rad] axis angles of all poses."""
    return joints_to_axes(read.table.robot, read.table.q)


def _axis_lines(read: PoseImport) -> list[str]:
    """Range of each axis beside its limits."""
    axes, robot = np.rad2deg(_axes(read)), read.table.robot
    limits = np.rad2deg((robot.axis_lower, robot.axis_upper))
    return [
        f"axis {k + 1}: {low:.5g} to {high:.5g} deg (limits {limits[0, k]:.4g} to "
        f"{limits[1, k]:.4g})"
        for k, (low, high) in enumerate(zip(axes.min(axis=0), axes.max(axis=0), strict=True))
    ]


def _listed(columns: tuple[int | str, ...]) -> str:
    return ", ".join(map(str, columns)) or "as the file has them"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
