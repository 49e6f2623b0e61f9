"""Measured values against the catalogue robot: wrong units, left-handed frames, wrong conventions.

The nominal robot is good to millimetres, which is enough to see a factor of 1000, a mirrored axis
or angles turned about other axes. A little wrong is the identifier's matter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ballbar.acquisition.faults.robot_angles import AngleReading
from ballbar.acquisition.faults.table_angles import fits
from ballbar.acquisition.measured_values import rotation
from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.quantities import PoseRows
from ballbar.cell.arrays import Array
from ballbar.cell.chain import Frames
from ballbar.cell.descriptions import Robot
from ballbar.cell.errors import LogError
from ballbar.cell.file_units import METRES, RADIANS, AngleUnit, LogLengthUnit
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.pose_file import ValueColumns
from ballbar.cell.rigid_fit import nearest_rotation, nominal_frames, rigid_fit

FEWEST = 10  # poses: fewer lie on many robots
MOST_JUDGED = 400  # poses; more show nothing new
_LARGE, _SMALL = 2.2, 1.0 / 200.0  # spread of positions, as a share of the robot's reach
_TOOL = 0.5  # [m] no target is further from the flange
_MOVED = 0.1  # of the reach: spread of the nominal flange that must show in the positions
_BETTER = 5.0  # times smaller residual of a mirrored frame
_FITS = 0.05  # of the reach: a nominal robot within it is the right one
_SEAT_FITS = 0.03  # of the reach: the same of a few points, carried on to the others
_TRIALS, _FEW = 150, 5  # of two equal parts, five points are of one in a sixteenth of the trials
_MOST = 0.9  # of the points of each seat that have to fit
_TURN_OFF = np.deg2rad(3.0)  # [rad] median error of the rotations
_TURN_FITS = 0.3  # of that, by another convention
_EULER = tuple("".join(axes) for axes in product("XYZ", repeat=3) if axes[0] != axes[1] != axes[2])
_CONVENTIONS = (*_EULER, *map(str.lower, _EULER), "rotvec")
_QUATERNIONS = ("quat_wxyz", "quat_xyzw")


def reach(robot: Robot) -> float:
    """[m] length of the stretched arm, an upper bound."""
    return float(np.hypot(robot.a, robot.d).sum())


def judged(count: int, most: int = MOST_JUDGED) -> NDArray[np.intp]:
    """(K,) rows that checks look at: all, or `most` spread evenly over `count`."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


def spread_of(points: Array) -> float:
    """[m] width of points (N, 3) [m]: twice the distance from their middle that nine in ten keep.

    Single wrong points do not change it.
    """
    return 2.0 * float(np.quantile(_off_middle(points), 0.9))


def _off_middle(points: Array) -> Array:
    """(N,) [m] distance of points (N, 3) [m] from their median."""
    return np.asarray(np.linalg.norm(points - np.median(points, axis=0), axis=1))


def check_positions(
    robot: Robot, rows: PoseRows, q: Array, points: Array, unit: str
) -> tuple[Finding, ...]:
    """Findings about measured points (N, 3) [m], declared in `unit`, at angles q (N, J) [rad].

    Raises LogError for points in another unit and for a left-handed frame.
    """
    chosen, length = judged(len(q)), reach(robot)
    frames, few = nominal_frames(robot, q[chosen]), points[chosen]
    spread, moved = spread_of(few), spread_of(frames.tip.T)
    far = spread > _LARGE * length + 2.0 * _TOOL
    if far:
        _refuse_two_seats(robot, rows, q, points)
    if far or (spread < _SMALL * length and moved > _MOVED * length):
        what = "more than the robot reaches" if far else "though its flange moves"
        raise LogError(
            f"{rows.file}: the measured points spread over {spread:.4g} m as {unit}, {what} "
            f"({length:.3g} m stretched, flange over {moved:.3g} m). "
            f"{_other_unit(spread, moved, unit)}"
        )
    if chosen.size < FEWEST:
        return ()
    limit = 2.0 * (length + _TOOL)
    within = _off_middle(few) < limit
    findings = _off_nominal(robot, rows, nominal_frames(robot, q[chosen][within]), few[within])
    if findings:
        _refuse_two_seats(robot, rows, q, points)
    sentence = "the point lies further from the others than the robot reaches."
    return (*rows.remark("point out of reach", sentence, _off_middle(points) >= limit), *findings)


