"""Evenly taken rows with stamps in coarse steps: their times come back."""

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.explain import explain_lines
from ballbar.acquisition.recording import read_recording
from ballbar.acquisition.stamps.order import STAMP
from ballbar.acquisition.stamps.quantised import spread
from ballbar.acquisition.table.table import Table
from ballbar.cell.errors import LogError
from tests.helpers.device_logs import ROBOT_T, joint_trajectory, robot_lines, stamped, write

Array = np.ndarray
ROWS = 5000
COMMON = 1 + 3e-5  # no controller's crystal agrees with another clock to better than some ppm


def table(t: Array, step: float) -> Table:
    """Rows taken at t [s], stamped with the last step of a clock."""
    return table_of(np.rint(np.floor(t / step) * step * 1e9).astype(np.int64))


def table_of(stamps: Array) -> Table:
    """Rows with stamps [ns]."""
    rows = np.arange(stamps.size)
    return Table({STAMP: stamps}, ("log.csv",), np.zeros_like(rows), rows + 2)


def off(stamps: Array, t: Array) -> Array:
    """(N,) [s] of stamps [ns], a shift common to all rows apart."""
    error = stamps * 1e-9 - t
    return np.abs(error - np.median(error))


@pytest.mark.parametrize(
    ("period", "step"), [(0.004032, 0.001), (0.004032, 0.016), (0.002016, 0.001), (0.012, 0.015625)]
)
def test_the_times_of_even_rows_come_back(period: float, step: float) -> None:
    t = 7.0031 + COMMON * period * np.arange(ROWS)
    coarse = table(t, step)
    fine = spread(coarse)
    assert off(coarse.columns[STAMP], t).max() > 0.45 * step
    assert off(fine.columns[STAMP], t).max() < 20e-6
    assert [(entry.kind, entry.severity, entry.count) for entry in fine.findings] == [
        ("quantised stamps", "repaired", ROWS)
    ]


@pytest.mark.parametrize(
    ("period", "step", "divisor"), [(0.004, 0.016, 0.004), (0.01, 0.016, 0.002)]
)
def test_commensurable_periods_are_known_to_half_the_common_divisor(
    period: float, step: float, divisor: float
) -> None:
    t = 7.0031 + (1 + 1e-7) * period * np.arange(ROWS)  # rows and steps keep their few phases
    coarse = table(t, step)
    assert (
        off(spread(coarse).columns[STAMP], t).max()
        <= 0.51 * divisor
        < off(coarse.columns[STAMP], t).max()
    )


@pytest.mark.parametrize("step", [0.001, 0.016])
def test_behind_lost_and_late_rows_the_line_begins_anew(step: float) -> None:
    t = 7.0031 + COMMON * 0.004032 * np.arange(ROWS)
    t[3000:] += 0.0231
    t = np.delete(t, [1000, 1001, 2000])
    fine = spread(table(t, step))
    error = off(fine.columns[STAMP], t)
    assert "anew at 3 places" in fine.findings[0].sentence
    assert np.quantile(error, 0.95) < 0.03 * step
    assert (
        error.max() <= 2.1 * 0.004032
    )  # rows beside such a place may be put to the other side of it


def test_a_clock_that_was_set_back_has_a_line_on_either_side() -> None:
    t = 7.0031 + COMMON * 0.004032 * np.arange(ROWS)
    shown = table(t, 0.016)
    shown.columns[STAMP][2000:] -= 1_600_000_000
    fine = spread(shown).columns[STAMP]
    assert np.flatnonzero(np.diff(fine) <= 0).tolist() == [1999]
    fine[2000:] += 1_600_000_000
    assert off(fine, t).max() < 100e-6


def test_rows_of_a_logger_that_comes_late_are_not_even(tmp_path: Path) -> None:
    late = np.random.default_rng(1).random(ROWS) < 0.1
    t = 7.0031 + np.cumsum(0.010 + 0.005 * late)
    with pytest.raises(
        LogError,
        match=(
            r"log.csv:\d+: declared as quantised, but the rows do not come evenly: .* missing at "
            r"\d+ places"
        ),
    ):
        spread(table(t, 0.001), declared=True)
    with pytest.raises(LogError, match=r"log\.csv:2: all rows have the same stamp"):
        spread(table(t, 1000.0), declared=True)


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng([seed, 31])


