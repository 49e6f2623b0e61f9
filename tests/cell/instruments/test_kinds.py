"""Every kind of instrument: what it measures of a target leads back to where the target stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.instruments import kinds, refuse_shared_chains
from ballbar.cell.instruments.base import Kind, TrueStand
from ballbar.cell.load import instrument_names, load_instrument
from ballbar.cell.placement import Placement
from ballbar.cell.rotation import matrix_from_rotvec

SEAT = Placement(
    matrix_from_rotvec(np.array([[0.3], [-0.2], [1.9]]))[:, :, 0], np.array([2.0, -1, 0.4])
)
RNG = np.random.default_rng(34)
POINTS = np.array([0.4, 0.2, 0.9]) + 0.5 * RNG.uniform(-1.0, 1.0, (40, 3))
NO_NOISE = np.zeros((6, len(POINTS)))


def instrument_of(kind: Kind) -> str:
    """The name of a shipped instrument of this kind."""
    return next(name for name in instrument_names() if load_instrument(name).kind == kind)


def stands() -> TrueStand:
    """The points as targets, seen from the seat."""
    rod = SEAT.rotation.T @ (POINTS - SEAT.origin).T
    turns = matrix_from_rotvec(RNG.uniform(-1.0, 1.0, (3, len(POINTS))))
    return TrueStand(rod, np.linalg.norm(rod, axis=0), turns)


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_the_values_of_a_target_put_it_where_it_stands(kind: Kind) -> None:
    """Also from a prediction that is off: along the directions that the kind senses."""
    instrument = load_instrument(instrument_of(kind))
    values = kind.measure(stands(), NO_NOISE, instrument)
    assert values.shape == (len(POINTS), kind.columns)
    assert len(kind.names) == len(kind.units) == kind.columns
    if kind.name == "socket":
        assert np.allclose(kind.sight(values, SEAT, POINTS.T).point, SEAT.origin[:, None])
        return
    assert np.allclose(kind.sight(values, SEAT, POINTS.T).point, POINTS.T, atol=1e-12)
    off = POINTS.T + 1e-5 * RNG.standard_normal(POINTS.T.shape)
    sight = kind.sight(values, SEAT, off)
    along = (sight.directions * (sight.point - POINTS.T)).sum(axis=1)
    assert np.abs(along).max() < 1e-9
    assert len(sight.directions) == kind.directions
    assert len(sight.free) == 6 - kind.equations


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_a_point_moves_with_each_value_as_stated(kind: Kind) -> None:
    """By differences of the values, along the directions that are sensed."""
    instrument = load_instrument(instrument_of(kind))
    values = kind.measure(stands(), NO_NOISE, instrument)
    sight = kind.sight(values, SEAT, POINTS.T)
    for k in range(min(kind.columns, kind.directions)):
        step = 1e-6 * np.eye(kind.columns)[k]
        ahead, back = (kind.sight(values + s, SEAT, POINTS.T).point for s in (step, -step))
        assert np.allclose((ahead - back) / 2e-6, sight.per_value[k], atol=1e-6)


@pytest.mark.parametrize(
    "kind",
    [kind for kind in kinds().values() if type(kind).seat_of is not Kind.seat_of],
    ids=lambda kind: kind.name,
)
def test_the_seat_follows_from_known_points(kind: Kind) -> None:
    """It explains the values of other points; whole where nothing of it is free."""
    instrument = load_instrument(instrument_of(kind))
    spread = stands()
    rod = spread.rod
    if not kind.sighted:  # the range is that of the values: at places where the robot brings it
        shares = RNG.uniform(size=len(POINTS))
        near = RNG.uniform(-0.3, 0.3, rod.T.shape)
        rod = kind.brought(near, shares, instrument.lower, instrument.upper).T
        reached = instrument.lower + shares * (instrument.upper - instrument.lower)
        assert np.allclose(
            kind.measure(
                TrueStand(rod, np.linalg.norm(rod, axis=0), spread.rotation), NO_NOISE, instrument
            )[:, 0],
            reached,
        )
    stood = TrueStand(rod, np.linalg.norm(rod, axis=0), spread.rotation)
    points = (SEAT.rotation @ rod).T + SEAT.origin
    values = kind.measure(stood, NO_NOISE, instrument)
    known, others = slice(0, len(POINTS) // 2), slice(len(POINTS) // 2, None)
    seat = kind.seat_of(values[known], points[known])
    assert seat is not None
    sight = kind.sight(values[others], seat, points[others].T)
    along = (sight.directions * (sight.point - points[others].T)).sum(axis=1)
    assert np.abs(along).max() < 1e-6
    if kind.seat_fixed:
        assert np.allclose(seat.origin, SEAT.origin, atol=1e-6)
        assert not kind.seat_turns or np.allclose(seat.rotation, SEAT.rotation, atol=1e-6)


def test_a_chain_of_two_kinds_is_refused() -> None:
    """The one that is found first would read the other's instruments."""
    point = kinds()["point"]

    class Probe(type(point)):  # type: ignore[misc]
        name = "probe"

    with pytest.raises(ValueError, match="is that of point and of probe; take it out of one"):
        refuse_shared_chains([point, Probe()])


