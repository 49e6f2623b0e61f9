"""Gross outliers: single values of a log that have nothing to do with the motion.

A flipped bit, a torn frame or a disturbed sensor causes them.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from cell.arrays import Array
from cell.schema import Strict
from sim.streams import stream

Share = Annotated[float, Field(ge=0.0, le=0.5)]
Size = Annotated[float, Field(ge=0.0)]


class Outliers(Strict):
    """Some rows of a log have one value that is grossly wrong."""

    robot_probability: Share = Field(
        0.05, description="Share of the robot's rows in which the angle of one joint is wrong."
    )
    ballbar_probability: Share = Field(
        0.05, description="Share of the ball-bar's rows in which one encoder's angle is wrong."
    )
    size_rad: tuple[Size, Size] = Field(
        (1.0e-3, 0.1),
        description="Smallest and largest error; drawn log-uniformly and with either sign. "
        "Assumed.",
    )

    @model_validator(mode="after")
    def _ordered(self) -> Outliers:
        if not self.size_rad[0] <= self.size_rad[1]:
            raise ValueError(
                f"size_rad = [{self.size_rad[0]:g}, {self.size_rad[1]:g}]: the smallest comes first"
            )
        return self

    def on_robot(self, rows: int, joints: int, seed: int) -> Array:
        """(N, J) [rad] errors of the joint angles of N rows; 0 where a value is right."""
        return self._drawn(rows, joints, self.robot_probability, stream(seed, "outliers_robot"))

    def on_ballbar(self, rows: int, encoders: int, seed: int) -> Array:
        """(N, E) [rad] errors of what E encoders read in N rows; 0 where a value is right."""
        rng = stream(seed, "outliers_ballbar")
        return self._drawn(rows, encoders, self.ballbar_probability, rng)

    def _drawn(
        self, rows: int, channels: int, probability: float, rng: np.random.Generator
    ) -> Array:
        hit = rng.uniform(size=rows) < probability
        smallest, largest = np.maximum(self.size_rad, np.finfo(float).tiny)
        sizes = np.exp(rng.uniform(np.log(smallest), np.log(largest), rows))
        sizes = sizes * rng.choice((-1.0, 1.0), rows)
        out = np.zeros((rows, channels))
        hit &= max(self.size_rad) > 0.0
        out[np.arange(rows), rng.integers(0, channels, rows)] = np.where(hit, sizes, 0.0)
        return out
