"""Stated uncertainty of many robots against its target; too large is as wrong as too small."""

from __future__ import annotations

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import accuracy_grid, position_sigma

RATIO = (0.8, 1.2)  # target of the error over the stated one, rms over the robots
COVERAGE = (0.93, 0.97)  # target of the share of 95 % intervals that hold the truth


def stated_uncertainty(over_stated: Array, covered: dict[str, Array]) -> str:
    """The figures of N robots with their targets, and whether they are below, within or above.

    over_stated : (N,) TCP error over the stated one. covered : for each kind of parameter, (N,)
    share of its 95 % intervals that hold the truth.
    """
    ratio = float(np.sqrt((over_stated**2).mean()))
    parts = [f"error over stated, rms: {ratio:.2f} ({place(ratio, RATIO)} {_words(RATIO, 'g')})"]
    for kind, shares in covered.items():
        mean = float(shares.mean())
        target = f"{place(mean, COVERAGE)} {_words(COVERAGE, '.0%')}"
        parts.append(f"{kind} intervals: {mean:.1%} ({target})")
    return "; ".join(parts)


def white_tcp_sigma(found: Identification) -> Array:
    """(G,) [m] TCP sigma of priors and white noise alone, the Cramer-Rao bound of the model."""
    robot, covariance = found.robot.identified, found.robot.covariance
    grid, table = accuracy_grid(found.robot.cell.robot), found.robot.geometry.table
    shared = np.array([table.index[n] for n in covariance.names if n in table.index])
    return position_sigma(robot.tool(grid), robot.jacobian(grid, shared), covariance.white)


def place(value: float, target: tuple[float, float]) -> str:
    """Whether a figure is below its target, within or above."""
    return "below" if value < target[0] else "above" if value > target[1] else "within"


def _words(target: tuple[float, float], form: str) -> str:
    return f"{target[0]:{form}}..{target[1]:{form}}"
