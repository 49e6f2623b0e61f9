"""Assessment of a candidate: best arm configuration, violated limits, and predicted uncertainty.

The objective is the root mean square over the workspace of the predicted TCP sigma. Which loads
reverse, and so which backlash shows, depends on the force in the rod, and that on the robot's
errors: a report looks at several robots.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import has_closed_form
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import nominal_chain, nominal_geometry
from ballbar.cell.load import load_instrument, load_measured_cell
from ballbar.cell.statistics import rms
from ballbar.cell.typical_machine import Spread
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.robot.accuracy import aligned_columns
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.planning.candidate import PathCandidate, Space, space_of
from ballbar.planning.clearance import Clearance, clearance
from ballbar.planning.coarse_crlb import CoarsePredictor, coarse_predictor
from ballbar.planning.crlb import (
    PathPrediction,
    Predictor,
    before,
    planned_unknowns,
    predict,
    predictor,
)
from ballbar.planning.followed_path import followed, placed_along, predict_followed
from ballbar.planning.force import (
    DRAWS,
    ForceModel,
    Forces,
    StrokeModel,
    force_model,
    predicted_forces,
    stroke_model,
)
from ballbar.planning.known import Known
from ballbar.planning.limits import Violation, violations
from ballbar.planning.request import PlanLimits, PlanRequest, tightened
from ballbar.planning.screen import UNREACHED, screen
from ballbar.planning.stations import PoseSetup
from ballbar.planning.trajectory import Trajectory, trajectories
from ballbar.sim.path import LEAST_AXES
from ballbar.sim.true_robot import FREE

NEARLY = 0.5  # excess of the motion's limits up to which forces and clearance are computed
UNEXAMINED = 10.0  # added to the excess otherwise: more than forces and clearance come to
UNIT_CLEARANCE = 0.1  # [m] a gross violation; only guides a search
ROBOTS = (
    2  # of ballbar.planning.force, whose tension enters an evaluation; the report takes all of them
)
# In a search one robot counts: random paths then rank as with all robots at a correlation of 0.982
# instead of 0.988 with two, which take half as long again.
SEARCH_ROBOTS = 1
# Margins that arms have from their singular postures, with a closed form and without.
OF_OTHER_ARMS = ("singular_value",)
OF_CLOSED_FORM = ("wrist_margin_deg", "elbow_margin_deg", "shoulder_margin_m")
INFEASIBLE = 10.0  # least objective of a candidate that violates a limit
SCREENED_OUT = 30.0  # least objective of a candidate that fails screening


@dataclass(frozen=True, eq=False)
class Evaluator:
    """Everything to evaluate candidates of one request with one rod."""

    request: PlanRequest
    rod: str  # name of the ball-bar as the request has it
    limits: PlanLimits  # that a plan keeps, with a reserve
    cell: Cell
    predictor: Predictor
    force_model: ForceModel | None  # None where nothing holds the rod's length
    stroke_model: StrokeModel | None  # None where the length is not sensed
    clearance: Clearance
    # (p, p) upper triangle, off the diagonal doubled, of the sum over the grid of products of the
    # tool's columns, base aligned
    gram: Array
    coarse: CoarsePredictor  # of many candidates at once
    followed: PoseSetup | None  # where an instrument follows the target
    beside: PoseSetup | None  # that of a tracker beside the ball-bar

    def predictions(
        self, trajectory: Trajectory, forces: Forces | None, *, robots: int = DRAWS
    ) -> tuple[PathPrediction, ...]:
        """Predictions of a trajectory with the rod tensions of some robots of
        ballbar.planning.force."""
        setup = self.beside
        if self.followed is not None:
            return (predict_followed(self.followed, self.request, trajectory),)
        on = replace(self.predictor, exact_scale=setup is None)  # a tracker tells the scale
        out: list[PathPrediction] = []
        for tension in tensions_of(trajectory, forces)[:robots]:
            previous, beside, left = (out[0] if out else None), None, None
            if setup is not None and forces is not None:
                loads = forces.carried.over_time(trajectory.t, tension)
                beside = placed_along(setup, self.request, trajectory, loads=loads)
                left = setup.unexplained
            out.append(predict(on, trajectory, tension, previous, beside=beside, unexplained=left))
        return tuple(out)

    @property
    def typical(self) -> Spread:
        """Spread of the typical values that the force of the rod depends on."""
        return Spread(()) if self.force_model is None else self.force_model.typical

    @property
    def held(self) -> Array | None:
        """(J,) [rad] by which friction holds the axes where they reverse; None without a force."""
        return None if self.force_model is None else self.force_model.held

    @property
    def space(self) -> Space:
        """The search space of the request with this rod."""
        return space_of(self.request, self.cell.ballbar.stroke)


@dataclass(frozen=True, eq=False)
class Assessment:
    """Outcome for one candidate."""

    candidate: PathCandidate
    violations: tuple[Violation, ...]  # worst first; none: it can be run
    trajectory: Trajectory | None = None  # None where the robot does not reach
    forces: Forces | None = None
    tcp: float = np.inf  # [m] predicted; infinite where it cannot be run
    examined: bool = True  # whether forces and clearance were computed

    @property
    def excess(self) -> float:
        """Sum over all limits; if unexamined, more than that of any examined candidate."""
        return sum(v.excess for v in self.violations) + (0.0 if self.examined else UNEXAMINED)


def evaluators(request: PlanRequest, known: Known | None = None) -> dict[str, Evaluator]:
    """An evaluator for each rod of a request, by its name; known : from results of the machine.

    Raises InputError or DescriptionError for a robot, rod, plate or servo that does not exist, and
    InputError for a robot of fewer axes than a path needs.
    """
    chosen = request.cell
    free = followed(request, chosen.instrument) is not None  # a path as about a wire
    cells = {
        rod: load_measured_cell(chosen.robot, FREE if free else rod, chosen.plate)
        for rod in chosen.rods
    }
    for rod, cell in cells.items():
        if (cell.ballbar.stroke is not None) != request.telescoping:
            keys = ("instrument", "ballbar") if request.telescoping else ("ballbar", "instrument")
            what = "has encoders" if request.telescoping else "measures its length"
            raise InputError(f"cell.{keys[0]} = {rod}: it {what}; name it as cell.{keys[1]}")
    if chosen.instrument is not None:
        sigma = request.sensors.length_sigma_m or load_instrument(chosen.instrument).sigma_length
        if sigma <= 0.0:
            raise InputError(
                f"cell.instrument = {chosen.instrument}: its file states no sigma_m of the length. "
                "Give sensors.length_sigma_m"
            )
        sensors = request.sensors.model_copy(update={"length_sigma_m": sigma})
        request = request.model_copy(update={"sensors": sensors})
    return {rod: evaluator_of(request, rod, cell, known) for rod, cell in cells.items()}


def evaluator_of(
    request: PlanRequest, rod: str, cell: Cell, known: Known | None = None
) -> Evaluator:
    """The evaluator of a request on a given cell; known : from results of the machine.

    Raises InputError for an unknown servo, limits that the robot's structure does not have, or a
    robot of fewer axes than a path needs.
    """
    if cell.robot.joints < LEAST_AXES:
        raise InputError(
            f"robot {cell.robot.name} has {cell.robot.joints} axes; a path of the tool in place "
            f"and direction needs {LEAST_AXES}. Plan still poses (ballbar-pose-plan/1)."
        )
    closed = has_closed_form(nominal_chain(cell.robot))
    wrong, right = (OF_OTHER_ARMS, OF_CLOSED_FORM) if closed else (OF_CLOSED_FORM, OF_OTHER_ARMS)
    if stated := [key for key in wrong if key in request.limits.model_fields_set]:
        raise InputError(
            f"limits.{stated[0]}: robot {cell.robot.name} is {'' if closed else 'not '}built as an "
            "IRB 2400, parallel axes 2 and 3 and a spherical wrist; give "
            f"limits.{', '.join(right)} instead"
        )
    on = predictor(cell, request.sensors, request.timing, request.workspace, known=known)
    setup, forces = followed(request, request.cell.instrument), None
    if cell.ballbar.stroke is None:
        forces = force_model(cell, request.servo, seed=request.seed)
    nominal = nominal_geometry(cell, np.zeros(3))  # the columns do not depend on the base pose
    layout, x = planned_unknowns(on, nominal, ())
    robot = IdentifiedRobot(cell, nominal, on.corrections, x[layout.coefficients])
    moves = robot.jacobian(on.grid, layout.shared)
    columns = aligned_columns(robot.tool(on.grid), moves)
    gram = columns.T @ columns
    return Evaluator(
        request=request,
        rod=rod,
        limits=tightened(request.limits),
        cell=cell,
        predictor=on,
        force_model=forces,
        stroke_model=None if setup else stroke_model(cell, seed=request.seed),
        clearance=clearance(cell, request.cell),
        gram=np.asarray(np.triu(gram) + np.triu(gram, 1)),
        coarse=coarse_predictor(on),
        followed=setup,
        beside=followed(request, request.cell.tracker),
    )


def objective(evaluator: Evaluator, genome: Array, *, robots: int = SEARCH_ROBOTS) -> float:
    """Objective of a genome (S,) [-]: natural logarithm of the TCP sigma in um.

    Where the candidate cannot be run, the objective is above INFEASIBLE or SCREENED_OUT and grows
    with the violation.
    """
    space = evaluator.space
    cell, around = evaluator.cell, evaluator.request.cell
    excess = float(screen(cell, around, space, evaluator.limits, genome[None]).excess[0])
    if excess > 0.0:
        return SCREENED_OUT + excess
    outcome = evaluate(evaluator, space.candidate(genome), robots=robots)
    return INFEASIBLE + outcome.excess if outcome.violations else float(np.log(outcome.tcp * 1e6))


def evaluate(evaluator: Evaluator, candidate: PathCandidate, *, robots: int = ROBOTS) -> Assessment:
    """Violated limits of a candidate and, if there are none, its predicted uncertainty.

    robots : how many robots of ballbar.planning.force enter the prediction.
    """
    best = check(evaluator, candidate)
    if best.violations or best.trajectory is None:
        return best
    tcp = [
        tcp_rms(evaluator, prediction)
        for prediction in evaluator.predictions(best.trajectory, best.forces, robots=robots)
    ]
    mean = float(np.sqrt(np.mean(np.square(tcp))))
    return Assessment(candidate, (), best.trajectory, best.forces, mean)


def tensions_of(trajectory: Trajectory, forces: Forces | None) -> Array:
    """(R, N) [N] of the rod with each robot; of one robot, and zero, where there is no force."""
    return np.zeros((1, trajectory.t.size)) if forces is None else forces.tension


def check(evaluator: Evaluator, candidate: PathCandidate) -> Assessment:
    """The arm configuration that violates least, without a prediction of its uncertainty."""
    cell, limits, around, best = evaluator.cell, evaluator.limits, evaluator.request.cell, None
    for trajectory in trajectories(cell, candidate, evaluator.request.timing):
        violated, forces = violations(cell, limits, trajectory, around, evaluator.held), None
        # Forces and clearance count before the motion is feasible: a search would stop where it
        # becomes so.
        examined = sum(v.excess for v in violated) < NEARLY
        if examined:
            if evaluator.force_model is not None:
                forces = predicted_forces(evaluator.force_model, trajectory)
            violated += _violations_when_loaded(evaluator, trajectory, forces)
        violated.sort(key=lambda v: -v.excess)
        outcome = Assessment(candidate, tuple(violated), trajectory, forces, examined=examined)
        if not violated:
            return outcome
        if best is None or outcome.excess < best.excess:
            best = outcome
    unreached = Violation("reach", UNREACHED, "the robot does not reach all of it")
    return best or Assessment(candidate, (unreached,), examined=False)


def _violations_when_loaded(
    evaluator: Evaluator, trajectory: Trajectory, forces: Forces | None
) -> Iterator[Violation]:
    """Violations of the limits of force and clearance."""
    limit, clear = evaluator.limits.force_N, evaluator.limits.clearance_m
    if forces is not None and (largest := float(forces.magnitude.max())) > limit:
        at = trajectory.t[int(forces.magnitude.argmax())]
        text = f"{largest:.0f} N in the rod at t = {at:.1f} s, limit {limit:g}"
        yield Violation("force_N", float(np.log(largest / limit)), text)
    motion = (trajectory.nominal, trajectory.q, trajectory.b, trajectory.t)
    closest = evaluator.clearance.nearest(*motion, within=clear)
    if closest.distance < clear:
        text = (
            f"{closest.pair} {closest.distance * 1e3:.0f} mm apart at t = {closest.t:.1f} s, "
            f"limit {clear * 1e3:g}"
        )
        yield Violation("clearance_m", (clear - closest.distance) / UNIT_CLEARANCE, text)


def tcp_rms(evaluator: Evaluator, prediction: PathPrediction) -> float:
    """[m] root mean square of `PathPrediction.tcp_sigma` over the grid, without the covariance."""
    if prediction.target:
        return rms(prediction.tcp_sigma)
    return rms_of_normal(evaluator, prediction.normal, prediction.layout)


def tcp_rms_before(evaluator: Evaluator) -> float:
    """[m] the same before any path: by the priors, and by what results say."""
    on = evaluator.predictor
    layout, _ = planned_unknowns(on, nominal_geometry(on.cell, np.zeros(3)), ())
    return rms_of_normal(evaluator, before(on, layout), layout)


def rms_of_normal(evaluator: Evaluator, normal: Array, layout: Unknowns) -> float:
    """[m] root mean square of the predicted TCP sigma by an information matrix (P, P).

    normal : its upper triangle counts.
    """
    machine, s = layout.machine, 1.0 / np.sqrt(np.diag(normal))
    factor, wrong = dpotrf(np.asfortranarray(normal * np.outer(s, s)), overwrite_a=True)
    if wrong:
        raise np.linalg.LinAlgError("the information matrix is not positive definite")
    covariance, _ = dpotri(factor, overwrite_c=True)
    products = evaluator.gram * covariance[np.ix_(machine, machine)]
    return float(np.sqrt(s[machine] @ products @ s[machine] / len(evaluator.predictor.grid)))
