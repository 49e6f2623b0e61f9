"""Flanks of the gears' backlash at still poses of a small arm, where the poses tell them.

Friction holds a gear on the flank from which its joint came wherever the weight is too small to
press it to the other. Where that is so is known to a factor alone, and one pose on a wrong flank
tells that the gear has no play, and with it a wrong zero, surely: of two flanks that differ by
nothing. So a gear of whose play nothing shows is taken to lie on the flank to which the weight
presses it for certain, which leaves zero and play one direction; and a pose that then lies the
whole play beside the model lies on the other flank (classification by largest likelihood).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.robust_fit import fit_robustly
from ballbar.ident.loads.at_rest import are_undecided

SEEN = 4.0  # standard deviations from which play is seen
CLEAR = 4.0  # difference of a pose's chi-square from which its gear lies on the other flank
ROUNDS = 8  # of new flanks


def on_flanks_of_poses(fit: Fit) -> Fit:
    """The fit with flanks that the poses tell, where friction may hold a gear of a small arm."""
    first = _backlash(fit)
    if first is None or fit.model.masses is None or fit.model.masses.friction is None:
        return fit
    flanks = [fit.model.resting[k][0].load_sign() for k in range(len(fit.model.parts))]
    for step in (_without_unseen, *[_turned] * ROUNDS):
        after = step(fit, first, flanks)
        if not all(map(np.array_equal, after, flanks)):
            fit = _refitted(fit, after)
        elif step is _turned:
            break
        flanks = after
    return fit


def _backlash(fit: Fit) -> slice | None:
    """Where the unknowns of the gears' backlash stand; None where there are none."""
    names = fit.model.unknowns.names
    if "backlash1" not in names:
        return None
    first = names.index("backlash1")
    return slice(first, first + len(fit.model.gearing.to_joint))


def _open(fit: Fit, part: int) -> NDArray[np.bool_]:
    """(J, N) whether friction may hold a gear at the poses of a group on either flank."""
    model = fit.model
    assert model.masses is not None
    assert model.masses.friction is not None
    q, geometry = model.poses.groups[part].q, model.unknowns.bare(fit.x)
    return are_undecided(model.masses, model.masses.friction, geometry, q)


def _unseen(fit: Fit, first: slice) -> NDArray[np.bool_]:
    """(J,) whether the poses do not show the play of a gear."""
    return np.asarray(fit.x[first] < SEEN * np.sqrt(np.diag(fit.covariance)[first]))


def _without_unseen(fit: Fit, first: slice, flanks: list[Array]) -> list[Array]:
    """(J, N) flanks of each group: of gears whose play is not seen that of most certain poses."""
    undecided = [_open(fit, k) for k in range(len(flanks))]
    certain = [np.where(o, 0.0, f).sum(axis=1) for o, f in zip(undecided, flanks, strict=True)]
    side = (_unseen(fit, first) * np.sign(sum(certain)))[:, None]
    return [np.where(o & (side != 0.0), side, f) for o, f in zip(undecided, flanks, strict=True)]


def _turned(fit: Fit, first: slice, flanks: list[Array]) -> list[Array]:
    """(J, N) flanks of each group: the other one where it explains the pose clearly best.

    A gear whose play is not seen has that of its file.
    """
    half = np.where(_unseen(fit, first), fit.model.unknowns.mean[first], fit.x[first])
    out = []
    for k, (point, weights) in enumerate(
        zip(fit.linear.evaluations, fit.linear.weights, strict=True)
    ):
        gain = np.zeros_like(flanks[k])
        for g, (own, used, flank) in enumerate(zip(fit.x[first], half, flanks[k], strict=True)):
            column = point.columns[g] * flank
            without = point.closure.error + own * column
            here, there = (weights(without + sign * used * column) for sign in (-1.0, 1.0))
            gain[g] = (here**2).sum(axis=0) - (there**2).sum(axis=0)
        gain *= _open(fit, k)
        turned = gain - np.maximum(np.sort(gain, axis=0)[-2], 0.0) > CLEAR
        out.append(np.where(turned, -flanks[k], flanks[k]))
    return out


def _refitted(fit: Fit, flanks: list[Array]) -> Fit:
    """The fit once more with other flanks (J, N) of each group."""
    table = fit.model.poses
    groups = [replace(g, flanks=f.T) for g, f in zip(table.groups, flanks, strict=True)]
    model = replace(fit.model, table=replace(table, groups=tuple(groups)))
    return fit_robustly(model, fit.x, fit.excess)
