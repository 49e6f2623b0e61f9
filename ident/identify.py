"""From logs, still poses or both to the robot's parameters, with their uncertainty and a verdict.

Each recording: smooth -> automatic start -> identifiable subset -> whitened fit of the `dh` model
with the clock as parameter (ballbar.ident.recording_fit). Several recordings are then fitted
together, by kinematics alone or with corrections (ballbar.ident.complete_fit), and one where
something systematic is left. Still poses alone are fitted by ballbar.ident.table_fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.payload import with_payload
from ballbar.cell.poses import PoseTable
from ballbar.cell.statistics import rms
from ballbar.ident.causes import Causes
from ballbar.ident.complete_fit import fit_complete, settled
from ballbar.ident.corrections import supported_corrections
from ballbar.ident.corrections.rod_elongation import rod_elongation
from ballbar.ident.estimates import result_of
from ballbar.ident.estimator.unknowns import PlacedPoses
from ballbar.ident.joint_errors import fit_joint_errors, may_have_joint_errors
from ballbar.ident.loads.logged_tension import logged_torque
from ballbar.ident.loads.payload import PayloadEstimate, payload_of_recordings
from ballbar.ident.loads.rod_tension import TORQUE_NEEDS
from ballbar.ident.model_choice import AUTOCORRELATED
from ballbar.ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ballbar.ident.recording_fit import BEYOND, Logs, RecordingFit, fit_recording
from ballbar.ident.remarks import CORRELATED
from ballbar.ident.result import Identification
from ballbar.ident.softening import fit_softening
from ballbar.ident.start.automatic import StartError
from ballbar.ident.start.placements import placed_by
from ballbar.ident.tracker import judged_by_tracker
from ballbar.ident.verdict import UNEXPLAINED, Status, implausible, noise_status

COMPLETE_ENCODERS = 4  # fewer cannot carry the complete model (notes/identification sec. 2)
LEFT_OUT = "the points of the tracker were left out: ball-bar and tracker together fit worse"
LONG = 1_000_000  # rows, an hour: what another process fits is in memory several times
PAYLOAD_TIMES = 6000  # of torque from which masses are found; those of 8 min


def identify_together(
    cell: Cell,
    recordings: Sequence[Logs],
    table: PoseTable | None = None,
    *,
    options: FitOptions = DEFAULTS,
    listener: Listener = SILENT,
) -> Identification:
    """Identify one robot from one or several recordings, and still poses of it.

    Each recording has its own clock, encoder offsets and base pose of the ball-bar, each table of
    still poses its own seats and targets. Where the result is not acceptable, its verdict names
    what may be wrong with the logs (ballbar.ident.causes). Where a tracker contradicts it, the
    verdict says so (ballbar.ident.tracker).

    Raises StartError when the logs of a recording cannot be brought together, with the same cause,
    InputError for still poses of another robot, and PoseStartError where their measurements and
    the robot cannot be brought together.
    """
    if table is not None and table.robot.name != cell.robot.name:
        raise InputError(
            f"{table.name} is of robot {table.robot.name}, the recordings are of "
            f"{cell.robot.name}: one fit is of one robot. Identify them one by one."
        )
    try:
        single = _fitted_alone(cell, recordings, options, listener)
    except StartError as error:
        raise StartError(Causes.of(cell, recordings).before(error)) from None
    causes, still = None, None
    if table is not None:
        listener.progress("finding seats and targets")
        still = placed_by(single[0].geometry, table)
    if any(map(_is_other_machine, single)):
        causes = Causes.of(cell, recordings, single)
    strange = [each for each in single if _is_no_robot(each)]
    if strange or (causes and causes.hopeless):  # the complete fit would come to nothing
        if causes and len(single) > 1:
            raise StartError(str(causes))
        result = kinematic_result(cell, (strange or single)[0], options)
        if len(single) > 1:
            raise StartError(f"{strange[0].logs.name}: {result.verdict.sentence}")
    else:
        result = _fitted(cell, single, options, listener, still)
        result = _with_points(cell, single, result, table, options, listener)
    if result.verdict.status in UNEXPLAINED:
        causes = Causes.of(cell, recordings, single) if causes is None else causes
        if causes:
            result = replace(result, verdict=result.verdict.with_cause(str(causes)))
    return _with_trackers(result, recordings)


def _fitted_alone(
    cell: Cell, recordings: Sequence[Logs], options: FitOptions, listener: Listener
) -> list[RecordingFit]:
    """The `dh` fit of each recording; half of them meanwhile, where none is LONG."""

    def fits(some: Sequence[Logs], listener: Listener) -> list[RecordingFit]:
        return [fit_recording(cell, logs, options, listener) for logs in some]

    short = all(logs.robot.t.size < LONG for logs in recordings)
    half = (len(recordings) + 1) // 2 if short else len(recordings)
    others = listener.begin(fits, recordings[half:], SILENT) if recordings[half:] else list
    return [*fits(recordings[:half], listener), *others()]


def kinematic_result(cell: Cell, single: RecordingFit, options: FitOptions) -> Identification:
    """The result of the `dh` fit of one recording, without asking what may be wrong with it."""
    return result_of(cell, [single], single.fit, options)


def _with_trackers(result: Identification, recordings: Sequence[Logs]) -> Identification:
    """The result with what its trackers contradict in the verdict."""
    verdict = result.verdict
    for estimate, logs in zip(result.recordings, recordings, strict=True):
        name = logs.name if len(recordings) > 1 else ""
        verdict = judged_by_tracker(verdict, logs.tracker, estimate.tracker, name=name)
    return replace(result, verdict=verdict)


def _with_points(
    cell: Cell,
    single: Sequence[RecordingFit],
    result: Identification,
    table: PoseTable | None,
    options: FitOptions,
    listener: Listener,
) -> Identification:
    """The result of a fit that takes in the trackers that do not contradict the first one.

    table : still poses of the fit. What contradicts it stays out, for `_with_trackers` to name, and
    so does what makes the verdict worse.
    """
    checks = [estimate.tracker for estimate in result.recordings]
    followed = [check.followed for check in checks if check is not None and check.acceptable]
    if not followed:
        return result
    listener.progress("fitting the points of the tracker too")
    groups = (*(() if table is None else table.groups), *followed)
    distances = () if table is None else table.distances
    still = placed_by(
        result.robot.identified.geometry, PoseTable(followed[0].file, cell.robot, groups, distances)
    )
    alone = [replace(each, logs=replace(each.logs, tracker=None)) for each in single]
    chosen = replace(options, model="dh") if result.model == "dh" else options
    both = _fitted(cell, alone, chosen, listener, still)
    if both.verdict.status.severity > result.verdict.status.severity:
        return replace(result, verdict=result.verdict.with_warning(LEFT_OUT))
    pairs = zip(both.recordings, checks, strict=True)
    return replace(both, recordings=tuple(replace(e, tracker=check) for e, check in pairs))


def _is_other_machine(recording: RecordingFit) -> bool:
    """Whether a recording by itself is fitted by no built robot."""
    identified = [recording.nominal.table.names[i] for i in recording.subset.parameters]
    strange = implausible(recording.geometry, identified, recording.nominal)
    return bool(strange) or not recording.fit.converged


def _is_no_robot(recording: RecordingFit) -> bool:
    """Whether what kinematics leave of a recording is far beyond the size of any correction."""
    error = recording.fit.linear.evaluations[0].closure.error[:3]
    return _is_other_machine(recording) and rms(error) > BEYOND


def _is_misfit(recording: RecordingFit) -> bool:
    """Whether the `dh` fit of four encoders is sure to be judged a misfit, before it is judged."""
    several = len(recording.samples.encoders) >= COMPLETE_ENCODERS
    judged = not (_is_other_machine(recording) or recording.start.ambiguous)
    return several and judged and noise_status(recording.fit.chi2_per_dof) is Status.MISFIT


def _fitted(
    cell: Cell,
    single: Sequence[RecordingFit],
    options: FitOptions,
    listener: Listener,
    still: PlacedPoses | None,
) -> Identification:
    """The result of the model that the options name, or that the data ask for.

    Kinematics of several recordings together, or of still poses and recordings, are the complete
    model without corrections.
    """
    judged = partial(result_of, begin=listener.begin)
    together = len(single) > 1 or still is not None
    if options.model == "dh":
        if not together:
            return judged(cell, single, single[0].fit, options)
        fit = fit_complete(cell, single, (), options, listener, still=still)
        return judged(cell, single, fit, options)
    automatic = options.model == "auto" and options.corrections is None
    measures_length = cell.ballbar.stroke is not None
    if automatic and not any(map(_is_misfit, single)):
        simple = [judged(cell, [each], each.fit, options) for each in single]
        if not any(map(_asks_for_more, simple)):
            if not together and not _shares_errors(simple[0]):
                return simple[0]
            extras = [] if measures_length else [rod_elongation(cell)]
            fit = fit_complete(cell, single, (), options, listener, extras, still)
            result = judged(cell, single, fit, options)
            if not together or result.verdict.status is Status.GOOD:
                return result
    corrections, payload = supported_corrections(cell.robot, rod_sensed=measures_length), None
    if options.corrections is not None:
        corrections = list(options.corrections)
    elif payload := _payload(cell, single, options):
        cell = with_payload(cell, payload.payload)
    few = len(single[0].samples.encoders) < COMPLETE_ENCODERS and not measures_length
    if automatic and not together and few:
        corrections = []  # step faults can be sized all the same
    fit = fit_complete(cell, single, corrections, options, listener, still=still)
    searched = automatic and bool(corrections) and not fit.given_up
    if searched:
        fit = fit_softening(cell, fit, listener)
    result = judged(cell, single, fit, options, payload=payload)
    if searched and may_have_joint_errors(result):
        with_errors, orders = fit_joint_errors(cell, fit, listener)
        if with_errors is not fit:
            fit = settled(with_errors, listener)
            result = judged(cell, single, fit, options, orders, payload=payload)
    return result


def _payload(
    cell: Cell, single: Sequence[RecordingFit], options: FitOptions
) -> PayloadEstimate | None:
    """The masses that the torque logs ask for; None where no recording has one that tells."""
    if options.force == "none" or any(cell.robot.lacks(key) for key in TORQUE_NEEDS):
        return None
    logged = [r for r in single if r.logs.robot.torque is not None and r.samples.encoders]
    if not logged:
        return None
    torques = [
        logged_torque(cell, r.samples, r.as_built, r.clock, r.logs.robot, most=PAYLOAD_TIMES)
        for r in logged
    ]
    return payload_of_recordings(cell, [r.as_built for r in logged], torques)


def _asks_for_more(simple: Identification) -> bool:
    """Whether the dh model leaves what the complete one could explain, or a step to be sized."""
    (recording,) = simple.recordings
    if simple.robot.cell.ballbar.stroke is not None and recording.clock is not None:
        # One residual a sample: the noise of the length takes up what the model leaves over.
        left = simple.fit.autocorrelation > AUTOCORRELATED
        return left or not simple.verdict.acceptable
    left = simple.verdict.status in (Status.SUSPECT, Status.MISFIT)
    # Gears that no file describes may yield by more than any robot is off its catalogue.
    left |= simple.verdict.status is Status.IMPLAUSIBLE and simple.robot.robot.lacks("gears")
    return (left and len(recording.encoders) >= COMPLETE_ENCODERS) or bool(recording.step_faults)


def _shares_errors(simple: Identification) -> bool:
    """Whether neighbouring residuals of a good dh fit are correlated: the rod may be compliant."""
    rigid = simple.robot.cell.ballbar.stroke is None
    several = len(simple.recordings[0].encoders) >= COMPLETE_ENCODERS
    return rigid and several and simple.fit.autocorrelation > CORRELATED
