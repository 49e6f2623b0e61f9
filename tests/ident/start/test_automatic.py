"""Starting values from two logs alone: clock, encoder directions and offsets, base position."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry, robot_frames
from ballbar.ident.estimator import gauss_newton
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.signals.smooth_log import SmoothLog
from ballbar.ident.start import automatic
from ballbar.ident.start.automatic import (
    GEOMETRY_SIGMA,
    Hypothesis,
    StartError,
    automatic_start,
    fit_hypothesis,
    length_hypotheses,
    start_parameters,
)
from ballbar.sim.errors.static_errors import THESIS_3_1
from tests.helpers.six_axes import FIXED, NAMES, TABLE
from tests.helpers.start_candidates import candidate
from tests.helpers.synthetic_recording import CELL, NOMINAL, closed, exact_log, minute

EXCESS = ExcessNoise(rod=2e-6)
TRUE = NOMINAL.replaced({name: NOMINAL[name] + e * 1e-3 for name, e in THESIS_3_1.items()})
CATALOGUE = NOMINAL.replaced({"ox": 0.0, "oy": 0.0, "oz": 0.0})
OFFSETS = np.array([2.0, -1.0, 0.7, 3.0, -2.5])  # [rad] of the encoders
LATE = 17.3  # [s] after the robot's log the ball-bar's begins
SPACING = 0.04  # [s] of 1500 samples


def logs(
    encoders: tuple[int, ...], directions: dict[int, int] | None = None, noise: float = 1e-5
) -> tuple[SmoothLog, SmoothLog | None]:
    """The minute by a robot off by millimetres; the ball-bar's log begins late, on its clock."""
    rng, path = np.random.default_rng(51), minute()
    q = closed(TRUE, path.b, path.q) + noise * rng.standard_normal(path.q.shape)
    robot = exact_log(path.t, q, 1e-5)
    if not encoders:
        return robot, None
    signs = np.array([(directions or {}).get(j, 1) for j in range(1, 6)])
    read = signs * (path.b - OFFSETS) + noise * rng.standard_normal(path.b.shape)
    return robot, exact_log(path.t - LATE, read[:, [j - 1 for j in encoders]], 1e-5)


def wrapped(angle: float) -> float:
    return float(np.angle(np.exp(1j * angle)))


@pytest.mark.parametrize(
    ("encoders", "directions"),
    [
        ((1, 2), {}),
        ((1, 2), {1: -1}),
        ((4, 5), {5: -1}),
        ((1, 2, 4, 5), {1: -1, 5: -1}),
        ((1, 2, 3, 4, 5), {3: -1}),
    ],
)
def test_clock_directions_offsets_and_base_are_found_without_a_guess(
    encoders: tuple[int, ...], directions: dict[int, int]
) -> None:
    robot, ballbar = logs(encoders, directions)
    start = automatic_start(robot, ballbar, encoders, CATALOGUE, EXCESS, spacing=SPACING)
    chosen = start.chosen
    assert not start.ambiguous
    assert chosen.hypothesis.directions == tuple(directions.get(j, 1) for j in encoders)
    # The nominal robot's errors of a millimetre at 0.5 m/s; two encoders tell less than four.
    assert chosen.fit.clock().offset == pytest.approx(LATE, abs=2e-3)
    geometry = chosen.fit.geometry()
    assert geometry.origin == pytest.approx(NOMINAL.origin, abs=10e-3)
    for joint in encoders:
        # rtheta1 is held, and a turn of the robot about its first axis is one of b1 and the base
        off = wrapped(geometry[f"btheta{joint}"] - OFFSETS[joint - 1])
        assert abs(off) < 1e-2, joint
    assert chosen.overlap == pytest.approx(60.0, abs=0.1)


def test_without_encoders_the_sphere_gives_the_base() -> None:
    robot, _ = logs(())
    start = automatic_start(robot, None, (), CATALOGUE, EXCESS, spacing=SPACING)
    assert start.chosen.fit.geometry().origin == pytest.approx(NOMINAL.origin, abs=10e-3)
    assert start.chosen.fit.model.unknowns.own[0].clock is None
    assert start.chosen.hypothesis.directions == ()


@pytest.mark.parametrize(
    ("encoders", "words"),
    [
        ((1,), "no complete gimbal"),
        ((3,), "no complete gimbal"),
        ((1, 2, 4), "half a gimbal is fitted"),
        ((1, 2, 3), "needs b1, b2, b4 and b5 beside it"),
    ],
)
def test_encoders_that_cannot_be_aligned_are_refused_in_words(
    encoders: tuple[int, ...], words: str
) -> None:
    robot, ballbar = logs(encoders)
    with pytest.raises(StartError, match=words):
        automatic_start(robot, ballbar, encoders, CATALOGUE, EXCESS, spacing=SPACING)


def test_a_robot_that_stands_still_is_refused_in_words() -> None:
    _, ballbar = logs((1, 2))
    t = minute().t
    still = exact_log(t, np.tile(minute().q[0], (t.size, 1)))
    with pytest.raises(StartError, match="no sphere can be seen"):
        automatic_start(still, ballbar, (1, 2), CATALOGUE, EXCESS, spacing=SPACING)


