"""What-if analysis: predicted TCP error on the same path with one property of the rig changed.

A path that the changed rig cannot run (another rod, another plate) is adapted: the nearest path
that it can run, with the ball-bar moved if necessary.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.robot.tcp_uncertainty import scale_error
from planning.candidate import PathCandidate, genome_of, space_of
from planning.evaluation import INFEASIBLE, Evaluator, evaluate, evaluator_of
from planning.first import descent
from planning.plan import PathPlan
from planning.questions import CHANGES, Question
from planning.workspace import Region

ROOM = 0.3  # [m] by which the ball-bar may move when a path is adapted
ADAPTING_SEED = 1  # any; fixed, so that an answer can be repeated


@dataclass(frozen=True)
class Answer:
    """Predicted error for one value of a property."""

    key: str
    value: str
    tcp: float | None  # [m] root mean square of the predicted TCP sigma; None: no path was found
    scale: float  # [m] error from the scale
    note: str

    @property
    def total(self) -> float | None:
        """[m] root sum of squares of both."""
        return None if self.tcp is None else float(np.hypot(self.tcp, self.scale))


def answers(plan: PathPlan, questions: Sequence[Question]) -> Iterator[Answer]:
    """The answer for each value of each question, in their order."""
    request, cell = plan.request, plan.evaluator.cell
    for item in questions:
        for value in item.values:
            changed, other = request, cell
            if isinstance(value, tuple):
                sensors = request.sensors.model_copy(update={"encoders": value})
                changed = request.model_copy(update={"sensors": sensors})
                shown = " ".join(f"b{j}" for j in value)
            else:
                changed, other = CHANGES[item.key].change(request, cell, value)
                shown = f"{value:g} {item.unit}"
            evaluator = evaluator_of(changed, plan.rod, other, plan.evaluator.predictor.known)
            yield _answer(item.key, shown, evaluator, plan.evaluation.candidate)


def _answer(key: str, shown: str, evaluator: Evaluator, candidate: PathCandidate) -> Answer:
    scale, note = scale_error(evaluator.cell, evaluator.predictor.grid), ""
    outcome = evaluate(evaluator, candidate)
    if outcome.violations:
        first = outcome.violations[0].sentence
        adapted = _adapted(evaluator, candidate)
        if adapted is None:
            return Answer(key, shown, None, scale, f"no path: {first}")
        outcome, note = evaluate(evaluator, adapted), "path adapted"
    return Answer(key, shown, outcome.tcp, scale, note)


def _adapted(evaluator: Evaluator, candidate: PathCandidate) -> PathCandidate | None:
    """The nearest candidate that the evaluator's rig can run; None if none was found."""
    centre, request = candidate.position, evaluator.request
    region = Region(lower=tuple((centre - ROOM).tolist()), upper=tuple((centre + ROOM).tolist()))
    cell = request.cell.model_copy(update={"ballbar_position_m": None, "ballbar_region_m": region})
    freed = replace(evaluator, request=request.model_copy(update={"cell": cell}))
    space = space_of(freed.request)
    best, least = descent(freed, space, genome_of(space, candidate), ADAPTING_SEED)
    return space.candidate(best) if least < INFEASIBLE else None
