"""Results of one robot over months: steps and drifts with their axes and dates, and refusals."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.dates import date2num

import ballbar as bb
from ballbar import FitOptions
from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.history import results as stored_results
from ballbar.history import show
from ballbar.history.events import (
    AxisEvent,
    AxisSeries,
    SeriesFit,
    count_of_tests,
    fit_series,
    limit,
    scatters,
)
from ballbar.history.figure import history_figure
from ballbar.history.history import Due, History, _findings, _rates, due, history_of, read_history
from ballbar.history.results import MONTH, DatedResult, _quantity
from ballbar.history.show import _amounts, _changed, due_sentence, rows, sentences
from ballbar.ident.least_sizes import LITTLE_RIPPLE, LITTLE_SHIFT
from ballbar.report.numbers import MISSING
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
    """Eight results of one drawn robot before a tracker; joint 3 stepped before the sixth."""
    folder, rng = tmp_path_factory.mktemp("monthly"), np.random.default_rng(4)
    drawn = drawn_robot("ur10", rng)
    folders = []
    for month in range(8):
        zero = np.zeros(6)
        zero[2] = STEP * (month >= 5)
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
    assert (finding.begin, finding.end) == (date(2025, 5, 10), date(2025, 6, 10))
    ((fit, event),) = finding.events
    assert fit.series.name == "rtheta3"
    assert abs(event.size - STEP) < 4.0 * event.sigma
    assert not history.changes(0, 4)
    assert {f.series.name for f, _, _ in history.changes(0, 5)} == {"rtheta3"}


def test_a_robot_without_change_is_said_to_have_none(monthly: list[Path]) -> None:
    history = read_history(monthly[:5])
    assert not history.findings
    assert sentences(history)[0].startswith("No axis changed")
    expected = due(history, 2e-4)
    assert expected.latest is None
    assert expected.earliest is None or expected.earliest > date(2025, 6, 1)


def test_table_page_and_json_say_the_same(monthly: list[Path], tmp_path: Path) -> None:
    page = tmp_path / "history.html"
    text = output("history", *monthly, "--tolerance-mm", "0.2", "--out", page)
    sentence = "Between 2025-05-10 and 2025-06-10 axis 3 changed: zero of axis 3 "
    assert sentence in text
    assert sentence in page.read_text()
    assert "<svg" in page.read_text()
    data = json.loads(output("history", *monthly, "--tolerance-mm", "0.2", "--json"))
    assert data["findings"][0]["sentence"] in text
    assert data["due"]["sentence"] in text
    assert [r["date"] for r in data["results"]] == [f"2025-{k:02}-10" for k in range(1, 9)]


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


def event(size: float, sigma: float, **changes: Any) -> AxisEvent:
    """A step at the sixth of ten dates."""
    told = AxisEvent(
        drift=False, at=5, earliest=5, latest=5, size=size, sigma=sigma, gain=100.0, either=False
    )
    return replace(told, **changes)


def found(
    *events: AxisEvent, name: str = "rtheta3", axis: int = 3, kind: str = "zero", **changes: Any
) -> SeriesFit:
    """A quantity of an axis with events; ten dates a month apart."""
    own = replace(series(np.zeros(10)), name=name, axis=axis, kind=kind, **changes)
    return SeriesFit(
        series=own, sigma=own.sigma, events=events, fitted=np.zeros(10),
        fitted_sigma=np.zeros(10), rate=(0.0, 0.0),
    )  # fmt: skip


DAYS = [date(2025, month, 1) for month in range(1, 11)]


def told(*fits: SeriesFit) -> list[tuple[str, tuple[int, ...], int, int]]:
    """Kind, axes, and the months between which each finding lies."""
    return [(f.kind, f.axes, f.begin.month, f.end.month) for f in _findings(fits, DAYS)]


def test_steps_of_one_month_are_one_collision_and_a_gears_own_are_the_gears() -> None:
    """Zeros of axes 2 and 4 with backlash of axis 5, which was replaced with its zero."""
    zeros = [found(event(1e-4, 1e-5), axis=axis) for axis in (4, 2, 5)]
    gear = found(event(3e-4, 1e-5, gain=300.0), axis=5, kind="backlash")
    assert told(*zeros, gear) == [("gear", (5,), 5, 6), ("collision", (2, 4), 5, 6)]


@pytest.mark.parametrize("kind", ["backlash", "compliance", "ripple"])
def test_play_stiffness_and_ripple_are_the_gears_alone(kind: str) -> None:
    assert told(found(event(1e-4, 1e-5), kind=kind)) == [("gear", (3,), 5, 6)]
    assert told(found(event(1e-4, 1e-5), kind="twist")) == [("collision", (3,), 5, 6)]


def test_steps_are_of_one_day_where_the_days_of_all_of_them_meet() -> None:
    """May to August with June to July, but not with August to September; in order of time."""
    wide = found(event(1e-4, 1e-5, earliest=5, latest=7), axis=1)
    inside = found(event(1e-4, 1e-5, earliest=6, latest=6, gain=50.0), axis=2)
    later = found(event(1e-4, 1e-5, earliest=8, latest=8, gain=200.0), axis=3)
    assert told(later, wide, inside) == [("collision", (1, 2), 6, 7), ("collision", (3,), 8, 9)]


def test_a_drift_is_wear_of_its_axis_and_what_may_be_either_is_a_change() -> None:
    """The earliest of its quantities says when it began; what wears stands before what stepped."""
    drift = event(1e-5, 1e-6, drift=True, earliest=3, latest=4)
    backlash = found(replace(drift, earliest=2, latest=5), kind="backlash")
    assert told(found(event(1e-4, 1e-5), axis=1), found(drift), backlash) == [
        ("wear", (3,), 3, 6),
        ("collision", (1,), 5, 6),
    ]
    unclear = event(1e-4, 1e-5, either=True)
    assert told(found(unclear)) == [("change", (3,), 5, 6)]
    assert told(found(unclear), found(event(1e-4, 1e-5), axis=2))[0][0] == "collision"


def test_a_step_lies_between_two_dates_of_its_own_series() -> None:
    """A quantity that was not stated in May stepped after April."""
    dates = np.array([0, 1, 2, 3, 5, 6, 7, 8, 9, 9])
    fit = found(event(1e-4, 1e-5, earliest=4, latest=4), dates=dates)
    assert told(fit) == [("collision", (3,), 4, 6)]


def test_amounts_are_in_mrad_with_two_sigmas_and_of_a_gear_per_newton_metre() -> None:
    def amount(fit: SeriesFit) -> str:
        (text,) = _amounts(tuple((fit, event) for event in fit.events))
        return text

    assert amount(found(event(-2.5e-4, 1e-5))) == "zero of axis 3 -0.25 ± 0.02 mrad"
    drift = event(1.2e-5, 1e-6, drift=True)
    assert amount(found(drift)) == "zero of axis 3 +0.012 ± 0.002 mrad a month"
    soft = found(event(3e-7, 2e-8), kind="compliance")
    assert amount(soft) == "compliance of axis 3 +0.30 ± 0.04 urad/(N m)"
    assert amount(found(event(1e-3, 1e-4), kind="twist")).startswith("angle of axis 3 to 4 +1.0")


def test_sine_and_cosine_of_a_ripple_are_one_amplitude() -> None:
    """3 and 4 urad are 5; it has no sign, and the larger of both deviations."""
    parts = [
        (found(event(3e-6, 1e-7), name="ripple3_50_sin", kind="ripple"), 3e-6, 1e-7),
        (found(event(-4e-6, 2e-7), name="ripple3_50_cos", kind="ripple"), -4e-6, 2e-7),
    ]
    pairs = tuple((fit, fit.events[0]) for fit, _, _ in parts)
    assert list(_amounts(pairs)) == ["ripple of axis 3 (50 a turn) 0.0050 ± 0.0004 mrad"]


def history_with(*fits: SeriesFit, results: Sequence[Any] = (), **changes: Any) -> History:
    whole = History(
        results=tuple(results), nominal=np.full(len(results), 1e-3), fits=fits, limit=5.0,
        repeated=True, findings=tuple(_findings(fits, DAYS)),
    )  # fmt: skip
    return replace(whole, **changes)


def test_findings_are_sentences_with_their_cause() -> None:
    step = found(event(-2.5e-4, 1e-5))
    (said,) = sentences(history_with(step))
    assert said == (
        "Between 2025-05-01 and 2025-06-01 axis 3 changed: zero of axis 3 -0.25 ± 0.02 mrad: a "
        "collision, or a zero that was set again."
    )
    (said,) = sentences(history_with(step, found(event(1e-4, 1e-5), axis=1)))
    assert "axes 1 and 3 changed" in said
    drift = found(event(1.2e-5, 1e-6, drift=True, earliest=3, latest=4))
    (said,) = sentences(history_with(drift))
    assert said.startswith("Axis 3 wears since 2025-05-01 at the latest: zero of axis 3 +0.012")


def test_where_nothing_is_found_the_quantities_are_counted_or_there_are_none() -> None:
    (said,) = sentences(history_with(found(), found(axis=1)))
    assert said == "No axis changed by more than chance explains, of 2 quantities of axes 1 and 3."
    assert sentences(history_with())[0].startswith("Nothing can be compared")


def changed_between(*sizes: float, axes: Sequence[int], sigma: float = 1e-5) -> History:
    """Zeros that are 0 at the first five dates and so much at the last five."""
    fits = []
    for size, axis in zip(sizes, axes, strict=True):
        value = size * (np.arange(10) >= 5)
        own = replace(series(value, sigma), axis=axis)
        fits.append(replace(found(), series=own, sigma=own.sigma))
    return history_with(*fits)


def test_a_change_between_two_results_is_named_beyond_its_sigma_and_what_the_tool_feels() -> None:
    """Two deviations of 10 urad: 14.1, five times that is 71; 5 um at a metre are 5 urad."""
    history = changed_between(72e-6, -69e-6, -300e-6, axes=(1, 2, 3))
    changes = history.changes(2, 7)
    assert [(fit.series.axis, size) for fit, size, _ in changes] == [
        (3, pytest.approx(-300e-6)),
        (1, pytest.approx(72e-6)),
    ]
    assert changes[0][2] == pytest.approx(-300.0 / np.hypot(10.0, 10.0))
    assert not history.changes(0, 4)
    felt = changed_between(4.9e-6, 5.1e-6, axes=(1, 2), sigma=1e-8)
    assert [fit.series.axis for fit, _, _ in felt.changes(0, 9)] == [2]
    missing = changed_between(1e-3, axes=(1,))
    later = replace(
        missing.fits[0], series=replace(missing.fits[0].series, dates=np.arange(10) + 1)
    )
    assert not replace(missing, fits=(later,)).changes(0, 7)


def test_a_row_names_the_two_axes_that_changed_most_and_counts_the_others() -> None:
    history = changed_between(200e-6, -400e-6, 300e-6, 100e-6, axes=(1, 2, 3, 4))
    assert _changed(history, 2, 7) == (
        "axis 2: zero -0.40 mrad (28 sigma), axis 3: zero +0.30 mrad (21 sigma), 2 more"
    )
    assert _changed(history, 0, 1) == MISSING
    one = changed_between(200e-6, -400e-6, 300e-6, axes=(1, 1, 1))
    assert _changed(one, 2, 7) == "axis 1: zero -0.40 mrad (28 sigma)"


def test_each_row_is_compared_with_the_first_and_the_last_that_were_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second one is not used; a day that nothing states is that of the file."""
    monkeypatch.setattr(show, "_changed", lambda _, first, last: f"{first} to {last}")

    def result(k: int, *, used: bool, measured: bool = True) -> Any:
        file = SimpleNamespace(fit=SimpleNamespace(status="misfit"))
        calibration = SimpleNamespace(tcp_sigma=2e-5, file=file)
        return SimpleNamespace(
            day=DAYS[k], measured=measured, calibration=calibration, acceptable=used
        )

    results = [result(0, used=True), result(1, used=False), result(2, used=True, measured=False)]
    results.append(result(3, used=True))
    table = rows(history_with(results=results))
    assert [row[0] for row in table] == [
        "2025-01-01", "2025-02-01", "2025-03-01 (file)", "2025-04-01",
    ]  # fmt: skip
    assert table[0][1:] == ("1.00", "0.0200", "", "")
    assert table[1][3:] == ("not used: verdict misfit", "")
    assert [row[3:] for row in table[2:]] == [("0 to 2", "0 to 2"), ("0 to 3", "2 to 3")]


