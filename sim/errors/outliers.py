"""Gross outliers: single values of a log that have nothing to do with the motion - a bit flipped, a frame torn, a sensor disturbed."""

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
        0.05, description="Of each row of the robot's log: one joint's angle is wrong."
    )
    ballbar_probability: Share = Field(
        0.05, description="Of each row of the ball-bar's log: one encoder's angle is wrong."
    )
    size_rad: tuple[Size, Size] = Field(
        (1.0e-3, 0.1), description="Smallest and largest; logarithm uniform, sign drawn. Assumed."
    )

    @model_validator(mode="after")
    def _ordered(self) -> Outliers:
        if not self.size_rad[0] <= self.size_rad[1]:
            raise ValueError(
                f"size_rad = [{self.size_rad[0]:g}, {self.size_rad[1]:g}]: the smallest comes first"
            )
        return self

    def on_robot(self, rows: int, seed: int) -> Array:
        """(N, 6) [rad] to be added to the joint angles."""
        return self._thrown(rows, 6, self.robot_probability, stream(seed, "outliers_robot"))

    def on_ballbar(self, rows: int, encoders: int, seed: int) -> Array:
        """(N, E) [rad] to be added to what the encoders read."""
        return self._thrown(
            rows, encoders, self.ballbar_probability, stream(seed, "outliers_ballbar")
        )

    def _thrown(
        self, rows: int, channels: int, probability: float, rng: np.random.Generator
    ) -> Array:
        hit = rng.uniform(size=rows) < probability
        smallest, largest = np.maximum(self.size_rad, np.finfo(float).tiny)
        sizes = np.exp(rng.uniform(np.log(smallest), np.log(largest), rows)) * rng.choice(
            (-1.0, 1.0), rows
        )
        out = np.zeros((rows, channels))
        out[np.arange(rows), rng.integers(0, channels, rows)] = np.where(
            hit & (max(self.size_rad) > 0.0), sizes, 0.0
        )
        return out
