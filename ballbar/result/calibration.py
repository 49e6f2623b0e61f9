"""calibration.yaml: what one identification leaves behind (schema `ballbar-calibration/1`), SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from cell.descriptions import Cell
from cell.files import write_yaml
from cell.geometry import NAMES, Geometry
from cell.strict_yaml import load_model
from ident.estimator.unknowns import PLACE
from ident.held_out import HeldOut, LoopClosure
from ident.identify import CoefficientValue, CorrectionValue, Identification, unloaded_robot
from ident.robot.unloaded_robot import UnloadedRobot
from ident.signals.step_fault import StepFault

CALIBRATION = "calibration.yaml"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ParameterEntry(_Strict):
    """One kinematic parameter; lengths in m, angles in rad."""

    nominal: float
    value: float
    sigma: float | None = None
    identified: bool


class ClockEntry(_Strict):
    """t_robot = offset_s + (1 + skew) * t_bar."""

    offset_s: float
    offset_sigma_s: float
    skew: float
    skew_sigma: float


class NoiseEntry(_Strict):
    """Standard deviations of one logged row, and of the rod's length."""

    joint_rad: tuple[float, ...]
    encoder_rad: dict[str, float]
    rod_m: float


class CoefficientEntry(_Strict):
    """One coefficient of a correction, SI units."""

    value: float
    sigma: float
    prior: float
    prior_sigma: float
    information_gain: float  # 0 to 1: how much of the knowledge is the data's and not the prior's
    unit: str


class StepFaultEntry(_Strict):
    """A jump of an encoder or a clock that was found and repaired."""

    kind: Literal["encoder", "clock"]
    joint: int
    time_s: float
    size: float  # [rad] or [s]
    periods: int


class PlaceEntry(_Strict):
    """Where the ball-bar's base stands [m] and leans [rad], robot base frame."""

    ox: float
    oy: float
    oz: float
    otx: float
    oty: float


class RecordingEntry(_Strict):
    """What one of several recordings has of its own."""

    recording: str  # name of its folder
    clock: ClockEntry | None = None
    zeros_rad: dict[str, float]
    place: PlaceEntry
    samples: int
    residuals: int
    chi2: float  # sum of squares of the whitened residuals
    tension_source: str
    events: tuple[StepFaultEntry, ...]


class ClosureEntry(_Strict):
    """How far robot and ball-bar disagree about the tool."""

    position_rms_m: float
    position_max_m: float
    angle_rms_rad: float
    ratio: float  # residual over what noise explains


class HeldOutEntry(_Strict):
    """A recording that took no part in the identification."""

    recording: str  # name of its folder
    sentence: str
    acceptable: bool
    samples: int
    identified: ClosureEntry
    ratio_with_uncertainty: float  # residual over what noise and the stated uncertainty explain
    nominal: ClosureEntry
    events: tuple[StepFaultEntry, ...]


class FitEntry(_Strict):
    """How the fit went."""

    status: str
    sentence: str
    warnings: tuple[str, ...]
    iterations: int
    samples: int
    chi2_per_dof: float
    autocorrelation: float
    rank: int
    condition: float
    tcp_sigma_mean_m: float


class DroppedEntry(_Strict):
    """A parameter left at its nominal value, and why."""

    name: str
    reason: str
    on: tuple[str, ...] = ()