def _refuse_two_seats(robot: Robot, rows: PoseRows, q: Array, points: Array) -> None:
    """Raises LogError if points (N, 3) [m] are those of two seats under one name.

    The largest part of the points that fits the catalogue robot is sought among random few
    (Fischler & Bolles 1981); the others have to fit it from another seat.
    """
    chosen = judged(len(q))
    if chosen.size < 2 * FEWEST:
        return
    lines, q, points = rows.line[chosen], q[chosen], points[chosen]
    limit = _SEAT_FITS * reach(robot)
    rng, best = np.random.default_rng(0), np.zeros(chosen.size, dtype=bool)
    for _ in range(_TRIALS):
        few = rng.choice(chosen.size, _FEW, replace=False)
        fitting = _distances(robot, q, points, few) < limit
        best = fitting if fitting.sum() > best.sum() else best
    if not FEWEST <= best.sum() <= chosen.size - FEWEST:
        return
    own, others = np.flatnonzero(best), np.flatnonzero(~best)
    first = _distances(robot, q, points, own)[own] < limit
    second = _distances(robot, q, points, others)[others] < limit
    if first.mean() < _MOST or second.mean() < _MOST:
        return
    parts = sorted((lines[own], lines[others]), key=min)
    seats = "; and ".join(map(_lines, parts))
    raise LogError(
        f"{rows.file}: the points fit {robot.name} only as those of two seats of the instrument "
        f"under one name: {seats}. Give each seat its name: a column with the names "
        "(`seat: {column: ...}`), or a table for each."
    )


def _distances(robot: Robot, q: Array, points: Array, chosen: NDArray[np.intp]) -> Array:
    """(N,) [m] of points (N, 3) from the nominal robot at q (N, J), moved onto the chosen ones."""
    frames = nominal_frames(robot, q)
    position, turns = frames.tip.T, frames.rotation().transpose(2, 0, 1)
    turn = rigid_fit(nominal_frames(robot, q[chosen]), points[chosen]).rotation
    wanted = points @ turn - position
    both = np.concatenate((turns, np.tile(np.eye(3), (len(turns), 1, 1))), axis=2)
    place = np.linalg.lstsq(both[chosen].reshape(-1, 6), wanted[chosen].ravel(), rcond=1e-9)[0]
    return np.asarray(np.linalg.norm(wanted - both @ place, axis=1))


def _lines(lines: NDArray[np.int64]) -> str:
    """Lines in words: a range where the other seat's are not among them, else the first ones."""
    ordered = np.sort(lines)
    gaps = np.diff(ordered)
    if (gaps <= 2 * np.median(gaps)).all() and np.median(gaps) == 1:
        return f"lines {ordered[0]} to {ordered[-1]}"
    return f"lines {', '.join(map(str, ordered[:4]))}, ... ({ordered.size} of those judged)"


def _off_nominal(
    robot: Robot, rows: PoseRows, frames: Frames, points: Array
) -> tuple[Finding, ...]:
    """A finding about points (K, 3) [m] that are not those of the catalogue robot.

    Raises LogError if they are their mirror image.
    """
    limit, direct = _FITS * reach(robot), rigid_fit(frames, points).rms
    if direct <= limit:
        return ()
    mirror = rigid_fit(frames, points, mirrored=True).rms
    if mirror * _BETTER < direct and mirror < limit:
        raise LogError(
            f"{rows.file}: the measured points fit {robot.name} only as their mirror image "
            f"({mirror * 1e3:.3g} mm against {direct * 1e3:.3g} mm): the frame is left-handed. "
            "Is an axis missing its sign, or are two columns swapped? Correct the columns."
        )
    return rows.remark(
        "far from the nominal robot",
        f"the points lie {direct * 1e3:.3g} mm (rms) off the catalogue robot {robot.name}: another "
        "robot, another order of the joints, or angles of another kind?",
    )


def refuse_radians(
    robot: Robot, rows: PoseRows, reading: AngleReading, logged: Array, values: Array
) -> None:
    """Raises LogError if logged angles (N, J), read as degrees, are radians by all that shows.

    values : (N, M) [m, rad]. Their positions, if there are any, have to fit the robot better so.
    """
    largest, as_rad = float(np.abs(logged).max()), replace(reading, unit="rad")
    if reading == as_rad or largest > 2.0 * np.pi or not fits(robot, as_rad, logged):
        return
    if values.shape[1] >= 3:
        chosen = judged(len(values))
        degrees, radians = (
            rigid_fit(nominal_frames(robot, q[chosen]), values[chosen, :3]).rms
            for q in (reading.joints(robot, logged), as_rad.joints(robot, logged))
        )
    if values.shape[1] < 3 or radians < degrees:
        raise LogError(
            f"{rows.file}: no joint angle exceeds {largest:.4g}, so that as degrees the robot "
            "would hardly move. Radians? Write `unit: rad` under joints in poses.yaml."
        )


