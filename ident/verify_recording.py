"""A stored calibration against one recording of today.

The recording is fitted twice: with the machine held, and with it free within the priors of an
identification. The difference of the two estimates is

    x = G (e + B d) + n,   G = 1 - H P^-1,

with H the white covariance of the free fit, P the priors, e the error of the stored machine (its
stated covariance C) and what an unchanged one is apart by from one recording to the next, n the
noise of this recording (its autocorrelation-robust covariance), and d what changed since, which
moves the unknowns along the columns B of a cause. Where the largest evidence of a single cause
(ballbar.ident.verification) is beyond what an unchanged machine exceeds in FALSE_ALARMS of the
checks, the machine changed. The distribution is that of draws of x with the tails of Student's t,
as the noise is estimated from some tens of blocks of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.clock import UNSEEN_OFFSET, UNSEEN_SKEW
from ballbar.cell.descriptions import Cell, Robot
from ballbar.ident.causes import Causes
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.smoothed_harmonics import smoothing_covariance
from ballbar.ident.estimator.step_faults import step_faults_in_logs
from ballbar.ident.estimator.uncertainty import uncertainty
from ballbar.ident.held_machine import (
    closed_loop,
    freed,
    loop_closure,
    normalised_innovation,
    recording_alone,
)
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs, RecordingFit
from ballbar.ident.result import Machine
from ballbar.ident.single_causes import (
    Cause,
    Explanation,
    covariance_of_wander,
    exchangeable,
    free_names,
    single_causes,
    with_exchangeable,
)
from ballbar.ident.verdict import MISFIT
from ballbar.ident.verification import RIVAL, SEEN, Score, Verification, followed

# Of the covariance of the free fit that is added to that of the difference: where the recording
# tells nothing, both fits end within so much of where they began.
UNSETTLED = 0.01
BLIND = 3e-4  # [rad] of an axis zero that may change unseen without being named


def verify_recording(
    machine: Machine, logs: Logs, *, options: FitOptions = DEFAULTS, listener: Listener = SILENT
) -> Verification:
    """Whether an identified machine still explains a recording, and if not, what changed.

    logs : of the same robot, instrument and plate; clock, base pose of the instrument and encoder
        offsets are fitted.

    Raises StartError when the logs cannot be brought together, with the cause
    (ballbar.ident.causes).
    """
    cell = machine.robot.cell
    recording = recording_alone(cell, logs, options, listener)
    listener.progress("fitting the recording with the stored machine held, and free")
    if exchangeable(cell):
        machine = with_exchangeable(machine)
    start = _compared(machine, recording, options)
    causes = single_causes(machine, start.free)
    limit, ranked = start.score.limit(causes, max(1, start.blocks - 1)), start.score.ranked(causes)
    statistic = ranked[0].evidence
    left, single = start, False
    if statistic > limit:
        listener.progress("fitting once more after the likeliest change")
        left, ranked[0], single = followed(start, ranked[0])
    innovation = normalised_innovation(start.closed, machine)
    innovation_left = normalised_innovation(left.closed, left.machine)
    closure, misfit = loop_closure(start.closed), start.free.chi2_per_dof
    sensed = cell.ballbar.stroke is not None
    return Verification(
        name=logs.name,
        error=np.linalg.norm(start.closed.linear.evaluations[0].closure.error[:3], axis=0),
        numbers=f"the loop closes to {closure.sentence}, {innovation:.2f} times what noise and the "
        "stated uncertainty explain",
        figures={
            "position_rms_m": closure.position_rms,
            "angle_rms_rad": closure.angle_rms,
            "normalised_innovation": innovation,
            "chi2_per_dof_with_free_machine": misfit,
            "log_bayes_factor": statistic,
        },
        unchanged=statistic <= limit and innovation**2 <= MISFIT,
        explanations=tuple(ranked),
        single=single,
        tried="zero of an axis, tool, "
        + ("zero or scale of the length, gear" if sensed else "rod, plate, gear"),
        square=float(start.score.value @ start.score.value),
        limit=limit,
        blind=_blind(start.score, causes, limit, cell.robot),
        doubt=_doubt(cell, recording, explained=is_explained(misfit, innovation_left)),
    )


def is_explained(misfit: float, innovation: float) -> bool:
    """Whether some machine of this kind explains a recording.

    With the machine free the noise alone has to explain the rest (misfit); of the stored one, or of
    it after the likeliest change, the stated uncertainty counts as well (innovation).
    """
    return misfit <= MISFIT or innovation**2 <= MISFIT


def changed(machine: Machine, free: Fit, by: Explanation) -> Machine:
    """The machine after a change of the size that explains a recording."""
    robot, steps = machine.robot, by.cause.columns @ by.size
    moves = dict(zip(free_names(machine, free), steps.tolist(), strict=True))
    geometry = robot.geometry
    moved = {name: geometry[name] + v for name, v in moves.items() if name in geometry.table.index}
    names = [c.name for correction in robot.corrections for c in correction.coefficients]
    values = robot.values
    if values is not None:
        values = values + [moves.get(name, 0.0) for name in names]
    return replace(machine, robot=replace(robot, geometry=geometry.replaced(moved), values=values))


def _unseen_clock(recording: RecordingFit) -> str:
    """Why a recording of a length does not determine its clock; empty where it does.

    Its fit may then end at another clock, which passes for a change of the machine.
    """
    position = recording.fit.model.unknowns.own[0].clock
    if position is None or not recording.samples.measures_length:
        return ""
    offset, skew = np.sqrt(np.diag(recording.fit.covariance))[position]
    if offset <= UNSEEN_OFFSET and skew <= UNSEEN_SKEW:
        return ""
    return (
        "a length that changes too little to tell its clock (sigma of the offset "
        f"{offset * 1e3:.0f} ms, of the skew {skew * 1e6:.0f} ppm), so take a path along which it "
        "changes more"
    )


def _doubt(cell: Cell, recording: RecordingFit, *, explained: bool) -> str:
    """Why a recording cannot be held against a machine; empty where it can."""
    if unseen := _unseen_clock(recording):
        return f"perhaps {unseen}"
    ambiguous = recording.start.ambiguous
    if explained and not ambiguous:
        return ""
    if causes := Causes.of(cell, [recording.logs]):
        return f"perhaps {causes}"
    if ambiguous:
        return "perhaps its logs can be aligned in more than one way"
    return (
        "no machine of this kind explains the recording (look at it with ballbar check; if nothing "
        "is wrong with it, identify again)"
    )


def _blind(score: Score, causes: Sequence[Cause], limit: float, robot: Robot) -> dict[int, float]:
    """Axes whose zero may have changed by more than BLIND unseen, axis 1 apart.

    Its zero turns the robot about its base, which is not known to the ball-bar anyway.
    """
    seen = max(SEEN, float(np.sqrt(2.0 * max(0.0, limit))))  # evidence is half a squared deviation
    sizes = {c.axis: score.unseen(c, seen) for c in causes if c.kind == "axis"}
    sizes = {axis: sizes.get(axis, np.inf) for axis in range(2, robot.joints + 1)}
    return {axis: size for axis, size in sizes.items() if size > BLIND}


@dataclass(frozen=True, eq=False)
class _Compared:
    """A recording with a machine held, and with it free."""

    machine: Machine
    recording: RecordingFit
    options: FitOptions
    closed: Fit
    free: Fit
    score: Score
    blocks: int  # of time, that the noise was estimated from

    def after(self, change: Explanation) -> _Compared:
        """The same of the machine after a change."""
        return _compared(changed(self.machine, self.free, change), self.recording, self.options)

    def explained(self, cause: Cause) -> bool:
        """Whether nothing speaks strongly for a second change beside a cause."""
        causes = single_causes(self.machine, self.free)
        return self.score.beside(cause).ranked(causes)[0].evidence <= RIVAL


def _compared(machine: Machine, recording: RecordingFit, options: FitOptions) -> _Compared:
    faults = step_faults_in_logs(recording.samples, recording.clock)
    closed = closed_loop(machine.robot, recording, options, faults, machine.excess, SILENT)
    changes = {name: change for name, (change, _) in exchangeable(machine.robot.cell).items()}
    free = freed(closed, machine, changes)
    stated, names, layout = uncertainty(free), free_names(machine, free), free.model.unknowns
    before = dict(zip(closed.model.unknowns.names, closed.x, strict=True))
    values = [before[n] if n in before else machine.robot.geometry[n] for n in names]
    at = np.array([layout.names.index(name) for name in names])
    own = np.array([machine.names.index(name) for name in names])
    wander = covariance_of_wander(single_causes(machine, free), at.size)
    white, inflation = free.covariance[np.ix_(at, at)], stated.inflation[at]
    # what the priors of the recording's own unknowns contribute is noise as the data's part is
    by_data = white - white @ (white / layout.sigma[at][:, None] ** 2)
    noise = max(1.0, free.chi2_per_dof) * np.outer(inflation, inflation) * by_data
    seen = np.eye(at.size) - white / layout.sigma[at] ** 2
    smoothed = smoothing_covariance(free, machine.robot.cell)[np.ix_(at, at)]
    error = seen @ (machine.covariance[np.ix_(own, own)] + wander) @ seen.T
    root = np.linalg.cholesky(error + noise + smoothed + UNSETTLED * white)
    shown = np.linalg.solve(root, seen)  # share of a change that the estimate shows
    score = Score(
        np.linalg.solve(root, free.x[at] - np.array(values)), lambda columns: shown @ columns
    )
    return _Compared(
        machine, recording, options, closed=closed, free=free, score=score, blocks=stated.blocks
    )
