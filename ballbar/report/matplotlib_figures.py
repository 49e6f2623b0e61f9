"""Maps and pictures of the report, by functions that import Matplotlib only when they draw."""

from __future__ import annotations

from dataclasses import dataclass

from ballbar.result.run_data import FittedRecording
from cell.descriptions import Cell
from ident.estimator.uncertainty import correlated_groups
from ident.result import RobotEstimate


@dataclass(frozen=True)
class SphereFigures:
    """Residuals of a recording on the sphere."""

    before: str
    after: str


def sphere_figures(fitted: FittedRecording) -> SphereFigures:
    """Residuals before and after the fit."""
    from ballbar.report import figures, sphere  # noqa: PLC0415  imports Matplotlib

    directions, angles = sphere.tool_directions(fitted), fitted.recording.length_log is None
    return SphereFigures(
        *(
            sphere.sphere_map(directions, residuals, colours, angles=angles)
            for residuals, colours in (
                (fitted.estimate.before, figures.BEFORE_SCALE),
                (fitted.estimate.after, figures.AFTER_SCALE),
            )
        )
    )


def cell_figure(cell: Cell, fitted: FittedRecording) -> str:
    """The identified cell in the middle of a recording."""
    from ballbar.report.cell_picture import cell_picture  # noqa: PLC0415  imports Matplotlib

    return cell_picture(cell, fitted)


def correlation_figure(robot: RobotEstimate) -> str:
    """Correlations among the members of each strongly correlated group; empty where none is."""
    from ballbar.report.sphere import correlation_map  # noqa: PLC0415  imports Matplotlib

    covariance = robot.covariance
    return correlation_map(covariance, correlated_groups(covariance.values, covariance.names))
