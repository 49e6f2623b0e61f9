"""The report on the logs: dwells, singular poses, configurations, clock shift of least error."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.ident.options import FitOptions
from ballbar.ident.result import RecordingEstimate
from ballbar.report.line_plot import _extremes
from ballbar.report.motion import cell_motion, mark_sentences, marks, stretches
from ballbar.report.recording_figures import SHIFTS, log_figures, shift_curve
from ballbar.report.recording_text import direction_sentences
from ballbar.result.identify import identify
from ballbar.result.run_data import FittedRecording
from tests.helpers.simulated_recordings import Recorded


def test_runs_of_true_are_stretches_of_time() -> None:
    t = np.arange(6) * 0.5
    assert stretches(t, np.array([True, True, False, True, False, True])).tolist() == [
        [0.0, 0.5],
        [1.5, 1.5],
        [2.5, 2.5],
    ]
    assert stretches(t, np.zeros(6, dtype=bool)).shape == (0, 2)


@pytest.fixture(scope="module")
def fitted(recorded: Recorded) -> FittedRecording:
    options = FitOptions(samples=300, model="dh")
    (recording,) = identify(Path(recorded.folder), options=options).data.recordings
    return recording


def test_directions_are_compared_with_the_declared_but_those_of_b2_and_b4() -> None:
    estimate = SimpleNamespace(encoders=(1, 2, 3, 4, 5), directions=(1, -1, -1, -1, -1))
    assert direction_sentences(cast("RecordingEstimate", estimate)) == [
        "b1: direction as declared.",
        "b3 and b5: direction opposite to the declared one; the identified one is used.",
        "b2 and b4: direction taken as declared: it cannot be observed, and does not change the "
        "result.",
    ]


def test_dwells_of_the_robot_are_marked_where_the_path_has_them(fitted: FittedRecording) -> None:
    passed = marks(fitted)
    assert len(passed.dwells) == 3  # at both ends, and one of 2 s between
    assert 1.0 < np.diff(passed.dwells[1])[0] < 3.0
    assert mark_sentences(passed)[0].startswith("The robot dwells 3 times")


def test_a_straight_wrist_and_the_change_of_configuration_are_marked(
    fitted: FittedRecording,
) -> None:
    motion = cell_motion(fitted)
    q = motion.q.copy()
    q[:, 4] = 0.5 * np.sin(2.0 * np.pi * motion.t / 20.0) - fitted.estimate.geometry["rtheta5"]
    passed = marks(fitted, replace(motion, q=q))
    crossings = passed.configuration["robot: wrist straight"]
    np.testing.assert_allclose(crossings, np.arange(6) * 10.0, atol=0.05)
    spans = passed.near_singular["robot: wrist straight"]
    # within 5 deg of 0.5 sin: asin(0.0873 / 0.5) / (2 pi / 20 s) on either side
    np.testing.assert_allclose(spans[1:-1].mean(axis=1), np.arange(1, 5) * 10.0, atol=0.1)
    np.testing.assert_allclose(np.diff(spans[1:-1], axis=1), 2 * 0.558, atol=0.1)


def test_the_error_is_least_where_the_clocks_are_aligned(fitted: FittedRecording) -> None:
    curve = shift_curve(fitted)
    assert curve is not None
    assert SHIFTS[int(np.argmin(curve))] == pytest.approx(0.0, abs=1e-9)
    assert curve[0] > 30 * curve.min()
    motion = cell_motion(fitted)
    captions = [
        caption.split()[0] for _, caption in log_figures(fitted, motion, marks(fitted, motion))
    ]
    assert captions == ["Angles", "Dwells", "Angles", "Distance"]


def test_a_curve_is_drawn_whole_where_it_runs_back() -> None:
    """Also by less than a point: its least and largest values are those of no column."""
    x = np.repeat(np.linspace(0.0, 10.0, 500), 2)
    assert _extremes(x, np.sin(x)).size < 100
    back = x.copy()
    back[501] -= 0.5
    assert _extremes(back, np.sin(x)).size == 1000
