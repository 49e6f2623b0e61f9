"""Does a stored calibration still hold? Single causes of a change, weighed by one score.

Something was measured today of a machine that is held as it was stored. Whitened, and freed of the
unknowns that belong to today alone (seats, base pose, clock), it is a vector of unit covariance
about zero where nothing changed. Each single cause moves it along columns of its own, and has a
prior of its size; its evidence is the Bayes factor of that cause against no change (Kass & Raftery
1995), in closed form as all of it is linear and Gaussian. The likeliest is taken away and what was
measured fitted again, until what is left is as of an unchanged machine: one of a milliradian is not
linear.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeVar

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.priors import with_tails
from ballbar.ident.single_causes import Cause, Explanation

FALSE_ALARMS = 0.02  # share of checks of an unchanged machine that call it changed
DRAWS, SEED = 20000, 1  # of the distribution for an unchanged machine
# Logarithm of the factor by which a cause must be likelier than the next, and by which a second
# change beside it must not be likelier than none: 20, strong evidence after Kass & Raftery 1995.
RIVAL = 3.0
ROUNDS = 4  # of taking a change away and fitting again
MANY = 3  # causes that are named together at most
WIDENINGS = 3  # of the prior of a size that is beyond it
SEEN = 4.0  # deviations by which a change must stand out
LARGEST = 0.1  # [rad] of a zero: no larger change is stated


@dataclass(frozen=True, eq=False)
class Score:
    """Today's measurement of a held machine, of unit covariance where nothing changed."""

    value: Array  # (W,)
    whitened: Callable[[Array], Array]  # of a cause's columns (C, K) how they move it (W, K)

    def moved(self, cause: Cause) -> Array:
        """(W, K) its change for a standard deviation of each unit of a cause."""
        return self.whitened(cause.columns) * cause.prior

    def explanation(self, cause: Cause) -> Explanation:
        """The cause with its size by generalised least squares, and its evidence.

        The prior has the tails of Student's distribution: a zero that was lost may be far off.
        """
        columns, prior = self.whitened(cause.columns), cause.prior
        for _ in range(WIDENINGS):
            moved = columns * prior
            scaled, right = moved.T @ moved + np.eye(prior.size), moved.T @ self.value
            covariance = np.linalg.inv(scaled)
            far = covariance @ right
            size, sigma = prior * far, prior * np.sqrt(np.diag(covariance))
            evidence = 0.5 * float(right @ far - np.linalg.slogdet(scaled)[1])
            gain = float(right @ far + far @ far)
            prior = with_tails(cause.prior, size)
        return Explanation(cause, size, sigma, evidence, gain)

    def unseen(self, cause: Cause, deviations: float = SEEN) -> float:
        """Size of a cause of one unit that stands out by so much, whatever its prior."""
        moved = float(np.linalg.norm(self.whitened(cause.columns)))
        return deviations / moved if moved > 0.0 else np.inf

    def ranked(self, causes: Sequence[Cause]) -> list[Explanation]:
        """Every cause, the best first."""
        return sorted((self.explanation(cause) for cause in causes), key=lambda e: -e.evidence)

    def beside(self, cause: Cause) -> Score:
        """The score without all that a cause can explain, its size unknown within its prior."""
        moved = self.moved(cause)
        root = np.linalg.cholesky(np.eye(self.value.size) + moved @ moved.T)
        return Score(
            np.linalg.solve(root, self.value),
            lambda columns: np.asarray(np.linalg.solve(root, self.whitened(columns))),
        )

    def limit(self, causes: Sequence[Cause], freedom: int) -> float:
        """Largest evidence of any cause, exceeded in FALSE_ALARMS of draws without a change.

        freedom : degrees, with which the covariance is known; the draws have the tails of Student's
        t.
        """
        rng = np.random.default_rng(SEED)
        drawn = rng.standard_normal((DRAWS, self.value.size))
        drawn *= np.sqrt(freedom / rng.chisquare(freedom, DRAWS))[:, None]
        best = np.full(DRAWS, -np.inf)
        for cause in causes:
            moved = self.moved(cause)
            scaled, right = moved.T @ moved + np.eye(cause.prior.size), drawn @ moved
            gain = (right * np.linalg.solve(scaled, right.T).T).sum(axis=1)
            best = np.maximum(best, 0.5 * (gain - np.linalg.slogdet(scaled)[1]))
        return float(np.quantile(best, 1.0 - FALSE_ALARMS))


