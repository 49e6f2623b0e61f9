"""Limits that a scenario states under `accept`, and how a run stands against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ballbar.cell.arrays import Array
from ballbar.cell.number_text import significant_text
from ballbar.ident.held_out import HeldOut
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import TcpError
from ballbar.ident.verdict import Status
from ballbar.result.compare import Comparison
from ballbar.scenario import AcceptSettings
from ballbar.sim.truth import PoseTruth, Truth
from ballbar.units import MM, PPM, UM, US

Measured = dict[str, tuple[str, float, str]]  # what, value and unit of each key of `accept`


@dataclass(frozen=True)
class Limit:
    """One limit of a scenario, and how the run stands against it."""

    what: str
    measured: float | str
    allowed: float | str
    unit: str
    met: bool

    @property
    def sizes(self) -> tuple[str, str]:
        """Measured and allowed value with their unit, for display."""
        measured, allowed = self.measured, self.allowed
        if isinstance(measured, float):
            measured = f"{measured:.0f}" if measured.is_integer() else significant_text(measured)
        if isinstance(allowed, float):
            allowed = f"{allowed:g}"
        return f"{measured} {self.unit}".strip(), f"{allowed} {self.unit}".strip()


def plant_limits(truth: Truth | PoseTruth, accept: AcceptSettings) -> tuple[Limit, ...]:
    """The limits of what was simulated: they need no identification. Still poses have none."""
    measured = {
        key: (what, truth.plant_sizes[key] * scale, unit)
        for key, what, scale, unit in (
            ("loop_closure_um", "loop closure of the plant, largest", UM, "um"),
            ("rod_force_N", "force in the rod, largest", 1.0, "N"),
        )
        if key in truth.plant_sizes
    }
    return _stated(measured, accept)


def result_limits(
    identified: Identification,
    comparison: Comparison,
    accept: AcceptSettings,
    held_out: Sequence[HeldOut] = (),
) -> tuple[Limit, ...]:
    """The limits of what was identified; held_out : results on accept.held_out_file."""
    measured: Measured = {
        **_tcp(comparison.tcp, identified.robot.tcp_sigma),
        "parameter_distance_mm_mrad": ("parameter distance", comparison.distance * MM, "mm|mrad"),
        "clock_offset_us": ("clock offset error", abs(comparison.offset or 0.0) * US, "us"),
        "clock_skew_ppm": ("clock skew error", abs(comparison.skew or 0.0) * PPM, "ppm"),
        "iterations": ("iterations", float(identified.fit.iterations), ""),
    }
    for outcome in held_out:
        what = "held-out residual over what noise and stated uncertainty explain"
        measured["held_out_ratio"] = (what, outcome.normalised_innovation, "")
    return (*_verdict(identified.verdict.status, accept), *_stated(measured, accept))


def tcp_limits(
    status: Status, sigma: Array, comparison: Comparison, accept: AcceptSettings
) -> tuple[Limit, ...]:
    """The limits that every scenario can state; sigma : (G,) [m] stated TCP uncertainty."""
    measured = _tcp(comparison.tcp, sigma)
    return (*_verdict(status, accept), *_stated(measured, accept))


def corrected_limits(distance: Array, accept: AcceptSettings) -> tuple[Limit, ...]:
    """The limits of corrected targets; distance : (N,) [m] of the tool from where it belongs."""
    mean, largest = float(distance.mean()), float(distance.max())
    measured: Measured = {
        "corrected_mean_mm": ("corrected targets in the plant, mean", mean * MM, "mm"),
        "corrected_max_mm": ("corrected targets in the plant, largest", largest * MM, "mm"),
    }
    return _stated(measured, accept)


def _tcp(error: TcpError, sigma: Array) -> Measured:
    stated = float(sigma.mean())
    return {
        "tcp_mean_mm": ("TCP error, mean", error.mean * MM, "mm"),
        "tcp_max_mm": ("TCP error, largest", error.maximum * MM, "mm"),
        "tcp_sigma_mm": ("stated TCP uncertainty with scale, mean", stated * MM, "mm"),
        "tcp_over_stated": ("TCP error over the stated, means", error.mean / stated, ""),
    }


def _verdict(status: Status, accept: AcceptSettings) -> tuple[Limit, ...]:
    if accept.verdict is None:
        return ()
    met = status.severity <= Status(accept.verdict).severity
    return (Limit("verdict", str(status), accept.verdict, "", met),)


def _stated(measured: Measured, accept: AcceptSettings) -> tuple[Limit, ...]:
    """A limit for each measured key that the scenario states."""
    stated = accept.model_dump(exclude_none=True)
    return tuple(
        Limit(what, value, float(stated[key]), unit, value <= stated[key])
        for key, (what, value, unit) in measured.items()
        if key in stated
    )
