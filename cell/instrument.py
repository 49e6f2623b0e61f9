"""Instruments: kinematic chains between the floor and a target on the robot's flange.

Each joint of a chain is revolute, prismatic, universal (two axes) or ball (three), and sensed or
not. What the sensed joints tell of the target is what the instrument measures: a telescoping
ball-bar or a draw-wire its distance, a laser tracker its position, a tracker with a 6-D target its
pose; a socket holds it at one point. The sensed double ball-bar, five revolute joints and a rod, is
described by its own class (ballbar.cell.descriptions.BallBar), for it is a mechanism with masses
too.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ballbar.cell.arrays import Array
from ballbar.cell.camera import NAMES, Camera, Lens, LensModel
from ballbar.cell.description_files import ExpansionFile, NominalAngle
from ballbar.cell.descriptions import BallBar, Link
from ballbar.cell.geometry import ROD_ROW
from ballbar.cell.instruments import kinds
from ballbar.cell.instruments.base import Instrument, Kind
from ballbar.cell.inverse import BAR_ALPHA
from ballbar.cell.schema import Line, NotNegative, Positive, Strict
from ballbar.cell.schema_errors import wrong_key

JointKind = Literal["revolute", "prismatic", "universal", "ball"]
# Standard deviations of the lens of a camera that was not calibrated: focal length, relative, and
# of its two values against each other; centre of the picture, of its width; distortion.
FOCAL, SQUARE, CENTRE = 0.2, 0.005, 0.03
DISTORTION: dict[LensModel, tuple[float, ...]] = {
    "brown": (0.3, 0.5, 0.01, 0.01, 0.5),
    "fisheye": (0.1, 0.1, 0.1, 0.1),
}
CALIBRATED = 0.1  # of those, where values but no deviations are stated
Pixels = Annotated[int, Field(ge=16, le=100000)]
_SHARED = ("lower_m", "upper_m", "sigma_m", "zero_sigma_m")  # by all sensed lengths of a chain


class JointFile(Strict):
    """One joint of a chain, from the floor to the tool."""

    joint: JointKind
    sensed: bool = Field(False, description="Whether the instrument reads this joint.")
    alpha_deg: NominalAngle = Field(0.0, description="Link twist behind a revolute joint.")
    nominal_m: NotNegative | None = Field(None, description="Nominal length of a prismatic joint.")
    lower_m: NotNegative | None = Field(None, description="Shortest length of a prismatic joint.")
    upper_m: Positive | None = Field(None, description="Longest length of a prismatic joint.")
    sigma_m: NotNegative = Field(0.0, description="Noise of a length; play of a socket.")
    zero_sigma_m: NotNegative = 0.0
    """Standard deviation of the length where the sensor reads the nominal one; 0 where it is
    calibrated, and taken as exact.
    """
    sigma_rad: NotNegative = Field(0.0, description="Noise of an angle.")


class DistanceFile(Strict):
    """Distance between the two seats of a fixture."""

    length_m: Positive
    sigma_m: Positive


class CameraFile(Strict):
    """A camera whose pictures of a board tell the board's pose."""

    image_px: tuple[Pixels, Pixels]
    """Width and height of its pictures."""
    field_of_view_deg: Annotated[float, Field(ge=5.0, le=170.0)] | None = None
    """Angle that a picture is wide, about: enough, for the pictures calibrate the lens."""
    lens: LensModel = "brown"
    """`brown`: pinhole with distortion k1, k2, p1, p2, k3; `fisheye` with k1 to k4."""
    lens_px: Annotated[tuple[float, ...], Field(min_length=4, max_length=9)] = ()
    """Calibration, as OpenCV has it: fx, fy, cx, cy [px], then the distortion."""
    lens_sigma_px: Annotated[tuple[Positive, ...], Field(max_length=9)] = ()
    """Their standard deviations; default a tenth of those of a camera without calibration."""
    sigma_px: Positive = 0.2
    """Noise of a corner along u and v, about: the pictures tell it."""

    @model_validator(mode="after")
    def _lens_is_stated(self) -> Self:
        expected = len(NAMES[self.lens])
        if not self.lens_px and self.field_of_view_deg is None:
            raise wrong_key("field_of_view_deg", message="missing; or give lens_px")
        for key in ("lens_px", "lens_sigma_px"):
            count = len(getattr(self, key))
            if count not in (0, expected) or (key == "lens_sigma_px" and count > len(self.lens_px)):
                raise wrong_key(key, message=f"expected {', '.join(NAMES[self.lens])}")
        return self