def test_a_kind_that_senses_turns_ends_in_a_sensed_ball() -> None:
    """Another joint's sigma would be dropped, and the turns taken as exact."""
    point = kinds()["point"]

    class Nest(type(point)):  # type: ignore[misc]
        name, chains, target_turns = "nest", (("ball*", "prismatic*"),), True

    with pytest.raises(
        ValueError, match=r"kind nest measures turns, and its chain ends in prismatic"
    ):
        refuse_shared_chains([Nest()])


def test_three_slides_are_equally_exact_along_every_axis() -> None:
    """A coordinate machine has no line of sight: its scatter is that of its slides, as stated."""
    machine = replace(load_instrument("tracker_point"), sigma_length=1e-4, sigma_direction=0.0)
    rod = np.repeat(np.array([[1.0], [0.5], [0.3]]), 4000, axis=1)
    stand = TrueStand(rod, np.linalg.norm(rod, axis=0), np.zeros((3, 3, 4000)))
    noise = np.random.default_rng(1).standard_normal((6, 4000))
    values = machine.kind.measure(stand, noise, machine)
    assert np.allclose(machine.sigma(values), 1e-4)
    assert np.allclose(np.cov(values.T), 1e-8 * np.eye(3), atol=5e-10)  # two sigma of 4000 draws


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_readings_scatter_as_the_kind_states(kind: Kind) -> None:
    """All of a reading's values together, since a position's are equal along every axis."""
    instrument, count = load_instrument(instrument_of(kind)), 4000
    one = stands()
    same = TrueStand(
        np.repeat(one.rod[:, :1], count, axis=1),
        np.repeat(one.distance[:1], count),
        np.repeat(one.rotation[:, :, :1], count, axis=2),
    )
    noise = np.random.default_rng(3).standard_normal((6, count))
    values = kind.measure(same, noise, instrument)
    exact = kind.measure(same, np.zeros((6, count)), instrument)
    sigma = kind.sigma(exact, instrument)
    assert (sigma > 0.0).all()
    for unit in set(kind.units):
        rows = [k for k, each in enumerate(kind.units) if each == unit]
        scatter = ((values - exact)[:, rows] ** 2).sum(axis=1).mean()
        # rotation vectors add up to a thousandth of the turn: 4000 readings tell 2 %
        assert scatter == pytest.approx((sigma[0, rows] ** 2).sum(), rel=0.08)


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_a_single_value_has_the_noise_along_the_line_of_sight_alone(kind: Kind) -> None:
    if kind.columns != 1:
        return
    instrument = load_instrument(instrument_of(kind))
    exact = kind.measure(stands(), NO_NOISE, instrument)
    for k in range(6):
        noise = np.zeros_like(NO_NOISE)
        noise[k] = 2.0
        change = kind.measure(stands(), noise, instrument) - exact
        assert change == pytest.approx(
            np.full(exact.shape, 2.0 * (k == 0)) * instrument.sigma_length
        )


@pytest.mark.parametrize("kind", kinds().values(), ids=lambda kind: kind.name)
def test_every_value_of_a_row_has_one_deviation(kind: Kind) -> None:
    """The three of a rotation have that of the instrument."""
    instrument = load_instrument(instrument_of(kind))
    values = kind.measure(stands(), NO_NOISE, instrument)
    sigma = kind.sigma(values, instrument)
    assert sigma.shape == (len(POINTS), values.shape[1] or 3)  # a socket has no values
    assert (sigma > 0.0).all()
    if kind.name == "pose":
        assert (sigma[:, 3:] == instrument.sigma_rotation).all()
