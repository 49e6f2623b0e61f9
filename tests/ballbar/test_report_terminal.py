"""Words of the command line on an identification: each number where its quantity is named."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from ballbar.cell.clock import Clock
from ballbar.report.numbers import capitalised, decimals_for, length_scale, listed
from ballbar.report.terminal import budget_sentence, say_comparison, say_identification

Stub = SimpleNamespace


def lines_of(say: Any, thing: Any) -> list[str]:
    text = io.StringIO()
    say(Console(file=text, width=400), thing)
    return text.getvalue().splitlines()


def tcp(mean: float, largest: float, without: float = 0.0) -> Stub:
    """Errors of the tool in um."""
    unscaled = np.array([without, without]) * 1e-6
    return Stub(mean=mean * 1e-6, maximum=largest * 1e-6, error_without_scale=unscaled)


def comparison(**changes: Any) -> Stub:
    """A comparison of two robots at their flanges, as far as it is printed."""
    base = {
        "target": "", "tcp": tcp(12.34, 45.67, 8.9), "tcp_nominal": tcp(1234.5, 4567.8),
        "deviations": {"ra2": 1.5e-5, "rtheta3": -4e-5}, "largest": ("rtheta3", -4e-5),
        "distance": 4.27e-5, "offset": None, "skew": None,
    }  # fmt: skip
    return Stub(**base | changes)


def test_a_comparison_of_logs_names_its_largest_parameter_and_the_clock() -> None:
    lines = lines_of(say_comparison, comparison(offset=1.5e-6, skew=-2e-8))
    assert lines == [
        "TCP error over the workspace: mean 0.0123 mm, largest 0.0457 mm, mean without scale "
        "0.0089 mm (nominal robot 1.234 and 4.568 mm)",
        "parameters: Euclidean distance 0.0427 mm|mrad over 2, largest rtheta3 -0.0400",
        "clock error: offset +1.50 us, skew -0.0200 ppm",
    ]
    assert len(lines_of(say_comparison, comparison(deviations={}))) == 1


def of_poses(**changes: Any) -> Stub:
    names = [f"ra{k}" for k in range(1, 6)] + [f"rtheta{k}" for k in range(1, 6)]
    base = {
        "target": "ball", "predicted": (2.5e-5, 3.5e-5), "both_have_target": True,
        "notable": names[2:3], "deviations": dict.fromkeys(names, -1.25e-4),
        "z": dict.fromkeys(names, -6.04), "unlike_ranges": (),
    }  # fmt: skip
    return comparison(**base | changes)


def test_a_comparison_of_results_of_poses_lists_what_differs() -> None:
    lines = lines_of(say_comparison, of_poses())
    errors = "mean 0.0123 mm, largest 0.0457 mm (nominal robot 1.234 and 4.568 mm)"
    assert lines[0].startswith("TCP difference over ")
    assert lines[0].endswith(
        f" poses within the fitted ranges, base aligned, target ball of both: {errors}"
    )
    assert lines[1] == "mean error by cross-validation: 0.0250 and 0.0350 mm"
    assert lines[2].endswith(
        "5 um or 25 urad: ra3 -0.1250 mm (z -6.0) (10 compared; sigma without what the model "
        "leaves unexplained)"
    )
    assert lines_of(say_comparison, of_poses(predicted=())) == [
        f"TCP error within the fitted ranges: {errors}"
    ]
    lines = lines_of(say_comparison, of_poses(both_have_target=False, notable=()))
    assert "target ball of the first: mean" in lines[0]
    assert "urad: none (10 compared" in lines[2]


def test_of_many_parameters_that_differ_eight_are_listed() -> None:
    many = of_poses(unlike_ranges=(2, 6))
    many.notable = list(many.deviations)
    lines = lines_of(say_comparison, many)
    assert lines[2].count("(z -6.0)") == 8
    assert "rtheta3 -0.1250 mrad (z -6.0) and 2 more (10" in lines[2]
    assert lines[3] == "warning: less than half of the fitted range is common: axes 2, 6"


def poses(**changes: Any) -> Stub:
    orders = [Stub(joint=k // 2, order=1 + k % 2) for k in range(10)]
    group = Stub(common=None, kind=Stub(scales=True))
    base = {
        "seats": ["floor"], "targets": ["a", "b"], "search": Stub(orders=orders), "cameras": {},
        "table": Stub(size=80, groups=[group]), "sigma_at_poses": np.array([1e-5, 2e-5]),
        "tcp_sigma": np.array([3e-5, 5e-5]),
    }  # fmt: skip
    return Stub(**base | changes)


def run(of: Stub, **changes: Any) -> Stub:
    """An identification from still poses."""
    dropped = [Stub(name="rd1"), Stub(name="otx")]
    robot = Stub(corrections=(), dropped=dropped, tcp=None)
    verdict = Stub(sentence="Good [so].", acceptable=True, warnings=["warm [cell]"])
    fit = Stub(iterations=7)
    identification = Stub(verdict=verdict, robot=robot, poses=of, model="poses", fit=fit)
    return Stub(outcomes=(), recordings=(), several=False, identification=identification, **changes)


@pytest.fixture(autouse=True)
def counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ballbar.report.terminal.parameter_count", lambda _: 27)


def test_an_identification_from_poses_says_what_was_found_and_stated() -> None:
    assert lines_of(say_identification, run(poses())) == [
        "Good [so].",
        "warning: warm [cell]",
        "27 parameters from 80 poses, 1 seat and 2 targets, in 7 iterations",
        "left at nominal values or priors: rd1, otx",
        "joint errors found (cycles a turn): joint 1: 1, joint 1: 2, joint 2: 1, joint 2: 2, "
        "joint 3: 1, joint 3: 2, joint 4: 1, joint 4: 2 and 2 more",
        "stated TCP uncertainty: 0.0150 mm at the measured poses; extrapolated over the whole of "
        "the fitted ranges 0.0400 mm (means, 1 sigma, all axes together; without the scale of the "
        "instrument)",
    ]


@pytest.mark.parametrize(
    ("common", "words"),
    [
        ((None,), "; without the scale of the instrument)"),
        ((1.0,), "; the scale is that of the board)"),
        ((1.0, None), "; without the scale of the instrument)"),
        ((), "all axes together)"),
    ],
)
def test_whose_scale_a_stated_uncertainty_has_is_said(
    common: tuple[float | None, ...], words: str
) -> None:
    groups = [Stub(common=c, kind=Stub(scales=True)) for c in common]
    groups.append(Stub(common=None, kind=Stub(scales=False)))
    stated = poses(table=Stub(size=4, groups=groups), search=Stub(orders=[]))
    lines = lines_of(say_identification, run(stated))
    assert lines[-1].endswith(words)
    assert lines[-2] == "joint errors found (cycles a turn): none"
    assert len(lines_of(say_identification, run(poses(search=None)))) == 5


def estimate(**changes: Any) -> Stub:
    base = {
        "clock": Clock(0.137, 5e-5), "clock_sigma": (1e-6, 1e-8), "tracker": None, "samples": 300,
        "tension": np.array([-30.4, 120.6]), "tension_source": "instrument",
    }  # fmt: skip
    return Stub(**base | changes)


def test_each_of_several_recordings_has_its_force_and_clock() -> None:
    of = run(poses())
    of.recordings = [Stub(name="one", estimate=estimate()), Stub(name="two", estimate=estimate())]
    of.recordings[1].estimate.clock = None
    coefficients = [Stub(name="k1"), Stub(name="k2")]
    of.identification.robot.corrections = [Stub(name="compliance", coefficients=coefficients)]
    of.several, of.identification.model = True, "complete"
    of.identification.poses = Stub(sentence="80 poses agree.")
    of.identification.robot.tcp = Stub(sigma=np.array([2e-5]), without_scale=np.array([1e-5]))
    of.identification.robot.cell = Stub(ballbar=Stub(stroke=None))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ballbar.report.terminal.parameters_at_prior", lambda _: ["rd1"])
        patch.setattr("ballbar.report.terminal.coefficients_at_prior", lambda _: coefficients[:1])
        lines = lines_of(say_identification, of)[2:]
    assert lines[0] == (
        "complete model: 27 parameters and 2 coefficients of 1 correction (compliance) from "
        "300 + 300 samples in 7 iterations"
    )
    assert lines[1].endswith("more than from the data (the uncertainty counts it): rd1, k1")
    assert lines[2].startswith("force along the instrument of one: -30 to 121 N, ")
    assert (
        lines[4]
        == "clock of one: offset +137.0000 ms (sigma 1.0 us), skew +50.000 ppm (sigma 0.010 ppm)"
    )
    assert lines[5:] == [
        "80 poses agree.",
        "stated TCP uncertainty over the workspace (1 sigma, mean): 0.0200 mm with the scale of "
        "plate and rod, 0.0100 mm without it",
    ]


def test_a_budget_names_its_three_largest_rows() -> None:
    rows = [
        Stub(what=f"cause {k}: more", share=share) for k, share in enumerate((0.5, 0.3, 0.15, 0.05))
    ]
    budget: Any = Stub(rows=rows, expanded=(2.5e-5, 7.25e-5), coverage_factor=2.051)
    assert budget_sentence(budget) == (
        "expanded uncertainty of the tool (k = 2.05, 95 %): 0.0250 mm, at the worst pose "
        "0.0725 mm; of its variance cause 0 50 %, cause 1 30 %, cause 2 15 %"
    )
    assert budget_sentence(None) == ""


@pytest.mark.parametrize(
    ("sigmas", "digits", "decimals"),
    [([0.023, 5.0], 1, 2), ([0.1], 2, 2), ([0.0999], 2, 3), ([30.0], 1, 0), ([1e-12], 2, 7),
     ([0.0, float("nan")], 2, 3)],
)  # fmt: skip
def test_decimals_reach_the_digits_of_the_smallest_sigma(
    sigmas: list[float], digits: int, decimals: int
) -> None:
    assert decimals_for(sigmas, digits=digits) == decimals


def test_lists_and_sentences_are_english() -> None:
    assert [listed(list(names)) for names in ("", "a", "ab", "abc")] == [
        "", "a", "a and b", "a, b and c",
    ]  # fmt: skip
    assert capitalised("the ABB robot") == "The ABB robot"
    assert length_scale(1e-4) == (1e3, "mm")
    assert length_scale(0.99e-4) == (1e6, "µm")
