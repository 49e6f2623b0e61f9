"""The content of calibration.yaml: what an identification found, as the schema has it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import count
from operator import attrgetter
from typing import Any, TypeVar, cast, get_args

import numpy as np

from ballbar.result.calibration_file import SCHEMA, CalibrationFile
from ballbar.result.machine_entries import (
    CoefficientEntry,
    DroppedEntry,
    ParameterEntry,
    RangeEntry,
    covariance_entry,
    masses_entry,
)
from ballbar.result.recording_entries import (
    POSES,
    ClockEntry,
    CrossValidationEntry,
    Direction,
    FitEntry,
    From,
    GroupEntry,
    HeldOutEntry,
    NoiseEntry,
    OrderEntry,
    PlacementEntry,
    PoseHeldOutEntry,
    RecordingEntry,
    ResidualEntry,
)
from ballbar.result.run_data import FittedRecording, PoseRun, RunData
from cell.arrays import Array
from cell.geometry import Geometry
from cell.rotation import rotvec_from_matrix
from cell.schema import Strict
from cell.statistics import rms
from ident.corrections.base import Coefficient
from ident.estimator.fit import Fit
from ident.estimator.priors import belongs_to_recording, shared_names
from ident.table_estimate import PlacementEstimate, TableEstimate

KNOWN = 0.5  # information gain below which a parameter stands at its prior
_UNIT = re.compile(r"_(?:m|rad|s)$")
E = TypeVar("E", bound=Strict)


def calibration_of(data: RunData) -> CalibrationFile:
    """The content of calibration.yaml for logs, which is checked once it is written."""
    result, description = data.identification, data.recordings[0].recording.description
    robot, fit, verdict = result.robot, result.fit, result.verdict
    return CalibrationFile.model_construct(
        schema_=SCHEMA,
        robot=description.robot,
        instrument=description.measured_by,
        plate=description.plate,
        model=result.model,
        parameters=_parameters(
            shared_names(robot.nominal.table), robot.nominal, robot.geometry, robot.sigma
        ),
        dropped=tuple(_entry(DroppedEntry, parameter) for parameter in robot.dropped),
        corrections={
            correction.name: {c.name: _entry(CoefficientEntry, c) for c in correction.coefficients}
            for correction in robot.corrections
        },
        masses=masses_entry(robot.payload),
        ranges=_ranges(robot.lower, robot.upper),
        covariance=covariance_entry(robot.tool),
        recordings=(
            *(_recording(fitted) for fitted in data.recordings),
            *(() if result.poses is None else _groups(result.poses)),
        ),
        seats={} if result.poses is None else _placements(result.poses.seats),
        targets={} if result.poses is None else _placements(result.poses.targets),
        fit=_entry(
            FitEntry,
            fit,
            status=verdict.status,
            verdict=verdict.sentence,
            warnings=verdict.warnings,
            rod_sigma_m=fit.excess.rod,
            tcp_sigma_mean_m=float(robot.tcp.sigma.mean()),
            tcp_sigma_without_scale_mean_m=float(robot.tcp.without_scale.mean()),
        ),
        held_out=tuple(_entry(HeldOutEntry, held_out.outcome) for held_out in data.validations),
    )


def calibration_of_poses(run: PoseRun) -> CalibrationFile:
    """The content of calibration.yaml for still poses, which is checked once it is written."""
    result, description = run.identification, run.tables[0][2].description
    fit, layout, verdict = result.fit, result.fit.model.unknowns, result.verdict
    sigma, gain, robot = result.sigma, result.information_gain, result.identified_robot()
    return CalibrationFile.model_construct(
        schema_=SCHEMA,
        robot=description.robot,
        instrument=description.instrument,
        model=POSES,
        parameters={
            name: ParameterEntry.model_construct(
                nominal=float(layout.mean[i]),
                value=float(fit.x[i]),
                sigma=sigma[name] if gain[name] > KNOWN else None,
                identified=gain[name] > KNOWN,
            )
            for i, name in enumerate(layout.names[: layout.shared.size])
        },
        corrections=_corrections_of_poses(fit),
        orders=tuple(
            _entry(
                OrderEntry,
                o,
                joint=o.joint + 1,
                order=round(o.order),
                aliases=tuple(round(a) for a in o.aliases),
            )
            for o in (result.search.orders if result.search else ())
        ),
        seats=_placements(result.poses.seats),
        targets=_placements(result.poses.targets),
        ranges=_ranges(robot.lower, robot.upper),
        recordings=tuple(_groups(result.poses)),
        cross_validation=_entry(CrossValidationEntry, result.cross_validation),
        fit=FitEntry.model_construct(
            status=verdict.status,
            verdict=verdict.sentence,
            warnings=verdict.warnings,
            iterations=fit.iterations,
            unknowns=layout.count,
            poses=result.table.size,
            tcp_sigma_at_poses_m=float(result.sigma_at_poses.mean()),
            tcp_sigma_mean_m=float(result.tcp_sigma.mean()),
            discrepancy_m=fit.excess.position,
            residual_mean_m=result.residual_means[0],
            nominal_mean_m=result.residual_means[1],
        ),
        held_out=tuple(
            _entry(
                PoseHeldOutEntry,
                outcome,
                poses=outcome.error.size,
                mean_m=float(outcome.error.mean()),
                quantile_95_m=float(np.quantile(outcome.error, 0.95)),
                nominal_mean_m=float(outcome.nominal.mean()),
            )
            for _, _, outcome in run.held_out
        ),
    )


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
    """A value of a key, or the entries that its annotation asks for."""
    parts = (annotation, *get_args(annotation))
    kind = next((p for p in parts if isinstance(p, type) and issubclass(p, Strict)), None)
    if kind is None or value is None:
        return value
    if isinstance(value, tuple):
        return tuple(_entry(kind, item) for item in value)
    return _entry(kind, value)


def _parameters(
    names: Iterable[str], nominal: Geometry, value: Geometry, sigma: dict[str, float]
) -> dict[str, ParameterEntry]:
    return {
        name: ParameterEntry.model_construct(
            nominal=nominal[name],
            value=value[name],
            sigma=sigma.get(name),
            identified=name in sigma,
        )
        for name in names
    }


def _corrections_of_poses(fit: Fit) -> dict[str, dict[str, CoefficientEntry]]:
    layout = fit.model.unknowns
    places = count(layout.coefficients.start)

    def entry(coefficient: Coefficient, k: int) -> CoefficientEntry:
        variance = fit.covariance[k, k]
        return CoefficientEntry.model_construct(
            value=float(fit.x[k]),
            sigma=float(np.sqrt(variance)),
            prior=float(layout.mean[k]),
            prior_sigma=float(layout.sigma[k]),
            information_gain=float(1.0 - min(1.0, variance / layout.sigma[k] ** 2)),
            unit=coefficient.unit,
        )

    return {
        correction.name: {c.name: entry(c, next(places)) for c in correction.coefficients}
        for correction in fit.model.corrections
    }


def _ranges(lower: Array, upper: Array) -> tuple[RangeEntry, ...]:
    return tuple(
        RangeEntry.model_construct(lower_rad=float(low), upper_rad=float(high))
        for low, high in zip(lower, upper, strict=True)
    )


def _placements(estimates: dict[str, PlacementEstimate]) -> dict[str, PlacementEntry]:
    return {
        name: PlacementEntry.model_construct(
            position_m=tuple(estimate.placement.origin.tolist()),
            position_sigma_m=tuple(estimate.sigma.tolist()),
            rotation_vector_rad=tuple(
                rotvec_from_matrix(estimate.placement.rotation[:, :, None])[:, 0].tolist()
            )
            if estimate.whole
            else None,
        )
        for name, estimate in estimates.items()
    }


def _groups(poses: TableEstimate) -> list[GroupEntry]:
    return [
        _entry(
            GroupEntry, group, poses=group.size, position_rms_m=float(np.sqrt((error**2).mean()))
        )
        for group, error in zip(poses.table.groups, poses.errors, strict=True)
    ]


def _recording(fitted: FittedRecording) -> RecordingEntry:
    estimate = fitted.estimate
    clock, after = estimate.clock, estimate.after
    names = [f"b{joint}" for joint in estimate.encoders]
    names_of_recording = [
        name for name in estimate.geometry.table.names if belongs_to_recording(name)
    ]
    directions = cast(tuple[Direction, ...], estimate.directions)
    noise = estimate.noise.encoder[[joint - 1 for joint in estimate.encoders]]
    return _entry(
        RecordingEntry,
        estimate,
        encoder_directions=dict(zip(names, directions, strict=True)),
        clock=None
        if clock is None
        else _entry(
            ClockEntry,
            clock,
            offset_sigma_s=estimate.clock_sigma[0],
            skew_sigma=estimate.clock_sigma[1],
        ),
        parameters=_parameters(
            names_of_recording, estimate.nominal, estimate.geometry, estimate.sigma
        ),
        noise=NoiseEntry.model_construct(
            joint_rad=tuple(estimate.noise.joint.tolist()),
            encoder_rad=dict(zip(names, noise.tolist(), strict=True)),
            length_m=estimate.noise.length or None,
        ),
        residuals=ResidualEntry.model_construct(
            samples=estimate.samples,
            equations=int(estimate.whitened.size),
            chi2=float((estimate.whitened**2).sum()),
            position_rms_m=rms(np.linalg.norm(after.position, axis=1)),
            angle_rms_rad=rms(np.linalg.norm(after.angle, axis=1)),
        ),
        temperature_C=fitted.recording.description.temperature_C,
    )
