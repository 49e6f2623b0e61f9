"""A plan: the path found, what it is predicted to tell, and the files that a cell and a scenario need."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import PARAMETERS, bar_frames, nominal_geometry, robot_frames
from cell.strict_yaml import load_model
from ident.corrections.base import backlash_transition
from ident.estimator.uncertainty import observability
from planning.candidate import Candidate, numbers_of, rounded, space_of
from planning.course import Course
from planning.first import first_path
from planning.force import load_reversals
from planning.judge import Judge, Judgement, judged, judges
from planning.predict import Prediction, predictions
from planning.request import PlanRequest
from planning.sample import VIOLATES
from planning.search import Progress, Start, ranked, search
from planning.workers import judging_processes
from sim.path import Lissajous
from sim.settings import LissajousFile
from sim.simulate import lissajous

COVERED_WITHIN = np.radians(
    10.0
)  # of the path, by which a point of the sphere counts as covered (notes/mujoco sec. 10)
SPHERE_POINTS = 2000


@dataclass(frozen=True, eq=False)
class Plan:
    """A path that can be run."""

    request: PlanRequest
    judge: Judge
    found: Judgement
    predictions: tuple[Prediction, ...]  # of each robot of planning.force
    evaluated: int
    seconds: float
    stopped: bool = False

    @property
    def course(self) -> Course:
        """Over time, in the configuration of the arm that was chosen."""
        assert self.found.course is not None
        return self.found.course

    @property
    def rod(self) -> str:
        """Name of the ball-bar as the request has it."""
        return self.judge.rod

    @property
    def plate_adds(self) -> float:
        """[m] root mean square TCP error that the plate's own length adds: pure scale, which no data show."""
        return scale_error(self.judge.predictor.grid, self.judge.cell)

    @property
    def tcp(self) -> Array:
        """(R,) [m] root mean square of the predicted TCP sigma over the workspace, of each robot."""
        return np.array([float(np.sqrt(np.mean(p.tcp_sigma**2))) for p in self.predictions])

    @property
    def typical(self) -> Prediction:
        """Of the robot in the middle."""
        return self.predictions[int(np.argsort(self.tcp)[len(self.predictions) // 2])]

    @property
    def reversals(self) -> Array:
        """(6,) sign changes of each gear's load, median over the robots."""
        assert self.found.forces is not None
        return np.median(
            load_reversals(self.found.forces, backlash_transition(self.judge.cell)), axis=0
        )

    @property
    def coverage(self) -> float:
        """Share of the sphere within COVERED_WITHIN of the path."""
        return covered(bar_frames(self.course.nominal, self.course.b).z[2])

    def indices(self) -> dict[str, float]:
        """Observability indices O1 to O5 of the robot's parameters."""
        typical = self.typical
        robot = [k for k, i in enumerate(typical.layout.shared) if PARAMETERS[i].side == "robot"]
        sigma, count = typical.layout.sigma, typical.model.recordings[0].times.size
        return observability(typical.normal, sigma, np.array(robot), count)


def scale_error(grid: Array, cell: Cell) -> float:
    """[m] root mean square TCP error over poses grid (G, 6) [rad] of a plate that is one deviation longer than it is said to be."""
    positions = robot_frames(nominal_geometry(cell, np.zeros(3)), grid).tip
    spread = float(
        np.sqrt(((positions - positions.mean(axis=1, keepdims=True)) ** 2).sum(axis=0).mean())
    )
    return spread * cell.plate.length_sigma / cell.plate.length


def covered(directions: Array) -> float:
    """Share of the unit sphere within COVERED_WITHIN of directions (3, N)."""
    k = np.arange(SPHERE_POINTS) + 0.5
    z, turn = 1.0 - 2.0 * k / SPHERE_POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k  # Fibonacci lattice
    points = np.stack(
        (np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z), axis=1
    )
    return float(((points @ directions).max(axis=1) > np.cos(COVERED_WITHIN)).mean())


def plans(
    request: PlanRequest,
    *,
    relative_to: Path,
    workers: int,
    seconds: float,
    evaluations: int,
    show: Callable[[Progress], None] = lambda _: None,
    since: Callable[[], float],
) -> Iterator[Plan]:
    """The best path within `seconds` and `evaluations`, then the next best; with 0 seconds the first that can be run.

    relative_to : folder of the request, for paths it names. since : seconds since planning began. Raises InputError where there is none.
    """
    given = judges(request)
    first, tried = first_path(given)
    progress = Progress()
    progress.add(first)
    show(progress)
    best = [first]
    if seconds > 0.0:
        with judging_processes(request, workers) as pool:
            progress = search(
                request,
                pool,
                workers=workers,
                seconds=seconds - since(),
                evaluations=evaluations,
                first=[first],
                hints=hints(request, relative_to),
                show=show,
            )
            best = ranked(progress.leaders, pool)
    took = since()
    for one in best:
        candidate = rounded(space_of(request).candidate(one.z))
        yield assessed(
            given[one.rod],
            candidate,
            evaluated=tried + progress.evaluated,
            seconds=took,
            stopped=progress.stopped,
        )


def hints(request: PlanRequest, relative_to: Path) -> list[Start]:
    """Paths that the request names, as starts that may yet violate limits. Raises DescriptionError for a bad file."""
    space = space_of(request)
    middle = 0.5 * (space.lower + space.upper)
    starts = []
    for file in (relative_to / name for name in request.start_from):
        shape, place = known_path(file)
        z = numbers_of(space, Candidate(shape, middle if place is None else np.array(place)))
        starts += [
            Start(rod, z, VIOLATES) for rod in (request.cell.ballbar, *request.cell.ballbar_choices)
        ]
    return starts


def known_path(file: Path) -> tuple[Lissajous, tuple[float, ...] | None]:
    """A path file, and where its ball-bar stood [m], should it say so. Raises DescriptionError for a bad file."""
    read = load_model(file, LissajousFile)
    return lissajous(read), read.ballbar_position_m


def assessed(
    judge: Judge,
    candidate: Candidate,
    *,
    evaluated: int = 0,
    seconds: float = 0.0,
    stopped: bool = False,
) -> Plan:
    """A candidate with all predictions. Raises InputError where it cannot be run."""
    found = judged(judge, candidate)
    if found.violations or found.course is None or found.forces is None:
        raise InputError(
            f"the path cannot be run: {'; '.join(v.sentence for v in found.violations)}"
        )
    expected = predictions(judge.predictor, found.course, found.forces.tension)
    return Plan(judge.request, judge, found, expected, evaluated, seconds, stopped)
