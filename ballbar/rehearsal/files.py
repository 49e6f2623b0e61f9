"""The folder of a rehearsal: recordings, results, plan, targets, the chain of figures and its page.

Everything is made beside the folder and takes its place at the end, or none of it does.
"""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from ballbar.cell.files import claimed_folder, write_whole
from ballbar.cell.foreign_text import printable
from ballbar.figure_style import AFTER, BEFORE, PURPLE
from ballbar.rehearsal.day import (
    FIRST,
    RECORDINGS,
    RESULT,
    SIMULATED,
    Day,
    Rehearsal,
    Stage,
    rehearse,
)
from ballbar.rehearsal.live import as_recorded, check_fault
from ballbar.rehearsal.second_path import PLAN, REQUEST
from ballbar.rehearsal.targets import CORRECTED, GIVEN
from ballbar.report.line_plot import Curve, Distribution, Plot, cumulative, draw
from ballbar.report.numbers import millimetres
from ballbar.report.provenance import versions, without_folders
from ballbar.report.section import template
from ballbar.report.summary import Tile
from ballbar.units import MM

CHAIN, PAGE = "rehearsal.json", "rehearsal.html"
OUTPUTS = {
    SIMULATED, RECORDINGS, PLAN, FIRST, RESULT, GIVEN, CORRECTED, REQUEST, CHAIN, PAGE,
}  # fmt: skip


LINKS = (
    (f"{FIRST}/report.html", "result of the first path"),
    (f"{RESULT}/report.html", "result of both paths"),
    (f"{PLAN}/plan.svg", "plan of the second path"),
    ("rehearsal.json", "all figures"),
)


def rehearse_into(day: Day) -> Rehearsal:
    """Rehearses a day, and leaves it in its folder as a whole.

    Raises InputError for a fault or a scenario that cannot be rehearsed, or when the folder holds
    something else; FailureError when a part of the cell does not come up.
    """
    check_fault(day.scenario, day.fault, relative_to=day.file.parent)
    delivered, out = as_recorded(day.scenario), day.folder
    with claimed_folder(out, OUTPUTS, "the rehearsal"):
        beside = Path(mkdtemp(dir=out.resolve().parent, prefix=f".{out.name}."))
        try:
            rehearsal = rehearse(replace(day, scenario=delivered, folder=beside))
            day.progress("writing the report")
            write_whole(beside / PAGE, rehearsal_page(rehearsal).encode())
            write_whole(beside / CHAIN, (json.dumps(chain(rehearsal), indent=2) + "\n").encode())
            _replace_outputs(beside, out)
        finally:
            with suppress(OSError):
                shutil.rmtree(beside)
        return rehearsal


def _replace_outputs(beside: Path, out: Path) -> None:
    """Moves a rehearsal to where an earlier one may be, the chain last."""
    for name in sorted(OUTPUTS, key=lambda name: name == CHAIN):
        old, new = out / name, beside / name
        if old.is_dir():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
        if new.exists():
            new.replace(old)


def chain(rehearsal: Rehearsal) -> dict[str, object]:
    """The chain of figures as plain data, SI units."""
    day = rehearsal.day
    return {
        "schema": "ballbar-rehearsal/1",
        "scenario": day.scenario.name,
        "robot": day.scenario.cell.robot,
        "measured_by": day.scenario.cell.measured_by,
        "seed": day.scenario.seed,
        "speed": day.speed,
        "fault": day.fault,
        "acceptable": rehearsal.acceptable,
        "wall_time_s": round(day.took, 1),
        "stages": [_stage_data(stage) for stage in day.stages],
        "limits": [asdict(limit) for limit in rehearsal.limits],
    }


def _stage_data(stage: Stage) -> dict[str, object]:
    return {
        "name": stage.name,
        "sentence": stage.sentence,
        "met": stage.met,
        "wall_time_s": round(stage.took, 1),
        "figures": stage.figures,
    }


def rehearsal_page(rehearsal: Rehearsal) -> str:
    """The page as text: a line a step, the uncertainty while it was recorded, the targets."""
    day, targets = rehearsal.day, rehearsal.held
    missed = [stage.name for stage in day.stages if not stage.met]
    missed += [limit.what for limit in rehearsal.limits if not limit.met]
    cell, planned = day.scenario.cell, any(stage.name == "plan path2" for stage in day.stages)
    fault = f", with the fault {day.fault}" if day.fault else ""
    page = template("rehearsal.html").render(
        title=day.scenario.name,
        subtitle=f"{cell.robot} and {cell.measured_by}, paths of "
        f"{day.scenario.needed_path.duration_s:g} s at {day.speed:g} times real time{fault}: "
        f"{day.took:.0f} s in all.",
        band="bad" if missed else "good",
        heading=f"Not as required: {', '.join(missed)}" if missed else "As required",
        sentence=f"{targets.after.size} targets are off by {millimetres(targets.before.mean())} on "
        f"average as planned with the nominal robot, and by {millimetres(targets.after.mean())} "
        f"after both paths and the correction, {millimetres(targets.after.max())} at most.",
        tiles=_tiles(rehearsal),
        stages=[(s.name, s.sentence, s.met, f"{s.took:.0f}") for s in day.stages],
        limits=[(limit.what, *limit.sizes, limit.met) for limit in rehearsal.limits],
        live=_live(day),
        held=cumulative(
            [
                Distribution("targets as planned", targets.before, BEFORE),
                Distribution("corrected targets", targets.after, AFTER),
                Distribution("corrected, base aligned", targets.aligned, PURPLE),
            ],
            label="distance of the tool",
        ),
        links=[link for link in LINKS if planned or not link[0].startswith(PLAN)],
        command=without_folders(day.command),
        versions=versions(simulated=True),
        written=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
    )
    return printable(page, allowed="\n\t")


def _tiles(rehearsal: Rehearsal) -> list[Tile]:
    day, after = rehearsal.day, rehearsal.held.after
    tiles = [Tile("Nominal robot", millimetres(rehearsal.nominal), "mean true TCP error")]
    for stage in day.stages:
        if stage.name.startswith("identify"):
            stated, true = stage.figures["tcp_sigma_m"], stage.figures["true_tcp_error_m"]
            assert isinstance(stated, float)
            assert isinstance(true, dict)
            note = f"stated (1 sigma, rms); true error rms {millimetres(true['rms'])}"
            tiles.append(Tile(stage.name.capitalize(), millimetres(stated), note))
    last = day.stages[-1]
    note = f"mean in the plant; largest {millimetres(after.max())}"
    return [
        *tiles,
        Tile("Corrected targets", millimetres(after.mean()), note),
        Tile("Path held out", "holds" if last.met else "fails", last.name),
    ]


def _live(day: Day) -> str:
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
