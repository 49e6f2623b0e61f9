"""One sensed length identifies a robot: a telescoping bar with a short stroke, and a draw-wire."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.errors import InputError
from ballbar.ident.held_out import held_out
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Identification
from ballbar.ident.verdict import Status
from tests.helpers.length_recordings import LengthRun, bar_run, wire_run

DH = FitOptions(model="dh", samples=1000)


@cache
def identified(
    make: Callable[..., LengthRun], offset: float, seed: int
) -> tuple[LengthRun, Identification]:
    """A run whose clock is off, and what its logs identify."""
    run = make(Clock(offset, 5e-5), seed=seed)
    return run, identify_together(run.cell, [run.logs], options=DH)


def deviations(result: Identification, run: LengthRun) -> dict[str, float]:
    """Errors of the identified parameters and of the clock in their stated deviations."""
    (recording,) = result.recordings
    assert recording.clock is not None
    out = {
        name: (result.robot.geometry[name] - run.true[name]) / sigma
        for name, sigma in result.robot.sigma.items()
    }
    offset, skew = recording.clock_sigma
    out["offset"] = (recording.clock.offset - run.clock.offset) / offset
    out["skew"] = (recording.clock.skew - run.clock.skew) / skew
    return out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "offset", "seed"),
    [
        (bar_run, 0.002, 1),
        (wire_run, 1.0, 2),
        pytest.param(bar_run, 1.0, 2, marks=pytest.mark.long),
        pytest.param(wire_run, 0.002, 1, marks=pytest.mark.long),
    ],
)
def test_clock_and_geometry_lie_within_the_stated_deviations(
    make: Callable[..., LengthRun], offset: float, seed: int
) -> None:
    run, result = identified(make, offset, seed)
    assert result.verdict.status is Status.GOOD
    off = deviations(result, run)
    assert abs(off["offset"]) < 3.0
    assert abs(off["skew"]) < 3.0
    # 24 correlated deviations scatter about 1; the largest of them is below 4
    assert np.sqrt(np.mean(np.square(list(off.values())))) < 1.6, off
    assert max(map(abs, off.values())) < 4.0, off
    assert {"rd4", "ra2", "rtheta6"} <= set(result.robot.sigma)
    assert ("bd3" in result.robot.sigma) == (make is wire_run)  # the bar was calibrated


@pytest.mark.slow
def test_what_a_point_cannot_see_stays_at_its_nominal_value() -> None:
    _, result = identified(wire_run, 1.0, 2)
    dropped = {d.name: d.reason for d in result.robot.dropped}
    assert dropped["ralpha6"] == "no effect"
    assert {"rd1", "rtheta1", "rd3"} <= set(dropped)
    assert result.robot.geometry["ralpha6"] == result.robot.nominal["ralpha6"]
    assert result.robot.geometry["ra6"] == result.robot.nominal["ra6"]  # the plate is known


@pytest.mark.long
@pytest.mark.slow
def test_a_tool_of_unknown_length_is_identified_with_a_calibrated_bar() -> None:
    run = bar_run(Clock(0.3, 0.0), seed=4)
    cell = replace(run.cell, plate=replace(run.cell.plate, length_sigma=1e-3))
    result = identify_together(cell, [run.logs], options=DH)
    error = result.robot.geometry["ra6"] - run.true["ra6"]
    assert abs(error) < 4.0 * result.robot.sigma["ra6"] < 1e-4


@pytest.mark.long
@pytest.mark.slow
def test_an_identified_robot_explains_a_held_out_length() -> None:
    fitted, other = (wire_run(Clock(0.3, 0.0), seed=5, motion=motion) for motion in (1, 2))
    result = identify_together(fitted.cell, [fitted.logs], options=DH)
    outcome = held_out(result, other.logs, options=DH)
    assert outcome.acceptable, outcome.sentence
    assert outcome.nominal.position_rms > 10.0 * outcome.identified.position_rms


@pytest.mark.long
def test_two_lengths_are_fitted_together() -> None:
    runs = [wire_run(Clock(0.3, 0.0), seed=6, motion=motion) for motion in (1, 2)]
    options = FitOptions(corrections=(), samples=600)
    result = identify_together(runs[0].cell, [run.logs for run in runs], options=options)
    assert result.verdict.acceptable, result.verdict.sentence
    off = {
        name: abs(result.robot.geometry[name] - runs[0].true[name]) / sigma
        for name, sigma in result.robot.sigma.items()
        if not name.startswith("rbeta")
    }
    assert max(off.values()) < 4.0, off


@pytest.mark.slow
def test_corrections_of_a_rigid_rod_are_refused() -> None:
    run, _ = identified(wire_run, 1.0, 2)
    options = FitOptions(corrections=("rod_strain",), samples=300)
    with pytest.raises(InputError, match="rod_strain is of a ball-bar with a rigid rod"):
        identify_together(run.cell, [run.logs], options=options)
