"""Figures that a result takes from a fit: what its prior resists, how soft its gears are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.geometry import parameter_named
from ballbar.cell.load import load_robot
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.estimates import pulled
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.priors import LENGTH_PRIOR
from ballbar.ident.fitted_robot import softer_gears
from ballbar.ident.table_fit import added_table


def fit_of(changes: dict[str, float], sigma: float = 1e-6) -> Fit:
    """A fit whose parameters stand off the means; those of the instrument have this prior."""
    names, count = tuple(changes), len(changes)
    layout = SimpleNamespace(
        names=names,
        machine=np.arange(count),
        mean=np.full(count, 0.2),
        sigma=np.full(count, sigma),
        shared=np.arange(count),
        parameters=[parameter_named(name) for name in names],
        fixed=SimpleNamespace(table=SimpleNamespace(plate="ra6")),
        gain=None,
    )
    return cast("Fit", SimpleNamespace(x=0.2 + np.array([*changes.values()]), model=_model(layout)))


def _model(layout: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(unknowns=layout, corrections=(), masses=None)


def test_an_unknown_far_from_its_prior_is_named_if_the_distance_matters() -> None:
    """3.5 deviations, and 5 um of a length or 25 urad of an angle; the furthest comes first."""
    fit = fit_of({"ba2": 6e-6, "bd4": 4e-6, "balpha2": 2e-5, "balpha3": -3e-5, "ra6": 1e-6})
    assert pulled(fit) == ("balpha3", "ba2")
    assert pulled(fit_of({"ba2": 6e-6}, sigma=2e-6)) == ()


def test_a_robots_parameter_is_far_from_the_catalogue_after_five_deviations_of_its_prior() -> None:
    """Whatever the tail of its prior has come to."""
    fit = fit_of({"rd4": 4.9 * LENGTH_PRIOR, "ra2": 5.1 * LENGTH_PRIOR, "rtheta3": 0.02}, 1.0)
    assert pulled(fit) == ("rtheta3", "ra2")


def test_gears_without_a_fitted_compliance_are_as_the_catalogue_has_them() -> None:
    fit = fit_of({"ra2": 0.0})
    assert softer_gears(fit) == 1.0


@pytest.mark.parametrize("factor", [0.8, 2.0])
def test_softness_is_the_mean_factor_over_the_gears(factor: float) -> None:
    correction = joint_compliance(load_robot("irb2400"))
    means = np.array([c.mean for c in correction.coefficients])
    spread = np.resize([1.5, 1.0 / 1.5], means.size)
    layout = SimpleNamespace(coefficients=slice(0, means.size))
    model = SimpleNamespace(unknowns=layout, corrections=(correction,))
    fit = cast("Fit", SimpleNamespace(model=model, x=factor * spread * means))
    assert softer_gears(fit) == pytest.approx(factor, rel=1e-12)


def test_a_fit_of_recordings_alone_has_no_table() -> None:
    model = SimpleNamespace(unknowns=SimpleNamespace(), recordings=(), table=None)
    assert added_table(cast("Fit", SimpleNamespace(model=model)), np.eye(1)) is None