class HeldMeasurement(Protocol):
    """Today's measurement, fitted to a machine that is held."""

    @property
    def score(self) -> Score:
        """Its evidence about the machine."""

    def after(self, change: Explanation) -> Self:
        """The same with a machine, or with what was measured, after a change."""

    def explained(self, cause: Cause) -> bool:
        """Whether nothing speaks for a second change beside a cause of any size."""


MeasurementT = TypeVar("MeasurementT", bound=HeldMeasurement)


def followed(start: MeasurementT, best: Explanation) -> tuple[MeasurementT, Explanation, bool]:
    """A change taken away: what is left, its whole size, and whether it explains all."""
    now, step, size = start, best, best.size
    for _ in range(ROUNDS):
        now = now.after(step)
        step = now.score.explanation(best.cause)
        size = size + step.size
        if now.explained(best.cause):
            return now, replace(best, size=size), True
    return now, replace(best, size=size), False


@dataclass(frozen=True, eq=False, kw_only=True)
class Verification:
    """A stored calibration against what was measured today, one recording or some still poses."""

    name: str
    error: Array  # (N,) [m] by which the poses, or the samples' loops, are off
    numbers: str  # how far they are, and what is expected of an unchanged machine
    figures: Mapping[str, float]  # the same, SI
    unchanged: bool  # whether nothing speaks for a change
    explanations: tuple[Explanation, ...]  # best first; of still poses none where it holds
    single: bool  # whether the first explains all, and nothing speaks for a second change beside it
    tried: str  # kinds of causes, in words
    square: float  # sum of squares of what was measured, whitened
    limit: float  # of what speaks for a change, exceeded in FALSE_ALARMS of unchanged machines
    blind: Mapping[int, float]  # axes, and the size [rad] up to which a change of zero is unseen
    doubt: str = ""  # why nothing can be said; empty where something can
    notes: tuple[str, ...] = ()  # on what does not count
    holding: str = "Holds"  # what is said of an unchanged machine
    remarks: tuple[str, ...] = ()  # on temperatures and on the reading

    @property
    def comparable(self) -> bool:
        """Whether the stored calibration can be held against what was measured."""
        return not self.doubt

    @property
    def holds(self) -> bool:
        return self.unchanged and self.comparable

    @property
    def named(self) -> tuple[Explanation, ...]:
        """The cause; several where they explain it about as well, none where none does.

        A target that explains more than the best is among them, whatever its three unknowns make it
        less likely: the zero of an axis may be a part of what it did.
        """
        if self.unchanged or not self.comparable or not self.single:
            return ()
        best = self.explanations[0]
        rivals = tuple(
            e
            for e in self.explanations
            if e.evidence > best.evidence - RIVAL
            or (e.cause.kind == "target" and e.gain >= best.gain)
        )
        return rivals if len(rivals) <= MANY else ()

    @property
    def sentence(self) -> str:
        """Whether it holds, and what changed."""
        if self.doubt:
            return f"Not comparable: {self.doubt}; {self.numbers}."
        if self.unchanged:
            return f"{self.holding}: {self.numbers}."
        each = ", or ".join(explanation.sentence for explanation in self.named)
        if [explanation.cause.kind for explanation in self.named] == ["pose"]:
            return (
                f"One pose stands out, {each}; the others agree with the calibration. Measure it "
                f"again. {self.numbers}."
            )
        if self.named:
            tail = "; what was measured does not tell which" if len(self.named) > 1 else ""
            return f"Changed since: {each}{tail}; {self.numbers}."
        return (
            f"Changed: {self.numbers}. No single cause ({self.tried}, another parameter) explains "
            "it clearly: identify again."
        )

    @property
    def warnings(self) -> list[str]:
        """Rows that do not count, changes that cannot be seen, and remarks."""
        each = ", ".join(
            f"{axis} ({size * 1e3:.1f} mrad)" if size < LARGEST else f"{axis} (any)"
            for axis, size in self.blind.items()
        )
        unseen = (
            "changes of the zeros of these axes, up to the size named, would not show in what was "
            f"measured: {each}"
        )
        return [*self.notes, *([unseen] if self.blind else []), *self.remarks]
