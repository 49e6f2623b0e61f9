"""The picture of a plan: the path on the sphere, axes over time against their ranges, loads, and what is known afterwards."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from ballbar.beam import GRAVITY, OFFSET_PLATE, PLATE_ALLOWED, PLATE_FORCE, STEEL_PLATE, tip_deflection
from cell.descriptions import joints_to_axes
from cell.geometry import bar_frames
from planning.plan import Plan
from planning.what_if import Answer

STYLE: dict[RcKeyType, Any] = {"svg.hashsalt": "ballbar", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
INK, WEAK = "#1b3a5c", "#b9c4d0"
COLOURS = ("#1b3a5c", "#c4542b", "#3d8f6b", "#8a5fa8", "#c49a1a", "#5f6b78")


def plan_picture(plan: Plan) -> bytes:
    """SVG."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11.0, 8.0), layout="constrained")
        grid = figure.subplot_mosaic([["sphere", "axes"], ["load", "sigma"]])
        _sphere(grid["sphere"], plan)
        _axes(grid["axes"], plan)
        _loads(grid["load"], plan)
        _sigma(grid["sigma"], plan)
        figure.suptitle(
            f"{plan.request.name}: predicted TCP sigma {np.median(plan.tcp) * 1e6:.1f} um rms over the workspace", x=0.01, ha="left"
        )
        return _svg(figure)


def what_if_picture(plan: Plan, given: Sequence[Answer]) -> bytes:
    """SVG: a panel for each question, expected TCP error over the values; open: with what the plate's own length adds."""
    keys = list(dict.fromkeys(answer.key for answer in given))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.2 * len(keys) + 0.6, 3.0), layout="constrained")
        for axes, key in zip(np.atleast_1d(figure.subplots(1, len(keys), sharey=True)), keys, strict=True):
            answers = [a for a in given if a.key == key]
            place = np.arange(len(answers))
            axes.plot(place, [np.nan if a.tcp is None else a.tcp * 1e6 for a in answers], "o-", color=INK, label="from the path")
            total = [np.nan if a.total is None else a.total * 1e6 for a in answers]
            axes.plot(place, total, "o--", color=INK, mfc="white", label="and the plate's length")
            axes.axhline(plan.found.tcp * 1e6, color=WEAK, lw=0.8)
            axes.set_xticks(place, [a.value for a in answers], rotation=30, ha="right")
            axes.set_title(key.replace("_", " "), fontsize=9)
            axes.set_ylim(bottom=0.0)
        figure.axes[0].set_ylabel("TCP sigma [um rms]")
        figure.axes[0].legend(frameon=False, fontsize=7)
        return _svg(figure)


def plate_picture() -> bytes:
    """SVG of thesis Fig. 4.4: deflection at the tip and weight over thickness, aluminium and steel."""
    thickness = np.linspace(0.020, 0.070, 60)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 3.0), layout="constrained")
        left, right = figure.subplots(1, 2)
        for (label, material), colour in zip({"aluminium": OFFSET_PLATE, "steel": STEEL_PLATE}.items(), COLOURS, strict=False):
            plates = [replace(material, thickness=float(h)) for h in thickness]
            left.plot(thickness * 1e3, [tip_deflection(p, PLATE_FORCE) * 1e6 for p in plates], color=colour, label=label)
            right.plot(thickness * 1e3, [p.weight * p.length / GRAVITY for p in plates], color=colour)
        left.axhline(PLATE_ALLOWED * 1e6, color=WEAK, lw=0.8)
        left.set_yscale("log")
        left.set(xlabel="thickness [mm]", ylabel="deflection [um], or urad from 1 m")
        right.set(xlabel="thickness [mm]", ylabel="mass [kg]", ylim=(0.0, None))
        left.legend(frameon=False)
        return _svg(figure)


def _svg(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()


def _sphere(axes: Axes, plan: Plan) -> None:
    """The rod's direction, Lambert's azimuthal equal-area projection from above: areas are true."""
    x, y, z = bar_frames(plan.course.nominal, plan.course.b).z[2]
    scale = np.sqrt(2.0 / (1.0 + np.clip(z, -0.999, 1.0)))
    axes.plot(scale * x, scale * y, color=INK, lw=1.0)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    for degrees in (30, 60, 90, 120):
        radius = 2.0 * np.sin(0.5 * np.radians(degrees))
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=WEAK, lw=0.6)
        axes.text(0.0, radius, f"{degrees}°", color="#667", fontsize=7, ha="center")
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title(f"rod's direction from above (robot's x to the right); {plan.coverage:.0%} of the sphere within 10°", fontsize=9)


def _axes(axes: Axes, plan: Plan) -> None:
    robot, course = plan.judge.cell.robot, plan.course
    angles = joints_to_axes(robot, course.q)
    share = (angles - robot.axis_lower) / (robot.axis_upper - robot.axis_lower)
    for k in range(6):
        axes.plot(course.t, share[:, k], color=COLOURS[k], lw=1.0, label=f"{k + 1}")
    axes.set_ylim(0.0, 1.0)
    axes.set(xlabel="time [s]", ylabel="axis angle, share of its range")
    axes.legend(ncols=6, loc="upper center", frameon=False, title="axis", fontsize=7, title_fontsize=7)


def _loads(axes: Axes, plan: Plan) -> None:
    forces = plan.found.forces
    assert forces is not None
    for tension in forces.tension:
        axes.plot(plan.course.t, tension, color=WEAK, lw=0.7)
    axes.plot(plan.course.t, np.median(forces.tension, axis=0), color=INK, lw=1.2)
    axes.axhline(0.0, color="k", lw=0.5)
    axes.set(xlabel="time [s]", ylabel="force in the rod [N]")
    axes.set_title(f"expected on soft servo, {len(forces.tension)} robots with 1 mm, 1 mrad", fontsize=9)


def _sigma(axes: Axes, plan: Plan) -> None:
    """How much of each prior is left."""
    typical = plan.typical
    robot = [n for n in typical.sigma if n.startswith(("ra", "rd", "ralpha", "rtheta", "rbeta", "compliance", "play"))]
    priors = dict(zip(typical.layout.names, typical.layout.sigma, strict=True))
    left = [typical.sigma[n] / priors[n] for n in robot]
    place = np.arange(len(robot))
    axes.vlines(place, 1e-4, left, color=WEAK, lw=2.0)
    axes.plot(place, left, "o", color=INK, ms=3.0)
    axes.set_yscale("log")
    axes.set_ylim(1e-4, 1.5)
    axes.set_xticks(place, robot, rotation=90, fontsize=6)
    axes.set(ylabel="predicted sigma / prior sigma")
