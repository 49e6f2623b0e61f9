"""A plan of still poses: candidates, selection, order, and the prediction against random poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.planning.crlb import PredictedInformation
from ballbar.planning.feasible_poses import Candidates, Screen, feasible, joined, random_candidates
from ballbar.planning.pose_information import Information, information_of
from ballbar.planning.route import Route, route_of
from ballbar.planning.stations import PoseSetup

APART = np.radians(10.0)  # [rad] of at least one axis, between any two poses
SWEEPS = 1  # of exchanges; further ones gain less than the refinement of the angles
NEIGHBOURS = 24  # of each pose in a round
ROUNDS = 20
FIRST, LAST = 0.5, 0.03  # [rad] standard deviation of the changes


@dataclass(frozen=True, eq=False)
class Design:
    """A problem of selection: K candidates."""

    axes: Array  # (K, J) [rad]
    rows: Array  # (K, E, P) whitened
    prior: Array  # (P, P)
    root: Array  # (P, P) [m]

    def normal(self, selected: NDArray[np.intp]) -> Array:
        """(P, P) information of selected poses and prior."""
        flat = self.rows[selected].reshape(-1, self.rows.shape[2])
        return self.prior + flat.T @ flat

    def objective(self, selected: NDArray[np.intp]) -> float:
        """[m^2] mean square TCP error after the selected poses."""
        return float(np.trace(self.root.T @ inverse(self.normal(selected)) @ self.root))


def decrease(rows: Array, covariance: Array, root: Array, sign: float = 1.0) -> Array:
    """(K,) [m^2] decrease of the objective by each pose added; with sign -1, increase if removed.

    rows : (K, E, P). covariance : (P, P) without, or for a removal with, the pose. root : (P, P).
    """
    k, e, p = rows.shape
    half = (rows.reshape(-1, p) @ covariance).reshape(k, e, p)
    inner = np.eye(e) + sign * half @ rows.transpose(0, 2, 1)
    outer = (half.reshape(-1, p) @ root).reshape(k, e, -1)
    square = outer @ outer.transpose(0, 2, 1)
    return np.asarray(np.trace(np.linalg.solve(inner, square), axis1=1, axis2=2))


def _apart(axes: Array, selected: Array) -> NDArray[np.bool_]:
    """(K,) whether axis angles (K, J) are far enough from all selected ones (S, J) [rad]."""
    apart = np.ones(len(axes), dtype=bool)
    for angles in selected:
        apart &= np.abs(axes - angles).max(axis=1) >= APART
    return apart


def greedy(design: Design, count: int) -> NDArray[np.intp]:
    """(count,) candidates, each the one that raises the determinant most."""
    selected = np.zeros(0, dtype=np.intp)
    allowed = np.ones(len(design.axes), dtype=bool)
    while selected.size < count and allowed.any():
        covariance = inverse(design.normal(selected))
        spread = design.rows @ covariance @ design.rows.transpose(0, 2, 1)
        gain = np.linalg.slogdet(np.eye(spread.shape[1]) + spread)[1]
        best = int(np.where(allowed, gain, -np.inf).argmax())
        selected = np.append(selected, best)
        allowed &= _apart(design.axes, design.axes[best : best + 1])
    return selected


def exchanged(
    design: Design, selected: NDArray[np.intp], going: Callable[[], bool] = lambda: True
) -> NDArray[np.intp]:
    """The selected poses, each in turn exchanged for the candidate that gains most.

    going : called before every exchange; whether to go on.
    """
    selected = selected.copy()
    for _ in range(SWEEPS):
        covariance = inverse(design.normal(selected))
        loss = decrease(design.rows[selected], covariance, design.root, -1.0)
        for place in np.argsort(loss):  # first what is missed least
            if not going():
                return selected
            others = np.delete(selected, place)
            gain = decrease(design.rows, inverse(design.normal(others)), design.root)
            allowed = _apart(design.axes, design.axes[others])
            selected[place] = int(np.where(allowed, gain, -np.inf).argmax())
    return selected


def refined(
    information: Information,
    poses: Candidates,
    rng: np.random.Generator,
    going: Callable[[], bool] = lambda: True,
) -> Candidates:
    """The poses with their angles improved; going : called before every round; whether to go on."""
    axes, rows = poses.axes.copy(), information.rows(poses)
    for scale in np.geomspace(FIRST, LAST, ROUNDS):
        if not going():
            break
        drawn, owner = _neighbours(information, Candidates(axes, poses.station), scale, rng)
        if not drawn.size:
            continue
        drawn_rows = information.rows(drawn)
        for place in range(poses.size):
            mine = np.flatnonzero(owner == place)
            if not mine.size:
                continue
            others = np.arange(poses.size) != place
            flat = rows[others].reshape(-1, rows.shape[2])
            covariance = inverse(information.prior + flat.T @ flat)
            tried = np.concatenate((rows[place][None], drawn_rows[mine]))
            gain = decrease(tried, covariance, information.root)
            gain[1:][~_apart(drawn.axes[mine], axes[others])] = -np.inf
            if best := int(gain.argmax()):
                axes[place], rows[place] = drawn.axes[mine[best - 1]], tried[best]
    return Candidates(axes, poses.station)


def _neighbours(
    information: Information, poses: Candidates, scale: float, rng: np.random.Generator
) -> tuple[Candidates, NDArray[np.intp]]:
    """Feasible poses near those selected, and of which of them each is a neighbour."""
    setup, parts, owners = information.setup, list[Candidates](), list[NDArray[np.intp]]()
    for k in np.unique(poses.station):
        owner = np.repeat(np.flatnonzero(poses.station == k), NEIGHBOURS)
        changed = poses.axes[owner] + scale * rng.standard_normal((owner.size, setup.robot.joints))
        changed = np.clip(changed, setup.lower, setup.upper)
        axes, source = feasible(setup, int(k), changed, rng, Screen())
        parts.append(Candidates(axes, np.full(len(axes), k, dtype=np.intp)))
        owners.append(owner[source])
    return joined(parts), np.concatenate(owners)


RANDOM_SETS = 10  # of as many candidates, with which the plan is compared


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses in their order, and what they are predicted to determine."""

    setup: PoseSetup
    information: Information
    route: Route
    prediction: PredictedInformation  # by the poses, over the workspace
    random: Array  # (RANDOM_SETS,) [m] its mean for random poses, as many and as feasible
    seconds: float  # that the search took

    @property
    def poses(self) -> Candidates:
        """The poses in the order of their measurement."""
        return self.route.poses

    @property
    def gain(self) -> float:
        """Predicted TCP error of the median random set over that of the plan."""
        return float(np.median(self.random) / self.prediction.tcp_sigma.mean())

    @property
    def narrow(self) -> tuple[int, ...]:
        """Axes, from 1, whose workspace is not within the range of the poses."""
        grid = self.setup.grid @ self.setup.robot.joint_to_axis
        grid = grid - self.setup.robot.controller_offset @ self.setup.robot.joint_to_axis
        low, high = self.poses.axes.min(axis=0), self.poses.axes.max(axis=0)
        outside = (grid.min(axis=0) < low) | (grid.max(axis=0) > high)
        return tuple(int(axis) + 1 for axis in np.flatnonzero(outside))


