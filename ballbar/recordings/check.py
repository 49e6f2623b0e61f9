"""`ballbar check`: what a recording holds and what was repaired in it, as a page for people or as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from acquisition import CoarseAlignment, Recording, coarse_alignment, find_dwells, report_lines
from acquisition.report import Finding
from cell.arrays import Array
from cell.logs import segment_starts


def check_lines(read: Recording, alignment: CoarseAlignment | None) -> list[str]:
    """The page: files, repairs, warnings, logs, clocks."""
    return [
        *report_lines(read.report),
        "LOGS",
        *(f"  {line}" for line in _log_lines(read)),
        *_clock_lines(alignment),
    ]


def check_data(read: Recording, alignment: CoarseAlignment | None) -> dict[str, Any]:
    """The import report as plain data, ready for JSON."""
    data = read.report.to_dict()
    data["logs"] = {
        name: {
            "rows": int(t.size),
            "duration_s": float(t[-1]),
            "median_period_s": float(np.median(np.diff(t))),
            "segments": len(starts) + 1,
            "rests_s": [[round(float(t[a]), 6), round(float(t[b]), 6)] for a, b in rests],
        }
        for name, t, starts, rests in _logs(read)
    }
    if alignment is not None:
        data["coarse_clock"] = {
            "offset_s": alignment.offset_s,
            "overlap_s": alignment.overlap_s,
            "runner_up_offset_s": alignment.runner_up_offset_s,
        }
    return data


def import_reports(read: Mapping[str, Recording]) -> str:
    """The import reports of recordings, by their names, as JSON text (schema `ballbar-import/1`)."""
    data = {
        "schema": "ballbar-import/1",
        "recordings": {name: check_data(one, None) for name, one in read.items()},
    }
    return json.dumps(data, indent=2, allow_nan=False) + "\n"


def repairs(read: Recording) -> list[Finding]:
    """What was changed or left out while reading."""
    return [one for one in read.report.findings if one.severity == "repaired"]


def aligned(read: Recording) -> CoarseAlignment | None:
    """The coarse clock offset, None without encoders.

    Raises LogError if the logs do not belong together.
    """
    return None if read.ballbar_log is None else coarse_alignment(read.robot_log, read.ballbar_log)


def _logs(read: Recording) -> list[tuple[str, Array, tuple[int, ...], list[tuple[int, int]]]]:
    """(name, times, rows at which segments start, rests as first and last row) of each log."""
    robot, bar, force = read.robot_log, read.ballbar_log, read.force_log
    out = [("robot", robot.t, segment_starts(robot.segment), _rests(robot.t, robot.q))]
    if bar is not None:
        out.append(("ball-bar", bar.t, segment_starts(bar.segment), _rests(bar.t, bar.angles)))
    if force is not None:
        out.append(("force", force.t, (), []))
    return out


def _rests(t: Array, angles: Array) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for a, b in find_dwells(t, angles).intervals]


def _log_lines(read: Recording) -> list[str]:
    bar = read.ballbar_log
    lines = []
    for name, t, starts, rests in _logs(read):
        encoders = (
            f", encoders {', '.join(f'b{j}' for j in bar.joints)}"
            if name == "ball-bar" and bar is not None
            else ""
        )
        torque = (
            ", with motor torques" if name == "robot" and read.robot_log.torque is not None else ""
        )
        cut = (
            f", {len(starts) + 1} segments (new at {', '.join(f'{t[row]:.2f}' for row in starts[:8])} s)"
            if starts
            else ""
        )
        still = ""
        if name != "force":
            total = sum(t[b] - t[a] for a, b in rests)
            still = (
                f"; at rest {len(rests)} times, {total:.1f} s in all"
                if rests
                else "; never at rest"
            )
        period = np.median(np.diff(t)) * 1e3
        lines.append(
            f"{name} log: {t.size} samples over {t[-1]:.2f} s, median period {period:.4g} ms{encoders}{torque}{cut}{still}"
        )
    if bar is None:
        lines.append("no encoders: the ball-bar's length is the only measurement")
    return lines


def _clock_lines(found: CoarseAlignment | None) -> list[str]:
    if found is None:
        return []
    rival = ""
    if found.runner_up_offset_s is not None:
        rival = f"; next best {found.runner_up_offset_s:+.2f} s with {found.runner_up_score / found.score:.0%} of the score"
    return [
        "CLOCKS",
        f"  coarse clock offset: {found.offset_s:+.2f} s over {found.overlap_s:.0f} s of overlap{rival}",
    ]
