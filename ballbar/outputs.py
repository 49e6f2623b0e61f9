"""The files that a run or an identification leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from ballbar.recordings.check import import_reports
from ballbar.result.names import CALIBRATION, IMPORT_REPORT, REPLAY, REPORT
from ballbar.result.run_data import PoseRun, RunData
from ballbar.result.write_calibration import RefusedResultError, write_calibration
from cell.files import write_whole
from cell.processes import Begin

SENT_ROWS = 500_000  # of the robot's logs, half an hour at 250 Hz

Progress = Callable[[str], None]


def write_outputs(
    out: Path,
    run: RunData | PoseRun,
    *,
    command: str,
    replay: bool,
    progress: Progress,
    begin: Begin = partial,
) -> None:
    """Writes calibration.yaml, report.html, of logs import_report.json and, with `replay`, run.rrd.

    begin : draws maps and writes the replay meanwhile (ballbar.report.process).

    Raises RefusedResultError, once all else is written, where the reader refuses calibration.yaml.
    """
    if isinstance(run, RunData):
        from ballbar.report.page import begin_parts, write_report  # noqa: PLC0415  imports Jinja

        if sum(recording.robot_log.t.size for _, _, recording in run.read) > SENT_ROWS:
            begin = partial  # a second process would hold the logs twice more
        parts = begin_parts(run, begin)
        report = partial(write_report, out / REPORT, run, parts, command=command)
        reports = import_reports({name: recording for name, _, recording in run.read})
        write_whole(out / IMPORT_REPORT, reports.encode())
    else:
        from ballbar.report.pose_page import write_pose_report  # noqa: PLC0415  imports Jinja

        report = partial(write_pose_report, out / REPORT, run, run.comparison, command=command)
    written = begin(_replay, out / REPLAY, run) if replay else None
    refusal = None
    try:
        write_calibration(out / CALIBRATION, run)
    except RefusedResultError as error:
        refusal = error
    progress("writing the report")
    report()
    if written is not None:
        progress("writing the replay")
        written()
    if refusal is not None:
        raise refusal


def _replay(path: Path, run: RunData | PoseRun) -> None:
    if isinstance(run, RunData):
        from ballbar.replay.write import write_replay  # noqa: PLC0415  imports Rerun

        write_replay(path, run)
    else:
        from ballbar.replay.pose_replay import write_pose_replay  # noqa: PLC0415

        write_pose_replay(path, run)
