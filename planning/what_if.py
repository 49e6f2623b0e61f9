"""Predicted TCP error on the same path with one property of the rig changed (what-if analysis).

A path that the changed rig cannot run (another rod, another plate) is adapted: the nearest path
that it can run, with the ball-bar moved if necessary.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.ident.robot.tcp_uncertainty import scale_error
from ballbar.planning.candidate import PathCandidate, genome_of
from ballbar.planning.evaluation import INFEASIBLE, Evaluator, evaluate, evaluator_of
from ballbar.planning.plan import PathPlan, descent
from ballbar.planning.questions import Question, changed
from ballbar.planning.workspace import Region

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
    known, candidate = plan.evaluator.predictor.known, plan.evaluation.candidate
    for item in questions:
        for value in item.values:
            request, cell = changed(plan.request, plan.evaluator.cell, item.key, value)
            evaluator = evaluator_of(request, plan.rod, cell, known)
            if isinstance(value, tuple):
                text = " ".join(f"b{joint}" for joint in value)
            else:
                text = f"{value:g} {item.unit}"
            outcome, note = evaluate(evaluator, candidate), ""
            tcp: float | None = outcome.tcp
            if outcome.violations:
                adapted = _adapted(evaluator, candidate)
                tcp, note = None, f"no path: {outcome.violations[0].sentence}"
                if adapted is not None:
                    tcp, note = evaluate(evaluator, adapted).tcp, "path adapted"
            yield Answer(item.key, text, tcp, scale_error(cell, evaluator.predictor.grid), note)


def _adapted(evaluator: Evaluator, candidate: PathCandidate) -> PathCandidate | None:
    """The nearest candidate that the evaluator's rig can run; None if none was found."""
    centre, request = candidate.position, evaluator.request
    region = Region(lower=tuple((centre - ROOM).tolist()), upper=tuple((centre + ROOM).tolist()))
    cell = request.cell.model_copy(update={"ballbar_position_m": None, "ballbar_region_m": region})
    freed = replace(evaluator, request=request.model_copy(update={"cell": cell}))
    space = freed.space
    best, least = descent(freed, space, genome_of(space, candidate), ADAPTING_SEED)
    return space.candidate(best) if least < INFEASIBLE else None
