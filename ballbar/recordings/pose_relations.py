"""Whether two files of still poses share their seat and their target, by what they show.

Four hypotheses are fitted (`pair_of_files`): one seat or two, one target or two. Those that leave
little more than two seats and two targets do are possible, and the simplest of them is taken.
Files with equal joint angles are compared to tenths of a millimetre, others to the millimetres of
the catalogue robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from acquisition.faults.nominal_robot import judged
from ballbar.recordings.pair_of_files import FilePair, Hypothesis, MeasuredFile, PairFit
from ballbar.units import MM
from cell.arrays import Array
from ident.moved_seats import LARGEST
from ident.start.placements import PoseStartError

_FEWEST = 10  # poses: fewer fit many seats and targets
_FEWEST_LENGTHS = 20  # of one equation each instead of three
_JUDGED = 100  # poses of a file; more show nothing new
# [rad] between joint angles of one pose in two files: angles rounded to 0.1 deg, and repeatability.
_EQUAL = 1.0e-3
# Times the misfit with two seats and two targets. Of 746 pairs of files of drawn robots (points; 10
# to 100 poses; 0.5 to 2 mrad, 0.3 to 1 mm) 739 were seen right, 6 not at all, none as less than it
# was.
_MORE = 1.5
_HOPELESS = 5.0  # times the tolerance, with two seats and two targets: another robot or columns
_APART = 1.0  # [m] no two targets on one flange are further apart

_SAME: Hypothesis = (True, True)
_TARGET: Hypothesis = (True, False)
_SEAT: Hypothesis = (False, True)
_OTHERS: Hypothesis = (False, False)


@dataclass(frozen=True)
class Relation:
    """What two files share."""

    shared: tuple[bool | None, bool | None]  # seat, target; None where they do not show it
    reason: str  # about the second file


def relation(
    a: MeasuredFile, b: MeasuredFile, known: tuple[bool | None, bool | None] = (None, None)
) -> Relation:
    """What two files share.

    known : whether they share the seat, and the target, as far as that is known.
    """
    fewest = _FEWEST_LENGTHS if a.group.measured == "length" else _FEWEST
    if min(a.group.size, b.group.size) < fewest:
        return Relation(known, f"it or {a.name} has fewer than {fewest} poses")
    hypotheses = [
        each
        for each in (_SAME, _TARGET, _SEAT, _OTHERS)
        if all(k in (None, shared) for k, shared in zip(known, each, strict=True))
    ]
    pairs = _equal_angles(a.group.q, b.group.q)
    paired = len(pairs[0]) >= _FEWEST
    every = (judged(a.group.size, _JUDGED), judged(b.group.size, _JUDGED))
    pair = FilePair(a, b, pairs if paired else every, paired)
    try:
        if paired and a.group.measured == "length":
            # Errors of the robot do not cancel in lengths from two seats, or to two targets.
            again = pair.fit(_SAME)
            if _SAME in hypotheses and again.misfit <= pair.tolerance:
                return Relation(_SAME, _reason(pair, _SAME, again))
            pair = FilePair(a, b, every, paired=False)
            hypotheses = [each for each in hypotheses if each != _SAME]
        free = pair.fit(_OTHERS)
        if free.misfit > _HOPELESS * pair.tolerance:
            left = _length(free.misfit)
            return Relation(known, f"beside {a.name} it fits the catalogue robot to {left} at best")
        possible = _possible(pair, hypotheses, free)
    except PoseStartError:
        return Relation(known, f"it or {a.name} does not fit the catalogue robot")
    match list(possible):
        case [hypothesis]:
            reason = _reason(pair, hypothesis, possible[hypothesis])
            if hypothesis == _SAME and possible[hypothesis].misfit > LARGEST:
                return Relation(known, f"{reason}: too little to tell")
            return Relation(hypothesis, reason)
        case []:
            given = "seat" if known[0] else "target"
            return Relation(known, f"it and {a.name} do not fit the one {given} that is given")
    reason = f"another seat than that of {a.name} explains it, and so does another target"
    return Relation((None, None), reason)


def _possible(
    pair: FilePair, hypotheses: Sequence[Hypothesis], free: PairFit
) -> dict[Hypothesis, PairFit]:
    """The simplest hypothesis that fits; two if none is simpler and none fits far better.

    free : the fit with two seats and two targets.
    """
    limit = max(pair.tolerance, _MORE * free.misfit)
    fits = {each: pair.fit(each) for each in hypotheses if each != _OTHERS}
    fits = {h: fit for h, fit in fits.items() if fit.misfit <= limit and fit.apart <= _APART}
    if _SAME in fits:
        return {_SAME: fits[_SAME]}
    if len(fits) == 2:
        least = 0.1 * pair.tolerance  # below which one is as good as the other
        target, seat = (max(fits[each].misfit, least) for each in (_TARGET, _SEAT))
        if target * _MORE <= seat:
            del fits[_SEAT]
        elif seat * _MORE <= target:
            del fits[_TARGET]
    return fits or ({_OTHERS: free} if _OTHERS in hypotheses else {})


def _equal_angles(a: Array, b: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of a (N, J) and b (M, J) [rad] with equal joint angles, _JUDGED pairs at most."""
    distance, index = cKDTree(a).query(b, p=np.inf)
    nearest = np.asarray(index, dtype=np.intp)  # (M,)
    rows = np.flatnonzero(distance <= _EQUAL)
    rows = rows[np.unique(nearest[rows], return_index=True)[1]]
    rows = rows[judged(rows.size, _JUDGED)] if rows.size else rows
    return nearest[rows], rows


def _reason(pair: FilePair, hypothesis: Hypothesis, fit: PairFit) -> str:
    """What two files show of the hypothesis that fits."""
    a, left = pair.a.name, f"{max(fit.misfit * MM, 0.01):.2g} mm"
    apart = _length(fit.apart)
    moved = _length(fit.moved)
    if pair.a.group.measured != "length":
        moved += f" and {fit.turned:.1f} deg"
    if pair.paired:
        at = "at equal joint angles its"
        return {
            _SAME: f"{at} values are those of {a} within {left}: one seat and one target",
            _TARGET: f"{at} points are {apart} beside those of {a} and turn with the flange: "
            "another target",
            _SEAT: f"{at} points are those of {a}, moved by {moved} as a whole: another seat",
            _OTHERS: f"{at} points are neither those of {a} moved as a whole, nor points beside "
            "them on the flange: another seat and another target",
        }[hypothesis]
    both = f"fit it and {a} to {left} by the catalogue robot"
    return {
        _SAME: f"one seat and one target {both}",
        _TARGET: f"one seat and two targets, {apart} apart, {both}: another target",
        _SEAT: f"two seats, {moved} apart, and one target {both}: another seat",
        _OTHERS: f"only two seats and two targets {both}: another seat and another target",
    }[hypothesis]


def _length(metres: float) -> str:
    """A length for the reader."""
    return f"{metres:.3g} m" if metres >= 1.0 else f"{metres * MM:.3g} mm"
