"""The masses that motor torques ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Link
from ballbar.cell.payload import LinkDeviation, Payload, with_deviations, with_payload
from ballbar.ident.loads.gear_loads import mass_model, own_weight
from ballbar.ident.loads.mass_uncertainty import deviated_cells, stated_covariance
from ballbar.ident.loads.payload import SURE, PayloadEstimate, payload_of_recordings
from ballbar.ident.remarks import loaded_otherwise
from tests.helpers.known_loads import motion_at
from tests.helpers.logged_torques import T, logged
from tests.helpers.synthetic_recording import CELL, NOMINAL


def found(true: Cell) -> PayloadEstimate:
    return payload_of_recordings(CELL, [NOMINAL], [logged(true)])


def test_a_tool_twice_as_heavy_is_found_within_its_sigma() -> None:
    body = CELL.plate.body
    heavier = Payload(2.0 * body.mass, body.com + np.array([0.0, 0.01, 0.03]))
    estimate = found(with_payload(CELL, heavier))
    assert estimate.significant
    assert estimate.stated == body.mass
    assert abs(estimate.payload.mass - heavier.mass) < 2.0 * estimate.mass_sigma
    assert abs(estimate.payload.mass - heavier.mass) < 0.1 * heavier.mass
    assert np.abs(estimate.payload.com - heavier.com).max() < 0.02
    assert estimate.added_load[1:3].min() > 10.0  # [N m] at the gears that carry it


def test_the_masses_of_the_files_stay_where_they_are_right() -> None:
    estimate = found(CELL)
    assert not estimate.significant
    assert abs(estimate.excess) < SURE * estimate.mass_sigma
    assert estimate.payload.arm == pytest.approx(1.0, abs=3.0 * estimate.arm_sigma)


def test_a_shifted_centre_of_the_forearm_is_found_by_the_load_of_the_wrist() -> None:
    links = list(CELL.robot.required("links"))
    links[4] = Link(links[4].mass, links[4].com + np.array([0.0, 3e-3, 0.0]), links[4].inertia)
    true = replace(CELL, robot=replace(CELL.robot, links=tuple(links)))
    estimate = found(true)
    assert not estimate.significant
    q: Array = np.random.default_rng(3).uniform(-1.5, 1.5, (200, 6))
    felt, stated, shown = (
        own_weight(mass_model(cell), NOMINAL, q).gear[3:]
        for cell in (true, CELL, with_payload(CELL, estimate.payload))
    )
    assert np.abs(stated - felt)[0].max() > 0.5  # [N m] 29.7 kg by 3 mm
    assert np.sqrt(((shown - felt) ** 2).mean()) < 0.3 * np.sqrt(((stated - felt) ** 2).mean())


def test_links_that_each_deviate_a_little_are_no_heavier_tool() -> None:
    rng = np.random.default_rng(4)
    links = CELL.robot.required("links")
    others = tuple(
        Link(link.mass * (1.0 + 0.02 * rng.standard_normal()), link.com, link.inertia)
        for link in links
    )
    estimate = found(replace(CELL, robot=replace(CELL.robot, links=others)))
    assert not estimate.significant


def weight(cell: Cell) -> Array:
    return own_weight(mass_model(cell), NOMINAL, motion_at(T[::10]).q).gear


def test_loads_are_better_known_than_by_the_files_and_within_their_covariance() -> None:
    """Masses, centres and gains are drawn; a gain is one of the rod's share of the torque too."""
    errors, stated, of_files = [], [], []
    factor = np.linalg.cholesky(stated_covariance(CELL))
    for seed in range(8):
        z = np.random.default_rng(50 + seed).standard_normal(len(factor))
        true = with_deviations(CELL, factor @ z)
        estimate = found(true)
        assert not estimate.significant
        cell = with_payload(CELL, estimate.payload)
        here = weight(cell)
        deviated = [weight(other) - here for other in deviated_cells(cell, estimate.covariance)]
        errors.append(((here - weight(true)) ** 2).mean(axis=1))
        of_files.append(((weight(CELL) - weight(true)) ** 2).mean(axis=1))
        stated.append(np.square(deviated).sum(axis=0).mean(axis=1))
    error, known, stated_by_files = (
        np.sqrt(np.mean(each, axis=0))[1:] for each in (errors, stated, of_files)
    )
    assert (error < stated_by_files).all()
    # eight draws of one or two directions each scatter by a third
    assert np.median(error / known) == pytest.approx(0.8, abs=0.4)
    assert (error < 1.7 * known).all()


def test_a_cell_with_other_masses_has_these_and_nothing_else() -> None:
    cell = with_payload(CELL, Payload(7.0, np.array([0.1, 0.0, 0.05]), 1.1))
    assert cell.plate.body.mass == 7.0
    assert cell.plate.body.com.tolist() == [0.1, 0.0, 0.05]
    for link, before in zip(
        cell.robot.required("links"), CELL.robot.required("links"), strict=True
    ):
        assert link.mass == pytest.approx(1.1 * before.mass)
        assert np.array_equal(link.com, before.com)
    assert np.array_equal(cell.robot.a, CELL.robot.a)


def test_recordings_under_two_tools_are_not_pooled() -> None:
    body = CELL.plate.body
    heavier = with_payload(CELL, Payload(2.5 * body.mass, body.com))
    two = [logged(CELL), logged(heavier, seed=2)]
    estimate = payload_of_recordings(CELL, [NOMINAL] * 2, two)
    first, second = estimate.each
    assert first == pytest.approx(body.mass, abs=1.0)
    assert second == pytest.approx(2.5 * body.mass, abs=1.5)
    assert estimate.payload.mass == first
    assert f"recording 2 for {second:.1f} kg" in loaded_otherwise(estimate)
    equal = payload_of_recordings(CELL, [NOMINAL] * 2, [logged(CELL), logged(CELL, seed=2)])
    assert equal.each == ()
    assert loaded_otherwise(equal) == ""


def test_each_link_of_a_cell_has_its_own_deviation() -> None:
    links = tuple(LinkDeviation(1.0 + 0.01 * i, np.array([0.0, 0.0, 0.001 * i])) for i in range(6))
    body = CELL.plate.body
    cell = with_payload(CELL, Payload(body.mass, body.com, 1.0, links))
    pairs = zip(cell.robot.required("links")[1:], CELL.robot.required("links")[1:], strict=True)
    for i, (link, before) in enumerate(pairs):
        assert link.mass == pytest.approx((1.0 + 0.01 * i) * before.mass)
        assert link.inertia == pytest.approx((1.0 + 0.01 * i) * before.inertia)
        assert link.com - before.com == pytest.approx([0.0, 0.0, 0.001 * i], abs=1e-12)
