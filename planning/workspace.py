"""Boxes that requests state: workspace, region of the ball-bar, and what to stay clear of."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import InputError
from ballbar.cell.schema import Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.sim.settings import Vector3

ROUNDING = 1e-9  # [deg] of an end of a range that is given in degrees and kept in radians
Axes = Annotated[tuple[float, ...], Field(min_length=5, max_length=8)]
AxisMargin = Annotated[
    float, Field(ge=0.0, description="Distance from the ends of each axis range.")
]


class Region(Strict):
    """A box in the robot's base frame."""

    lower: Vector3
    upper: Vector3

    @model_validator(mode="after")
    def _ordered(self) -> Region:
        if any(low > high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError("lower must not exceed upper")
        return self


class KeepOut(Strict):
    """A box to stay clear of: fence, table, cabinet."""

    name: str
    lower_m: Vector3 = Field(description="Corner, robot base frame.")
    upper_m: Vector3 = Field(description="Opposite corner.")

    @model_validator(mode="after")
    def _ordered(self) -> KeepOut:
        if any(low >= high for low, high in zip(self.lower_m, self.upper_m, strict=True)):
            raise ValueError("lower_m must be below upper_m in every coordinate")
        return self


class Workspace(Strict):
    """Box of axis angles over which the TCP error counts, a value for each axis."""

    lower_deg: Axes
    upper_deg: Axes

    @model_validator(mode="after")
    def _ordered(self) -> Workspace:
        if len(self.lower_deg) != len(self.upper_deg):
            message = f"found {len(self.upper_deg)} values, lower_deg has {len(self.lower_deg)}"
            raise wrong_key("upper_deg", message=message)
        for i, (low, high) in enumerate(zip(self.lower_deg, self.upper_deg, strict=True)):
            if not low < high:
                raise wrong_key("upper_deg", i, message=f"expected more than lower_deg, {low:g}")
        return self


StatedWorkspace = Annotated[
    Workspace | None, Field(description="Workspace; by default the accuracy box of the robot file.")
]


def check_axes(key: str, values: tuple[float, ...], robot: Robot) -> None:
    """Raises InputError for a list of axes that has not one value for each axis of the robot."""
    if len(values) != robot.joints:
        raise InputError(
            f"{key}: {len(values)} values, but {robot.name} has {robot.joints} axes. Give one for "
            "each axis."
        )


def workspace_grid(robot: Robot, workspace: Workspace | None) -> Array:
    """(G, J) [rad] DH joint angles over a workspace, by default over the robot's accuracy box.

    Raises InputError for a workspace of another number of axes, or beyond the range of one.
    """
    if workspace is None:
        return accuracy_grid(robot)
    check_axes("workspace.lower_deg", workspace.lower_deg, robot)
    low, high = np.array((workspace.lower_deg, workspace.upper_deg))
    first, last = np.degrees((robot.axis_lower, robot.axis_upper))
    beyond = (low < first - ROUNDING) | (high > last + ROUNDING)
    if beyond.any():
        k = int(beyond.argmax())
        raise InputError(
            f"workspace: axis {k + 1} from {low[k]:g} to {high[k]:g} deg, but {robot.name} "
            f"moves it from {first[k]:.4g} to {last[k]:.4g} deg. Keep to that."
        )
    return accuracy_grid(
        replace(robot, accuracy_lower=np.radians(low), accuracy_upper=np.radians(high))
    )
