"""Fixtures of the project's tests: the wheel, built once for all of them."""

from __future__ import annotations

from tests.helpers.wheels import wheel

__all__ = ["wheel"]
