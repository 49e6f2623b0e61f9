"""Which parameters one recording can determine, and what becomes of the rest.

Some parameters move nothing, some only together (thesis sec. 3.2: ra6|bd3|ba5, rd1|oz|bd1, rd2|rd3,
rtheta1|ox,oy, ...). Selected are, in the order of thesis sec. 3.3, those whose column is not a
combination of the columns selected before: encoder offsets, ball-bar origin, robot, rod length, the
rest of the ball-bar. (The thesis reads the diagonal of "Q"; it is that of R.)

The dependencies are exact only on the nominal mechanism: a robot with 1 mrad of twist error
separates rd2 from rd3 by a thousandth. So they are judged there, on joint angles that close the
nominal loop along the measured path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import BAR_ROWS, Geometry, ParameterTable, bar_frames
from ballbar.cell.inverse import UnreachableError, refine_reachable
from ballbar.ident.estimator.closure import close_loop, closed_angles, parameter_jacobian
from ballbar.ident.estimator.dependencies import STRUCTURAL, orthogonalised
from ballbar.ident.estimator.model import Evaluation
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.whitening import covariance, whitening

# [m, rad] standard deviation above which the data say less than the largest error that a robot is
# expected to have (thesis sec. 5.4: 2 mm or mrad)
POORLY_EXCITED = 2e-3
INVOLVED = 0.02  # share (mm and mrad mixed) from which a parameter is named in a dependency
SAMPLES = 300  # of a recording that are looked at; the rank does not change beyond some tens


@dataclass(frozen=True, eq=False)
class DroppedParameter:
    """A parameter that was left out, and why."""

    name: str
    reason: str  # "no effect", "depends on" or "poorly excited"
    on: tuple[str, ...]  # the selected parameters it cannot be separated from


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The parameters to identify, and what was left out."""

    parameters: NDArray[np.intp]  # (P,) kept, indices into the table, in order of priority
    weak: NDArray[np.intp]  # (W,) poorly excited: they need a prior
    dropped: tuple[DroppedParameter, ...]
    rank: int  # directions the data determine, clock included
    condition: float  # of the kept whitened columns, scaled to unit length


def candidates(
    table: ParameterTable,
    encoders: tuple[int, ...],
    *,
    complete: bool = False,
    declared: Sequence[str] | None = None,
) -> NDArray[np.intp]:
    """Indices of the parameters worth identifying, in the order of thesis sec. 3.3.

    complete : also the rest of the ball-bar, its base tilt and the Hayati angles, which the thesis
    leaves out. declared : names that are never among them; default the offset plate, the known
    length that fixes the scale. Where it may be identified it comes last.
    """
    declared = (table.plate,) if declared is None else declared
    offsets = [f"btheta{joint}" for joint in encoders]
    robot = [name for name in table.robot if name != table.plate]
    names = [*offsets, "ox", "oy", "oz", *robot, "bd3", table.plate]
    if complete:
        bar = [f"b{kind}{row + 1}" for kind in ("a", "d", "alpha") for row in range(BAR_ROWS)]
        names += [*table.hayati, *(name for name in bar if name != "bd3"), "otx", "oty"]
    return np.array([table.index[name] for name in names if name not in declared])


def identifiable(
    point: Evaluation, excess: ExcessNoise, nominal: Geometry, requested: NDArray[np.intp]
) -> Identifiability:
    """The subset of the `requested` parameters (R,) that a recording determines.

    point : the recording at an estimate of where the mechanism was. nominal : catalogue geometry;
    encoder offsets and base position are taken from `point`. excess : noise beyond that of the
    logs. Raises UnreachableError when the nominal robot reaches none of the poses.
    """
    columns = _columns_on_nominal(point, excess, nominal, requested)
    clock = ["offset", "skew"] if point.recording.has_clock else []
    order = np.roll(np.arange(len(columns)), len(clock))
    names = [*clock, *(nominal.table.names[i] for i in requested)]
    selected, dropped = _selected(columns[order], names)
    unit = columns[order][selected]
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    values = np.linalg.svd(unit @ unit.T, compute_uv=False)
    parameters = requested[[k - len(clock) for k in selected if k >= len(clock)]]
    condition = float(np.sqrt(values[0] / values[-1]))
    poor = [nominal.table.index[d.name] for d in dropped if d.reason == "poorly excited"]
    weak = np.array(poor, dtype=np.intp)
    return Identifiability(parameters, weak, tuple(dropped), len(selected), condition)


