"""The thesis's costs minimised over paired samples: parameters, rates, the rod's compliance."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry
from ballbar.ident.thesis.cost_fit import fit_cost, identifiable_by
from ballbar.ident.thesis.costs import Form, cost_named
from ballbar.ident.thesis.names import ENCODERS_NEEDED, CostName
from ballbar.sim.path import ReferencePath
from tests.helpers.six_axes import INDEX, NAMES
from tests.helpers.synthetic_recording import closed

COSTS = get_args(CostName)
# [m | rad] 1e-6 mm|mrad: far above rounding, a thousandth of what the thesis reached (sec. 3.4)
EXACT = 1e-9

Angles = dict[str, Array]


def test_a_missing_angle_is_refused(exact: Angles, nominal: Geometry) -> None:
    q, b = exact["q"].copy(), exact["b"]
    q[3, 2] = np.nan
    with pytest.raises(ValueError, match="an angle of the samples is missing"):
        fit_cost(cost_named("transform", "vector"), nominal, q=q, b=b, parameters=[INDEX["ra1"]])


@pytest.mark.parametrize(
    ("name", "count"),
    [("length", 23), ("position", 25), ("position_angles", 28), ("transform", 29)],
)
def test_what_a_cost_identifies_is_the_thesis_s_choice(
    path: ReferencePath, nominal: Geometry, name: CostName, count: int
) -> None:
    """Offsets of the encoders it needs, origin, 19 or 20 of the robot, the rod.

    rd1, rd3 and rtheta1 depend on others (Table 3.2).
    """
    names = [NAMES[i] for i in identifiable_by(name, nominal, path.q[::50], path.b[::50])]
    assert len(names) == count
    assert {"rd1", "rd3", "rtheta1", "ra6"}.isdisjoint(names)
    assert ("ralpha6" in names) == (name in ("position_angles", "transform"))
    assert [n for n in names if n.startswith("btheta")] == [
        f"btheta{j}" for j in ENCODERS_NEEDED[name]
    ]


@pytest.mark.parametrize(("name", "form"), [*((c, "vector") for c in COSTS), ("length", "thesis")])
def test_signed_forms_find_the_exact_parameters_in_a_few_steps(
    path: ReferencePath,
    exact: Angles,
    nominal: Geometry,
    true: Geometry,
    name: CostName,
    form: Form,
) -> None:
    """The vector forms, and the printed length, which is signed as well."""
    chosen = identifiable_by(name, nominal, path.q[::50], path.b[::50])
    fit = fit_cost(cost_named(name, form), nominal, **exact, parameters=chosen)
    assert fit.converged
    assert fit.iterations <= 6
    assert np.abs((fit.geometry.values - true.values)[chosen]).max() <= EXACT
    left = np.setdiff1d(np.arange(len(NAMES)), chosen)
    assert np.array_equal(fit.geometry.values[left], nominal.values[left])


@pytest.mark.parametrize("name", ["position", "position_angles", "transform"])
def test_printed_scalars_halve_the_error_in_each_step(
    path: ReferencePath, exact: Angles, nominal: Geometry, true: Geometry, name: CostName
) -> None:
    """The scalar vanishes quadratically at the solution.

    On a root of order two Gauss-Newton converges linearly.
    """
    chosen = identifiable_by(name, nominal, path.q[::50], path.b[::50])
    cost = cost_named(name, "thesis")
    errors = []
    for steps in (9, 10, 11):
        fit = fit_cost(cost, nominal, **exact, parameters=chosen, max_iterations=steps)
        assert not fit.converged
        assert fit.iterations == steps
        errors.append(np.linalg.norm((fit.geometry.values - true.values)[chosen]))
    assert errors[1:] / np.array(errors[:-1]) == pytest.approx([0.5, 0.5], abs=0.01)
    whole = fit_cost(cost, nominal, **exact, parameters=chosen)
    assert whole.converged
    assert 15 < whole.iterations < 40
    assert np.abs((whole.geometry.values - true.values)[chosen]).max() <= EXACT


def test_with_noise_the_printed_scalar_crawls_where_the_vector_form_is_done(
    path: ReferencePath, exact: Angles, nominal: Geometry, true: Geometry
) -> None:
    """10 urad on every angle (thesis sec. 3.5): 100 steps of the printed C_T against a handful."""
    rng = np.random.default_rng(3)
    q, b = (angles + rng.normal(0.0, 1e-5, angles.shape) for angles in exact.values())
    chosen = identifiable_by("transform", nominal, path.q[::50], path.b[::50])
    vector = fit_cost(cost_named("transform", "vector"), nominal, q=q, b=b, parameters=chosen)
    printed = fit_cost(
        cost_named("transform", "thesis"), nominal, q=q, b=b, parameters=chosen, max_iterations=100
    )
    assert vector.converged
    assert vector.iterations <= 4
    assert not printed.converged
    assert printed.iterations == 100
    assert np.linalg.norm((vector.geometry.values - true.values)[chosen]) < 5e-5
    assert 1e-5 < vector.rms < 2e-5


@pytest.mark.parametrize("name", COSTS)
def test_a_rod_that_is_longer_where_it_is_pulled_has_its_deviation_as_one_more_unknown(
    path: ReferencePath, nominal: Geometry, true: Geometry, name: CostName
) -> None:
    """The rod is 0.1 mm longer where it is pulled and shorter where it is pushed (thesis ch. 6)."""
    some = np.linspace(200, path.t.size - 200, 400).round().astype(int)
    sign = np.where(np.sin(0.05 * some) > 0.0, 1.0, -1.0)
    b = path.b[some]
    q = closed(true, b, path.q[some], 1e-4 * sign)
    chosen = identifiable_by(name, nominal, path.q[::50], path.b[::50])
    fit = fit_cost(cost_named(name, "vector"), nominal, q=q, b=b, parameters=chosen, rod_sign=sign)
    assert fit.converged
    assert fit.rod_deviation == pytest.approx(1e-4, abs=EXACT)
    assert np.abs((fit.geometry.values - true.values)[chosen]).max() <= EXACT
    without = fit_cost(cost_named(name, "vector"), nominal, q=q, b=b, parameters=chosen)
    assert without.rod_deviation == 0.0
    # C_Ptheta and C_T, the least sensitive, leave some hundredths of the deviation
    assert np.abs((without.geometry.values - true.values)[chosen]).max() > 3e-6


def test_the_deviation_of_a_printed_scalar_is_refused_with_its_reason(
    exact: Angles, nominal: Geometry
) -> None:
    sign = np.ones(400)
    with pytest.raises(ValueError, match="linear in the signed components only"):
        fit_cost(
            cost_named("position", "thesis"),
            nominal,
            **exact,
            parameters=[INDEX["ra1"]],
            rod_sign=sign,
        )


def test_what_is_left_over_is_stated_as_sum_and_as_rms(exact: Angles, true: Geometry) -> None:
    off = true.replaced({"ox": true["ox"] + 1e-3})
    fit = fit_cost(
        cost_named("position", "vector"), off, **exact, parameters=[INDEX["ra1"]], max_iterations=0
    )
    assert fit.cost == pytest.approx(400 * 1e-6)  # a millimetre along x in each sample
    assert fit.rms == pytest.approx(1e-3 / np.sqrt(3.0))


def test_a_loose_stop_ends_a_printed_scalar_and_no_signed_form(
    path: ReferencePath, exact: Angles, nominal: Geometry
) -> None:
    chosen = identifiable_by("position", nominal, path.q[::50], path.b[::50])

    def steps(form: Form, **stop: float) -> int:
        cost = cost_named("position", form)
        return fit_cost(cost, nominal, **exact, parameters=chosen, **stop).iterations

    assert steps("thesis", relative_stop=0.1) < steps("thesis")
    assert steps("vector", relative_stop=0.1) == steps("vector")
