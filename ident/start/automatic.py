"""Automatic start: from two logs to starting values, without a guess.

Unknown are the encoder zeros (over the full turn), the directions of rotation, the configuration of the ball-bar, its position
and the clock offset, whatever its size. The nominal robot gives the sphere on which the tool moves (ident.start.sphere); two
encoders of a gimbal against the rod direction give offset, sign and zeros in one scan of all lags (ident.start.lag_scan). Several
lags and branches are kept as hypotheses to the end, each is fitted, and what the fits explain decides: a first peak, or a
first small residual, can be an alias of the motion. Algorithm and traps: notes/start (measured on 500 draws).

The directions of b2 and b4 cannot be seen (they are one gauge with the configuration) and stay as declared; those of b1, b3 and
b5 can, and a disagreement with the declared ones is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from cell.chain import Array
from cell.errors import FailureError
from cell.geometry import INDEX, Geometry, robot_frames
from cell.inverse import bar_roll
from ident.estimator.iteration import IterationCallback
from ident.estimator.problem import Clock, NoiseModel, Problem
from ident.estimator.sampling import overlap, sample_times
from ident.estimator.solver import Fit, Prior, solve
from ident.signals.smooth_log import SmoothLog
from ident.start.lag_scan import Branch, Pair, PairScan, best_lags, scan_lags, subsample
from ident.start.sphere import Sphere, sphere_candidates

SCAN_STEP = 0.02  # [s]
SPHERE_STEP = 0.1  # [s]
LAGS_KEPT = 5
LAG_SEPARATION = 2.0  # [s] nearer maxima belong to one peak
SAMPLES = 400
HYPOTHESES = 8
ITERATIONS = 15  # a wrong hypothesis crawls; the right one needs 3 to 7
GEOMETRY_SIGMA = 5e-3  # [m, rad] a gauge weight, not a belief: unobservable directions stay where linearisation holds
GAUGE = (
    "ra6",
    "rd1",
    "rd3",
    "rtheta1",
)  # known scale, and what the ball-bar's base and rd2 can take up; left free they wander
ROLL_CLOSE = (
    0.9  # a sign of b3 whose mean resultant is within this factor of the better one is kept too
)
SCORE_KEPT = 0.5  # of the best score
ACCEPT_FACTOR, ACCEPT_MARGIN = (
    2.0,
    0.5,
)  # cost per residual: at most factor times the least plus margin
SAME_OFFSET = 0.05  # [s] two accepted solutions further apart are two answers
SAME_ORIGIN = 0.05  # [m]
SAME_OVERLAP, SAME_COST = (
    0.98,
    1.2,
)  # within these factors candidates are as good as each other; the better score goes first
RIVAL_OVERLAP = 0.7  # of the chosen one's


class StartError(FailureError):
    """No starting point could be found, and why."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way to read the two logs."""

    clock: Clock
    signs: tuple[int, ...]  # (E,) per fitted encoder, relative to the declared sense
    geometry: Geometry  # nominal, with origin and encoder zeros of this hypothesis
    score: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted hypothesis."""

    hypothesis: Hypothesis
    fit: Fit
    overlap: float  # [s]

    @property
    def cost(self) -> float:
        """Cost per residual, prior included: a covariance that depends on the parameters can be gamed otherwise."""
        return self.fit.cost / max(1, self.fit.dof)


@dataclass(frozen=True, eq=False)
class Start:
    """The chosen starting point, and the rivals that the logs cannot exclude."""

    chosen: Candidate
    rivals: tuple[Candidate, ...]
    tried: int

    @property
    def ambiguous(self) -> bool:
        return bool(self.rivals)


def automatic_start(
    robot: SmoothLog,
    bar: SmoothLog | None,
    joints: tuple[int, ...],
    nominal: Geometry,
    noise: NoiseModel,
) -> Start:
    """Starting values for a recording.

    nominal : catalogue geometry; its origin and encoder zeros are ignored.

    Raises StartError when the logs share no motion or hold no complete pair of encoders.
    """
    pairs = [pair for pair in ((1, 2), (5, 4)) if set(pair) <= set(joints)]
    if joints and not pairs:
        raise StartError(
            f"encoders {joints} hold no complete gimbal: b1 with b2, or b4 with b5, is needed to align the logs"
        )
    if {1, 2, 4, 5} & set(joints) != {j for pair in pairs for j in pair}:
        raise StartError(
            f"encoders {joints}: half a gimbal is fitted; use b1 with b2 and b4 with b5, or leave the odd one out"
        )
    candidates = []
    for hypothesis in islice(_hypotheses(robot, bar, joints, nominal), HYPOTHESES):
        candidate = fitted(hypothesis, robot, bar, joints, noise)
        if candidate is not None:
            candidates.append(candidate)
    if not candidates:
        raise StartError(
            "no clock offset makes the two logs agree anywhere; are both of the same run, and is the robot the right one?"
        )
    return _choice(candidates)


def _hypotheses(
    robot: SmoothLog, bar: SmoothLog | None, joints: tuple[int, ...], nominal: Geometry
) -> Iterator[Hypothesis]:
    poses = _poses(robot, nominal, SPHERE_STEP)
    try:
        spheres = sphere_candidates(poses[:, :3, 3], nominal["bd3"])
    except ValueError as error:
        raise StartError(str(error)) from None
    if bar is None:
        for sphere in spheres:
            yield Hypothesis(Clock(0.0, 0.0), (), _with_base(nominal, sphere, {}), -sphere.cost)
        return
    found = [h for sphere in spheres for h in _aligned(robot, bar, joints, nominal, sphere)]
    best = max((h.score for h in found), default=0.0)
    yield from sorted((h for h in found if h.score >= SCORE_KEPT * best), key=lambda h: -h.score)


def _aligned(
    robot: SmoothLog, bar: SmoothLog, joints: tuple[int, ...], nominal: Geometry, sphere: Sphere
) -> Iterator[Hypothesis]:
    poses = _poses(robot, nominal, SCAN_STEP)
    rotation, tip = poses[:, :3, :3], poses[:, :3, 3]
    rod = tip - sphere.centre
    u = rod / np.linalg.norm(rod, axis=1, keepdims=True)
    v = np.einsum("nij,ni->nj", rotation, u)
    readings = np.asarray(bar.spline(_grid(bar, SCAN_STEP)))
    column = {joint: readings[:, k] for k, joint in enumerate(joints)}
    pairs: dict[tuple[int, int], PairScan] = {}
    if {1, 2} <= set(joints):
        pairs[1, 2] = PairScan(Pair(column[1], column[2], u), SCAN_STEP)
    if {4, 5} <= set(joints):
        pairs[5, 4] = PairScan(
            Pair(column[5], column[4], v * np.array([-1.0, 1.0, 1.0])), SCAN_STEP
        )
    scan = scan_lags(list(pairs.values()))
    for index in best_lags(scan, count=LAGS_KEPT, separation=round(LAG_SEPARATION / SCAN_STEP)):
        offset = subsample(scan, index) * SCAN_STEP + robot.start - bar.start
        for branches in product(*(pair.branches(index) for pair in pairs.values())):
            read: dict[int, tuple[int, float]] = {}
            for (turning, tilting), branch in zip(pairs, branches, strict=True):
                read |= _readings(turning, tilting, branch)
            for full in _with_roll(read, joints, column, rotation, int(scan.lags[index])):
                signs = tuple(full[j][0] for j in joints)
                zeros = {f"btheta{j}": full[j][1] for j in joints}
                yield Hypothesis(
                    Clock(offset, 0.0),
                    signs,
                    _with_base(nominal, sphere, zeros),
                    float(scan.score[index]),
                )


def _readings(turning: int, tilting: int, branch: Branch) -> dict[int, tuple[int, float]]:
    return {turning: (branch.sign, branch.turning_zero), tilting: (1, branch.tilting_zero)}


def _with_roll(
    read: dict[int, tuple[int, float]],
    joints: tuple[int, ...],
    column: dict[int, Array],
    rotation: Array,
    lag: int,
) -> Iterator[dict[int, tuple[int, float]]]:
    """The readings with that of b3 added: its zero, and its sign where one explains the roll clearly better."""
    if 3 not in joints:
        yield read
        return
    if not {1, 2, 4, 5} <= set(read):
        raise StartError(
            "encoder b3 needs b1, b2, b4 and b5 beside it: its zero is read off against the other four"
        )
    n = column[3].size
    first, last = max(0, -lag), min(n, rotation.shape[0] - lag)
    angle = {j: s * column[j][first:last] + z for j, (s, z) in read.items()}
    roll = bar_roll(rotation[first + lag : last + lag], angle[1], angle[2], angle[4], angle[5])
    means = {
        sign: complex(np.exp(1j * (roll - sign * column[3][first:last])).mean()) for sign in (1, -1)
    }
    longest = max(abs(mean) for mean in means.values())
    for sign, mean in means.items():
        if abs(mean) >= ROLL_CLOSE * longest:
            yield read | {3: (sign, float(np.angle(mean)))}


def fitted(
    hypothesis: Hypothesis,
    robot: SmoothLog,
    bar: SmoothLog | None,
    joints: tuple[int, ...],
    noise: NoiseModel,
    on_iteration: IterationCallback | None = None,
) -> Candidate | None:
    """A hypothesis after a fit of a few samples; None where it leads nowhere."""
    try:
        times = sample_times(robot, bar, hypothesis.clock, SAMPLES)
    except ValueError:
        return None
    problem = Problem(robot, bar, joints, np.array(hypothesis.signs, dtype=float), times, noise)
    parameters, sigma = start_parameters(joints)
    prior = Prior(hypothesis.geometry.values[parameters], sigma)
    start = problem.start(hypothesis.geometry, hypothesis.clock)
    try:
        fit = solve(
            problem,
            start,
            parameters,
            prior=prior,
            negligible=1e-2,
            max_iterations=ITERATIONS,
            on_iteration=on_iteration,
        )
    except np.linalg.LinAlgError:  # a wrong hypothesis may run into a pose where nothing can be solved; it is then no candidate
        return None
    first, last = overlap(robot, bar, fit.estimate.clock)
    return Candidate(hypothesis, fit, last - first)


def start_parameters(joints: tuple[int, ...]) -> tuple[NDArray[np.intp], Array]:
    """Geometry that is free while hypotheses compete, and its prior sigma (origin and encoder zeros have none)."""
    zeros = [f"btheta{j}" for j in joints]
    robot = [f"r{kind}{row}" for kind in ("a", "d", "alpha", "theta") for row in range(1, 7)]
    names = [*zeros, "ox", "oy", "oz", *(name for name in robot if name not in GAUGE), "bd3"]
    sigma = np.full(len(names), GEOMETRY_SIGMA)
    sigma[: len(zeros) + 3] = np.inf
    return np.array([INDEX[name] for name in names]), sigma


def _choice(candidates: list[Candidate]) -> Start:
    least = min(candidate.cost for candidate in candidates)
    accepted = [c for c in candidates if c.cost <= ACCEPT_FACTOR * least + ACCEPT_MARGIN]
    longest = [c for c in accepted if c.overlap >= SAME_OVERLAP * max(a.overlap for a in accepted)]
    chosen = next(
        c for c in longest if c.cost <= SAME_COST * min(a.cost for a in longest)
    )  # candidates come best score first
    rivals = tuple(
        c
        for c in accepted
        if c is not chosen and _differs(c, chosen) and c.overlap > RIVAL_OVERLAP * chosen.overlap
    )
    return Start(chosen, rivals, len(candidates))


def _differs(one: Candidate, other: Candidate) -> bool:
    a, b = one.fit.estimate, other.fit.estimate
    apart = float(np.linalg.norm(a.geometry.origin - b.geometry.origin))
    return abs(a.clock.offset - b.clock.offset) > SAME_OFFSET or apart > SAME_ORIGIN


def _with_base(nominal: Geometry, sphere: Sphere, zeros: dict[str, float]) -> Geometry:
    ox, oy, oz = (float(c) for c in sphere.centre)
    return nominal.replaced({"ox": ox, "oy": oy, "oz": oz} | zeros)


def _grid(log: SmoothLog, step: float) -> Array:
    return np.asarray(
        log.start + step * np.arange(int((log.end - log.start) / step) + 1, dtype=np.float64)
    )


def _poses(robot: SmoothLog, nominal: Geometry, step: float) -> Array:
    return robot_frames(nominal, np.asarray(robot.spline(_grid(robot, step)))).poses()
