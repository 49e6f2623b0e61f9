"""The content of calibration.yaml, and the file that is read back before it takes its name.

Where the reader of results refuses it, it is kept whole under another name, so what was fitted is
not lost to a check of the program's own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, TypeVar, cast, get_args

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import same_contents
from ballbar.cell.errors import InputError
from ballbar.cell.files import copied_description, write_yaml
from ballbar.cell.rotation import rotvec_from_matrix
from ballbar.cell.schema import Strict
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.estimator.priors import belongs_to_recording, shared_names
from ballbar.ident.result import RecordingEstimate, RobotEstimate
from ballbar.ident.table_estimate import PlacementEstimate, TableEstimate
from ballbar.ident.verdict import Verdict
from ballbar.result.budget_entries import BudgetEntry
from ballbar.result.calibration import Calibration, load
from ballbar.result.calibration_schema import SCHEMA, CalibrationFile
from ballbar.result.machine_entries import (
    CoefficientEntry,
    DroppedEntry,
    From,
    MassesEntry,
    ParameterEntry,
    RangeEntry,
    covariance_entry,
)
from ballbar.result.recording_entries import (
    ClockEntry,
    CrossValidationEntry,
    Direction,
    FitEntry,
    GroupEntry,
    HeldOutEntry,
    NoiseEntry,
    OrderEntry,
    PlacementEntry,
    PoseHeldOutEntry,
    RecordingEntry,
    ResidualEntry,
    camera_entries,
)
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.result.temperature_entries import growth_entries, temperature_entry

_UNIT = re.compile(r"_(?:m|rad|s)$")
E = TypeVar("E", bound=Strict)


class RefusedResultError(RuntimeError):
    """A result that was fitted and written, and that the reader of results refuses.

    It is a fault of the program: one of fit, writer and reader is wrong.
    """


def calibration_of(data: RunData) -> CalibrationFile:
    """The content of calibration.yaml, which is checked once it is written."""
    result, robot, poses = data.identification, data.identification.robot, data.identification.poses
    own = _of_recordings(data) if data.recordings else _of_still_poses(data)
    return CalibrationFile.model_construct(
        schema_=SCHEMA,
        model=result.model,
        corrections={
            correction.name: {c.name: _entry(CoefficientEntry, c) for c in correction.coefficients}
            for correction in robot.corrections
        },
        ranges=_ranges(robot.identified.lower, robot.identified.upper),
        recordings=(
            *(_recording(fitted) for fitted in data.recordings),
            *([] if poses is None else _groups(poses)),
        ),
        seats={} if poses is None else _placements(poses.seats),
        targets={} if poses is None else _placements(poses.targets),
        measured_on=_last_day(data),
        temperature=temperature_entry(data),
        cameras={} if poses is None else camera_entries(poses.cameras),
        uncertainty_budget=_content(BudgetEntry, result.budget),
        **own,
    )


def _last_day(data: RunData) -> str | None:
    """The last day on which something of a result was measured; None where nothing says it."""
    recordings = [r.recording for r in data.recordings]
    days = {r.description.measured_on or r.report.day for r in recordings}
    days |= {table.description.measured_on or table.report.day for _, table in data.tables}
    return max(days - {""}, default=None)


def _of_recordings(data: RunData) -> dict[str, Any]:
    """The parts of a result that recordings have, alone or together with still poses."""
    result, description = data.identification, data.recordings[0].recording.description
    robot, fit = result.robot, result.fit
    return {
        "robot": description.robot,
        "instrument": description.measured_by,
        "plate": description.plate,
        "parameters": _parameters(shared_names(robot.nominal.table), robot),
        "dropped": tuple(_entry(DroppedEntry, parameter) for parameter in robot.dropped),
        "masses": _content(MassesEntry, robot.payload),
        "covariance": covariance_entry(robot.tool),
        "fit": _entry(
            FitEntry,
            fit,
            **_verdict(result.verdict),
            rod_sigma_m=fit.excess.rod,
            tcp_sigma_mean_m=float(robot.tcp.sigma.mean()),
            tcp_sigma_without_scale_mean_m=float(robot.tcp.without_scale.mean()),
        ),
        "held_out": tuple(_entry(HeldOutEntry, other.outcome) for other in data.validations),
    }


def _of_still_poses(data: RunData) -> dict[str, Any]:
    """The parts of a result that still poses without recordings have."""
    result, description = data.identification, data.tables[0][1].description
    robot, fit, poses = result.robot, result.fit, result.poses
    assert poses is not None, "without recordings there are still poses"
    return {
        "robot": description.robot,
        "instrument": description.instrument or "",
        "parameters": _parameters([p.name for p in arm_parameters(robot.robot)], robot),
        "orders": tuple(
            _entry(
                OrderEntry,
                o,
                joint=o.joint + 1,
                order=round(o.order),
                aliases=tuple(round(a) for a in o.aliases),
            )
            for o in (poses.search.orders if poses.search else ())
        ),
        "cross_validation": _entry(
            CrossValidationEntry,
            poses.cross_validation,
            white_m=poses.cross_validation.white or None,
        ),
        "fit": FitEntry.model_construct(
            **_verdict(result.verdict),
            iterations=fit.iterations,
            unknowns=fit.unknowns,
            poses=poses.table.size,
            tcp_sigma_at_poses_m=float(poses.sigma_at_poses.mean()),
            tcp_sigma_mean_m=float(robot.tcp.sigma.mean()),
            discrepancy_m=poses.unexplained,
            residual_mean_m=poses.residual_means[0],
            nominal_mean_m=poses.residual_means[1],
        ),
        "held_out": tuple(
            _entry(
                PoseHeldOutEntry,
                outcome,
                poses=outcome.error.size,
                mean_m=float(outcome.error.mean()),
                quantile_95_m=float(np.quantile(outcome.error, 0.95)),
                nominal_mean_m=float(outcome.nominal.mean()),
            )
            for _, outcome in data.held_out_tables
        ),
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {"status": verdict.status, "verdict": verdict.sentence, "warnings": verdict.warnings}


def _entry(entry: type[E], source: object, **values: Any) -> E:
    """An entry of these values, and of what `source` has under the other keys.

    A key that ends with its unit, such as `largest_m`, stands for an attribute without it too, and
    a mark `From` names another one. What is an entry itself is formed from its attribute.
    """
    for key, field in entry.model_fields.items():
        marks = [mark.attribute for mark in field.metadata if isinstance(mark, From)]
        for name in marks or (key, _UNIT.sub("", key)):
            if key not in values and hasattr(source, name.split(".")[0]):
                values[key] = _content(field.annotation, attrgetter(name)(source))
    return cast(E, entry.model_construct(None, **values))


def _content(annotation: Any, value: Any) -> Any:
    """A value of a key, or the entries that its annotation asks for; (N,) numbers as a tuple."""
    parts = (annotation, *get_args(annotation))
    kind = next((p for p in parts if isinstance(p, type) and issubclass(p, Strict)), None)
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    if kind is None or value is None:
        return value
    if isinstance(value, tuple):
        return tuple(_entry(kind, item) for item in value)
    return _entry(kind, value)


def _parameters(
    names: Iterable[str], estimate: RobotEstimate | RecordingEstimate
) -> dict[str, ParameterEntry]:
    return {
        name: ParameterEntry.model_construct(
            nominal=estimate.nominal[name],
            value=estimate.geometry[name],
            sigma=estimate.sigma.get(name),
            identified=name in estimate.sigma,
        )
        for name in names
    }


def _ranges(lower: Array, upper: Array) -> tuple[RangeEntry, ...]:
    return tuple(
        RangeEntry.model_construct(lower_rad=float(low), upper_rad=float(high))
        for low, high in zip(lower, upper, strict=True)
    )


def _placements(estimates: dict[str, PlacementEstimate]) -> dict[str, PlacementEntry]:
    entries = {}
    for name, estimate in estimates.items():
        turn = rotvec_from_matrix(estimate.placement.rotation[:, :, None])[:, 0].tolist()
        rotation = tuple(turn) if estimate.whole else None
        sigma = tuple(estimate.turn_sigma.tolist()) if estimate.whole else None
        entries[name] = _entry(
            PlacementEntry, estimate, rotation_vector_rad=rotation, rotation_sigma_rad=sigma
        )
    return entries


def _groups(poses: TableEstimate) -> list[GroupEntry]:
    clocks = {
        name: _clock(clock, (float(sigma[0]), float(sigma[1])))
        for name, (clock, sigma) in poses.clocks.items()
    }
    return [
        _entry(
            GroupEntry,
            group,
            poses=group.size,
            position_rms_m=float(np.sqrt((error**2).mean())),
            clock=None if group.motion is None else clocks[group.motion.name],
        )
        for group, error in zip(poses.table.groups, poses.errors, strict=True)
    ]


def _clock(clock: Clock | None, sigma: tuple[float, float]) -> ClockEntry | None:
    if clock is None:
        return None
    return _entry(ClockEntry, clock, offset_sigma_s=sigma[0], skew_sigma=sigma[1])


def _residuals(estimate: RecordingEstimate) -> ResidualEntry:
    return ResidualEntry.model_construct(
        samples=estimate.samples,
        equations=int(estimate.whitened.size),
        chi2=float((estimate.whitened**2).sum()),
        position_rms_m=rms(np.linalg.norm(estimate.after.position, axis=1)),
        angle_rms_rad=rms(np.linalg.norm(estimate.after.angle, axis=1)),
    )


def _recording(fitted: FittedRecording) -> RecordingEntry:
    estimate = fitted.estimate
    names = [f"b{joint}" for joint in estimate.encoders]
    own = [name for name in estimate.geometry.table.names if belongs_to_recording(name)]
    directions = cast(tuple[Direction, ...], estimate.directions)
    noise = estimate.noise.encoder[[joint - 1 for joint in estimate.encoders]]
    return _entry(
        RecordingEntry,
        estimate,
        encoder_directions=dict(zip(names, directions, strict=True)),
        clock=_clock(estimate.clock, estimate.clock_sigma),
        parameters=_parameters(own, estimate),
        noise=NoiseEntry.model_construct(
            joint_rad=tuple(estimate.noise.joint.tolist()),
            encoder_rad=dict(zip(names, noise.tolist(), strict=True)),
            length_m=estimate.noise.length or None,
        ),
        residuals=_residuals(estimate),
        temperature_C=fitted.recording.description.temperature_C,
        growth=growth_entries(estimate.growth),
    )


def write_calibration(path: Path, run: RunData) -> None:
    """Write calibration.yaml, whole or not at all, and the user's descriptions in it beside it.

    Raises InputError for arrays of a robot, ball-bar or plate that no file describes.

    Raises RefusedResultError if its reader refuses the file. That then stands beside `path` with
    `.refused` in its name (ballbar.result.names.REFUSED), and an earlier result under `path` is
    deleted.
    """
    refused = path.with_suffix(f".refused{path.suffix}")
    file, described = calibration_of(run), ["robot"]
    if run.recordings:
        described += ["instrument", "plate"]
    if run.of_arrays:
        _require_shipped(run, file)
    copied = {
        key: copied_description(path.parent, key, run.folder / name)
        for key in described
        if (name := getattr(file, key)).endswith(".yaml")
    }
    plain = file.model_copy(update=copied).model_dump(
        mode="json",
        by_alias=True,
        exclude_none=True,
        warnings=False,  # of values that are not of the declared type: the reader says so
        fallback=methodcaller("tolist"),  # numbers of NumPy
    )
    write_yaml(refused, plain)
    try:
        load(refused)
    except InputError as error:
        path.unlink(missing_ok=True)
        raise RefusedResultError(
            f"the result stands whole in {refused}, and not in {path.name}, since the reader of "
            f"results refuses it: {error}"
        ) from error
    refused.replace(path)


def _require_shipped(run: RunData, file: CalibrationFile) -> None:
    """Raises InputError unless the names in a file stand for what the arrays were given with."""
    named = Calibration(file).identified_robot().description
    given = run.identification.robot.identified.description
    if not same_contents(given, named):
        raise InputError(
            f"{file.robot} is not the robot of that name that is shipped, or ball-bar or plate are "
            "not, and calibration.yaml can name only descriptions in files. Write them as YAML, "
            "and the logs as a recording folder (ballbar new)."
        )
