"""Pictures of a plan as SVG.

A plan shows the trajectory on the sphere, axes over time against their ranges, loads, and the
predicted uncertainties; a what-if study and thesis Fig. 4.4 are pictures of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from ballbar.cell.geometry import bar_frames
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.figure_style import FAINT, FRAME, INK, LINES, QUIET, logarithmic, svg_text
from ballbar.plan.beam import GRAVITY
from ballbar.plan.plate_figure import MATERIALS, THICKNESS, draw_deflection
from ballbar.planning.crlb import EXACT
from ballbar.planning.plan import PathPlan
from ballbar.planning.what_if import Answer
from ballbar.units import MM, UM

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

STYLE: dict[RcKeyType, Any] = {
    **FRAME,
    "svg.hashsalt": "plan",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.prop_cycle": cycler(color=LINES),
    "lines.linewidth": 1.2,
}
_UNKNOWNS_SHOWN = ("ra", "rd", "ralpha", "rtheta", "rbeta", "compliance", "backlash")  # prefixes


def plan_picture(plan: PathPlan) -> bytes:
    """SVG of a plan: sphere, axes, loads or lengths, uncertainties."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.0), layout="constrained")
        grid = figure.subplot_mosaic([["sphere", "axes"], ["load", "sigma"]])
        _sphere(grid["sphere"], plan)
        _axes(grid["axes"], plan)
        _along_rod(grid["load"], plan)
        _sigma(grid["sigma"], plan)
        sigma = f"{np.median(plan.tcp) * UM:.1f} um rms over the workspace"
        figure.suptitle(f"{plan.request.name}: predicted TCP sigma {sigma}", x=0.01, ha="left")
        return svg_text(figure).encode()


def what_if_picture(plan: PathPlan, answers: Sequence[Answer]) -> bytes:
    """SVG of the expected TCP error over the values of each what-if question, a panel for each.

    Filled marks: from the trajectory; open marks: with the error of the scale added.
    """
    keys = list(dict.fromkeys(answer.key for answer in answers))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.2 * len(keys) + 0.6, 3.0), layout="constrained")
        panels = np.atleast_1d(figure.subplots(1, len(keys), sharey=True))
        for axes, key in zip(panels, keys, strict=True):
            of_key = [answer for answer in answers if answer.key == key]
            tcp = np.array([a.tcp for a in of_key], dtype=np.float64) * UM  # None: no mark
            total = np.array([a.total for a in of_key], dtype=np.float64) * UM
            axes.plot(tcp, "o-", color=INK, label="from the path")
            axes.plot(total, "o--", color=INK, mfc="white", label="and the scale")
            axes.axhline(plan.evaluation.tcp * UM, color=FAINT, lw=0.8)
            axes.set_xticks(range(len(of_key)), [a.value for a in of_key], rotation=30, ha="right")
            axes.set_title(key.replace("_", " "))
        figure.axes[0].set_ylim(bottom=0.0)  # shared by all panels, once all is drawn
        figure.axes[0].set_ylabel("TCP sigma [um rms]")
        figure.axes[0].legend(frameon=False, fontsize=7)
        return svg_text(figure).encode()


