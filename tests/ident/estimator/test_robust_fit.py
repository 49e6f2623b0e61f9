"""The fit of still poses: its cost, its chi-square and its covariance, against what was put in."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, geometry_of_chain, parameter_table, robot_geometry
from ballbar.cell.poses import Measured, PoseTable
from ballbar.ident.estimator import robust_fit
from ballbar.ident.estimator.block_covariance import robust_covariance
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.model import Model, still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.robust_fit import equations_at, fit_robustly
from ballbar.ident.estimator.unknowns import PlacedPoses
from ballbar.ident.start.placements import start_of_poses
from tests.helpers.still_poses import angles, group, socket_table, table_of, true_robot

TRUE = true_robot("ur5", sag=0.0)
NOISE = 1e-4  # [m]


def model_of(table: PoseTable) -> Model:
    """Geometry alone."""
    nominal = robot_geometry(table.robot)
    start = start_of_poses(table, nominal.robot)
    layout = still_unknowns(nominal, start, ())
    return still_model(table, layout, (), np.zeros(table.robot.joints))


def true_geometry() -> Geometry:
    """The true robot's."""
    return geometry_of_chain(parameter_table(TRUE.robot), TRUE.chain)


def fitted(stated: float, *, repeated: int = 1, held: bool = False) -> Fit:
    """Points with noise of NOISE; stated : [m] what their file says of it.

    repeated : how often each pose stands in the table, with the same noise. held : the robot at its
    true parameters, so that only seat and target are unknown.
    """
    q = angles(TRUE.name, 200)
    (drawn,) = table_of(TRUE, "point", q=q, noise=NOISE).groups
    sigma = np.full((repeated * len(q), 3), stated)
    repeated = group(
        "point", "tracker", np.tile(q, (repeated, 1)), np.tile(drawn.values, (repeated, 1)), sigma
    )
    model = model_of(PoseTable(TRUE.name, TRUE.robot, (repeated,)))
    if held:
        placed = model.unknowns.placed
        still = PlacedPoses(model.poses, placed.seat_starts, placed.target_starts)
        layout = still_unknowns(true_geometry(), still, ())
        model = replace(model, unknowns=layout.held())
    return fit_robustly(model, model.unknowns.mean.copy())


@pytest.mark.parametrize("measured", ["point", "length", "socket"])
def test_priors_count_once_and_the_gradient_is_half_the_derivative_of_the_cost(
    measured: Measured,
) -> None:
    """Cost of residuals, priors and known distances, a deviation off the priors' means."""
    table = socket_table(TRUE, count=8) if measured == "socket" else table_of(TRUE, measured)
    model = model_of(table)
    mean, sigma = model.unknowns.mean, model.unknowns.sigma
    x = mean + 1e-3 * np.minimum(1.0, 1e3 * sigma)
    robust = [np.ones(g.size) for g in table.groups]
    # So large that the residuals weigh about as much as the priors
    excess = ExcessNoise(position=0.1, rotation=0.1)
    at = equations_at(model, x, excess, robust)
    jacobians = Fit(model, at, at.normal, excess, 0, True).jacobians
    flat = np.concatenate([j.reshape(x.size, -1) for j in jacobians], axis=1)
    priors = np.diag(at.normal - flat @ flat.T) * sigma**2
    # Known distances are of seats alone
    assert priors[model.unknowns.machine] == pytest.approx(1.0, abs=1e-6)

    def cost(where: Array) -> float:
        here = equations_at(model, where, excess, robust)
        closures = zip(here.evaluations, at.weights, strict=True)  # the weights are held
        data = sum(float((w(p.closure.error) ** 2).sum()) for p, w in closures)
        own = sum(float((r * r).sum()) for r in here.residuals)
        return here.cost - own + data

    for i, name in enumerate(model.unknowns.names):
        step = 1e-2 * np.minimum(sigma[i], 1e-3) * np.eye(x.size)[i]
        slope = 0.25 * (cost(x + step) - cost(x - step)) / step[i]
        scale = np.sqrt(at.normal[i, i])
        assert at.gradient[i] / scale == pytest.approx(slope / scale, rel=1e-3, abs=1e-4), name


def test_residuals_are_whitened_to_a_chi_square_of_one_whatever_noise_is_stated() -> None:
    """Per degree of freedom: of 600 equations the data determine 30 unknowns or so."""
    for stated in (NOISE / 10.0, NOISE / 2.0):
        fit = fitted(stated)
        sigma = fit.model.unknowns.sigma
        determined = sigma.size - float((np.diag(fit.covariance) / sigma**2).sum())
        assert determined > 25.0
        freedom = fit.linear.equations - determined
        square = sum(float((r * r).sum()) for r in fit.linear.residuals)
        assert square / freedom == pytest.approx(1.0, abs=0.02)  # two of SETTLED


