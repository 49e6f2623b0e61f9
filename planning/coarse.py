"""Objectives of many candidates at once, on a coarse grid of time: what a search compares.

The objectives are those of ballbar.planning.evaluation.objective, with numpy's calls shared by all
candidates, samples STEP apart and the prediction of ballbar.planning.coarse_crlb. Between two
samples a limit is exceeded by little, so a search looks closely at the few candidates that would be
its best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.closed_form import has_closed_form
from ballbar.planning import evaluation
from ballbar.planning.candidate import rounded
from ballbar.planning.coarse_crlb import coarse_normals
from ballbar.planning.followed_path import predict_followed
from ballbar.planning.force import predicted_forces
from ballbar.planning.limits import measures
from ballbar.planning.screen import UNREACHED, screen
from ballbar.planning.trajectory import Trajectory, trajectories_of_many
from ballbar.sim.path import Lissajous

BATCH, KEPT = 128, 2  # random candidates of a draw, and those of them that may be starts
FOLLOWED = 60  # samples of a path that an instrument follows
# Share of the force's limit on the coarse grid: between its samples the force is larger by 5 % in
# half of all paths.
SEEN = 0.93
STEP, EVERY = 0.75, 2  # [s] of the grid; of it force, clearance and prediction take every other


def objectives(evaluator: evaluation.Evaluator, genomes: Array, *, best: float = -np.inf) -> Array:
    """(M,) coarse objectives of genomes (M, S) [-]; above INFEASIBLE as in `objective`.

    best : objective below which a candidate is looked at closely, until one of them violates no
        limit on the fine grid either. One that does is worse than `best` by its excess.
    """
    space = evaluator.space
    screened = screen(evaluator.cell, evaluator.request.cell, space, evaluator.limits, genomes)
    values = evaluation.SCREENED_OUT + screened.excess
    passed = np.flatnonzero(values <= evaluation.SCREENED_OUT)
    if not passed.size:
        return values
    shapes, positions = space.many(genomes[passed])
    values[passed] = _of_screened(evaluator, shapes, positions, screened.allowed[passed])
    for k in np.argsort(values, kind="stable"):
        if values[k] >= best:
            break
        closely = evaluation.check(evaluator, rounded(space.candidate(genomes[k])))
        if not closely.violations:
            break
        values[k] = min(best, evaluation.INFEASIBLE) + closely.excess
    return values


def sample(evaluator: evaluation.Evaluator, *, seed: int) -> tuple[Array, Array, int]:
    """The KEPT best of BATCH uniform draws from the search space that pass the screen.

    Returns their genomes (K, S) [-], best first, their coarse objectives (K,), and the draws.
    """
    size = evaluator.space.size
    genomes = np.random.default_rng(seed).random((BATCH, size))
    values = objectives(evaluator, genomes)
    best = np.argsort(values, kind="stable")[:KEPT]
    best = best[values[best] < evaluation.SCREENED_OUT]
    return genomes[best], values[best], BATCH


def _of_screened(
    evaluator: evaluation.Evaluator, shapes: Lissajous, positions: Array, allowed: NDArray[np.bool_]
) -> Array:
    """(M,) coarse objectives of candidates that passed the screen."""
    values = np.full(len(positions), evaluation.INFEASIBLE + UNREACHED + evaluation.UNEXAMINED)
    runs_of_all = trajectories_of_many(
        evaluator.cell, shapes, positions, evaluator.request.timing, allowed=allowed, step=STEP
    )
    if runs_of_all is None:
        return values
    trajectory, which = runs_of_all
    # the space itself keeps to the cables
    limits = measures(
        evaluator.cell, evaluator.limits, trajectory, evaluator.request.cell, evaluator.held
    )
    worst = (limit.excess.reshape(trajectory.runs, -1).max(axis=1) for limit in limits)
    excess = np.asarray(np.sum([np.maximum(over, 0.0) for over in worst], axis=0))
    np.minimum.at(values, which, evaluation.INFEASIBLE + evaluation.UNEXAMINED + excess)
    order, waiting = np.argsort(excess, kind="stable"), excess < evaluation.NEARLY
    if has_closed_form(trajectory.nominal.robot):  # the others hardly differ in force and clearance
        waiting[np.setdiff1d(order, order[np.unique(which[order], return_index=True)[1]])] = False
    while waiting.any():  # one configuration after the other, of those that cannot be run yet
        runs = order[waiting[order]]
        runs = runs[np.unique(which[runs], return_index=True)[1]]
        some = trajectory.of_runs(runs, every=EVERY)
        examined = _examined(evaluator, some, excess[runs], positions[which[runs]])
        values[which[runs]] = np.minimum(values[which[runs]], examined)
        waiting[runs] = False
        waiting &= values[which] >= evaluation.INFEASIBLE
    return values


def _examined(
    evaluator: evaluation.Evaluator, trajectory: Trajectory, excess: Array, positions: Array
) -> Array:
    """(R,) coarse objectives of runs with their forces and clearances.

    excess : (R,) over the limits of motion. positions : (R, 3) [m] of the ball-bar.
    """
    count, limits, forces = trajectory.runs, evaluator.limits, None
    over = np.zeros(count)
    if evaluator.force_model is not None:
        forces = predicted_forces(evaluator.force_model, trajectory)
        largest = forces.magnitude.reshape(count, -1).max(axis=1)
        over += np.maximum(np.log(largest / (SEEN * limits.force_N)), 0.0)
    bar, instants = trajectory.bar, trajectory.t.size // count
    closest = evaluator.clearance.nearest_of_runs(
        trajectory.robot,
        replace(bar, origin=bar.origin + np.repeat(positions, instants, axis=0).T),
        trajectory.t[:instants],
        within=limits.clearance_m,
    )
    distance = np.array([nearest.distance for nearest in closest])
    excess = excess + (over + (limits.clearance_m - distance) / evaluation.UNIT_CLEARANCE)
    values, runnable = evaluation.INFEASIBLE + excess, np.flatnonzero(excess <= 0.0)
    if runnable.size:
        if (setup := evaluator.followed) is not None:
            for run in runnable:
                alone = trajectory.of_runs(np.array([run]))
                predicted = predict_followed(setup, evaluator.request, alone, samples=FOLLOWED)
                values[run] = np.log(evaluation.tcp_rms(evaluator, predicted) * 1e6)
            return values
        samples = np.arange(trajectory.t.size).reshape(count, -1)[runnable].ravel()
        normals = coarse_normals(
            evaluator.coarse,
            trajectory.of_runs(runnable),
            None if forces is None else forces.carried.part(samples),
            evaluation.tensions_of(trajectory, forces)[0, samples],
        )
        tcp = [
            evaluation.rms_of_normal(evaluator, normal, evaluator.coarse.layout)
            for normal in normals
        ]
        values[runnable] = np.log(np.array(tcp) * 1e6)
    return values
