"""rehearsal.html: the day in a line a step, the uncertainty while it was recorded, the targets."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.rehearsal.day import FIRST, PLAN, RESULT, Rehearsal, Stage
from ballbar.report.line_plot import Curve, Distribution, Plot, cumulative, draw
from ballbar.report.numbers import millimetres
from ballbar.report.provenance import versions, without_folders
from ballbar.report.section import template
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
    page = template("rehearsal.html").render(
        title=day.scenario.name,
        subtitle=_subtitle(day),
        band="bad" if missed else "good",
        heading=f"Not as required: {', '.join(missed)}" if missed else "As required",
        sentence=_in_short(day),
        tiles=_tiles(day),
        stages=[(s.name, s.sentence, s.met, f"{s.took:.0f}") for s in day.stages],
        limits=[(limit.what, *limit.sizes, limit.met) for limit in day.limits],
        live=_live(day),
        held=cumulative(
            [
                Distribution("targets as planned", day.held.before, BEFORE),
                Distribution("corrected targets", day.held.after, AFTER),
                Distribution("corrected, base aligned", day.held.aligned, PURPLE),
            ],
            label="distance of the tool",
        ),
        links=LINKS,
        command=without_folders(command),
        versions=versions(simulated=True),
        written=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
    )
    return printable(page, allowed="\n\t")


def _subtitle(day: Rehearsal) -> str:
    cell = day.scenario.cell
    fault = f", with the fault {day.fault}" if day.fault else ""
    return (
        f"{cell.robot} and {cell.measured_by}, paths of {day.scenario.path.duration_s:g} s at "
        f"{day.speed:g} times real time{fault}: {day.took:.0f} s in all."
    )


def _in_short(day: Rehearsal) -> str:
    held = day.held
    return (
        f"{held.after.size} targets are off by {millimetres(held.before.mean())} on average as "
        f"planned with the nominal robot, and by {millimetres(held.after.mean())} after both paths "
        f"and the correction, {millimetres(held.after.max())} at most."
    )


def _tiles(day: Rehearsal) -> list[Tile]:
    identified = [stage for stage in day.stages if stage.name.startswith("identify")]
    return [
        Tile("Nominal robot", millimetres(day.nominal), "mean true TCP error"),
        *(_identified_tile(stage) for stage in identified),
        Tile(
            "Corrected targets",
            millimetres(day.held.after.mean()),
            f"mean in the plant; largest {millimetres(day.held.after.max())}",
        ),
        Tile("Path held out", "holds" if day.stages[-1].met else "fails", day.stages[-1].name),
    ]


def _identified_tile(stage: Stage) -> Tile:
    stated, true = stage.figures["tcp_sigma_m"], stage.figures["true_tcp_error_m"]
    assert isinstance(stated, float)
    assert isinstance(true, dict)
    note = f"stated (1 sigma, rms); true error rms {millimetres(true['rms'])}"
    return Tile(stage.name.capitalize(), millimetres(stated), note)


def _live(day: Rehearsal) -> str:
    """Stated uncertainty while each path was recorded."""
    colours = {"fault": BEFORE, "path1": AFTER, "path2": PURPLE}
    curves = []
    for name, path in day.paths.items():
        if name in colours and len(path.stated) > 1:
            recorded, sigma = np.array(path.stated).T
            curves.append(Curve(recorded, sigma * MM, colours[name], name, 1.6))
    if not curves:
        return ""
    plot = Plot(curves, "stated TCP uncertainty [mm]", log=True)
    return draw([plot], "recorded [s]", height=250.0, legend=True)
