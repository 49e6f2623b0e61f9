"""What a table of still poses shows of itself: rounded angles, axes that stand, repeated poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from acquisition.report import Finding, finding
from acquisition.table.quantities import PoseRows
from cell.arrays import Array
from cell.pose_file import AngleUnit

# Of angles as a table has them; the coarsest on which all lie is reported.
_GRIDS_DEG = (10.0, 5.0, 1.0, 0.5, 0.1, 0.05, 0.01)
_GRIDS_RAD = (0.1, 0.01, 0.001)
_ON_GRID = 1e-6  # of a step: rounding of decimal numbers
_FEWEST = 5  # different angles of an axis, below which a grid is a coincidence
_STANDS = 1e-6  # [rad] an axis that turns by less stands
# [rad] between joint angles of one pose, to which a robot came back: repeatability and noise of its
# encoders. A UR10 lists such poses 0.05 to 0.2 mrad apart.
_SAME = 3.0e-4


def angle_findings(rows: PoseRows, logged: Array, unit: AngleUnit) -> tuple[Finding, ...]:
    """Findings about logged angles (N, J) in `unit`: axes on a grid, axes that never move."""
    findings = list[Finding]()
    scale = 1.0 if unit == "rad" else np.pi / 180.0
    still = np.ptp(logged, axis=0) * scale < _STANDS
    if still.all() and len(logged) > 1:
        sentence = "no axis moves over the whole table. Are these the columns of the angles?"
        findings.append(finding("joints stand still", "warning", rows.file, sentence, count=1))
    elif still.any() and len(logged) > 1:
        sentence = f"{_axes(np.flatnonzero(still))} never moves."
        findings.append(finding("axis stands still", "warning", rows.file, sentence, count=1))
    steps: dict[tuple[float, str], list[int]] = {}
    for axis in np.flatnonzero(~still):
        if (step := _grid(logged[:, axis], unit)) is not None:
            steps.setdefault(step, []).append(int(axis))
    for (size, of), axes in steps.items():
        sentence = f"all angles of {_axes(axes)} are whole multiples of {size:g} {of}."
        findings.append(finding("angles on a grid", "warning", rows.file, sentence, count=1))
    return tuple(findings)


def repeated(rows: PoseRows, q: Array) -> tuple[Finding, ...]:
    """A finding about poses of q (N, J) [rad] that the table has before."""
    pairs = cKDTree(q).query_pairs(_SAME, output_type="ndarray")
    again = np.unique(pairs.max(axis=1))
    if not again.size:
        return ()
    sentence = "the joint angles of a row before; keep such rows on one side of a split."
    lines = rows.line[again]
    return (finding("repeated pose", "warning", rows.file, sentence, lines=lines),)


def _grid(angles: Array, unit: AngleUnit) -> tuple[float, str] | None:
    """Step and its unit of the coarsest grid on which angles (N,) in `unit` lie."""
    if np.unique(angles).size < _FEWEST:
        return None
    degrees = angles if unit == "deg" else np.rad2deg(angles)
    # Numbers of a file in rad have some six digits, so that a grid of degrees is there to 1e-4 deg.
    blur = 0.0 if unit == "deg" else 1e-4
    for step in _GRIDS_DEG:
        off = np.abs(degrees - step * np.rint(degrees / step))
        if (unit == "deg" or step >= 0.1) and (off <= _ON_GRID * step + blur).all():
            return step, "deg"
    for step in _GRIDS_RAD if unit == "rad" else ():
        if (np.abs(angles - step * np.rint(angles / step)) <= _ON_GRID * step).all():
            return step, "rad"
    return None


def _axes(axes: list[int] | NDArray[np.intp]) -> str:
    numbers = [str(axis + 1) for axis in axes]
    return f"axis {numbers[0]}" if len(numbers) == 1 else f"axes {', '.join(numbers)}"
