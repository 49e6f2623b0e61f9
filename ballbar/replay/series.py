"""The curves of a replay: angles, residuals, TCP error, rod force and strain, clock; each with its unit in the entity's name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from ballbar.replay.entities import (
    AFTER,
    ANGLE,
    BEFORE,
    CLOCK_ERROR,
    CLOCK_FOUND,
    CLOCK_TRUE,
    ENCODERS,
    FORCE_FOUND,
    FORCE_TRUE,
    GREEN,
    JOINTS,
    POSITION,
    RED,
    STRAIN_FOUND,
    STRAIN_TRUE,
    TCP_AFTER,
    TCP_BEFORE,
    Colour,
    at,
)
from ballbar.replay.motion import CellMotion, TrueTool, mechanism_angles, on_robot_clock, thinning
from ballbar.result.run_data import RunData
from cell.arrays import Array
from ident.identify import Identification, Residuals

_REDS = [RED, (242, 142, 43), (214, 120, 160)]
_GREENS = [GREEN, (118, 183, 178), (170, 205, 90)]
_SERIES = [
    (78, 121, 167),
    (242, 142, 43),
    (225, 87, 76),
    (118, 183, 178),
    (89, 161, 79),
    (237, 201, 72),
]  # one colour a joint


@dataclass(frozen=True, eq=False)
class Series:
    """Curves of one plot."""

    t: Array  # (N,) [s] robot's clock
    values: Array  # (N, C), unit as in the entity's name
    names: Sequence[str]  # (C,) as the legend shows them
    colours: Sequence[Colour]  # (C,)


def run_series(data: RunData, motion: CellMotion, truth: TrueTool | None) -> dict[str, Series]:
    """Every plot of the run, by entity."""
    result, log = data.identification, data.recording.ballbar_log
    series = {
        JOINTS: Series(motion.t, np.degrees(motion.q), [f"q{i}" for i in range(1, 7)], _SERIES)
    }
    if log is not None:
        rows = np.arange(0, log.t.size, thinning(log.t))
        angles = np.degrees(mechanism_angles(result, log)[rows])
        colours = [_SERIES[joint - 1] for joint in log.joints]
        series[ENCODERS] = Series(
            on_robot_clock(result, log.t[rows]),
            angles,
            [f"b{joint}" for joint in log.joints],
            colours,
        )
    series |= _residual_series(
        BEFORE, "before", on_robot_clock(result, result.before.t), result.before, _REDS
    )
    series |= _residual_series(
        AFTER, "after", on_robot_clock(result, result.after.t), result.after, _GREENS
    )
    series |= _rod_series(result) | _clock_series(data, motion.t)
    return series if truth is None else series | _truth_series(truth, motion.t)


def _residual_series(
    entity: str, when: str, t: Array, residuals: Residuals, colours: list[Colour]
) -> dict[str, Series]:
    names = [f"{axis} {when}" for axis in "xyz"]
    return {
        f"{entity}/{POSITION}": Series(t, residuals.position * 1e6, names, colours),
        f"{entity}/{ANGLE}": Series(t, residuals.angle * 1e6, names, colours),
    }


def _truth_series(truth: TrueTool, t: Array) -> dict[str, Series]:
    before, after = (
        np.linalg.norm(error, axis=1)[:, None] * 1e6
        for error in (truth.nominal_error, truth.identified_error)
    )
    series = {
        TCP_BEFORE: Series(t, before, ["nominal"], [RED]),
        TCP_AFTER: Series(t, after, ["identified"], [GREEN]),
    }
    if truth.rod_force.any():  # a kinematic plant knows no forces
        series[FORCE_TRUE] = Series(t, truth.rod_force[:, None], ["true"], [_SERIES[0]])
        series[STRAIN_TRUE] = Series(t, truth.rod_strain[:, None] * 1e6, ["true"], [_SERIES[0]])
    return series


def _rod_series(result: Identification) -> dict[str, Series]:
    """Force and strain as the complete model found them; strain without play."""
    if not result.tension.any():
        return {}
    t = on_robot_clock(result, result.after.t)
    series = {FORCE_FOUND: Series(t, result.tension[:, None], ["identified"], [GREEN])}
    compliance = [
        c.value
        for one in result.corrections
        for c in one.coefficients
        if c.name == "rod_compliance"
    ]
    if compliance:
        series[STRAIN_FOUND] = Series(
            t, compliance[0] * result.tension[:, None] * 1e6, ["identified"], [GREEN]
        )
    return series


def _clock_series(data: RunData, t: Array) -> dict[str, Series]:
    """Robot's clock minus ball-bar's, each counted from the first row of its log; and how wrong that is, where the truth is known."""
    clock = data.identification.clock
    if clock is None:
        return {}
    found = t - clock.ballbar_time(t)
    series = {CLOCK_FOUND: Series(t, found[:, None] * 1e3, ["identified"], [GREEN])}
    if data.simulation is None:
        return series
    times = data.simulation.times
    stamps = (times.bar_stamp - times.bar_stamp[0]) * 1e-9
    true_time = np.interp(t, times.robot_stamp - times.robot_stamp[0], times.robot_true)
    inside = (true_time >= times.bar_true[0]) & (true_time <= times.bar_true[-1])
    true = t[inside] - np.interp(true_time[inside], times.bar_true, stamps)
    series[CLOCK_TRUE] = Series(t[inside], true[:, None] * 1e3, ["true"], [_SERIES[0]])
    series[CLOCK_ERROR] = Series(
        t[inside], (found[inside] - true)[:, None] * 1e6, ["identified minus true"], [RED]
    )
    return series


def log_series(stream: rr.RecordingStream, entity: str, one: Series) -> None:
    """Writes one plot's curves."""
    # zoomed out, the viewer would draw averages by itself, and a single bad sample would not be seen
    style = rr.SeriesLines(names=one.names, colors=one.colours, aggregation_policy="MinMax")
    stream.log(entity, style, static=True)
    stream.send_columns(entity, indexes=at(one.t), columns=rr.Scalars.columns(scalars=one.values))
