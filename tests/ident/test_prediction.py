"""A stretch of logs behind those of a fit: predicted, or the channel that is off is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.ident.options import FitOptions
from ballbar.ident.prediction import part_of, predict
from ballbar.ident.recording_fit import Logs, RecordingFit, fit_recording
from ballbar.result.identify import logs_of
from ballbar.sim.live.device_logs import GrowingRecording, TextLog
from tests.helpers.simulated_recordings import CLOCK, Recorded

FIT_UNTIL = 40.0  # [s]


@pytest.fixture
def growing(recorded: Recorded, tmp_path: Path) -> GrowingRecording:
    return GrowingRecording(recorded.folder, tmp_path / "growing", CLOCK)


@pytest.fixture(scope="module")
def logs(recorded: Recorded) -> Logs:
    return logs_of("recording", read_recording(recorded.folder))


@pytest.fixture(scope="module")
def fitted(cell: Cell, logs: Logs) -> RecordingFit:
    return fit_recording(cell, part_of(logs, Clock(0.0, 0.0), 0.0, FIT_UNTIL), FitOptions())


def spoilt(growing: GrowingRecording, log: TextLog, name: str, factor: float, since: float) -> Logs:
    """The logs up to 43 s, a channel of which moves so many times as far from an instant on."""
    rows = np.flatnonzero(log.t >= since)
    first = log.numbers(name)[rows[0] - 1]
    moved = log.numbers(name)[rows] - first
    if name.startswith("b"):
        moved = (moved + 2.0**31) % 2.0**32 - 2.0**31
    log.put(rows, name, first + factor * moved)
    growing.write_until(43.0)
    return logs_of("recording", read_recording(growing.folder))


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [
        ("b1", -1.0, "encoder b1 counts backwards"),
        ("b4", 2.0, "encoder b4 turns 2 times as far as it should"),
        ("m1", -1.0, "counts backwards"),
        ("m6", 1.5, "turns 1.49 times as far as it should"),
    ],
)
def test_a_channel_that_is_off_from_some_row_on_is_named(
    growing: GrowingRecording,
    cell: Cell,
    fitted: RecordingFit,
    name: str,
    factor: float,
    words: str,
) -> None:
    log = growing.logs["ballbar" if name.startswith("b") else "robot"]
    prediction = predict(cell, fitted, spoilt(growing, log, name, factor, 42.0), 2.0)
    assert prediction.since == pytest.approx(42.0, abs=0.4)
    assert words in prediction.cause
    assert name[1] in prediction.cause.split(" count")[0].split(" turns")[0]


def test_rows_that_a_fit_has_not_seen_are_predicted_within_its_uncertainty(
    cell: Cell, logs: Logs, fitted: RecordingFit
) -> None:
    ratios = []
    for until in np.arange(FIT_UNTIL, 55.0, 1.0):
        part = part_of(logs, fitted.clock, 0.0, until)
        prediction = predict(cell, fitted, part, 1.0)
        assert prediction.since is None
        ratios.append(prediction.ratio)
    assert 0.5 < min(ratios) <= max(ratios) < 1.5


def test_too_few_rows_are_no_prediction(cell: Cell, logs: Logs, fitted: RecordingFit) -> None:
    assert predict(cell, fitted, part_of(logs, fitted.clock, 0.0, 0.05), 1.0) is None


def test_an_axis_that_is_logged_as_zero_hides_no_fault(
    cell: Cell, fitted: RecordingFit, growing: GrowingRecording
) -> None:
    """Its noise is none; nothing is divided by it."""
    known = fitted.samples.robot.noise * (np.arange(6) < 5)
    samples = replace(fitted.samples, robot=replace(fitted.samples.robot, noise=known))
    model = replace(fitted.fit.model, recordings=(samples,))
    still = replace(fitted, fit=replace(fitted.fit, model=model))
    wrong = spoilt(growing, growing.logs["ballbar"], "b1", -1.0, 41.5)
    assert predict(cell, still, wrong, 2.0).since is not None
