"""Sweeps: what a file may say, which run is which, and the same table after any interruption."""

from __future__ import annotations

import csv
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from ballbar.cell.errors import InputError
from ballbar.cell.extended_yaml import with_changes
from ballbar.cell.threads import ONE_THREAD
from ballbar.sweep import run as sweep_run
from ballbar.sweep.check import LoadedSweep, check_points, load_sweep
from ballbar.sweep.chunk import Task, run_chunk, run_chunk_remotely, unpack
from ballbar.sweep.file import Changes, Seeds
from ballbar.sweep.folder import open_folder
from ballbar.sweep.plan import Plan, PlanData, point_of, run_of
from ballbar.sweep.run import SweepError, SweepOutcome, dask_cluster, processes
from ballbar.sweep.table import failures_of, grid_points, write_table
from ballbar.trial.trial import run_trial
from tests.helpers import sweep_work
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import SCENARIOS
from tests.helpers.sweeps import GRID, HEAD, inline, loaded, swept, table_bytes

# A sweep of real runs that lasts long enough to be killed, and not longer.
REAL = f"""schema: ballbar-sweep/1
name: real
scenario: {SCENARIOS / "irb2400.yaml"}
change:
  plant.kind: kinematic
  errors.rod_strain: null
  identify: {{cost: transform, data: samples, samples: 300}}
vary: {{errors.joint_noise.sigma_rad: [1.0e-6, 1.0e-5]}}
seeds: {{count: 30}}
"""


def plan_of(folder: Path, text: str) -> Plan:
    return loaded(folder, text).plan


def refused(words: str) -> pytest.RaisesExc[InputError]:
    """An InputError in these words, a regular expression."""
    return pytest.raises(InputError, match=words)


# -- what a file may say


# what follows the head of a sweep file, line of the fault, what is said
WRONG = yaml.safe_load(r"""
- ["vary: {errors.joint_nose.sigma_rad: [1.0]}\nseeds: {count: 1}\n", 4,
   "unknown key errors.joint_nose. Did you mean joint_noise?"]
- ["vary:\n  errors.joint_noise.sigma_rad:\n    - 1.0e-5\n    - -1.0\nseeds: {count: 1}\n", 7,
   "sigma_rad = -1.0: expected 0 or more."]
- ["change: {cell.robot.a: 1}\nseeds: {count: 1}\n", 4,
   "cell.robot.a: the value 'irb2400' above a has no keys of its own"]
- ["together:\n  - {clocks.skew: 0.0}\n  - {clocks: {skew: 1.0}}\nseeds: {count: 1}\n", 6,
   "clocks.skew = 1.0: expected 0.002 or less"]
- ["vary: {cell.ballbar_position_m.3: [0.1]}\nseeds: {count: 1}\n", 4,
   "the list has no item 3; its 3 items count from 0"]
- ["draw:\n  errors.joint_noise.sigma_rad: {normal: [0, 1]}\ndraws: 9\nseeds: {count: 1}\n", 5,
   "expected 0 or more"]
- ["vary: {seed: [1, 2]}\nseeds: {count: 1}\n", 4,
   "vary.seed: the seeds of the runs are given under seeds."]
- ["draw: {clocks.skew: {uniform: [0, 1e-4]}}\nseeds: {count: 1}\n", 4,
   "the number of draws is missing: add `draws: N`"]
- ["draws: 3\nseeds: {count: 1}\n", 4, "nothing is drawn"]
- ["draw: {clocks.skew: {log_uniform: [0, 1e-4]}}\ndraws: 3\nseeds: {count: 1}\n", 4,
   "both bounds of log_uniform must be above 0"]
- ["draw: {clocks.skew: {uniform: [1, 0]}}\ndraws: 3\nseeds: {count: 1}\n", 4,
   "the first bound must be below the second"]
- ["draw: {clocks.skew: {uniform: [0, 1], normal: [0, 1]}}\ndraws: 3\nseeds: {count: 1}\n", 4,
   "give exactly one of uniform"]
- ["vary:\n  clocks: [{}]\n  clocks.skew: [0.0]\nseeds: {count: 1}\n", 6,
   "clocks is given under vary already"]
- ["together:\n  - {clocks.skew: 0}\nvary:\n  clocks.skew: [0.0]\nseeds: {count: 1}\n", 7,
   "clocks.skew is given under together already"]
- ["vary: {path.file: [paths/irb2400_a.yaml, no.yaml]}\nseeds: {count: 1}\n", null,
   "path.file = 'no.yaml': "]
""")


