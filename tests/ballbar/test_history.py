"""Results of one robot over months: steps and drifts with their axes and dates, and refusals."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

import ballbar as bb
from ballbar import FitOptions
from ballbar.cell.arrays import Array
from ballbar.history.events import (
    AxisSeries,
    SeriesFit,
    count_of_tests,
    fit_series,
    limit,
    scatters,
)
from ballbar.history.history import Due, History, due, history_of, read_history
from ballbar.history.results import DatedResult
from ballbar.history.show import due_sentence, rows, sentences
from ballbar.ident.least_sizes import LITTLE_SHIFT
from tests.helpers.command_line import output, refusal
from tests.helpers.drawn_pose_tables import drawn_robot, point_table
from tests.helpers.pose_results import write_pose_result
from tests.helpers.simulated_recordings import Recorded

MONTHS = 24
SIGMA = 1e-5  # [rad]
STEP = 2e-4  # [rad]


def series(value: Array, sigma: float = SIGMA, t: Array | None = None) -> AxisSeries:
    """A zero whose error moves one tool position by 1 m per rad."""
    count = value.size
    times = np.arange(count, dtype=np.float64) if t is None else t
    own = np.full(count, sigma)
    return AxisSeries(
        name="rtheta3", axis=3, kind="zero", dates=np.arange(count), t=times, value=value,
        sigma=own, moves=np.eye(3)[0],
    )  # fmt: skip


def fitted(value: Array, sigma: float = SIGMA) -> SeriesFit:
    each = series(value, sigma)
    return fit_series(each, scatters([each])[0], limit(count_of_tests(each)), LITTLE_SHIFT)


def noise(seed: int, sigma: float = SIGMA, count: int = MONTHS) -> Array:
    return sigma * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize("at", [1, 7, 12, 22])
def test_a_step_is_found_at_its_date_with_its_size(at: int) -> None:
    fit = fitted(noise(at) + STEP * (np.arange(MONTHS) >= at))
    (event,) = fit.events
    assert not event.drift
    assert (event.earliest, event.at, event.latest) == (at, at, at)
    assert abs(event.size - STEP) < 3.0 * event.sigma < 0.3 * STEP


@pytest.mark.parametrize("begin", [0, 8])
def test_a_drift_is_found_with_its_rate_and_its_beginning(begin: int) -> None:
    """The dates that are said to explain it hold the true one in most of 40 draws."""
    held = 0
    for seed in range(40):
        fit = fitted(noise(seed) + 2e-5 * np.maximum(0, np.arange(MONTHS) - begin))
        (event,) = fit.events
        assert event.drift
        assert abs(event.at - begin) <= 3
        assert abs(event.size - 2e-5) < 4.0 * event.sigma < 5e-6
        assert fit.rate == pytest.approx((event.size, event.sigma))
        held += event.earliest <= begin <= event.latest
    assert held >= 36


def test_the_rate_of_a_drift_is_that_of_weighted_least_squares() -> None:
    """Against numpy.polyfit, with unequal deviations and times."""
    rng = np.random.default_rng(5)
    t, sigma = np.sort(rng.uniform(0, 20, 9)), rng.uniform(1e-5, 3e-5, 9)
    each = replace(series(sigma * rng.standard_normal(9), t=t), sigma=sigma)
    rate = fit_series(each, 1.0, 99.0, LITTLE_SHIFT).rate
    size, covariance = np.polyfit(t, each.value, 1, w=1.0 / sigma, cov="unscaled")
    assert rate == pytest.approx((size[0], np.sqrt(covariance[0, 0])), rel=1e-9)


def test_drift_and_step_of_one_axis_are_told_apart() -> None:
    month = np.arange(MONTHS)
    fit = fitted(noise(9) + 2e-5 * month + STEP * (month >= 15))
    assert [(e.drift, e.at) for e in fit.events if not e.drift] == [(False, 15)]
    assert [e.earliest for e in fit.events if e.drift] == [0]


def test_what_only_the_last_date_shows_is_neither_step_nor_drift_yet() -> None:
    (event,) = fitted(noise(2) + STEP * (np.arange(MONTHS) >= MONTHS - 1)).events
    assert event.either
    (event,) = fitted(np.array([0.0, STEP])).events
    assert event.either


@pytest.mark.parametrize("understated", [1.0, 3.0])
def test_nothing_is_found_where_nothing_changed(understated: float) -> None:
    """Also where the results scatter three times more than they state."""
    for seed in range(30):
        every = [series(noise(100 * seed + k, understated * SIGMA)) for k in range(8)]
        least = limit(sum(map(count_of_tests, every)))
        for each, factor in zip(every, scatters(every), strict=True):
            assert not fit_series(each, factor, least, LITTLE_SHIFT).events


def test_what_does_not_matter_to_the_tool_is_no_event() -> None:
    month = np.arange(MONTHS)
    assert not fitted(noise(1, 1e-8) + 4e-6 * (month >= 9), 1e-8).events
    assert fitted(noise(1, 1e-8) + 6e-6 * (month >= 9), 1e-8).events


@pytest.fixture(scope="module")
def monthly(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Twelve results of one drawn robot before a tracker; joint 3 stepped before the eighth."""
    folder, rng = tmp_path_factory.mktemp("monthly"), np.random.default_rng(4)
    drawn = drawn_robot("ur10", rng)
    folders = []
    for month in range(12):
        zero = np.zeros(6)
        zero[2] = STEP * (month >= 7)
        table = point_table(drawn, drawn.angles(60, rng), 3e-5, rng, zero=zero)
        result = bb.identify(table, options=FitOptions(joint_errors="none"))
        result.save(folder / f"m{month}")
        dated(folder / f"m{month}" / "calibration.yaml", date(2025, month + 1, 10))
        folders.append(folder / f"m{month}")
    return folders


