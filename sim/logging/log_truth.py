"""True errors of sensors, clocks and loggers of a simulated recording, as they were drawn."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from cell.schema import Strict
from sim.errors.clock_errors import ClockStep, LoggerRestart
from sim.errors.sensor_effects import EncoderEffects, ResolverEffects
from sim.errors.wander import WanderCurve
from sim.logging.load_logs import DrawnLoads
from sim.logging.loggers import RowCounts
from sim.logging.tracker import TrackerTruth


class FirstRows(Strict):
    """Times of the first rows of both logs, from the start of the path."""

    robot_s: float
    ballbar_s: float


class LogTruth(Strict):
    """Errors of sensors, clocks and loggers.

    Angles are positive along the DH angle of the joint; times count from the start of the path.
    """

    first_rows: FirstRows
    encoders: dict[str, EncoderEffects] = Field(default_factory=dict)  # of b1.., if any
    resolvers: ResolverEffects | None = None
    # [s] time constant of each motor's filter; that of the first is in the clock offset
    joint_lag_s: tuple[float, ...] = ()
    clock_wander: WanderCurve | None = None  # of the ball-bar's clock
    robot_clock_wander: WanderCurve | None = None
    clock_step: ClockStep | None = None
    restart: LoggerRestart | None = None
    rows: dict[str, RowCounts] = Field(default_factory=dict)  # robot, ballbar
    loads: DrawnLoads = DrawnLoads()
    tracker: TrackerTruth | None = None

    def stated(self) -> dict[str, object]:
        """Plain data without absent entries."""
        filled = {
            key: _filled(value) for key, value in self.model_dump(mode="json").items() if value
        }
        return {key: value for key, value in filled.items() if value}


def _filled(value: Any) -> Any:
    """Plain data without empty entries, at any depth."""
    if isinstance(value, dict):
        return {key: _filled(inner) for key, inner in value.items() if inner not in (None, [], {})}
    return [_filled(inner) for inner in value] if isinstance(value, list) else value
