"""A candidate judged: the best configuration of the arm, what it violates, and how well it would do.

The figure is the root mean square of the predicted TCP sigma over the workspace. Which loads reverse,
and so which play is seen, depends on the force in the rod, and that on the robot: a report looks at several.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from cell.arrays import Array
from cell.descriptions import Cell
from cell.errors import InputError
from cell.geometry import nominal_geometry
from cell.load import load_cell
from ident.loads.gear_loads import mass_model
from ident.robot.accuracy import rigid_basis
from ident.robot.unloaded_robot import UnloadedRobot
from planning.candidate import Candidate
from planning.clearance import Clearance, clearance, nearest
from planning.course import Course, course_over
from planning.force import ForceModel, Forces, force_model, predicted_forces
from planning.limits import Violation, violations
from planning.predict import Prediction, Predictor, moving, planned_unknowns, predictions, predictor
from planning.request import PlanLimits, PlanRequest, tightened

NEARLY = 0.5  # excess of the motion up to which forces and clearance are looked at
UNEXAMINED = 10.0  # more than forces and clearance come to
ROBOTS = 2  # whose tension enters a judgement; a search weighs one while it goes, and the report takes all of planning.force


@dataclass(frozen=True, eq=False)
class Judge:
    """Everything to judge candidates of one request with one rod."""

    request: PlanRequest
    rod: str  # the ball-bar, as the request has it
    limits: PlanLimits  # those that a plan keeps, with a reserve
    cell: Cell
    predictor: Predictor
    forces: ForceModel
    clearance: Clearance
    gram: Array  # (p, p) sum over the grid of products of the tool's columns, base aligned


@dataclass(frozen=True, eq=False)
class Judgement:
    """Of one candidate."""

    candidate: Candidate
    violations: tuple[Violation, ...]  # worst first; none: it can be run
    course: Course | None  # None where the robot does not reach
    forces: Forces | None
    tcp: float  # [m] predicted; infinite where it cannot be run
    examined: bool = True  # forces and clearance too

    @property
    def excess(self) -> float:
        """Of all limits together; of one that was not examined, more than of any that was."""
        return sum(v.excess for v in self.violations) + (0.0 if self.examined else UNEXAMINED)


def judges(request: PlanRequest) -> dict[str, Judge]:
    """One for each rod that may be taken, by its name. Raises InputError or DescriptionError for what is not there."""
    rods = (request.cell.ballbar, *request.cell.ballbar_choices)
    return {
        rod: judge_of(request, rod, load_cell(request.cell.robot, rod, request.cell.plate))
        for rod in rods
    }


def judge_of(request: PlanRequest, rod: str, cell: Cell) -> Judge:
    """Raises InputError for a servo that the robot does not have."""
    gains = cell.robot.servo.get(request.servo)
    if gains is None:
        raise InputError(
            f"servo = {request.servo!r}: robot {cell.robot.name} has no such gain set; it has {', '.join(cell.robot.servo)}"
        )
    masses = mass_model(cell)
    on = predictor(cell, request.sensors, request.timing, request.workspace)
    return Judge(
        request,
        rod,
        tightened(request.limits),
        cell,
        on,
        force_model(cell, masses, gains, seed=request.seed),
        clearance(cell, request.cell),
        _gram(on),
    )


def judged(judge: Judge, candidate: Candidate, *, robots: int = ROBOTS) -> Judgement:
    """What a candidate violates and, where that is nothing, how well it would do with so many robots of planning.force."""
    at_best = checked(judge, candidate)
    if at_best.violations or at_best.course is None or at_best.forces is None:
        return at_best
    tcp = [
        tcp_rms(judge, found)
        for found in predictions(judge.predictor, at_best.course, at_best.forces.tension[:robots])
    ]
    return Judgement(
        candidate, (), at_best.course, at_best.forces, float(np.sqrt(np.mean(np.square(tcp))))
    )


def checked(judge: Judge, candidate: Candidate) -> Judgement:
    """The configuration of the arm that violates least, and what."""
    limits, best = judge.limits, None
    for course in course_over(judge.cell, candidate, judge.request.timing):
        found, forces = violations(judge.cell, limits, course), None
        near = sum(v.excess for v in found) < NEARLY
        if near:  # before the motion is all right, or a search would stop where it becomes so
            forces = predicted_forces(judge.forces, course)
            found += [*_too_strong(forces, limits.force_N, course), *_too_near(judge, course)]
        found.sort(key=lambda v: -v.excess)
        one = Judgement(candidate, tuple(found), course, forces, np.inf, examined=near)
        if not found:
            return one
        if best is None or one.excess < best.excess:
            best = one
    return best or Judgement(
        candidate,
        (Violation("reach", 10.0, "the robot does not reach all of it"),),
        None,
        None,
        np.inf,
        examined=False,
    )


def _too_strong(forces: Forces, limit: float, course: Course) -> list[Violation]:
    if forces.largest <= limit:
        return []
    k = int(np.abs(forces.tension).max(axis=0).argmax())
    text = f"{forces.largest:.0f} N in the rod at t = {course.t[k]:.1f} s, limit {limit:g}"
    return [Violation("force_N", float(np.log(forces.largest / limit)), text)]


def _too_near(judge: Judge, course: Course) -> list[Violation]:
    limit = judge.limits.clearance_m
    near = nearest(judge.clearance, course.nominal, course.q, course.b, course.t)
    if near.distance >= limit:
        return []
    text = f"{near.pair} {near.distance * 1e3:.0f} mm apart at t = {near.t:.1f} s, limit {limit * 1e3:g}"
    return [Violation("clearance_m", (limit - near.distance) / 0.1, text)]


def tcp_rms(judge: Judge, found: Prediction) -> float:
    """[m] root mean square over the grid of what `Prediction.tcp_sigma` is at each pose, without forming the covariance."""
    moved, s = moving(found.layout), found.layout.sigma
    wanted = np.zeros((s.size, moved.size))
    wanted[moved, np.arange(moved.size)] = s[moved]
    factor = np.linalg.cholesky(found.normal * np.outer(s, s))
    half = solve_triangular(
        factor, wanted, lower=True, check_finite=False
    )  # covariance = half' half
    return float(np.sqrt(((half @ judge.gram) * half).sum() / len(found.grid)))


def _gram(on: Predictor) -> Array:
    """The free robot does not depend on where the ball-bar stands, so neither do these columns."""
    nominal = nominal_geometry(on.cell, np.zeros(3))
    layout, x = planned_unknowns(on, nominal, ())
    free = UnloadedRobot(on.cell, nominal, on.corrections, x[layout.coefficients])
    moves = free.jacobian(on.grid, layout.shared)
    columns = moves.transpose(2, 1, 0).reshape(-1, len(moves))
    basis = rigid_basis(free.tool(on.grid))
    columns -= basis @ (basis.T @ columns)
    return np.asarray(columns.T @ columns)
