"""The folder of a rehearsal: recordings, results, plan, targets, and the chain of figures.

Everything is made beside the folder and takes its place at the end, or none of it does.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import mkdtemp

from ballbar.outputs import Progress
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
from ballbar.scenario import Scenario
from cell.files import claimed_folder, write_whole

CHAIN, PAGE = "rehearsal.json", "rehearsal.html"
OUTPUTS = {
    SIMULATED, RECORDINGS, PLAN, FIRST, RESULT, GIVEN, CORRECTED, REQUEST, CHAIN, PAGE,
}  # fmt: skip


def rehearse_into(
    out: Path,
    scenario: Scenario,
    *,
    file: Path,
    speed: float,
    fault: str | None,
    command: str,
    show: Callable[[Stage], None],
    progress: Progress,
) -> Rehearsal:
    """Rehearses a day, and leaves it in a folder as a whole; arguments as of `Day`.

    Raises InputError for a fault or a scenario that cannot be rehearsed, or when `out` holds
    something else; FailureError when a part of the cell does not come up.
    """
    check_fault(scenario, fault)
    delivered = as_recorded(scenario)
    with claimed_folder(out, OUTPUTS, "the rehearsal"):
        beside = Path(mkdtemp(dir=out.resolve().parent, prefix=f".{out.name}."))
        try:
            begun = Day(delivered, file, beside, speed, command, show, progress=progress)
            day = rehearse(begun, fault)
            progress("writing the report")
            from ballbar.rehearsal.page import rehearsal_page  # noqa: PLC0415  imports Jinja

            write_whole(beside / PAGE, rehearsal_page(day, command=command).encode())
            write_whole(beside / CHAIN, (json.dumps(chain(day), indent=2) + "\n").encode())
            # where an earlier rehearsal may be, the chain last
            for name in sorted(OUTPUTS, key=lambda name: name == CHAIN):
                old, new = out / name, beside / name
                if old.is_dir():
                    shutil.rmtree(old)
                else:
                    old.unlink(missing_ok=True)
                if new.exists():
                    new.rename(old)
        finally:
            with suppress(OSError):
                shutil.rmtree(beside)
        return day


def chain(day: Rehearsal) -> dict[str, object]:
    """The chain of figures as plain data, SI units."""
    return {
        "schema": "ballbar-rehearsal/1",
        "scenario": day.scenario.name,
        "robot": day.scenario.cell.robot,
        "measured_by": day.scenario.cell.measured_by,
        "seed": day.scenario.seed,
        "speed": day.speed,
        "fault": day.fault,
        "acceptable": day.acceptable,
        "wall_time_s": round(day.took, 1),
        "stages": [
            {
                "name": stage.name,
                "sentence": stage.sentence,
                "met": stage.met,
                "wall_time_s": round(stage.took, 1),
                "figures": stage.figures,
            }
            for stage in day.stages
        ],
        "limits": [asdict(limit) for limit in day.limits],
    }
