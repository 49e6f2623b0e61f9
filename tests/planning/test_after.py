"""`ballbar plan --after`: what a path brings, and what is asked instead where it brings nothing."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from ballbar.plan.show import given_path, instead, say_gain, worthwhile
from ident.estimator.noise import ExcessNoise
from planning.evaluation import evaluators, tcp_rms, tcp_rms_before
from planning.known import Known, Stated
from planning.plan import Plan
from planning.questions import ENCODERS
from planning.request import PlanCell, PlanRequest
from tests.helpers.simulated_recordings import SCENARIOS

POSITION = (0.897, -0.195, 0.486)  # as in scenarios/irb2400_planned.yaml
PATH = SCENARIOS / "paths" / "irb2400_planned.yaml"


def request() -> PlanRequest:
    cell = PlanCell(robot="irb2400", ballbar="lund_600", ballbar_position_m=POSITION)
    return PlanRequest(schema="ballbar-plan/1", name="test", cell=cell)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return given_path(request(), PATH, POSITION)


def knowing(plan: Plan, share: float) -> Known:
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


def told(plan: Plan) -> str:
    text = io.StringIO()
    say_gain(Console(file=text, width=200), plan)
    return text.getvalue()


@pytest.mark.slow
def test_before_the_path_the_result_is_what_is_known(plan: Plan) -> None:
    known = knowing(plan, 1.0)
    evaluator = evaluators(request(), known)["lund_600"]
    assert tcp_rms_before(evaluator) == pytest.approx(
        tcp_rms(plan.evaluator, plan.typical), rel=1e-3
    )


@pytest.mark.slow
def test_a_path_after_a_poor_result_is_worth_its_time(plan: Plan) -> None:
    after = given_path(request(), PATH, POSITION, knowing(plan, 9.0))
    assert worthwhile(after)
    assert instead(after) == []
    assert "less)" in told(after)
    assert told(plan) == ""


@pytest.mark.slow
def test_where_a_path_brings_nothing_other_means_are_asked_for(plan: Plan) -> None:
    after = given_path(request(), PATH, POSITION, knowing(plan, 1e-3))
    assert not worthwhile(after)
    assert "less than 10%" in told(after)
    assert [q.key for q in instead(after)] == [ENCODERS, "rod_sigma", "duration"]