@pytest.mark.parametrize(("text", "line", "words"), WRONG)
def test_a_wrong_sweep_is_refused_with_file_line_and_words(
    text: str, line: int | None, words: str, tmp_path: Path
) -> None:
    place = "" if line is None else f"{tmp_path / 'sweep.yaml'}:{line}: "
    with refused(f"^{re.escape(place)}.*{re.escape(words)}"):
        plan_of(tmp_path, text)


def test_a_scenario_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with refused(r"sweep.yaml:3: scenario = 'gone.yaml': no such file"):
        plan_of(
            tmp_path, "schema: ballbar-sweep/1\nname: a\nscenario: gone.yaml\nseeds: {count: 1}\n"
        )


def test_values_that_are_wrong_only_together_are_named_together(tmp_path: Path) -> None:
    """A shorter path ends before the clock step of the scenario; each value alone is valid."""
    scenario = (
        (SCENARIOS / "irb2400.yaml")
        .read_text()
        .replace("clocks: {", "clocks: {step: {at_s: 90, step_s: 0.01}, ")
    )
    (tmp_path / "scenario.yaml").write_text(scenario.replace("paths/", f"{SCENARIOS}/paths/"))
    text = (
        "schema: ballbar-sweep/1\nname: a\nscenario: scenario.yaml\n"
        "vary: {path.duration_s: [120, 60]}\nseeds: {count: 1}\n"
    )
    with refused(
        r'clocks.step.at_s = 90: t = 90 s is not logged; .* with \{"path.duration_s": 60\}\.'
    ):
        plan_of(tmp_path, text)


def test_every_wrong_value_of_a_grid_is_reported_at_once(tmp_path: Path) -> None:
    with refused(r"sweep\.yaml:5: ") as raised:
        plan_of(
            tmp_path,
            "vary:\n  clocks.skew: [0.0, 1.0]\n  identify.samples: [3, 100]\nseeds: {count: 1}\n",
        )
    assert [line.split(":")[1] for line in str(raised.value).splitlines()] == ["5", "6"]


@pytest.mark.parametrize(
    "file", sorted((SCENARIOS / "sweeps").glob("*.yaml")), ids=lambda file: file.stem
)
def test_every_shipped_sweep_is_accepted(file: Path) -> None:
    sweep = load_sweep(file)
    check_points(sweep)
    assert sweep.plan.runs > 1


def test_the_sweep_of_the_documentation_is_accepted(tmp_path: Path) -> None:
    page = (SCENARIOS.parent / "docs" / "sweeps.md").read_text()
    example = page.split("```yaml\n")[1].split("```")[0]
    (tmp_path / "sweeps").mkdir()
    (tmp_path / "sweeps" / "noise.yaml").write_text(example)
    (tmp_path / "irb2400.yaml").write_text((SCENARIOS / "irb2400.yaml").read_text())
    shutil.copytree(SCENARIOS / "paths", tmp_path / "paths")
    sweep = load_sweep(tmp_path / "sweeps" / "noise.yaml")
    check_points(sweep)
    assert sweep.plan.runs == 2 * 3 * 50 * 20


# -- which run is which