def test_logs_too_short_for_any_overlap_are_refused_in_words() -> None:
    robot, _ = logs(())
    t = np.arange(0.0, 4.0, 0.05)
    short = exact_log(t, np.column_stack((np.sin(t), np.cos(t))))
    with pytest.raises(StartError, match="no clock offset makes the two logs agree anywhere"):
        automatic_start(robot, short, (1, 2), CATALOGUE, EXCESS, spacing=SPACING)


def hypothesis(offset: float, geometry: Geometry = NOMINAL, score: float = 1.0) -> Hypothesis:
    return Hypothesis(Clock(offset, 0.0), (1, 1), geometry, score)


def test_a_hypothesis_under_which_the_logs_do_not_overlap_leads_nowhere() -> None:
    robot, ballbar = logs((1, 2))
    assert fit_hypothesis(hypothesis(500.0), robot, ballbar, (1, 2), EXCESS, SPACING) is None


def test_a_hypothesis_that_cannot_be_linearised_leads_nowhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def singular(*_: object, **__: object) -> None:
        raise gauss_newton.SingularError("the fit cannot be linearised")

    monkeypatch.setattr(automatic, "fit_kinematics", singular)
    robot, ballbar = logs((1, 2))
    assert fit_hypothesis(hypothesis(LATE), robot, ballbar, (1, 2), EXCESS, SPACING) is None


def test_base_and_encoder_offsets_are_free_in_the_start_the_rest_is_held_near_the_catalogue() -> (
    None
):
    parameters, sigma = start_parameters(TABLE, (1, 2))
    priors = dict(zip((NAMES[i] for i in parameters), sigma, strict=True))
    assert {name for name, s in priors.items() if np.isinf(s)} == {
        "btheta1", "btheta2", "ox", "oy", "oz",
    }  # fmt: skip
    assert not set(FIXED) & set(priors)
    assert {s for s in priors.values() if np.isfinite(s)} == {GEOMETRY_SIGMA}
    assert "bd3" in priors
    assert CELL.ballbar.length_tolerance < GEOMETRY_SIGMA  # it is a weight, not what is known


@pytest.mark.parametrize(
    ("candidates", "chosen", "rivals"),
    [
        # The least cost wins over the better score, which is the order of the list.
        ([(0.0, 9.0), (7.0, 1.0)], 1, []),
        # So it does where the other one cannot be excluded.
        ([(0.0, 2.0), (7.0, 1.0)], 1, [0]),
        # Within a fifth of the cost they are equally good, and the score decides; a rival it stays.
        ([(0.0, 1.15), (7.0, 1.0)], 0, [1]),
        # The same answer twice is no rival.
        ([(0.0, 1.0), (0.01, 1.0)], 0, []),
        # The same clock, but the ball-bar stands elsewhere.
        ([(0.0, 1.0, 60.0, 0.7), (0.0, 1.0, 60.0, 0.8)], 0, [1]),
        # A short overlap is easily explained: it is neither chosen nor a rival.
        ([(0.0, 1.0, 30.0), (7.0, 1.3, 60.0)], 1, []),
        # A cost of more than twice the least and a half is no answer.
        ([(0.0, 1.0), (7.0, 2.6)], 0, []),
        ([(0.0, 1.0), (7.0, 2.4)], 0, [1]),
    ],
)
def test_what_the_fits_explain_decides_among_the_hypotheses(
    candidates: list[tuple[float, ...]],
    chosen: int,
    rivals: list[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ranked = [candidate(*values) for values in candidates]
    waiting = iter(ranked)
    monkeypatch.setattr(automatic, "fit_hypothesis", lambda *_: next(waiting))
    monkeypatch.setattr(automatic, "_hypotheses", lambda *_: (c.hypothesis for c in ranked))
    robot, ballbar = logs((1, 2))
    start = automatic_start(robot, ballbar, (1, 2), CATALOGUE, EXCESS, spacing=SPACING)
    assert start.chosen is ranked[chosen]
    assert list(start.rivals) == [ranked[k] for k in rivals]
    assert start.ambiguous == bool(rivals)
    assert start.tried == len(ranked)


def test_a_sensed_length_gives_clock_seat_and_the_zero_of_its_sensor() -> None:
    """Both logs begin away from zero, the sensor's 4 mm short."""
    path, zero = minute(), 4e-3
    q = path.q + 0.15 * np.sin(0.43 * path.t)[:, None] * np.eye(6)[2]  # off the sphere
    robot = exact_log(path.t + 5.0, q)
    away = np.linalg.norm(robot_frames(NOMINAL, q).tip.T - NOMINAL.origin, axis=1)
    read = (away - NOMINAL["bd3"] - zero)[:, None]
    extension = exact_log(path.t + 2.0, read)
    best = next(length_hypotheses(robot, extension, CATALOGUE, zero_sigma=0.01))
    assert best.clock.offset == pytest.approx(3.0, abs=0.01)
    assert best.geometry["bd3"] == pytest.approx(NOMINAL["bd3"] + zero, abs=1e-4)
    assert best.geometry.origin == pytest.approx(NOMINAL.origin, abs=1e-3)
