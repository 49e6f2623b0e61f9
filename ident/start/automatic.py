"""Automatic start: from two logs to starting values, without a guess.

Unknown are the encoder offsets (over the full turn), the encoder directions, the configuration of
the ball-bar, its base position and the clock offset, whatever its size. The nominal robot gives the
sphere on which the tool moves (ballbar.ident.start.sphere); two encoders of a gimbal against the
rod's direction give clock offset, encoder direction and offsets in one scan of all lags
(ballbar.ident.start.lag_scan). Several lags and branches are kept as hypotheses to the end, each is
fitted, and what the fits explain decides: a first peak, or a first small residual, can be an alias
of the motion. Algorithm and the study behind the constants: notes/identification sec. 8.

The directions of b2 and b4 are unobservable (one gauge with the configuration) and stay as
declared; those of b1, b3 and b5 are found, and a disagreement with the declared ones is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import screw
from ballbar.cell.clock import Clock
from ballbar.cell.errors import FailureError
from ballbar.cell.geometry import Geometry, ParameterTable, parameter_named, robot_frames
from ballbar.cell.inverse import bar_roll
from ballbar.ident.estimator.fit import Fit, fit_kinematics
from ballbar.ident.estimator.gauss_newton import SingularError
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.priors import fixed_names
from ballbar.ident.estimator.sample_times import overlap, sample_times
from ballbar.ident.estimator.samples import samples_of
from ballbar.ident.signals.smooth_log import SmoothLog
from ballbar.ident.start.lag_scan import Pair, PairScan, best_lags, scan_lags, subsample
from ballbar.ident.start.length_scan import best_lengths
from ballbar.ident.start.sphere import FittedSphere, sphere_candidates

SCAN_STEP = 0.02  # [s] of the lags; more where a log is so long that its grid has SCAN_ROWS
SCAN_ROWS = 200_000  # 67 minutes
SPHERE_STEP = 0.1  # [s]
LENGTH_ROWS = 6000  # of the grid on which a sensed length is compared, at most
LAGS = 5  # kept of the scan
LAG_SEPARATION = 2.0  # [s] nearer maxima belong to one peak
SAMPLES = 400  # of a hypothesis' fit
HYPOTHESES = 8
ITERATIONS = 15  # a wrong hypothesis crawls; the right one needs 3 to 7
# [m, rad] a gauge weight, not a prior: unobservable directions stay where linearisation holds
GEOMETRY_SIGMA = 5e-3
# Known scale, and what the ball-bar's base and rd2 can absorb; left free they wander.
ROLL_CLOSE = 0.9  # of the better mean resultant: a direction of b3 that is kept too
SCORE_KEPT = 0.5  # of the best score
ACCEPT_FACTOR, ACCEPT_MARGIN = 2.0, 0.5  # cost per residual: at most so many times the least, plus
SAME_OFFSET, SAME_ORIGIN = 0.05, 0.05  # [s], [m] solutions further apart are two answers
# Within these factors candidates are equally good; the better score goes first.
SAME_OVERLAP, SAME_COST = 0.98, 1.2
RIVAL_OVERLAP = 0.7  # of the chosen one's
_GIMBALS = ((1, 2), (5, 4))  # turning and tilting joint of gimbal and universal joint


class StartError(FailureError):
    """No starting point could be found, and why."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way to read the two logs."""

    clock: Clock
    directions: tuple[int, ...]  # (E,) of each encoder against its declared direction
    geometry: Geometry  # nominal, with base position and encoder offsets of this hypothesis
    score: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted hypothesis."""

    hypothesis: Hypothesis
    fit: Fit
    overlap: float  # [s]

    @property
    def cost(self) -> float:
        """Cost per residual, prior included, so that leaving the prior cannot lower it."""
        equations = self.fit.linear
        return equations.cost / max(1, equations.equations - len(equations.x))


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
    ballbar: SmoothLog | None,
    encoders: tuple[int, ...],
    nominal: Geometry,
    excess: ExcessNoise,
    *,
    spacing: float,
    zero_sigma: float = 0.0,
    known: Hypothesis | None = None,
) -> Start:
    """Starting values for a recording.

    ballbar : without encoders it is the sensed extension of the rod [m].
    nominal : catalogue geometry; its base position and encoder offsets are ignored.
    spacing : [s] between the samples of the fit that follows.
    zero_sigma : [m] of the sensed length's zero.
    known : how the logs are to be read; nothing is searched.

    Raises StartError when the logs share no motion or hold no complete pair of encoders.
    """
    pairs = [pair for pair in _GIMBALS if set(pair) <= set(encoders)]
    if encoders and not pairs:
        raise StartError(
            f"encoders {encoders} hold no complete gimbal: b1 with b2, or b4 with b5, is needed to "
            "align the logs. Declare both in recording.yaml"
        )
    if {1, 2, 4, 5} & set(encoders) != {j for pair in pairs for j in pair}:
        raise StartError(
            f"encoders {encoders}: half a gimbal is fitted; use b1 with b2 and b4 with b5, or "
            "leave the odd one out"
        )
    if known is not None:
        every = iter((known,))
    elif ballbar is not None and not encoders:
        every = length_hypotheses(robot, ballbar, nominal, zero_sigma)
    else:
        every = _hypotheses(robot, ballbar, encoders, nominal)
    candidates = []
    for hypothesis in islice(every, HYPOTHESES):
        candidate = fit_hypothesis(hypothesis, robot, ballbar, encoders, excess, spacing)
        if candidate is not None:
            candidates.append(candidate)
    if not candidates:
        raise StartError(
            "no clock offset makes the two logs agree anywhere; are both of the same run, and is "
            "the robot the right one? Name logs of one run, and its robot, in recording.yaml"
        )
    return _choice(candidates)


def _hypotheses(
    robot: SmoothLog, ballbar: SmoothLog | None, encoders: tuple[int, ...], nominal: Geometry
) -> Iterator[Hypothesis]:
    poses = _poses(robot, nominal, SPHERE_STEP)
    try:
        spheres = sphere_candidates(poses[:, :3, 3], nominal["bd3"])
    except ValueError as error:
        raise StartError(str(error)) from None
    if ballbar is None:
        for sphere in spheres:
            yield Hypothesis(Clock(0.0, 0.0), (), _with_base(nominal, sphere, {}), -sphere.cost)
        return
    aligned = [a for s in spheres for a in _aligned(robot, ballbar, encoders, nominal, s)]
    least = SCORE_KEPT * max((score for score, _ in aligned), default=0.0)
    for score, hypotheses in sorted(aligned, key=lambda a: -a[0]):
        if score >= least:
            yield from hypotheses


def _aligned(
    robot: SmoothLog,
    ballbar: SmoothLog,
    encoders: tuple[int, ...],
    nominal: Geometry,
    sphere: FittedSphere,
) -> Iterator[tuple[float, Iterator[Hypothesis]]]:
    """The score of each of the best lags about one sphere, and the hypotheses that have it."""

    def hypotheses(index: int, read: dict[int, tuple[int, float]]) -> Iterator[Hypothesis]:
        offset = subsample(scan, index) * step + robot.start - ballbar.start
        for readable in _with_roll(read, encoders, column, rotation, int(scan.lags[index])):
            directions = tuple(readable[joint][0] for joint in encoders)
            offsets = {f"btheta{joint}": readable[joint][1] for joint in encoders}
            geometry = _with_base(nominal, sphere, offsets)
            yield Hypothesis(Clock(offset, 0.0), directions, geometry, float(scan.score[index]))

    step = max(SCAN_STEP, _longest(robot, ballbar) / SCAN_ROWS)
    poses = _poses(robot, nominal, step)
    rotation, tip = poses[:, :3, :3], poses[:, :3, 3]
    rod = tip - sphere.centre
    u = rod / np.linalg.norm(rod, axis=1, keepdims=True)
    v = np.einsum("nij,ni->nj", rotation, u)
    readings = np.asarray(ballbar.spline(_grid(ballbar, step)))
    column = {joint: readings[:, k] for k, joint in enumerate(encoders)}
    seen = dict(zip(_GIMBALS, (u, v * np.array([-1.0, 1.0, 1.0])), strict=True))
    pairs = {
        pair: PairScan(Pair(column[pair[0]], column[pair[1]], rod_direction), step)
        for pair, rod_direction in seen.items()
        if set(pair) <= set(encoders)
    }
    scan = scan_lags(list(pairs.values()))
    for index in best_lags(scan, count=LAGS, separation=round(LAG_SEPARATION / step)):
        for branches in product(*(pair.branches(index) for pair in pairs.values())):
            read: dict[int, tuple[int, float]] = {}  # direction and offset of each encoder
            for (turning, tilting), branch in zip(pairs, branches, strict=True):
                read[turning] = branch.sign, branch.turning_offset
                read[tilting] = 1, branch.tilting_offset
            yield float(scan.score[index]), hypotheses(index, read)


def length_hypotheses(
    robot: SmoothLog, extension: SmoothLog, nominal: Geometry, zero_sigma: float
) -> Iterator[Hypothesis]:
    """Hypotheses of the best lags of a sensed length, the best first.

    extension : of the rod [m]; other arguments as of `automatic_start`.
    """
    step = max(SCAN_STEP, _longest(robot, extension) / LENGTH_ROWS)
    q = np.asarray(robot.spline(_grid(robot, step)))
    frames, table = robot_frames(nominal, q), nominal.table
    free = [name for name in table.robot if name not in fixed_names(table)]
    moves = np.array([screw(frames, p.kind, p.row)[:3] for p in map(parameter_named, free)])
    moves *= GEOMETRY_SIGMA
    length = nominal["bd3"] + np.asarray(extension.spline(_grid(extension, step)))[:, 0]
    best = best_lengths(frames.tip.T, moves, length, step, zero_sigma=zero_sigma, count=LAGS)
    for scan, index in best:
        offset = subsample(scan.scan, index) * step + robot.start - extension.start
        zero = {"bd3": nominal["bd3"] + scan.zero(index)}
        for x, y, z in scan.seats(index):
            geometry = nominal.replaced({"ox": float(x), "oy": float(y), "oz": float(z)} | zero)
            yield Hypothesis(Clock(offset, 0.0), (), geometry, float(scan.scan.score[index]))


def _with_roll(
    read: dict[int, tuple[int, float]],
    encoders: tuple[int, ...],
    column: dict[int, Array],
    rotation: Array,
    lag: int,
) -> Iterator[dict[int, tuple[int, float]]]:
    """The readings with that of b3 added, in each direction that explains the roll well enough."""
    if 3 not in encoders:
        yield read
        return
    if not {1, 2, 4, 5} <= set(read):
        raise StartError(
            "encoder b3 needs b1, b2, b4 and b5 beside it: its offset is read off against these. "
            "Declare them in recording.yaml, or leave b3 out"
        )
    n = column[3].size
    first, last = max(0, -lag), min(n, rotation.shape[0] - lag)
    angle = {j: s * column[j][first:last] + offset for j, (s, offset) in read.items()}
    turned = rotation[first + lag : last + lag]
    roll = bar_roll(turned, angle[1], angle[2], angle[4], angle[5])
    means = {
        direction: complex(np.exp(1j * (roll - direction * column[3][first:last])).mean())
        for direction in (1, -1)
    }
    longest = max(abs(mean) for mean in means.values())
    for direction, mean in means.items():
        if abs(mean) >= ROLL_CLOSE * longest:
            yield read | {3: (direction, float(np.angle(mean)))}


def fit_hypothesis(
    hypothesis: Hypothesis,
    robot: SmoothLog,
    ballbar: SmoothLog | None,
    encoders: tuple[int, ...],
    excess: ExcessNoise,
    spacing: float,
) -> Candidate | None:
    """A hypothesis after a fit of a few samples; None where it leads nowhere.

    spacing : [s] between the samples of the fit that follows.
    """
    try:
        times = sample_times(robot, ballbar, hypothesis.clock, SAMPLES)
    except ValueError:
        return None
    samples = samples_of(robot, ballbar, encoders, hypothesis.directions, times, spacing=spacing)
    parameters, sigma = start_parameters(hypothesis.geometry.table, encoders)
    try:
        fit = fit_kinematics(
            samples,
            hypothesis.geometry,
            hypothesis.clock,
            parameters,
            excess,
            prior_sigma=sigma,
            negligible=1e-2,
            max_iterations=ITERATIONS,
        )
    except SingularError:  # a wrong hypothesis may run into a pose where nothing can be solved
        return None
    first, last = overlap(robot, ballbar, fit.clock())
    return Candidate(hypothesis, fit, last - first)


def start_parameters(
    table: ParameterTable, encoders: tuple[int, ...]
) -> tuple[NDArray[np.intp], Array]:
    """Parameters that are fitted while hypotheses compete, and their prior sigmas (P,) [m, rad].

    Base position and encoder offsets have none.
    """
    offsets = [f"btheta{joint}" for joint in encoders]
    robot = [name for name in table.robot if name not in fixed_names(table)]
    names = [*offsets, "ox", "oy", "oz", *robot, "bd3"]
    sigma = np.full(len(names), GEOMETRY_SIGMA)
    sigma[: len(offsets) + 3] = np.inf
    return np.array([table.index[name] for name in names]), sigma


def _choice(candidates: list[Candidate]) -> Start:
    least = min(candidate.cost for candidate in candidates)
    accepted = [c for c in candidates if c.cost <= ACCEPT_FACTOR * least + ACCEPT_MARGIN]
    longest = max(c.overlap for c in accepted)
    long = [c for c in accepted if c.overlap >= SAME_OVERLAP * longest]
    cheapest = min(c.cost for c in long)
    chosen = next(c for c in long if c.cost <= SAME_COST * cheapest)  # best score first
    rivals = tuple(
        c
        for c in accepted
        if c is not chosen and _differ(c, chosen) and c.overlap > RIVAL_OVERLAP * chosen.overlap
    )
    return Start(chosen, rivals, len(candidates))


def _differ(a: Candidate, b: Candidate) -> bool:
    """Whether two candidates are different answers."""
    apart = float(np.linalg.norm(a.fit.geometry().origin - b.fit.geometry().origin))
    later = abs(a.fit.clock().offset - b.fit.clock().offset)
    return later > SAME_OFFSET or apart > SAME_ORIGIN


def _with_base(nominal: Geometry, sphere: FittedSphere, offsets: dict[str, float]) -> Geometry:
    ox, oy, oz = (float(c) for c in sphere.centre)
    return nominal.replaced({"ox": ox, "oy": oy, "oz": oz} | offsets)


def _longest(robot: SmoothLog, other: SmoothLog) -> float:
    """[s] duration of the longer log."""
    return max(robot.end - robot.start, other.end - other.start)


def _grid(log: SmoothLog, step: float) -> Array:
    count = int((log.end - log.start) / step) + 1
    return np.asarray(log.start + step * np.arange(count, dtype=np.float64))


def _poses(robot: SmoothLog, nominal: Geometry, step: float) -> Array:
    """(N, 4, 4) tool poses of the nominal robot on an even grid of its log."""
    return robot_frames(nominal, np.asarray(robot.spline(_grid(robot, step)))).poses()
