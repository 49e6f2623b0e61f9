"""TCP error over the workspace: against the truth, or what can be said without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbar.figure_style import AFTER, BEFORE
from ballbar.report.line_plot import Distribution, cumulative
from ballbar.report.maps import AFTER_SCALE, BEFORE_SCALE, Sphere, workspace_map
from ballbar.report.numbers import MISSING, significant
from ballbar.result.run_data import RunData
from ballbar.units import MM, PPM
from cell.arrays import Array
from cell.statistics import rms
from ident.robot.accuracy import TcpError, accuracy_grid, position_error
from ident.robot.unloaded_robot import UnloadedRobot


@dataclass(frozen=True, eq=False)
class TcpView:
    """TCP error over the G poses of the accuracy grid.

    Where the truth is not known, `before` is the distance between nominal and identified model, and
    `after` the stated uncertainty of the identified one.
    """

    against_truth: bool
    position: Array  # (G, 3) [m] robot base frame
    before: Array  # (G,) [m] error of the nominal model
    after: Array  # (G,) [m] error of the identified model
    before_label: str
    after_label: str
    predicted: TcpError  # distance between nominal and identified model
    stated: Array  # (G,) [m] stated uncertainty of the identified model, with the scale
    stated_without_scale: Array  # (G,) [m]


@dataclass(frozen=True)
class TcpRow:
    """One row of the table, in mm."""

    name: str
    mean: str
    quantile: str  # 95 % of the poses lie below
    largest: str
    without_scale: str  # mean after removing one common scale factor
    side: str  # "before" or "after"


@dataclass(frozen=True, eq=False)
class TcpSection:
    """What the page shows of a TcpView."""

    view: TcpView
    rows: list[TcpRow]
    cumulative: str
    map_before: str
    map_after: str
    scale_ppm: float  # standard deviation of every length in proportion, as the stated sigma has it


def tcp_view(data: RunData) -> TcpView:
    """Error against the truth if there is a comparison, else the correction and its uncertainty."""
    robot = data.identification.robot
    grid = accuracy_grid(robot.cell.robot)
    nominal = UnloadedRobot(robot.cell, robot.nominal).tool(grid)
    shift = position_error(nominal, robot.unloaded().tool(grid))
    comparison = data.comparison
    return TcpView(
        against_truth=comparison is not None,
        position=comparison.tcp_nominal.position if comparison else shift.position,
        before=comparison.tcp_nominal.error if comparison else shift.error,
        after=comparison.tcp.error if comparison else robot.tcp_sigma,
        before_label="TCP error before" if comparison else "TCP correction",
        after_label="TCP error after" if comparison else "Stated TCP sigma",
        predicted=shift,
        stated=robot.tcp.sigma,
        stated_without_scale=robot.tcp.without_scale,
    )


def tcp_section(data: RunData, view: TcpView) -> TcpSection:
    """Table, curves and maps of the TCP view."""
    estimates = [fitted.estimate for fitted in data.recordings]
    spheres = [Sphere(e.geometry.origin, e.geometry["bd3"]) for e in estimates]
    before, after = (f"{label}, mean" for label in (view.before_label, view.after_label))
    quantity = "TCP error" if view.against_truth else "distance of the TCP"
    return TcpSection(
        view=view,
        rows=_rows(data, view),
        cumulative=cumulative(_distributions(view), label=quantity),
        map_before=workspace_map(
            view.position, view.before, spheres, label=before, colours=BEFORE_SCALE
        ),
        map_after=workspace_map(
            view.position, view.after, spheres, label=after, colours=AFTER_SCALE
        ),
        scale_ppm=_scale(view) * PPM,
    )


def _scale(view: TcpView) -> float:
    """Relative standard deviation of the scale in the stated uncertainty."""
    reach = np.linalg.norm(view.position - view.position.mean(axis=0), axis=1)
    squares = rms(view.stated) ** 2 - rms(view.stated_without_scale) ** 2
    return float(np.sqrt(max(0.0, squares)) / rms(reach))


def _rows(data: RunData, view: TcpView) -> list[TcpRow]:
    if data.comparison is None:
        rows = [_row("correction", view.predicted, "before")]
    else:
        nominal, identified = data.comparison.tcp_nominal, data.comparison.tcp
        rows = [
            _row("before (nominal)", nominal, "before"),
            _row("after (identified)", identified, "after"),
            _row("predicted before", view.predicted, "before"),
        ]
    stated = tcp_row("stated sigma", view.stated, "after", view.stated_without_scale)
    return [*rows, stated]


def _row(name: str, error: TcpError, side: str) -> TcpRow:
    return tcp_row(name, error.error, side, error.error_without_scale)


def tcp_row(name: str, error: Array, side: str, without_scale: Array | None = None) -> TcpRow:
    """The row of errors (G,) [m]; without_scale : after removing one common scale factor."""
    mean, quantile, largest = error.mean(), np.quantile(error, 0.95), error.max()
    return TcpRow(
        name=name,
        mean=significant(float(mean) * MM),
        quantile=significant(float(quantile) * MM),
        largest=significant(float(largest) * MM),
        without_scale=MISSING
        if without_scale is None
        else significant(float(without_scale.mean()) * MM),
        side=side,
    )


def _distributions(view: TcpView) -> list[Distribution]:
    curves = [
        Distribution(view.before_label, view.before, BEFORE),
        Distribution(view.after_label, view.after, AFTER),
    ]
    if view.against_truth:
        label = "predicted before: nominal against identified"
        curves.append(Distribution(label, view.predicted.error, BEFORE, dashed=True))
        curves.append(
            Distribution("predicted after: stated sigma", view.stated, AFTER, dashed=True)
        )
    return curves