class InstrumentFile(Strict):
    """Description of an instrument, cell/instruments/*.yaml."""

    schema_: Annotated[Literal["ballbar-instrument/1"], Field(alias="schema")]
    title: Line
    chain: Annotated[tuple[JointFile, ...], Field(max_length=4)] = ()
    """Joints from the floor to the tool; that of a camera follows from its pictures."""
    camera: CameraFile | None = None
    distance: DistanceFile | None = None
    expansion: ExpansionFile | None = None
    """Thermal expansion of what it measures with, a rod, a wire or the fixture of `distance`: still
    poses are taken with lengths as they are at the temperature of the instrument.
    """
    mass_kg: NotNegative = 0.0
    """Mass of a rod from seat to target; the target carries half of its weight."""

    @model_validator(mode="after")
    def _chain_is_one_that_measures(self) -> Self:
        if self.camera is not None and not self.chain:
            return self
        if _kind_of(_joints(self)) is None:
            known = "; ".join(" ".join(c) for kind in kinds().values() for c in kind.chains)
            raise wrong_key(
                "chain",
                message=f"{' '.join(_joints(self))} is no chain that measures a target; those that "
                f"do are (sensed joints marked *): {known}",
            )
        for i, joint in enumerate(self.chain):
            if joint.joint == "prismatic" and None in (
                joint.nominal_m,
                joint.lower_m,
                joint.upper_m,
            ):
                message = "expected nominal_m, lower_m and upper_m of a prismatic joint"
                raise wrong_key("chain", i, message=message)
        return self

    @model_validator(mode="after")
    def _noise_of_sensed_joints(self) -> Self:
        first: JointFile | None = None  # sensed length
        for i, joint in enumerate(self.chain):
            key = "sigma_m" if joint.joint == "prismatic" else "sigma_rad"
            if joint.sensed and getattr(joint, key) == 0.0:
                message = (
                    f"{key} of this sensed {joint.joint} joint is 0 or missing; state the standard "
                    "deviation of what it reads"
                )
                raise wrong_key("chain", i, message=message)
            if not joint.sensed or joint.joint != "prismatic":
                continue
            first = first or joint
            for shared in _SHARED:
                if getattr(joint, shared) != getattr(first, shared):
                    message = (
                        f"{shared} differs from that of the first sensed length; one value serves "
                        "all of them, so give each the same"
                    )
                    raise wrong_key("chain", i, message=message)
        return self


def instrument_of(name: str, file: InstrumentFile) -> Instrument:
    """The instrument that a checked file describes; name : of that file."""
    if file.camera is not None and not file.chain:
        file = file.model_copy(update={"chain": _sight_of(camera_of(file.camera))})
    kind = _kind_of(_joints(file))
    assert kind is not None  # checked when the file was read
    sliding = [joint for joint in file.chain if joint.joint == "prismatic"]
    length = next((j for j in sliding if j.sensed), sliding[-1] if sliding else file.chain[0])
    turning = [j.sigma_rad for j in file.chain if j.joint == "revolute"]
    distance = file.distance
    return Instrument(
        name=name,
        title=file.title,
        kind=kind,
        nominal=length.nominal_m or 0.0,
        lower=length.lower_m or 0.0,
        upper=length.upper_m or 0.0,
        sigma_length=length.sigma_m,
        sigma_zero=length.zero_sigma_m,
        sigma_direction=max(turning, default=0.0),
        sigma_rotation=file.chain[-1].sigma_rad if kind.target_turns else 0.0,
        distance=None if distance is None else (distance.length_m, distance.sigma_m),
        mass=file.mass_kg,
        expansion=None if file.expansion is None else file.expansion.described(),
        camera=None if file.camera is None else camera_of(file.camera),
    )


