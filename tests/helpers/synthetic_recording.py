"""A minute of one closed mechanism in numpy, without a plant: its logs as splines, its samples.

The rows of both logs lie on one grid, and the samples on rows of it, so the white noise of the rows
is the noise of the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.chain import screw
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry, bar_frames, nominal_geometry
from ballbar.cell.inverse import refine
from ballbar.cell.load import load_cell
from ballbar.ident.estimator.closure import Closure, close_loop
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.signals.smooth_log import SmoothLog, interpolating_log
from ballbar.sim.path import Lissajous, ReferencePath, reference_path

CELL = load_cell("irb2400", "lund_600", "plate_250")
NOMINAL = nominal_geometry(CELL, np.array([0.70, 0.0, 0.54]))
UNIVERSAL_AND_GIMBAL = (1, 2, 4, 5)  # the encoders of the thesis's ball-bar
ROW_PERIOD, ROWS_PER_SAMPLE = 0.05, 4  # [s], rows
NO_CLOCK_ERROR = Clock(0.0, 0.0)

SHAPE = Lissajous(  # scenarios/paths/irb2400_a.yaml
    centre=np.radians([-23.2, -54.3, 20.8, -129.6, 138.0]),
    amplitude=np.radians([75.9, -19.6, 31.0, -18.2, 87.4]),
    cycles=np.array([3.0, 1.0, 4.0, 2.0, 5.0]),
    phase=np.radians([18.0, 49.7, 251.0, 277.2, 357.4]),
)


@dataclass(frozen=True, eq=False)
class Loop:
    """A mechanism that is off by centimetres, and angles that close the nominal one."""

    geometry: Geometry
    q: Array  # (9, 6) [rad]
    b: Array  # (9, 5) [rad]

    @property
    def closure(self) -> Closure:
        return close_loop(self.geometry, self.q, self.b)


@lru_cache(maxsize=4)
def minute(step: float = ROW_PERIOD) -> ReferencePath:
    """Sixty seconds of the nominal mechanism, 2 s of dwell at both ends; step : [s] of its rows."""
    return reference_path(CELL.robot, NOMINAL, SHAPE, duration=60.0, dwell=2.0, stops=0, step=step)


def exact_log(t: Array, angles: Array, sigma: float = 2e-6) -> SmoothLog:
    """The spline through angles (N, C) [rad]; sigma : [rad] noise that is stated for a row."""
    return interpolating_log(t, angles, np.full(angles.shape[1], sigma))


def closed(true: Geometry, b: Array, q: Array, stretch: Array | float = 0.0) -> Array:
    """(N, 6) [rad] robot angles that close the loop of `true` at ball-bar angles b (N, 5) [rad].

    q : (N, 6) [rad] to start from. stretch : (N,) [m] of the rod beyond its length.
    """
    frames = bar_frames(true, b)
    poses = frames.poses()
    poses[:, :3, 3] += (screw(frames, "d", 2)[:3] * stretch).T
    return refine(true.robot, q, poses)


def recording(
    *,
    encoders: tuple[int, ...] = UNIVERSAL_AND_GIMBAL,
    true: Geometry = NOMINAL,
    clock: Clock = NO_CLOCK_ERROR,
    noise: float | Array = 0.0,
    encoder_noise: float | None = None,
    stretch: float = 0.0,
    repeated: int = 1,
    stated: float = 1e-5,
    seed: int = 0,
) -> Samples:
    """Samples of the minute: mechanism `true`, the ball-bar's log on a clock of its own.

    noise : [rad] of the robot's angles, of each joint where it is (6,). encoder_noise : [rad] of
    the encoders' readings; the same where it is not given. stretch : [m] of the rod. All are
    white, or the same over `repeated` samples. stated : [rad] the noise that both logs claim.
    """
    rng, path = np.random.default_rng(seed), minute()
    rows = 1 if repeated == 1 else repeated * ROWS_PER_SAMPLE

    def random(columns: int) -> Array:
        drawn = rng.standard_normal((-(-path.t.size // rows), columns))
        return np.repeat(drawn, rows, axis=0)[: path.t.size]

    encoder_noise = noise if encoder_noise is None else encoder_noise
    q = closed(true, path.b, path.q, stretch * random(1)[:, 0]) + noise * random(6)
    b = path.b + encoder_noise * random(5)
    t_bar = clock.ballbar_time(path.t)
    columns = [joint - 1 for joint in encoders]
    ballbar = exact_log(t_bar, b[:, columns], stated) if encoders else None
    times = (t_bar if encoders else path.t)[30:-30:ROWS_PER_SAMPLE]
    robot = exact_log(path.t, q, stated)
    return samples_of(robot, ballbar, encoders, np.ones(len(encoders)), times)