def test_the_last_axis_changes_fastest_and_the_seed_faster_still(tmp_path: Path) -> None:
    text = """together:
  - {label: one, clocks.skew: 1.0e-5}
  - {label: two, clocks: {skew: 2.0e-5, offset_s: 0.5}}
vary:
  identify.samples: [100, 200]
  errors.static: [{table: thesis_3_1}, {sigma_m: 0, sigma_rad: 0}]
seeds: {first: 7, count: 2}
"""
    plan = plan_of(tmp_path, text)
    runs = [run_of(plan, k) for k in range(plan.runs)]
    expected = itertools.product(["one", "two"], [100, 200], ["thesis_3_1", None], [7, 8])
    for run, (label, samples, table, seed) in zip(runs, expected, strict=True):
        assert (run.values["label"], run.scenario.seed) == (label, seed)
        assert run.scenario.identify.samples == samples
        assert getattr(run.scenario.errors.static, "table", "") == table
    assert [run.point for run in runs] == [k // 2 for k in range(16)]
    assert [run.scenario.clocks.offset_s for run in runs] == [0.137] * 8 + [0.5] * 8


def test_draws_stay_when_another_key_is_drawn_or_more_are_drawn(tmp_path: Path) -> None:
    one = plan_of(
        tmp_path, "draw: {clocks.skew: {uniform: [-1e-4, 1e-4]}}\ndraws: 20\nseeds: {count: 3}\n"
    )
    more = plan_of(
        tmp_path,
        "draw:\n  errors.joint_noise.sigma_rad: {log_uniform: [1e-6, 1e-4]}\n"
        "  clocks.skew: {uniform: [-1e-4, 1e-4]}\ndraws: 30\nseeds: {count: 1}\n",
    )
    skews = [point_of(one, i)["clocks.skew"] for i in range(20)]
    assert skews == [point_of(more, i)["clocks.skew"] for i in range(20)]
    assert len(set(skews)) == 20
    sigmas = [point_of(more, i)["errors.joint_noise.sigma_rad"] for i in range(20)]
    assert abs(np.corrcoef(skews, np.log(sigmas))[0, 1]) < 0.9, "each key has a stream of its own"
    other = plan_of(
        tmp_path,
        "draw: {clocks.skew: {uniform: [-1e-4, 1e-4]}}\ndraws: 20\nseed: 1\nseeds: {count: 3}\n",
    )
    assert not set(skews) & {point_of(other, i)["clocks.skew"] for i in range(20)}


DRAWS = 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("distribution", "quantile"),
    [
        ("uniform: [-1.0, 3.0]", lambda u: -1.0 + 4.0 * u),
        ("log_uniform: [1.0e-2, 1.0]", lambda u: 10.0 ** (-2.0 + 2.0 * u)),
        ("normal: [2.0, 0.5]", lambda u: 2.0 + 0.5 * float(ndtri(u))),
    ],
)
def test_draws_follow_their_distribution(
    distribution: str, quantile: Callable[[float], float], tmp_path: Path
) -> None:
    plan = plan_of(
        tmp_path,
        f"draw: {{clocks.offset_s: {{{distribution}}}}}\ndraws: {DRAWS}\nseeds: {{count: 1}}\n",
    )
    drawn = np.sort([point_of(plan, i)["clocks.offset_s"] for i in range(plan.points)])
    for u in (0.1, 0.25, 0.5, 0.75, 0.9):
        share = float(np.mean(drawn < quantile(u)))
        assert abs(share - u) < 4.0 * np.sqrt(u * (1.0 - u) / DRAWS)  # standard deviations


def _small_plan(
    scenario: dict[str, Any], together: list[Changes], vary: dict[str, list[Any]], seeds: int = 1
) -> Plan:
    return Plan.of(
        PlanData(
            name="a",
            version="1",
            scenario=scenario,
            together=together,
            vary=vary,
            draw={},
            seed=0,
            seeds=Seeds(first=0, count=seeds),
            files={},
        )
    )


@given(points=st.integers(1, 60), seeds=st.integers(1, 500))
def test_every_run_is_in_exactly_one_chunk(points: int, seeds: int) -> None:
    plan = _small_plan({}, [], {"clocks.skew": [0.0] * points}, seeds)
    runs = [run for chunk in range(plan.chunks) for run in plan.chunk(chunk)]
    assert runs == list(range(points * seeds))


def test_the_costs_of_one_recording_share_a_chunk_and_its_simulation() -> None:
    """Two workers that took turns at the runs would both simulate every recording."""
    costs = {"identify.cost": ["length", "position", "ml"]}
    together = [{"label": "a", "recording": 1}, {"label": "again", "recording": 2}]
    recorded = _small_plan({}, together, costs)
    assert [list(recorded.chunk(i)) for i in range(recorded.chunks)] == [[0, 1, 2], [3, 4, 5]]
    samples = _small_plan({"identify": {"data": "samples"}}, together, costs)
    assert samples.chunks == samples.runs


def test_changes_leave_the_scenario_as_it_was() -> None:
    data = {"a": {"b": [1, {"c": 2}]}, "d": None}
    changed = with_changes(data, {"a.b.1.c": 3, "d.e.f": 4, "g": {"h": 5}})
    assert changed == {"a": {"b": [1, {"c": 3}]}, "d": {"e": {"f": 4}}, "g": {"h": 5}}
    assert data == {"a": {"b": [1, {"c": 2}]}, "d": None}


