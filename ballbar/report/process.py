"""A second process that draws some of a report."""

from __future__ import annotations

from contextlib import AbstractContextManager

from cell.processes import Begin, second_process


def reporting_process(*, replay: bool) -> AbstractContextManager[Begin]:
    """The process, begun before logs are read: it imports its libraries while they are fitted.

    replay : whether it writes a replay, too.
    """
    report = ("page", "sphere", "cell_picture")
    modules = [f"ballbar.report.{name}" for name in report]
    modules += ["matplotlib.backends.backend_svg"]
    if replay:
        modules += ["ballbar.replay.write", "pandas"]  # Arrow looks for it at Rerun's first array
    return second_process(*modules)
