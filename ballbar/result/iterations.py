"""The iterations of an identification, kept in order with the stage in which each was made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ident.estimator.iteration import Iteration


@dataclass(frozen=True, eq=False)
class Step:
    """One iteration, and what the identifier said that it was doing."""

    stage: str
    iteration: Iteration


class IterationLog:
    """Hears the stages (`progress`) and iterations (`on_iteration`) of an identification, and hands them on."""

    def __init__(
        self,
        progress: Callable[[str], None],
        on_iteration: Callable[[int, Step], None] | None = None,
    ) -> None:
        """progress : hears every stage too. on_iteration : hears every iteration too, with its number from 1."""
        self._progress, self._watch = progress, on_iteration
        self._stage = ""
        self.steps: list[Step] = []

    def progress(self, sentence: str) -> None:
        """The identifier begins a stage."""
        self._stage = sentence
        self._progress(sentence)

    def on_iteration(self, iteration: Iteration) -> None:
        """A solver has made a step."""
        self.steps.append(Step(self._stage, iteration))
        if self._watch:
            self._watch(len(self.steps), self.steps[-1])
