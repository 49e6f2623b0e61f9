"""Static errors of the true geometry: joints and links, axes and base of the ball-bar, plate.

Errors of several sources add up.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, ParameterTable, parameter_named, robot_frames
from ballbar.cell.schema import NotNegative, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.temperature import Temperatures, temperature_of
from ballbar.sim.streams import stream

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


class StaticErrors(Strict):
    """Deviations of the true geometry from the nominal one, from a table or drawn."""

    table: Literal["thesis_3_1"] | None = None
    """Deviations of thesis Table 3.1; none to draw them."""
    sigma_m: NotNegative | None = None
    """Sigma of drawn lengths."""
    sigma_rad: NotNegative | None = None
    """Sigma of drawn angles."""
    parameters: Literal["thesis", "robot", "all"] = "thesis"
    """Drawn are those of Table 3.1; also whatever else of the robot can be identified; or all of
    robot, ball-bar and base but the plate's length.
    """

    @model_validator(mode="after")
    def _table_or_sigmas(self) -> StaticErrors:
        drawn = self.sigma_m is not None and self.sigma_rad is not None
        if (self.table is None) != drawn:
            raise ValueError("give either table, or both sigma_m and sigma_rad")
        if self.table and self.parameters != "thesis":
            raise wrong_key(
                "parameters",
                message="Table 3.1 has its own; to draw others, give sigma_m and sigma_rad "
                "instead of table",
            )
        return self


class BallbarAxes(Strict):
    """The axes of gimbal and universal joint neither intersect nor are square
    (notes/plant, joints_mechanical).
    """

    sigma_m: NotNegative = 5.0e-6
    """Sigma of the intersection offsets."""
    sigma_rad: NotNegative = 5.0e-5
    """Sigma of the squareness errors."""
    parameters: Literal["between", "all"] = "between"
    """Drawn are those between the axes, or also those before the first and behind the last, which
    act as the base's height and the plate do.
    """


class BaseTilt(Strict):
    """The base of the ball-bar is not parallel to the robot's (notes/plant, base)."""

    sigma_rad: NotNegative = 1.0e-3
    """Sigma about each axis."""


class PlateLength(Strict):
    """The plate's length, which fixes the scale, deviates from its nominal value."""

    sigma_m: NotNegative | None = None
    """Sigma; by default the plate file's."""


class MotorOffsets(Strict):
    """The zeros of the robot's motors are off, as after a calibration by marks.
    Axis 1 has none: it is the base's.
    """

    sigma_rad: NotNegative = 0.05
    """Sigma at the motor; 0.4 to 1.1 mrad at a joint. Assumed."""


class CellErrors(Strict):
    """Error sources of the geometry of a cell; each is absent unless named."""

    static: StaticErrors | None = None
    ballbar_axes: BallbarAxes | None = None
    base_tilt: BaseTilt | None = None
    plate_length: PlateLength | None = None
    motor_offsets: MotorOffsets | None = None


def true_geometry(
    nominal: Geometry,
    errors: CellErrors,
    cell: Cell,
    *,
    seed: int,
    zero_sigma: float | None = None,
    turns: Array | None = None,
) -> Geometry:
    """The nominal geometry with its static errors.

    cell : nominal, for the sigma of its plate's length and its robot's transmission.
    zero_sigma : [m] of the zero of a sensed length; None for a ball-bar. Universal joint and ball
        of an instrument are points, so its rows have no other errors.
    turns : (J,) of the motors as in `resolver_effects`.
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
        length = cell.plate.length_sigma if plate.sigma_m is None else plate.sigma_m
        drawn.append(
            deviations((nominal.table.plate,), {True: length}, stream(seed, "plate_length"))
        )
    if errors.motor_offsets:
        z = stream(seed, "motor_offsets").standard_normal(cell.robot.joints)
        at_motors = errors.motor_offsets.sigma_rad * z / (1.0 if turns is None else turns)
        joints = at_motors @ cell.robot.transmission
        offsets = {f"rtheta{i + 1}": float(angle) for i, angle in enumerate(joints)}
        drawn.append({n: v for n, v in offsets.items() if n not in nominal.table.gauge})
    true = nominal
    for source in drawn:
        true = true.replaced({name: true[name] + value for name, value in source.items()})
    return true


def grown(true: Geometry, cell: Cell, stated: Temperatures) -> Geometry:
    """The geometry with the robot, plate and rod as long as they are at their temperatures.

    cell : nominal. Lengths whose file states no expansion stay as they are.
    """
    arm, instrument = (temperature_of([stated], robot=of_robot) for of_robot in (True, False))
    longer: dict[str, float] = {}
    if arm is not None and cell.robot.expansion is not None:
        share = arm.growth(cell.robot.expansion)[0]
        robot = [p.name for p in true.table.parameters if p.side == "robot" and p.is_length]
        longer = {name: share * true[name] for name in robot if name != true.table.plate}
    if instrument is not None and (plate := cell.plate).expansion is not None:
        longer[true.table.plate] = instrument.growth(plate.expansion)[0] * plate.length
    if instrument is not None and (bar := cell.ballbar).expansion is not None:
        longer["bd3"] = instrument.growth(bar.expansion)[0] * true["bd3"]
    return true.replaced({name: true[name] + value for name, value in longer.items()})


def set_without_strain(true: Geometry, q: Array) -> Geometry:
    """The geometry with the ball-bar's base moved along the rod so that the rod is not strained.

    q : (1, J) [rad] first target, at which the base is set with the robot at rest.
    """
    rod = robot_frames(true, q).tip[:, 0] - true.origin
    origin = true.origin + rod * (1.0 - true["bd3"] / np.linalg.norm(rod))
    return true.replaced({f"o{axis}": float(v) for axis, v in zip("xyz", origin, strict=True)})


def static_deviations(
    errors: StaticErrors, table: ParameterTable, rng: np.random.Generator
) -> dict[str, float]:
    """Deviation [m, rad] of each parameter, from thesis Table 3.1 or drawn."""
    if errors.table == "thesis_3_1":
        return {name: value * _MILLI for name, value in THESIS_3_1.items()}
    # Table 3.1 comes first, so that its parameters always get the same draws. The plate is the
    # known length: only errors.plate_length changes it.
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
