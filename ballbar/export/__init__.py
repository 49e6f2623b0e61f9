"""The identified robot for other programs: models, tables, data of controllers, JSON."""

from __future__ import annotations

from typing import Literal

Format = Literal["urdf", "mjcf", "dh", "mdh", "hayati", "poe", "abb", "ur-kinematics", "json"]