class CalibrationFile(_Strict):
    """Schema of calibration.yaml."""

    schema_: Annotated[Literal["ballbar-calibration/1"], Field(alias="schema")]
    robot: str
    ballbar: str
    plate: str
    cost: Literal["ml"]
    parameters: dict[str, ParameterEntry]
    dropped: tuple[DroppedEntry, ...] = ()
    directions: dict[str, Literal[-1, 1]]
    clock: ClockEntry | None = None
    corrections: dict[str, dict[str, CoefficientEntry]] = {}
    tension_source: str = ""
    events: tuple[StepFaultEntry, ...] = ()
    noise: NoiseEntry
    fit: FitEntry
    recordings: tuple[
        RecordingEntry, ...
    ] = ()  # of a joint fit; clock, zeros and place above are those of the first
    held_out: tuple[HeldOutEntry, ...] = ()


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibration as read back."""

    file: CalibrationFile
    geometry: Geometry
    nominal: Geometry

    def unloaded_robot(self, cell: Cell) -> UnloadedRobot:
        """The identified robot without ball-bar; cell : as the file names it."""
        corrections = tuple(
            CorrectionValue(
                name,
                "",
                tuple(
                    CoefficientValue(
                        key, c.unit, c.value, c.sigma, c.prior, c.prior_sigma, c.information_gain
                    )
                    for key, c in entries.items()
                ),
            )
            for name, entries in self.file.corrections.items()
        )
        return unloaded_robot(
            cell, self.geometry, tuple(int(name[1]) for name in self.file.directions), corrections
        )


def write_calibration(
    path: Path,
    result: Identification,
    *,
    robot: str,
    ballbar: str,
    plate: str,
    recordings: Sequence[tuple[str, Identification]] = (),
    held_out: Sequence[HeldOut] = (),
) -> None:
    """Writes calibration.yaml, whole or not at all.

    robot, ballbar, plate : as the recording names them. recordings : all of a joint fit with their names, `result` among them; empty
    for a single one. held_out : recordings that the result was tried on.
    """
    data: dict[str, object] = {
        "schema": "ballbar-calibration/1",
        "robot": robot,
        "ballbar": ballbar,
        "plate": plate,
        "cost": "ml",
        "parameters": {name: _parameter(result, name) for name in NAMES},
        "dropped": [
            {"name": d.name, "reason": d.reason, "on": list(d.on)}
            for d in result.identifiability.dropped
        ],
        "directions": {
            f"b{joint}": sense for joint, sense in zip(result.joints, result.signs, strict=True)
        },
        "clock": _clock(result),
        "corrections": {
            c.name: {v.name: _coefficient(v) for v in c.coefficients} for c in result.corrections
        },
        "tension_source": result.tension_source,
        "events": _events(result.events),
        "noise": {
            "joint_rad": [float(s) for s in result.log_noise.joint],
            "encoder_rad": {f"b{j}": float(result.log_noise.encoder[j - 1]) for j in result.joints},
            "rod_m": float(result.noise.rod),
        },
        "fit": {
            "status": result.verdict.status,
            "sentence": result.verdict.sentence,
            "warnings": list(result.verdict.warnings),
            "iterations": result.iterations,
            "samples": int(result.after.t.size),
            "chi2_per_dof": result.chi2_per_dof,
            "autocorrelation": result.autocorrelation,
            "rank": result.identifiability.rank,
            "condition": result.identifiability.condition,
            "tcp_sigma_mean_m": float(result.tcp_sigma.mean()),
        },
    }
    if recordings:
        data["recordings"] = [_recording(name, one) for name, one in recordings]
    if held_out:
        data["held_out"] = [_held_out(one) for one in held_out]
    write_yaml(path, data)


def _clock(result: Identification) -> dict[str, object] | None:
    if result.clock is None:
        return None
    offset_sigma, skew_sigma = result.clock_sigma
    return {
        "offset_s": result.clock.offset,
        "offset_sigma_s": offset_sigma,
        "skew": result.clock.skew,
        "skew_sigma": skew_sigma,
    }


def _events(events: Sequence[StepFault]) -> list[dict[str, object]]:
    return [
        {"kind": e.kind, "joint": e.joint, "time_s": e.time, "size": e.size, "periods": e.periods}
        for e in events
    ]


def _recording(name: str, result: Identification) -> dict[str, object]:
    return {
        "recording": name,
        "clock": _clock(result),
        "zeros_rad": {f"b{j}": result.geometry[f"btheta{j}"] for j in result.joints},
        "place": {name: result.geometry[name] for name in PLACE},
        "samples": int(result.after.t.size),
        "residuals": int(result.whitened.size),
        "chi2": float((result.whitened**2).sum()),
        "tension_source": result.tension_source,
        "events": _events(result.events),
    }


def _held_out(one: HeldOut) -> dict[str, object]:
    return {
        "recording": one.name,
        "sentence": one.sentence,
        "acceptable": one.acceptable,
        "samples": one.samples,
        "identified": _closure(one.identified),
        "ratio_with_uncertainty": one.normalised_innovation,
        "nominal": _closure(one.nominal),
        "events": _events(one.events),
    }


def _closure(one: LoopClosure) -> dict[str, object]:
    return {
        "position_rms_m": one.position_rms,
        "position_max_m": one.position_max,
        "angle_rms_rad": one.angle_rms,
        "ratio": one.ratio,
    }


def _parameter(result: Identification, name: str) -> dict[str, object]:
    entry: dict[str, object] = {"nominal": result.nominal[name], "value": result.geometry[name]}
    if name in result.sigma:
        entry["sigma"] = result.sigma[name]
    return entry | {"identified": name in result.sigma}


def _coefficient(value: CoefficientValue) -> dict[str, object]:
    stated = {
        "value": value.value,
        "sigma": value.sigma,
        "prior": value.prior,
        "prior_sigma": value.prior_sigma,
        "information_gain": value.information_gain,
    }
    return {**stated, "unit": value.unit}


def calibration_file(path: Path) -> Path:
    """The file itself, or the one in a folder that `run` or `identify` wrote."""
    return path / CALIBRATION if path.is_dir() else path


def load_calibration(path: Path) -> Calibration:
    """Reads calibration.yaml. Raises DescriptionError naming file, line and key."""
    file = load_model(path, CalibrationFile)
    value = np.array([file.parameters[name].value for name in NAMES])
    nominal = np.array([file.parameters[name].nominal for name in NAMES])
    return Calibration(file, Geometry(value), Geometry(nominal))
