"""Single channels of the logs that are late or scaled: a score test for each, after a failed fit.

A channel (gear or encoder) that is logged late by tau reads tau times its speed too little; one
whose gear ratio or line count is not the stated one reads a share of its angle too much. Either
displaces the channel's own column of the loop closure by a known signal s. The nominal robot with
its encoder offsets, base position and clock fitted is linearised with all parameters that the
recording identifies: to first order they leave a cost `c = r'r - g'Cg` of the residual r, and with
s among them `c - (s'r - s'J C g)^2 / (s's - s'J C J's)`. So all channels cost little more than an
iteration of a fit, and an error of a percent does no harm, as it would in the fit that failed.

The same is done beside a complete fit of several recordings, of each channel of each recording: a
lag or factor that all recordings share is among its unknowns (joint_lag, gear_ratio), one of a
single recording or of an encoder is not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.ident.corrections.base import BAR
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.model import Evaluation, Model, gearing
from ballbar.ident.estimator.normal_equations import (
    NormalEquations,
    jacobian,
    normal_equations,
    products,
)
from ballbar.ident.recording_fit import RecordingFit, nominal_robot_fit

DECISIVE = 3.0  # times less than without the channel's error
# Share of a recording's cost that an error explains beside a complete fit: 0.4 and more where a
# channel of one of two recordings is a row late, 0.02 at most of sound machines
BESIDE = 0.2
LATE, SCALED = 5e-4, 5e-5  # [s], [1] a smaller error is named by nobody
_DEPENDENT = 1e-3  # of a signal's power: what is left of one that other unknowns can stand for


@dataclass(frozen=True)
class ChannelError:
    """An error of one channel that would explain a recording."""

    recording: int  # from 0
    channel: str  # gear 3, encoder b2
    late: bool  # whether it is a delay, else a factor
    size: float  # [s] by which it is late, or [1] relative error of its angle
    left: float  # share of the recording's cost that it leaves

    @property
    def remedy(self) -> str:
        """The remedy, as a sentence without its full stop."""
        if self.late:
            return "Log all channels of a row at one instant"
        if self.channel.startswith("encoder"):
            return "Correct its lines and bits in recording.yaml"
        return "Correct its gear ratio in the robot's file, or the unit of its column"


@dataclass(frozen=True, eq=False)
class _Signal:
    channel: str
    late: bool
    values: Array  # (E, N) whitened change of the residual for a unit of the error


def channel_errors(cell: Cell, recording: RecordingFit) -> list[ChannelError]:
    """The errors of single channels that explain a recording, the best first; else nothing.

    recording : its fit by kinematics, which may have failed.
    """
    fit = nominal_robot_fit(recording, recording.samples)
    clock = fit.clock() if recording.samples.has_clock else None
    layout, x = kinematic_unknowns(fit.geometry(), clock, recording.subset.parameters)
    model = Model(fit.model.gearing, None, (), layout, fit.model.recordings)
    linear = normal_equations(model, x, fit.ballbars, fit.excess)
    covariance = inverse(linear.normal)
    errors = _errors(cell, model, linear, covariance, covariance @ linear.gradient, 0)
    named = (e for e in errors if abs(e.size) > (LATE if e.late else SCALED))
    return _ranked(named, 1.0 / DECISIVE)


def channel_errors_beside(cell: Cell, fit: Fit) -> list[ChannelError]:
    """The errors of single channels of single recordings that a complete fit cannot have.

    The most decisive first; nothing where none is. The fit has moved all its unknowns to make up
    for such an error, and has taken its excess noise for what is left: a small share of the cost
    decides.
    """
    still = np.zeros(fit.model.unknowns.count)  # the step of a fit that has converged
    errors = (
        error
        for k in range(len(fit.model.recordings))
        for error in _errors(cell, fit.model, fit.linear, fit.covariance, still, k)
    )
    return _ranked(errors, 1.0 - BESIDE)


def _ranked(errors: Iterable[ChannelError], left: float) -> list[ChannelError]:
    """Errors that leave less than a share `left` of the residual, the least first."""
    return sorted((e for e in errors if e.left < left), key=lambda error: error.left)


def _errors(
    cell: Cell, model: Model, linear: NormalEquations, covariance: Array, step: Array, k: int
) -> Iterator[ChannelError]:
    """Every error of a single channel of recording k, sized by its score.

    covariance : (P, P) of the unknowns. step : (P,) by which they move without it.
    """
    residual, weights, point = linear.residuals[k], linear.weights[k], linear.evaluations[k]
    blocks = list(jacobian(model, linear, k))
    cost = float((residual * residual).sum() - linear.gradient @ step)
    for signal in _signals(cell, point, weights(_columns(cell, point))):
        shared = products(model, k, blocks, signal.values)
        power = float((signal.values * signal.values).sum())
        rest = power - float(shared @ covariance @ shared)
        score = float((signal.values * residual).sum() - shared @ step)
        if rest > _DEPENDENT * power:
            left = (cost - score * score / rest) / cost
            yield ChannelError(k, signal.channel, signal.late, score / rest, left)


def _columns(cell: Cell, point: Evaluation) -> Array:
    """(J + 5, 6, N) change of the loop-closure error per radian of each gear and encoder."""
    joints, bar = point.columns[:BAR], point.columns[BAR : BAR + 5]
    gears = np.einsum("gj,jcn->gcn", gearing(cell.robot).to_joint, joints)
    return np.concatenate((gears, bar))


def _signals(cell: Cell, point: Evaluation, columns: Array) -> Iterator[_Signal]:
    """Every error of a single channel; columns (J + 5, E, N) whitened, of gears and encoders.

    A log that shows too much moves the residual as the channel's own motion does with that sign.
    """
    samples, to_gear = point.recording, gearing(cell.robot).to_gear
    angles = (samples.joint_angles(point.robot_time) @ to_gear).T
    speeds = (samples.joint_speed(point.robot_time) @ to_gear).T
    for k, (angle, speed) in enumerate(zip(angles, speeds, strict=True)):
        yield _Signal(f"gear {k + 1}", True, -columns[k] * speed)
        yield _Signal(f"gear {k + 1}", False, columns[k] * (angle - angle.mean()))
    if samples.ballbar is None:
        return
    speeds = (np.asarray(samples.ballbar.speed(samples.times)) * samples.directions).T
    for joint, speed in zip(samples.encoders, speeds, strict=True):
        column, angle = columns[len(angles) + joint - 1], point.ballbar[:, joint - 1]
        yield _Signal(f"encoder b{joint}", True, -column * speed)
        yield _Signal(f"encoder b{joint}", False, column * (angle - angle.mean()))
