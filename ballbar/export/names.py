"""Formats that an identified robot is exported in."""

from __future__ import annotations

from typing import Literal

Format = Literal["urdf", "mjcf", "dh", "mdh", "hayati", "poe", "abb", "ur-kinematics", "json"]
