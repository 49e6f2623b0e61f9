"""Random numbers: one stream per error source.

Switching a source on leaves the draws of all others bit-identical. What differs from one recording
of a machine to the next (noise, clocks, lost rows) draws with the seed of the recording.
"""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, source: str) -> np.random.Generator:
    """The generator of one named error source of a run."""
    return np.random.default_rng([seed, zlib.crc32(source.encode())])


def recording_seed(seed: int, recording: int) -> int:
    """The seed of what differs between recordings of the machine of a seed: of the first, its own.

    recording : from 1.
    """
    if recording == 1:
        return seed
    return int(np.random.SeedSequence([seed, recording]).generate_state(1, np.uint64)[0])