def test_due_is_said_with_its_days_or_that_no_day_is_certain() -> None:
    early, late = date(2026, 3, 1), date(2026, 9, 1)
    expected = Due(2e-4, 5e-5, (1e-6, 4.5e-6), early, late)
    assert due_sentence(expected) == (
        "Next calibration at 0.200 mm mean TCP error: between 2026-03-01 and 2026-09-01; the tool "
        "drifts by 1.0 to 4.5 um a month (95 %)."
    )
    assert "not before 2026-03-01" in due_sentence(replace(expected, latest=None))
    assert "not before ten years" in due_sentence(replace(expected, latest=None, earliest=None))
    assert due_sentence(replace(expected, sigma=2e-4)).startswith(
        "The last calibration does not hold 0.200 mm: its stated uncertainty is 0.200 mm"
    )


def test_the_tools_rate_is_the_root_mean_square_of_its_axes_and_half_known_ones_are_slow() -> None:
    """Two axes move the tool along x and y, 1 and 2 m per rad, by 3 and 2 urad a month: 5 um."""
    certain = event(1e-6, 1e-9, drift=True)
    first = replace(found(certain, moves=np.array([1.0, 0.0, 0.0])), rate=(3e-6, 0.0))
    second = replace(found(certain, moves=np.array([0.0, 2.0, 0.0])), rate=(2e-6, 0.0))
    assert _rates([first, second]) == pytest.approx((5e-6, 5e-6))
    over_two = np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    assert _rates([replace(first, series=replace(first.series, moves=over_two))]) == pytest.approx(
        (3e-6, 3e-6)
    )
    unnamed = replace(second, events=())
    assert _rates([first, unnamed]) == pytest.approx((3e-6, 5e-6))
    spread = replace(first, rate=(0.0, 1e-6), events=())
    slow, fast = _rates([spread])
    assert slow == 0.0
    assert fast == pytest.approx(2.24e-6, rel=0.06)  # 97.5 % of |z| of a normal deviate
    assert _rates([]) == (0.0, np.inf)


