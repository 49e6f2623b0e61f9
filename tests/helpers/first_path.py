"""The first path of the planning request of the IRB 2400 that can be run, before any search."""

from __future__ import annotations

from functools import cache

from ballbar.planning.candidate import PathCandidate, rounded, space_of
from ballbar.planning.evaluation import Evaluator, evaluators
from ballbar.planning.plan import first_path
from ballbar.planning.request import load_request
from tests.helpers.simulated_recordings import SCENARIOS


@cache
def first_runnable() -> tuple[Evaluator, PathCandidate]:
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    given = evaluators(requested)
    start, _ = first_path(given)
    return given[start.rod], rounded(space_of(requested).candidate(start.genome))
