"""Damped Gauss-Newton on normal equations.

Minimise `F(x) = |r(x)|^2` from normal equations `N = J'J`, `g = J'r`. Each step is the Gauss-Newton
step; where it does not lower the cost it is halved (`halved`; Björck 1996, sec. 9.2), or turned
towards the gradient (`Marquardt`; Levenberg 1944, Marquardt 1963), as the thesis did. Weights are
frozen within an iteration, so a trial step is judged by the cost that it was made for. The search
ends when the full step predicts a negligible decrease, or when an accepted one brought it.

A Jacobian may serve more than one step: near the minimum, where a step leaves less than QUICK of
the predicted decrease, a new one would hardly change the next.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from ballbar.cell.arrays import Array
from ballbar.cell.errors import FailureError

# Added to the diagonal of the normal matrix, scaled to one: keeps a direction that nothing
# determines at rounding level instead of failing.
ROUNDING = 1e-12
LEAST_SHARE = 1e-4  # of the Gauss-Newton step: a shorter one is rounding, or a wall
FIRST_DAMPING, MAX_DAMPING = 1e-6, 1e6  # of Marquardt, in units of the scaled diagonal
RAISE, LOWER = 10.0, 0.01  # its factors after a refused and an accepted step
QUICK = 1e-2


class SingularError(FailureError):
    """The normal equations have no finite solution: the model is far away from any mechanism."""


class Equations(Protocol):
    """Normal equations at one value of the unknowns."""

    @property
    def normal(self) -> Array:
        """(P, P)"""

    @property
    def gradient(self) -> Array:
        """(P,) of half the cost"""

    @property
    def cost(self) -> float: ...

    @property
    def equations(self) -> int: ...


class TrialStep(Protocol):
    """A trial step: where it leads, and the cost there."""

    @property
    def x(self) -> Array: ...

    @property
    def cost(self) -> float: ...


EquationsT = TypeVar("EquationsT", bound=Equations)
TrialT = TypeVar("TrialT", bound=TrialStep)


class Problem(Protocol[EquationsT, TrialT]):
    """A least-squares problem that the loop minimises."""

    def start(self) -> EquationsT:
        """The normal equations where the search begins."""

    def trial(self, equations: EquationsT, step: Array, /) -> TrialT:
        """The cost after a step (P,), under the weights of the equations."""

    def accept(self, equations: EquationsT, accepted: TrialT, iterations: int, /) -> EquationsT:
        """New normal equations at an accepted trial."""

    def reuse(self, equations: EquationsT, accepted: TrialT, /) -> EquationsT:
        """The normal equations at an accepted trial with the present Jacobian."""


class Search(Protocol):
    """Finds a step that lowers the cost, starting from the Gauss-Newton step."""

    def __call__(
        self, problem: Problem[EquationsT, TrialT], current: EquationsT, step: Array, /
    ) -> tuple[TrialT | None, Array]:
        """An accepted trial and its step (P,); no trial where no step lowers the cost."""


@dataclass(frozen=True)
class Stop:
    """When the search ends."""

    decrease: float = 0.0  # predicted decrease, in units of the cost per degree of freedom
    whitened: bool = True  # then that unit is at least 1: a small cost is no reason to go on
    step: float = 0.0  # largest component of the full step [m, rad]
    relative: float = 0.0  # decrease of the cost, or size of the step, against their own size

    def enough(self, equations: Equations) -> float:
        """Decrease of the cost that is negligible."""
        unit = equations.cost / max(1, equations.equations - len(equations.gradient))
        return self.decrease * (max(1.0, unit) if self.whitened else unit)


@dataclass(frozen=True)
class Minimum(Generic[EquationsT]):
    """Where the search ended."""

    equations: EquationsT
    iterations: int  # accepted steps
    converged: bool
    stuck: bool  # no step lowers the cost any more: rounding, or a wall
    given_up: bool = False


def minimise(
    problem: Problem[EquationsT, TrialT],
    stop: Stop,
    *,
    max_iterations: int,
    reuse_below: float = 0.0,
    search: Search | None = None,
    give_up: Callable[[EquationsT, int], bool] = lambda *_: False,
) -> Minimum[EquationsT]:
    """Minimise from the problem's start.

    reuse_below : predicted decrease for each unknown, in units of the cost per degree of freedom,
        below which the Jacobian holds as far as its step goes; 0 for a new one at every step.
    search : what becomes of a step that does not lower the cost; by default `halved`.
    give_up : whether to end after so many iterations, as what will be found is of no use.

    Raises SingularError where the normal equations have no finite solution.
    """
    iterations = 0
    current = problem.start()
    step, predicted = gauss_newton_step(current)
    first = predicted  # of the present Jacobian
    settled = stuck = given_up = False
    while True:
        enough = stop.enough(current)
        converged = settled or predicted < enough or bool(np.abs(step).max() < stop.step)
        given_up = not converged and give_up(current, iterations)
        if converged or given_up or iterations == max_iterations:
            break
        accepted, step = (search or halved)(problem, current, step)
        if accepted is None:
            stuck = True
            break
        iterations += 1
        gained = current.cost - accepted.cost
        settled = gained < enough or (
            gained <= stop.relative * current.cost
            or bool(np.linalg.norm(step) <= stop.relative * np.linalg.norm(accepted.x))
        )
        before = predicted
        if first <= reuse_below * len(current.gradient) * _unit(current):
            reused = problem.reuse(current, accepted)
            step, predicted = gauss_newton_step(reused)
            if predicted <= max(stop.enough(reused), QUICK * before):
                current = reused
                continue
        current = problem.accept(current, accepted, iterations)
        step, predicted = gauss_newton_step(current)
        first = predicted
    return Minimum(current, iterations, converged, stuck, given_up)


def halved(
    problem: Problem[EquationsT, TrialT], current: EquationsT, step: Array
) -> tuple[TrialT | None, Array]:
    """The longest of the halved steps that lowers the cost, and its trial; none if none does."""
    share = 1.0
    tried = problem.trial(current, step)
    while tried.cost >= current.cost and share > LEAST_SHARE:
        share *= 0.5
        tried = problem.trial(current, share * step)
    return (None if tried.cost >= current.cost else tried), share * step


class Marquardt:
    """Steps with a damping on the scaled diagonal that grows while they do not lower the cost.

    The damping is kept from iteration to iteration, so one object serves one minimisation.
    """

    def __init__(self) -> None:
        self._damping = ROUNDING

    def __call__(
        self, problem: Problem[EquationsT, TrialT], current: EquationsT, step: Array
    ) -> tuple[TrialT | None, Array]:
        """The first damped step that lowers the cost, and its trial; none if none does."""
        while self._damping <= MAX_DAMPING:
            scale, scaled = _scaled(current.normal, self._damping)
            step = -scale * _solved(scaled, scale * current.gradient)
            tried = problem.trial(current, step)
            if tried.cost < current.cost:
                self._damping = max(ROUNDING, self._damping * LOWER)
                return tried, step
            self._damping = max(FIRST_DAMPING, self._damping * RAISE)
        return None, step


def _unit(equations: Equations) -> float:
    return max(1.0, equations.cost / max(1, equations.equations - len(equations.gradient)))


def gauss_newton_step(equations: Equations) -> tuple[Array, float]:
    """(P,) the Gauss-Newton step, and the decrease of the cost that it predicts."""
    scale, scaled = _scaled(equations.normal)
    step = -scale * _solved(scaled, scale * equations.gradient)
    return step, float(-(equations.gradient @ step))


def inverse(normal: Array) -> Array:
    """(P, P) inverse of a normal matrix (P, P).

    A direction that nothing determines gets a variance at rounding level, not an exception.
    """
    scale, scaled = _scaled(normal)
    return _solved(scaled, np.eye(len(normal))) * np.outer(scale, scale)


def _scaled(normal: Array, damping: float = ROUNDING) -> tuple[Array, Array]:
    """(P,) scale that gives the diagonal of a normal matrix unit size, and the scaled matrix.

    damping : added to its diagonal.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    scaled = normal * np.outer(scale, scale)
    scaled.flat[:: len(scaled) + 1] += damping
    return scale, scaled


def _solved(matrix: Array, right: Array) -> Array:
    """Solution of a positive definite system (P, P) for (P,) or (P, K)."""
    finite = bool(np.isfinite(matrix).all() and np.isfinite(right).all())
    factor, minor = dpotrf(matrix) if finite else (matrix, -1)  # scipy's own functions check more
    if minor != 0:
        error = f"{minor}-th leading minor is not positive definite" if finite else "not finite"
        raise SingularError(
            f"the fit cannot be linearised: {error}. "
            "Check the start values and the recording, or identify fewer parameters"
        )
    return np.asarray(dpotrs(factor, right)[0])
