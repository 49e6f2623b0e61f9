"""Frozen channels are seen, and nothing that truly stands, creeps or is coarse is taken for one."""

import numpy as np
import pytest

from ballbar.acquisition.faults.frozen import with_frozen_loads_checked, with_frozen_motion_checked
from ballbar.acquisition.flags import RowFlag, usable
from ballbar.acquisition.table.table import Table

ROWS, PERIOD = 6000, 0.004
T = PERIOD * np.arange(ROWS)
MOTION = 0.4 * np.sin(0.9 * T) + 0.1 * np.sin(2.3 * T + 1.0)  # [rad], up to 0.6 rad/s
NOISE = 2e-6 * np.random.default_rng(1).standard_normal(ROWS)
COUNT = 2.0 * np.pi / (3600 * 2**12)


def table(**columns: np.ndarray) -> Table:
    rows = np.arange(ROWS)
    return Table(columns, ("log.csv",), np.zeros(ROWS, dtype=np.int64), rows + 2)


def frozen_rows(values: np.ndarray) -> list[int]:
    """Rows that are left out of a log of this angle [rad] and of another one that moves."""
    checked = with_frozen_motion_checked(
        table(a=values, b=MOTION[::-1] + NOISE), T, {"a": 1.0, "b": 1.0}
    )
    assert {f.kind for f in checked.findings} <= {"frozen channel"}
    return np.flatnonzero(~usable(checked.flags)).tolist()


def coarse(values: np.ndarray, grain: float) -> np.ndarray:
    return grain * np.floor(values / grain)


@pytest.mark.parametrize("length", [5, 20, 100, 500])
@pytest.mark.parametrize("first", [300, 1700, 4000])
def test_a_value_that_repeats_in_motion_is_left_out(first: int, length: int) -> None:
    values = MOTION + NOISE
    values[first : first + length] = values[first - 1]
    assert frozen_rows(values) == list(range(first, first + length))


def test_a_frozen_reversal_is_seen_by_its_abrupt_ends() -> None:
    values = 0.3 * np.cos(1.5 * (T - T[3000])) + NOISE
    values[2940:3061] = values[2939]
    assert abs(values[3061] - values[2939]) < 1e-5  # no jump: the motion comes back
    assert frozen_rows(values) == list(range(2940, 3061))


def test_a_channel_that_is_dead_to_the_end_is_left_out() -> None:
    values = MOTION + NOISE
    values[5000:] = values[4999]
    assert frozen_rows(values) == list(range(5000, ROWS))


def test_the_finding_names_column_and_lines() -> None:
    values = MOTION + NOISE
    values[1000:1040] = values[999]
    both = table(a=values, b=MOTION + NOISE)
    (finding,) = with_frozen_motion_checked(both, T, {"a": 1.0, "b": 1.0}).findings
    assert finding.severity == "repaired"
    assert "column a repeats one value in lines 1002 to 1041" in finding.sentence
    assert finding.lines[0] == 1002
    assert finding.count == 40


def test_a_logger_that_froze_is_one_finding() -> None:
    logged = {"a": MOTION + NOISE, "b": MOTION[::-1] + NOISE}
    for values in logged.values():
        values[1000:1200] = values[999]
    checked = with_frozen_motion_checked(table(**logged), T, {"a": 1.0, "b": 1.0})
    assert ["columns a, b repeat" in f.sentence for f in checked.findings] == [True]
    assert (checked.flags == RowFlag.FROZEN).sum() == 200


def stopping(stop: float, acceleration: float) -> np.ndarray:
    """(N,) [rad] of a joint that brakes from 0.5 rad/s, stands from `stop` [s] on and sets off."""
    speed = np.minimum(0.5, acceleration * np.maximum(stop - T, 0.0))
    speed += np.minimum(0.5, acceleration * np.maximum(T - stop - 3.0, 0.0))
    return np.asarray(PERIOD * np.cumsum(speed))


@pytest.mark.parametrize("grain", [1e-9, 1e-6, 2.0 * np.pi / 8192, 2.0 * np.pi / 65536])
@pytest.mark.parametrize("acceleration", [0.2, 2.0, 20.0])
def test_a_joint_that_stands_is_not_frozen(acceleration: float, grain: float) -> None:
    assert frozen_rows(coarse(stopping(9.0, acceleration), grain)) == []


