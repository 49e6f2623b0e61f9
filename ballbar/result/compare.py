"""An identified robot against the truth, or against another calibration.

Parameter distance as in thesis sec. 3.4 (mm and mrad mixed), meaningful where the parameters held
fixed are true; and the TCP error over the accuracy grid, meaningful always.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ballbar.result.true_robot import true_tool
from cell.arrays import Array
from cell.descriptions import Cell
from cell.geometry import Geometry, mirrored, parameter_named
from cell.statistics import rms
from ident.result import Identification
from ident.robot.accuracy import TcpError, accuracy_grid, position_error
from ident.robot.unloaded_robot import UnloadedRobot

if TYPE_CHECKING:  # an identification of recordings does without the simulation
    from sim.truth import Truth


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far a model is from a reference."""

    deviations: dict[str, float]  # [m, rad] model minus reference, of the parameters compared
    tcp: TcpError  # of the model
    tcp_nominal: TcpError  # of the nominal robot, against the same reference
    offset: float | None  # [s] clock offset minus the true one
    skew: float | None  # [1]

    @property
    def distance(self) -> float:
        """[m | rad] Euclidean distance over the compared parameters."""
        return float(np.linalg.norm(list(self.deviations.values())))

    @property
    def largest(self) -> tuple[str, float]:
        """Name and value [m | rad] of the largest deviation."""
        return max(self.deviations.items(), key=lambda item: abs(item[1]))


def compare(
    model: UnloadedRobot, nominal: Geometry, reference: UnloadedRobot, names: Sequence[str]
) -> Comparison:
    """Model and nominal robot against another identified robot, in the parameters of `names`."""
    return _compared(
        model,
        nominal,
        reference.geometry,
        reference.tool(accuracy_grid(model.cell.robot)),
        names,
        None,
    )


def compare_with_truth(
    model: UnloadedRobot,
    nominal: Geometry,
    truth: Truth,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    """Model and nominal robot against what the recording was simulated from.

    clock : (offset [s], skew [-]) as identified, or None
    """
    reference = reference_of(truth)
    errors = (clock[0] - truth.clock.offset_s, clock[1] - truth.clock.skew) if clock else None
    actual = true_tool(model.cell, truth, reference, accuracy_grid(model.cell.robot))
    return _compared(model, nominal, reference, actual, names, errors)


def identification_against_truth(
    result: Identification, truth: Truth, recording: int = 0
) -> Comparison:
    """The result against the truth that one of its recordings was simulated from."""
    own = result.recordings[recording]
    clock = (own.clock.offset, own.clock.skew) if own.clock else None
    model = replace(result.robot.unloaded(), geometry=own.geometry)
    names = [*result.robot.sigma, *own.sigma]
    return compare_with_truth(model, own.nominal, truth, names, clock)


def z_rms(result: Identification, comparison: Comparison) -> float:
    """Root mean square of error over stated sigma; near 1 if the intervals hold."""
    sigma = result.sigma
    errors = comparison.deviations.items()
    return rms([error / sigma[name] for name, error in errors if sigma[name] > 0.0])


def compare_kinematics(
    cell: Cell,
    model: Geometry,
    nominal: Geometry,
    reference: Geometry,
    names: Sequence[str],
    *,
    clock: tuple[float, float] | None = None,
) -> Comparison:
    """Rigid robots against each other.

    clock : errors of (offset [s], skew [-]), if both sides have a clock
    """
    actual = UnloadedRobot(cell, reference).tool(accuracy_grid(cell.robot))
    return _compared(UnloadedRobot(cell, model), nominal, reference, actual, names, clock)


def _compared(
    model: UnloadedRobot,
    nominal: Geometry,
    reference: Geometry,
    actual: Array,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    grid = accuracy_grid(model.cell.robot)
    deviations = compare_geometry(model.geometry, reference, names)
    offset, skew = clock if clock else (None, None)
    bare = UnloadedRobot(model.cell, nominal)
    return Comparison(
        deviations,
        position_error(model.tool(grid), actual),
        position_error(bare.tool(grid), actual),
        offset,
        skew,
    )


def reference_of(truth: Truth) -> Geometry:
    """The true geometry as the declared directions of b2 and b4 describe it.

    Which of the two directions is positive is a gauge: the logs do not tell.
    """
    geometry = truth.geometry
    for joint in (2, 4):
        if truth.directions.get(f"b{joint}") == -1:
            geometry = mirrored(geometry, joint)
    return geometry


def compare_geometry(
    model: Geometry, reference: Geometry, names: Sequence[str]
) -> dict[str, float]:
    """[m, rad] model minus reference of the named parameters; angles within half a turn."""
    return {name: _difference(name, model, reference) for name in names}


def _difference(name: str, model: Geometry, reference: Geometry) -> float:
    difference = model[name] - reference[name]
    if parameter_named(name).is_length:
        return difference
    return float(np.arctan2(np.sin(difference), np.cos(difference)))