def plate_picture() -> bytes:
    """SVG of thesis Fig. 4.4: tip deflection and mass over thickness, aluminium and steel."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 3.0), layout="constrained")
        deflection, mass = figure.subplots(1, 2)
        draw_deflection(deflection)
        for material in MATERIALS.values():
            plates = [replace(material, thickness=float(h)) for h in THICKNESS]
            mass.plot(THICKNESS * MM, [p.weight * p.length / GRAVITY for p in plates])
        deflection.set_ylabel("deflection [um], or urad from 1 m")
        mass.set(xlabel="thickness [mm]", ylabel="mass [kg]", ylim=(0.0, None))
        deflection.legend()
        return svg_text(figure).encode()


def _sphere(axes: Axes, plan: PathPlan) -> None:
    """The rod's direction from above, in Lambert's azimuthal equal-area projection."""
    x, y, z = bar_frames(plan.trajectory.nominal, plan.trajectory.b).z[2]
    scale = np.sqrt(2.0 / (1.0 + np.clip(z, -0.999, 1.0)))
    axes.plot(scale * x, scale * y, color=INK, lw=1.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    for degrees in (30, 60, 90, 120):
        radius = 2.0 * np.sin(0.5 * np.radians(degrees))
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=FAINT, lw=0.6)
        axes.text(0.0, radius, f"{degrees}°", color=QUIET, fontsize=7, ha="center")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(
        "rod's direction from above (robot's x to the right); "
        f"{plan.coverage:.0%} of the sphere within 10°"
    )


def _axes(axes: Axes, plan: PathPlan) -> None:
    """Axis angles over time, as a share of their ranges."""
    robot, trajectory = plan.evaluator.cell.robot, plan.trajectory
    angles = joints_to_axes(robot, trajectory.q)
    share = (angles - robot.axis_lower) / (robot.axis_upper - robot.axis_lower)
    for k in range(robot.joints):
        axes.plot(trajectory.t, share[:, k], lw=1.0, label=f"{k + 1}")
    axes.set_ylim(0.0, 1.0)
    axes.set(xlabel="time [s]", ylabel="axis angle, share of its range")
    axes.legend(ncols=6, loc="upper center", title="axis", fontsize=7, title_fontsize=7)


def _along_rod(axes: Axes, plan: PathPlan) -> None:
    """Expected force in the rod over time, or length of a telescoping bar, with each drawn robot.

    Bold: the median of the forces, or the ends of the stroke. Where nothing holds the tool, its
    place.
    """
    t, forces, lengths = plan.trajectory.t, plan.forces, plan.lengths
    if lengths is not None:
        nominal = plan.evaluator.cell.ballbar.length
        for length in lengths.length:
            axes.plot(t, (length - nominal) * MM, color=FAINT, lw=0.7)
        for end in lengths.stroke:
            axes.axhline((end - nominal) * MM, color=INK, lw=1.2)
        label, robots = "length of the bar less nominal [mm]", len(lengths.length)
        title = f"expected of {robots} robots with 1 mm, 1 mrad; bold: the stroke"
    elif forces is None:
        axes.plot(t, plan.trajectory.tip, lw=1.0, label=["x", "y", "z"])
        axes.legend(ncols=3, fontsize=7)
        label, title = "tool in the base frame [m]", "nothing holds the tool"
    else:
        for tension in forces.tension:
            axes.plot(t, tension, color=FAINT, lw=0.7)
        axes.plot(t, np.median(forces.tension, axis=0), color=INK, lw=1.2)
        label, robots = "force in the rod [N]", len(forces.tension)
        title = f"expected on soft servo, {robots} robots with 1 mm, 1 mrad"
    axes.axhline(0.0, color=QUIET, lw=0.7)
    axes.set(xlabel="time [s]", ylabel=label, title=title)


def _sigma(axes: Axes, plan: PathPlan) -> None:
    """Predicted standard deviation of each unknown of the robot, relative to its prior."""
    sigma, priors = plan.typical.sigma, plan.typical.prior
    robot = [n for n in sigma if n.startswith(_UNKNOWNS_SHOWN) and priors[n] > EXACT]
    ratio, x = [sigma[name] / priors[name] for name in robot], np.arange(len(robot))
    axes.vlines(x, 1e-4, ratio, color=FAINT, lw=2.0)
    axes.plot(x, ratio, "o", color=INK, ms=3.0)
    logarithmic(axes, "y")
    axes.set_ylim(1e-4, 1.5)
    axes.set_xticks(x, robot, rotation=90, fontsize=6)
    axes.set(ylabel="predicted sigma / prior sigma")
