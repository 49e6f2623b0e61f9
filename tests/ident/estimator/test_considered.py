"""Uncertain masses add to the uncertainty of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.cell.payload import with_deviations
from ballbar.ident.corrections import correction_named
from ballbar.ident.estimator import uncertainty as stated_uncertainty
from ballbar.ident.estimator.build_unknowns import RecordingStart, complete_unknowns
from ballbar.ident.estimator.fit import Fit, fit, fit_kinematics
from ballbar.ident.estimator.model import Model, gearing
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.estimator.uncertainty import (
    KNOWN,
    KnownLengths,
    considered_shifts,
    held_shifts,
    known_lengths,
    uncertainty,
)
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.loads.gear_loads import loads, mass_model
from ballbar.ident.loads.logged_tension import tension_splines
from ballbar.ident.loads.mass_uncertainty import deviated_cells, stated_covariance
from ballbar.ident.robot.accuracy import accuracy_grid, position_sigma, rigid_basis
from ballbar.ident.robot.identified import IdentifiedRobot
from tests.helpers.complete_model import EXCESS
from tests.helpers.six_axes import INDEX
from tests.helpers.synthetic_recording import (
    CELL,
    NO_CLOCK_ERROR,
    NOMINAL,
    UNIVERSAL_AND_GIMBAL,
    exact_log,
    minute,
)

GRID = accuracy_grid(CELL.robot)[::8]
STIFFNESS = CELL.robot.required("gears").stiffness


@pytest.fixture(scope="module")
def deviated() -> tuple[Cell, ...]:
    return deviated_cells(CELL, stated_covariance(CELL))


@pytest.fixture(scope="module")
def elastic_fit() -> Fit:
    """A minute of a robot on elastic gears with the masses of its files and a known tension."""
    path, columns = minute(), [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    still = np.zeros_like(path.q)
    pull = 30.0 * np.sin(path.t)
    load = loads(
        mass_model(CELL), NOMINAL, q=path.q, b=path.b, speed=still, acceleration=still
    ).gears(pull)
    logged = path.q + (load / STIFFNESS[:, None]).T @ CELL.robot.gear_to_joint
    times = np.linspace(3.0, 57.0, 200)
    samples = samples_of(
        exact_log(path.t, logged),
        exact_log(path.t, path.b[:, columns]),
        UNIVERSAL_AND_GIMBAL,
        np.ones(len(columns)),
        times,
    )
    samples = replace(
        samples, tension=np.interp(times, path.t, pull), splines=tension_splines(times)
    )
    start = RecordingStart(
        UNIVERSAL_AND_GIMBAL, NOMINAL, NO_CLOCK_ERROR, samples.splines.shape[0], tension_sigma=1.0
    )
    chosen = (correction_named("joint_compliance", CELL, UNIVERSAL_AND_GIMBAL),)
    layout, x = complete_unknowns(CELL, NOMINAL, [start], chosen, gain_sigma=0.03, rod_sigma=None)
    model = Model(gearing(CELL.robot), mass_model(CELL), chosen, layout, (samples,))
    return fit(model, x, [samples.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)], EXCESS)


def refitted(estimate: Fit, cell: Cell) -> Fit:
    """The same recording, fitted with the masses of another cell."""
    model = replace(estimate.model, masses=mass_model(cell))
    return fit(model, estimate.x, estimate.ballbars, EXCESS, negligible=1e-3)


def compliances(estimate: Fit) -> list[int]:
    return [estimate.model.unknowns.names.index(f"compliance{i}") for i in range(1, 7)]


def unloaded(estimate: Fit, cell: Cell, x: Array) -> IdentifiedRobot:
    model = estimate.model
    geometry = model.unknowns.geometry(x, 0)
    return IdentifiedRobot(cell, geometry, model.corrections, x[model.unknowns.coefficients])


def drawn_cells(count: int) -> list[Cell]:
    factor = np.linalg.cholesky(stated_covariance(CELL))
    z = np.random.default_rng(8).standard_normal((count, len(factor)))
    return [with_deviations(CELL, factor @ row) for row in z]


def test_a_fit_with_other_masses_ends_where_the_shift_says(
    elastic_fit: Fit, deviated: tuple[Cell, ...]
) -> None:
    """The directions are sorted by their effect; the first carries most of it."""
    shift = considered_shifts(elastic_fit, deviated[:1])[:, 0]
    moved = refitted(elastic_fit, deviated[0]).x - elastic_fit.x
    sigma = np.sqrt(np.diag(elastic_fit.covariance))
    # the deflection is bilinear in masses and compliances, and the masses differ by 2 %
    assert np.linalg.norm((moved - shift) / sigma) < 0.15 * np.linalg.norm(moved / sigma)


def test_the_gain_of_a_measured_tension_is_as_open_as_its_prior(elastic_fit: Fit) -> None:
    """The geometry tells it to a third of that; a fit at another gain ends where the shift says."""
    estimate, layout = elastic_fit, elastic_fit.model.unknowns
    gain = layout.gain
    assert gain is not None
    assert layout.sigma[gain] == 0.03 > 2.0 * np.sqrt(estimate.covariance[gain, gain])
    stated = stated_uncertainty.uncertainty(estimate)
    assert 0.03 < np.sqrt(stated.covariance[gain, gain]) < 0.04
    (shift,) = [c for c in stated.candidates.T if abs(c[gain]) > 0.02]
    sigma, mean = layout.sigma.copy(), layout.mean.copy()
    sigma[gain], mean[gain] = 1e-6, estimate.x[gain] + 0.3 * shift[gain]
    held = replace(estimate.model, unknowns=replace(layout, sigma=sigma, mean=mean))
    found = fit(held, estimate.x, estimate.ballbars, EXCESS, negligible=1e-6)
    moved = (found.x - estimate.x)[compliances(estimate)] * STIFFNESS
    assert np.abs(moved[2:]).min() > 4e-3
    sigma = np.sqrt(np.diag(estimate.covariance))[compliances(estimate)] * STIFFNESS
    off = moved - 0.3 * shift[compliances(estimate)] * STIFFNESS
    assert np.linalg.norm(off / sigma) < 0.15 * np.linalg.norm(moved / sigma)


def test_few_samples_of_a_recording_give_the_same_shifts(
    elastic_fit: Fit, deviated: tuple[Cell, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = elastic_fit.model.unknowns.machine
    every = considered_shifts(elastic_fit, deviated)[machine]
    monkeypatch.setattr(stated_uncertainty, "SAMPLES", 100)  # of 200
    half = considered_shifts(elastic_fit, deviated)[machine]
    sigma = np.sqrt(np.diag(elastic_fit.covariance))[machine, None]
    assert np.abs((half - every) / sigma).max() < 0.2


def test_compliances_scatter_over_drawn_masses_as_stated(
    elastic_fit: Fit, deviated: tuple[Cell, ...]
) -> None:
    """The recording is the same each time, so all scatter is that of the masses."""
    where = compliances(elastic_fit)
    shifts = considered_shifts(elastic_fit, deviated)[where]
    fits = [refitted(elastic_fit, cell) for cell in drawn_cells(24)]
    moved = np.array([(other.x - elastic_fit.x)[where] for other in fits])
    ratio = np.sqrt((moved**2).mean(axis=0) / (shifts**2).sum(axis=1))
    # 24 draws, six values that are correlated: a seventh of sampling error
    assert 0.7 < np.sqrt((ratio**2).mean()) < 1.4


@pytest.mark.long
def test_the_tool_scatters_over_drawn_masses_as_the_joint_covariance_says(
    elastic_fit: Fit, deviated: tuple[Cell, ...]
) -> None:
    """A heavier link under the same deflection means a stiffer gear: the sag changes less."""
    robot, machine = unloaded(elastic_fit, CELL, elastic_fit.x), elastic_fit.model.unknowns.machine
    shifts = considered_shifts(elastic_fit, deviated)[machine]
    moves = np.concatenate(
        (
            robot.jacobian(GRID, elastic_fit.model.unknowns.shared),
            robot.moved_by_masses(deviated, GRID),
        )
    )
    each = np.eye(len(deviated))
    joint = np.block([[shifts @ shifts.T, shifts], [shifts.T, each]])
    apart = np.block([[shifts @ shifts.T, 0.0 * shifts], [0.0 * shifts.T, each]])
    here = robot.tool(GRID)
    stated = np.sqrt((position_sigma(here, moves, joint) ** 2).mean())
    errors, basis = [], rigid_basis(here)
    for cell in drawn_cells(40):
        moved = (
            unloaded(elastic_fit, cell, refitted(elastic_fit, cell).x).tool(GRID) - here
        ).ravel()
        moved -= basis @ (basis.T @ moved)
        errors.append((moved**2).sum() / len(GRID))
    # 40 draws of a few directions: a seventh of sampling error
    assert 0.75 < np.sqrt(np.mean(errors)) / stated < 1.33
    assert np.sqrt((position_sigma(here, moves, apart) ** 2).mean()) > 1.2 * stated


def test_stated_covariance_is_that_of_known_masses_and_the_shifts(
    elastic_fit: Fit, deviated: tuple[Cell, ...]
) -> None:
    known, stated = uncertainty(elastic_fit), uncertainty(elastic_fit, deviated)
    added = stated.considered @ stated.considered.T
    assert known.considered.shape[1] == 0
    scale = np.sqrt(np.outer(*[np.diag(stated.covariance)] * 2))
    assert stated.covariance / scale == pytest.approx((known.covariance + added) / scale, abs=1e-9)
    assert np.diag(added)[compliances(elastic_fit)].min() > 0.0


def test_a_fit_without_loads_has_nothing_to_consider(
    elastic_fit: Fit, deviated: tuple[Cell, ...]
) -> None:
    bare = replace(elastic_fit, model=replace(elastic_fit.model, masses=None))
    assert not considered_shifts(bare, deviated).any()


@pytest.fixture(scope="module")
def kinematic_samples() -> Samples:
    path, columns = minute(), [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    logs = exact_log(path.t, path.q), exact_log(path.t, path.b[:, columns])
    times, signs = np.linspace(3.0, 57.0, 200), np.ones(len(columns))
    return samples_of(*logs, UNIVERSAL_AND_GIMBAL, signs, times)


def of_lengths(samples: Samples, nominal: Geometry) -> Fit:
    """A fit of the arm's and the rod's lengths; the plate and ba5 are held."""
    names = ["ox", "oy", "oz", "ra2", "ra3", "rd4", "rd6", "bd3"]
    free = np.array([INDEX[name] for name in names])
    return fit_kinematics(samples, nominal, NO_CLOCK_ERROR, free, EXCESS)


def test_a_fit_with_another_plate_ends_where_the_shift_says(kinematic_samples: Samples) -> None:
    held, sigma = np.array([INDEX["ra6"], INDEX["ba5"]]), np.array([5e-6, 5e-6])
    estimate = of_lengths(kinematic_samples, NOMINAL)
    root, shifts = held_shifts(estimate, held, sigma)
    for k, name in enumerate(("ra6", "ba5")):
        longer = NOMINAL.replaced({name: NOMINAL[name] + sigma[k]})
        moved = of_lengths(kinematic_samples, longer).x - estimate.x
        stated = shifts @ np.linalg.solve(root, np.eye(2)[k] * sigma[k])
        assert np.linalg.norm(moved[:-2]) > 5e-6  # [m] or the test would say nothing
        # bilinear in deviations of 5 um and lengths of the arm
        assert moved[:-2] == pytest.approx(stated[:-2], abs=1e-3 * np.linalg.norm(moved[:-2]))


def test_a_held_angle_that_the_data_show_counts_as_far_as_they_leave_it_open(
    kinematic_samples: Samples,
) -> None:
    """An axis of the ball-bar 50 urad out of square by its file: the angles show it better."""
    held, sigma = np.array([INDEX["balpha2"]]), np.array([5e-5])
    root, _ = held_shifts(of_lengths(kinematic_samples, NOMINAL), held, sigma)
    assert np.abs(root) < 1e-5
    bent = NOMINAL.replaced({"balpha2": NOMINAL["balpha2"] + 5e-5})
    off, _ = held_shifts(of_lengths(kinematic_samples, bent), held, sigma)
    assert np.abs(off) == pytest.approx(5e-5, rel=0.1)  # and its error in this fit counts whole


ROD = 5e-6  # [m]


def layout() -> Unknowns:
    out, _ = complete_unknowns(CELL, NOMINAL, [], (), gain_sigma=None, rod_sigma=ROD)
    return out


def posterior(unknowns: Unknowns, error: float) -> tuple[Array, Array]:
    """Estimate and covariance after a measurement of ra6 + bd3 that is off by `error` [m]."""
    row = np.array([float(name in ("ra6", "bd3")) for name in unknowns.names])
    normal = np.diag(unknowns.sigma**-2.0) + np.outer(row, row) / 1e-7**2
    covariance = np.linalg.inv(normal)
    return unknowns.mean + covariance @ row * error / 1e-7**2, covariance


def judged(error: float, noise: float = 1.0) -> tuple[Unknowns, KnownLengths]:
    """noise : of the measurement over what its weight says, as the blocks of time show it."""
    unknowns = layout()
    x, covariance = posterior(unknowns, error)
    data = covariance - covariance @ (covariance / unknowns.sigma[:, None] ** 2)
    return unknowns, known_lengths(unknowns, x, covariance, (noise**2 - 1.0) * data)


def test_noise_that_is_worse_than_white_contradicts_no_length() -> None:
    """The estimate is then off by what the data are off, of which the prior knows nothing."""
    unknowns, lengths = judged(30e-6, noise=200.0)
    plate = unknowns.sigma[unknowns.names.index("ra6")]
    expected = np.sqrt(plate**2 + ROD**2 + 200.0**2 * 1e-7**2)
    assert lengths.apart == pytest.approx(30e-6 / expected, rel=0.01)


def test_a_contradiction_is_in_standard_deviations_of_the_sum() -> None:
    unknowns, lengths = judged(30e-6)
    plate = unknowns.sigma[unknowns.names.index("ra6")]
    assert {"ra6", "bd3"} <= {unknowns.names[i] for i in lengths.unknowns}
    assert lengths.apart == pytest.approx(30e-6 / np.hypot(plate, ROD), rel=0.01)
    assert {"ra6", "bd3"} == set(lengths.named)
    assert lengths.off == pytest.approx(30e-6, rel=0.01)  # together, whichever of them is wrong


def test_lengths_that_agree_are_not_made_surer() -> None:
    assert judged(0.0)[1].apart == pytest.approx(0.0, abs=1e-6)
    assert not judged(1e-6)[1].doubt.any()


def test_the_stated_deviation_covers_the_result_without_each_length() -> None:
    """A rod that is stated ten times too well: one factor for all would leave it the sure one."""
    unknowns, error = layout(), 30e-6
    both = [unknowns.names.index(name) for name in ("ra6", "bd3")]
    sigma = unknowns.sigma.copy()
    sigma[both[1]] *= 0.1
    unknowns = replace(unknowns, sigma=sigma)
    x, covariance = posterior(unknowns, error)
    lengths = known_lengths(unknowns, x, covariance, np.zeros_like(covariance))
    expected = np.zeros(x.size)
    for length in both:
        wide = sigma.copy()
        wide[length] = 1.0  # [m] as good as free
        moved = posterior(replace(unknowns, sigma=wide), error)[0] - x
        expected += (1.0 - 1.0 / lengths.apart**2) * moved**2
    stated = np.sqrt((lengths.doubt**2).sum(axis=1))[both]
    assert stated == pytest.approx(np.sqrt(expected[both]), rel=1e-3)
    assert stated[1] > 0.9 * error  # the rod may have the whole error, at 0.5 um stated


def test_what_the_data_tell_alone_contradicts_nothing() -> None:
    """A length that the data determine by itself may be anywhere in its prior."""
    unknowns = layout()
    index = unknowns.names.index("bd3")
    normal = np.diag(unknowns.sigma**-2.0)
    normal[index, index] += 1e-7**-2.0
    covariance = np.linalg.inv(normal)
    x = unknowns.mean.copy()
    x[index] += 4.0 * ROD
    lengths = known_lengths(unknowns, x, covariance, np.zeros_like(covariance))
    assert index not in lengths.unknowns
    assert lengths.apart == 0.0


def test_a_length_that_is_only_roughly_known_contradicts_nothing() -> None:
    """The nominal lengths of the links are priors too, of a millimetre."""
    unknowns = layout()
    x = unknowns.mean + np.where(unknowns.sigma > KNOWN, 0.5 * unknowns.sigma, 0.0)
    rough = [n for n, s in zip(unknowns.names, unknowns.sigma, strict=True) if s > KNOWN]
    assert {"ra2", "rd4"} <= set(rough)
    _, covariance = posterior(unknowns, 0.0)
    lengths = known_lengths(unknowns, x, covariance, np.zeros_like(covariance))
    assert not {unknowns.names[i] for i in lengths.unknowns} & set(rough)
    assert lengths.apart == pytest.approx(0.0, abs=1e-6)