def test_a_log_that_begins_and_ends_at_rest_is_not_frozen() -> None:
    ramp = np.clip(np.minimum(T - 3.0, 20.0 - T), 0.0, 1.0)
    assert frozen_rows(coarse(PERIOD * np.cumsum(0.5 * ramp), 1e-9)) == []


@pytest.mark.parametrize("bits", [12, 13, 16, 20])
@pytest.mark.parametrize("slow", [1.0, 0.1, 0.01])
def test_coarse_encoders_are_not_frozen(slow: float, bits: int) -> None:
    assert frozen_rows(coarse(slow * MOTION, 2.0 * np.pi / 2**bits)) == []
    assert frozen_rows(coarse(slow * MOTION + NOISE, 2.0 * np.pi / 2**bits)) == []


def test_numbers_of_seven_digits_are_coarser_beyond_a_hundred() -> None:
    degrees = np.rad2deg(stopping(9.0, 0.2)) - 60.0
    coarser = np.where(np.abs(degrees) < 10.0, np.round(degrees, 3), np.round(degrees, 2))
    flicker = np.where(np.arange(ROWS) % 700 == 0, 0.01, 0.0) * (np.abs(degrees) > 10.0)
    assert frozen_rows(np.deg2rad(coarser)) == []
    assert frozen_rows(np.deg2rad(coarser + flicker)) == []


@pytest.mark.parametrize("held", [2, 6, 12, 25])
def test_values_that_the_logger_holds_for_some_rows_are_not_frozen(held: int) -> None:
    assert frozen_rows((MOTION + NOISE)[held * (np.arange(ROWS) // held)]) == []


def test_a_slip_while_all_stands_is_no_frozen_channel() -> None:
    values = coarse(stopping(9.0, 2.0), 1e-6)
    values[int(10.5 / PERIOD) :] += 2e-3
    assert frozen_rows(values) == []


def test_counters_that_wrap_are_not_frozen_and_frozen_ones_are_seen() -> None:
    words = np.rint((MOTION + NOISE) / COUNT).astype(np.int64) % 2**32
    logged = table(b1=words)
    assert with_frozen_motion_checked(logged, T, {"b1": COUNT}, 2**32) is logged
    words[2000:2007] = words[1999]
    checked = with_frozen_motion_checked(table(b1=words), T, {"b1": COUNT}, 2**32)
    assert np.flatnonzero(checked.flags).tolist() == list(range(2000, 2007))


def test_a_torque_that_repeats_while_its_motor_moves_is_left_out() -> None:
    noise = np.random.default_rng(2).standard_normal(ROWS)
    torque = 50.0 * np.cos(0.9 * T) + noise
    torque[800:806] = torque[799]
    checked = with_frozen_loads_checked(table(tau=torque, m=MOTION), {"tau": "m"})
    assert np.flatnonzero(checked.flags).tolist() == list(range(800, 806))
    standing = np.where(T < 4.0, MOTION, MOTION[1000])
    assert not with_frozen_loads_checked(table(tau=torque, m=standing), {"tau": "m"}).flags.all()
    held = np.where((T > 8.0) & (T < 12.0), 0.0, noise)  # on its brakes
    still = np.where((T > 8.0) & (T < 12.0), MOTION[2000], MOTION)
    assert not with_frozen_loads_checked(table(tau=held, m=still), {"tau": "m"}).flags.any()


def test_torques_in_whole_percents_repeat_by_chance() -> None:
    torque = np.rint(20.0 * np.cos(0.9 * T) + 0.3 * np.random.default_rng(3).standard_normal(ROWS))
    assert not with_frozen_loads_checked(table(tau=torque, m=MOTION), {"tau": "m"}).flags.any()


def test_torques_without_noise_repeat_where_they_turn_back_and_where_all_stands() -> None:
    turning = np.round(50.0 * np.cos(0.9 * T), 3)
    turning[4000:] = turning[4000]
    assert not with_frozen_loads_checked(table(tau=turning, m=MOTION), {"tau": "m"}).flags.any()
    assert not with_frozen_loads_checked(table(fx=turning), {"fx": None}).flags.any()
