"""The files that a run or an identification leaves in its folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from ballbar.cell.files import write_whole
from ballbar.cell.processes import Begin
from ballbar.ident.options import SILENT
from ballbar.recordings.check import import_reports
from ballbar.result.names import CALIBRATION, IMPORT_REPORT, REPLAY, REPORT
from ballbar.result.run_data import RunData
from ballbar.result.write_calibration import RefusedResultError, write_calibration

SENT_ROWS = 500_000  # of the robot's logs, half an hour at 250 Hz

Progress = Callable[[str], None]


def write_outputs(
    out: Path,
    run: RunData,
    *,
    command: str = "ballbar.identify",
    replay: bool = False,
    progress: Progress = SILENT.progress,
    begin: Begin = partial,
) -> None:
    """Writes calibration.yaml, report.html, with `replay` run.rrd, and of logs import_report.json.

    begin : writes the replay meanwhile (ballbar.cell.processes).

    Raises RefusedResultError, once all else is written, where the reader refuses calibration.yaml.
    """
    from ballbar.report.page import write_report  # noqa: PLC0415  imports Jinja

    rows = sum(recording.robot_log.t.size for _, recording in run.read)
    if rows > SENT_ROWS or not run.recordings:
        # a second process would hold the logs twice more; poses compute what they cache meanwhile
        begin = partial
    written = begin(_replay, out / REPLAY, run) if replay else None
    refusal = None
    try:
        write_calibration(out / CALIBRATION, run)
    except RefusedResultError as error:
        refusal = error
    if not run.recordings:
        (out / IMPORT_REPORT).unlink(missing_ok=True)  # of logs that were identified before
    else:
        reports = dict(run.read)
        write_whole(out / IMPORT_REPORT, import_reports(reports).encode())
    progress("writing the report")
    write_report(out / REPORT, run, command=command)
    if written is not None:
        progress("writing the replay")
        written()
    if refusal is not None:
        raise refusal


def _replay(path: Path, run: RunData) -> None:
    from ballbar.replay.write import write_replay  # noqa: PLC0415  imports Rerun

    write_replay(path, run)