def test_the_covariance_is_that_of_the_noise_and_not_of_the_stated_one() -> None:
    """Quarter of the noise stated: without the misfit, deviations would be a quarter as large."""
    deviations = [
        np.sqrt(np.diag(fitted(stated, held=True).covariance))[-9:]
        for stated in (NOISE / 4.0, NOISE)
    ]
    # 600 values tell their scatter to 3 %; where the noise is stated, no variance goes below it
    assert deviations[0] / deviations[1] == pytest.approx(np.ones(9), rel=0.09)
    assert deviations[1][0] > NOISE / np.sqrt(200)


@pytest.mark.parametrize("repeated", [1, 4])
def test_errors_that_neighbouring_poses_share_inflate_the_covariance(repeated: int) -> None:
    """The same errors four times tell as much as once: deviations are twice those of white ones."""
    fit = fitted(NOISE / 10.0, repeated=repeated, held=True)
    ratio = np.sqrt(np.diag(robust_covariance(fit)) / np.diag(fit.covariance))[-9:]
    # 32 regions scatter by an eighth, and no factor is below 1
    assert np.median(ratio) == pytest.approx(np.sqrt(repeated), rel=0.2)


def residuals(
    rng: np.random.Generator, count: int, sigma: tuple[float, float], *, turns: bool
) -> Any:
    """A group of poses whose sensors explain 3 um and 4 urad of each coordinate."""
    error = np.repeat(sigma, 3)[:, None] * rng.standard_normal((6, count))
    noise = np.repeat([3e-6, 4e-6], 3)[:, None] * np.ones(count)
    kind = SimpleNamespace(directions=3, target_turns=turns)
    return SimpleNamespace(
        closure=SimpleNamespace(error=error),
        noise_columns=lambda _: noise[None],
        still=SimpleNamespace(kind=kind),
    )


@pytest.mark.parametrize("turns", [True, False])
def test_what_the_sensors_do_not_explain_is_the_rest_of_the_variance(
    turns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the sensors make 3 of 5 um it is 4; the fit takes a tenth of the variance."""
    monkeypatch.setattr(robust_fit, "determined", lambda *_: 60.0)
    rng = np.random.default_rng(6)
    fair = residuals(rng, 40_000, (5e-6, 5e-6), turns=turns)
    wild = residuals(rng, 40_000, (5e-3, 5e-3), turns=turns)
    fair.closure.error *= np.sqrt(0.9)
    linear: Any = SimpleNamespace(
        evaluations=[fair, wild], robust=[np.ones(40_000), np.zeros(40_000)], equations=600
    )
    model: Any = SimpleNamespace(
        unknowns=None, poses=SimpleNamespace(groups=[SimpleNamespace(factor=None)])
    )
    found = robust_fit.unexplained(model, linear, ExcessNoise())
    assert found.position == pytest.approx(4e-6, rel=0.02)
    assert found.rotation == (pytest.approx(3e-6, rel=0.03) if turns else 0.0)
    fair.closure.error *= 0.5  # less than the sensors make
    found = robust_fit.unexplained(model, linear, ExcessNoise())
    least = robust_fit.LEAST
    assert (found.position, found.rotation) == (least.position, least.rotation * turns)


def test_huber_counts_poses_beyond_three_scales_less_and_gross_ones_not_at_all() -> None:
    """By the scale of the median length, which is one of white noise."""
    lengths = np.full(101, robust_fit.MEDIAN * 2.0)
    lengths[:3] = robust_fit.HUBER * np.array([2.0, 3.0, 0.0])
    lengths[2] = 2.0 * robust_fit.GROSS * 1.001
    error = np.zeros((6, 101))
    error[0] = np.sqrt(6.0) * lengths

    class Whitening:
        matrix = np.zeros(6)

        def __call__(self, closure: Array) -> Array:
            return closure

    point = SimpleNamespace(closure=SimpleNamespace(error=error))
    linear: Any = SimpleNamespace(evaluations=[point], weights=[Whitening()])
    (found,) = robust_fit.robust_weights(linear)
    np.testing.assert_allclose(found[:3], [1.0, np.sqrt(2.0 / 3.0), 0.0], atol=1e-12)
    np.testing.assert_allclose(found[3:], 1.0)


def test_priors_and_data_share_the_unknowns() -> None:
    """An unknown is determined by as much as the data shrink the variance of its prior."""
    sigma = np.array([1.0, 2.0, 10.0])
    data = np.array([3.0, 0.0, 1.0])  # information beside the priors
    linear: Any = SimpleNamespace(normal=np.diag(data + sigma**-2.0))
    layout: Any = SimpleNamespace(count=3, sigma=sigma)
    expected = 0.75 + 0.0 + 1.0 / 1.01
    assert robust_fit.determined(linear, layout) == pytest.approx(expected)
