"""What a correction is: error sources that displace a carrier of the mechanism by a sum of coefficients times known signals.

Carriers are the six gears, the five ball-bar joints, the rod's length and the plate's bend. A correction names its unknown
coefficients, each with a prior of physical size, and gives for every sample the signals phi that multiply them; so the
derivative of the residual is the carrier's own column times phi (design, section 4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cell.arrays import Array
from cell.descriptions import Cell
from ident.loads.gear_loads import Loads

GEAR, BAR, ROD, PLATE = 0, 6, 11, 12  # first carrier of each kind
CARRIERS = 13

BACKLASH_SHARE = 24.0  # a gear changes sides of its play over the load that would wind it up by this share of half the play
TENSION_WIDTH = 3.0  # [N] likewise for the rod


@dataclass(frozen=True)
class Coefficient:
    """One unknown of a correction."""

    name: str
    unit: str  # SI
    mean: float
    sigma: float  # of the prior
    carrier: int


@dataclass(frozen=True, eq=False)
class State:
    """What the signals may depend on, at N samples."""

    t: Array  # (N,) [s] on the ball-bar's clock
    recording: int  # from 0
    gears: Array  # (6, N) [rad] gear outputs as logged
    bar: Array  # (5, N) [rad] ball-bar joint angles, zeros in them: what is off centre turns with the joint, whatever the counter says
    loads: Loads
    tension: Array  # (N,) [N] of the rod
    width: Array  # (6,) [N m] load over which each gear changes sides of its play
    sharpness: float = 1.0  # below 1 play changes sides over a wider load; for continuation
    sides: Array | None = None  # (6, N) of the play, where they are known otherwise

    def load_sign(self) -> Array:
        """(6, N) side of its play on which each gear lies, -1 to 1: a smooth sign of its load, unless it is given."""
        if self.sides is not None:
            return self.sides
        return smooth_sign(self.loads.gears(self.tension), self.width[:, None] / self.sharpness)

    def tension_sign(self) -> Array:
        """(N,) smooth sign of the rod's tension."""
        return smooth_sign(self.tension, TENSION_WIDTH / self.sharpness)


def backlash_transition(cell: Cell) -> Array:
    """(6,) [N m] load over which play changes sides: 1.5 N m for the main axes of an IRB 2400.

    Wider bends the stiffness that is found beside it, narrower slows the fit.
    """
    gears = cell.robot.gears
    return np.asarray(0.5 * gears.lost_motion * gears.stiffness / BACKLASH_SHARE)


def smooth_sign(load: Array, width: Array | float) -> Array:
    """-1 to 1, half way at a load of 0.58 widths."""
    return np.asarray(load / np.sqrt(load * load + width * width))


def sign_slope(load: Array, width: Array | float) -> Array:
    """Derivative of `smooth_sign`."""
    return np.asarray(width * width / (load * load + width * width) ** 1.5)


@dataclass(frozen=True, eq=False)
class Correction:
    """One error source."""

    name: str
    sentence: str
    coefficients: tuple[Coefficient, ...]
    signals: Callable[[State], Sequence[Array]]  # (N,) each, one a coefficient
    slopes: Callable[[State], Sequence[Array]] | None = (
        None  # derivative of each signal with the rod's tension; None: no load
    )


Maker = Callable[[Cell, tuple[int, ...]], Correction]
