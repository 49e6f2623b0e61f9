"""A second process that draws some of a report."""

from __future__ import annotations

from contextlib import AbstractContextManager

from cell.processes import Begin, second_process


def reporting_process() -> AbstractContextManager[Begin]:
    """The process, begun before logs are read: it imports its libraries while they are fitted."""
    return second_process("ballbar.report.page", "matplotlib.backends.backend_svg")
