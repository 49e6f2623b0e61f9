"""The pictures of the front page and the tutorial, from runs made for them.

    python -m generators.readme_picture      # docs/images/readme.svg, tutorial.png: half a minute

The errors of the main scenario go to docs/studies/main_scenario.csv, a table of docs/validation.md.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D

from ballbar.cell.files import write_whole
from ballbar.cell.geometry import bar_frames, robot_frames
from ballbar.figure_style import AFTER, BEFORE, FRAME, svg_text, to_hundredths
from ballbar.ident.estimator.closure import complete_bar_angles
from ballbar.report.tcp_view import tcp_view
from ballbar.result.run_data import RunData
from ballbar.run import run_scenario
from ballbar.scenario import load_scenario
from ballbar.units import MM, PPM, US

ROOT = Path(__file__).parents[1]
SCENARIO = ROOT / "scenarios" / "irb2400.yaml"
IMAGES = ROOT / "docs" / "images"
ERRORS = ROOT / "docs" / "studies" / "main_scenario.csv"
TUTORIAL = ROOT / "docs" / "tutorial.md"
TUTORIAL_RUNS = "runs/tutorial"
INSTANT = 0.3  # of the run, at which the mechanism is drawn


def picture(data: RunData) -> str:
    """SVG: the identified mechanism on its sphere, and the TCP error before and after."""
    tcp = tcp_view(data)
    with matplotlib.rc_context(
        {**FRAME, "svg.hashsalt": "readme", "font.size": 10.0, "grid.linewidth": 0.7}
    ):
        figure = Figure(figsize=(10.0, 4.4), layout="constrained", facecolor="white")
        cell = figure.add_subplot(1, 2, 1, projection="3d")
        assert isinstance(cell, Axes3D)
        _draw_cell(cell, data)
        axes = figure.add_subplot(1, 2, 2)
        for values, colour, label in (
            (tcp.after, AFTER, "identified robot"),
            (tcp.before, BEFORE, "nominal robot"),
        ):
            ordered = np.sort(values) * 1e3
            axes.step(
                ordered,
                np.arange(1, ordered.size + 1) / ordered.size * 100.0,
                where="post",
                color=colour,
                linewidth=2.0,
            )
            words = f"{label}\nmean {values.mean() * 1e3:.2g} mm"
            axes.annotate(
                words,
                (float(np.median(ordered)), 50.0),
                (12, 0),
                color=colour,
                textcoords="offset points",
            )
        axes.set(
            xscale="log",
            xlim=(2e-4, 150.0),
            ylim=(0.0, 101.0),
            xlabel="TCP error [mm]",
            ylabel=f"share of {values.size} poses [%]",
        )
        axes.xaxis.set_major_formatter("{x:g}")
        return to_hundredths(svg_text(figure))


def tutorial_picture() -> bytes:
    """PNG of the tutorial's plot, by the tutorial's own files and commands."""
    text = TUTORIAL.read_text()
    with TemporaryDirectory(prefix="ballbar-tutorial-") as folder:
        work = Path(folder)
        (work / "scenarios").symlink_to(ROOT / "scenarios")
        for name, content in re.findall(r"```\w+\n# (\S+\.(?:yaml|py))\n(.*?)```", text, re.DOTALL):
            (work / name).parent.mkdir(parents=True, exist_ok=True)
            (work / name).write_text(content)
        environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
        for command in (
            ["-m", "ballbar", "sweep", f"{TUTORIAL_RUNS}/my_sweep.yaml"],
            [f"{TUTORIAL_RUNS}/plot.py"],
        ):
            subprocess.run([sys.executable, *command], cwd=work, env=environment, check=True)
        return (work / TUTORIAL_RUNS / "eccentricity.png").read_bytes()


def _draw_cell(axes: Axes3D, data: RunData) -> None:
    (recording,) = data.recordings
    geometry, log = recording.estimate.geometry, recording.recording.robot_log
    rows = np.linspace(0, log.t.size * INSTANT, 400).astype(int)
    q = log.q[rows]
    robot = robot_frames(geometry, q)
    bar = bar_frames(geometry, complete_bar_angles(geometry, q, np.zeros((q.shape[0], 0)), ()))
    centre, radius = geometry.origin, geometry["bd3"]
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))
    sphere = [np.sin(height) * np.cos(turn), np.sin(height) * np.sin(turn), np.cos(height)]
    axes.plot_wireframe(
        *(c + radius * x for c, x in zip(centre, sphere, strict=True)),
        color="#c8d0d6",
        linewidth=0.4,
    )
    axes.plot(*robot.tip, color=AFTER, linewidth=1.4)
    for chain, colour, width in ((robot.origin, "#22303c", 5.0), (bar.origin, BEFORE, 3.0)):
        axes.plot(
            *chain[:, :, -1].T,
            color=colour,
            linewidth=width,
            marker="o",
            markersize=width * 1.4,
            solid_capstyle="round",
        )
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", box_aspect=(1, 1, 1))
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MultipleLocator(0.5))
    axes.set_title("robot, ball-bar, and the tool's path on its sphere", y=0.98)
    axes.view_init(elev=18, azim=-62)


def errors_of(data: RunData) -> dict[str, str]:
    """Errors of the main scenario by the name of their column, to the digits that are quoted."""
    comparison = data.comparison
    assert comparison is not None
    assert comparison.offset is not None
    assert comparison.skew is not None
    return {
        "tcp_mean_mm": f"{comparison.tcp.mean * MM:.2g}",
        "tcp_max_mm": f"{comparison.tcp.maximum * MM:.2g}",
        "nominal_mean_mm": f"{comparison.tcp_nominal.mean * MM:.2g}",
        "nominal_max_mm": f"{comparison.tcp_nominal.maximum * MM:.2g}",
        "distance_mm_mrad": f"{comparison.distance * MM:.2g}",
        "clock_us": f"{abs(comparison.offset) * US:.2g}",
        "skew_ppm": f"{abs(comparison.skew) * PPM:.1g}",
        "iterations": str(data.identification.fit.iterations),
    }


def main() -> None:
    """Writes both."""
    with TemporaryDirectory(prefix="ballbar-picture-") as folder:
        data = run_scenario(
            load_scenario(SCENARIO), SCENARIO, out=Path(folder) / "run", command="", progress=print
        )
    write_whole(IMAGES / "readme.svg", picture(data).encode())
    errors = errors_of(data)
    write_whole(ERRORS, "\n".join([",".join(errors), ",".join(errors.values()), ""]).encode())
    write_whole(IMAGES / "tutorial.png", tutorial_picture())
    print(f"Wrote {IMAGES / 'readme.svg'} and tutorial.png")


if __name__ == "__main__":
    main()
