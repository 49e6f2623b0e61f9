"""Measured values of still poses in SI units, and their standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbar.acquisition.report import Finding
from ballbar.acquisition.table.quantities import PoseRows
from ballbar.cell.arrays import Array
from ballbar.cell.errors import LogError
from ballbar.cell.instruments.base import Instrument, Kind
from ballbar.cell.pose_file import Sigma, ValueColumns

_STEP = 1e-5  # [rad] of the central difference; its error is of the order of 1e-10


@dataclass(frozen=True)
class ValueConversion:
    """Meaning of raw columns of values, and units of the lengths and angles among them."""

    declared: ValueColumns
    kind: Kind
    length: float  # [m]
    angle: float  # [rad]

    @property
    def _units(self) -> Array:
        """(M,) [m, rad] of the values as the kind has them."""
        return np.array([self.length if unit == "m" else self.angle for unit in self.kind.units])

    def values(self, raw: Array) -> Array:
        """(N, M) [m, rad] values of raw columns (N, K), M as the kind's `columns`."""
        if raw.shape[1] < 3:
            return np.asarray(raw * self._units + self.declared.offset_m)
        values = self.position(raw[:, :3])
        if raw.shape[1] == 3:
            return values
        turns = rotation(str(self.declared.rotation), raw[:, 3:], self.angle)
        return np.hstack((values, turns.as_rotvec()))

    def position(self, raw: Array) -> Array:
        """(N, 3) [m] of raw columns (N, 3): x y z, or azimuth, elevation, distance."""
        if self.declared.spherical is None:
            return raw * self.length
        units = np.array([[self.angle], [self.angle], [self.length]])
        azimuth, elevation, distance = raw.T * units
        distance = distance + self.declared.offset_m
        if self.declared.spherical == "zenith":
            elevation = 0.5 * np.pi - elevation
        across, height = distance * np.cos(elevation), distance * np.sin(elevation)
        return np.stack((across * np.cos(azimuth), across * np.sin(azimuth), height), axis=1)

    def sigma(self, raw: Array, deviation: Array) -> Array:
        """(N, M) [m, rad] of the deviations (N, K) of raw columns (N, K), to first order.

        The deviations of a rotation are of small turns about the axes of the seat's frame.
        """
        if raw.shape[1] < 3:
            return np.asarray(deviation * self._units)
        sigma = self._position_sigma(raw[:, :3], deviation)
        if raw.shape[1] == 3:
            return sigma
        angles, spread = raw[:, 3:] * self.angle, deviation[:, 3:] * self.angle
        variance, convention = np.zeros((len(raw), 3)), str(self.declared.rotation)
        for k, step in enumerate(_STEP * np.eye(3)):
            ahead, behind = (rotation(convention, angles + s, 1.0) for s in (step, -step))
            turn = (ahead * behind.inv()).as_rotvec()
            variance += (turn / (2.0 * _STEP) * spread[:, [k]]) ** 2
        return np.hstack((sigma, np.sqrt(variance)))

    def _position_sigma(self, raw: Array, deviation: Array) -> Array:
        """(N, 3) [m] of the deviations (N, K) of a position's raw columns (N, 3)."""
        if self.declared.spherical is None:
            return deviation[:, :3] * self.length
        variance = np.zeros((len(raw), 3))
        for k, unit in enumerate((self.angle, self.angle, self.length)):
            step = _STEP / unit * np.eye(3)[k]
            change = (self.position(raw + step) - self.position(raw - step)) / (2.0 * _STEP)
            variance += (change * deviation[:, [k]] * unit) ** 2
        return np.sqrt(variance)


def rotation(convention: str, raw: Array, angle: float) -> Rotation:
    """Rotations of raw columns (N, 3) in units of `angle` [rad], or of quaternions (N, 4).

    convention : as in ballbar.cell.file_units.Rotation.
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
    """Raises LogError for a quaternion, among values (N, 7), whose length is not 1."""
    norm = np.linalg.norm(raw[:, 3:], axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > 0.01)
    if declared.quaternions and wrong.size:
        what = f"the quaternion has length {norm[wrong[0]]:.4g}, expected 1."
        remedy = f"Name its four columns, in the order of {declared.rotation}."
        raise LogError.at(rows.location(wrong[0]), what, remedy)


def constant_sigma(sigma: Sigma, instrument: Instrument, count: int) -> Array:
    """(N, M) [m, rad] of declared constants; M is 3 for a socket."""
    lengths = np.full((count, instrument.kind.directions), sigma.length_m)
    if not instrument.kind.target_turns:
        return lengths
    return np.hstack((lengths, np.full((count, 3), sigma.rotation_rad)))


def with_sigma_of_instrument(
    rows: PoseRows, sigma: Array, instrument: Instrument, values: Array
) -> tuple[Array, tuple[Finding, ...]]:
    """Deviations (N, M) [m, rad] with those of the instrument in poses where one is 0.

    values : (N, M) [m, rad].
    Raises LogError for a negative one.
    """
    if (sigma < 0.0).any():
        row = np.argwhere(sigma < 0.0)[0][0]
        remedy = "Name the columns of the deviations under sigma."
        raise LogError.at(rows.location(row), "a standard deviation is negative.", remedy)
    zero = (sigma == 0.0).any(axis=1)
    sentence = f"a standard deviation is 0; that of {instrument.name} is taken for the pose."
    stated = np.where(zero[:, None], instrument.sigma(values), sigma)
    return stated, rows.remark("sigma 0", sentence, zero)
