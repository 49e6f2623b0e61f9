"""Objectives of many candidates at once, on a coarse grid of time: what a search compares.

As planning.evaluation.objective, with numpy's calls shared by all candidates, samples STEP apart
and the prediction of planning.coarse_crlb. Limits between two samples are exceeded by little, so a
search looks closely at the few candidates that would be its best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.geometry import bar_frames, robot_frames
from planning.candidate import rounded, space_of
from planning.clearance import TIME_STEP, nearest_of_runs
from planning.coarse_crlb import coarse_normals
from planning.evaluation import (
    INFEASIBLE,
    NEARLY,
    SCREENED_OUT,
    UNEXAMINED,
    UNIT_CLEARANCE,
    Evaluator,
    check,
    rms_of_normal,
    tensions_of,
)
from planning.force import Forces, predicted_forces
from planning.limits import cones, measures
from planning.screen import UNREACHED, screen
from planning.trajectory import Trajectory, trajectories_of_many
from sim.path import Lissajous

BATCH, KEPT = 128, 2  # random candidates of a draw, and those of them that may be starts
STEP = 0.5  # [s] of the grid; force, clearance and prediction take every other sample


def objectives(evaluator: Evaluator, genomes: Array, *, best: float = -np.inf) -> Array:
    """(M,) coarse objectives of genomes (M, S) [-]; above INFEASIBLE as in `objective`.

    best : objective below which a candidate is looked at closely, until one of them violates no
        limit on the fine grid either.
    """
    space, limits = space_of(evaluator.request), evaluator.limits
    around = evaluator.request.cell
    screened = screen(evaluator.cell, around, space, limits, genomes)
    out = SCREENED_OUT + screened.excess
    passed = np.flatnonzero(out <= SCREENED_OUT)
    if not passed.size:
        return out
    shapes, positions = space.many(genomes[passed])
    out[passed] = _of_screened(evaluator, shapes, positions, screened.allowed[passed])
    for k in np.argsort(out, kind="stable"):
        if out[k] >= best:
            break
        closely = check(evaluator, rounded(space.candidate(genomes[k])))
        if not closely.violations:
            break
        out[k] = INFEASIBLE + closely.excess
    return out


def sample(evaluator: Evaluator, *, seed: int) -> tuple[Array, Array, int]:
    """Of BATCH uniform draws from the search space the KEPT best that pass the screen.

    Returns their genomes (K, S) [-], best first, their coarse objectives (K,), and the draws.
    """
    size = space_of(evaluator.request).size
    genomes = np.random.default_rng(seed).random((BATCH, size))
    values = objectives(evaluator, genomes)
    best = np.argsort(values, kind="stable")[:KEPT]
    best = best[values[best] < SCREENED_OUT]
    return genomes[best], values[best], BATCH


def _of_screened(
    evaluator: Evaluator, shapes: Lissajous, positions: Array, allowed: NDArray[np.bool_]
) -> Array:
    """(M,) coarse objectives of candidates that passed the screen."""
    out = np.full(len(positions), INFEASIBLE + UNREACHED + UNEXAMINED)
    timing = evaluator.request.timing
    moving = trajectories_of_many(
        evaluator.cell, shapes, positions, timing, allowed=allowed, step=STEP
    )
    if moving is None:
        return out
    trajectory, which = moving
    excess = _of_motion(evaluator, trajectory)
    np.minimum.at(out, which, INFEASIBLE + UNEXAMINED + excess)
    waiting = excess < NEARLY
    while waiting.any():  # one configuration after the other, of those that cannot be run yet
        runs = np.flatnonzero(waiting)
        runs = runs[np.unique(which[runs], return_index=True)[1]]
        some = trajectory.of_runs(runs, every=round(TIME_STEP / STEP))
        values = _examined(evaluator, some, excess[runs], positions[which[runs]])
        out[which[runs]] = np.minimum(out[which[runs]], values)
        waiting[runs] = False
        waiting &= out[which] >= INFEASIBLE
    return out


def _examined(
    evaluator: Evaluator, trajectory: Trajectory, excess: Array, positions: Array
) -> Array:
    """(R,) coarse objectives of runs; excess : (R,) over the limits of motion."""
    forces = None
    if evaluator.force_model is not None:
        forces = predicted_forces(evaluator.force_model, trajectory)
    excess = excess + _of_surroundings(evaluator, trajectory, forces, positions)
    out, runnable = INFEASIBLE + excess, np.flatnonzero(excess <= 0.0)
    if runnable.size:
        out[runnable] = _predicted(evaluator, trajectory, forces, runnable)
    return out


def _of_motion(evaluator: Evaluator, trajectory: Trajectory) -> Array:
    """(R,) excess of each run over the limits of motion; the space itself keeps to the cables."""
    every = measures(evaluator.cell, evaluator.limits, trajectory)
    every += cones(evaluator.request.cell, trajectory)
    worst = (m.excess.reshape(trajectory.runs, -1).max(axis=1) for m in every)
    return np.asarray(np.sum([np.maximum(excess, 0.0) for excess in worst], axis=0))


def _of_surroundings(
    evaluator: Evaluator, trajectory: Trajectory, forces: Forces | None, positions: Array
) -> Array:
    """(R,) excess of each run over the limits of force and clearance.

    positions : (R, 3) [m] of the ball-bar.
    """
    runs, limits = trajectory.runs, evaluator.limits
    out = np.zeros(runs)
    if forces is not None:
        largest = np.abs(forces.tension).max(axis=0).reshape(runs, -1).max(axis=1)
        out += np.maximum(np.log(largest / limits.force_N), 0.0)
    bar, instants = bar_frames(trajectory.nominal, trajectory.b), trajectory.t.size // runs
    closest = nearest_of_runs(
        evaluator.clearance,
        robot_frames(trajectory.nominal, trajectory.q),
        replace(bar, origin=bar.origin + np.repeat(positions, instants, axis=0).T),
        trajectory.t[:instants],
        within=limits.clearance_m,
    )
    distance = np.array([nearest.distance for nearest in closest])
    return np.asarray(out + (limits.clearance_m - distance) / UNIT_CLEARANCE)


def _predicted(
    evaluator: Evaluator, trajectory: Trajectory, forces: Forces | None, runs: NDArray[np.intp]
) -> Array:
    """(K,) natural logarithm of the TCP sigma in um of some runs of a trajectory."""
    some = trajectory.of_runs(runs)
    samples = np.arange(trajectory.t.size).reshape(trajectory.runs, -1)[runs].ravel()
    carried = None if forces is None else forces.carried.part(samples)
    tension = tensions_of(trajectory, forces)[0, samples]
    normals = coarse_normals(evaluator.coarse, some, carried, tension)
    tcp = [rms_of_normal(evaluator, normal, evaluator.coarse.layout) for normal in normals]
    return np.asarray(np.log(np.array(tcp) * 1e6))
