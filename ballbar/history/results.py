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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import parameter_named
from ballbar.history.events import Series
from ballbar.ident.least_sizes import WANDER_ZERO
from ballbar.ident.robot.accuracy import accuracy_grid, aligned_columns
from ballbar.ident.robot.identified import RANGE_MARGIN
from ballbar.ident.rules import UNDETERMINED
from ballbar.ident.verdict import Status
from ballbar.result.calibration import Calibration, load

MONTH = 365.25 / 12.0  # [days]
# of the corrections that belong to an axis
KINDS = {
    "gear_backlash": "backlash",
    "typical_backlash": "backlash",
    "joint_compliance": "compliance",
    "typical_compliance": "compliance",
    "gear_ripple": "ripple",
    "joint_harmonics": "ripple",
}


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


def series_of(results: Sequence[DatedResult]) -> tuple[Series, ...]:
    """What the acceptable results state of each axis on two days or more."""
    used = [(k, r) for k, r in enumerate(results) if r.acceptable]
    repeated = repetitions([r.calibration for _, r in used])
    stated = {k: _stated(r.calibration, repeated) for k, r in used}
    moves = _moves(used[-1][1].calibration) if used else {}
    names = dict.fromkeys(name for values in stated.values() for name in values)
    series = []
    for name in names:
        dates = np.array([k for k, values in stated.items() if name in values])
        days = [results[k].day for k in dates]
        if name not in moves or days[0] == days[-1]:
            continue
        value, sigma = np.array([stated[k][name] for k in dates]).T
        t = np.array([(day - results[0].day).days / MONTH for day in days])
        axis, kind, unit, move = moves[name]
        series.append(Series(name, axis, kind, unit, dates, t, _near(value, kind), sigma, move))
    return tuple(sorted(series, key=lambda s: (s.axis, list(_ORDER).index(s.kind))))


_ORDER = ("zero", "twist", "backlash", "compliance", "ripple")


def _near(value: Array, kind: str) -> Array:
    """Values, angles within half a turn of the first."""
    if kind not in ("zero", "twist"):
        return value
    return np.asarray(value[0] + np.angle(np.exp(1j * (value - value[0]))))


def repetitions(calibrations: Sequence[Calibration]) -> bool:
    """Whether results are of logs of one path, taken with one instrument and plate."""
    first = calibrations[0]
    return all(
        c.of_logs
        and _shared(c) == _shared(first)
        and c.ranges.shape == first.ranges.shape
        and np.allclose(c.ranges, first.ranges, rtol=0.0, atol=RANGE_MARGIN)
        for c in calibrations
    )


def _shared(calibration: Calibration) -> tuple[object, ...]:
    """What two results have in common if they are of one instrument, plate and load."""
    file = calibration.file
    return file.instrument, file.plate, file.masses is None, tuple(file.corrections)


def _stated(calibration: Calibration, repeated: bool) -> dict[str, tuple[float, float]]:
    """Value and deviation of every quantity that the data of a result determine.

    repeated : whether the deviation is that of a repetition, where it is stated.
    """
    file = calibration.file
    values = {name: (file.parameters[name].value, sigma) for name, sigma in _angles(calibration)}
    values |= {
        key: (c.value, c.sigma)
        for name, entries in file.corrections.items()
        for key, c in entries.items()
        if name in KINDS and c.information_gain >= UNDETERMINED
    }
    if repeated and file.covariance is not None and file.covariance.repeated_sigma:
        pairs = zip(file.covariance.names, file.covariance.repeated_sigma, strict=True)
        values |= {name: (values[name][0], sigma) for name, sigma in pairs if name in values}
    for name, _ in _angles(calibration):
        values[name] = values[name][0], float(np.hypot(values[name][1], WANDER_ZERO))
    return values


def _angles(calibration: Calibration) -> Iterator[tuple[str, float]]:
    """Names and deviations of the identified angles of the robot, those of the tool left out."""
    for name, entry in calibration.file.parameters.items():
        parameter = parameter_named(name)
        own = parameter.side == "robot" and parameter.row < calibration.robot.joints - 1
        if own and entry.sigma is not None and not parameter.is_length:
            yield name, entry.sigma


def _moves(calibration: Calibration) -> dict[str, tuple[int, str, str, Array]]:
    """Axis, kind, unit and motion of the tool of every quantity of a robot."""
    robot = calibration.identified_robot()
    q = accuracy_grid(robot.robot) if calibration.of_logs else robot.workspace()
    table = robot.geometry.table
    names = [name for name, _ in _angles(calibration)]
    indices = np.array([table.index[name] for name in names], dtype=np.intp)
    columns = aligned_columns(robot.poses(q)[:, :3, 3], robot.jacobian(q, indices)).T
    entries: dict[str, tuple[int, str, str, Array]] = {}
    for name, column in zip(names, columns, strict=False):
        parameter = parameter_named(name)
        kind = "zero" if parameter.kind == "theta" else "twist"
        entries[name] = (parameter.row + 1, kind, "rad", column)
    coefficients = [(c.name, k) for c in robot.corrections for k in c.coefficients]
    for (correction, c), column in zip(coefficients, columns[len(names) :], strict=True):
        axis = re.search(r"\d+", c.name)
        if correction in KINDS and axis is not None:
            entries[c.name] = (int(axis[0]), KINDS[correction], c.unit, column)
    return entries
