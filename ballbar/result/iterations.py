"""The iterations of an identification, in order, each with the stage in which it was made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ident.estimator.iteration import Iteration
from ident.options import Listener


@dataclass(frozen=True, eq=False)
class Step:
    """One iteration, and the stage that the identifier had announced."""

    stage: str
    iteration: Iteration


class IterationLog:
    """Records the stages and iterations of an identification, and passes them on."""

    def __init__(
        self, progress: Callable[[str], None], on_step: Callable[[int, Step], None] | None = None
    ) -> None:
        """progress : called with every stage; on_step : with every step and its number, from 1."""
        self._progress, self._on_step = progress, on_step
        self._stage = ""
        self.steps: list[Step] = []
        self.listener = Listener(self._begin_stage, self._add)

    def _begin_stage(self, sentence: str) -> None:
        self._stage = sentence
        self._progress(sentence)

    def _add(self, iteration: Iteration) -> None:
        self.steps.append(Step(self._stage, iteration))
        if self._on_step:
            self._on_step(len(self.steps), self.steps[-1])