EVEN = 0.004 * np.arange(ROWS)
NOT_COARSE = {
    "microseconds": (COMMON * 0.004032 * np.arange(ROWS), 1e-6),
    "a period of whole steps": (EVEN, 0.001),
    "rows that are lost at random": (np.delete(EVEN, rng(1).integers(1, ROWS, 50)), 0.004),
    "many of them": (np.delete(EVEN, rng(2).integers(1, ROWS, 500)), 0.004),
    "stamps that jitter by more than a step": (EVEN + 2e-3 * rng(3).random(ROWS), 0.001),
    "rows that come late now and then": (
        np.cumsum(0.01 + 0.005 * (rng(4).random(ROWS) < 0.1)),
        0.001,
    ),
}


@pytest.mark.parametrize("log", NOT_COARSE)
def test_stamps_that_are_exact_or_of_uneven_rows_stay_as_they_are(log: str) -> None:
    t, step = NOT_COARSE[log]
    stamped_rows = table(7.0031 + np.sort(t), step)
    assert spread(stamped_rows) is stamped_rows


@pytest.mark.parametrize("kind", ["late", "lost", "late, lost and written twice"])
@pytest.mark.parametrize("events", [10, 20, 60])
def test_exact_stamps_stay_whatever_chance_does_to_some_rows(kind: str, events: int) -> None:
    """With ten of them three in ten logs passed for coarse, with rows written twice every one."""
    for seed in range(10):
        chance = rng(seed)
        distances = np.full(12_000, 0.010)
        rows = chance.choice(distances.size, events, replace=False)
        distances[rows] = 0.020 if kind == "lost" else 0.015
        if "twice" in kind:
            distances[rows[: events // 5]] = 0.020
            distances[chance.choice(distances.size, 1 + events // 8, replace=False)] = 0.0
        stamped_rows = table(7.0031 + np.cumsum(distances), 0.001)
        assert spread(stamped_rows) is stamped_rows, seed


def test_coarse_stamps_that_are_declared_exact_stay_as_they_are() -> None:
    coarse = table(7.0031 + COMMON * 0.004032 * np.arange(ROWS), 0.001)
    assert spread(coarse, declared=False) is coarse
    assert spread(coarse) is not coarse


def test_coarse_stamps_show_themselves_where_rows_are_lost_or_late() -> None:
    t = 7.0031 + COMMON * 0.004032 * np.arange(ROWS)
    t[3000:] += 0.0231
    t = np.delete(t, rng(5).integers(1, ROWS, 5))
    fine = spread(table(t, 0.001)).columns[STAMP]
    assert np.quantile(off(fine, t), 0.95) < 50e-6


def test_a_log_with_rows_that_share_stamps_is_read_unless_they_are_declared_exact(
    tmp_path: Path,
) -> None:
    lines = robot_lines()
    steps = np.floor((100.0 + ROBOT_T) / 0.016) * 0.016
    coarse = [
        lines[0],
        *(
            stamped(line, f"{stamp:.3f}")
            for line, stamp in zip(lines[1:], steps.tolist(), strict=True)
        ),
    ]
    with pytest.raises(LogError, match=r"clock is too coarse\. .* declare `quantised: true`"):
        read_recording(
            write(
                tmp_path,
                robot=coarse,
                change=lambda data: data["sources"]["robot"].update(quantised=False),
            )
        )
    declared = write(
        tmp_path, robot=coarse, change=lambda data: data["sources"]["robot"].update(quantised=True)
    )
    assert any(
        "stamps step by more than can be neglected" in line for line in explain_lines(declared)
    )
    recording = read_recording(write(tmp_path, robot=coarse))
    log = recording.robot_log
    assert len(log.t) == len(ROBOT_T)
    np.testing.assert_allclose(log.t, ROBOT_T, atol=1e-4)
    np.testing.assert_allclose(log.q, joint_trajectory(log.t), atol=1e-4)
    remark = next(entry for entry in recording.report.findings if entry.kind == "quantised stamps")
    assert remark.sentence.startswith(
        "stamps in steps of 16 ms, rows put evenly between them, 4.03"
    )


def test_some_rows_that_are_half_a_period_late_do_not_show_a_coarse_clock() -> None:
    """Regression: 9 of 3000 such logs were put on even rows, with their rows up to 3 ms off."""
    for draw in range(400):
        distances = np.full(999, 10_000_000)
        distances[np.random.default_rng([10, draw]).choice(999, 10, replace=False)] = 15_000_000
        assert not spread(table_of(np.cumsum(distances))).findings
