"""Held-out validation: does a machine explain what it was not identified from?

What belongs to the held-out recording or table itself is fitted, the machine is held
(ballbar.ident.held_machine).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.number_text import significant_text
from ballbar.cell.poses import PoseTable
from ballbar.ident.causes import Causes
from ballbar.ident.cross_validation import LEVEL, SAME_PLACE
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.step_faults import (
    MAX_FOUND,
    find_step_fault,
    sized,
    step_faults_in_logs,
)
from ballbar.ident.held_machine import (
    LoopClosure,
    closed_loop,
    loop_closure,
    normalised_innovation,
    placed,
    recording_alone,
)
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.ident.robot.identified import IdentifiedRobot, range_sentence
from ballbar.ident.signals.steps import StepFault
from ballbar.ident.table_estimate import TableEstimate, position_errors
from ballbar.ident.table_steps import other_sides
from ballbar.ident.tracker import TrackerCheck, check_tracker
from ballbar.ident.verdict import MISFIT

WORSE = 2.0  # held-out error over that predicted by cross-validation: no longer the same robot


@dataclass(frozen=True)
class HeldOut:
    """One recording that took no part in the identification."""

    name: str
    identified: LoopClosure
    normalised_innovation: float  # residual over what noise and the stated uncertainty explain
    nominal: LoopClosure  # of the catalogue's robot and ball-bar, the recording's own part fitted
    samples: int
    ambiguous: bool  # whether its logs can be aligned in more than one way
    step_faults: tuple[StepFault, ...]
    causes: Causes | None = None  # what may be wrong with its logs, where it is not acceptable
    tracker: TrackerCheck | None = None  # None without a tracker, or where it cannot be compared

    @property
    def acceptable(self) -> bool:
        return self.normalised_innovation**2 <= MISFIT and not self.ambiguous

    @property
    def sentence(self) -> str:
        """How well the machine explains the recording."""
        sizes = (self.nominal.position_rms * 1e3, self.identified.ratio, self.normalised_innovation)
        nominal, ratio, innovation = (significant_text(v, 2) for v in sizes)
        closure = (
            f"Held out {self.name}: the loop closes to {self.identified.sentence}; nominal robot "
            f"{nominal} mm. {ratio} times what noise explains, {innovation} with the stated "
            "uncertainty"
        )
        if self.ambiguous:
            doubt = "its logs can be aligned in more than one way, so this proves nothing"
            return f"{closure}; but {doubt}.{self._cause}"
        if self.acceptable:
            return f"{closure}."
        return (
            f"{closure}: a misfit. The machine as identified does not explain this "
            f"recording.{self._cause}"
        )

    @property
    def _cause(self) -> str:
        return f" Perhaps {self.causes}" if self.causes else ""


def held_out(
    result: Identification,
    logs: Logs,
    *,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> HeldOut:
    """How well an identified machine closes the loop of a recording it was not identified from.

    logs : of the same robot, ball-bar and plate. options : its samples and the source of its force.

    Raises StartError when the logs cannot be brought together, with the cause
    (ballbar.ident.causes).
    """
    machine = result.machine
    cell, robot, excess = machine.robot.cell, machine.robot, machine.excess
    recording = recording_alone(cell, logs, options, listener)
    bare = robot.rigid(machine.nominal)
    listener.progress(f"closing the loop of {logs.name}")
    faults = step_faults_in_logs(recording.samples, recording.clock)
    # what a poor model leaves over passes for steps, so only the complete one looks for more
    most = len(faults) + MAX_FOUND if result.model == "complete" else 0
    closed = closed_loop(robot, recording, options, faults, excess, listener)
    while len(faults) < most and (fault := find_step_fault(closed)) is not None:
        faults = (*faults, fault)
        closed = closed_loop(robot, recording, options, faults, excess, listener)
    nominal = closed_loop(bare, recording, options, faults, excess, listener)
    tracker = None
    if logs.tracker is not None:
        both = closed.linear.evaluations[0], nominal.linear.evaluations[0]
        tracker = check_tracker(logs.tracker, *both, tcp_sigma=machine.tcp_sigma)
    outcome = HeldOut(
        name=logs.name,
        identified=loop_closure(closed),
        normalised_innovation=normalised_innovation(closed, machine),
        nominal=loop_closure(nominal),
        samples=closed.model.recordings[0].times.size,
        ambiguous=recording.start.ambiguous,
        step_faults=sized(closed, faults, cell.ballbar.encoder_lines),
        tracker=tracker,
    )
    return outcome if outcome.acceptable else replace(outcome, causes=Causes.of(cell, [logs]))


@dataclass(frozen=True, eq=False)
class PoseHeldOut:
    """A table of poses that took no part in the identification."""

    name: str
    error: Array  # (N,) [m] of the identified robot
    nominal: Array  # (N,) [m] of the nominal robot, seats fitted in the same way
    predicted: float  # [m] mean error that cross-validation predicts
    out_of_range: dict[int, tuple[float, float]]  # axes, from 1, beyond their fitted range [rad]
    moved: tuple[str, ...] = ()  # targets as they are called on the other side of a step
    elsewhere: bool = False  # whether it was measured at a place that was not fitted

    @property
    def acceptable(self) -> bool:
        return float(self.error.mean()) <= WORSE * self.predicted

    @property
    def sentence(self) -> str:
        """How well the robot predicts the poses."""
        mean, high = self.error.mean() * 1e3, np.quantile(self.error, LEVEL) * 1e3
        opening = (
            f"Held out {self.name}: {self.error.size} poses to {mean:.3f} mm (95 %: {high:.3f} "
            f"mm); nominal robot {self.nominal.mean() * 1e3:.3f} mm; predicted "
            f"{self.predicted * 1e3:.3f} mm"
        )
        if self.moved:
            opening += f"; its target stands as {', '.join(map(repr, self.moved))}"
        if self.out_of_range:
            opening += f"; some poses are {range_sentence(self.out_of_range)}"
        if self.acceptable:
            return f"{opening}."
        return f"{opening}: a misfit. The robot as identified does not explain these poses."


def held_out_poses(result: TableEstimate, table: PoseTable) -> PoseHeldOut:
    """How well an identified robot predicts a table that it was not identified from."""
    robot = result.identified_robot()
    identified, moved = _as_it_stood(result, robot, table)
    bare = robot.rigid(robot_geometry(table.robot))
    before = result.nominal.model.unknowns
    nominal_targets = {name: before.target(result.nominal.x, name) for name in before.targets}
    return PoseHeldOut(
        name=table.name,
        error=position_errors(identified),
        nominal=position_errors(placed(bare, table, nominal_targets)),
        predicted=result.cross_validation.mean,
        out_of_range=robot.out_of_range(table.q),
        moved=moved,
        elsewhere=_elsewhere(result, identified),
    )


def _elsewhere(result: TableEstimate, held: Fit) -> bool:
    """Whether a seat of a held-out table stands at another place than all that were fitted."""
    known, own = result.fit.model.unknowns, held.model.unknowns
    fitted = np.stack([known.seat(result.fit.x, name).origin for name in known.seats])
    return any(
        np.linalg.norm(fitted - own.seat(held.x, name).origin, axis=1).min() > SAME_PLACE
        for name in own.seats
    )


def _as_it_stood(
    result: TableEstimate, robot: IdentifiedRobot, table: PoseTable
) -> tuple[Fit, tuple[str, ...]]:
    """A table placed with each target on that side of its steps which fits better, and the names
    of the targets that are not on the side with most fitted poses.
    """
    layout, x = result.fit.model.unknowns, result.fit.x
    known = {name: layout.target(x, name) for name in layout.targets}
    best, moved = placed(robot, table, known), dict[str, str]()
    for target in table.targets:
        for name in other_sides(result.findings.steps, target):
            trial = placed(robot, table, known | {target: layout.target(x, name)})
            if position_errors(trial).mean() < position_errors(best).mean():
                best, moved[target] = trial, name
    return best, tuple(moved.values())
