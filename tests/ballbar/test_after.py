"""`ballbar plan --after`: what a path brings, and what is asked instead where it brings nothing."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from rich.console import Console

from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.plan.show import given_path
from ballbar.plan.summary import instead, say_gain, worthwhile
from ballbar.planning.evaluation import evaluators, tcp_rms, tcp_rms_before
from ballbar.planning.known import Known, Stated
from ballbar.planning.plan import PathPlan
from ballbar.planning.questions import ENCODERS
from ballbar.planning.request import PlanCell, PlanRequest
from ballbar.planning.workspace import Region
from tests.helpers.simulated_recordings import SCENARIOS

POSITION = (0.897, -0.195, 0.486)  # as in scenarios/irb2400_planned.yaml
PATH = SCENARIOS / "paths" / "irb2400_planned.yaml"


def request() -> PlanRequest:
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=POSITION)
    return PlanRequest(schema="ballbar-plan/1", name="test", cell=cell)


@pytest.fixture(scope="module")
def plan() -> PathPlan:
    return given_path(request(), PATH, POSITION)


def knowing(plan: PathPlan, share: float) -> Known:
    """A result of the same path, its covariance times `share`."""
    count, typical = plan.typical.layout.machine.size, plan.typical
    covariance = share * typical.covariance[:count, :count]
    return Known(
        results=(Stated(typical.layout.names[:count], covariance),),
        corrections={
            c.name: tuple(k.name for k in c.coefficients) for c in typical.model.corrections
        },
        excess=ExcessNoise(1e-5, 2e-5, 1e-5, 1e-6),
    )


def told(plan: PathPlan) -> str:
    text = io.StringIO()
    say_gain(Console(file=text, width=200), plan)
    return text.getvalue()


def test_before_the_path_the_result_is_what_is_known(plan: PathPlan) -> None:
    known = knowing(plan, 1.0)
    evaluator = evaluators(request(), known)["lund_600"]
    assert tcp_rms_before(evaluator) == pytest.approx(
        tcp_rms(plan.evaluator, plan.typical), rel=1e-3
    )


def test_a_path_after_a_poor_result_is_worth_its_time(plan: PathPlan) -> None:
    after = given_path(request(), PATH, POSITION, knowing(plan, 9.0))
    assert worthwhile(after)
    assert instead(after) == []
    assert "less)" in told(after)
    assert told(plan) == ""


def test_where_a_path_brings_nothing_other_means_are_asked_for(plan: PathPlan) -> None:
    after = given_path(request(), PATH, POSITION, knowing(plan, 1e-3))
    assert not worthwhile(after)
    assert "less than 10%" in told(after)
    assert [q.key for q in instead(after)] == [ENCODERS, "rod_sigma", "duration"]


def prediction(*, telescoping: bool, place_free: bool) -> PathPlan:
    """A path that lowers 10.0 um to 9.9, as far as its sentence needs it."""
    cell = PlanCell(
        robot="irb2400",
        ballbar=None if telescoping else "lund_600",
        instrument="qc20w_300" if telescoping else None,
        ballbar_position_m=None if place_free else POSITION,
        ballbar_region_m=Region(lower=POSITION, upper=POSITION) if place_free else None,
    )
    requested = PlanRequest(schema="ballbar-plan/1", name="test", cell=cell)
    bar = SimpleNamespace(length_tolerance=1e-5)
    evaluator = SimpleNamespace(cell=SimpleNamespace(ballbar=bar))
    plan: Any = SimpleNamespace(
        tcp_before=1e-5, tcp=np.array([9.9e-6]), request=requested, evaluator=evaluator
    )
    return cast("PathPlan", plan)


@pytest.mark.parametrize("place_free", [True, False])
@pytest.mark.parametrize("telescoping", [True, False])
def test_only_what_follows_or_can_be_done_is_advised(telescoping: bool, place_free: bool) -> None:
    """Nothing else is predicted of a telescoping bar, and its place was free already."""
    sentence = told(prediction(telescoping=telescoping, place_free=place_free))
    assert "scale known, by the results so far 10.0 um rms, with this path 9.9 um" in sentence
    assert "by less than 10%" in sentence
    assert ("is below" in sentence) == (not telescoping)
    assert ("ballbar_region_m" in sentence) == (not place_free)
