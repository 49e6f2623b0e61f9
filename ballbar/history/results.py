"""The results of one robot in order of time, and the series of what they state of its axes.

Results of one path share what instrument, plate, masses, nominal robot and priors are off by: a
difference has the noise of the data alone, which a result of logs states (`repeated_sigma`). Where
instrument, plate or fitted ranges differ, and of still poses, the whole stated uncertainty counts:
too much of it, never too little. An unchanged axis is off by WANDER_ZERO from one recording to the
next.

Lengths are not compared, which follow the temperature, nor is the last row, which holds what the
tool was mounted by.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import parameter_named
from ballbar.history.events import AxisSeries
from ballbar.ident.least_sizes import WANDER_ZERO
from ballbar.ident.robot.accuracy import accuracy_grid, aligned_columns
from ballbar.ident.robot.identified import RANGE_MARGIN
from ballbar.ident.rules import UNDETERMINED
from ballbar.ident.verdict import Status
from ballbar.result.calibration import Calibration, load

MONTH = 365.25 / 12.0  # [days]
_COEFFICIENT = re.compile(r"(?:typical_)?(backlash|compliance|ripple|joint)(\d+)(?:_[\d.]+_\w+)?")


@dataclass(frozen=True, eq=False)
class DatedResult:
    """A result, and when it was measured."""

    day: date
    measured: bool  # the day is that of the measurement; else that of the file
    calibration: Calibration

    @property
    def acceptable(self) -> bool:
        return Status(self.calibration.file.fit.status).acceptable


def dated_results(paths: Sequence[Path]) -> tuple[DatedResult, ...]:
    """The results in folders, or of calibration.yaml files, in order of time.

    Raises InputError for fewer than two days, and for results that cannot be compared: of another
    robot, or of still poses among those of logs.
    """
    results = tuple(sorted((_dated(load(path)) for path in paths), key=lambda r: r.day))
    first = results[0].calibration
    for other in (r.calibration for r in results[1:]):
        if other.robot.title != first.robot.title:
            what = f"is of robot {other.robot.title}, {first.path} of {first.robot.title}."
            raise InputError.at(other.path, what, "Name the results of one robot.")
        _ = other.file_of_logs() if first.of_logs else other.file_of_poses()
    if results[0].day == results[-1].day:
        what = f"{len(results)} of {results[0].day}: a history has results of two days or more."
        remedy = "Set measured_on in recording.yaml or poses.yaml where the stamps are of no date."
        raise InputError.at("results", what, remedy)
    return results


def _dated(calibration: Calibration) -> DatedResult:
    day = calibration.file.measured_on
    if day is not None:
        return DatedResult(date.fromisoformat(day), True, calibration)
    written = date.fromtimestamp(calibration.path.stat().st_mtime)
    return DatedResult(written, False, calibration)


def series_of(results: Sequence[DatedResult]) -> list[AxisSeries]:
    """Every quantity of an axis that the acceptable results state on two days or more."""
    used = [(k, r) for k, r in enumerate(results) if r.acceptable]
    repeated = repetitions([r.calibration for _, r in used])
    stated = {k: _stated(r.calibration, repeated) for k, r in used}
    moves = _moves(used[-1][1].calibration) if used else {}
    series = []
    for name, move in moves.items():
        dates = np.array([k for k, values in stated.items() if name in values], dtype=np.intp)
        t = np.array([(results[k].day - results[0].day).days / MONTH for k in dates])
        if t.size and t[-1] > t[0]:
            axis, kind = _quantity(name, results[0].calibration.robot.joints) or (0, "")
            value, sigma = np.array([stated[int(k)][name] for k in dates]).T
            if kind in ("zero", "twist"):  # within half a turn of the first
                value = value[0] + np.angle(np.exp(1j * (value - value[0])))
            series.append(
                AxisSeries(
                    name=name,
                    axis=axis,
                    kind=kind,
                    dates=dates,
                    t=t,
                    value=value,
                    sigma=sigma,
                    moves=move,
                )
            )
    return series


def repetitions(calibrations: Sequence[Calibration]) -> bool:
    """Whether results are of logs of one path, taken with one instrument, plate and model."""

    def shared(calibration: Calibration) -> tuple[object, ...]:
        file = calibration.file
        return file.instrument, file.plate, file.masses is None, tuple(file.corrections)

    return all(
        c.of_logs
        and shared(c) == shared(calibrations[0])
        and c.ranges.shape == calibrations[0].ranges.shape
        and np.allclose(c.ranges, calibrations[0].ranges, rtol=0.0, atol=RANGE_MARGIN)
        for c in calibrations
    )


def _quantity(name: str, joints: int) -> tuple[int, str] | None:
    """Axis, from 1, and kind of a parameter or coefficient; None for one that is not compared."""
    if parts := _COEFFICIENT.fullmatch(name):
        return int(parts[2]), parts[1].replace("joint", "ripple")
    try:
        parameter = parameter_named(name)
    except KeyError:
        return None
    if parameter.side != "robot" or parameter.is_length or parameter.row >= joints - 1:
        return None
    return parameter.row + 1, "zero" if parameter.kind == "theta" else "twist"


def _stated(calibration: Calibration, repeated: bool) -> dict[str, tuple[float, float]]:
    """Value and deviation of every quantity that the data of a result determine.

    repeated : whether the deviation is that of a repetition, where it is stated.
    """
    file, joints = calibration.file, calibration.robot.joints
    identified = {n: (p.value, p.sigma) for n, p in file.parameters.items() if p.sigma is not None}
    for entries in file.corrections.values():
        known = (item for item in entries.items() if item[1].information_gain >= UNDETERMINED)
        identified |= {name: (c.value, c.sigma) for name, c in known}
    own = {}
    if repeated and file.covariance is not None and file.covariance.repeated_sigma:
        own = dict(zip(file.covariance.names, file.covariance.repeated_sigma, strict=True))
    wander = dict.fromkeys(file.parameters, WANDER_ZERO)
    return {
        name: (value, float(np.hypot(own.get(name, sigma), wander.get(name, 0.0))))
        for name, (value, sigma) in identified.items()
        if _quantity(name, joints)
    }


def _moves(calibration: Calibration) -> dict[str, Array]:
    """(3 G,) [m per unit] motion of the tool over the workspace for every quantity of a robot."""
    robot = calibration.identified_robot()
    q = accuracy_grid(robot.robot) if calibration.of_logs else robot.workspace()
    names = [n for n in robot.geometry.table.names if _quantity(n, robot.robot.joints)]
    indices = np.array([robot.geometry.table.index[name] for name in names], dtype=np.intp)
    columns = aligned_columns(robot.poses(q)[:, :3, 3], robot.jacobian(q, indices)).T
    names += [c.name for correction in robot.corrections for c in correction.coefficients]
    pairs = zip(names, columns, strict=True)
    return {name: column for name, column in pairs if _quantity(name, robot.robot.joints)}