def _columns_on_nominal(
    point: Evaluation, excess: ExcessNoise, nominal: Geometry, requested: NDArray[np.intp]
) -> Array:
    """(R [+ 2], M) whitened columns on the nominal mechanism, moving as the recording says."""
    samples, believed = point.recording, point.bar_closure.geometry
    taken = ("ox", "oy", "oz", *(f"btheta{j}" for j in range(1, 6)))
    geometry = nominal.replaced({name: believed[name] for name in taken})
    total = samples.times.size
    chosen = np.unique(np.linspace(0, total - 1, min(SAMPLES, total)).round().astype(int))
    ballbar, at = point.ballbar[chosen], point.robot_time[chosen]
    logged = np.asarray(samples.robot.spline(at))
    if geometry.table.joints < 6:  # the robot alone does not reach every pose of the ball-bar
        q, ballbar = closed_angles(geometry, logged, ballbar)
        closes = np.ones(chosen.size, dtype=bool)
    else:
        poses = bar_frames(geometry, ballbar).poses()
        q, closes = refine_reachable(geometry.robot, logged, poses)
    if not closes.any():
        raise UnreachableError(
            f"the nominal robot reaches none of the {closes.size} poses that the ball-bar's angles "
            "tell. Check that both logs are of one run, and that robot and ball-bar are the "
            "declared ones."
        )
    chosen, ballbar, at = chosen[closes], ballbar[closes], at[closes]
    nominally = replace(
        point,
        samples=replace(samples, times=samples.times[chosen]),
        closure=close_loop(geometry, q, ballbar),
        ballbar=ballbar,
        robot_time=at,
    )
    weights = whitening(covariance(nominally.noise_columns(excess)), nominally.unmeasured_columns)
    columns = parameter_jacobian(
        nominally.closure, [nominal.table.parameters[i] for i in requested]
    )
    if samples.has_clock:
        offset = nominally.time_column
        skew = offset * nominally.recording.times
        columns = np.concatenate((columns, offset[None], skew[None]))
    share = np.sqrt(total / chosen.size)  # as if all samples had been looked at
    return np.asarray(share * weights(columns).reshape(len(columns), -1))


def _selected(columns: Array, names: list[str]) -> tuple[list[int], list[DroppedParameter]]:
    """Gram-Schmidt in the given order over columns (R, M); what leaves no remainder is dropped."""
    lengths = np.linalg.norm(columns, axis=1)
    moving = lengths >= STRUCTURAL * np.median(lengths)

    def determined(k: int, remainder: float) -> bool:
        enough = names[k] in ("offset", "skew") or remainder * lengths[k] * POORLY_EXCITED >= 1.0
        return remainder >= STRUCTURAL and enough

    walk = orthogonalised(columns, [int(k) for k in np.flatnonzero(moving)], determined)
    dropped = []
    for k in (k for k in range(len(names)) if k not in walk.selected):
        if not moving[k]:
            dropped.append(DroppedParameter(names[k], "no effect", ()))
            continue
        reason = "depends on" if walk.remainders[k] < STRUCTURAL else "poorly excited"
        partners = _partners(columns, walk.before(k), k, names)
        dropped.append(DroppedParameter(names[k], reason, partners))
    return walk.selected, dropped


def _partners(columns: Array, before: list[int], k: int, names: list[str]) -> tuple[str, ...]:
    """Names of the columns selected before k that make up its combination, largest share first."""
    if not before:
        return ()
    shares = np.linalg.lstsq(columns[before].T, columns[k], rcond=None)[0]
    order = np.argsort(-np.abs(shares))
    return tuple(names[before[i]] for i in order if abs(shares[i]) > INVOLVED)
