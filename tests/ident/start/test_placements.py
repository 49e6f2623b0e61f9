"""Where seats and targets are by the nominal robot, before anything is fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, approx_fprime, least_squares

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import robot_geometry
from ballbar.cell.instruments import kinds
from ballbar.ident.start import placements
from ballbar.ident.start.placements import start_of_poses
from tests.helpers.still_poses import table_of, true_robot

SIGHTED = [name for name, kind in kinds().items() if kind.directions < 3]


@pytest.mark.parametrize("measured", SIGHTED)
def test_the_slope_of_what_is_sensed_is_its_difference(
    measured: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Away from the start, where seats have turned by a few degrees."""
    asked = []

    def compared(residual: Any, x: Array, slope: Any, args: Any, **options: Any) -> OptimizeResult:
        at = x + np.random.default_rng(len(asked)).normal(0.0, 0.05, x.size)
        expected = approx_fprime(at, residual, 1e-7, *args)
        assert slope(at, *args) == pytest.approx(expected, abs=1e-5)  # differences of 1e-7
        asked.append(at)
        return least_squares(residual, x, slope, args=args, **options)

    monkeypatch.setattr(placements, "least_squares", compared)
    table = table_of(true_robot("ur5"), measured)  # type: ignore[arg-type]
    start_of_poses(table, robot_geometry(table.robot).robot)
    assert len(asked) > 1
