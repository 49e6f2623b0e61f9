"""An error source as the page has it, and its plot: a signal over another, of which runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from ballbar.cell.descriptions import Cell
from generators.scenario_reference import signals
from generators.scenario_reference.runs import Changes, merged
from generators.scenario_reference.signals import Signal

POINTS = 300  # of a line; a plot is 250 px wide inside


@dataclass(frozen=True)
class Plot:
    """A signal over another, for one or more variants of a source."""

    x: Signal
    y: Signal
    axes: tuple[str, str]
    on: Mapping[str, Changes]  # label of the line: what is switched on
    off: Changes = field(default_factory=dict)
    minus_off: bool = True  # whether the run without the source is subtracted
    show_off: str = ""  # its label, when it is drawn beside instead
    columns: tuple[str, ...] = ()  # labels of the columns of y
    window: tuple[float, float] = (1.0, 59.0)  # [s]
    counted: bool = False  # ball-bar angles in steps of the counters
    rows: bool = False  # x and y are rows of a log, not values at chosen times
    points: int = POINTS
    marks: bool = False  # dots instead of a line


@dataclass(frozen=True)
class Source:
    """A row of the page: one error source, beyond its settings."""

    key: str  # in the scenario, with dots
    model: str
    origin: str  # of the default; none where it is assumed
    plot: Plot
    # unit and sizes of the description files
    of_machine: tuple[str, Callable[[Cell], ArrayLike]] | None = None


XYZ = ("x", "y", "z")
KINEMATIC: Changes = {"plant": {"kind": "kinematic"}}
T, RESIDUAL_MM, RESIDUAL_UM = "t [s]", "tool, bar - robot [mm]", "tool, bar - robot [um]"


def error(name: str, /, **parameters: object) -> Changes:
    """One error source, with parameters of its own."""
    return {"errors": {name: parameters}}


def residual_plot(changes: Changes, *, off: Changes | None = None, um: bool = False) -> Plot:
    """Over time, the residual that a source leaves: [mm], or [um]."""
    label, signal = (RESIDUAL_UM, signals.residual_um) if um else (RESIDUAL_MM, signals.residual_mm)
    return Plot(signals.time, signal, (T, label), {"": changes}, off or {}, columns=XYZ)


def sensor_plot(joint: int, changes: Changes, *, x: str = "angle", **more: Any) -> Plot:
    """One ball-bar angle by the log, over the angle or over time."""
    signal, label = (
        (signals.true_bar_deg(joint), f"b{joint} [deg]") if x == "angle" else (signals.time, T)
    )
    return Plot(
        signal,
        signals.bar_angle(joint, 1e6),
        (label, f"b{joint}, change [urad]"),
        {"": merged(KINEMATIC, changes)},
        KINEMATIC,
        counted=True,
        **more,
    )


def clock_plot(changes: Mapping[str, Any], unit: str, scale: float, **more: Any) -> Plot:
    """Time that the robot's clock shows more than the ball-bar's, over time."""
    difference = signals.clock_difference(scale)
    return rows_plot(signals.bar_row_time, difference, f"t_robot - t_bar [{unit}]", changes, **more)


def rows_plot(x: Signal, y: Signal, label: str, changes: Mapping[str, Any], **more: Any) -> Plot:
    """One value of each row of a log, over time."""
    on = {"": merged(KINEMATIC, {"clocks": changes})}
    return Plot(x, y, (T, label), on, KINEMATIC, minus_off=False, rows=True, **more)


def gear_plot(on: Mapping[str, Changes], **more: Any) -> Plot:
    """Turn of gear 1 that the log does not show, over its angle by the log."""
    axes = ("axis 1 [deg]", "joint - log, change [urad]")
    return Plot(signals.logged_gear_deg(1), signals.behind_gear_urad(1), axes, on, **more)
