"""The rod's tension at the samples of a recording, from a torque or force log on another clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.errors import InputError
from ballbar.cell.logs import ForceLog, RobotLog
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.loads.logged_tension import (
    KNOTS_PER_SECOND,
    LEAST_KNOTS,
    instrument_forces,
    sensor_tension,
    tension_splines,
    torque_tension,
)
from ballbar.ident.loads.rod_tension import SENSOR_NOISE
from ballbar.ident.signals.smooth_log import interpolating_log
from tests.helpers.known_loads import motion_at, tension_at
from tests.helpers.synthetic_recording import CELL, NOMINAL, exact_log, minute, recording

CLOCK = Clock(0.25, 1e-4)


@pytest.fixture(scope="module")
def samples() -> Samples:
    """The minute with rows as close as a robot logs them, the ball-bar's on a clock of its own."""
    path = minute(0.01)
    robot = exact_log(path.t, path.q)
    return replace(recording(clock=CLOCK), robot=robot)


@pytest.fixture(scope="module")
def torque(samples: Samples) -> Array:
    """(R, 6) [N m] of every row of the robot's log."""
    t = samples.robot.stamps
    return motion_at(t).torque(tension_at(t)).T


def at_samples(samples: Samples) -> Array:
    """(N,) [N] the planted tension at the samples, on the robot's clock."""
    return tension_at(CLOCK.robot_time(samples.times))


def moving(samples: Samples) -> Array:
    speed = np.abs(samples.robot.speed(CLOCK.robot_time(samples.times))).max(axis=1)
    return speed > 0.1


@pytest.mark.parametrize(
    ("duration", "count"), [(60.0, int(60 * KNOTS_PER_SECOND)), (3.0, LEAST_KNOTS)]
)
def test_splines_of_the_tension_add_up_to_one_everywhere(duration: float, count: int) -> None:
    times = np.linspace(5.0, 5.0 + duration, 300)
    splines = tension_splines(times)
    assert splines.shape == (count, 300)
    assert splines.sum(axis=0) == pytest.approx(np.ones(300))
    assert (np.diff(splines.indptr) > 0).all()  # each knot has samples
    assert (splines.toarray() > 0.0).sum(axis=0).max() == 4  # cubic


def test_stretches_of_samples_share_no_spline() -> None:
    times = np.concatenate((np.linspace(0.0, 20.0, 100), [300.0], np.linspace(600.0, 620.0, 100)))
    splines = tension_splines(times).toarray()
    assert splines.shape == (25 + LEAST_KNOTS + 25, 201)
    assert splines.sum(axis=0) == pytest.approx(np.ones(201))
    assert not splines[:25, 100:].any()
    assert not splines[25:-25, 101:].any()


def test_splines_follow_any_tension_that_changes_slowly() -> None:
    times = np.linspace(0.0, 60.0, 600)
    splines = tension_splines(times).T.toarray()
    fitted = splines @ np.linalg.lstsq(splines, tension_at(times))[0]
    assert np.abs(fitted - tension_at(times)).max() < 0.1  # of 80 N


def log_of(t: Array, torque: Array | None) -> RobotLog:
    return RobotLog(t, np.zeros((t.size, 6)), torque=torque)


def test_the_tension_follows_from_the_torques_on_the_ball_bars_clock(
    samples: Samples, torque: Array
) -> None:
    log = log_of(samples.robot.stamps, torque)
    force = torque_tension(CELL, samples, NOMINAL, CLOCK, log)
    off = force - at_samples(samples)
    # Means over 0.08 s, and friction near reversals; a clock 0.25 s off would leave 5 N.
    assert np.sqrt((off[moving(samples)] ** 2).mean()) < 1.5
    wrong = torque_tension(CELL, samples, NOMINAL, Clock(0.5, 0.0), log)
    assert np.sqrt(((wrong - at_samples(samples)) ** 2).mean()) > 4.0


def test_torques_logged_in_coarser_rows_serve_as_well(samples: Samples, torque: Array) -> None:
    t = samples.robot.stamps[::4]
    coarse = replace(samples, robot=replace(samples.robot, stamps=t))
    force = torque_tension(CELL, coarse, NOMINAL, CLOCK, log_of(t, torque[::4]))
    off = (force - at_samples(samples))[moving(samples)]
    assert np.sqrt((off**2).mean()) < 1.5


@pytest.mark.parametrize("lag", [-1.13, 0.37, 1.9])
def test_a_sensor_on_a_clock_of_its_own_is_aligned_by_what_it_should_measure(
    samples: Samples, lag: float
) -> None:
    """lag : [s] after the robot's log that of the sensor begins."""
    t = np.arange(0.0, 58.0, 0.02)
    at = np.clip(t + lag, 0.0, 60.0)
    wrench = motion_at(at).wrench(tension_at(at)).T + np.array([3.0, -4.0, 5.0, 0.2, -0.3, 0.4])
    wrench += np.random.default_rng(63).normal(0.0, SENSOR_NOISE, wrench.shape)
    force = sensor_tension(CELL, samples, NOMINAL, CLOCK, ForceLog(t, wrench))
    covered = (samples.times > 3.0) & (samples.times < 55.0)
    off = (force - at_samples(samples))[covered]
    # 1 N a row, four rows a mean; 0.05 s of lag would leave 1.5 N
    assert np.sqrt((off**2).mean()) < 0.8


def test_a_signal_that_was_not_logged_is_refused_with_the_choices(samples: Samples) -> None:
    with pytest.raises(InputError, match="no motor torques; choose force auto, sensor or none"):
        torque_tension(CELL, samples, NOMINAL, CLOCK, log_of(samples.robot.stamps, None))
    with pytest.raises(InputError, match="no log of a force sensor; choose force auto, torque"):
        sensor_tension(CELL, samples, NOMINAL, CLOCK, None)


def test_the_spring_follows_the_extension_and_friction_the_sign_of_its_rate() -> None:
    t = np.arange(0.0, 20.0, 0.05)
    still = interpolating_log(t, np.zeros((t.size, 6)), np.zeros(6))
    extension = interpolating_log(t, 2e-3 * np.sin(t)[:, None], np.zeros(1))
    at = np.linspace(1.0, 19.0, 200)
    samples = samples_of(still, extension, (), (), at)
    constant, spring, friction = instrument_forces(samples, (0.995, 1.005)).toarray()
    assert (constant == 1.0).all()
    assert spring == pytest.approx(0.4 * np.sin(at), abs=1e-6)  # 1 N at the end of the stroke
    fast = np.abs(np.cos(at)) > 0.1
    assert friction[fast] == pytest.approx(np.sign(np.cos(at))[fast], abs=0.02)
