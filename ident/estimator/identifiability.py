"""Which parameters one recording can determine, and what becomes of the rest.

Some parameters move nothing, some only together (thesis sec. 3.2: ra6|bd3|ba5, rd1|oz|bd1, rd2|rd3, rtheta1|ox,oy, ...).
Kept are, in the order of thesis sec. 3.3, those whose column is not a combination of the columns kept before: encoder zeros,
ball-bar origin, robot, rod length, the rest of the ball-bar. (The thesis reads the diagonal of "Q"; it is that of R.)

The dependencies are exact only on the nominal mechanism: a robot with 1 mrad of twist error tells rd2 from rd3 by a
thousandth. So they are judged there, on joint angles that close the nominal loop along the measured path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array, Chain
from cell.geometry import BAR_ROWS, INDEX, NAMES, PARAMETERS, ROBOT_ROWS, Geometry, bar_frames
from cell.inverse import UnreachableError, refine
from ident.estimator.closure import (
    bar_joint_jacobian,
    close_loop,
    covariance,
    parameter_jacobian,
    robot_joint_jacobian,
    whitening,
)
from ident.estimator.dependencies import remainder_of
from ident.estimator.problem import Estimate, Problem

DEPENDENT = 1e-6  # relative length of a column's remainder below which it counts as a combination; structural ones give 1e-12
POORLY_EXCITED = 2e-3  # [m, rad] standard deviation above which the data say less than `max_plausible` of the robot does
INVOLVED = 0.02  # coefficient (mm and mrad mixed) from which a parameter is named in a dependency
SAMPLES = 300


@dataclass(frozen=True, eq=False)
class Dependency:
    """A parameter that was left out, and why."""

    name: str
    reason: str  # "no effect", "depends on" or "poorly excited"
    on: tuple[str, ...]  # the kept parameters it cannot be told from


@dataclass(frozen=True, eq=False)
class Identifiability:
    """The parameters to identify, and what was left out."""

    parameters: NDArray[np.intp]  # (P,) kept, indices into PARAMETERS, in order of priority
    dropped: tuple[Dependency, ...]
    rank: int  # directions the data determine, clock included
    condition: float  # of the kept whitened columns, scaled to unit length


def candidates(joints: tuple[int, ...], *, complete: bool = False) -> NDArray[np.intp]:
    """Indices of the parameters worth asking for, in the order of thesis sec. 3.3.

    `ra6` is never among them: the offset plate is the known length that fixes the scale. `complete` adds the rest of the
    ball-bar, its base tilt and the Hayati angles to the thesis's choice.
    """
    zeros = [f"btheta{j}" for j in joints]
    robot = [
        f"r{kind}{row + 1}" for kind in ("a", "d", "alpha", "theta") for row in range(ROBOT_ROWS)
    ]
    names = [*zeros, "ox", "oy", "oz", *robot, "bd3"]
    if complete:
        bar = [f"b{kind}{row + 1}" for kind in ("a", "d", "alpha") for row in range(BAR_ROWS)]
        names += ["rbeta2", "rbeta6", *(name for name in bar if name != "bd3"), "otx", "oty"]
    return np.array([INDEX[name] for name in names if name != "ra6"])


def identifiable(
    problem: Problem, estimate: Estimate, nominal: Geometry, asked: NDArray[np.intp]
) -> Identifiability:
    """The subset of `asked` that the recording determines.

    nominal : catalogue geometry; zeros and origin are taken from `estimate`, which says where the mechanism was.
    """
    columns = _columns_on_nominal(problem, estimate, nominal, asked)
    clock = 2 if problem.has_clock else 0
    order = np.concatenate(
        (np.arange(columns.shape[0] - clock, columns.shape[0]), np.arange(columns.shape[0] - clock))
    )
    kept, dropped = _greedy(
        columns[order], [*(["offset", "skew"][:clock]), *(NAMES[i] for i in asked)]
    )
    unit = columns[order][kept]
    unit = unit / np.linalg.norm(unit, axis=1, keepdims=True)
    values = np.linalg.svd(unit @ unit.T, compute_uv=False)
    chosen = asked[[k - clock for k in kept if k >= clock]]
    return Identifiability(
        chosen, tuple(dropped), len(kept), float(np.sqrt(values[0] / values[-1]))
    )


def _columns_on_nominal(
    problem: Problem, estimate: Estimate, nominal: Geometry, asked: NDArray[np.intp]
) -> Array:
    """(P [+ 2], M) whitened columns on the nominal mechanism, which moves as the recording says."""
    keep = {
        name: estimate.geometry[name]
        for name in ("ox", "oy", "oz", *(f"btheta{j}" for j in range(1, 6)))
    }
    geometry = nominal.replaced(keep)
    some = np.unique(
        np.linspace(0, problem.times.size - 1, min(SAMPLES, problem.times.size)).round().astype(int)
    )
    bar, logged = estimate.bar[some], problem.robot_angles(estimate.clock)[some]
    q, closes = _closed_on(geometry.robot, logged, bar_frames(geometry, bar).poses())
    some, bar = some[closes], bar[closes]
    closure = close_loop(geometry, q, bar)
    noise = problem.noise
    weights = whitening(
        covariance(closure, noise.joint, noise.encoder, noise.rod),
        bar_joint_jacobian(closure)[problem.free_joints],
    )
    columns = parameter_jacobian(closure, [PARAMETERS[i] for i in asked])
    if problem.has_clock:
        offset = np.einsum(
            "jcn,nj->cn", robot_joint_jacobian(closure), problem.robot_speeds(estimate.clock)[some]
        )
        columns = np.concatenate((columns, offset[None], (offset * problem.times[some])[None]))
    share = np.sqrt(problem.times.size / some.size)  # as if all samples had been looked at
    return np.asarray(share * weights(columns).reshape(columns.shape[0], -1))


def _closed_on(robot: Chain, q: Array, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
    try:
        return refine(robot, q, poses), np.ones(len(q), dtype=bool)
    except UnreachableError:
        found = np.zeros(len(q), dtype=bool)
        closed = []
        for k in range(len(q)):
            try:
                closed.append(refine(robot, q[k : k + 1], poses[k : k + 1])[0])
                found[k] = True
            except UnreachableError:
                continue
        return np.array(closed).reshape(-1, 6), found


def _greedy(columns: Array, names: list[str]) -> tuple[list[int], list[Dependency]]:
    """Gram-Schmidt in the given order; what leaves no remainder is dropped."""
    lengths = np.linalg.norm(columns, axis=1)
    typical = float(np.median(lengths))
    basis = np.zeros((0, columns.shape[1]))
    kept: list[int] = []
    dropped: list[Dependency] = []
    for k, column in enumerate(columns):
        if lengths[k] < DEPENDENT * typical:
            dropped.append(Dependency(names[k], "no effect", ()))
            continue
        rest = remainder_of(column / lengths[k], basis)
        remainder = float(np.linalg.norm(rest))
        if remainder < DEPENDENT:
            dropped.append(Dependency(names[k], "depends on", _involved(columns, kept, k, names)))
        elif names[k] not in ("offset", "skew") and 1.0 / (remainder * lengths[k]) > POORLY_EXCITED:
            dropped.append(
                Dependency(names[k], "poorly excited", _involved(columns, kept, k, names))
            )
        else:
            basis = np.vstack((basis, rest / remainder))
            kept.append(k)
    return kept, dropped


def _involved(columns: Array, kept: list[int], k: int, names: list[str]) -> tuple[str, ...]:
    if not kept:
        return ()
    shares = np.linalg.lstsq(columns[kept].T, columns[k], rcond=None)[0]
    order = np.argsort(-np.abs(shares))
    return tuple(names[kept[i]] for i in order if abs(shares[i]) > INVOLVED)
