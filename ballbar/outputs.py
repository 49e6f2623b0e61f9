"""The files that a run or an identification leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ballbar.recordings.check import import_reports
from ballbar.result.names import CALIBRATION, IMPORT_REPORT, REPLAY, REPORT
from ballbar.result.run_data import RunData
from ballbar.result.write_calibration import RefusedResultError, write_calibration
from cell.files import write_whole
from cell.processes import Begin

if TYPE_CHECKING:  # an identification of recordings does without still poses
    from ballbar.result.compare_poses import PoseComparison
    from ballbar.result.pose_run import PoseRun

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

    Raises RefusedResultError, once all else is written, where the reader refuses calibration.yaml.
    """
    from ballbar.report.page import begin_parts, write_report  # noqa: PLC0415  imports Jinja

    if sum(recording.robot_log.t.size for _, _, recording in data.read) > SENT_ROWS:
        begin = partial  # a second process would hold the logs twice more
    parts = begin_parts(data, begin)
    written = begin(_replay, out / REPLAY, data) if replay else None
    refusal = _refusal(partial(write_calibration, out / CALIBRATION, data))
    reports = {name: recording for name, _, recording in data.read}
    write_whole(out / IMPORT_REPORT, import_reports(reports).encode())
    progress("writing the report")
    write_report(out / REPORT, data, parts, command=command)
    if written is not None:
        progress("writing the replay")
        written()
    if refusal is not None:
        raise refusal


def write_pose_outputs(
    out: Path,
    run: PoseRun,
    comparison: PoseComparison | None = None,
    *,
    command: str,
    replay: bool,
    progress: Progress,
) -> None:
    """Writes calibration.yaml, report.html and, with `replay`, run.rrd of still poses.

    Raises as `write_outputs`.
    """
    from ballbar.report.pose_page import write_pose_report  # noqa: PLC0415  imports Matplotlib

    refusal = _refusal(partial(write_calibration, out / CALIBRATION, run))
    progress("writing the report")
    write_pose_report(out / REPORT, run, comparison, command=command)
    if replay:
        from ballbar.replay.pose_replay import write_pose_replay  # noqa: PLC0415  imports Rerun

        progress("writing the replay")
        write_pose_replay(out / REPLAY, run)
    if refusal is not None:
        raise refusal


def _refusal(write: Callable[[], None]) -> RefusedResultError | None:
    """Writes a result; its refusal is to be raised once all else is written."""
    try:
        write()
    except RefusedResultError as error:
        return error
    return None


def _replay(path: Path, data: RunData) -> None:
    from ballbar.replay.write import write_replay  # noqa: PLC0415  imports Rerun

    write_replay(path, data)
