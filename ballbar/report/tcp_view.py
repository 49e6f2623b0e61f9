"""TCP error over the workspace: against the truth, or what can be said without it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from ballbar.figure_style import AFTER, BEFORE
from ballbar.ident.robot.accuracy import TcpError, accuracy_grid, position_error
from ballbar.report.drawing import Colours
from ballbar.report.line_plot import Distribution, cumulative
from ballbar.report.maps import AFTER_SCALE, BEFORE_SCALE, Sphere, workspace_map
from ballbar.report.numbers import significant
from ballbar.report.section import Section, machine_row, section
from ballbar.result.run_data import RunData
from ballbar.units import MM, PPM

SAME_CELLS = "same cells, with a colour scale of its own (mind the unit)."


@dataclass(frozen=True, eq=False)
class TcpView:
    """TCP error over G poses.

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

    @property
    def scale(self) -> float:
        """Standard deviation of every length in proportion, as the stated uncertainty has it."""
        reach = np.linalg.norm(self.position - self.position.mean(axis=0), axis=1)
        squares = rms(self.stated) ** 2 - rms(self.stated_without_scale) ** 2
        return float(np.sqrt(max(0.0, squares)) / rms(reach))


def tcp_view(data: RunData) -> TcpView:
    """Error against the truth if there is a comparison, else the correction and its uncertainty.

    Over the accuracy grid, or of still poses alone over the fitted ranges.
    """
    robot, comparison = data.identification.robot, data.comparison
    model = robot.identified
    grid = accuracy_grid(model.robot) if data.recordings else model.workspace()
    shift = position_error(model.rigid(robot.nominal).tool(grid), model.tool(grid))
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


def tcp_section(run: RunData, view: TcpView) -> Section:
    """Table, curves and maps."""
    return section(
        "tcp.html",
        {"tcp": "TCP error"},
        machine_row(run),
        heading=f"TCP error over the {'workspace' if run.recordings else 'fitted ranges'}",
        intro=_intro(run, view),
        against_truth=view.against_truth,
        rows=_rows(run, view),
        cumulative=cumulative(
            _distributions(view), label="TCP error" if view.against_truth else "distance of the TCP"
        ),
        curves=f"{view.before_label} and {view.after_label}",
        note=_note(run, view),
        maps=_maps(run, view),
    )


def _intro(data: RunData, view: TcpView) -> str:
    which = "held-out poses" if data.recordings else "random poses within the fitted ranges"
    poses = f"at {view.before.size} {which}, after the best rigid motion of the base frame."
    if data.comparison is None:
        return (
            "The true robot is not known here, so the TCP error itself cannot be stated. Shown are "
            "the correction, which is the distance between nominal and identified model and so an "
            "estimate of the error before, and the stated uncertainty (1 sigma) of the identified "
            f"model, both {poses}"
        )
    tool = "tool position"
    if not data.recordings:
        tool = f"place of target {data.comparison.target}"
    loaded = bool(data.recordings and data.identification.robot.corrections)
    under = " of the unloaded robot under its own weight" if loaded else ""
    return (
        f"Distance between the {tool} that the model predicts and the true one{under}, {poses} "
        "Before: nominal model. After: identified model."
    )


def _note(data: RunData, view: TcpView) -> str:
    predicted = (
        "Predicted before: distance between nominal and identified robot, which is what a real "
        "cell would show. "
    )
    stated = (
        "Stated sigma: in the scale of the instrument, all axes together, what the model leaves "
        "unexplained included."
    )
    if data.recordings:
        stroke = data.identification.robot.cell.ballbar.stroke
        source = "plate and rod give" if stroke is None else "the sensor of the length gives"
        scale = significant(view.scale * PPM, 2)
        stated = (
            f"The stated sigma holds the scale, which {source} to {scale} ppm (1 sigma) of every "
            "length."
        )
    return f"{predicted if view.against_truth else ''}{stated}"


def _maps(data: RunData, view: TcpView) -> list[tuple[Markup, str, str]]:
    """Map, name and caption of before and after."""
    estimates = [fitted.estimate for fitted in data.recordings]
    spheres = [Sphere(e.geometry.origin, e.geometry["bd3"]) for e in estimates]
    caption = "mean of the poses in each cell. Square: robot base."
    if spheres:
        sphere = "ball-bar and the sphere on which the tool was measured"
        if data.identification.robot.cell.ballbar.stroke is not None:
            sphere = "seat, and the sphere of the instrument's nominal length"
        each = ", of each recording" if data.several else ""
        caption += f" Cross and dashed circle: {sphere}{each}."

    def drawn(name: str, error: Array, colours: Colours, words: str) -> tuple[Markup, str, str]:
        label = f"{name}, mean"
        drawing = workspace_map(view.position, error, spheres, label=label, colours=colours)
        return drawing, name, f"{name}, {words}"

    return [
        drawn(view.before_label, view.before, BEFORE_SCALE, caption),
        drawn(view.after_label, view.after, AFTER_SCALE, SAME_CELLS),
    ]


def _rows(data: RunData, view: TcpView) -> list[tuple[str, ...]]:
    predicted = view.predicted.error, "before", view.predicted.error_without_scale
    stated = _tcp_row("stated sigma", view.stated, "after", view.stated_without_scale)
    if data.comparison is None:
        return [_tcp_row("correction", *predicted), stated]
    nominal, identified = data.comparison.tcp_nominal, data.comparison.tcp
    return [
        _tcp_row("before (nominal)", nominal.error, "before", nominal.error_without_scale),
        _tcp_row("after (identified)", identified.error, "after", identified.error_without_scale),
        _tcp_row("predicted before", *predicted),
        stated,
    ]


def _tcp_row(name: str, error: Array, side: str, without_scale: Array) -> tuple[str, ...]:
    """Side and name of errors (G,) [m]; mean, 95 % quantile and largest in mm.

    side : "before" or "after". without_scale : after removing one common scale factor, its mean.
    """
    sizes = error.mean(), np.quantile(error, 0.95), error.max(), without_scale.mean()
    return (side, name, *(significant(float(size) * MM) for size in sizes))


def _distributions(view: TcpView) -> list[Distribution]:
    curves = [
        Distribution(view.before_label, view.before, BEFORE),
        Distribution(view.after_label, view.after, AFTER),
    ]
    if view.against_truth:
        label = "predicted before: nominal against identified"
        curves.append(Distribution(label, view.predicted.error, BEFORE, dashed=True))
        label = "predicted after: stated sigma"
        curves.append(Distribution(label, view.stated, AFTER, dashed=True))
    return curves