def dated(file: Path, day: date) -> None:
    file.write_text(f"{file.read_text()}measured_on: '{day}'\n")


def test_a_step_of_a_measured_robot_is_named_with_axis_and_dates(monthly: list[Path]) -> None:
    """In any order of the folders; the tables come from no simulator of ours."""
    history = read_history(monthly[::-1])
    (finding,) = history.findings
    assert (finding.kind, finding.axes) == ("collision", (3,))
    assert (finding.begin, finding.end) == (date(2025, 7, 10), date(2025, 8, 10))
    ((fit, event),) = finding.events
    assert fit.series.name == "rtheta3"
    assert abs(event.size - STEP) < 4.0 * event.sigma
    assert not history.changes(0, 6)
    assert {f.series.name for f, _, _ in history.changes(0, 7)} == {"rtheta3"}


def test_a_robot_without_change_is_said_to_have_none(monthly: list[Path]) -> None:
    history = read_history(monthly[:7])
    assert not history.findings
    assert sentences(history)[0].startswith("No axis changed")
    expected = due(history, 2e-4)
    assert expected.latest is None
    assert expected.earliest is None or expected.earliest > date(2025, 8, 1)


def test_table_page_and_json_say_the_same(monthly: list[Path], tmp_path: Path) -> None:
    page = tmp_path / "history.html"
    text = output("history", *monthly, "--tolerance-mm", "0.2", "--out", page)
    sentence = "Between 2025-07-10 and 2025-08-10 axis 3 changed: zero of axis 3 "
    assert sentence in text
    assert sentence in page.read_text()
    assert "<svg" in page.read_text()
    data = json.loads(output("history", *monthly, "--tolerance-mm", "0.2", "--json"))
    assert data["findings"][0]["sentence"] in text
    assert data["due"]["sentence"] in text
    assert [r["date"] for r in data["results"]] == [f"2025-{k:02}-10" for k in range(1, 13)]


def test_figures_are_written_by_their_ending(monthly: list[Path], tmp_path: Path) -> None:
    output("history", *monthly[:3], "--out", tmp_path / "h.svg")
    assert (tmp_path / "h.svg").read_text().count("axis 3 [um]") == 1
    output("history", *monthly[:3], "--out", tmp_path / "h.png")
    assert (tmp_path / "h.png").read_bytes().startswith(b"\x89PNG")
    assert ".html, .svg or .png" in refusal("history", *monthly[:3], "--out", tmp_path / "h.pdf")


def test_a_result_whose_verdict_is_not_acceptable_is_shown_and_not_used(
    monthly: list[Path], tmp_path: Path
) -> None:
    bad = tmp_path / "calibration.yaml"
    content = (monthly[0] / "calibration.yaml").read_text()
    content = re.sub(r"status: \w+", "status: misfit", content).replace("2025-01-10", "2024-01-10")
    bad.write_text(content)
    history = read_history([bad, *monthly[:4]])
    assert not history.results[0].acceptable
    assert all(0 not in fit.series.dates for fit in history.fits)
    assert rows(history)[0][3] == "not used: verdict misfit"
    assert "misfit" in output("history", bad, *monthly[:4]).split()  # cells of a terminal wrap


