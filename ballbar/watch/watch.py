"""A recording that is being written, read on and identified again and again.

Each update reads the recording whole, with the reader of every other command: ten minutes at 250 Hz
take a quarter of a second, and whatever the file is, it is read in one way. A half-written last row
is left out by the reader, and is whole at the next update. Then

1. the latest rows are compared with the fit of the earlier ones (ballbar.ident.prediction), which
   they took no part in;
2. where they agree, the recording but its last seconds is fitted by kinematics alone, and the logs
   are read as by the fit before, once that was confirmed;
3. where a residual remains, the complete model is fitted in growing intervals, elsewhere.

Where an instrument follows the robot, the recording is identified whole in growing intervals.

Nothing here waits or looks at a clock: `update` is given the time.
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import replace
from multiprocessing.pool import AsyncResult, Pool
from pathlib import Path

from ballbar.acquisition.recording import Recording
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import DescriptionError, FailureError, LogError, UnfinishedLogError
from ballbar.cell.load import load_cell, load_measured_cell, load_robot
from ballbar.ident.causes import suspects
from ballbar.ident.identify import kinematic_result
from ballbar.ident.options import FitOptions
from ballbar.ident.prediction import Prediction, part_of, predict
from ballbar.ident.recording_fit import Logs, RecordingFit, fit_recording
from ballbar.ident.robot.tcp_uncertainty import scale_error
from ballbar.ident.start.automatic import Hypothesis
from ballbar.ident.verdict import Status
from ballbar.recordings.read_with_causes import read_with_causes
from ballbar.result.identify import logs_of
from ballbar.watch.alarms import (
    SEEN_TWICE,
    FindingAlarms,
    SilenceAlarms,
    StepAlarms,
    since_first,
    standing,
)
from ballbar.watch.state import (
    Alarm,
    Estimate,
    WatchState,
    axes_covered,
    complete_estimate,
    estimate_of,
    followed_estimate,
    seconds_of,
)

HELD_OUT = 2.0  # [s] at the end that take part in no fit, but judge it
REFIT, REFIT_SHARE = 2.0, 0.02  # [s] of new rows, and of the recording, from which it is fitted
SHORTEST = 10.0  # [s] of a recording that is fitted; the columns of less cannot be compared
YOUNG = 30.0  # [s] of a recording that may have been started wrongly (causes says as much)
FAILED_GROWTH = 1.5  # times, after a start that failed: it takes seconds
COMPLETE_FIRST, COMPLETE_GROWTH = 45.0, 1.15  # [s] of the first complete fit; times, of the next
CERTAIN = 20.0  # residual over what is expected that is no chance; less is seen in two updates
# Stated standard deviations within which the true TCP error lies in 95 %, also where the scale, one
# number, is most of it.
CERTAIN_SIGMAS = 1.96
PATIENCE = 6  # updates without files that are being written again, up to which one waits for them
# A start that leads nowhere, a fit that is singular or out of reach, logs that cannot be used.
NO_FIT = (FailureError, ValueError)
AGREES = 2.0  # residual of held-out rows over what is expected, up to which a fit is confirmed
SAME_MODEL = 3.0  # times chi-square: a fit of all rows that leaves no more has only more to tell


class Watch:
    """A recording folder, identified as it grows.

    accuracy : [m] TCP error (rms) that is asked for. duration : [s] of the whole recording, if it
    is known. pool : takes the complete fits; without one there are none.
    """

    def __init__(
        self,
        folder: Path,
        *,
        accuracy: float | None = None,
        duration: float | None = None,
        pool: Pool | None = None,
    ) -> None:
        self._folder, self._accuracy, self._duration = folder, accuracy, duration
        self._pool = pool
        self._cell: Cell | None = None
        self._ended = False  # whether the recording is over, so that nothing need move any more
        self._unread = 0  # updates in a row in which nothing could be read
        self._begin()

    def _begin(self) -> None:
        """Forgets everything: a recording begins, for the first time or again in the same files."""
        self._findings, self._silence, self._steps = FindingAlarms(), SilenceAlarms(), StepAlarms()
        self._encoders: tuple[int, ...] | None = None
        self._fitted: RecordingFit | None = None
        self._next_fit = self._fitted_until = 0.0  # [s] of the recording
        self._estimate: Estimate | None = None
        self._no_fit = "too little motion yet to identify anything"
        # end [s] of the recording and result of a complete fit under way
        self._complete: tuple[float, AsyncResult[Estimate]] | None = None
        self._next_complete = COMPLETE_FIRST
        self._misfit: Alarm | None = None
        self._state = WatchState(0.0, {}, "no recording yet", ())

    def update(self, now: float) -> WatchState:
        """The state of the recording; now : [s] on a clock that goes on evenly."""
        try:
            recording = read_with_causes(self._folder)
            described, tracker, sources = recording.description, None, recording.description.sources
            if described.followed:
                robot = load_robot(described.robot, relative_to=self._folder)
                tracker = sources.tracker
            else:
                self._cell = self._cell or _cell(self._folder, recording)
                robot = self._cell.robot
            named = (sources.robot, sources.ballbar, sources.length, tracker)
            latest = [source.files[-1] for source in named if source is not None]
            sizes = {name: (self._folder / name).stat().st_size for name in latest}
        except (UnfinishedLogError, DescriptionError, OSError) as error:
            return self._refused(str(error), patience=PATIENCE)
        except LogError as error:
            return self._refused(str(error), patience=SEEN_TWICE)
        self._unread = 0
        logs = logs_of(self._folder.name, recording)
        seconds, encoders = seconds_of(logs), logs.ballbar.joints if logs.ballbar else ()
        if seconds < self._state.seconds - HELD_OUT or self._encoders not in (None, encoders):
            self._begin()
        self._encoders = encoders
        over = self._ended or (self._duration is not None and seconds >= self._duration - 1.0)
        alarms = self._findings.alarms(recording.report, seconds)
        silent = self._silence.alarms(sizes, now, seconds)
        if not over:
            alarms += [*silent, *standing(logs)]
        prediction, cell = None, self._cell
        if cell is None:
            self._ask_followed(logs, seconds)
        else:
            if self._fitted is not None:
                prediction = predict(cell, self._fitted, logs, HELD_OUT)
            alarms += self._identified(cell, logs, seconds, prediction)
        if self._fitted is not None:
            alarms += self._steps.alarms(self._fitted.samples, self._fitted.clock, seconds)
        self._take_complete()
        estimate = self._estimate  # no longer young, and all the same of no such machine
        if estimate and estimate.status == Status.IMPLAUSIBLE and estimate.until >= YOUNG:
            alarms.append(Alarm("implausible", estimate.sentence, seconds))
        rows = Counter[str]()
        for file in recording.report.files:
            rows[file.source] += file.rows_read
        axes = axes_covered(robot, logs.robot.q)
        return self._stated(dict(rows), axes, seconds, prediction, alarms)

    def finish(self, now: float) -> WatchState:
        """The state of the whole recording, nothing of it held out.

        It is fitted with the model that the data support; alarms against the recording stay.
        """
        self._ended = True
        state = self.update(now)
        early = self._estimate is None and self._cell is not None
        if early or not state.rows or self._unread or self._misfit:
            return state
        try:
            logs = logs_of(self._folder.name, read_with_causes(self._folder))
            if self._cell is None:
                estimate = followed_estimate(self._folder, logs)
            else:
                estimate = complete_estimate(self._cell, logs, self._accuracy)
        except (*NO_FIT, OSError) as error:  # what was known before is shown, and is not enough
            return replace(state, enough=False, waiting="" if state.estimate else str(error))
        enough = self._reached(estimate) and not state.alarms
        end = estimate.tcp_sigma
        return replace(state, waiting="", estimate=estimate, tcp_sigma_end=end, enough=enough)

    def _reached(self, estimate: Estimate) -> bool:
        """Whether the true TCP error is within the accuracy in 95 % of such estimates."""
        certain = CERTAIN_SIGMAS * estimate.tcp_sigma
        return self._accuracy is not None and estimate.acceptable and certain <= self._accuracy

    def _refused(self, sentence: str, *, patience: int) -> WatchState:
        """The last state, with an alarm for files that could be read and no longer can.

        patience : updates from which it is one.
        """
        self._state = replace(self._state, enough=False)
        if self._state.rows or patience == SEEN_TWICE:
            self._unread += 1
        else:
            self._state = replace(self._state, waiting=sentence)
        if self._unread >= patience:
            alarm = Alarm("refused", sentence, self._state.seconds)
            others = [a for a in self._state.alarms if a.kind != alarm.kind]
            alarms = since_first((*others, alarm), self._state.alarms)
            self._state = replace(self._state, alarms=alarms)
        return self._state

    def _identified(
        self, cell: Cell, logs: Logs, seconds: float, prediction: Prediction | None
    ) -> list[Alarm]:
        """Fits the recording again if it has grown and agrees; alarms where it does not."""
        if prediction is not None and prediction.since is not None:
            alarm = self._disagreement(cell, logs, seconds, prediction)
            if alarm is not None or self._misfit is not None:
                return [alarm] if alarm else []
        else:
            self._misfit = None
        if seconds < SHORTEST:
            return []
        if self._estimate is None or not self._estimate.acceptable:  # no fit explains the logs yet
            worst = suspects(cell, logs)[:1]
            if worst and worst[0].hopeless:
                return [Alarm("wrong from the start", str(worst[0]), seconds)]
        if seconds < self._next_fit:
            return []
        instrument = logs.ballbar or logs.length or logs.robot
        early = Clock(float(logs.robot.t[-1] - instrument.t[-1]), 0.0)  # both end together
        last = float(instrument.t[-1]) - HELD_OUT
        used = part_of(logs, early, min(0.0, -early.offset), last)
        try:
            reading = self._known(prediction)
            fitted = fit_recording(cell, used, FitOptions(model="dh"), known=reading)
            self._take(cell, fitted, seconds - HELD_OUT)
        except NO_FIT:
            self._next_fit = seconds * FAILED_GROWTH
            return []
        self._next_fit = seconds + max(REFIT, REFIT_SHARE * seconds)
        self._ask_complete(cell, used, seconds - HELD_OUT)
        return []

    def _known(self, prediction: Prediction | None) -> Hypothesis | None:
        """How the logs are to be read, once a fit of one reading alone has been confirmed."""
        if self._fitted is None or self._fitted_until < YOUNG or not self._fitted.fit.converged:
            return None
        start = self._fitted.start
        if start.ambiguous or prediction is None or prediction.ratio > AGREES:
            return None
        return replace(start.chosen.hypothesis, clock=self._fitted.clock)

    def _disagreement(
        self, cell: Cell, logs: Logs, seconds: float, prediction: Prediction
    ) -> Alarm | None:
        """The alarm for rows that the fit does not predict; None if a fit with them explains all.

        A young fit may know too little of where the path leads to, or be of a wrong start.
        """
        if self._misfit is None:
            before = self._fitted
            assert before is not None  # it has predicted
            with suppress(*NO_FIT):
                fitted = fit_recording(cell, logs, FitOptions(model="dh"))
                young = self._fitted_until < YOUNG or not before.fit.converged
                increase = fitted.fit.chi2_per_dof / max(1.0, before.fit.chi2_per_dof)
                if young or (fitted.fit.converged and increase < SAME_MODEL):
                    self._take(cell, fitted, seconds)
                    return None
        sure = self._misfit is not None or prediction.ratio > CERTAIN or self._ended
        self._misfit = Alarm("misfit", _contradiction(prediction), seconds)
        return self._misfit if sure else None

    def _take(self, cell: Cell, fitted: RecordingFit, until: float) -> None:
        """Makes a fit the one that predicts, and its result the estimate."""
        result = kinematic_result(cell, fitted, FitOptions(model="dh", accuracy=self._accuracy))
        self._fitted, self._fitted_until = fitted, until
        if self._estimate is None or self._estimate.model == "dh" or result.verdict.acceptable:
            self._estimate = estimate_of(result, fitted.logs, until)

    def _ask_complete(self, cell: Cell, logs: Logs, until: float) -> None:
        """Hands the recording over to be fitted by the complete model, if it is time."""
        estimate = self._estimate
        if self._pool is None or estimate is None or self._complete is not None:
            return
        needed = not estimate.acceptable or estimate.model == "complete"
        if needed and until >= self._next_complete:
            arguments = cell, logs, self._accuracy
            self._complete = until, self._pool.apply_async(complete_estimate, arguments)
            self._next_complete = until * COMPLETE_GROWTH

    def _ask_followed(self, logs: Logs, until: float) -> None:
        """Hands over a recording of an instrument that follows the robot, if it is time."""
        due = not self._ended and until >= max(SHORTEST, self._next_fit)
        if due and self._pool is not None and self._complete is None:
            self._no_fit, arguments = "being identified", (self._folder, logs)
            self._complete = until, self._pool.apply_async(followed_estimate, arguments)
            self._next_fit = until * COMPLETE_GROWTH

    def _take_complete(self) -> None:
        """Makes a fit that was handed over the estimate, once it is done."""
        if self._complete is None or not self._complete[1].ready():
            return
        try:
            self._estimate = replace(self._complete[1].get(), until=self._complete[0])
        except (*NO_FIT, OSError) as error:
            self._no_fit = str(error)
        self._complete = None

    def _stated(
        self,
        rows: dict[str, int],
        axes: tuple[float, ...],
        seconds: float,
        prediction: Prediction | None,
        alarms: list[Alarm],
    ) -> WatchState:
        """The state after an update, from what was found by it."""
        estimate, cell, end = self._estimate, self._cell, None
        good = estimate is not None and estimate.status == Status.GOOD
        if self._duration is not None and cell is not None and estimate is not None and good:
            end = estimate.at_end(self._duration, scale=scale_error(cell))
        # an instrument that follows predicts in its cross-validation, which the verdict heeds
        agrees = cell is None if prediction is None else prediction.ratio <= AGREES
        enough = estimate is not None and self._reached(estimate) and agrees and not alarms
        self._state = WatchState(
            seconds=seconds,
            rows=rows,
            waiting="" if estimate else self._no_fit,
            alarms=since_first(alarms, self._state.alarms),
            axes=axes,
            estimate=estimate,
            predicted=None if prediction is None else prediction.ratio,
            tcp_sigma_end=end,
            enough=enough,
        )
        return self._state


def _cell(folder: Path, recording: Recording) -> Cell:
    named = recording.description
    load = load_measured_cell if named.ballbar is None else load_cell
    return load(named.robot, named.measured_by, named.plate, relative_to=folder)


def _contradiction(prediction: Prediction) -> str:
    cause = prediction.cause or "the latest rows contradict all earlier ones"
    return (
        f"{cause} (from t = {prediction.since:.2f} s on; the residual is {prediction.ratio:.1f} "
        "times what the earlier rows explain)"
    )
