"""Terms that a complete fit keeps: wrong ratios, and compliances that came out negative."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident import model_choice
from ballbar.ident.corrections.gear_ratio import GEAR_RATIO
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.model_choice import _wrong_ratio, needed_corrections, negative_coefficients


def fit_of(x: list[float], sigma: list[float], chi2: float = 1.0) -> Fit:
    """A fit whose coefficients are all of one correction."""
    covariance = np.diag(np.square(sigma))
    return cast(Fit, SimpleNamespace(x=np.array(x), covariance=covariance, chi2_per_dof=chi2))


@pytest.mark.parametrize(
    ("size", "sigma", "chi2", "wrong"),
    [
        (7e-4, 1e-5, 1.0, True),
        (-7e-4, 1e-5, 1.0, True),
        (5e-4, 1e-5, 1.0, False),  # errors of a joint with few cycles a turn look like it
        (9e-4, 2e-4, 1.0, False),  # five deviations are 1e-3
        (1.1e-3, 2e-4, 1.0, True),
        (1.1e-3, 2e-4, 4.0, False),  # residuals are twice as large as stated
        (9e-4, 2e-4, 0.25, False),  # smaller ones make nothing surer
    ],
)
def test_a_ratio_is_wrong_beyond_what_slow_errors_and_five_deviations_explain(
    size: float, sigma: float, chi2: float, wrong: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_choice, "coefficients_of", lambda *_: slice(0, 2))
    assert _wrong_ratio(fit_of([0.0, size], [1e-9, sigma], chi2), cast(Any, None)) == wrong


class Blocks:
    """Held-out cost that falls by a gain of each correction; its one coefficient is its place."""

    def __init__(self, gains: list[float]) -> None:
        self.gains = gains

    def held_out_cost(self, absent: Array) -> float:
        return 1e4 - sum(g for k, g in enumerate(self.gains) if k not in absent)


@pytest.mark.parametrize(("wrong", "needed"), [(False, ["a", "z"]), (True, ["a", GEAR_RATIO, "z"])])
def test_a_ratio_joins_only_where_it_is_wrong_and_others_by_what_they_predict(
    wrong: bool, needed: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names before and behind that of the ratio; a gain below 30 is none."""
    names = ["a", GEAR_RATIO, "small", "z"]
    tried: Any = [SimpleNamespace(name=name) for name in names]
    monkeypatch.setattr(model_choice, "time_blocks", lambda _: Blocks([50.0, 60.0, 29.0, 31.0]))

    def place(_: Fit, correction: Any) -> slice:
        k = names.index(correction.name)
        return slice(k, k + 1)

    monkeypatch.setattr(model_choice, "coefficients_of", place)
    monkeypatch.setattr(model_choice, "_wrong_ratio", lambda *_: wrong)
    chosen = needed_corrections(fit_of([0.0] * 4, [1.0] * 4), tried)
    assert [c.name for c in chosen] == needed


@pytest.mark.parametrize(
    ("value", "sigma", "negative"),
    [(-0.16, 0.07, True), (-0.14, 0.01, False), (-0.3, 0.16, False), (0.5, 0.01, False)],
)
def test_a_compliance_is_negative_beyond_two_deviations_and_a_part_of_its_prior(
    value: float, sigma: float, negative: bool
) -> None:
    """0.15 of the prior's deviation, which is 1 here: a rigid gear may come out either side."""
    coefficient = SimpleNamespace(name="c", never_negative=True, sigma=1.0)
    free = SimpleNamespace(name="free", never_negative=False, sigma=1.0)
    given: Any = fit_of([9.0, -9.0, value], [1.0, 1.0, sigma])
    given.model = SimpleNamespace(
        corrections=[SimpleNamespace(coefficients=[free, coefficient])],
        unknowns=SimpleNamespace(coefficients=slice(1, 3)),
    )
    assert negative_coefficients(given, np.array([1.0, 1.0, sigma])) == ("c",) * negative
