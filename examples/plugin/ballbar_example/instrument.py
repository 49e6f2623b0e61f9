"""A telecentric camera: it looks at a ball along its axis, and measures x and y across it."""

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.instruments.base import Instrument, Kind, Sight, TrueStand
from ballbar.cell.placement import Placement
from ballbar.cell.rigid_fit import nearest_rotation


class Telecentric(Kind):
    """Coordinates x and y [m] of the target in the seat's frame."""

    name = "telecentric"  # also that of the entry point
    chains = (("prismatic*", "prismatic*", "prismatic", "ball"),)
    noun = "camera readings"
    names, units = ("x", "y"), ("m", "m")
    directions = 2
    judged = "position across the camera's axis"
    seat_fixed = False  # the camera does not show where on its axis it is
    sighted = False

    def sight(self, values: Array, seat: Placement, predicted: Array) -> Sight:
        axes = seat.rotation[:, :2]
        seen = axes.T @ (predicted - seat.origin[:, None])
        across = np.repeat(axes.T[:, :, None], predicted.shape[1], axis=2)
        return Sight(predicted + axes @ (values.T - seen), across)

    def measure(self, stand: TrueStand, noise: Array, instrument: Instrument) -> Array:
        return (stand.rod[:2] + instrument.sigma_length * noise[:2]).T

    def sigma(self, values: Array, instrument: Instrument) -> Array:
        return np.full(values.shape, instrument.sigma_length)

    def seat_of(self, values: Array, points: Array) -> Placement:
        known = np.column_stack((points, np.ones(len(points))))
        x, y = np.linalg.lstsq(known, values, rcond=1e-6)[0].T
        rotation = nearest_rotation(np.stack((x[:3], y[:3], np.cross(x[:3], y[:3])), axis=1))
        return Placement(rotation, -rotation[:, :2] @ np.array((x[3], y[3])))


KIND = Telecentric()
