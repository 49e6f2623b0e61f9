"""Base of the error sources of plug-ins: keys of a scenario, and what they do to the robot."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.schema import Strict
from ballbar.sim.streams import stream

GearHarmonics = Iterable[tuple[int, float, float, float]]


class ErrorSource(Strict):
    """Harmonic errors of gears, and errors of single logged angles; fields are the keys."""

    def ripples(self, joints: int, rng: np.random.Generator) -> GearHarmonics:
        """Gear from 0, cycles per turn of its output, amplitude and phase [rad] of each harmonic.

        They are a machine's: its truth states them, moving or still. The motor shows g - a
        sin(order g + phase) at the output angle g. joints : of the robot.
        """
        del joints, rng
        return ()

    def logged(self, q: Array, rng: np.random.Generator) -> Array:
        """(N, J) [rad] joint angles that one recording logs in place of q (N, J) [rad].

        It stands for noise: no truth states it.
        """
        del rng
        return q


def sources_of(errors: Strict) -> list[tuple[str, ErrorSource]]:
    """Key and settings of the error sources of plug-ins that are stated."""
    return [(name, source) for name, source in errors if isinstance(source, ErrorSource)]


def with_logged_errors(errors: Strict, q: Array, seed: int) -> Array:
    """(N, J) [rad] angles q (N, J) [rad] as plug-ins have them logged."""
    for name, source in sources_of(errors):
        q = source.logged(q, stream(seed, f"{name}_logged"))
    return q