def test_due_within_ten_years_only_and_of_the_last_result_that_is_used() -> None:
    """0.1 mm at 1 um a month take 100 months; at half of that they are beyond the horizon."""

    def at(rate: float, *, used: bool = True) -> Due:
        calibration = SimpleNamespace(tcp_sigma=0.0)
        last = SimpleNamespace(day=date(2025, 1, 1), calibration=calibration, acceptable=used)
        drift = event(rate, 0.0, drift=True)
        fit = replace(found(drift), rate=(rate, 0.0))
        return due(history_with(fit, results=[last]), 1e-4)

    soon = at(1e-6)
    assert soon.earliest == soon.latest == date(2025, 1, 1) + timedelta(days=100.0 * MONTH)
    assert at(0.5e-6).earliest is None
    assert at(0.0).latest is None
    with pytest.raises(InputError, match="none is acceptable, so none is in use"):
        at(1e-6, used=False)


def test_quantities_are_of_an_axis_and_of_a_kind_or_are_not_compared() -> None:
    assert _quantity("backlash2", 6) == (2, "backlash")
    assert _quantity("typical_compliance4", 6) == (4, "compliance")
    assert _quantity("ripple3_50_sin", 6) == (3, "ripple")
    assert _quantity("joint5_17_cos", 6) == (5, "ripple")
    assert _quantity("rtheta3", 6) == (3, "zero")
    assert _quantity("ralpha5", 6) == (5, "twist")
    assert _quantity("rtheta6", 6) is None  # the last row holds what the tool was mounted by
    assert _quantity("ra2", 6) is None
    assert _quantity("btheta2", 6) is None
    assert _quantity("mass3", 6) is None


