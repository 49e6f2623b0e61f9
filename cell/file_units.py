"""Units in which files state lengths and angles."""

from __future__ import annotations

from typing import Literal

import numpy as np

LengthUnit = Literal["m", "cm", "mm", "um", "inch"]
LogLengthUnit = Literal["m", "mm", "um"]  # of logs, whose unit a proposal has to tell apart
AngleUnit = Literal["rad", "deg"]
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 0.0254}  # of each LengthUnit
RADIANS: dict[AngleUnit, float] = {"rad": 1.0, "deg": np.pi / 180.0}