def test_results_of_two_robots_or_of_one_day_are_refused(
    monthly: list[Path], tmp_path: Path
) -> None:
    other = write_pose_result(tmp_path / "calibration.yaml", "irb2400", seed=1)
    assert "is of robot" in refusal("history", monthly[0], other)
    assert "results of two days or more" in refusal("history", monthly[0], monthly[0])


def test_a_day_that_nothing_states_is_that_of_the_file(tmp_path: Path) -> None:
    first = write_pose_result(tmp_path / "first.yaml", "ur10", seed=1)
    second = write_pose_result(tmp_path / "second.yaml", "ur10", seed=1)
    dated(second, date(2020, 1, 1))
    history = read_history([first, second])
    assert [r.measured for r in history.results] == [True, False]
    assert history.results[0].day == date(2020, 1, 1)


def drifting(history: History, rate: float, sigma: float) -> Due:
    """When a history is due in which one zero drifts, by 1 m of the tool per rad."""
    fit = fitted(noise(1, 1e-9) + rate * np.arange(MONTHS), 1e-9)
    last = history.results[-1].calibration
    entry = last.file.fit.model_copy(update={"tcp_sigma_mean_m": sigma})
    certain = replace(last, file=last.file.model_copy(update={"fit": entry}))
    results = (*history.results[:-1], replace(history.results[-1], calibration=certain))
    return due(replace(history, results=results, fits=(fit,)), 1e-4)


def test_calibration_is_due_when_drift_and_uncertainty_reach_the_tolerance(
    monthly: list[Path],
) -> None:
    """sqrt(0.06^2 + (0.02 mm * 4 months)^2) = 0.1 mm."""
    history = read_history(monthly[:3])
    expected = drifting(history, 2e-5, 6e-5)
    assert expected.earliest is not None
    assert expected.latest is not None
    assert abs((expected.earliest - history.results[-1].day).days - 4 * 30.4) < 2
    assert (expected.latest - expected.earliest).days < 2
    assert "does not hold" in due_sentence(drifting(history, 2e-5, 2e-4))


def test_a_repetition_is_known_better_than_the_machine(recorded: Recorded) -> None:
    """Its deviations are the data's own; results of logs of one path are compared by them."""
    result = bb.identify(str(recorded.folder), options=FitOptions(samples=300))
    stated = result.file.covariance
    assert stated is not None
    repeated = np.array(stated.repeated_sigma)
    assert (repeated <= np.sqrt(np.diag(stated.covariance.of_names)) * (1.0 + 1e-9)).all()
    assert repeated[stated.names.index("bd3")] < 0.8 * result.sigma["bd3"]  # the rod's own length
    pair = tuple(DatedResult(date(2026, month, 1), True, result) for month in (1, 2))
    history = history_of(pair, np.zeros(2))
    assert history.repeated
    assert {fit.series.axis for fit in history.fits} == {1, 2, 3, 4, 5}
    assert not history.findings


@pytest.mark.parametrize("factor", [0.3, 1.0, 2.5])
def test_the_scatter_is_that_of_values_about_what_their_neighbours_predict(factor: float) -> None:
    """Uneven dates, a steady drift and deviations that differ by five times."""
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.2, 3.0, 600))
    sigma = SIGMA * rng.uniform(0.4, 2.0, 600)
    value = 1e-5 * t + factor * sigma * rng.standard_normal(600)
    each = replace(series(value, t=t), sigma=sigma)
    assert scatters([each])[0] == pytest.approx(max(1.0, factor), rel=0.06)
    few = replace(series(value[:4], t=t[:4]), sigma=0.01 * sigma[:4])
    assert scatters([few]) == [1.0]


def test_a_series_that_scatters_little_by_chance_has_the_scatter_of_its_kind() -> None:
    rng = np.random.default_rng(6)
    three = [series(s * SIGMA * rng.standard_normal(400)) for s in (1.0, 3.0, 3.0)]
    other = replace(series(5.0 * SIGMA * rng.standard_normal(400)), kind="twist")
    assert scatters([*three, other]) == pytest.approx([3.0, 3.0, 3.0, 5.0], rel=0.1)
