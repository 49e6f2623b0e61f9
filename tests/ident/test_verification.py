"""A stored machine against a recording: what passes for unchanged, and what is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cell.geometry import Geometry
from ident.held_out import LoopClosure
from ident.identify import identify_together
from ident.options import FitOptions
from ident.result import Machine
from ident.single_causes import LENGTH, ZERO, Cause, covariance_of_wander
from ident.verification import (
    FALSE_ALARMS,
    Explanation,
    RecordingVerification,
    _Difference,
    verify_recording,
)
from tests.helpers.minute_logs import TRUE, minute_logs
from tests.helpers.synthetic_recording import CELL

OPTIONS = FitOptions(model="dh", samples=300)


@pytest.fixture(scope="module")
def machine() -> Machine:
    return identify_together(CELL, [minute_logs(seed=1, true=TRUE)], options=OPTIONS).machine


def verified(machine: Machine, true: Geometry, seed: int = 2) -> RecordingVerification:
    """With the encoders mounted again."""
    mounted = true.replaced({"btheta2": 0.3, "btheta5": -0.2})
    return verify_recording(machine, minute_logs(true=mounted, seed=seed), options=OPTIONS)


def moved(**changes: float) -> Geometry:
    return TRUE.replaced({name: TRUE[name] + change for name, change in changes.items()})


@pytest.mark.slow
def test_an_unchanged_machine_holds(machine: Machine) -> None:
    outcome = verified(machine, TRUE)
    assert outcome.holds
    assert outcome.named == ()
    assert outcome.sentence.startswith("Holds: the loop closes to 0.0")


@pytest.mark.slow
def test_the_zero_of_one_axis_is_named_with_its_size(machine: Machine) -> None:
    outcome = verified(machine, moved(rtheta4=3.1e-4))
    (named,) = outcome.named
    assert (named.cause.kind, named.cause.axis) == ("axis", 4)
    assert named.size[0] == pytest.approx(3.1e-4, abs=4.0 * named.sigma[0])
    assert named.sigma[0] < 3e-5
    assert outcome.sentence.startswith("Changed since: zero of axis 4 by +0.3")


@pytest.mark.slow
def test_axis_2_of_a_parallel_rod_moves_two_joints(machine: Machine) -> None:
    """The rod keeps the forearm's angle: joint 3 turns back by what joint 2 turns on."""
    (named,) = verified(machine, moved(rtheta2=4e-4, rtheta3=-4e-4)).named
    assert (named.cause.kind, named.cause.axis) == ("axis", 2)
    assert named.size[0] == pytest.approx(4e-4, abs=4.0 * named.sigma[0])


@pytest.mark.slow
def test_another_rod_is_named(machine: Machine) -> None:
    outcome = verified(machine, moved(bd3=2e-4))
    (named,) = outcome.named
    assert named.cause.kind == "rod"
    assert named.size[0] == pytest.approx(2e-4, abs=4.0 * named.sigma[0])


@pytest.mark.slow
def test_two_changes_have_no_single_cause(machine: Machine) -> None:
    outcome = verified(machine, moved(rtheta4=1e-3, bd3=3e-4))
    assert not outcome.holds
    assert outcome.named == ()
    assert "No single cause" in outcome.sentence


@pytest.mark.slow
def test_a_machine_stated_with_less_certainty_hides_what_is_below_it(machine: Machine) -> None:
    doubted = replace(machine, covariance=machine.covariance * 100.0**2)
    assert verified(doubted, moved(rtheta4=1e-4)).holds


def outcome_of(**changes: Any) -> RecordingVerification:
    """An unchanged robot on a quick path, whose residual is more than the noise explains."""
    cause = Cause("axis", 4, (), np.ones((1, 1)), np.array([ZERO]))
    outcome = RecordingVerification(
        name="quick",
        identified=LoopClosure(3.4e-5, 1.6e-4, 1.2e-4, 1.5),
        innovation=0.78,
        innovation_left=0.78,
        misfit=2.06,
        limit=1.94,
        explanations=(Explanation(cause, np.array([1e-6]), np.array([1e-5]), -2.6),),
        single=True,
        blind={},
    )
    return replace(outcome, **changes)


def test_a_residual_beyond_the_noise_alone_does_not_make_a_changed_machine() -> None:
    """It was called changed in 3 of 3 recordings that the stated uncertainty explained."""
    assert outcome_of().holds
    assert not outcome_of(suspect="its logs can be aligned in more than one way").comparable


def test_a_recording_that_no_machine_explains_is_not_comparable() -> None:
    outcome = outcome_of(innovation=3.0, innovation_left=3.0)
    assert (outcome.holds, outcome.comparable, outcome.named) == (False, False, ())
    assert outcome.sentence.startswith("Not comparable: the loop closes to 0.034 mm rms")
    changed_since = Explanation(outcome.explanations[0].cause, np.ones(1), np.ones(1), 250.0)
    named = outcome_of(innovation=3.0, explanations=(changed_since,)).named
    assert named == (changed_since,), "a change that leaves what is explained is named"


def test_what_an_unchanged_machine_is_apart_by_from_day_to_day_is_no_change() -> None:
    """20 urad of an axis, 10 um of a rod were called changed at stated sigmas of 3 urad, 2 um."""
    causes = [
        Cause("axis", 4, (), np.array([[1.0], [0.0]]), np.array([ZERO])),
        Cause("rod", 0, (), np.array([[0.0], [1.0]]), np.array([LENGTH])),
    ]
    stated = np.diag([3e-6, 2e-6]) ** 2
    for x in (np.array([2e-5, 0.0]), np.array([0.0, 1e-5])):
        sure = _Difference(x, np.eye(2), stated, blocks=20)
        assert sure.ranked(causes)[0].evidence > sure.limit(causes)
        honest = replace(sure, covariance=stated + covariance_of_wander(causes, 2))
        assert honest.ranked(causes)[0].evidence < honest.limit(causes)


@pytest.mark.slow
def test_the_limit_is_exceeded_in_as_many_draws_as_it_says() -> None:
    rng = np.random.default_rng(5)
    root = rng.standard_normal((6, 6))
    covariance = root @ root.T
    causes = [
        Cause("axis", k + 1, (), np.eye(6)[:, [k]], np.array([3.0 * (k + 1)])) for k in range(4)
    ]
    made = _Difference(np.zeros(6), np.eye(6), covariance, blocks=1000)
    limit = made.limit(causes)
    drawn = rng.standard_normal((2000, 6)) @ root.T
    largest = [replace(made, x=x).ranked(causes)[0].evidence for x in drawn]
    assert np.mean(np.array(largest) > limit) == pytest.approx(FALSE_ALARMS, abs=0.01)
