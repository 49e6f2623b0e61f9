"""The nominal robot moved onto measured points."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.cell.load import load_robot
from ballbar.cell.rigid_fit import nominal_frames, rigid_fit
from ballbar.cell.rotation import matrix_from_rotvec

TOOL = np.array([0.05, -0.02, 0.15])  # [m]
FRAMES = nominal_frames(load_robot("irb2400"), np.random.default_rng(2).uniform(-1.0, 1.0, (60, 6)))


def test_measuring_frame_and_tool_are_taken_out_of_exact_points() -> None:
    turn = matrix_from_rotvec(np.array([[0.3], [-1.1], [0.7]]))[:, :, 0]
    points = FRAMES.tip.T + FRAMES.rotation().transpose(2, 0, 1) @ TOOL
    fit = rigid_fit(FRAMES, points @ turn.T + [1.0, -2.0, 0.5])
    assert fit.rotation == pytest.approx(turn, abs=1e-3)
    assert fit.rms < 1e-3


@pytest.mark.parametrize("width", [0.0, 0.2])
def test_the_width_is_that_of_the_points_across_their_longest_direction(width: float) -> None:
    along, across = np.random.default_rng(3).standard_normal((2, 60))
    along, across = ((v - v.mean()) / v.std() for v in (along, across))
    across = across - (across @ along) / 60.0 * along
    points = np.outer(along, [0.0, 0.8, 0.6]) + np.outer(
        across / across.std() * width, [1.0, 0.0, 0.0]
    )
    assert rigid_fit(FRAMES, points).width == pytest.approx(width, abs=1e-12)
