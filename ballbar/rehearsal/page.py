"""rehearsal.html: the day in a line a step, the uncertainty while it was recorded, the targets."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.rehearsal.day import FIRST, RESULT, Rehearsal
from ballbar.rehearsal.second_path import PLAN
from ballbar.report import line_plot
from ballbar.report.figures import Curve, cumulative
from ballbar.report.numbers import millimetres
from ballbar.report.page import template
from ballbar.report.provenance import versions, without_folders
from ballbar.report.summary import Tile
from ballbar.units import MM
from cell.foreign_text import printable

LINKS = (
    (f"{FIRST}/report.html", "result of the first path"),
    (f"{RESULT}/report.html", "result of both paths"),
    (f"{PLAN}/plan.svg", "plan of the second path"),
    ("rehearsal.json", "all figures"),
)


def rehearsal_page(day: Rehearsal, *, command: str) -> str:
    """The page as text. command : as the user typed it."""
    missed = [stage.name for stage in day.stages if not stage.met]
    missed += [limit.what for limit in day.limits if not limit.met]
    cell, targets = day.scenario.cell, day.held
    fault = f", with the fault {day.fault}" if day.fault else ""
    page = template("rehearsal.html").render(
        title=day.scenario.name,
        subtitle=f"{cell.robot} and {cell.measured_by}, paths of "
        f"{day.scenario.path.duration_s:g} s at {day.speed:g} times real time{fault}: "
        f"{day.took:.0f} s in all.",
        band="bad" if missed else "good",
        heading=f"Not as required: {', '.join(missed)}" if missed else "As required",
        sentence=f"{targets.after.size} targets are off by {millimetres(targets.before.mean())} on "
        f"average as planned with the nominal robot, and by {millimetres(targets.after.mean())} "
        f"after both paths and the correction, {millimetres(targets.after.max())} at most.",
        tiles=_tiles(day),
        stages=[(s.name, s.sentence, s.met, f"{s.took:.0f}") for s in day.stages],
        limits=[(limit.what, *limit.sizes, limit.met) for limit in day.limits],
        live=_live(day),
        held=cumulative(
            [
                Curve("targets as planned", targets.before, BEFORE),
                Curve("corrected targets", targets.after, AFTER),
                Curve("corrected, base aligned", targets.aligned, PURPLE),
            ],
            label="distance of the tool",
        ),
        links=LINKS,
        command=without_folders(command),
        versions=versions(simulated=True),
        written=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
    )
    return printable(page, allowed="\n\t")


def _tiles(day: Rehearsal) -> list[Tile]:
    tiles = [Tile("Nominal robot", millimetres(day.nominal), "mean true TCP error")]
    for stage in day.stages:
        if stage.name.startswith("identify"):
            stated, true = stage.figures["tcp_sigma_m"], stage.figures["true_tcp_error_m"]
            assert isinstance(stated, float)
            assert isinstance(true, dict)
            note = f"stated (1 sigma, rms); true error rms {millimetres(true['rms'])}"
            tiles.append(Tile(stage.name.capitalize(), millimetres(stated), note))
    after, last = day.held.after, day.stages[-1]
    note = f"mean in the plant; largest {millimetres(after.max())}"
    return [
        *tiles,
        Tile("Corrected targets", millimetres(after.mean()), note),
        Tile("Path held out", "holds" if last.met else "fails", last.name),
    ]


def _live(day: Rehearsal) -> str:
    """Stated uncertainty while each path was recorded."""
    colours = {"fault": BEFORE, "path1": AFTER, "path2": PURPLE}
    curves = []
    for name, path in day.paths.items():
        if name in colours and len(path.stated) > 1:
            recorded, sigma = np.array(path.stated).T
            curves.append(line_plot.Curve(recorded, sigma * MM, colours[name], name, 1.6))
    if not curves:
        return ""
    plot = line_plot.Plot(curves, "stated TCP uncertainty [mm]", log=True)
    return line_plot.draw([plot], "recorded [s]", height=250.0, legend=True)
