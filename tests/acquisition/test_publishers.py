"""Two publishers on one topic are refused; what only looks like them is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.channels import read_channels
from ballbar.acquisition.sources import log_source, read_files
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.files import write_yaml
from ballbar.cell.recording import TrackerFile
from tests.helpers.real_robots import DATA

PAIRS, PERIOD = 1500, 0.01
APART = np.array([4.0, 1.5, -1.5])  # 4.53 mm
VICON = DATA / "irb4400_vicon" / "record_20240711_144811.csv.gz"
Motion = Callable[[Array], Array]


def swinging(t: Array) -> Array:
    """(N, 3) [mm] at times (N,) [s], up to 0.5 m/s."""
    return np.stack((300 * np.sin(1.1 * t), 200 * np.sin(1.7 * t + 1), 150 * np.cos(0.9 * t)), 1)


def with_rests(t: Array) -> Array:
    """(N, 3) [mm] moves of 2 s at 0.4 m/s, there and back, with rests of 2 s between them."""
    share = np.clip(np.mod(t, 4.0) - 1.0, 0.0, 2.0) / 2.0
    return np.where(np.mod(t, 8.0) < 4.0, share, 1.0 - share)[:, None] * [800.0, -300.0, 100.0]


def fast(t: Array) -> Array:
    """(N, 3) [mm] on a circle at 2.4 m/s: 24 mm from pair to pair."""
    return np.stack((400 * np.sin(6 * t), 400 * np.cos(6 * t), 0 * t), 1)


def at_rest(t: Array) -> Array:
    return np.zeros((t.size, 3))


def to_and_fro(t: Array) -> Array:
    """(N, 3) [mm] along one line at 0.5 m/s, back after every half second."""
    return np.abs(np.mod(t, 1.0) - 0.5)[:, None] * [400.0, 300.0, 0.0]


MOTIONS = pytest.mark.parametrize("motion", [swinging, with_rests, fast, at_rest, to_and_fro])
NOISES = pytest.mark.parametrize(
    "noise", [0.05, *(pytest.param(noise, marks=pytest.mark.slow) for noise in (0.0, 1.0))]
)


def written(folder: Path, t: Array, values: Array, noise: float = 0.05) -> Path:
    """A table of rows at times t (N,) [s] in their order, values (N, 3) [mm] with noise."""
    rng, order = np.random.default_rng(4), np.argsort(t, kind="stable")
    cells = np.column_stack((np.rint(t * 1e9) + 1e9, values + noise * rng.normal(size=(t.size, 3))))
    lines = [f"{row[0]:.0f},{row[1]:.6f},{row[2]:.6f},{row[3]:.6f}" for row in cells[order]]
    file = folder / "log.csv"
    file.write_text("\n".join(("time_ns,x,y,z", *lines)) + "\n")
    return file


def jittered(count: int = PAIRS, period: float = PERIOD) -> Array:
    return np.arange(count) * period + np.random.default_rng(5).normal(0.0, 1e-4, count)


@MOTIONS
@pytest.mark.parametrize("within", [1e-6, 4e-5, 1.5e-3])
def test_two_publishers_are_refused_with_their_count_and_distance(
    tmp_path: Path, motion: Motion, within: float
) -> None:
    t = jittered()
    both = np.concatenate((motion(t), motion(t) + APART))
    message = r"csv:\d+: two publishers: 1\d\d\d pairs of rows, .* apart, .* 4(\.\d*)? apart in x"
    with pytest.raises(LogError, match=message):
        read_channels(written(tmp_path, np.concatenate((t, t + within)), both))


@MOTIONS
def test_neither_a_fixed_order_nor_every_row_is_needed(tmp_path: Path, motion: Motion) -> None:
    rng, t = np.random.default_rng(6), jittered()
    late = 4e-5 * (np.arange(PAIRS) % 3 > 0)
    rows = np.concatenate((t + late, t + 4e-5 - late))
    both, kept = np.concatenate((motion(t), motion(t) + APART)), rng.random(2 * PAIRS) < 0.9
    with pytest.raises(LogError, match="two publishers"):
        read_channels(written(tmp_path, rows[kept], both[kept], noise=0.2))


@MOTIONS
@NOISES
@pytest.mark.parametrize("share", [0.98, 0.6, 0.5, 0.2])
def test_bursts_of_one_source_are_read(
    tmp_path: Path, motion: Motion, noise: float, share: float
) -> None:
    """Rows are consecutive updates; share : of them that begin a burst; half in regular pairs."""
    rows, rng = np.arange(2 * PAIRS), np.random.default_rng(7)
    begins = rows % 2 == 0 if share == 0.5 else rng.random(rows.size) < share
    burst = np.cumsum(begins)
    last = np.searchsorted(burst, burst, side="right") - 1
    source = 0.5 * PERIOD * rows
    arrived = source[last] - 4e-5 * (last - rows)
    log, _ = read_channels(written(tmp_path, arrived, motion(source), noise))
    assert log.t.size > 0.9 * rows.size


@MOTIONS
@NOISES
@pytest.mark.parametrize("pair", ["two of four", "held", "held late", "one twice", "filtered"])
def test_pairs_of_one_source_are_read(
    tmp_path: Path, motion: Motion, noise: float, pair: str
) -> None:
    """Two updates in four, a value held, a value held and the next one, raw twice or filtered."""
    rng, times = np.random.default_rng(8), np.repeat(jittered(), 2)
    source = 0.25 * PERIOD * (4 * np.arange(PAIRS)[:, None] + [0, 1]).ravel()
    values = motion(source if pair == "two of four" else times)
    if pair.startswith("held"):
        values = values + np.repeat(rng.normal(0.0, noise, (PAIRS, 3)), 2, axis=0)
        values = np.roll(values, -1, axis=0) if pair == "held late" else values
    else:
        values = values + rng.normal(0.0, noise, values.shape) * np.resize(
            [1.0, 0.0 if pair == "filtered" else 1.0], 2 * PAIRS
        ).reshape(-1, 1)
    arrived = times + np.tile([0.0, 4e-5], PAIRS)
    rows = read_channels(written(tmp_path, arrived, values, 0.0))[0].t.size
    assert rows >= 2 * PAIRS - 1  # where the motion turns back a row may be of the tick before


@MOTIONS
def test_a_backlash_and_a_flickering_digit_are_of_one_source(
    tmp_path: Path, motion: Motion
) -> None:
    t = jittered()
    speed = np.sign(np.gradient(motion(t), axis=0))
    read_channels(written(tmp_path, t, motion(t) + 2.0 * speed))
    alternating = np.resize([0.0, 0.01], PAIRS)[:, None]
    read_channels(written(tmp_path, t, motion(t) + alternating, noise=0.0))


def test_a_difference_of_rounding_does_not_matter(tmp_path: Path) -> None:
    t = np.concatenate((jittered(), jittered() + 4e-5))
    second = np.repeat([0.0, 1.0], PAIRS)[:, None]
    fine, coarse = (with_rests(t) + size * second for size in (0.005, 0.1))  # travel 860 mm
    assert read_channels(written(tmp_path, t, fine, noise=0.0))[0].t.size == 2 * PAIRS
    with pytest.raises(LogError, match="two publishers"):
        read_channels(written(tmp_path, t, coarse, noise=0.0))


def test_a_source_of_a_recording_names_the_unit(tmp_path: Path) -> None:
    dialect = {
        **{"schema": "ballbar-dialect/1", "source": "tracker", "separators": [","]},
        **{"time": {"column": "time_ns", "forms": ["ns"]}, "point": ["x", "y", "z"]},
        "period_s": [1e-4, 0.1],
    }
    write_yaml(tmp_path / "own.yaml", dialect)
    t = jittered()
    written(tmp_path, np.tile(t, 2), np.concatenate((fast(t), fast(t) + APART)))  # equal stamps
    declared = TrackerFile(files=("log.csv",), dialect="own.yaml", time="ns")
    with pytest.raises(LogError, match=r"0 s apart, .* 4(\.\d*)? mm apart in x .* Record one"):
        read_files(log_source(tmp_path, "tracker", declared))


@pytest.mark.skipif(not VICON.exists(), reason="the measured robots are not beside the project")
@pytest.mark.parametrize(
    "names",
    ["joint_1 joint_2 joint_3", "pv_x pv_y pv_z", "ps_x ps_y ps_z", "os_x os_y", "tcp_speeds"],
)
def test_a_measured_robot_read_in_bursts_is_one_publisher(names: str) -> None:
    assert read_channels(VICON, channels=names.split())[0].t.size > 1500
