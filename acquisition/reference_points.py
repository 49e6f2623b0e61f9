"""Poses in the mean frame of their seat, whose motion reference points show.

All rows of a seat, of whichever file, define it together; points are numbered in the order of
their columns. Equal readings in successive rows, as for several targets at one pose, are one
measurement of the points. A row without any has its frame from the measurements around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_rows import FilePoses
from ballbar.acquisition.reference_fit import Knock, ReferenceFit, fit_with_knocks
from ballbar.acquisition.report import Finding, finding
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError

_FEWEST = 3  # points, and measurements of each
_FAR = 0.02  # [m] further than an instrument drifts or is jolted
_WIDTH = 0.02  # of the length of the points: width across it, below which they are on a line
_RIGID = 20.0  # times the declared sigma: points that scatter further are no fixed points
_SCATTER = 2.0  # times the declared sigma: reported
_DISTURBED = 8.0  # deviations of a reading of which a quarter of the weight is left


def steadied(files: Sequence[FilePoses]) -> list[FilePoses]:
    """The poses of files, in the mean frame of each seat that has reference points.

    Raises LogError for points that do not show how a seat moved.
    """
    out = list(files)
    labels = (label for poses in files if poses.reference.shape[1] for label in poses.seat)
    for name in dict.fromkeys(labels):
        seat = _seat(name, files)
        _refuse_unfit(seat)
        fit, knocks = fit_with_knocks(seat.readings, seat.sigma, seat.elapsed)
        if fit.scale > _RIGID:
            what = f"the reference points of seat {name} scatter by {_scatter(seat, fit)}."
            remedy = "Name x y z of each, in the same order in every table, or correct sigma_m."
            raise LogError.at(seat.lines[0][0], what, remedy)
        points = np.array([files[k].group.values[i, :3] for k, i in seat.rows])
        added = fit.sigma(points, seat.measurement)
        findings = _findings(seat, fit, knocks, points, added)
        numbers = np.array(seat.rows)
        for k in np.unique(numbers[:, 0]).tolist():
            own = np.flatnonzero(numbers[:, 0] == k)
            entries = tuple(e for e in findings if e.file == files[k].group.file)
            moved = _corrected(out[k], numbers[own, 1], fit, seat.measurement[own])
            out[k] = replace(moved, findings=(*moved.findings, *entries))
    return out


def _corrected(
    poses: FilePoses, rows: NDArray[np.intp], fit: ReferenceFit, at: NDArray[np.intp]
) -> FilePoses:
    """The poses with some rows (N,) in the mean frame of their seat; at : (N,) measurements."""
    values, sigma = poses.group.values.copy(), poses.group.sigma.copy()
    width = values.shape[1]
    sigma[rows] = np.hypot(sigma[rows], fit.sigma(values[rows, :3], at)[:, :width])
    values[rows, :3] = fit.steady(values[rows, :3], at)
    if width == 6:
        back = Rotation.from_matrix(fit.rotation(at)).inv()
        values[rows, 3:] = (back * Rotation.from_rotvec(values[rows, 3:])).as_rotvec()
    return replace(poses, group=replace(poses.group, values=values, sigma=sigma))


@dataclass(frozen=True, eq=False)
class _Seat:
    """The N rows of a seat in the order of time, and E measurements of K reference points."""

    name: str
    lines: tuple[tuple[str, int], ...]  # (N,) file and line of each row
    rows: tuple[tuple[int, int], ...]  # (N,) number of the file, and place among its rows
    measurement: NDArray[np.intp]  # (N,) of each row
    first: NDArray[np.intp]  # (E,) row of each measurement
    numbers: NDArray[np.intp]  # (K,) of the points in the order of their columns, from 1
    readings: Array  # (E, K, 3) [m]; NaN where a point was not read
    sigma: Array  # (E, K) [m] of a coordinate
    elapsed: Array  # (E - 1,) time between measurements, above 0, in any unit


def _seat(name: str, files: Sequence[FilePoses]) -> _Seat:
    """Raises LogError for points that differ from file to file, or are too few."""
    rows = [
        (k, i)
        for k, poses in enumerate(files)
        if poses.group.values.shape[1] >= 3
        for i in np.flatnonzero(np.array(poses.seat) == name).tolist()
    ]
    counts = {files[k].reference.shape[1]: files[k].group.file for k, _ in rows}
    counts.pop(0, None)
    (count, file), *others = counts.items()
    if others:
        raise LogError(
            f"{others[0][1]}: seat {name} has {others[0][0]} reference points, in {file} {count}. "
            "Name the same points in the same order, or give the seat another name."
        )
    stamps = [files[k].stamps for k, _ in rows]
    timed = (each[i] for each, (_, i) in zip(stamps, rows, strict=True) if each is not None)
    time = np.fromiter(timed, dtype=np.int64)
    if len(time) < len(rows):
        time = np.arange(len(rows))
    order = np.argsort(time, kind="stable")
    rows, time = [rows[n] for n in order], time[order]
    readings, sigma = np.full((len(rows), count, 3), np.nan), np.ones((len(rows), count))
    for n, (k, i) in enumerate(rows):
        if files[k].reference.shape[1]:
            readings[n], sigma[n] = files[k].reference[i], files[k].reference_sigma[i]
    new = np.ones(len(rows), dtype=bool)
    empty = np.isnan(readings)
    equal = (readings[1:] == readings[:-1]) | (empty[1:] & empty[:-1])
    new[1:] = ~equal.all(axis=(1, 2)) | empty[1:].all(axis=(1, 2))
    first = np.flatnonzero(new)
    often = np.flatnonzero((~empty[first].any(axis=2)).sum(axis=0) >= _FEWEST)
    if often.size < _FEWEST:
        what = f"of {count} reference points of seat {name} {often.size} are read {_FEWEST} times."
        remedy = f"{_FEWEST} points are needed. Correct the columns, or leave reference out."
        raise LogError.at(file, what, remedy)
    elapsed = np.diff(time[first]).astype(float)
    floor = 1e-3 * elapsed.mean() or 1.0
    return _Seat(
        name=name,
        lines=tuple((files[k].group.file, int(files[k].group.rows[i])) for k, i in rows),
        rows=tuple(rows),
        measurement=np.cumsum(new) - 1,
        first=first,
        numbers=often + 1,
        readings=readings[np.ix_(first, often)],
        sigma=sigma[np.ix_(first, often)],
        elapsed=np.maximum(elapsed, floor),
    )


def _refuse_unfit(seat: _Seat) -> None:
    """Raises LogError for points on a line, and where all of them lie elsewhere than mostly."""
    middle = np.nanmedian(seat.readings, axis=0)
    length, width, _ = np.linalg.svd(middle - middle.mean(axis=0))[1] / np.sqrt(len(middle))
    if width < _WIDTH * length:
        what = f"the reference points of seat {seat.name} lie on a line: {width * 1e3:.2g} mm rms."
        remedy = "They do not show a turn about it: put up another one, or correct the columns."
        raise LogError.at(seat.lines[0][0], what, remedy)
    away = np.linalg.norm(seat.readings - middle, axis=2)
    away[(~np.isnan(away)).sum(axis=1) < _FEWEST] = np.nan
    least = np.fmin.reduce(away, axis=1)
    far = np.flatnonzero(least > _FAR)
    if far.size:
        file, line = seat.lines[seat.first[far[0]]]
        what = f"the reference points lie {least[far[0]] * 1e3:.4g} mm from where they mostly are."
        remedy = f"Name them in one order, and give each set-up of {seat.name} a seat of its own."
        raise LogError.at(f"{file}:{line}", what, remedy)


def _scatter(seat: _Seat, fit: ReferenceFit) -> str:
    declared = float(np.nanmedian(seat.sigma)) * 1e3
    return f"{fit.scale * declared:.3g} mm, declared {declared:.3g} mm"


def _findings(
    seat: _Seat, fit: ReferenceFit, knocks: Sequence[Knock], points: Array, added: Array
) -> tuple[Finding, ...]:
    """How far the seat moved, and what of its reference points is not as it should be.

    points : (N, 3) [m] measured. added : (N, 6) [m, rad] standard deviation of their correction.
    """
    file, _ = seat.lines[0]
    at = seat.measurement
    read = np.isfinite(fit.length).any(axis=1)
    shift, turn = (  # [mm, mrad] largest distance from the first one
        float(np.linalg.norm(motion - motion[0], axis=1).max()) * 1e3
        for motion in (points - fit.steady(points, at), fit.motion[at, 3:])
    )
    sentence = (
        f"seat {seat.name} moved by up to {shift:.3f} mm (targets) and {turn:.3f} mrad against "
        f"{len(seat.numbers)} reference points, read in {int(read.sum())} measurements, which "
        f"scatter by {_scatter(seat, fit)}; corrected, to "
        f"{float(np.median(np.linalg.norm(added[:, :3], axis=1))) * 1e3:.2g} mm."
    )
    findings = [finding("moving seat", file, sentence, count=1)]
    if fit.scale > _SCATTER:
        sentence = (
            f"of seat {seat.name} they scatter about a rigid motion by {_scatter(seat, fit)}."
        )
        findings.append(finding("loose reference points", file, sentence, count=1))
    for knock in knocks:
        own, line = seat.lines[seat.first[knock.measurement]]
        sentence = (
            f"point {seat.numbers[knock.point]} of seat {seat.name} moved by "
            f"{knock.size * 1e3:.3f} mm against the others; from here on it is another point."
        )
        findings.append(finding("reference point moved", own, sentence, lines=[line]))
    disturbed = np.flatnonzero((fit.length > _DISTURBED).any(axis=1))
    for own in dict.fromkeys(seat.lines[seat.first[e]][0] for e in disturbed):
        lines = [line for f, line in (seat.lines[seat.first[e]] for e in disturbed) if f == own]
        sentence = f"a point of seat {seat.name} lies off the others; it hardly counts there."
        findings.append(finding("disturbed reference point", own, sentence, lines=lines))
    return tuple(findings)
