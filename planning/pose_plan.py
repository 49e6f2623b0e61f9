"""A plan of still poses: candidates, selection, order, and the prediction against random poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from planning.feasible_poses import Candidates, random_candidates
from planning.pose_design import Design, exchanged, greedy, refined
from planning.pose_information import Information, information_of
from planning.route import Route, route_of
from planning.stations import PoseSetup

RANDOM_SETS = 10  # of as many candidates, with which the plan is compared


@dataclass(frozen=True, eq=False)
class PosePlan:
    """Poses in their order, and what they are predicted to determine."""

    setup: PoseSetup
    information: Information
    route: Route
    rows: Array  # (n, E, P) whitened rows of the poses
    sigma: Array  # (G,) [m] predicted TCP error over the workspace
    random: Array  # (RANDOM_SETS,) [m] its mean for random poses, as many and as feasible
    seconds: float  # that the search took

    @property
    def poses(self) -> Candidates:
        """The poses in the order of their measurement."""
        return self.route.poses

    @property
    def gain(self) -> float:
        """Predicted TCP error of the median random set over that of the plan."""
        return float(np.median(self.random) / self.sigma.mean())

    @property
    def narrow(self) -> tuple[int, ...]:
        """Axes, from 1, whose workspace is not within the range of the poses."""
        grid = self.information.grid @ self.setup.robot.joint_to_axis
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
        float(information.tcp_sigma(rows[rng.permutation(candidates.size)[:count]]).mean())
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
    rows = information.rows(route.poses)
    return PosePlan(
        setup=setup,
        information=information,
        route=route,
        rows=rows,
        sigma=information.tcp_sigma(rows),
        random=np.array(random),
        seconds=since(),
    )
