"""Shares of single parameters in the TCP correction from nominal to identified robot.

With the base aligned, the correction is to first order the sum of one field over the poses for each
parameter and each correction, c = sum f_k. The derivatives are taken midway between both robots,
which leaves errors of third order. The shares (f_k, c) / (c, c) add up to 1; one below 0 belongs to
a part that the others outweigh.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.accuracy import aligned_columns
from ballbar.ident.robot.identified import IdentifiedRobot

_FAMILY = re.compile(r"[a-z]+\d*")  # `ripple1` of `ripple1_40_sin`


@dataclass(frozen=True)
class CorrectionPart:
    """The part of one parameter of the robot, or of one gear or joint in a correction."""

    name: str  # `ra2`; of coefficients what they have in common: `compliance2`, `ripple1`
    source: str  # name of the correction; empty for a parameter
    size: float  # [m] rms of the tool over the poses, by itself
    sigma: float  # [m] standard deviation of the same
    share: float  # of the mean square of the whole correction


def correction_parts(robot: RobotEstimate, grid: Array) -> list[CorrectionPart]:
    """The parts of the correction at joint angles grid (G, J) [rad], the largest first."""
    table = robot.geometry.table
    names = [p.name for p in table.parameters if p.side == "robot"]
    sources, change = [""] * len(names), [robot.geometry[n] - robot.nominal[n] for n in names]
    for correction in robot.corrections:
        names += [c.name for c in correction.coefficients]
        sources += [correction.name] * len(correction.coefficients)
        change += [c.value for c in correction.coefficients]
    midway = _midway(robot)
    indices = np.array([table.index[n] for n in names[: sources.count("")]], dtype=np.intp)
    columns = aligned_columns(midway.tool(grid), midway.jacobian(grid, indices))
    fields = columns * np.array(change)
    whole, points = fields.sum(axis=1), len(grid)
    parts = []
    for (source, name), members in _families(names, sources).items():
        own = fields[:, members].sum(axis=1)
        spread = columns[:, members] @ _root(robot, [names[i] for i in members])
        parts.append(
            CorrectionPart(
                name=name,
                source=source,
                size=float(np.linalg.norm(own) / np.sqrt(points)),
                sigma=float(np.linalg.norm(spread) / np.sqrt(points)),
                share=float(own @ whole / (whole @ whole)) if whole.any() else 0.0,
            )
        )
    return sorted((p for p in parts if p.size > 0.0), key=lambda p: -p.size)


def _midway(robot: RobotEstimate) -> IdentifiedRobot:
    """The robot between nominal and identified."""
    identified = robot.identified
    geometry = robot.nominal.with_values(0.5 * (robot.nominal.values + robot.geometry.values))
    return replace(identified, geometry=geometry, values=0.5 * identified.values)


def _families(names: Sequence[str], sources: Sequence[str]) -> dict[tuple[str, str], list[int]]:
    """Indices of the unknowns that stand for one thing, by correction and name."""
    out: dict[tuple[str, str], list[int]] = {}
    for i, (name, source) in enumerate(zip(names, sources, strict=True)):
        family = _FAMILY.match(name) if source else None
        out.setdefault((source, family[0] if family else name), []).append(i)
    return out


def _root(robot: RobotEstimate, names: Sequence[str]) -> Array:
    """(K, K) root of the covariance of some unknowns; zero for what was taken as exact."""
    known = robot.covariance.names
    factor = np.array([n in known for n in names], dtype=np.float64)
    at = [known.index(n) if n in known else 0 for n in names]
    block = robot.covariance.values[np.ix_(at, at)] * np.outer(factor, factor)
    scale = np.sqrt(np.maximum(np.diag(block), np.finfo(float).tiny))  # units differ
    values, vectors = np.linalg.eigh(block / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
