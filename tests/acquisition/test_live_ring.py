"""The PLC's ring buffer: each sample once and whole, or counted as lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.live.folder import SegmentFile
from ballbar.acquisition.live.plc_source import PlcSource, RingReader
from ballbar.acquisition.live.source import DeviceSilentError
from tests.helpers.plc_server import Plc, plc_samples, text_of
from tests.helpers.ring_memory import RingMemory

RATE = 1000.0


def ring_memory(capacity: int) -> RingMemory:
    return RingMemory(Plc("", RATE, capacity=capacity))


@pytest.mark.slow
@pytest.mark.parametrize("capacity", [16, 100, 1000])
def test_every_sample_comes_once_and_whole_or_is_counted_as_lost(capacity: int) -> None:
    rng = np.random.default_rng(capacity)
    memory = ring_memory(capacity)
    memory.plc.write(3 * capacity // 2)
    ring = RingReader(memory.read)
    ring.attach()
    first = expected = memory.plc.written
    got = lost = 0
    for _ in range(300):
        memory.plc.write(int(rng.integers(0, capacity)))
        pace = int(rng.choice([0, 1, capacity // 3, capacity]))
        memory.meanwhile = lambda pace=pace: int(rng.integers(0, pace + 1))
        taken = ring.take()
        expected += taken.lost
        assert np.array_equal(
            taken.samples, plc_samples(expected, taken.samples.size, memory.plc.period_ns)
        )
        expected += taken.samples.size
        got, lost = got + taken.samples.size, lost + taken.lost
    memory.meanwhile = lambda: 0
    while (taken := ring.take()).samples.size:
        got, lost = got + taken.samples.size, lost + taken.lost
    assert got + lost == memory.plc.written - first
    assert got > 0
    assert lost > 0


def test_a_reader_that_keeps_up_loses_nothing_at_the_ring_s_end() -> None:
    memory = ring_memory(64)
    ring = RingReader(memory.read)
    ring.attach()
    for size in range(64):
        memory.plc.write(size)
        taken = ring.take()
        assert (taken.samples.size, taken.lost) == (size, 0)


def test_the_slot_that_is_being_written_is_not_taken() -> None:
    """The PLC has begun sample n + capacity, in the slot of sample n, and not counted it yet."""
    memory = ring_memory(16)
    ring = RingReader(memory.read)
    ring.attach()
    memory.plc.write(16)
    taken = ring.take()
    assert (taken.samples.size, taken.lost) == (15, 1)


def test_after_a_lost_connection_the_reader_goes_on_where_it_was() -> None:
    memory = ring_memory(100)
    ring = RingReader(memory.read)
    ring.attach()
    memory.plc.write(10)
    assert ring.take().samples.size == 10
    memory.plc.write(50)
    memory.cut = True
    with pytest.raises(DeviceSilentError, match="cable pulled"):
        ring.take()
    memory.cut = False
    ring.attach()
    taken = ring.take()
    assert (taken.samples["sequence"][0], taken.samples.size, taken.lost) == (11, 50, 0)


def test_a_restarted_plc_is_noticed_and_read_from_its_first_sample() -> None:
    memory = ring_memory(100)
    ring = RingReader(memory.read)
    ring.attach()
    memory.plc.write(10)
    ring.take()
    memory.plc.restart()
    memory.plc.write(30)
    with pytest.raises(DeviceSilentError, match="restarted"):
        ring.take()
    ring.attach()
    assert ring.take().samples["sequence"].tolist() == list(range(1, 31))


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"layout": 1}, "another layout"),
        ({"capacity": 0}, "another layout"),
        ({"fitted": 0}, "no encoder"),
        ({"bits": 14}, "bits = 14"),
    ],
)
def test_memory_that_is_no_ring_is_not_read_as_one(header: dict[str, int], words: str) -> None:
    memory = ring_memory(100)
    memory.plc.poke(**header)
    with pytest.raises(DeviceSilentError, match=words):
        RingReader(memory.read).attach()


def test_a_sequence_number_that_is_not_its_own_ends_the_segment() -> None:
    memory = ring_memory(100)
    ring = RingReader(memory.read)
    ring.attach()
    memory.plc.write(10)
    memory.plc.poke(written=12)
    with pytest.raises(DeviceSilentError, match="sequence numbers"):
        ring.take()


def test_samples_taken_before_the_cable_was_pulled_are_handed_on() -> None:
    memory = ring_memory(2000)
    source = PlcSource(memory, lines=3600)
    source.connect()
    memory.plc.write(600)
    reads = iter(range(1, 100))

    def pull() -> int:
        memory.cut = next(reads) == 3  # header, 500 samples, header: then the cable
        return 0

    memory.meanwhile = pull
    batch = source.poll()
    assert (len(batch.records), batch.ends) == (500, "cable pulled")
    memory.meanwhile, memory.cut = (lambda: 0), False
    source.connect()
    again = source.poll()
    header = source.file_start()
    assert header + b"".join(batch.records + again.records) == text_of(
        plc_samples(0, 600, memory.plc.period_ns)
    )


def test_a_clock_that_is_set_back_ends_the_file_before_that_sample() -> None:
    memory = ring_memory(2000)
    source = PlcSource(memory, lines=3600)
    source.connect()
    memory.plc.write(30)
    memory.plc.set_back(at=20, by_ns=10**9)
    batch = source.poll()
    assert (len(batch.records), batch.ends) == (20, "the PLC's clock was set back")
    source.connect()
    assert len(source.poll().records) == 10


def test_a_clock_that_stands_still_makes_no_new_file() -> None:
    memory = ring_memory(2000)
    source = PlcSource(memory, lines=3600)
    source.connect()
    memory.plc.write(30)
    memory.plc.set_clock(0)
    batch = source.poll()
    assert (len(batch.records), batch.ends) == (30, "")


def test_angles_for_the_eye_count_on_over_polls_and_wraps() -> None:
    memory = ring_memory(4000)
    source = PlcSource(memory, lines=3600)
    source.connect()
    angles = []
    for _ in range(6):
        memory.plc.write(500)
        angles.append(source.poll().values)
    t = np.arange(3000) * 1e-3
    counts = np.rint(2e6 * np.sin(0.4 * t))
    assert np.allclose(np.concatenate(angles)[:, 0], counts * 360.0 / (3600 * 4096))


def test_a_segment_without_a_record_leaves_no_file(tmp_path: Path) -> None:
    file = SegmentFile(tmp_path / "a.csv", b"time;b1\r\n")
    file.close()
    assert not (tmp_path / "a.csv").exists()
