"""A sweep that has grown keeps its rows, computes what is missing, and ends as if run at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from ballbar.cell.errors import InputError
from ballbar.scenario import Scenario
from ballbar.sweep.folder import changed_keys, earlier_number
from ballbar.sweep.plan import run_of
from ballbar.sweep.run import SweepOutcome
from tests.helpers import sweep_work
from tests.helpers.sweeps import inline, loaded, swept, table_bytes

SMALL = """together:
  - {label: one, clocks.skew: 1.0e-5}
  - {label: two, clocks.offset_s: 0.5}
vary: {errors.joint_noise.sigma_rad: [1.0e-6, 1.0e-4], identify.samples: [100, 200]}
draw: {cell.ballbar_position_m.0: {uniform: [0.7, 0.72]}}
draws: 3
seeds: {first: 3, count: 4}
"""
RUNS = 2 * 2 * 2 * 3 * 4
GROWTHS = {
    "seeds": ("first: 3, count: 4", "first: 1, count: 9"),
    "draws": ("draws: 3", "draws: 5"),
    "a value before the others": ("[100, 200]", "[50, 100, 200]"),
    "a value of another type": ("[1.0e-6, 1.0e-4]", "[1.0e-6, 1, 1.0e-4]"),
    "a row": ("  - {label: two", "  - {label: half, clocks.skew: 2.0e-5}\n  - {label: two"),
}
REORDERED = SMALL.replace("[100, 200]", "[200, 100]")


def ignored(done: int, stage: str) -> None:
    """Progress that nobody looks at."""


def run(
    folder: Path, text: str, name: str = "out", progress: Callable[[int, str], None] = ignored
) -> tuple[SweepOutcome, int]:
    """Outcome of a sweep in `folder/name`, and how many runs were computed."""
    seeds: list[int] = []

    def trial(scenario: Scenario, files: Path) -> Mapping[str, float | int | str]:
        seeds.append(scenario.seed)
        if scenario.seed == 4:
            raise ZeroDivisionError("division by zero")
        late = {"late": 1.5} if scenario.seed == 6 else {}
        return late | sweep_work.figures(scenario, files)

    return swept(loaded(folder, text), folder / name, inline, trial, progress), len(seeds)


@pytest.fixture(scope="module")
def grown_at_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, tuple[bytes, bytes]]:
    """The small sweep with all growths, and its table when it is run without a break."""
    folder, text = tmp_path_factory.mktemp("whole"), SMALL
    for old, new in GROWTHS.values():
        text = text.replace(old, new)
    return text, table_bytes(run(folder, text)[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", GROWTHS)
def test_only_what_is_missing_is_run_and_the_table_is_that_of_one_run(
    name: str, tmp_path: Path
) -> None:
    assert run(tmp_path, SMALL)[1] == RUNS
    text = SMALL.replace(*GROWTHS[name])
    grown, computed = run(tmp_path, text)
    assert grown.finished
    assert (grown.resumed, computed) == (RUNS, grown.folder.plan.runs - RUNS)
    assert table_bytes(grown) == table_bytes(run(tmp_path, text, "whole")[0])
    assert run(tmp_path, text)[1] == 0, "it is finished"


@pytest.mark.slow
def test_a_growth_that_is_interrupted_and_grows_again_loses_nothing(
    grown_at_once: tuple[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    text, whole = grown_at_once

    def stopped(text: str, before: int, more: int) -> int:
        """Runs that are done when a sweep is stopped; `before` of them were already."""

        def interrupt(done: int, stage: str) -> None:
            if done >= before + more:
                raise KeyboardInterrupt

        outcome, computed = run(tmp_path, text, progress=interrupt)
        assert not outcome.finished
        assert outcome.resumed == before
        # an interrupt drops what was computed and not yet returned
        assert before + more <= outcome.done <= before + computed
        return outcome.done

    done = stopped(SMALL, 0, 30)
    first, computed = run(tmp_path, SMALL)
    assert computed == RUNS - done
    table = table_bytes(first)
    done = stopped(SMALL.replace(*GROWTHS["seeds"]), RUNS, 25)
    assert table_bytes(first) == table, "the last complete one stays"
    done = stopped(text, done, 40)
    last, computed = run(tmp_path, text)
    assert (last.resumed, computed) == (done, last.folder.plan.runs - done)
    assert table_bytes(last) == whole


@pytest.mark.slow
def test_the_table_is_written_anew_for_each_order(tmp_path: Path) -> None:
    first, _ = run(tmp_path, SMALL)
    table = table_bytes(first)
    other, computed = run(tmp_path, REORDERED)
    assert computed == 0
    assert table_bytes(other) == table_bytes(run(tmp_path, REORDERED, "whole")[0]) != table
    again, computed = run(tmp_path, SMALL)
    assert (table_bytes(again), computed) == (table, 0)


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("draws: 3", "draws: 2", "draws"),
        ("count: 4", "count: 3", "seeds"),
        ("first: 3", "first: 4", "seeds"),
        ("[100, 200]", "[100, 300]", "vary.identify.samples"),
        ("identify.samples: [100, 200]", "identify.cost: [ml]", "vary"),
        ("0.72", "0.73", "draw"),
        ("seeds:", "seed: 1\nseeds:", "seed"),
        ("1.0e-5}", "1.5e-5}", "together"),
        (
            "vary:",
            "change: {clocks.skew: 0, path.stops: 1}\nvary:",
            "scenario.clocks.skew, scenario.path.stops",
        ),
    ],
)
def test_another_sweep_is_refused_with_what_differs(
    old: str, new: str, changed: str, tmp_path: Path
) -> None:
    def interrupt(done: int, stage: str) -> None:
        raise KeyboardInterrupt

    run(tmp_path, SMALL, progress=interrupt)
    words = re.escape(f"plan.yaml: its chunks are of another sweep (changed: {changed}); nothing")
    with pytest.raises(InputError, match=words):
        run(tmp_path, SMALL.replace(old, new))


def test_a_run_of_a_smaller_plan_has_the_same_values_and_seed(
    grown_at_once: tuple[str, tuple[bytes, bytes]], tmp_path: Path
) -> None:
    small, grown = loaded(tmp_path, SMALL).plan, loaded(tmp_path, grown_at_once[0]).plan
    assert changed_keys(grown, small) == []
    pairs = [(k, earlier_number(grown, k, small)) for k in range(grown.runs)]
    assert sorted(number for _, number in pairs if number is not None) == list(range(RUNS))
    for new, old in ((run_of(grown, k), run_of(small, n)) for k, n in pairs if n is not None):
        assert (new.values, new.seed) == (old.values, old.seed)
