"""Static errors of the true geometry: joints and links, axes and base of the ball-bar, plate.

Errors of several sources add up.
"""

from __future__ import annotations

import numpy as np

from cell.arrays import Array
from cell.geometry import Geometry, ParameterTable, parameter_named
from sim.settings import ErrorSettings, StaticErrors
from sim.streams import stream

# Thesis Table 3.1, in mm and mrad. Only parameters that every cost function can identify deviate.
THESIS_3_1 = {
    "ra1": -0.40, "ra2": 0.14, "ra3": -1.52, "ra4": -1.88, "ra5": 0.80,
    "rd2": 0.27, "rd4": -0.16, "rd5": 1.80, "rd6": -1.47,
    "ralpha1": 0.37, "ralpha2": 0.78, "ralpha3": -1.36, "ralpha4": 0.35, "ralpha5": 0.08,
    "rtheta2": -0.09, "rtheta3": 0.19, "rtheta4": -0.12, "rtheta5": 0.72, "rtheta6": -0.22,
    "bd3": 0.24, "btheta1": -0.74, "btheta2": 1.27, "btheta3": -1.90, "btheta4": -0.19,
    "btheta5": 0.98,
    "ox": 0.16, "oy": 0.80, "oz": -0.70,
}  # fmt: skip
# Offsets between the axes of the gimbal (b1, b2, b3) and of the universal joint (b3, b4, b5), and
# their squareness.
AXIS_OFFSETS = ("ba1", "ba2", "ba3", "ba4", "bd2", "bd4")
AXIS_ANGLES = ("balpha1", "balpha2", "balpha3", "balpha4")
# No axis follows row 5 and none precedes row 1: these act as the plate and as the base's height do.
AXIS_ENDS = ("ba5", "bd1", "bd5", "balpha5")
BASE_TILT = ("otx", "oty")
_MILLI = 1e-3  # mm and mrad of the table


def true_geometry(
    nominal: Geometry,
    errors: ErrorSettings,
    *,
    plate_sigma: float,
    transmission: Array,
    seed: int,
    zero_sigma: float | None = None,
) -> Geometry:
    """The nominal geometry with its static errors.

    plate_sigma : [m] standard deviation of the plate's length if the scenario states none.
    transmission : (J, J) of the robot, joints = motors @ transmission.
    zero_sigma : [m] of the zero of a sensed length; None for a ball-bar. Universal joint and ball
        of an instrument are points, so its rows have no other errors.
    """
    axes, tilt, plate = errors.ballbar_axes, errors.base_tilt, errors.plate_length
    drawn: list[dict[str, float]] = []
    if errors.static:
        static = static_deviations(errors.static, nominal.table, stream(seed, "static"))
        of_bar = zero_sigma is None
        existing = {n: v for n, v in static.items() if of_bar or parameter_named(n).side != "bar"}
        drawn.append(existing)
    if zero_sigma is not None:
        drawn.append(deviations(("bd3",), {True: zero_sigma}, stream(seed, "length_zero")))
    if axes:
        sigma = {True: axes.sigma_m, False: axes.sigma_rad}
        ends = AXIS_ENDS if axes.parameters == "all" else ()
        names = (*AXIS_OFFSETS, *AXIS_ANGLES, *ends)
        drawn.append(deviations(names, sigma, stream(seed, "ballbar_axes")))
    if tilt:
        drawn.append(deviations(BASE_TILT, {False: tilt.sigma_rad}, stream(seed, "base_tilt")))
    if plate:
        length = plate_sigma if plate.sigma_m is None else plate.sigma_m
        drawn.append(
            deviations((nominal.table.plate,), {True: length}, stream(seed, "plate_length"))
        )
    if errors.motor_offsets:
        z = stream(seed, "motor_offsets").standard_normal(len(transmission))
        joints = (errors.motor_offsets.sigma_rad * z) @ transmission
        offsets = {f"rtheta{i + 1}": float(angle) for i, angle in enumerate(joints)}
        drawn.append({n: v for n, v in offsets.items() if n not in nominal.table.gauge})
    true = nominal
    for source in drawn:
        true = true.replaced({name: true[name] + value for name, value in source.items()})
    return true


def static_deviations(
    errors: StaticErrors, table: ParameterTable, rng: np.random.Generator
) -> dict[str, float]:
    """Deviation [m, rad] of each parameter, from thesis Table 3.1 or drawn."""
    if errors.table == "thesis_3_1":
        return {name: value * _MILLI for name, value in THESIS_3_1.items()}
    # Table 3.1 comes first, so that its parameters are always drawn alike. The plate is the known
    # length: only errors.plate_length changes it.
    names = tuple(THESIS_3_1)
    others = tuple(name for name in table.names if name not in (*names, table.plate))
    if errors.parameters == "all":
        names += others
    elif errors.parameters == "robot":
        rows = (*table.robot, *table.hayati)
        names += tuple(name for name in others if name in rows and name not in table.gauge)
    return deviations(names, {True: errors.sigma_m or 0.0, False: errors.sigma_rad or 0.0}, rng)


def deviations(
    names: tuple[str, ...], sigma: dict[bool, float], rng: np.random.Generator
) -> dict[str, float]:
    """Normally distributed deviations [m, rad] of the named parameters.

    sigma : standard deviation of lengths [m] under the key True, of angles [rad] under False.
    """
    drawn = rng.standard_normal(len(names))
    return {
        name: float(z) * sigma[parameter_named(name).is_length]
        for name, z in zip(names, drawn, strict=True)
    }
