"""Corrections that a fit was tried with and left out: what they could move the estimate by.

That the data do not show a term is no proof that it is not there. An estimate chosen so states the
uncertainty of a model that is taken for granted (Chatfield 1995). A term of the machine that was
left out therefore stays a candidate: with the estimate c of its coefficients and their covariance
D, the mean square of what is neglected is `D + c c'`, and the other unknowns x moved by

    x_c = C_xc C_cc^-1

for each of them as the term went. What few machines have is not among them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.corrections.base import Correction

# y of joint 2 and its like: parallel to the gear of the joint before, whose compliance holds it
TILT, COMPLIANCE = "tilt", "compliance"


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Shifts of the estimate by the terms that were left out of a fit at once."""

    names: tuple[str, ...]  # (P,) of the unknowns that stayed
    shifts: Array  # (P, H) for independent directions of their coefficients
    sizes: Mapping[str, float]  # root mean square of what each coefficient may be
    corrections: tuple[Correction, ...] = ()

    def of(self, names: Sequence[str]) -> Array:
        """(Q, H) shifts of the unknowns `names`, 0 for those that came later."""
        place = {name: k for k, name in enumerate(self.names)}
        rows = [self.shifts[place[n]] if n in place else 0.0 * self.shifts[0] for n in names]
        return np.array(rows)


def left_out(
    names: Sequence[str], x: Array, covariance: Array, gone: NDArray[np.intp], widening: float
) -> LeftOut:
    """Shifts that a fit may lack without its unknowns `gone` (H,), of mean 0.

    x : (P,) estimate with them. covariance : (P, P) of it, if residuals were white. widening : of
    the variance, as they are not.
    """
    own, values = covariance[np.ix_(gone, gone)], x[gone]
    stayed = np.setdiff1d(np.arange(x.size), gone)
    square = widening * own + np.outer(values, values)
    scale = np.sqrt(np.diag(square))
    size, directions = np.linalg.eigh(square / np.outer(scale, scale))
    root = scale[:, None] * directions * np.sqrt(np.maximum(size, 0.0))
    shifts = covariance[np.ix_(stayed, gone)] @ np.linalg.solve(own, root)
    sizes = dict(zip([names[i] for i in gone], scale.tolist(), strict=True))
    return LeftOut(tuple(names[i] for i in stayed), shifts, sizes)


def held_tilts(names: Sequence[str], sizes: Mapping[str, float]) -> Array:
    """(P,) deviations of unknowns by tilts of bearings that no data tell from them.

    Of a joint whose tilt about y has no coefficient, the gear of the joint before turns about the
    same axis. Its bearing is taken to be as soft as the others are in the median. sizes : root mean
    square of each tilt that was fitted, or left out.
    """
    tilts = {name: size for name, size in sizes.items() if name.startswith(TILT)}
    out = np.zeros(len(names))
    for name in tilts:
        joint = int(name.removeprefix(TILT)[:-1])
        before = f"{COMPLIANCE}{joint - 1}"
        if f"{TILT}{joint}y" not in tilts and before in names:
            out[names.index(before)] = np.median(list(tilts.values()))
    return out
