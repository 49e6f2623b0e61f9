"""`ballbar check`: content of a recording or of still poses and repairs, as text or JSON data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.acquisition.alignment import CoarseAlignment
from ballbar.acquisition.dwells import find_dwells
from ballbar.acquisition.pose_tables import PoseImport
from ballbar.acquisition.recording import Recording
from ballbar.acquisition.report import Finding, ImportReport, report_lines
from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.logs import segment_starts
from ballbar.cell.pose_file import PosesFile
from ballbar.cell.poses import PoseGroup
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.units import MM, MS

SEGMENTS_SHOWN = 8  # first segments of a log that are listed
GROUPS_SHOWN = 40


def holds_poses(path: Path) -> bool:
    """Whether a folder or file is a table of still poses rather than a recording.

    Raises InputError for a folder that holds both.
    """
    if not path.is_dir():
        return path.suffix == ".yaml" and path.name != "recording.yaml"
    poses = (path / "poses.yaml").exists()
    if poses and (path / "recording.yaml").exists():
        remedy = f"Name {path / 'poses.yaml'}, or move the recording into a folder of its own."
        raise InputError.at(path, "holds poses.yaml and recording.yaml.", remedy)
    return poses


@dataclass(frozen=True, eq=False)
class CheckedRecording:
    """A recording, and the coarse offset of its clocks where it has two."""

    read: Recording
    alignment: CoarseAlignment | None = None

    def lines(self) -> list[str]:
        """Lines of text: files, repairs and warnings; logs and clocks."""
        lines = [*report_lines(self.read.report), "LOGS"]
        lines += (f"  {line}" for line in _log_lines(self.read))
        if (alignment := self.alignment) is not None:
            offset = f"{alignment.offset_s:+.2f} s over {alignment.overlap_s:.0f} s of overlap"
            if alignment.runner_up_offset_s is not None:
                share = alignment.runner_up_score / alignment.score
                second = f"{alignment.runner_up_offset_s:+.2f} s with {share:.0%} of the score"
                offset += f"; next best {second}"
            lines += ["CLOCKS", f"  coarse clock offset: {offset}"]
        return lines

    def data(self) -> dict[str, Any]:
        """The import report, logs and coarse clock offset as plain data for JSON."""
        data = self.read.report.to_dict()
        data["logs"] = {
            name: {
                "rows": int(t.size),
                "duration_s": float(t[-1]),
                "median_period_s": float(np.median(np.diff(t))),
                "segments": len(starts) + 1,
                "rests_s": [[round(float(t[i]), 6) for i in dwell] for dwell in dwells],
            }
            for name, t, starts, dwells in _logs(self.read)
        }
        if self.alignment is not None:
            data["coarse_clock"] = {
                "offset_s": self.alignment.offset_s,
                "overlap_s": self.alignment.overlap_s,
                "runner_up_offset_s": self.alignment.runner_up_offset_s,
            }
        return data


@dataclass(frozen=True, eq=False)
class CheckedPoses:
    """Still poses."""

    read: PoseImport

    def lines(self) -> list[str]:
        """Lines of text: files, repairs and warnings; poses and axis ranges."""
        return [*report_lines(self.read.report), *_pose_lines(self.read)]

    def data(self) -> dict[str, Any]:
        """The import report, groups, known distances and axis ranges as plain data for JSON."""
        return self.read.report.to_dict() | {"poses": _pose_data(self.read)}


def import_reports(recordings: Mapping[str, Recording]) -> str:
    """The import reports of recordings by name, as JSON text of schema `ballbar-import/1`."""
    reports = {name: CheckedRecording(recording).data() for name, recording in recordings.items()}
    data = {"schema": "ballbar-import/1", "recordings": reports}
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def repairs(report: ImportReport) -> list[Finding]:
    """Findings about rows that were changed or left out while reading."""
    return [finding for finding in report.findings if finding.severity == "repaired"]


def _logs(recording: Recording) -> list[tuple[str, Array, tuple[int, ...], list[tuple[int, int]]]]:
    """Each log: name, times t (N,) [s], first rows of new segments, dwells (first, last row)."""

    def dwells(t: Array, angles: Array) -> list[tuple[int, int]]:
        return [(int(first), int(last)) for first, last in find_dwells(t, angles).intervals]

    robot, bar, force = recording.robot_log, recording.ballbar_log, recording.force_log
    logs = [("robot", robot.t, segment_starts(robot.segment), dwells(robot.t, robot.q))]
    if bar is not None:
        logs.append(("ball-bar", bar.t, segment_starts(bar.segment), dwells(bar.t, bar.angles)))
    # A bar on its sphere hardly tells when the robot rests.
    if (length := recording.length_log) is not None:
        logs.append(("length", length.t, segment_starts(length.segment), []))
    if force is not None:
        logs.append(("force", force.t, (), []))
    if (tracker := recording.tracker_log) is not None:
        logs.append(("tracker", tracker.t, segment_starts(tracker.segment), []))
    return logs


def _log_line(
    name: str, t: Array, starts: tuple[int, ...], dwells: list[tuple[int, int]], channels: str
) -> str:
    """One log as `_logs` gives it; channels : words about them."""
    line = (
        f"{name} log: {t.size} samples over {t[-1]:.2f} s, median period "
        f"{np.median(np.diff(t)) * MS:.4g} ms{channels}"
    )
    if starts:
        times = ", ".join(f"{t[row]:.2f}" for row in starts[:SEGMENTS_SHOWN])
        line += f", {len(starts) + 1} segments (new at {times} s)"
    if dwells:
        total = sum(t[last] - t[first] for first, last in dwells)
        return f"{line}; {len(dwells)} dwells, {total:.1f} s in all"
    return line if name in ("force", "length", "tracker") else f"{line}; no dwell"


def _log_lines(recording: Recording) -> list[str]:
    """A line for each log: samples, duration, period, channels, segments, dwells."""
    bar, robot = recording.ballbar_log, recording.robot_log
    channels = {}
    if bar is not None:
        channels["ball-bar"] = f", encoders {', '.join(f'b{j}' for j in bar.joints)}"
    if robot.torque is not None:
        channels["robot"] = ", with motor torques"
    lines = [_log_line(*log, channels.get(log[0], "")) for log in _logs(recording)]
    if bar is None and recording.length_log is None and not recording.description.followed:
        lines.append("no encoders: the ball-bar's length is the only measurement")
    return lines


def explain_poses(description: PosesFile) -> list[str]:
    """How each file of still poses will be read: columns and units, as poses.yaml declares them."""

    def listed(columns: tuple[int | str, ...]) -> str:
        return ", ".join(map(str, columns)) or "as the file has them"

    lines = []
    for table in description.tables:
        joints, values = table.joints, table.values
        kind = "controller's axis angles" if joints.angles == "axes" else "DH joint angles"
        lines += [
            *(f"{file}:" for file in table.files),
            f"  joints: {listed(joints.columns)}; {kind}, in {joints.unit or 'the header unit'}",
        ]
        if values is not None:
            units = [values.unit or "the header unit", values.angle_unit, values.rotation]
            words = ", ".join(unit for unit in units if unit)
            lines.append(f"  values: {listed(values.columns)}; in {words}")
        if table.reference is not None:
            lines.append(f"  reference points: {listed(table.reference.columns)}; as the values")
        lines.append(f"  instrument {table.instrument or description.instrument}")
    return lines


def _pose_lines(read: PoseImport) -> list[str]:
    """Poses by seat and target, known distances, and the range of each axis beside its limits."""
    table, robot = read.table, read.table.robot
    groups = [f"  {_group_line(group)}" for group in table.groups[:GROUPS_SHOWN]]
    if len(table.groups) > GROUPS_SHOWN:
        groups.append(f"  and {len(table.groups) - GROUPS_SHOWN} more groups")
    distances = [
        f"  {d.seats[0]} to {d.seats[1]}: {d.length * MM:.6g} mm, sigma {d.sigma * MM:.3g} mm"
        for d in table.distances
    ]
    return [
        "POSES",
        f"  {_count(table.size, 'pose')} of {robot.title} in "
        f"{_count(len(table.groups), 'group')}: {_count(len(table.seats), 'seat')}, "
        f"{_count(len(table.targets), 'target')}",
        *groups,
        *(["DISTANCES", *distances] if distances else []),
        "AXES",
        *_axis_lines(robot, table.q),
    ]


def _axis_lines(robot: Robot, q: Array) -> list[str]:
    """The range of each axis at joint angles q (N, J) [rad] beside its limits."""
    axes = joints_to_axes(robot, q)
    ends = (axes.min(axis=0), axes.max(axis=0), robot.axis_lower, robot.axis_upper)
    return [
        f"  axis {k}: {low:.5g} to {high:.5g} deg (limits {lower:.4g} to {upper:.4g})"
        for k, (low, high, lower, upper) in enumerate(np.rad2deg(ends).T, 1)
    ]


def _group_data(group: PoseGroup) -> dict[str, Any]:
    return {
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


def _pose_data(read: PoseImport) -> dict[str, Any]:
    """Groups, known distances and axis ranges."""
    table = read.table
    axes = joints_to_axes(table.robot, table.q)
    return {
        "robot": table.robot.name,
        "instrument": read.description.instrument or "",
        "poses": table.size,
        "seats": list(table.seats),
        "targets": list(table.targets),
        "groups": [_group_data(group) for group in table.groups],
        "distances": [
            {"seats": list(d.seats), "length_m": d.length, "sigma_m": d.sigma}
            for d in table.distances
        ],
        "axis_lower_rad": axes.min(axis=0).tolist(),
        "axis_upper_rad": axes.max(axis=0).tolist(),
    }


def _group_line(group: PoseGroup) -> str:
    """One group: seat, target, number of poses, ranges and median sigma."""
    lower, upper = group.values.min(axis=0), group.values.max(axis=0)
    ranges = ", ".join(
        f"{name} {low * MM:.4g} to {high * MM:.4g}"
        for name, low, high in zip(group.kind.names[:3], lower, upper, strict=False)
    )
    unit = "mrad" if group.kind.units[:1] == ("rad",) else "mm"
    sigma = np.median(group.sigma[:, :3], axis=0).max() * MM
    poses = f"seat {group.seat}, target {group.target}: {_count(group.size, 'pose')}"
    spread = f"; {ranges} {unit}" if ranges else ""
    return f"{poses}, {group.measured}{spread}; sigma {sigma:.3g} {unit}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
