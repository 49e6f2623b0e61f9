"""A stored machine against a recording: what passes for unchanged, and what is named."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Machine
from ballbar.ident.single_causes import LENGTH, ZERO, Cause, Explanation, covariance_of_wander
from ballbar.ident.verification import FALSE_ALARMS, Score, Verification
from ballbar.ident.verify_recording import is_explained, verify_recording
from tests.helpers.drawn_machines import OPTIONS as RIPPLING
from tests.helpers.drawn_machines import Truth, drawn, identified, recorded
from tests.helpers.minute_logs import TRUE, minute_logs
from tests.helpers.synthetic_recording import CELL

OPTIONS = FitOptions(model="dh", samples=300)


@pytest.fixture(scope="module")
def machine() -> Machine:
    return identify_together(CELL, [minute_logs(seed=1, true=TRUE)], options=OPTIONS).machine


def verified(machine: Machine, true: Geometry, seed: int = 2) -> Verification:
    """With the encoders mounted again."""
    mounted = true.replaced({"btheta2": 0.3, "btheta5": -0.2})
    return verify_recording(machine, minute_logs(true=mounted, seed=seed), options=OPTIONS)


def moved(**changes: float) -> Geometry:
    return TRUE.replaced({name: TRUE[name] + change for name, change in changes.items()})


def test_an_unchanged_machine_holds(machine: Machine) -> None:
    outcome = verified(machine, TRUE)
    assert outcome.holds
    assert outcome.named == ()
    assert outcome.sentence.startswith("Holds: the loop closes to 0.0")


@pytest.mark.parametrize(
    ("changes", "kind", "name", "size"),
    [
        ({"rtheta4": 3.1e-4}, "axis", "4", 3.1e-4),
        ({"rtheta2": 4e-4, "rtheta3": -4e-4}, "axis", "2", 4e-4),  # the rod keeps the forearm
        ({"bd3": 2e-4}, "rod", "", 2e-4),
    ],
)
def test_a_change_is_named_with_its_size(
    machine: Machine, changes: dict[str, float], kind: str, name: str, size: float
) -> None:
    outcome = verified(machine, moved(**changes))
    (named,) = outcome.named
    assert (named.cause.kind, named.cause.name) == (kind, name)
    assert named.size[0] == pytest.approx(size, abs=4.0 * named.sigma[0])
    assert named.sigma[0] < 3e-5
    assert outcome.sentence.startswith("Changed since: ")


def test_no_cause_is_named_that_an_unchanged_machine_would_show_as_well(
    machine: Machine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The residual alone is beyond what is stated, and the likeliest cause within its limit."""
    monkeypatch.setattr(Score, "limit", lambda *_: 1e9)
    outcome = verified(machine, moved(rtheta4=1e-3))
    assert not outcome.holds
    assert outcome.comparable
    assert outcome.named == ()
    assert "No single cause" in outcome.sentence


def test_two_changes_have_no_single_cause(machine: Machine) -> None:
    outcome = verified(machine, moved(rtheta4=1e-3, bd3=3e-4))
    assert not outcome.holds
    assert outcome.named == ()
    assert "No single cause" in outcome.sentence


def test_a_machine_stated_with_less_certainty_hides_what_is_below_it(machine: Machine) -> None:
    doubted = replace(machine, covariance=machine.covariance * 100.0**2)
    assert verified(doubted, moved(rtheta4=1e-4)).holds


def outcome_of(**changes: Any) -> Verification:
    """A robot after a change of one zero that explains all."""
    cause = Cause("axis", "4", np.ones((1, 1)), np.array([ZERO]))
    best = Explanation(cause, np.array([3.1e-4]), np.array([1e-5]), 250.0, 500.0)
    outcome = Verification(
        name="quick",
        error=np.full(3, 3.4e-5),
        numbers="the loop closes",
        figures={},
        unchanged=False,
        explanations=(best,),
        single=True,
        tried="zero of an axis, tool",
        square=501.0,
        limit=1.94,
        blind={},
    )
    return replace(outcome, **changes)


@pytest.mark.parametrize(
    ("misfit", "innovation", "explained"),
    [(2.06, 0.78, True), (1.0, 3.0, True), (2.06, 3.0, False)],
)
def test_a_residual_beyond_the_noise_alone_makes_no_other_kind_of_machine(
    misfit: float, innovation: float, explained: bool
) -> None:
    """It was called changed in 3 of 3 recordings that the stated uncertainty explained."""
    assert is_explained(misfit, innovation) == explained


