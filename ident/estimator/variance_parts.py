"""Parts of a fit's covariance by where they come from: each source of noise, each prior.

With weights W = V^-1, where V is a sum over sources of noise s, the normal matrix of a fit is
`H = J' W J + P` with the priors P, and its covariance C splits exactly,

    C = C H C = sum over s of C J' W V_s W J C + sum over p of C P_p C:

the variance that each input of the estimate passes on (law of propagation of uncertainty, JCGM
100:2008, 5.1.2), inputs being independent. V_s is formed from the noise columns with all other
sources switched off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.model import Evaluation
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import JacobianBlock, jacobian, known_distance
from ballbar.ident.estimator.whitening import FLOOR_SIGMA

BACKLASH, ROUNDING, DISTANCE = "backlash", "rounding", "distance"  # names of sources
NONE = ExcessNoise()


@dataclass(frozen=True, eq=False)
class VariancePart:
    """Contribution of the sources of one row to the covariance of some unknowns."""

    row: str
    covariance: Array  # (R, R)
    size: float  # standard deviation of the source [m, rad, s], root mean square of several


def variance_parts(
    fit: Fit, rows: NDArray[np.intp], row_of: Callable[[str], str]
) -> list[VariancePart]:
    """Parts of the covariance (R, R) [m, rad] of the unknowns `rows` (R,) by the normal matrix.

    row_of : name of the part in which a source stands: noise as `noise_sources` names it, or a
        prior by its unknown.
    """
    if not rows.size:
        return []
    own, layout = inverse(fit.linear.normal)[rows], fit.model.unknowns
    roots, sizes = dict[str, list[Array]](), dict[str, list[float]]()
    for i in np.flatnonzero(np.isfinite(layout.sigma)):
        name = row_of(layout.names[i])
        roots.setdefault(name, []).append(own[:, i] / layout.sigma[i])
        sizes.setdefault(name, []).append(float(layout.sigma[i]))
    for known in fit.model.distances:
        column = own @ known_distance(fit.model, fit.x, known)[0]
        roots.setdefault(row_of(DISTANCE), []).append(column)
        sizes.setdefault(row_of(DISTANCE), []).append(known.sigma)
    by_prior = {name: np.array(root).T for name, root in roots.items()}
    return [
        *_parts_of_noise(fit, own, row_of),
        *(VariancePart(name, root @ root.T, rms(sizes[name])) for name, root in by_prior.items()),
    ]


def noise_sources(
    point: Evaluation, excess: ExcessNoise, uncertain: Array | float
) -> Iterator[tuple[str, Array, float]]:
    """Name, columns (K, 6, N) [m, rad] and standard deviation of each source of noise by itself.

    excess, uncertain : as of `Evaluation.noise_columns`, whose covariance is that of all of these
    together.
    """
    part = point.samples
    for name, alone, size in part.noise_sources:
        yield name, alone.noise_columns(point, NONE), size
    for component in fields(ExcessNoise):
        if size := getattr(excess, component.name):
            single = ExcessNoise(**{component.name: size})
            yield component.name, part.silent.noise_columns(point, single), size
    if np.ndim(uncertain):
        columns = part.silent.noise_columns(point, NONE, uncertain)
        yield BACKLASH, columns, rms(uncertain)
    floor = np.repeat(FLOOR_SIGMA * np.eye(6)[:, :, None], part.size, axis=2)
    yield ROUNDING, floor, FLOOR_SIGMA


def _parts_of_noise(fit: Fit, own: Array, row_of: Callable[[str], str]) -> list[VariancePart]:
    """The parts of all sources of noise; own : (R, P) rows of the covariance."""
    model, linear = fit.model, fit.linear
    squares, sizes = dict[str, Array](), dict[str, list[float]]()
    for k, point in enumerate(linear.evaluations):
        uncertain = model.backlash_uncertainty(fit.x, point)
        sources = []
        for name, columns, size in noise_sources(point, fit.excess, uncertain):
            if (used := columns.any(axis=(1, 2))).any():
                sources.append((name, columns[used]))
                sizes.setdefault(name, []).append(size)
        for block in jacobian(model, linear, k):
            moved = _moved(fit, own, k, block)
            weights = linear.weights[k].part(block.samples)
            for name, columns in sources:
                white = weights(columns[..., block.samples])  # (K, E, n)
                deviations = np.einsum("ren,ken->rkn", moved, white).reshape(len(own), -1)
                half = dsyrk(1.0, deviations.T, trans=1)  # the upper triangle
                squares[name] = squares.get(name, 0.0) + half + np.triu(half, 1).T
    return [
        VariancePart(row_of(name), square, rms(sizes[name])) for name, square in squares.items()
    ]


def _moved(fit: Fit, own: Array, k: int, block: JacobianBlock) -> Array:
    """(R, E, n) motion of the estimate per unit of each whitened error of a block of part k."""
    p, equations, n = block.values.shape
    moved = (own[:, block.index] @ block.values.reshape(p, -1)).reshape(len(own), equations, n)
    knots = fit.model.unknowns.knots(k)
    if block.slope is not None and knots is not None:
        splines = fit.model.recordings[k].splines[:, block.samples]
        moved += (splines.T @ own[:, knots].T).T[:, None] * block.slope
    return np.asarray(moved)
