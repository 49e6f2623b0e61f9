"""A recorder counts records, losses, gaps, rate and status of the encoders of a device."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.acquisition.live.source import Batch, Tally

PERIOD = 4_000_000  # [ns]


def batch(first: int, count: int, status: tuple[int, ...] = (), **changes: int) -> Batch:
    """`count` records from the row `first` on."""
    stamps = 1_000 + PERIOD * np.arange(first, first + count)
    values = np.arange(first, first + count, dtype=float)[:, None]
    return Batch([b"x"] * count, stamps, values, np.array(status, dtype=np.int64), **changes)


def test_records_losses_and_refusals_add_up() -> None:
    tally = Tally("ballbar")
    for each in (batch(0, 5, lost=1), batch(5, 0, refused=2), batch(5, 7, lost=3, refused=1)):
        tally.count(each)
    progress = tally.progress
    assert (progress.records, progress.lost, progress.refused) == (12, 4, 3)
    assert progress.latest == pytest.approx([11.0])


def test_the_rate_is_that_of_the_stamps_over_the_last_polls() -> None:
    tally = Tally("robot")
    tally.count(batch(0, 10))
    assert tally.progress.rate == 0.0
    for k in range(1, 6):
        tally.count(batch(10 * k, 10))
    assert tally.progress.rate == pytest.approx(250.0)


def test_status_is_that_of_the_last_records_and_ever_that_of_all() -> None:
    tally = Tally("ballbar")
    tally.count(batch(0, 2, (1, 0)))
    tally.count(batch(2, 2, (4, 8)))
    tally.count(batch(4, 2, (0, 0)))
    assert tally.progress.status is not None
    assert tally.progress.status.tolist() == [0, 0]
    assert tally.progress.ever is not None
    assert tally.progress.ever.tolist() == [5, 8]


def test_steps_of_more_than_three_periods_are_gaps_also_between_two_polls() -> None:
    tally = Tally("robot")
    tally.count(batch(0, 10))
    tally.count(batch(12, 5))
    assert tally.progress.gaps == 0
    tally.count(batch(20, 5))
    assert tally.progress.gaps == 1
    tally.count(batch(40, 1))
    tally.count(batch(41, 1))
    assert tally.progress.gaps == 2