def test_files_of_the_scenario_travel_with_the_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker finds them by the same names, also above the scenario's folder.

    Another text of a file is another sweep.
    """
    (tmp_path / "cells" / "mine").mkdir(parents=True)
    (tmp_path / "paths").mkdir()
    (tmp_path / "paths" / "a.yaml").write_text("one")
    scenario = (
        (SCENARIOS / "irb2400.yaml")
        .read_text()
        .replace("paths/irb2400_a.yaml", "../../paths/a.yaml")
    )
    (tmp_path / "cells" / "mine" / "s.yaml").write_text(scenario)
    text = "schema: ballbar-sweep/1\nname: a\nscenario: cells/mine/s.yaml\nseeds: {count: 1}\n"
    sweep = loaded(tmp_path, text)
    (tmp_path / "paths" / "a.yaml").write_text("two")
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "1")
    (row,) = run_chunk_remotely(sweep.plan.text, [0], sweep_work.path_text, sweep.files)
    assert row["text"] == "one"
    assert plan_of(tmp_path, text).digest != sweep.plan.digest
    for elsewhere in ("here", "there"):
        unpack(sweep.files, tmp_path / elsewhere)
        row = run_chunk(sweep.plan.text, [0], sweep_work.no_such_file, tmp_path / elsewhere)[0]
        assert row["reason"] == "../../paths/a.yaml and paths/a.yaml: no such file.", (
            "the folder of the worker is not in it"
        )


# -- the table


def test_a_row_says_what_was_run_and_what_came_out(tmp_path: Path) -> None:
    sweep = loaded(tmp_path, GRID)
    outcome = swept(sweep, tmp_path / "out", inline)
    table = pd.read_parquet(outcome.folder.table)
    assert list(table.columns) == [
        *("sweep", "scenario", "version", "run", "point", "seed", "status", "reason"),
        *("errors.joint_noise.sigma_rad", "cell.ballbar_position_m.0"),
        *("distance_mm_mrad", "rows", "cost"),
    ]
    assert len(table) == sweep.plan.runs == 20
    assert (table["sweep"] == "tried").all()
    assert (table["scenario"] == "irb2400").all()
    assert table["version"].str.fullmatch(r"\d+\.\d+\.\d+\+[0-9a-f]{8}").all()
    assert list(table["seed"]) == [2, 3, 4, 5, 6] * 4
    assert list(table["rows"]) == list(table["seed"])
    twelfth = sweep_work.figures(run_of(sweep.plan, 12).scenario, tmp_path)
    assert table["distance_mm_mrad"][12] == twelfth["distance_mm_mrad"]
    with outcome.folder.csv.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["distance_mm_mrad"]) for row in rows] == list(table["distance_mm_mrad"])


def test_a_failed_run_is_a_row_with_its_reason(tmp_path: Path) -> None:
    sweep = loaded(tmp_path, GRID)
    outcome = swept(sweep, tmp_path / "out", inline, sweep_work.figures_with_failures)
    table = pd.read_parquet(outcome.folder.table)
    assert list(table["status"]) == ["failed", "failed", "failed", "failed", "done"] * 4
    assert list(table["reason"][:4]) == [
        *("paths/irb2400_a.yaml: no motion in 120 s", "ZeroDivisionError: division by zero"),
        *("no motion at 0.7 m in 4 s", "no motion at 0.7 m in 5 s"),
    ]
    assert table["reason"].isna().sum() == 4
    assert table["distance_mm_mrad"].isna().sum() == 16
    assert list(table["extra"].dropna()) == [1.5] * 4
    failures = failures_of(outcome.folder.table)
    assert (failures.count, failures.of_reason) == (16, 8), "whatever the numbers in it"
    assert failures.reason == "no motion at 0.7 m in 4 s"


def test_a_column_has_one_type_whatever_its_chunks_hold(tmp_path: Path) -> None:
    """A chunk may hold no results, or whole numbers only; the table holds all values exactly."""
    chunks = [
        [{"run": 0, "status": "failed", "reason": "x"}],
        [{"run": 1, "status": "done", "a": 1, "b": 2, "c": True, "d": "t"}],
        [{"run": 2, "status": "done", "a": 0.5, "b": 2**60, "c": None, "d": "u,\n\"'", "e": None}],
    ]
    files = []
    for i, rows in enumerate(chunks):
        files.append(tmp_path / f"{i}.json")
        files[-1].write_text(json.dumps(rows))
    varied = {"vary": [1, 0.5], "mixed": ["auto", 1, {"a": 1}]}
    write_table(files, varied, {"parquet": tmp_path / "t.parquet", "csv": tmp_path / "t.csv"})
    rows = pd.read_parquet(tmp_path / "t.parquet", dtype_backend="pyarrow")
    types = [str(rows[name].dtype) for name in ("vary", "mixed", "a", "b", "c", "d", "e")]
    expected = ("double", "string", "double", "int64", "bool", "string", "double")
    assert types == [f"{name}[pyarrow]" for name in expected]
    assert rows["b"][2] == 2**60
    assert rows["d"][2] == "u,\n\"'"
    assert list(pd.read_csv(tmp_path / "t.csv")["d"].fillna("")) == ["", "t", "u,\n\"'"]


def test_a_result_cannot_take_the_place_of_another_column(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, GRID)
    with pytest.raises(ValueError, match="run 0: results have the names of other columns: seed"):
        run_chunk(plan.text, [0], lambda *_: {"seed": 1}, tmp_path)


def test_the_summary_takes_draws_and_seeds_of_a_grid_point_together(tmp_path: Path) -> None:
    sweep = loaded(
        tmp_path,
        GRID.replace("seeds", "draw: {clocks.skew: {uniform: [0, 1e-4]}}\ndraws: 3\nseeds"),
    )
    outcome = swept(sweep, tmp_path / "out", inline, sweep_work.figures_with_failures)
    table = pd.read_parquet(outcome.folder.table)
    points = list(grid_points(outcome.folder.table, sweep.plan))
    assert [(point.runs, point.failed) for point in points] == [(15, 12)] * 4
    for (_, rows), point in zip(
        table.groupby(["errors.joint_noise.sigma_rad", "cell.ballbar_position_m.0"]),
        points,
        strict=True,
    ):
        assert list(point.values) == ["errors.joint_noise.sigma_rad", "cell.ballbar_position_m.0"]
        assert list(point.results["distance_mm_mrad"]) == list(rows["distance_mm_mrad"].dropna())


# -- the same bytes by any workers, however often they stop


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> tuple[LoadedSweep, SweepOutcome]:
    """A sweep computed without a break in this process."""
    folder = tmp_path_factory.mktemp("reference")
    sweep = loaded(folder, GRID.replace("count: 5", "count: 40"))
    return sweep, swept(sweep, folder / "out", inline)


@pytest.mark.slow
def test_an_interrupt_keeps_what_is_done_and_the_rest_follows(
    reference: tuple[LoadedSweep, SweepOutcome], tmp_path: Path
) -> None:
    sweep, whole = reference
    heard: list[str] = []
    killed: list[int] = []

    def interrupt(done: int, stage: str) -> None:
        heard.append(stage)
        if done and not killed:
            killed.append(done)
            os.kill(os.getpid(), signal.SIGINT)

    stopped = swept(sweep, tmp_path / "out", partial(processes, count=2), progress=interrupt)
    assert not stopped.finished
    assert 0 < stopped.done < sweep.plan.runs
    assert any(stage.startswith("stopping when the runs in progress are done") for stage in heard)
    kept = {
        path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "chunks").rglob("[0-9]*.json")
    }
    assert sum(len(json.loads(path.read_text())) for path in kept) == stopped.done
    again = swept(sweep, tmp_path / "out", partial(processes, count=1))
    assert again.finished
    assert again.resumed == stopped.done
    assert {path: path.stat().st_mtime_ns for path in kept} == kept, "no chunk was computed twice"
    assert table_bytes(again) == table_bytes(whole)


@pytest.mark.slow
def test_a_second_interrupt_drops_what_is_under_way_and_nothing_else(
    reference: tuple[LoadedSweep, SweepOutcome], tmp_path: Path
) -> None:
    sweep, whole = reference

    def interrupt(done: int, stage: str) -> None:
        if done:
            raise KeyboardInterrupt

    stopped = swept(sweep, tmp_path / "out", inline, progress=interrupt)
    assert 0 < stopped.done < sweep.plan.runs
    assert table_bytes(swept(sweep, tmp_path / "out", inline)) == table_bytes(whole)


def test_a_finished_sweep_is_not_run_again(reference: tuple[LoadedSweep, SweepOutcome]) -> None:
    sweep, whole = reference
    written = whole.folder.table.stat().st_mtime_ns
    again = swept(sweep, whole.folder.path, inline, sweep_work.path_text)
    assert whole.folder.table.stat().st_mtime_ns == written
    assert again.resumed == sweep.plan.runs


def test_a_torn_chunk_is_named_and_only_its_runs_are_repeated(
    reference: tuple[LoadedSweep, SweepOutcome], tmp_path: Path
) -> None:
    sweep, whole = reference
    plan = sweep.plan
    first = swept(sweep, tmp_path / "out", inline)
    first.folder.csv.unlink()
    torn = first.folder.chunk(3)
    torn.write_bytes(torn.read_bytes()[:100])
    with refused(r"000003\.json: cannot be read: .* Delete this file and run the sweep again"):
        swept(sweep, tmp_path / "out", inline)
    torn.unlink()
    again = swept(sweep, tmp_path / "out", inline)
    assert again.resumed == plan.runs - len(plan.chunk(3))
    assert table_bytes(again) == table_bytes(whole)


@pytest.mark.slow
def test_a_worker_that_dies_ends_the_sweep_in_words(tmp_path: Path) -> None:
    sweep = loaded(tmp_path, GRID)
    with pytest.raises(
        SweepError,
        match=r"a worker process died while it computed runs \d+ to \d+\. Is there enough memory\?",
    ):
        swept(sweep, tmp_path / "out", partial(processes, count=2), sweep_work.figures_or_death)


@pytest.mark.slow
def test_the_version_changes_with_a_byte_of_our_code(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    shutil.copytree(root / "ballbar", tmp_path / "ballbar")  # what it links as well

    def version() -> str:
        program = "from ballbar.code_version import code_version; print(code_version())"
        return subprocess.run(
            [sys.executable, "-c", program],
            cwd=tmp_path,
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
        ).stdout

    before = version()
    with (tmp_path / "ballbar/ident/estimator/solver.py").open("a") as file:
        file.write("#")
    assert version() != before


def test_a_worker_of_another_version_is_refused(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, GRID)
    other = plan.text.replace(plan.data.version, "0.0.9+00000000")
    with refused(
        r"a worker has version \S+, the sweep 0\.0\.9\+00000000\. Install the same version"
    ):
        run_chunk(other, [0], sweep_work.figures, tmp_path)


def test_a_worker_of_a_cluster_with_several_threads_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("MKL_NUM_THREADS", "4")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    sweep = loaded(tmp_path, GRID)
    with refused("with a nanny, Dask's default, or with OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1"):
        run_chunk_remotely(sweep.plan.text, [0], sweep_work.figures, sweep.files)


def test_chunks_of_another_sweep_or_version_are_never_mixed_in(tmp_path: Path) -> None:
    def started(plan: Plan) -> None:
        with open_folder(tmp_path / "out", plan) as folder:
            folder.start(())

    plan = plan_of(tmp_path, GRID)
    started(plan)
    with pytest.raises(
        InputError,
        match=r"plan\.yaml: its chunks are of another sweep "
        r"\(changed: vary\.cell\.ballbar_position_m\.0\); nothing was run",
    ):
        started(plan_of(tmp_path, GRID.replace("0.72", "0.73")))
    with refused(r"plan\.yaml: its chunks were computed by version \S+, this is 0\.0\.9"):
        started(Plan(plan.text.replace(plan.data.version, "0.0.9")))
    started(plan)


@pytest.mark.slow
def test_the_command_says_where_the_table_is_and_what_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ballbar.trial.trial.run_trial", sweep_work.figures_with_failures)
    loaded(tmp_path, GRID)
    monkeypatch.chdir(tmp_path)
    code, out, err = ballbar("sweep", "sweep.yaml", "--out", "out", "--workers", 2)
    assert code == 0
    assert "Table out/tried.parquet and tried.csv: 20 runs" in out, "no path of this machine"
    assert "16 of 20 runs failed; most often (8): no motion at 0.7 m in 4 s" in out
    assert [line.split()[:4] for line in out.splitlines() if line.startswith("1e-0")] == [
        [sigma, place, "5", "4"] for sigma in ("1e-06", "1e-05") for place in ("0.7", "0.72")
    ]
    assert err == "", "no bar where there is no terminal"


@pytest.mark.slow
def test_a_sweep_whose_every_run_fails_exits_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ballbar.trial.trial.run_trial", sweep_work.no_such_file)
    loaded(tmp_path, "seeds: {count: 3}\n")
    code, out, _ = ballbar(
        "sweep", tmp_path / "sweep.yaml", "--out", tmp_path / "out", "--workers", 1
    )
    assert code == 1
    assert "3 of 3 runs failed" in out


def test_bad_input_exits_with_2_and_writes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "sweep.yaml"
    file.write_text(HEAD + GRID.replace("1.0e-6", "-1.0e-6"))
    code, _, err = ballbar("sweep", file, "--out", tmp_path / "out")
    assert code == 2
    assert "sweep.yaml:5: errors.joint_noise.sigma_rad = -1e-06: expected 0 or more." in err
    assert not (tmp_path / "out").exists()
    code, _, err = ballbar("sweep", file, "--workers", 2, "--scheduler", "tcp://10.0.0.5:8786")
    assert code == 2
    assert "counts processes on this machine" in err


@pytest.mark.slow
@pytest.mark.long
def test_a_sweep_killed_at_any_time_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    """The command as a user runs it: killed with chunks half done, stopped by Ctrl-C, then left."""
    file = tmp_path / "real.yaml"
    file.write_text(REAL)
    options = ["--workers", "2", "--out", str(tmp_path / "broken")]
    command = [sys.executable, "-m", "ballbar", "sweep", str(file), *options]

    def killed(number: signal.Signals, chunks: int) -> tuple[int, str, list[psutil.Process]]:
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, start_new_session=True
        ) as sweep:
            until = time.monotonic() + 30.0
            while (
                len(list((tmp_path / "broken" / "chunks").rglob("[0-9]*.json"))) < chunks
                and time.monotonic() < until
            ):
                time.sleep(0.02)
            workers = psutil.Process(sweep.pid).children(recursive=True)
            if number == signal.SIGKILL:
                sweep.kill()
            else:
                os.killpg(sweep.pid, number)  # as a terminal does: workers hear it too
            said, _ = sweep.communicate(timeout=60.0)
        return sweep.returncode, said, workers

    code, _, workers = killed(signal.SIGKILL, 3)
    assert code == -signal.SIGKILL
    _, alive = psutil.wait_procs(workers, timeout=10.0)
    assert not alive, "workers end with their driver"
    code, said, _ = killed(signal.SIGINT, 10)
    assert code == 130
    assert "of 60 runs are done and kept" in said
    assert "The same command goes on from there." in said
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 0, done.stderr
    assert "real.parquet and real.csv: 60 runs, " in done.stdout
    assert "no run failed" in done.stdout
    whole = swept(
        loaded(tmp_path, REAL), tmp_path / "whole", partial(processes, count=2), run_trial
    )
    assert whole.resumed == 0
    for file in (whole.folder.table, whole.folder.csv, whole.folder.path / "plan.yaml"):
        assert (tmp_path / "broken" / file.name).read_bytes() == file.read_bytes()
    assert not list((tmp_path / "broken").rglob("*.part"))


# -- a Dask cluster: a real one, on this machine

NOTHING = Task("", sweep_work.figures, (), Path())


@pytest.mark.long
@pytest.mark.slow
def test_a_dask_cluster_that_loses_a_worker_gives_the_same_bytes(tmp_path: Path) -> None:
    """The killed worker had chunks in progress, and perhaps the files that all chunks need."""
    from distributed import LocalCluster  # noqa: PLC0415  slow to import

    sweep = loaded(tmp_path, GRID.replace("count: 5", "count: 40"))
    alone = swept(sweep, tmp_path / "alone", inline, sweep_work.figures_with_failures)
    killed: list[int] = []

    def kill_one(done: int, _stage: str) -> None:
        if done and not killed:
            killed.append(done)
            os.kill(cluster.workers[0].pid, signal.SIGKILL)

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        there = swept(
            sweep,
            tmp_path / "there",
            partial(dask_cluster, address=cluster.scheduler_address),
            sweep_work.figures_with_failures,
            kill_one,
        )
    assert killed
    assert killed[0] < sweep.plan.runs
    assert there.finished
    assert table_bytes(there) == table_bytes(alone)


@pytest.mark.slow
def test_without_a_scheduler_the_address_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_run, "CONNECT_TIMEOUT", 0.2)
    with (
        refused(r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers there"),
        dask_cluster(NOTHING, address="tcp://127.0.0.1:9"),
    ):
        pass


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        refused(r"needs distributed, which is not installed: pip install 'ballbar-bench\[dask\]'"),
        dask_cluster(NOTHING, address="tcp://127.0.0.1:9"),
    ):
        pass
