"""Damped Gauss-Newton on problems whose minimum is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.ident.estimator.gauss_newton import (
    ROUNDING,
    Marquardt,
    Search,
    SingularError,
    Stop,
    gauss_newton_step,
    halved,
    inverse,
    minimise,
)

EXACT = Stop(decrease=1e-12, whitened=False)
BOTH = pytest.mark.parametrize("search", [lambda: halved, Marquardt], ids=["halved", "Marquardt"])


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations at x, and the Jacobian that they came from."""

    x: Array
    residual: Array
    jacobian: Array  # (M, P)

    @property
    def normal(self) -> Array:
        return np.asarray(self.jacobian.T @ self.jacobian)

    @property
    def gradient(self) -> Array:
        return np.asarray(self.jacobian.T @ self.residual)

    @property
    def cost(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def equations(self) -> int:
        return self.residual.size


@dataclass(frozen=True, eq=False)
class Residuals:
    """A problem given by its residual r(x) and Jacobian; counts what it is asked for."""

    residual: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    begin: Array
    calls: list[str] = field(default_factory=list)

    def at(self, x: Array) -> Equations:
        return Equations(x, self.residual(x), self.jacobian(x))

    def start(self) -> Equations:
        return self.at(self.begin)

    def trial(self, equations: Equations, step: Array) -> Equations:
        self.calls.append("trial")
        return self.at(equations.x + step)

    def accept(self, _equations: Equations, accepted: Equations, _iterations: int) -> Equations:
        self.calls.append("accept")
        return accepted

    def reuse(self, equations: Equations, accepted: Equations) -> Equations:
        self.calls.append("reuse")
        return replace(accepted, jacobian=equations.jacobian)


def linear(matrix: Array, right: Array, begin: Array) -> Residuals:
    return Residuals(lambda x: matrix @ x - right, lambda _: matrix, begin)


def line_of_arctan(begin: float) -> Residuals:
    """r = arctan(x): from |x| > 1.39 full Gauss-Newton steps overshoot further and further."""
    return Residuals(np.arctan, lambda x: np.diag(1.0 / (1.0 + x * x)), np.array([begin]))


# Misra1a of the NIST Statistical Reference Datasets: data and certified values (least squares of
# b1 (1 - exp(-b2 x)), both starting points of the page, certified sum of squares).
MISRA_X = np.fromstring(
    "77.6 114.9 141.1 190.8 239.9 289.0 332.8 378.4 434.8 477.3 536.8 593.1 689.1 760.0", sep=" "
)
MISRA_Y = np.fromstring(
    "10.07 14.73 17.94 23.93 29.61 35.18 40.02 44.82 50.76 55.05 61.01 66.40 75.47 81.78", sep=" "
)
MISRA_FAR, MISRA_NEAR = (500.0, 1e-4), (250.0, 5e-4)
CERTIFIED, CERTIFIED_COST = np.array([2.3894212918e02, 5.5015643181e-04]), 1.2455138894e-01
CERTIFIED_SIGMA = np.array([2.7070075241e00, 7.2668688436e-06])


def misra(begin: tuple[float, float] = MISRA_FAR) -> Residuals:
    def jacobian(x: Array) -> Array:
        wave = np.exp(-x[1] * MISRA_X)
        return np.column_stack((1.0 - wave, x[0] * MISRA_X * wave))

    def residual(x: Array) -> Array:
        return np.asarray(x[0] * (1.0 - np.exp(-x[1] * MISRA_X)) - MISRA_Y)

    return Residuals(residual, jacobian, np.array(begin))


def test_a_linear_problem_is_solved_in_one_step() -> None:
    rng = np.random.default_rng(1)
    matrix, right = rng.standard_normal((20, 4)), rng.standard_normal(20)
    end = minimise(linear(matrix, right, np.full(4, 5.0)), EXACT, max_iterations=10)
    assert (end.converged, end.stuck, end.iterations) == (True, False, 1)
    expected = np.linalg.lstsq(matrix, right)[0]
    # What is added to the diagonal leaves a relative error of that size.
    assert end.equations.x == pytest.approx(expected, abs=1e-10)


def test_a_search_that_is_given_up_ends_where_it_is() -> None:
    """One that has converged is not given up, whatever is asked then."""
    asked = []

    def after_two(equations: Equations, iterations: int) -> bool:
        asked.append((iterations, equations.cost))
        return iterations >= 2

    end = minimise(misra(), EXACT, max_iterations=50, give_up=after_two)
    assert (end.given_up, end.converged, end.iterations) == (True, False, 2)
    assert [iterations for iterations, _ in asked] == [0, 1, 2]
    assert asked[-1][1] == end.equations.cost > 2.0 * CERTIFIED_COST
    at_end = minimise(
        misra(tuple(CERTIFIED)), Stop(step=1.0), max_iterations=50, give_up=lambda *_: True
    )
    assert (at_end.given_up, at_end.converged) == (False, True)


def test_units_of_an_unknown_do_not_change_the_step() -> None:
    rng = np.random.default_rng(2)
    matrix, right = rng.standard_normal((20, 3)), rng.standard_normal(20)
    unit = np.array([1e-6, 1.0, 1e5])
    plain = gauss_newton_step(Equations(np.zeros(3), right, matrix))
    scaled = gauss_newton_step(Equations(np.zeros(3), right, matrix * unit))
    assert scaled[0] * unit == pytest.approx(plain[0], rel=1e-9)
    assert scaled[1] == pytest.approx(plain[1], rel=1e-9)


def test_the_predicted_decrease_of_a_linear_problem_is_its_actual_one() -> None:
    rng = np.random.default_rng(3)
    problem = linear(rng.standard_normal((20, 3)), rng.standard_normal(20), np.zeros(3))
    now = problem.start()
    step, predicted = gauss_newton_step(now)
    assert predicted == pytest.approx(now.cost - problem.at(step).cost, rel=1e-9)


def test_a_direction_that_nothing_determines_stays_finite_and_the_others_are_found() -> None:
    rng = np.random.default_rng(4)
    matrix, right = rng.standard_normal((20, 4)), rng.standard_normal(20)
    matrix[:, 3] = matrix[:, 0] - 2.0 * matrix[:, 1]
    end = minimise(linear(matrix, right, np.ones(4)), EXACT, max_iterations=10)
    best, (cost,) = np.linalg.lstsq(matrix[:, :3], right)[:2]
    assert end.equations.cost == pytest.approx(cost, rel=1e-9)
    # It moves no further than the others: the sum of the pair is determined, their split is damped.
    assert np.abs(end.equations.x - 1.0).max() < 3.0 * np.abs(best - 1.0).max()
    assert end.equations.x[2] == pytest.approx(best[2], abs=1e-6)


def test_an_unknown_without_any_column_stays_where_it_is() -> None:
    matrix, right = np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([1.0, 1.0])
    end = minimise(linear(matrix, right, np.array([0.0, 7.0])), EXACT, max_iterations=5)
    assert end.equations.x == pytest.approx([0.6, 7.0])


@BOTH
def test_a_step_that_overshoots_is_made_shorter_until_it_lowers_the_cost(
    search: Callable[[], Search],
) -> None:
    problem = line_of_arctan(3.0)
    end = minimise(problem, Stop(decrease=1e-15), max_iterations=30, search=search())
    assert end.converged
    assert abs(end.equations.x[0]) < 1e-6
    assert problem.calls.count("trial") > end.iterations


@pytest.mark.parametrize("begin", [MISRA_FAR, MISRA_NEAR])
@BOTH
def test_a_certified_problem_of_nist_is_solved_to_eight_digits(
    begin: tuple[float, float], search: Callable[[], Search]
) -> None:
    end = minimise(misra(begin), EXACT, max_iterations=50, search=search())
    assert end.converged
    assert end.equations.x == pytest.approx(CERTIFIED, rel=1e-8)
    assert end.equations.cost == pytest.approx(CERTIFIED_COST, rel=1e-8)


def test_marquardts_damping_shortens_the_step_until_it_lowers_the_cost() -> None:
    """The damped step of one unknown is the full one divided by 1 + damping."""
    problem = line_of_arctan(3.0)
    now = problem.start()
    full, _ = gauss_newton_step(now)
    accepted, step = Marquardt()(problem, now, full)
    assert accepted is not None
    assert accepted.cost < now.cost
    damping = float(full[0] / step[0]) - 1.0
    assert damping == pytest.approx(10.0 ** round(np.log10(damping)), rel=1e-6)
    longer = full / (1.0 + 0.1 * damping)
    assert problem.at(now.x + longer).cost >= now.cost  # the damping before it was refused


def test_marquardts_damping_is_raised_at_once_where_the_last_step_needed_it() -> None:
    """It goes down a hundredfold after an accepted step and not back to nothing."""
    problem, search = line_of_arctan(3.0), Marquardt()
    now = problem.start()
    search(problem, now, gauss_newton_step(now)[0])
    first = problem.calls.count("trial")
    search(problem, now, gauss_newton_step(now)[0])
    assert 1 < problem.calls.count("trial") - first < first


def test_halving_leaves_the_longest_share_of_the_step_that_lowers_the_cost() -> None:
    problem = line_of_arctan(3.0)
    now = problem.start()
    full, _ = gauss_newton_step(now)
    accepted, step = halved(problem, now, full)
    assert accepted is not None
    share = float(step[0] / full[0])
    assert accepted.cost < now.cost <= problem.at(now.x + 2.0 * share * full).cost
    assert np.log2(share) == round(np.log2(share))


@pytest.mark.parametrize("reuse_below", [np.inf, 1e6])
def test_a_reused_jacobian_leads_to_the_same_minimum_with_fewer_jacobians(
    reuse_below: float,
) -> None:
    fresh, thrifty = misra(MISRA_NEAR), misra(MISRA_NEAR)
    every = minimise(fresh, EXACT, max_iterations=50)
    reused = minimise(thrifty, EXACT, max_iterations=50, reuse_below=reuse_below)
    assert "reuse" not in fresh.calls
    assert thrifty.calls.count("accept") < fresh.calls.count("accept")
    assert reused.converged
    # Where J'r vanishes with an old J differs from the minimum by the curvature of the model.
    assert (np.abs(reused.equations.x - every.equations.x) < 1e-2 * CERTIFIED_SIGMA).all()


def test_a_reused_jacobian_that_converges_slowly_is_formed_again() -> None:
    """From far away the first Jacobian is of no use for the second step."""
    problem = misra(MISRA_FAR)
    end = minimise(problem, EXACT, max_iterations=50, reuse_below=np.inf)
    assert problem.calls.count("accept") > 0
    assert (np.abs(end.equations.x - CERTIFIED) < 1e-2 * CERTIFIED_SIGMA).all()


def test_a_jacobian_is_not_reused_where_its_step_promises_more_than_the_limit() -> None:
    problem = misra(MISRA_NEAR)
    minimise(problem, EXACT, max_iterations=1, reuse_below=1e-9)
    assert problem.calls == ["trial", "accept"]


def test_the_search_ends_where_the_next_step_promises_a_negligible_decrease() -> None:
    for decrease, most in ((1e8, 0), (1e-2, 4)):
        end = minimise(misra(MISRA_NEAR), Stop(decrease=decrease), max_iterations=50)
        assert end.converged
        assert end.iterations <= most
        assert gauss_newton_step(end.equations)[1] < decrease


def test_the_search_ends_where_the_full_step_is_short() -> None:
    end = minimise(misra(MISRA_NEAR), Stop(step=1e-3), max_iterations=50)
    assert end.converged
    assert np.abs(gauss_newton_step(end.equations)[0]).max() < 1e-3


def test_the_search_ends_with_a_relative_decrease_that_is_small() -> None:
    """r = (x^2, 1): each step halves x, so the cost falls by 15/16 x^4 of about 1."""
    problem = Residuals(
        lambda x: np.array([x[0] ** 2, 1.0]),
        lambda x: np.array([[2.0 * x[0]], [0.0]]),
        np.array([1.0]),
    )
    end = minimise(problem, Stop(relative=1e-6), max_iterations=50)
    assert end.converged
    assert end.iterations == 6  # 15/16 2^-20 is the first decrease below a millionth
    assert end.equations.x == pytest.approx([2.0**-6])


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_relative_decrease_is_the_same_in_any_unit_of_the_residual(unit: float) -> None:
    """r = (x^2, 1) in another unit ends at the same iteration."""
    problem = Residuals(
        lambda x: unit * np.array([x[0] ** 2, 1.0]),
        lambda x: unit * np.array([[2.0 * x[0]], [0.0]]),
        np.array([1.0]),
    )
    assert minimise(problem, Stop(relative=1e-6), max_iterations=50).iterations == 6


@pytest.mark.parametrize("most", [0, 1])
def test_a_search_that_runs_out_of_iterations_has_not_converged(most: int) -> None:
    end = minimise(misra(), EXACT, max_iterations=most)
    assert (end.converged, end.stuck, end.iterations) == (False, False, most)
    assert np.array_equal(end.equations.x, MISRA_FAR) == (most == 0)


@BOTH
def test_a_wall_is_told_from_a_minimum(search: Callable[[], Search]) -> None:
    """The Jacobian promises a decrease that no step of any length brings."""
    problem = Residuals(lambda x: 1.0 + np.abs(x), lambda _: np.eye(1), np.array([0.0]))
    end = minimise(problem, EXACT, max_iterations=10, search=search())
    assert (end.converged, end.stuck, end.iterations) == (False, True, 0)


def test_normal_equations_that_are_not_finite_are_refused_in_words() -> None:
    problem = linear(np.array([[1.0, np.nan], [0.0, 1.0]]), np.ones(2), np.zeros(2))
    with pytest.raises(SingularError, match="the fit cannot be linearised"):
        minimise(problem, EXACT, max_iterations=5)
    with pytest.raises(SingularError, match="the fit cannot be linearised"):
        inverse(np.array([[1.0, 2.0], [2.0, 1.0]]))  # indefinite


def test_the_inverse_is_numpys_whatever_the_units() -> None:
    rng = np.random.default_rng(5)
    matrix = rng.standard_normal((20, 4)) * np.array([1e-5, 1.0, 3.0, 1e6])
    normal = matrix.T @ matrix
    assert inverse(normal) * normal.diagonal() == pytest.approx(
        np.linalg.inv(normal) * normal.diagonal(), rel=1e-6, abs=1e-9
    )


def test_the_variance_of_a_direction_that_nothing_determines_is_that_of_rounding() -> None:
    """Both columns are the same, so their difference has no variance but what rounding leaves."""
    normal = np.ones((2, 2))
    variance = inverse(normal)
    assert np.isfinite(variance).all()
    assert np.array([1.0, -1.0]) @ variance @ [1.0, -1.0] == pytest.approx(2.0 / ROUNDING, rel=1e-2)


@pytest.mark.parametrize(
    ("stop", "cost", "expected"),
    [
        (Stop(decrease=0.1), 60.0, 0.1 * 60.0 / 20.0),
        (Stop(decrease=0.1), 2.0, 0.1),  # white residuals, or less: the unit stays 1
        (Stop(decrease=0.1, whitened=False), 2.0, 0.1 * 2.0 / 20.0),
        (Stop(), 60.0, 0.0),
    ],
)
def test_negligible_is_counted_in_the_cost_per_degree_of_freedom(
    stop: Stop, cost: float, expected: float
) -> None:
    residual = np.full(24, np.sqrt(cost / 24))
    assert stop.enough(Equations(np.zeros(4), residual, np.zeros((24, 4)))) == pytest.approx(
        expected
    )


class Trial:
    """A cost alone."""

    def __init__(self, cost: float) -> None:
        self.cost = cost


@pytest.mark.parametrize("longest", [1.0, 0.3, 0.02])
def test_the_step_of_an_accepted_trial_is_the_one_that_was_tried(longest: float) -> None:
    """The whole one where it lowers the cost, else its halves in turn."""
    tried: list[float] = []

    class Narrow:
        def trial(self, _: Any, step: Array) -> Trial:
            tried.append(float(step[0]))
            return Trial(0.5 if abs(step[0]) <= longest else 2.0)

    problem: Any = Narrow()
    trial, step = halved(problem, Trial(1.0), np.array([1.0]))  # type: ignore[type-var]
    assert trial is not None
    assert float(step[0]) == tried[-1]
    assert tried == [0.5**k for k in range(len(tried))]
    assert 0.5 * longest < tried[-1] <= longest
