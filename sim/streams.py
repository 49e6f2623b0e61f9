"""Random numbers: one stream per error source.

Switching a source on leaves the draws of all others bit-identical.
"""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, source: str) -> np.random.Generator:
    """The generator of one named error source of a run."""
    return np.random.default_rng([seed, zlib.crc32(source.encode())])
