"""Plans: the best paths of a search, evaluated in full."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import bar_frames
from ballbar.cell.rotation import even_directions
from ballbar.cell.strict_yaml import load_model
from ballbar.ident.corrections.base import backlash_transition
from ballbar.ident.estimator.uncertainty import observability
from ballbar.ident.robot.tcp_uncertainty import scale_error
from ballbar.planning.candidate import (
    AMPLITUDES,
    PathCandidate,
    Space,
    folded,
    genome_of,
    rounded,
    space_of,
)
from ballbar.planning.coarse import BATCH, objectives
from ballbar.planning.crlb import PathPrediction
from ballbar.planning.evaluation import (
    INFEASIBLE,
    SCREENED_OUT,
    Assessment,
    Evaluator,
    check,
    evaluate,
    evaluators,
    tcp_rms_before,
)
from ballbar.planning.force import Forces, Lengths, load_reversals, predicted_lengths
from ballbar.planning.known import Known
from ballbar.planning.programs import BALLBAR, TELESCOPING, TRACKED
from ballbar.planning.request import PlanRequest
from ballbar.planning.screen import screen, tally
from ballbar.planning.search import (
    RatedCandidate,
    SearchProgress,
    evaluating_processes,
    evolution,
    free_numbers,
    ranked,
    search,
)
from ballbar.planning.trajectory import Trajectory
from ballbar.sim.path import Lissajous
from ballbar.sim.path_files import LissajousFile, lissajous

SECONDS = 60.0  # a request for which nothing is found in this time most likely allows nothing
BATCHES = 8  # screened for one descent
# Generations without a gain that end a descent, and of one descent at most
GENERATIONS, MOST_GENERATIONS = 20, 100
# Screened candidates that are tried before one, without the force that excludes most of them: those
# that are farthest from the limits move least and identify least.
TRIED = 32
# Of a search, as they are; then the best with these shares of its amplitudes: where the servo takes
# it beyond a limit, by some percent of the acceleration, its neighbours are beyond it as well.
AS_FOUND, CALMER = 2, (0.95, 0.9)
SHOWN = 3  # limits that the nearest miss violates, worst first


def first_path(
    given: dict[str, Evaluator], *, seconds: float = SECONDS
) -> tuple[RatedCandidate, int]:
    """A candidate that can be run, and the number of candidates tried.

    given : evaluators by rod. Raises InputError that says which limits stand in the way.
    """
    since, tried, rods = time.monotonic(), 0, list(given)
    rng = np.random.default_rng(next(iter(given.values())).request.seed)
    reasons: Counter[str] = Counter()
    nearest = (np.inf, "")
    while time.monotonic() - since < seconds:
        rod = rods[tried // (BATCH * BATCHES) % len(rods)]
        evaluator, space = given[rod], given[rod].space
        genomes = rng.random((BATCH * BATCHES, space.size))
        screened = screen(evaluator.cell, evaluator.request.cell, space, evaluator.limits, genomes)
        tried += len(genomes)
        reasons.update(screened.reason[screened.excess > 0.0].tolist())
        start = genomes[int(screened.excess.argmin())]
        if (passed := genomes[screened.excess <= 0.0][:TRIED]).size:
            values = objectives(evaluator, passed, best=INFEASIBLE)
            start = passed[int(values.argmin())]
            if values.min() < INFEASIBLE:
                return RatedCandidate(rod, start, float(values.min())), tried
        genome, least = descent(evaluator, space, start, int(rng.integers(2**31)))
        if least < INFEASIBLE:
            return RatedCandidate(rod, genome, least), tried
        if least < min(nearest[0], SCREENED_OUT):
            violated = check(evaluator, space.candidate(genome)).violations[:SHOWN]
            nearest = (least, "; ".join(v.sentence for v in violated))
    miss = f" The nearest miss (limits with their reserve): {nearest[1]}." if nearest[1] else ""
    raise InputError(
        f"no path found: {tried} random paths and descents from the best of them failed, "
        f"the random ones by: {tally(reasons)}.{miss} "
        "Move the ball-bar (cell.ballbar_region_m), take another rod, or widen the limit that "
        "stands in the way."
    )


def descent(evaluator: Evaluator, space: Space, start: Array, seed: int) -> tuple[Array, float]:
    """The first genome (S,) [-] that violates nothing, or the one that violates least.

    start : (S,) [-] genome. Returns the genome and its objective.
    """
    free = free_numbers(space)
    search = evolution(start[free], seed=seed)
    best, least, gained = start, np.inf, 0
    for generation in range(MOST_GENERATIONS):
        points = search.ask()
        genomes = np.tile(start, (len(points), 1))
        genomes[:, free] = points
        values = objectives(evaluator, genomes, best=INFEASIBLE)
        if values.min() < least:
            best, least, gained = folded(genomes[values.argmin()]), float(values.min()), generation
        if least < INFEASIBLE or generation - gained >= GENERATIONS:
            break
        search.tell(points, values.tolist())
    return best, least


# [rad] distance from the path within which a point of the sphere counts as covered (notes/plant
# sec. 10)
COVERED_WITHIN = np.radians(10.0)
SPHERE_POINTS = 2000  # 2.6 deg apart


@dataclass(frozen=True, eq=False)
class PathPlan:
    """A path that can be run."""

    evaluator: Evaluator
    evaluation: Assessment
    trajectory: Trajectory  # in the configuration of the arm that was chosen
    forces: Forces | None  # None where nothing holds the rod's length
    lengths: Lengths | None  # of a bar that measures its length
    predictions: tuple[PathPrediction, ...]  # of each robot of ballbar.planning.force
    evaluated: int = 0  # candidates of the search
    seconds: float = 0.0  # that the search took
    stopped: bool = False  # by Ctrl-C

    @property
    def request(self) -> PlanRequest:
        """The request that the plan answers."""
        return self.evaluator.request

    @property
    def rod(self) -> str:
        """Name of the ball-bar as the request has it."""
        return self.evaluator.rod

    @property
    def gauge(self) -> str:
        """Name of the thing that is mounted on the flange."""
        if self.evaluator.followed is not None:
            return TRACKED
        return TELESCOPING if self.request.telescoping else BALLBAR

    @property
    def scale_adds(self) -> float:
        """[m] root mean square TCP error from the scale, which no data show."""
        if self.evaluator.followed is not None or self.evaluator.beside is not None:
            return 0.0  # that of the instrument, which its description does not state
        return scale_error(self.evaluator.cell, self.evaluator.predictor.grid)

    @property
    def tcp(self) -> Array:
        """(R,) [m] root mean square over the workspace of each robot's predicted TCP sigma."""
        return np.array([float(np.sqrt(np.mean(p.tcp_sigma**2))) for p in self.predictions])

    @property
    def tcp_before(self) -> float | None:
        """[m] `tcp` before the path, by the results of the machine; None without any."""
        known = self.evaluator.predictor.known
        return None if known is None else tcp_rms_before(self.evaluator)

    @property
    def typical(self) -> PathPrediction:
        """The prediction of the robot with the median TCP sigma."""
        return self.predictions[int(np.argsort(self.tcp)[len(self.predictions) // 2])]

    @property
    def reversals(self) -> Array:
        """(6,) sign changes of each gear's load, median over the robots; (0,) without forces."""
        if self.forces is None:
            return np.zeros(0)
        width = backlash_transition(self.evaluator.cell.robot)
        return np.median(load_reversals(self.forces, width), axis=0)

    @property
    def coverage(self) -> float:
        """Share of the sphere within COVERED_WITHIN of the path."""
        return covered(bar_frames(self.trajectory.nominal, self.trajectory.b).z[2])

    def indices(self) -> dict[str, float]:
        """Observability indices O1 to O5 of the robot's parameters."""
        typical = self.typical
        parameters = typical.layout.fixed.table.parameters
        shared = typical.layout.shared
        robot = [k for k, i in enumerate(shared) if parameters[i].side == "robot"]
        sigma, count = typical.layout.sigma, typical.model.parts[0].size
        return observability(typical.normal, sigma, np.array(robot), count)


def covered(directions: Array) -> float:
    """Share of the unit sphere within COVERED_WITHIN of unit vectors (3, N) [-]."""
    nearest = (even_directions(SPHERE_POINTS) @ directions).max(axis=1)
    return float((nearest > np.cos(COVERED_WITHIN)).mean())


def plans(
    request: PlanRequest,
    *,
    relative_to: Path,
    workers: int,
    seconds: float,
    evaluations: int,
    show: Callable[[SearchProgress], None] = lambda _: None,
    since: Callable[[], float],
    known: Known | None = None,
) -> Iterator[PathPlan]:
    """The best path within `seconds` and `evaluations`, then the next best, then calmer ones.

    With 0 seconds, the first path that can be run. relative_to : folder of the request, for the
        paths that it names. show : called with the progress of the search. since : returns the
        seconds since planning began. known : from results of the machine.

    Raises InputError where no path can be run.
    """
    of_rods = evaluators(request, known)
    first, tried = first_path(of_rods)
    progress = SearchProgress()
    progress.add(first)
    show(progress)
    best = [first]
    if seconds > 0.0:
        with evaluating_processes(request, workers, known) as pool:
            progress = search(
                request,
                pool,
                seconds=seconds - since(),
                evaluations=evaluations,
                first=[first],
                hints=hints(request, relative_to),
                show=show,
            )
            best = ranked(progress.incumbents, pool) or best  # none yet where Ctrl-C came at once
    took = since()

    def planned(start: RatedCandidate) -> PathPlan:
        evaluator = of_rods[start.rod]
        return replace(
            assess(evaluator, rounded(evaluator.space.candidate(start.genome))),
            evaluated=tried + progress.evaluated,
            seconds=took,
            stopped=progress.stopped,
        )

    yield from map(planned, best[:AS_FOUND])
    for share in CALMER:
        try:
            plan = planned(calmer(best[0], share))
        except InputError:  # nearer to another limit
            continue
        yield plan


def calmer(start: RatedCandidate, share: float) -> RatedCandidate:
    """The candidate with amplitudes of this share: its joints accelerate by about as much less."""
    genome = folded(start.genome)
    genome[AMPLITUDES] *= share
    return replace(start, genome=genome)


def hints(request: PlanRequest, relative_to: Path) -> list[RatedCandidate]:
    """Paths that the request names as starts of islands, which may violate limits.

    Raises DescriptionError for a bad file.
    """
    space = space_of(request)
    middle = 0.5 * (space.lower + space.upper)
    rods = request.cell.rods
    starts = []
    for file in (relative_to / name for name in request.start_from):
        shape, position = known_path(file, telescoping=request.telescoping)
        candidate = PathCandidate(shape, middle if position is None else np.array(position))
        genome = genome_of(space, candidate)
        starts += [RatedCandidate(rod, genome, INFEASIBLE) for rod in rods]
    return starts


def known_path(
    file: Path, *, telescoping: bool = False
) -> tuple[Lissajous, tuple[float, ...] | None]:
    """The shape of a path file, and the ball-bar's position [m] if the file states it.

    telescoping : whether the rod may change its length.

    Raises DescriptionError for a bad file, InputError for one whose rod would have to telescope.
    """
    content = load_model(file, LissajousFile)
    if content.rod and not telescoping:
        raise InputError(f"{file}: paths are planned for a rigid rod. Leave out `rod`.")
    return lissajous(content), content.ballbar_position_m


def assess(evaluator: Evaluator, candidate: PathCandidate) -> PathPlan:
    """The plan of a candidate, with all predictions. Raises InputError where it cannot be run."""
    outcome = evaluate(evaluator, candidate)
    trajectory, forces, model = outcome.trajectory, outcome.forces, evaluator.stroke_model
    if outcome.violations or trajectory is None:
        raise InputError(
            f"the path cannot be run: {'; '.join(v.sentence for v in outcome.violations)}. "
            "Change the path, or move the ball-bar"
        )
    return PathPlan(
        evaluator=evaluator,
        evaluation=outcome,
        trajectory=trajectory,
        forces=forces,
        lengths=None if model is None else predicted_lengths(model, trajectory),
        predictions=evaluator.predictions(trajectory, forces),
    )