def test_the_limit_is_what_chance_exceeds_once_in_a_thousand_histories() -> None:
    """One test: 3.29 deviations; a hundred, so 1e-5 each: 4.42 (two-sided normal)."""
    assert limit(1) == pytest.approx(3.2905, abs=1e-4)
    assert limit(100) == pytest.approx(4.4172, abs=1e-4)
    assert limit(0) == limit(1)


def test_tests_are_counted_by_events_and_pairs_of_dates() -> None:
    """Four dates: three steps, two drifts, two comparisons each; two days: one step."""
    assert count_of_tests(series(np.zeros(4))) == 3 + 2 + 8
    same_day = series(np.zeros(4), t=np.array([0.0, 0.0, 1.0, 1.0]))
    assert count_of_tests(same_day) == 1 + 8


def test_the_effect_of_play_and_ripple_is_at_least_that_at_a_metre() -> None:
    moves = np.array([3e-1, 4e-1, 0.0, 0.0, 0.0, 0.1])
    assert replace(series(np.zeros(3)), moves=moves).effect == pytest.approx(0.3)
    least = LITTLE_SHIFT / LITTLE_RIPPLE
    for kind in ("backlash", "ripple"):
        own = replace(series(np.zeros(3)), moves=moves, kind=kind)
        assert own.effect == max(0.3, least) == pytest.approx(least)