@dataclass(frozen=True, eq=False)
class Orientations:
    """Rotations of the nominal flange in the measuring frame, which positions tell."""

    expected: Array  # (K, 3, 3)
    chosen: NDArray[np.intp]  # (K,) their rows

    def error(self, convention: str, raw: Array, angle: float) -> float:
        """[rad] median turn of the target on the flange about its mean, which should not turn.

        raw : (N, 3 or 4) columns of measured rotations, angles in units of `angle` [rad].
        """
        measured = rotation(convention, raw[self.chosen], angle).as_matrix()
        on_flange = self.expected.transpose(0, 2, 1) @ measured
        mean = nearest_rotation(on_flange.mean(axis=0))
        cosine = 0.5 * (np.einsum("ij,nij->n", mean, on_flange) - 1.0)
        return float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def fitting(self, raw: Array) -> tuple[str, AngleUnit, float] | None:
        """Convention, unit and error [rad] with which rotations raw (N, 3 or 4) fit best.

        None if none fits.
        """
        errors = {
            (name, unit): self.error(name, raw, scale)
            for name in (_QUATERNIONS if raw.shape[1] == 4 else _CONVENTIONS)
            for unit, scale in RADIANS.items()
        }
        (name, unit), least = min(errors.items(), key=lambda item: item[1])
        return (name, unit, least) if least < _TURN_OFF else None


def orientations(robot: Robot, q: Array, points: Array) -> Orientations | None:
    """Expected rotations of the flange at q (N, J) [rad], by the measured points (N, 3) [m].

    None if the points are few, on a line, or not those of the robot.
    """
    chosen = judged(len(q))
    if chosen.size < FEWEST:
        return None
    frames = nominal_frames(robot, q[chosen])
    fit = rigid_fit(frames, points[chosen])
    if fit.rms > _FITS * reach(robot) or fit.width < 3.0 * fit.rms:
        return None
    return Orientations(fit.rotation @ frames.rotation().transpose(2, 0, 1), chosen)


def check_rotations(
    robot: Robot,
    rows: PoseRows,
    expected: Orientations | None,
    declared: ValueColumns,
    raw: Array,
    angle: float,
) -> tuple[Finding, ...]:
    """A finding if measured rotations do not turn as the flange does.

    raw : (N, 3 or 4) columns of the rotation, angles in units of `angle` [rad].

    Raises LogError if another convention or unit fits.
    """
    if expected is None or (off := expected.error(str(declared.rotation), raw, angle)) < _TURN_OFF:
        return ()
    fitting = expected.fitting(raw)
    if fitting is not None and fitting[2] < _TURN_FITS * off:
        name, unit, least = fitting
        how = f"rotation: {name}" + ("" if name.startswith("quat") else f", angle_unit: {unit}")
        raise LogError(
            f"{rows.file}: the rotations read as {declared.rotation} do not turn as the flange of "
            f"{robot.name} does ({np.rad2deg(off):.3g} deg off, median); with `{how}` they do "
            f"({np.rad2deg(least):.2g} deg). Write so under values in poses.yaml."
        )
    turn = f"{np.rad2deg(off):.3g} deg (median)"
    sentence = f"the rotations are {turn} off those of the flange of {robot.name}."
    return rows.remark("rotations off the nominal robot", sentence)


def check_lengths(
    rows: PoseRows, values: Array, instrument: Instrument, unit: str
) -> tuple[Finding, ...]:
    """A finding about lengths values (N, 1) [m] that the instrument cannot have measured.

    Raises LogError if they are in another unit.
    """
    middle = float(np.median(np.abs(values)))
    lower, upper = instrument.lower, max(instrument.upper, 1e-6)
    if middle > 10.0 * upper or middle < lower / 10.0:
        raise LogError(
            f"{rows.file}: lengths of {middle:.4g} m (median, read as {unit}); {instrument.name} "
            f"measures {lower:g} to {upper:g} m. {_other_unit(middle, instrument.nominal, unit)}"
        )
    outside = np.asarray(((values < lower) | (values > upper)).any(axis=1))
    sentence = f"outside the range of {instrument.name}, {lower:g} to {upper:g} m."
    return rows.remark("length outside the range", sentence, outside)


def _other_unit(measured: float, expected: float, unit: str) -> str:
    """Advice for lengths `measured` [m] that should be about `expected` [m]."""
    for name in get_args(LogLengthUnit):
        scale = measured / METRES[unit] * METRES[name]
        if name != unit and 0.2 < scale / max(expected, 1e-9) < 5.0:
            return f"In {name}? Write `unit: {name}` under values in poses.yaml."
    return "Correct the unit under values in poses.yaml, or name the columns that were measured."
