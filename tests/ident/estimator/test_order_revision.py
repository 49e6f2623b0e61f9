"""Joint errors that were found one after another are weighed against their neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.corrections.joint_harmonics import PRIOR
from ballbar.ident.estimator.linear_model import LinearModel
from ballbar.ident.estimator.order_revision import RevisedOrder, revised_orders
from ballbar.ident.estimator.order_search import wave_columns
from tests.helpers.joint_error_models import linear_model, uniform_angles

RIVALS = [(1, float(order)) for order in range(1, 41)]


def fitted(angles: Array, errors: Array, pairs: Sequence[tuple[int, float]]) -> LinearModel:
    """The model with the found errors among its unknowns, at their estimate, the last 2 F ones."""
    model = linear_model(angles, errors)
    waves = wave_columns(model, pairs).reshape(-1, *model.residual.shape)
    columns = np.concatenate((model.jacobian, waves))
    prior = np.diag([1e-6, 1e-6, *[PRIOR**-2] * len(waves)])
    flat = columns.reshape(len(columns), -1)
    x = -np.linalg.solve(flat @ flat.T + prior, flat @ model.residual.ravel())
    return replace(
        model,
        jacobian=columns,
        residual=model.residual + np.tensordot(x, columns, axes=1),
        prior_gradient=prior @ x,
        prior_normal=prior,
    )


def revised(angles: Array, errors: Array, found: Sequence[tuple[int, float]]) -> list[RevisedOrder]:
    """The found errors of a joint that moves by these angles, against whole orders up to 40."""
    model, own = fitted(angles, errors, found), np.arange(2, 2 + 2 * len(found))
    values = model.prior_gradient[own] * PRIOR**2
    rivals = [pair for pair in RIVALS if pair not in found]
    return revised_orders(model, own, values, found, rivals, 1.0)


def test_two_wrong_orders_that_make_up_for_one_are_replaced_by_it() -> None:
    """A forward search takes 5 and 12 cycles a turn for 9 on a joint that turns by 50 degrees."""
    angles = uniform_angles() * 0.14
    errors = np.zeros_like(angles)
    errors[1] = 3e-4 * np.sin(9.0 * angles[1] + 0.4) + 1e-4 * np.sin(27.0 * angles[1])
    (low, high, *_) = sorted(revised(angles, errors, [(1, 5), (1, 27), (1, 12)]), key=_order)
    assert (_order(low), _order(high)) == (9, 27)
    assert [each.number for each in (low, high)] in ([0, 1], [2, 1])


def test_what_explains_nothing_beside_the_others_goes() -> None:
    angles = uniform_angles()
    errors = np.zeros_like(angles)
    errors[1] = 2e-4 * np.cos(17.0 * angles[1])
    (only,) = revised(angles, errors, [(1, 17), (1, 4)])
    assert only == RevisedOrder(0, {(1, 17): pytest.approx(2e-4, rel=0.1)})


def test_orders_that_nothing_tells_apart_share_the_error() -> None:
    """Over 9 degrees 3 to 5 cycles a turn are much the same; over a whole turn they are not."""
    angles = uniform_angles() * 0.025
    errors = np.zeros_like(angles)
    errors[1] = 1e-4 * np.sin(4.0 * angles[1])
    (shared,) = revised(angles, errors, [(1, 4)])
    assert {(1, 3.0), (1, 5.0)} < shared.sizes.keys()
    assert next(iter(shared.sizes))[0] == 1
    together = np.sqrt(sum(size**2 for size in shared.sizes.values()))
    assert max(shared.sizes.values()) < 0.8 * together
    whole = uniform_angles()
    errors[1] = 1e-4 * np.sin(4.0 * whole[1])
    assert [each.sizes.keys() for each in revised(whole, errors, [(1, 4)])] == [{(1, 4)}]


def _order(each: RevisedOrder) -> float:
    return next(iter(each.sizes))[1]