def test_after_a_step_the_rate_is_that_of_the_dates_beside_it() -> None:
    """Against numpy's least squares of a constant, a line and the step."""
    month = np.arange(float(MONTHS))
    value = noise(3) + STEP * (month >= 10)
    fit = fitted(value)
    columns = np.column_stack((np.ones(MONTHS), month, month >= 10)) / SIGMA
    expected = np.linalg.lstsq(columns, value / SIGMA, rcond=None)[0]
    covariance = np.linalg.inv(columns.T @ columns)
    assert [e.at for e in fit.events] == [10]
    scatter = fit.sigma[0] / SIGMA
    assert fit.rate[0] == pytest.approx(expected[1], rel=1e-6)
    assert fit.rate[1] == pytest.approx(scatter * np.sqrt(covariance[1, 1]), rel=1e-6)


def test_the_fitted_series_is_that_of_its_events_with_its_own_deviation() -> None:
    """A constant and one step: each level known as the mean of its dates."""
    month = np.arange(MONTHS)
    value = noise(3) + STEP * (month >= 8)
    fit = fit_series(series(value), 1.0, limit(10), LITTLE_SHIFT)
    assert fit.fitted[:8] == pytest.approx(value[:8].mean(), abs=1e-12)
    assert fit.fitted[8:] == pytest.approx(value[8:].mean(), abs=1e-12)
    assert fit.fitted_sigma[:8] == pytest.approx(SIGMA / np.sqrt(8.0), rel=1e-9)
    assert fit.fitted_sigma[8:] == pytest.approx(SIGMA / np.sqrt(MONTHS - 8.0), rel=1e-9)
    (step,) = fit.events
    assert step.size == pytest.approx(value[8:].mean() - value[:8].mean(), rel=1e-9)
    assert step.sigma == pytest.approx(SIGMA * np.sqrt(1 / 8 + 1 / (MONTHS - 8)), rel=1e-9)
    total = ((value - value.mean()) ** 2).sum() - ((value - fit.fitted) ** 2).sum()
    assert step.gain == pytest.approx(total / SIGMA**2, rel=1e-6)


