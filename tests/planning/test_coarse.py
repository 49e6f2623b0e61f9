"""Objectives that a search compares: many candidates at once, on a coarse grid."""

from __future__ import annotations

import csv
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import bar_frames, robot_frames
from ballbar.planning import coarse
from ballbar.planning import search as searching
from ballbar.planning.candidate import PathCandidate, genome_of, rounded, space_of
from ballbar.planning.capsules import segment_distance
from ballbar.planning.clearance import FAR
from ballbar.planning.coarse import STEP, objectives
from ballbar.planning.coarse_crlb import coarse_predictor
from ballbar.planning.evaluation import INFEASIBLE, SCREENED_OUT, Evaluator, evaluators, objective
from ballbar.planning.force import predicted_forces
from ballbar.planning.plan import first_path, known_path
from ballbar.planning.request import load_request
from ballbar.planning.search import RatedCandidate, evaluating_processes, neighbours, search
from ballbar.planning.trajectory import trajectories, trajectories_of_many
from ballbar.sim.path import Lissajous
from tests.helpers.simulated_recordings import SCENARIOS

FREE = np.r_[0:15, 20:23]  # numbers of a genome that an island varies


@pytest.fixture(scope="module")
def evaluator() -> Evaluator:
    return evaluators(load_request(SCENARIOS / "plans" / "irb2400.yaml"))["lund_600"]


@pytest.fixture(scope="module")
def genomes(evaluator: Evaluator) -> Array:
    """The planned path, random ones that can be run, and ones beside them."""
    space, rng = space_of(evaluator.request), np.random.default_rng(3)
    shape, position = known_path(SCENARIOS / "paths" / "irb2400_planned.yaml")
    paths = [PathCandidate(shape, np.array(position)), *(random_path(k) for k in range(13))]
    runnable = np.array([genome_of(space, path) for path in paths])
    beside = runnable.copy()
    beside[:, FREE] += 0.02 * rng.standard_normal((len(beside), FREE.size))
    return np.concatenate((runnable, beside))


def random_path(k: int) -> PathCandidate:
    """The k-th of the study's random paths."""
    with (
        SCENARIOS.parent / "docs" / "studies" / "planned_paths_random_irb2400.csv"
    ).open() as file:
        row = list(csv.DictReader(file))[k]
    keys = ("centre_deg", "amplitude_deg", "cycles", "phase_deg")
    centre, amplitude, cycles, phase = (
        np.array([float(row[f"{key}_b{j}"]) for j in range(1, 6)]) for key in keys
    )
    shape = Lissajous(np.radians(centre), np.radians(amplitude), cycles, np.radians(phase))
    return PathCandidate(shape, np.array([float(row[f"ballbar_{axis}_m"]) for axis in "xyz"]))


