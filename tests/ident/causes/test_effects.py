"""Effects that no model has are named by what a complete fit leaves in its residual."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar import identify
from ballbar.ident.causes import effects
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


def swaying(frequency: float, *seconds: float) -> Any:
    """Residuals of a base of the ball-bar that sways along y by 1 and along z by 0.5."""
    recorded = []
    for k, longest in enumerate(seconds):
        t = 100.0 * k + np.sort(np.random.default_rng(k).uniform(0.0, longest, 900))
        t[[0, -1]] = 100.0 * k, 100.0 * k + longest
        residual = np.zeros((6, t.size))
        residual[1] = np.sin(2.0 * np.pi * frequency * t + 0.4 * k)
        residual[2] = 0.5 * np.cos(2.0 * np.pi * frequency * t)
        point = SimpleNamespace(recording=SimpleNamespace(times=t))
        recorded.append((point, lambda columns: columns, residual))
    return SimpleNamespace(recorded=recorded)


@pytest.mark.parametrize("frequency", [0.11, 0.7, 2.337, 3.9])
def test_a_sway_has_its_frequency_and_columns_that_hold_all_of_it(frequency: float) -> None:
    """Frequencies are a quarter of one over the longest recording apart."""
    fit = swaying(frequency, 30.0, 50.0)
    found, columns = effects._sway(fit)
    assert found == pytest.approx(frequency, abs=0.5 * 0.25 / 50.0 + 1e-9)
    for k, (own, (_, _, residual)) in enumerate(zip(columns, fit.recorded, strict=True)):
        assert own.shape == (12, 6, 900)
        assert not own[6 * (1 - k) : 6 * (1 - k) + 6].any(), "of the other recording"
        flat = own.reshape(12, -1)
        size = np.linalg.lstsq(flat.T, residual.reshape(-1), rcond=None)[0]
        left = residual.reshape(-1) - size @ flat
        assert (left**2).sum() < 0.06 * (residual**2).sum()


def test_fewer_than_three_cycles_are_no_sway() -> None:
    """They look like a seat that moved; the nearest frequency is three cycles in 50 s."""
    assert effects._sway(swaying(0.02, 50.0))[0] >= 3.0 / 50.0


def test_effects_are_worded_with_the_gear_and_size_that_is_largest() -> None:
    assert effects._hysteresis("load", np.array([1e-6, 2e-6, -3e-5, 2e-5, 0.0, 0.0])) == (
        "hysteresis of the gears along their load, most in gear 2 (50 urad)"
    )
    assert effects._hysteresis("motion", np.array([1e-6, -4e-5, 2e-6])) == (
        "hysteresis of the gears along their motion, most in gear 2 (40 urad)"
    )
    assert effects._drift(3, np.array([1e-5, -2.5e-5])) == "the zero of gear 3 drifts by 25 urad"
    assert effects._swing(0.704, np.array([3e-6, 4e-6])) == (
        "the base of the ball-bar sways at 0.704 Hz by 5 um"
    )


def test_what_a_column_explains_is_the_share_that_no_unknown_stands_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By regression: the residual of two columns on the unknown and on one effect at a time."""
    rng = np.random.default_rng(8)
    unknown, first, second = rng.standard_normal((3, 5, 40))
    first += 0.8 * unknown
    residual = 2.0 * first + 0.1 * rng.standard_normal((5, 40))
    flat = unknown.reshape(-1)
    residual -= unknown * (flat @ residual.reshape(-1)) / (flat @ flat)  # the fit has ended
    model = SimpleNamespace(recordings=[None], unknowns=SimpleNamespace(count=1))
    covariance = np.array([[1.0 / (flat @ flat)]])
    recorded = [(None, None, residual)]
    fit: Any = SimpleNamespace(model=model, linear=None, covariance=covariance, recorded=recorded)
    monkeypatch.setattr(effects, "jacobian", lambda *_: [None])
    monkeypatch.setattr(effects, "products", lambda *a: np.array([(unknown * a[-1]).sum()]))
    made = [("first", first), ("second", second)]
    columns = [(lambda size, n=n: f"{n} {size[0]:.3f}", "", [c[None]]) for n, c in made]
    monkeypatch.setattr(effects, "_columns", lambda _: iter(columns))
    found = effects.effects_beside(fit)
    assert [e.cause.split()[0] for e in found] == ["first", "second"]
    for effect, (_, column) in zip(found, made, strict=True):
        basis = np.stack([flat, column.reshape(-1)], axis=1)
        size, left, *_ = np.linalg.lstsq(basis, residual.reshape(-1), rcond=None)
        assert effect.left == pytest.approx(left[0] / (residual**2).sum(), rel=1e-9)
        assert abs(float(effect.cause.split()[1])) == pytest.approx(abs(size[1]), abs=1e-3)
