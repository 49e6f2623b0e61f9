"""Corrections: error sources that displace error channels of the mechanism.

Channels are the gears, the five ball-bar joints, the rod's length, the plate's bending, and any
parameter of the robot that does not stay the same along a recording. A correction names its unknown
coefficients, each with a prior of physical size, and gives for every sample the regressors phi that
multiply them; so the derivative of the residual is the channel's own column times phi
(docs/theory).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, wraps
from typing import Any, ParamSpec

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell, Robot
from ballbar.cell.geometry import Parameter
from ballbar.cell.typical_machine import with_typical
from ballbar.ident.loads.gear_loads import Loads

# First channel of each kind. Those behind the gears count from the end, since the number of gears
# is the robot's.
GEAR, BAR, ROD, PLATE = 0, -7, -2, -1
BEHIND_GEARS = 7  # channels
Channel = int | Parameter

# Half the backlash over the elastic deflection that the transition load causes: 1.5 N m for the
# main axes of an IRB 2400. A wider transition biases the stiffness that is identified beside it, a
# narrower one slows the fit (notes/identification sec. 4).
BACKLASH_SHARE = 24.0
TENSION_WIDTH = 3.0  # [N] of rod tension over which the rod changes the flank of its backlash


@dataclass(frozen=True)
class Coefficient:
    """One unknown of a correction."""

    name: str
    unit: str  # SI
    mean: float  # of the prior
    sigma: float  # of the prior
    channel: Channel

    @property
    def never_negative(self) -> bool:
        """Whether it is a compliance or a backlash."""
        return self.unit in ("rad/(N m)", "m/N") or "backlash" in self.name


@dataclass(frozen=True, eq=False)
class State:
    """State of the mechanism at N samples, on which regressors depend."""

    t: Array  # (N,) [s] on the ball-bar's clock
    recording: int  # from 0
    gears: Array  # (J, N) [rad] gear outputs as logged
    bar: Array  # (5, N) [rad] ball-bar joint angles, encoder offsets included
    loads: Loads
    tension: Array  # (N,) [N] of the rod
    width: Array  # (J,) [N m] load over which each gear changes the flank of its backlash
    gear_speed: Array  # (J, N) [rad/s]
    gear_acceleration: Array  # (J, N) [rad/s^2] of the arm as a rigid body
    sharpness: float = 1.0  # below 1 flanks change over a wider load; for continuation
    flanks: Array | None = None  # (J, N) of the backlash, where they are known otherwise

    def load_sign(self) -> Array:
        """(J, N) flank of the backlash on which each gear lies, -1 to 1: smooth sign of load."""
        if self.flanks is not None:
            return self.flanks
        return smooth_sign(self.loads.gears(self.tension), self.width[:, None] / self.sharpness)

    def tension_sign(self) -> Array:
        """(N,) smooth sign of the rod's tension."""
        return smooth_sign(self.tension, TENSION_WIDTH / self.sharpness)


def backlash_transition(robot: Robot) -> Array:
    """(J,) [N m] width of the smooth transition between the flanks of each gear's backlash.

    That of typical gears where the robot's file states none (ballbar.cell.typical_machine).
    """
    gears = with_typical(robot)[0].required("gears")
    return np.asarray(0.5 * gears.lost_motion * gears.stiffness / BACKLASH_SHARE)


def smooth_sign(load: Array, width: Array | float) -> Array:
    """Smooth sign (..., N) of a load [N, N m], -1 to 1; 0.5 at a load of 0.58 widths."""
    return np.asarray(load / np.sqrt(load * load + width * width))


def sign_slope(load: Array, width: Array | float) -> Array:
    """Derivative (..., N) of `smooth_sign` with respect to the load [N, N m]."""
    return np.asarray(width * width / (load * load + width * width) ** 1.5)


@dataclass(frozen=True, eq=False)
class Correction:
    """One error source; to be pickled it is formed by name, or by a maker that is `remade`."""

    name: str
    sentence: str
    coefficients: tuple[Coefficient, ...]
    regressors: Callable[[State], Sequence[Array]]  # (N,) each, one a coefficient
    # derivative of each regressor with the rod's tension; None where no load enters
    slopes: Callable[[State], Sequence[Array]] | None = None
    made_by: Callable[[], Correction] | None = None
    # whether the coefficients are small or large together: still poses tell the common scale of
    # their priors (ballbar.ident.estimator.common_scale)
    one_scale: bool = False

    def __reduce__(self) -> str | tuple[Any, ...]:
        return super().__reduce__() if self.made_by is None else (self.made_by, ())


P = ParamSpec("P")


def remade(maker: Callable[P, Correction]) -> Callable[P, Correction]:
    """The maker, whose corrections are pickled as its call; their functions stand within it."""

    @wraps(maker)
    def made(*args: P.args, **kwargs: P.kwargs) -> Correction:
        return replace(maker(*args, **kwargs), made_by=partial(made, *args, **kwargs))

    return made


Maker = Callable[[Cell, tuple[int, ...]], Correction]


def of_robot(maker: Callable[[Robot], Correction]) -> Maker:
    """The maker for a cell of a correction that needs the robot alone."""
    return lambda cell, _: maker(cell.robot)
