"""Recordings that judge each other: what changed between them, and along one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cell.arrays import Array
from cell.geometry import Geometry
from cell.logs import RobotLog
from ident.complete_fit import fit_complete
from ident.consistency import Change, Consistency, consistency
from ident.options import FitOptions
from ident.recording_fit import Logs, fit_recording
from tests.helpers.minute_logs import minute_logs
from tests.helpers.synthetic_recording import CELL, NOMINAL

OPTIONS = FitOptions(model="complete", samples=400, corrections=())


def judged(*logs: Logs) -> Consistency:
    recordings = [fit_recording(CELL, each, OPTIONS) for each in logs]
    return consistency(fit_complete(CELL, recordings, (), OPTIONS))


def moved(logs: Logs, axis: int, size: float, begin: Callable[[Array], Array]) -> Logs:
    """The logs of a robot whose axis reads `size` [rad] more where `begin` of the times holds."""
    log, q = logs.robot, logs.robot.q.copy()
    q[begin(log.t), axis - 1] += size
    return replace(logs, robot=RobotLog(log.t, q))


def always(t: Array) -> Array:
    return np.ones(t.size, dtype=bool)


def another(**changes: float) -> Geometry:
    return NOMINAL.replaced({name: NOMINAL[name] + change for name, change in changes.items()})


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_recordings_of_one_machine_agree(seed: int) -> None:
    result = judged(minute_logs(seed=2 * seed), minute_logs(seed=2 * seed + 1))
    assert result.change is None
    assert result.sentence == ""
    assert all(0.8 < ratio < 1.2 for ratio in result.held_out)


@pytest.mark.slow
def test_a_zero_that_moved_between_recordings_is_named_with_its_size() -> None:
    result = judged(minute_logs(), moved(minute_logs(seed=1), 4, 1e-4, always))
    assert result.change is not None
    assert (result.change.recording, result.change.time) == (1, None)
    assert result.change.group == "rtheta4"
    assert abs(result.change.size) == pytest.approx(1e-4, rel=0.1)
    assert result.sentence.startswith(
        "recording 2 is not of the same machine as the others: the zero of axis 4 differs by"
    )
    assert max(result.held_out) > 1.5


@pytest.mark.slow
def test_a_zero_that_moved_along_a_recording_is_named_with_its_time() -> None:
    result = judged(minute_logs(), moved(minute_logs(seed=1), 5, 2e-4, lambda t: t > 30.0))
    assert result.change is not None
    assert (result.change.recording, result.change.group) == (1, "rtheta5")
    assert result.change.time == pytest.approx(30.0, abs=4.0)
    assert "from t = " in result.sentence


@pytest.mark.slow
def test_another_rod_is_not_another_robot() -> None:
    result = judged(minute_logs(), minute_logs(true=another(bd3=2e-4), seed=1))
    assert result.change is not None
    assert (result.change.group, result.change.time) == ("bd3", None)
    assert result.change.size == pytest.approx(2e-4, rel=0.1)


@pytest.mark.slow
def test_another_robot_is_named_as_one() -> None:
    rng = np.random.default_rng(3)
    names = ("ra1", "ra2", "ra3", "rd4", "ralpha2", "ralpha4", "ralpha5", "rtheta3", "rtheta5")
    other = another(
        **{name: float(v) for name, v in zip(names, 1e-3 * rng.standard_normal(9), strict=True)}
    )
    result = judged(minute_logs(), minute_logs(true=other, seed=1))
    assert result.change is not None
    assert (result.change.group, result.change.time) == ("robot", None)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "named"), [(1e-5, False), (5e-5, True)])
def test_a_zero_that_wandered_as_unchanged_ones_do_is_no_other_machine(
    size: float, named: bool
) -> None:
    """One of 10 urad is certain after two minutes, and made the verdict a misfit."""
    result = judged(minute_logs(), moved(minute_logs(seed=1), 4, size, always))
    assert (result.change is not None) == named


@pytest.mark.parametrize(
    ("group", "size", "share", "matters"),
    [
        ("rtheta2", -2e-5, 0.9, False),
        ("rtheta2", -3e-5, 0.9, True),
        ("bd3", 1e-5, 0.9, False),
        ("bd3", 1.5e-5, 0.9, True),
        ("robot", 1e-3, 0.05, False),
        ("gear3", 1e-7, 0.2, True),
    ],
)
def test_a_change_matters_by_its_size_or_by_its_share_of_the_residual(
    group: str, size: float, share: float, matters: bool
) -> None:
    assert Change(1, None, group, size, 1000.0, share).matters == matters


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("rtheta2", "the zero of axis 2 differs by +0.250 mrad"),
        ("gear3", "gear 3 yields, plays or ripples otherwise"),
        ("bd3", "the rod's length differs by +0.250 mm"),
        ("loads", "as under another tool or payload"),
        ("bar", "the ball-bar's joints stand otherwise"),
        ("tool", "the tool sits 0.250 mm elsewhere"),
        ("seat", "the ball-bar's base stands 0.250 mm elsewhere"),
        ("robot", "another robot, or one that was repaired"),
    ],
)
def test_every_change_has_words_and_a_remedy(group: str, words: str) -> None:
    between = Change(0, None, group, 2.5e-4, 2.0).sentence
    within = Change(1, 63.2, group, 2.5e-4, 2.0).sentence
    assert words in between
    assert words in within
    assert between.endswith("Identify it by itself")
    assert within.startswith("from t = 63 s on the machine of recording 2 is another one: ")