def camera_of(file: CameraFile) -> Camera:
    """The camera of a checked file; its covariance is that of the lens before any picture."""
    width, height = file.image_px
    count = len(NAMES[file.lens])
    values = np.zeros(count)
    angle = np.deg2rad(file.field_of_view_deg or 60.0)
    wide = np.tan(0.5 * angle) if file.lens == "brown" else 0.5 * angle
    values[:4] = 0.5 * width / wide, 0.5 * width / wide, 0.5 * (width - 1), 0.5 * (height - 1)
    if file.lens_px:
        values[:] = file.lens_px
    sigma = np.concatenate(([0.0, 0.0], [CENTRE * width] * 2, DISTORTION[file.lens]))
    covariance = np.diag(sigma**2)
    focal = values[:2] * np.array([[FOCAL, 0.0], [FOCAL, SQUARE]]).T
    covariance[:2, :2] = focal.T @ focal
    if file.lens_px:
        covariance *= CALIBRATED**2
    if file.lens_sigma_px:
        covariance = np.diag(np.square(file.lens_sigma_px))
    return Camera(file.image_px, Lens(file.lens, values), covariance, file.sigma_px)


def _sight_of(camera: Camera) -> tuple[JointFile, ...]:
    """A chain with about the noise of a board of fifty corners that is a fifth of a picture wide,
    at a distance of 0.7 m.
    """
    focal, corners = float(camera.lens.values[0]), 50.0
    direction = camera.sigma / focal / np.sqrt(corners)
    size = 0.1 * camera.image[0] / focal  # half the board, as a tangent
    line: dict[str, JointKind | bool | float] = {"joint": "revolute", "sensed": True}
    depth = {"nominal_m": 0.7, "lower_m": 0.1, "upper_m": 3.0, "sigma_m": 0.7 * direction / size}
    parts = (
        line | {"alpha_deg": -90.0, "sigma_rad": direction},
        line | {"alpha_deg": 90.0, "sigma_rad": direction},
        line | {"joint": "prismatic"} | depth,
        line | {"joint": "ball", "sigma_rad": direction / size},
    )
    return tuple(JointFile.model_validate(part) for part in parts)


def telescoping_bar(instrument: Instrument) -> BallBar:
    """A length instrument as a ball-bar without encoders whose rod is sensed and alone has mass.

    Universal joint and ball are the five revolute joints of a ball-bar, in one point each; `bd3` is
    the length where the sensor reads the nominal one. Raises ValueError for another instrument.
    """
    if instrument.measured != "length":
        raise ValueError(f"instrument {instrument.name} measures a {instrument.measured}")
    zero: Array = np.zeros(5)
    rod = zero.copy()
    rod[ROD_ROW] = instrument.nominal
    middle = np.array([0.0, 0.0, 0.5 * instrument.nominal])
    body, rod_body = (Link(m, middle, np.zeros((3, 3))) for m in (0.0, instrument.mass))
    return BallBar(
        name=instrument.name,
        title=instrument.title,
        a=zero,
        d=rod,
        alpha=BAR_ALPHA,
        theta=zero,
        length_tolerance=instrument.sigma_zero,
        rod_stiffness=np.inf,
        joint_stiffness=(np.inf, np.inf),
        axial_damping=0.0,
        joint_damping=zero,
        friction_torque=0.0,
        joint_backlash=(0.0, 0.0),
        encoder_lines=1,
        encoder_bits=0,
        encoder_noise_sigma=0.0,
        links=(body, body, rod_body, body, body),
        stroke=(instrument.lower, instrument.upper),
    )


def _joints(file: InstrumentFile) -> tuple[str, ...]:
    return tuple(joint.joint + "*" * joint.sensed for joint in file.chain)


def _kind_of(joints: tuple[str, ...]) -> Kind | None:
    """The kind of instrument that has these joints; None where there is none."""
    return next((kind for kind in kinds().values() if joints in kind.chains), None)