def pose_plan(
    setup: PoseSetup,
    *,
    seconds: float,
    since: Callable[[], float],
    show: Callable[[str], None] = lambda _: None,
) -> PosePlan:
    """The poses that determine the robot best.

    seconds : after which the selection is not improved further; since : seconds since it began.
    Raises InputError where too few poses are feasible.
    """
    rng = np.random.default_rng(setup.request.seed)
    show("drawing feasible poses ...")
    candidates = random_candidates(setup, setup.request.candidates, rng)
    information, count = information_of(setup), setup.request.poses
    rows = information.rows(candidates)
    random = [
        float(
            information.prediction(rows[rng.permutation(candidates.size)[:count]]).tcp_sigma.mean()
        )
        for _ in range(RANDOM_SETS)
    ]
    design = Design(candidates.axes, rows, information.prior, information.root)

    def going() -> bool:
        return since() < seconds

    show("selecting poses ...")
    selected = exchanged(design, greedy(design, count), going)
    show("refining their angles ...")
    poses = refined(information, candidates.part(selected), rng, going)
    show("ordering them ...")
    route = route_of(setup, poses, rng)
    return PosePlan(
        setup=setup,
        information=information,
        route=route,
        prediction=information.prediction(information.rows(route.poses)),
        random=np.array(random),
        seconds=since(),
    )
