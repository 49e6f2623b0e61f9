"""Effects that no model has are named by what a complete fit leaves in its residual."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ballbar import identify
from ballbar.ident.causes.effects import least_sizes, stop
from tests.independent.machine import Effects
from tests.independent.recording import Plan, record

EFFECTS = {
    "hysteresis of the gears along their load": Effects(hysteresis=5e-5),
    "hysteresis of the gears along their motion": Effects(reversal=3e-5),
    r"the base of the ball-bar sways at 0\.(69\d?|7) Hz": Effects(sway=(3e-5, 0.7)),
}
SHORT = 60.0  # [s]


def test_a_stop_operator_follows_what_drags_it_and_forgets_all_else() -> None:
    """Slopes of one after every reversal, closed loops, and the same again after any detour."""
    way = np.array([0.0, 3.0, 2.5, 2.8, -3.0, -2.5, 3.0])
    np.testing.assert_allclose(stop(way[None])[0], [0.0, 1.0, 0.5, 0.8, -1.0, -0.5, 1.0])
    fine = np.interp(np.linspace(0.0, 6.0, 601), np.arange(7), way)
    np.testing.assert_allclose(stop(fine[None])[0][::100], stop(way[None])[0], atol=1e-12)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("cause", EFFECTS)
def test_an_effect_is_named_and_its_result_is_not_acceptable(cause: str, tmp_path: Path) -> None:
    record(Plan(1, EFFECTS[cause], duration=SHORT), tmp_path)
    verdict = identify(tmp_path / "1", tmp_path / "2").data.identification.verdict
    assert re.search(cause, verdict.sentence)
    assert not verdict.acceptable


def test_columns_that_other_unknowns_stand_for_explain_nothing() -> None:
    """The zero of joint 1 is the turn of each base: rounding gave it 20 times the whole cost."""
    information = np.array([[1.0, 0.3, 0.0], [0.3, 1.0, 0.0], [0.0, 0.0, 1e-9]])
    np.testing.assert_allclose(
        least_sizes(information, np.array([1.3, 1.3, 0.5])), [-1.0, -1.0, 0.0], atol=1e-12
    )
    np.testing.assert_allclose(least_sizes(1e-9 * np.eye(2), np.ones(2)), 0.0)
