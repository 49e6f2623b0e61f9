"""Measured values of still poses in SI units, and their standard deviations."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from acquisition.report import Finding, finding
from acquisition.table.quantities import PoseRows
from cell.arrays import Array
from cell.errors import LogError
from cell.instrument import Instrument
from cell.pose_file import Sigma, ValueColumns

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}
RADIANS = {"rad": 1.0, "deg": np.pi / 180.0}
_STEP = 1e-5  # [rad] of the central difference; its error is of the order of 1e-10


def si_values(declared: ValueColumns, raw: Array, length: float, angle: float) -> Array:
    """(N, M) [m, rad] values of a group, M as in cell.poses.COLUMNS, of raw columns (N, K).

    length, angle : unit of the lengths [m] and angles [rad] among the raw columns.
    """
    if raw.shape[1] == 1:
        return raw * length + declared.offset_m
    values = position(declared, raw[:, :3], length, angle)
    if raw.shape[1] == 3:
        return values
    return np.hstack((values, rotation(str(declared.rotation), raw[:, 3:], angle).as_rotvec()))


def position(declared: ValueColumns, raw: Array, length: float, angle: float) -> Array:
    """(N, 3) [m] positions of raw columns (N, 3): x y z, or azimuth, elevation, distance."""
    if declared.spherical is None:
        return raw * length
    azimuth, elevation, distance = raw.T * np.array([[angle], [angle], [length]])
    distance = distance + declared.offset_m
    if declared.spherical == "zenith":
        elevation = 0.5 * np.pi - elevation
    across = distance * np.cos(elevation)
    directions = (across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation))
    return np.stack(directions, axis=1)


def rotation(convention: str, raw: Array, angle: float) -> Rotation:
    """Rotations of raw columns (N, 3) in units of `angle` [rad], or of quaternions (N, 4).

    convention : as in cell.pose_file.Rotation.
    """
    match convention:
        case "quat_wxyz":
            return Rotation.from_quat(raw[:, [1, 2, 3, 0]])
        case "quat_xyzw":
            return Rotation.from_quat(raw)
        case "rotvec":
            return Rotation.from_rotvec(raw * angle)
    return Rotation.from_euler(convention, raw * angle)


def refuse_quaternions(declared: ValueColumns, rows: PoseRows, raw: Array) -> None:
    """Raises LogError for a quaternion (N, 4) whose length is not 1."""
    if not str(declared.rotation).startswith("quat"):
        return
    norm = np.linalg.norm(raw, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > 0.01)
    if wrong.size:
        raise LogError(
            f"{rows.location(int(wrong[0]))}: the quaternion has length {norm[wrong[0]]:.4g}, "
            "expected 1. Name the four columns of the quaternion, in the order of "
            f"{declared.rotation}."
        )


def constant_sigma(sigma: Sigma, measured: str, count: int) -> Array:
    """(N, M) [m, rad] of declared constants; M is 3 for a socket.

    Raises ValueError if a pose has no sigma of its rotation.
    """
    width = {"length": 1, "point": 3, "pose": 3, "socket": 3}[measured]
    lengths = np.full((count, width), sigma.length_m)
    if measured != "pose":
        return lengths
    if sigma.rotation_rad is None:
        raise ValueError("sigma of a pose: give rotation_rad beside length_m")
    return np.hstack((lengths, np.full((count, 3), sigma.rotation_rad)))


def column_sigma(
    declared: ValueColumns, raw: Array, deviation: Array, length: float, angle: float
) -> Array:
    """(N, M) [m, rad] of the deviations (N, K) of raw columns (N, K), to first order.

    Those of a rotation are of small turns about the axes of the seat's frame.
    """
    if raw.shape[1] == 1:
        return deviation * length
    if declared.spherical is None:
        sigma = deviation[:, :3] * length
    else:
        units = np.array([angle, angle, length])
        variance = np.zeros((len(raw), 3))
        for k, unit in enumerate(units):
            step = np.zeros(3)
            step[k] = _STEP / unit
            upper = position(declared, raw[:, :3] + step, length, angle)
            lower = position(declared, raw[:, :3] - step, length, angle)
            slope = (upper - lower) / (2.0 * _STEP)
            variance += (slope * deviation[:, [k]] * unit) ** 2
        sigma = np.sqrt(variance)
    if raw.shape[1] == 3:
        return sigma
    angles, spread = raw[:, 3:] * angle, deviation[:, 3:] * angle
    variance = np.zeros((len(raw), 3))
    for k in range(3):
        step = np.zeros(3)
        step[k] = _STEP
        turned = rotation(str(declared.rotation), angles + step, 1.0)
        turn = turned * rotation(str(declared.rotation), angles - step, 1.0).inv()
        variance += (turn.as_rotvec() / (2.0 * _STEP) * spread[:, [k]]) ** 2
    return np.hstack((sigma, np.sqrt(variance)))


def with_sigma_of_instrument(
    rows: PoseRows, sigma: Array, instrument: Instrument, values: Array
) -> tuple[Array, tuple[Finding, ...]]:
    """Deviations (N, M) [m, rad] with those of the instrument in poses where one is 0.

    values : (N, M) [m, rad].
    Raises LogError for a negative one.
    """
    if (sigma < 0.0).any():
        row = int(np.argwhere(sigma < 0.0)[0][0])
        raise LogError(
            f"{rows.location(row)}: a standard deviation is negative. Name the columns of the "
            "deviations under sigma."
        )
    zero = (sigma == 0.0).any(axis=1)
    if not zero.any():
        return sigma, ()
    sentence = f"a standard deviation is 0; that of {instrument.name} is taken for the pose."
    entry = finding("sigma 0", "repaired", rows.file, sentence, lines=rows.line[zero])
    return np.where(zero[:, None], instrument.sigma(values), sigma), (entry,)
