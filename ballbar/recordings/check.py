"""`ballbar check`: content of a recording and repairs, as text for people or JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.alignment import CoarseAlignment, coarse_alignment
from acquisition.dwells import find_dwells
from acquisition.recording import Recording
from acquisition.report import Finding, ImportReport, report_lines
from ballbar.units import MS
from cell.arrays import Array
from cell.load import load_measured_cell
from cell.logs import segment_starts

SEGMENTS_SHOWN = 8  # first segments of a log that are listed


def check_lines(recording: Recording, alignment: CoarseAlignment | None) -> list[str]:
    """Lines of text: files, repairs, warnings, logs, clocks."""
    return [
        *report_lines(recording.report),
        "LOGS",
        *(f"  {line}" for line in _log_lines(recording)),
        *_clock_lines(alignment),
    ]


def check_data(recording: Recording, alignment: CoarseAlignment | None) -> dict[str, Any]:
    """The import report with its logs and the coarse clock offset, as plain data for JSON."""
    data = recording.report.to_dict()
    data["logs"] = {
        name: {
            "rows": int(t.size),
            "duration_s": float(t[-1]),
            "median_period_s": float(np.median(np.diff(t))),
            "segments": len(starts) + 1,
            "rests_s": [[round(float(t[i]), 6) for i in dwell] for dwell in dwells],
        }
        for name, t, starts, dwells in _logs(recording)
    }
    if alignment is not None:
        data["coarse_clock"] = {
            "offset_s": alignment.offset_s,
            "overlap_s": alignment.overlap_s,
            "runner_up_offset_s": alignment.runner_up_offset_s,
        }
    return data


def import_reports(recordings: Mapping[str, Recording]) -> str:
    """The import reports of recordings by name, as JSON text of schema `ballbar-import/1`."""
    reports = {name: check_data(recording, None) for name, recording in recordings.items()}
    data = {"schema": "ballbar-import/1", "recordings": reports}
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def repairs(report: ImportReport) -> list[Finding]:
    """What was changed or left out while reading."""
    return [finding for finding in report.findings if finding.severity == "repaired"]


def aligned(recording: Recording, folder: Path) -> CoarseAlignment | None:
    """The coarse clock offset, None without encoders.

    folder : of the recording, for the descriptions that it names.

    Raises LogError if the logs do not belong together.
    """
    if recording.length_log is not None:
        from ballbar.recordings.length_clock import length_alignment  # noqa: PLC0415  slow

        named = recording.description
        cell = load_measured_cell(named.robot, named.measured_by, named.plate, relative_to=folder)
        return length_alignment(recording, cell)
    bar = recording.ballbar_log
    return None if bar is None else coarse_alignment(recording.robot_log, bar)


def _logs(recording: Recording) -> list[tuple[str, Array, tuple[int, ...], list[tuple[int, int]]]]:
    """Each log: name, times t (N,) [s], first rows of new segments, dwells (first, last row)."""
    robot, bar, force = recording.robot_log, recording.ballbar_log, recording.force_log
    logs = [("robot", robot.t, segment_starts(robot.segment), _dwells(robot.t, robot.q))]
    if bar is not None:
        logs.append(("ball-bar", bar.t, segment_starts(bar.segment), _dwells(bar.t, bar.angles)))
    if recording.length_log is not None:
        length = recording.length_log  # a bar on its sphere hardly tells when the robot rests
        logs.append(("length", length.t, segment_starts(length.segment), []))
    if force is not None:
        logs.append(("force", force.t, (), []))
    if (tracker := recording.tracker_log) is not None:
        logs.append(("tracker", tracker.t, segment_starts(tracker.segment), []))
    return logs


def _dwells(t: Array, angles: Array) -> list[tuple[int, int]]:
    """First and last row of each dwell; t (N,) [s], angles (N, J) [rad]."""
    return [(int(first), int(last)) for first, last in find_dwells(t, angles).intervals]


def _log_lines(recording: Recording) -> list[str]:
    """A line for each log: samples, duration, period, channels, segments, dwells."""
    bar, robot = recording.ballbar_log, recording.robot_log
    channels = {}
    if bar is not None:
        channels["ball-bar"] = f", encoders {', '.join(f'b{j}' for j in bar.joints)}"
    if robot.torque is not None:
        channels["robot"] = ", with motor torques"
    lines = []
    for name, t, starts, dwells in _logs(recording):
        line = (
            f"{name} log: {t.size} samples over {t[-1]:.2f} s, median period "
            f"{np.median(np.diff(t)) * MS:.4g} ms{channels.get(name, '')}"
        )
        if starts:
            times = ", ".join(f"{t[row]:.2f}" for row in starts[:SEGMENTS_SHOWN])
            line += f", {len(starts) + 1} segments (new at {times} s)"
        if dwells:
            total = sum(t[last] - t[first] for first, last in dwells)
            line += f"; {len(dwells)} dwells, {total:.1f} s in all"
        elif name not in ("force", "length", "tracker"):
            line += "; no dwell"
        lines.append(line)
    if bar is None and recording.length_log is None:
        lines.append("no encoders: the ball-bar's length is the only measurement")
    return lines


def _clock_lines(alignment: CoarseAlignment | None) -> list[str]:
    """The coarse clock offset and its runner-up, below a heading."""
    if alignment is None:
        return []
    offset = f"{alignment.offset_s:+.2f} s over {alignment.overlap_s:.0f} s of overlap"
    if alignment.runner_up_offset_s is not None:
        share = alignment.runner_up_score / alignment.score
        offset += f"; next best {alignment.runner_up_offset_s:+.2f} s with {share:.0%} of the score"
    return ["CLOCKS", f"  coarse clock offset: {offset}"]