@pytest.mark.parametrize(
    ("changes", "holds", "comparable", "said"),
    [
        ({"unchanged": True}, True, True, "Holds: the loop closes."),
        ({}, False, True, "Changed since: zero of axis 4 by +0.31 mrad (sigma 0.01 mrad; resolver"),
        ({"single": False}, False, True, "Changed: the loop closes. No single cause (zero of an"),
        ({"doubt": "perhaps b1"}, False, False, "Not comparable: perhaps b1; the loop closes."),
    ],
)
def test_it_holds_has_changed_or_cannot_be_compared(
    changes: dict[str, Any], holds: bool, comparable: bool, said: str
) -> None:
    outcome = outcome_of(**changes)
    assert (outcome.holds, outcome.comparable) == (holds, comparable)
    assert bool(outcome.named) == said.startswith("Changed since")
    assert outcome.sentence.startswith(said)


def score_of(x: Array, covariance: Array) -> Score:
    """The score of an estimate x (U,) that shows every change in full."""
    root = np.linalg.cholesky(covariance)
    return Score(np.linalg.solve(root, x), lambda columns: np.linalg.solve(root, columns))


def test_a_change_that_nothing_shows_is_unseen_at_any_size() -> None:
    """Its prior of 2 mrad passed for what was measured: it was said to show beyond 8 mrad."""
    score = score_of(np.zeros(2), np.diag([1e-4, 1.0]) ** 2)
    seen, hidden = (Cause("axis", "2", x, np.array([ZERO])) for x in np.eye(2)[:, :, None])
    assert score.unseen(seen) == pytest.approx(4e-4)
    assert score.unseen(hidden) == pytest.approx(4.0)
    outcome = outcome_of(blind={2: score.unseen(seen), 3: score.unseen(hidden)})
    assert outcome.warnings[0].endswith("2 (0.4 mrad), 3 (any)")


def test_what_an_unchanged_machine_is_apart_by_from_day_to_day_is_no_change() -> None:
    """20 urad of an axis, 10 um of a rod were called changed at stated sigmas of 3 urad, 2 um."""
    causes = [
        Cause("axis", "4", np.array([[1.0], [0.0]]), np.array([ZERO])),
        Cause("rod", "", np.array([[0.0], [1.0]]), np.array([LENGTH])),
    ]
    stated = np.diag([3e-6, 2e-6]) ** 2
    for x in (np.array([2e-5, 0.0]), np.array([0.0, 1e-5])):
        sure = score_of(x, stated)
        assert sure.ranked(causes)[0].evidence > sure.limit(causes, 19)
        honest = score_of(x, stated + covariance_of_wander(causes, 2))
        assert honest.ranked(causes)[0].evidence < honest.limit(causes, 19)


def test_the_limit_is_exceeded_in_as_many_draws_as_it_says() -> None:
    rng = np.random.default_rng(5)
    root = rng.standard_normal((6, 6))
    covariance = root @ root.T
    causes = [
        Cause("axis", str(k + 1), np.eye(6)[:, [k]], np.array([3.0 * (k + 1)])) for k in range(4)
    ]
    limit = score_of(np.zeros(6), covariance).limit(causes, 999)
    drawn = rng.standard_normal((2000, 6)) @ root.T
    largest = [score_of(x, covariance).ranked(causes)[0].evidence for x in drawn]
    assert np.mean(np.array(largest) > limit) == pytest.approx(FALSE_ALARMS, abs=0.01)


@pytest.fixture(scope="module")
def stored() -> tuple[Truth, Machine]:
    truth = drawn(914)
    return truth, identified(truth)


def verified_drawn(machine: Machine, true: Truth, duration: float, seed: int) -> Verification:
    logs = recorded(true, "b", duration, np.random.default_rng([77, seed]))
    return verify_recording(machine, logs, options=RIPPLING)


@pytest.mark.parametrize("duration", [20.0, 30.0, 50.0])
def test_ripple_faster_than_the_rows_is_no_exchanged_gear(
    stored: tuple[Truth, Machine], duration: float
) -> None:
    """In rows of 10 ms the smoothing loses ripple that passes at 50 Hz.

    Its amplitude came out too small, and gear 6 was named with a log Bayes factor of 9 to 77.
    """
    truth, machine = stored
    outcome = verified_drawn(machine, truth, duration, 914)
    assert outcome.holds, outcome.sentence


@pytest.mark.parametrize(
    ("name", "size", "kind"),
    [("bd4", 2e-4, "ball-bar"), ("ra2", 5.8e-5, "geometry"), ("ra5", -6.5e-5, "geometry")],
)
def test_another_length_is_not_taken_for_a_gear(
    stored: tuple[Truth, Machine], name: str, size: float, kind: str
) -> None:
    """The dozen coefficients of gear 1, 2 or 5 took up these, and the gear was named."""
    truth, machine = stored
    geometry = truth.geometry
    now = replace(truth, geometry=geometry.replaced({name: geometry[name] + size}))
    (named,) = verified_drawn(machine, now, 60.0, 1).named
    assert named.cause.kind == kind
    assert name in named.cause.names
    if kind == "geometry":
        assert named.size[0] == pytest.approx(size, abs=4.0 * named.sigma[0])
        assert named.sentence.startswith(f"parameter {name} by ")