def test_what_violates_a_limit_between_the_coarse_samples_is_worse_than_the_best_by_its_excess(
    evaluator: Evaluator, genomes: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An island turns to where both grids keep the limits, instead of away from the limit."""
    plain = objectives(evaluator, genomes)
    order = np.argsort(plain)
    best = float(plain[order[3]])

    def closely(_: Evaluator, candidate: PathCandidate) -> SimpleNamespace:
        rank = next(
            r
            for r, k in enumerate(order)
            if _same(candidate, evaluator.space.candidate(genomes[k]))
        )
        return SimpleNamespace(violations=[] if rank == 2 else ["one"], excess=0.1 * (rank + 1))

    monkeypatch.setattr(coarse.evaluation, "check", closely)
    found = objectives(evaluator, genomes, best=best)
    np.testing.assert_allclose(found[order[:2]], [best + 0.1, best + 0.2])
    np.testing.assert_array_equal(found[order[2:]], plain[order[2:]])
    of_the_first = objectives(evaluator, genomes[order[:1]], best=np.inf)
    np.testing.assert_allclose(of_the_first, INFEASIBLE + 0.1)


def _same(first: PathCandidate, second: PathCandidate) -> bool:
    """Whether one candidate is the other one, rounded."""
    return bool(np.allclose(first.shape.phase, second.shape.phase, atol=1e-3))


@pytest.mark.slow
def test_coarse_objectives_rank_paths_as_full_ones_do(evaluator: Evaluator, genomes: Array) -> None:
    fast = objectives(evaluator, genomes)
    full = np.array([objective(evaluator, genome) for genome in genomes])
    assert (fast < INFEASIBLE).tolist() == (full < INFEASIBLE).tolist()
    assert ((fast > SCREENED_OUT) == (full > SCREENED_OUT)).all()
    runnable = full < INFEASIBLE
    assert 14 <= runnable.sum() < len(genomes)
    above = fast[runnable] - full[runnable]
    assert 0.0 < above.mean() < 0.2  # ballbar.planning.coarse_crlb: 0.13
    assert np.corrcoef(fast[runnable], full[runnable])[0, 1] > 0.99


def test_with_more_samples_the_coarse_prediction_is_the_full_one(
    evaluator: Evaluator, genomes: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tension that is free at each of 114 samples, or a spline through 240."""
    monkeypatch.setattr(coarse, "STEP", 0.5)
    monkeypatch.setattr(coarse, "SEEN", 1.0)
    fine = replace(evaluator, coarse=coarse_predictor(evaluator.predictor, samples=114))
    full = objective(evaluator, genomes[0])
    assert objectives(fine, genomes[:1])[0] == pytest.approx(full, abs=0.06)


def test_a_candidate_counts_the_same_whoever_stands_beside_it(
    evaluator: Evaluator, genomes: Array
) -> None:
    together = objectives(evaluator, genomes)
    apart = np.concatenate([objectives(evaluator, genome[None]) for genome in genomes])
    assert together == pytest.approx(apart, abs=1e-9)


def test_runs_are_the_trajectories_of_their_candidates(
    evaluator: Evaluator, genomes: Array
) -> None:
    space, timing = space_of(evaluator.request), evaluator.request.timing
    shapes, positions = space.many(genomes[:3])
    allowed = np.ones((3, 4), dtype=np.bool_)
    model = evaluator.force_model
    assert model is not None
    many = trajectories_of_many(
        evaluator.cell, shapes, positions, timing, allowed=allowed, step=STEP
    )
    assert many is not None
    runs, which = many
    tension = predicted_forces(model, runs).tension
    for k in range(3):
        candidate = space.candidate(genomes[k])
        alone = trajectories(evaluator.cell, candidate, timing, step=STEP)
        own = np.flatnonzero(which == k)
        assert own.size == len(alone)
        for run, trajectory in zip(own, alone, strict=True):
            part = runs.of_runs(np.array([run]))
            for name in ("t", "b", "q", "speed", "acceleration", "tip", "tip_speed"):
                assert getattr(part, name) == pytest.approx(getattr(trajectory, name), abs=1e-9)
            force = predicted_forces(model, trajectory).tension
            assert tension.reshape(*force.shape[:1], runs.runs, -1)[:, run] == pytest.approx(force)


def test_what_would_be_the_best_is_looked_at_on_the_fine_grid(
    evaluator: Evaluator, genomes: Array
) -> None:
    """The tool is fastest between two samples of the coarse grid, where it passes the limit."""
    space, timing = space_of(evaluator.request), evaluator.request.timing
    fastest = []
    for genome in genomes[:14]:
        candidate = rounded(space.candidate(genome))
        grids = (trajectories(evaluator.cell, candidate, timing, step=s)[0] for s in (0.2, STEP))
        fastest.append([float(grid.tip_speed.max()) for grid in grids])
    fine, coarse = np.array(fastest).T
    k = int((fine / coarse).argmax())
    between = {"tcp_speed_m_per_s": 0.5 * (fine[k] + coarse[k])}
    tight = replace(evaluator, limits=evaluator.limits.model_copy(update=between))
    some = genomes[k : k + 1]
    assert objectives(tight, some)[0] < INFEASIBLE
    assert INFEASIBLE < objectives(tight, some, best=np.inf)[0] < INFEASIBLE + 0.1


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_segments_are_no_farther_apart_than_any_of_their_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    p, u, q, v = rng.standard_normal((4, 3))
    if seed % 3 == 0:
        v = -0.5 * u  # parallel
    s = np.linspace(-1.0, 1.0, 401)
    points, others = p + s[:, None] * u, q + s[:, None] * v
    brute = np.linalg.norm(points[:, None] - others, axis=2).min()
    (distance,) = segment_distance(*(w[:, None] for w in (p, u, q, v)))
    assert distance <= brute + 1e-12
    size = float(np.linalg.norm(u) + np.linalg.norm(v))
    assert distance == pytest.approx(brute, abs=0.01 * size)  # points 0.005 of it apart
    least = lsq_linear(np.column_stack((u, -v)), q - p, bounds=(-1.0, 1.0), method="bvls")
    assert distance == pytest.approx(np.linalg.norm(least.fun), abs=1e-9)  # of rounding


def test_clearance_of_runs_is_that_of_each(evaluator: Evaluator, genomes: Array) -> None:
    space, of = space_of(evaluator.request), evaluator.clearance
    alone = [
        trajectories(evaluator.cell, space.candidate(genome), evaluator.request.timing)[0]
        for genome in genomes[:2]
    ]
    frames = [(robot_frames(t.nominal, t.q[::5]), bar_frames(t.nominal, t.b[::5])) for t in alone]
    for (robot, bar), t in zip(frames, alone, strict=True):
        (found,) = of.nearest_of_runs(robot, bar, t.t[::5], within=FAR)
        assert found == of.nearest(t.nominal, t.q, t.b, t.t)


def test_neighbours_of_a_path_have_one_cycle_more_or_less(evaluator: Evaluator) -> None:
    space = space_of(evaluator.request)
    genome = np.full(space.size, 0.5)
    genome[15:20] = (0.1, 0.3, 0.5, 0.7, 0.9)  # 1 to 5 cycles of 5
    cycles = space.candidate(genome).shape.cycles
    changes = [
        space.candidate(start.genome).shape.cycles - cycles
        for start in neighbours(space, RatedCandidate("lund_600", genome, 3.0))
    ]
    assert not changes[0].any()
    assert len(changes) == 1 + 8  # the first has no fewer, the last no more
    assert all(np.abs(change).sum() == 1.0 for change in changes[1:])


@pytest.mark.slow
@pytest.mark.long
def test_a_search_does_not_depend_on_the_number_of_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(searching, "DRAWS", 16)
    requested = load_request(SCENARIOS / "plans" / "irb2400.yaml")
    start, _ = first_path(evaluators(requested))
    ends = []
    for count in (1, 2):
        with evaluating_processes(requested, count) as pool:
            found = search(requested, pool, seconds=600.0, evaluations=300, first=[start], hints=[])
        assert found.best is not None
        ends.append((found.evaluated, found.best.objective, found.best.genome.tolist()))
    assert ends[0] == ends[1]
