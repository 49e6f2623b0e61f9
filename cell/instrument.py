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
from ballbar.cell.description_files import NominalAngle
from ballbar.cell.descriptions import BallBar, Link
from ballbar.cell.geometry import ROD_ROW
from ballbar.cell.instruments import kinds
from ballbar.cell.instruments.base import Instrument, Kind
from ballbar.cell.inverse import BAR_ALPHA
from ballbar.cell.schema import Line, NotNegative, Positive, Strict
from ballbar.cell.schema_errors import wrong_key

JointKind = Literal["revolute", "prismatic", "universal", "ball"]
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


class InstrumentFile(Strict):
    """Description of an instrument, cell/instruments/*.yaml."""

    schema_: Annotated[Literal["ballbar-instrument/1"], Field(alias="schema")]
    title: Line
    chain: Annotated[tuple[JointFile, ...], Field(min_length=1, max_length=4)]
    """Joints from the floor to the tool."""
    distance: DistanceFile | None = None
    mass_kg: NotNegative = 0.0
    """Mass of a rod from seat to target; the target carries half of its weight."""

    @model_validator(mode="after")
    def _chain_is_one_that_measures(self) -> Self:
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
    )


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