def test_the_figure_shows_micrometres_of_the_tool_since_the_first_result() -> None:
    """2 m a radian: 0.1 mrad are 200 um, two sigmas of 10 urad 40 um; a bar where it stepped."""
    step = event(1e-4, 1e-5)
    value = 3e-3 + 1e-4 * (np.arange(10) >= 5)
    own = replace(series(value), moves=np.array([0.0, 0.0, 2.0]))
    fit = replace(found(step), series=own, fitted=value, sigma=own.sigma)
    results = [SimpleNamespace(day=day) for day in DAYS]
    history = history_with(fit, found(axis=1), results=results)
    first, second = history_figure(history).axes
    assert [panel.get_ylabel() for panel in (first, second)] == ["axis 1 [um]", "axis 3 [um]"]
    points = second.containers[0].lines[0].get_xydata()
    assert points[:, 1] == pytest.approx([0.0] * 5 + [200.0] * 5)
    (bars,) = second.containers[0].lines[2]
    lengths = [np.ptp(part[:, 1]) for part in bars.get_segments()]
    assert lengths == pytest.approx([80.0] * 10)
    lines = [line.get_ydata() for line in second.lines if line.get_linestyle() == "-"]
    assert [len(line) for line in lines] == [5, 5], "not drawn across the step"
    (shaded,) = second.patches
    assert (shaded.get_x(), shaded.get_x() + shaded.get_width()) == pytest.approx(
        tuple(date2num([DAYS[4], DAYS[5]]))
    )
    assert not first.patches
    strong, weak = (panel.containers[0].lines[0].get_alpha() for panel in (second, first))
    assert strong > weak


def test_every_result_is_compared_with_the_first_before_it_is_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another robot, poses among logs, and a single day are refused."""

    def stored(day: int, title: str = "UR", *, of_logs: bool = True) -> Any:
        file = SimpleNamespace(measured_on=f"2025-01-{day:02}")
        asked = list[str]()
        calibration = SimpleNamespace(
            robot=SimpleNamespace(title=title), file=file, of_logs=of_logs, path=f"{day}.yaml",
            file_of_logs=lambda: asked.append("logs"), file_of_poses=lambda: asked.append("poses"),
        )  # fmt: skip
        return calibration, asked

    def read(*results: Any) -> Any:
        by_path = {Path(r.path): r for r, _ in results}
        monkeypatch.setattr(stored_results, "load", by_path.__getitem__)
        return stored_results.dated_results(list(by_path))

    first, second, third = stored(3), stored(1), stored(2)
    dated = read(first, second, third)
    assert [r.day.day for r in dated] == [1, 2, 3]
    assert (first[1], second[1], third[1]) == (["logs"], [], ["logs"])
    poses = stored(1, of_logs=False), stored(2, of_logs=False)
    read(*poses)
    assert poses[1][1] == ["poses"]
    with pytest.raises(InputError, match=r"2\.yaml: is of robot KUKA, 1\.yaml of UR"):
        read(stored(1), stored(2, "KUKA"))
    same = stored(4), stored(4)
    same[1][0].path = "other.yaml"
    with pytest.raises(InputError, match="2 of 2025-01-04: a history has results of two days"):
        read(*same)


def test_the_fast_end_of_the_rate_is_due_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.1 mm at 4 and 2 um a month: 25 and 50 months."""
    monkeypatch.setattr("ballbar.history.history._rates", lambda _: (2e-6, 4e-6))
    calibration = SimpleNamespace(tcp_sigma=0.0)
    last = SimpleNamespace(day=date(2025, 1, 1), calibration=calibration, acceptable=True)
    expected = due(history_with(results=[last]), 1e-4)
    assert expected.rates == (2e-6, 4e-6)
    assert expected.earliest == date(2025, 1, 1) + timedelta(days=25.0 * MONTH)
    assert expected.latest == date(2025, 1, 1) + timedelta(days=50.0 * MONTH)
