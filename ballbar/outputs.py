"""The files that a run or an identification leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from ballbar.recordings.check import import_reports
from ballbar.result.calibration import write_calibration
from ballbar.result.names import CALIBRATION, IMPORT_REPORT, REPLAY, REPORT
from ballbar.result.run_data import RunData
from cell.files import write_whole
from cell.processes import Begin

SENT_ROWS = 500_000  # of the robot's logs, half an hour at 250 Hz

Progress = Callable[[str], None]


def write_outputs(
    out: Path,
    data: RunData,
    *,
    command: str,
    replay: bool,
    progress: Progress,
    begin: Begin = partial,
) -> None:
    """Writes calibration.yaml, import_report.json, report.html and, with `replay`, run.rrd.

    begin : draws maps and writes the replay meanwhile (ballbar.report.process).
    """
    from ballbar.report.page import begin_parts, write_report  # noqa: PLC0415  imports Jinja

    if sum(recording.robot_log.t.size for _, _, recording in data.read) > SENT_ROWS:
        begin = partial  # a second process would hold the logs twice more
    parts = begin_parts(data, begin)
    written = begin(_replay, out / REPLAY, data) if replay else None
    reports = {name: recording for name, _, recording in data.read}
    write_whole(out / IMPORT_REPORT, import_reports(reports).encode())
    write_calibration(out / CALIBRATION, data)
    progress("writing the report")
    write_report(out / REPORT, data, parts, command=command)
    if written is not None:
        progress("writing the replay")
        written()


def _replay(path: Path, data: RunData) -> None:
    from ballbar.replay.write import write_replay  # noqa: PLC0415  imports Rerun

    write_replay(path, data)
