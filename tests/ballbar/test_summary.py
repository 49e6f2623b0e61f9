"""The top of the report: heading by what failed first, and key figures of known residuals."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.clock import UNSEEN_OFFSET, Clock
from ballbar.commands import result_json
from ballbar.commands.result_json import comparison_data
from ballbar.ident.verdict import Status
from ballbar.report import summary as page
from ballbar.report.numbers import MISSING
from ballbar.report.summary import Tile

Stub = SimpleNamespace
GOOD, SUSPECT, MISFIT = Status.GOOD, Status.SUSPECT, Status.MISFIT


def judged(status: Status = GOOD, *, failed: str = "", missed: str = "", **changes: Any) -> Any:
    """A run with a verdict, one held-out recording and one limit."""
    verdict = Stub(status=status, acceptable=status is not MISFIT, sentence="So.", warnings=("w",))
    outcomes = [Stub(name="fine", acceptable=True, sentence="Explained.")]
    outcomes += [Stub(name=failed, acceptable=False, sentence="Not.")] if failed else []
    limits = [Stub(what="mean", met=True)] + ([Stub(what=missed, met=False)] if missed else [])
    acceptable = verdict.acceptable and not failed and not missed
    made = {
        "identification": Stub(verdict=verdict), "outcomes": outcomes, "limits": limits,
        "recordings": (), "acceptable": acceptable,
    }  # fmt: skip
    return Stub(**made | changes)


@pytest.mark.parametrize(
    ("run", "heading"),
    [
        (judged(), "Acceptable"),
        (judged(SUSPECT), "Acceptable, with care"),
        (judged(MISFIT), "Not acceptable"),
        (judged(missed="largest"), "Limits of the scenario missed: largest"),
        (judged(MISFIT, missed="largest"), "Not acceptable"),
        (judged(failed="b", missed="largest"), "Held-out poses not explained: b"),
        (judged(failed="b", recordings=[1]), "Held-out recording not explained: b"),
    ],
)
def test_the_heading_names_what_failed_first(run: Any, heading: str) -> None:
    assert page._heading(run) == heading


@pytest.mark.parametrize(
    ("run", "begin", "end"),
    [
        (judged(), "The identified robot may be used", "corrects targets."),
        (judged(SUSPECT), "The identified robot may be used", "if the margin is tight."),
        (judged(missed="mean"), "Do not use these parameters yet", "was required."),
        (judged(MISFIT), "Do not use these parameters before", "has been found."),
    ],
)
def test_what_to_do_follows_from_the_verdict(run: Any, begin: str, end: str) -> None:
    sentence = page._what_to_do(run)
    assert sentence.startswith(begin)
    assert sentence.endswith(end)


def tcp(mean: float, largest: float) -> Any:
    return Stub(mean=mean, maximum=largest)


POSES = Stub(
    cross_validation=Stub(mean=1.5e-5, quantile=4.2e-5, counting=np.array([1, 0, 1, 1])),
    fit=Stub(model=Stub(unknowns=Stub(count=47)), iterations=6),
    search=Stub(orders=[1, 2, 3]),
    residual_means=(1.1e-5, 0.9e-3),
    sigma_at_poses=np.array([1e-5, 3e-5]),
    tcp_sigma=np.array([4e-5, 8e-5]),
    table=Stub(
        groups=[Stub(kind=Stub(noun="points")), Stub(kind=Stub(noun="lengths"))],
        robot=Stub(title="KR 10"), size=4, what="poses",
    ),
)  # fmt: skip


def test_the_tiles_of_poses_are_in_millimetres() -> None:
    comparison: Any = Stub(tcp=tcp(2.15e-5, 7e-5), tcp_nominal=tcp(1.234e-3, 5e-3))
    note = "mean; largest 0.070 mm; nominal robot 1.234 mm"
    stated = "mean at the measured poses; extrapolated over the whole ranges 0.060 mm"
    tiles = (
        Tile("Stated TCP uncertainty", "0.020 mm", stated),
        Tile("Error where it was not fitted", "0.015 mm", "mean; 95 % below 0.042 mm"),
        Tile("Nominal robot", "0.900 mm", "mean, seats and targets fitted"),
        Tile("Fitted poses", "0.011 mm", "mean of 3"),
        Tile("Joint errors", "3", "orders found by evidence"),
        Tile("Unknowns", "47", "6 iterations"),
    )
    poses: Any = POSES
    comparison.tcp.mean = 2.1501e-5
    truth = Tile("TCP error against the truth", "0.022 mm", note)
    assert page._pose_tiles(poses, comparison) == (truth, *tiles)
    assert page._pose_tiles(poses, None) == tiles


def test_the_summary_of_poses_names_robot_and_instruments() -> None:
    run = judged(SUSPECT)
    run.identification.poses = POSES
    nothing: Any = None
    made = page.summary(Stub(**vars(run), comparison=None), nothing, "")  # type: ignore[arg-type]
    assert (made.band, made.heading, made.even) == ("care", "Acceptable, with care", True)
    assert made.subtitle == "KR 10; 4 poses, lengths and points."
    assert (made.sentences, made.warnings) == (("Explained.", "So."), ("w",))
    run.acceptable = False
    assert page.summary(Stub(**vars(run), comparison=None), nothing, "").band == "bad"  # type: ignore[arg-type]


def view(*, against_truth: bool) -> Any:
    return Stub(
        before=np.array([1e-3, 2e-3]), after=np.array([2e-5, 4e-5]), stated=np.array([3e-5, 4e-5]),
        stated_without_scale=np.array([1e-5, 2e-5]), against_truth=against_truth,
    )  # fmt: skip


def robot(*, stroke: Any = None, encoders: Any = (1, 2, 4, 5)) -> Any:
    bar = Stub(stroke=stroke, title="Lund 600")
    stated = Stub(sigma=np.array([1e-5, 3e-5]), without_scale=np.array([5e-6, 7e-6]))
    cell = Stub(ballbar=bar, robot=Stub(title="IRB 2400"))
    return Stub(robot=Stub(cell=cell, encoders=encoders, tcp=stated, corrections=()))


def test_the_error_before_and_after_is_against_the_truth_where_it_is_known() -> None:
    assert page._in_short(view(against_truth=True), robot()) == (
        "Over 2 poses of the workspace the mean TCP error is 1.50 mm with the nominal model and "
        "0.0300 mm with the identified one."
    )
    assert page._in_short(view(against_truth=False), robot()) == (
        "Over 2 poses of the workspace the identified model moves the TCP by 1.50 mm on average "
        "against the nominal one; the stated uncertainty of what remains is 0.0350 mm with the "
        "scale of plate and rod, 0.0150 mm without it (1 sigma, mean)."
    )
    assert page._tcp_tile(view(against_truth=True)) == Tile(
        "TCP error, before → after", "1.50 → 0.0300 mm",
        "mean of 2 poses, against the truth; stated 0.0350 mm with scale, 0.0150 mm without (1 "
        "sigma)",
    )  # fmt: skip
    assert page._tcp_tile(view(against_truth=False)) == Tile(
        "Stated TCP uncertainty", "0.0300 mm",
        "1 sigma, mean of 2 poses, with scale; 0.0150 mm without; correction made 1.50 mm",
    )  # fmt: skip


def test_95_percent_are_two_sigma(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "left_at_nominal", lambda _: [("rd1", 0), ("rd2", 0)])
    sentence = page._confidence(robot())
    assert "within 0.0400 mm of the true tool position at an average pose" in sentence
    assert "within 0.0600 mm at the worst" in sentence
    assert "within 0.0120 mm at an average pose." in sentence
    assert sentence.endswith("kept at the catalogue's values: rd1 and rd2.")
    monkeypatch.setattr(page, "left_at_nominal", lambda _: [])
    assert page._confidence(robot()).endswith("within 0.0120 mm at an average pose.")


def fitted(seconds: float = 59.6, **changes: Any) -> Any:
    """Residuals of 3 and 4 um along an axis before, and a tenth after."""
    before = Stub(position=np.diag([3e-6, 4e-6]), angle=np.full((2, 1), 1e-5))
    after = Stub(position=0.1 * before.position, angle=0.1 * before.angle)
    base = {
        "before": before, "after": after, "whitened": np.zeros((5, 9)), "samples": 300,
        "clock": Clock(0.137, 0.0), "clock_sigma": (1e-6, 1e-9),
    }  # fmt: skip
    log = Stub(t=np.array([0.0, seconds]))
    recording = Stub(description=Stub(kind="simulated"), robot_log=log)
    return Stub(estimate=Stub(**base | changes), recording=recording)


def recorded(*each: Any, **of: Any) -> Any:
    result = robot(**of)
    result.fit = Stub(iterations=4, converged=True, unknowns=48)
    each = each or (fitted(),)
    return Stub(identification=result, recordings=each, several=len(each) > 1, comparison=None)


def test_the_subtitle_says_what_measured() -> None:
    assert page._subtitle(recorded()) == (
        "IRB 2400 on Lund 600 with 4 encoders; simulated recording of 60 s."
    )
    sensed = recorded(fitted(), fitted(), encoders=(), stroke=(0.2, 0.4))
    assert page._subtitle(sensed) == (
        "IRB 2400 on Lund 600 with its length sensed; 2 simulated recordings together."
    )
    assert "with no encoders;" in page._subtitle(recorded(encoders=()))


def test_residuals_are_root_mean_squares_before_and_after() -> None:
    """Rows of norm 3 and 4 um have the root of 12.5."""
    _, _, residual, iterations, samples = page._tiles(recorded(), view(against_truth=True))
    assert residual.value == "3.54 → 0.354 µm"
    assert residual.note == "angle 10.0 → 1.00 µrad"
    assert (iterations.value, iterations.note) == ("4", "from the automatic start")
    assert (samples.value, samples.note) == ("300", "5 equations each, 48 unknowns")
    one = recorded(fitted(whitened=np.zeros((1, 9))), fitted(whitened=np.zeros((1, 9))), stroke=1)
    one.identification.fit.converged = False
    *_, residual, iterations, samples = page._tiles(one, view(against_truth=True))
    assert residual.note == "of the length"
    assert iterations.note == "from the automatic start, not converged"
    assert (samples.value, samples.note) == ("300 + 300", "1 equation each, 48 unknowns")


def test_a_clock_that_is_not_seen_has_no_offset() -> None:
    unseen = fitted(clock=Clock(-0.5, 0.0), clock_sigma=(2.0 * UNSEEN_OFFSET, 1e-9))
    tile = page._clock_tile(recorded(fitted(), fitted(clock_sigma=(2e-6, 0.0)), unseen))
    assert (tile.label, tile.value) == ("Clock offsets", f"137.000, 137.000, {MISSING} ms")
    tile = page._clock_tile(recorded(fitted(), fitted(clock_sigma=(2e-6, 0.0))))
    assert "± 2.0 µs or less" in tile.note
    none = fitted(clock=None)
    assert page._clock_tile(recorded(none, none)).value == "one log"


def test_a_comparison_as_data_is_in_si_units() -> None:
    sizes = np.array([1e-6, 2e-6])
    made: Any = Stub(
        target="ball", tcp=Stub(mean=1.0, maximum=2.0, distances=sizes, error=sizes),
        tcp_nominal=Stub(mean=3.0, maximum=4.0, distances=sizes, error=sizes),
        predicted=(5.0, 6.0), deviations={"ra2": 7.0}, z={"ra2": 8.0}, unlike_ranges=(3,),
        offset=None, skew=None,
    )  # fmt: skip
    data = comparison_data(made)
    assert (data["target"], data["cross_validated_mean_m"]) == ("ball", [5.0, 6.0])
    assert data["parameters"] == {"ra2": {"difference": 7.0, "z": 8.0}}
    assert data["axes_with_unlike_ranges"] == [3]
    assert "clock_offset_error_s" not in data
    made.offset, made.skew = 1e-6, 1e-8
    assert comparison_data(made)["clock_skew_error"] == 1e-8


def test_a_run_as_data_has_plant_and_comparison_where_it_was_simulated(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = Stub(model_dump=lambda **_: {"schema": "x"})
    monkeypatch.setattr(result_json, "load", lambda _: Stub(file=file))
    error = Stub(mean=1.0, maximum=2.0, error_without_scale=np.array([0.5, 1.5]))
    run = judged(SUSPECT)
    run.simulation, run.comparison, run.limits = None, None, []
    plain = result_json.run_data(run, tmp_path)
    assert plain == {
        "acceptable": True, "sentence": "So.", "folder": str(tmp_path), "files": [],
        "calibration": {"schema": "x"},
    }  # fmt: skip
    run.simulation = Stub(figures={"plant": {"s": 1.0}})
    assert result_json.run_data(run, tmp_path) == plain
    run.comparison = Stub(tcp=error, tcp_nominal=error)
    compared = result_json.run_data(run, tmp_path)
    sizes = {"mean_m": 1.0, "max_m": 2.0, "mean_without_scale_m": 1.0}
    assert compared["comparison"] == {"tcp_error": sizes, "tcp_error_nominal": sizes}
    assert (compared["plant"], compared["limits"]) == ({"s": 1.0}, [])
    run.recordings, run.simulation, run.comparison = [1], None, None
    data = result_json.run_data(run, tmp_path)
    assert (data["plant"], data["comparison"]) == (None, None)
