"""Readings of an instrument with noise and outliers, drift of its seats, and logged angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.chain import forward
from ballbar.cell.instruments.base import Instrument, TrueStand
from ballbar.cell.robot_angles import joints_to_axes
from ballbar.sim.errors.base import with_logged_errors
from ballbar.sim.settings import ErrorSettings
from ballbar.sim.streams import stream
from ballbar.sim.true_robot import TrueArm
from ballbar.sim.truth import SeatMotion, TruePlace


def seat_motion(errors: ErrorSettings, seed: int) -> SeatMotion:
    """The drawn drift of the seats."""
    directions = stream(seed, "drift").standard_normal((2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    drift = errors.drift
    sizes = (drift.shift_m, drift.turn_rad) if drift else (0.0, 0.0)
    shift, turn = (size * direction for size, direction in zip(sizes, directions, strict=True))
    return SeatMotion(shift_m=tuple(shift.tolist()), turn_rad=tuple(turn.tolist()))


def stand_of(
    arm: TrueArm, q: Array, target: TruePlace, seat: tuple[Array, Array], sag: Array | None = None
) -> TrueStand:
    """Where a target stands at shown angles q (N, J) [rad].

    seat : origin (3, N) and rotation (3, 3, N). sag : (N, J) [rad] actual joint angles, where a
        plant has found them; otherwise those under the arm's own weight.
    """
    frames = arm.flange(q) if sag is None else forward(arm.chain, sag)
    place = frames.tip + np.einsum("ijn,j->in", frames.rotation(), target.position)
    return seen_from(seat, place, np.einsum("ijn,jk->ikn", frames.rotation(), target.rotation))


def seen_from(seat: tuple[Array, Array], place: Array, turn: Array) -> TrueStand:
    """Places (3, N) [m] and rotations (3, 3, N) in the base frame as a seat sees them."""
    rod = place - seat[0]
    return TrueStand(
        rod=np.einsum("jin,jn->in", seat[1], rod),
        distance=np.linalg.norm(rod, axis=0),
        rotation=np.einsum("jin,jkn->ikn", seat[1], turn),
    )


def measured(
    instrument: Instrument, exact: TrueStand, *, scale: float, rng: np.random.Generator
) -> Array:
    """(N, M) [m, rad] values of an instrument, M as its kind's `columns`.

    scale : of the noise, along the line of sight and across it.
    """
    noise = scale * rng.standard_normal((6, exact.distance.size))
    return instrument.kind.measure(exact, noise, instrument)


def outliers(errors: ErrorSettings, instrument: Instrument, count: int, seed: int) -> Array:
    """(N, 3) [m] what is added to readings, to a length the first of them; 0 where one is right.

    A socket's are added to the place of the ball.
    """
    rng = stream(seed, "outliers")
    out = np.zeros((count, 3))
    if errors.outliers is None:
        return out
    width = min(3, instrument.kind.columns) or 3
    wrong = rng.uniform(size=count) < errors.outliers.share
    low, high = np.log(errors.outliers.size_m)
    sizes = np.exp(rng.uniform(low, high, count))
    directions = rng.standard_normal((count, width))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    out[wrong, :width] = sizes[wrong, None] * directions[wrong]
    return out


def unsettled(errors: ErrorSettings, q: Array, seed: int) -> tuple[Array, NDArray[np.bool_]]:
    """Angles (N, J) [rad] at which those poses were read that were read too early, and which (N,).

    q : (N, J) [rad] of all poses in the order of time.
    """
    early = np.zeros(len(q), dtype=bool)
    if errors.unsettled is None:
        return q, early
    early = stream(seed, "unsettled").uniform(size=len(q)) < errors.unsettled.share
    early[0] = False
    missing = errors.unsettled.fraction * np.diff(q, axis=0, prepend=q[:1])
    return np.where(early[:, None], q - missing, q), early


def logged_axes(arm: TrueArm, errors: ErrorSettings, q: Array, seed: int) -> Array:
    """(N, J) [rad] axis angles in the table, of shown angles q (N, J) [rad]."""
    noise = stream(seed, "pose_joint_noise").standard_normal(q.shape)
    if errors.joint_noise is not None:
        q = q + errors.joint_noise.sigma_rad * noise
    axes = joints_to_axes(arm.robot, with_logged_errors(errors, q, seed))
    if errors.rounding is not None:
        step = np.deg2rad(errors.rounding.step_deg)
        axes = np.round(axes / step) * step
    return axes
