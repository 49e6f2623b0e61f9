"""Units and forms in which files state lengths, angles and rotations."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

LengthUnit = Literal["m", "cm", "mm", "um", "inch"]
LogLengthUnit = Literal["m", "mm", "um"]  # of logs, whose unit a proposal has to tell apart
AngleUnit = Literal["rad", "deg"]
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}  # of each LengthUnit
RADIANS: dict[AngleUnit, float] = {"rad": 1.0, "deg": np.pi / 180.0}
# Angles turned about moving axes (XYZ) or fixed ones (xyz), as scipy's Rotation.from_euler has it.
Rotation = Annotated[
    str,
    Field(
        pattern=r"^(rotvec|quat_wxyz|quat_xyzw"
        r"|XYZ|XZY|YXZ|YZX|ZXY|ZYX|XYX|XZX|YXY|YZY|ZXZ|ZYZ"
        r"|xyz|xzy|yxz|yzx|zxy|zyx|xyx|xzx|yxy|yzy|zxz|zyz)$"
    ),
]
