"""Attenuation of gear harmonics that pass faster than the knots of the smoothed logs.

A harmonic of order n repeats at the frequency f = n v / (2 pi) when its gear turns at speed v. Of
that, a least-squares spline of degree p on knots h apart keeps the share

    H = u^-m / sum over k of (u + k)^-m,   u = f h,   m = 2 (p + 1),

the response of a fit to dense rows. The model has the whole harmonic, so its coefficients come out
wrong where H is below 1: by about their own size where all of the recording is too fast.
"""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.splines import DEGREE
from ballbar.ident.corrections.gear_ripple import WAVES, harmonic_orders
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.normal_equations import gradient_of, jacobian

_ALIASES = np.arange(-20, 21)[:, None]  # of the knots' frequency, so many on either side


def spline_response(frequency: Array, spacing: float) -> Array:
    """(...,) share of a harmonic of frequency (...,) [Hz] that knots `spacing` [s] apart keep."""
    u = np.minimum(np.abs(frequency) * spacing, float(_ALIASES[-1, 0]))
    around = np.sinc(u.reshape(-1) + _ALIASES) ** (2 * (DEGREE + 1))
    response = around[len(_ALIASES) // 2] / around.sum(axis=0)
    return np.asarray(response.reshape(u.shape))


def smoothing_covariance(fit: Fit, cell: Cell) -> Array:
    """(P, P) of what smoothing brings into the fit of one recording, zeros without ripple.

    A harmonic of amplitude c moves the estimate by `-C J' (1 - H) J_c c`, with C the covariance of
    the fit, J its Jacobian and J_c the column of the harmonic. Of c both the prior's size and the
    estimate count, as the latter may have come out too small.
    """
    model, (point,) = fit.model, fit.linear.evaluations
    layout = model.unknowns
    ripple = [
        c for each in model.corrections if each.name == "gear_ripple" for c in each.coefficients
    ]
    if not ripple or point.state is None:
        return np.zeros((layout.count, layout.count))
    at = np.array([layout.names.index(c.name) for c in ripple])
    orders = [(gear, order) for gear, order, _ in harmonic_orders(cell.robot) for _ in WAVES]
    speed = np.array([order * point.state.gear_speed[gear] for gear, order in orders])
    lost = 1.0 - spline_response(speed / (2.0 * np.pi), point.recording.smoothing)
    missing = np.zeros((layout.count, at.size))
    for block in jacobian(model, fit.linear, 0):
        columns = block.values[np.isin(block.index, at)]
        parts = columns * lost[:, None, block.samples]
        missing += np.column_stack([gradient_of(model, 0, block, part) for part in parts])
    moved = fit.covariance @ missing * np.hypot(layout.sigma[at], fit.x[at])
    return np.asarray(moved @ moved.T)
