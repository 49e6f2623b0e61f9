"""The content of a certificate: everything that it prints, recomputed from its input files.

It is plain data in SI units and in one order, so that it has a digest and can be compared with what
another computer computes from the same files.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.errors import InputError
from ballbar.cell.files import name_from
from ballbar.certificate.conformity import DRAWS, Rule, coverage, decide, error_draws
from ballbar.certificate.details import (
    CertificateDetails,
    ToleranceDetails,
    load_details,
    measured_places,
    stated_details,
)
from ballbar.certificate.words import Locale
from ballbar.code_version import code_version
from ballbar.ident.options import SILENT, Listener
from ballbar.report.parameters import parameter_count
from ballbar.report.provenance import hashed, input_places
from ballbar.report.tcp_view import TcpView, tcp_view
from ballbar.result.calibration import Calibration, load
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.identify import identified
from ballbar.result.run_data import RunData
from ballbar.result.write_calibration import calibration_of
from ballbar.units import MM

SCHEMA = "ballbar-certificate/1"
SAME = 1e-3  # of a standard deviation, by which a parameter may differ on another computer
FEW_BITS = 1e-3  # the same of a standard deviation itself, relative
Content = dict[str, Any]


def certificate_content(
    result: Path, details: Path, *, base: Path | None, locale: Locale, listener: Listener = SILENT
) -> tuple[Content, Path]:
    """The content, and the folder from which it names its files.

    result : a calibration.yaml, or its folder. details : the file that `load_details` reads.
    base : that folder, by default the closest one that holds all files.

    Raises InputError for bad files, and where the result does not follow from the recordings.
    """
    stated, calibration = load_details(details), load(result)
    places = measured_places(stated, details, calibration.path)
    run = identified(*places, options=stated.options, listener=listener)
    _check_same(calibration, calibration_of(run), places[0], details)
    files = [details, calibration.path, *(folder / name for _, folder, name in input_places(run))]
    base = base or _common([*files, *(place for both in places for place in both)])
    listener.progress("computing the conformity")
    content = {
        "schema": SCHEMA,
        "locale": locale,
        "program": code_version(),
        "details_file": name_from(base, details),
        "result_file": name_from(base, calibration.path),
        "files": [_file(base, file) for file in dict.fromkeys(files)],
        "details": dict(stated_details(stated)),
        "described": {
            "robot": run.identification.robot.robot.title,
            "instrument": calibration.file.instrument or "",
            "plate": calibration.file.plate or "",
        },
        **_computed(run, stated),
    }
    return json.loads(canonical(content)), base


def canonical(content: Content) -> bytes:
    """The content as text in one order, of which the digest is taken."""
    text = json.dumps(content, sort_keys=True, ensure_ascii=False, allow_nan=False, indent=0)
    return text.encode()


def digest_of(content: Content) -> str:
    """SHA-256 of the content."""
    return hashlib.sha256(canonical(content)).hexdigest()


def _common(files: Sequence[Path]) -> Path:
    try:
        common = Path(os.path.commonpath([file.resolve() for file in files]))
    except ValueError:
        what = "lies on another drive than the recordings."
        raise InputError.at(files[0], what, "Copy them into one folder.") from None
    return common if common.is_dir() else common.parent


def _file(base: Path, file: Path) -> dict[str, Any]:
    own = hashed(file.parent, file.name)
    return {"name": name_from(base, file), "size": own.size, "sha256": own.sha256}


def _check_same(
    stored: Calibration, computed: CalibrationFile, places: Sequence[Path], details: Path
) -> None:
    """Refuse a result that these recordings do not give."""
    if apart := list(unlike_results(stored.file, computed)):
        raise InputError(
            f"{stored.path}: does not follow from {', '.join(map(str, places))}: "
            f"{'; '.join(apart[:4])}. Name in {details} the recordings that it was identified from "
            "and, under `identify`, its options; or identify them again."
        )


def unlike_results(stored: CalibrationFile, computed: CalibrationFile) -> Iterator[str]:
    """What differs between two results of the same recordings, beyond the last bits."""
    for what, old, new in (
        ("model", stored.model, computed.model),
        ("fit", stored.fit.status, computed.fit.status),
    ):
        if old != new:
            yield f"{what} {old}, computed {new}"
    numbers = [dict(_estimates(file)) for file in (stored, computed)]
    for name in dict.fromkeys((*numbers[0], *numbers[1])):
        was, is_now = (of.get(name) for of in numbers)
        if was is None or is_now is None:
            yield f"{name} {'is not computed' if is_now is None else 'is not in it'}"
            continue
        allowed = SAME * is_now[1] or 1e-9 * abs(is_now[0])
        if abs(was[0] - is_now[0]) > allowed or abs(was[1] - is_now[1]) > FEW_BITS * is_now[1]:
            texts = (f"{value:.9g} ({sigma:.3g})" for value, sigma in (was, is_now))
            yield f"{name} = {next(texts)}, computed {next(texts)}"


def _estimates(file: CalibrationFile) -> Iterator[tuple[str, tuple[float, float]]]:
    """Names, values and standard deviations of all that was identified of the robot."""
    for name, parameter in file.parameters.items():
        yield name, (parameter.value, parameter.sigma or 0.0)
    for entries in file.corrections.values():
        for name, coefficient in entries.items():
            yield name, (coefficient.value, coefficient.sigma)
    yield "fit.tcp_sigma_mean_m", (0.0, file.fit.tcp_sigma_mean_m)


def _computed(run: RunData, stated: CertificateDetails) -> Content:
    """Everything that the recordings tell."""
    view, result = tcp_view(run), run.identification
    rule = _rule(stated.tolerance)
    draws = error_draws(result.robot, view.grid)
    rows = [
        (robot, quantity, getattr(of, quantity))
        for robot, of in draws.items()
        for quantity in ("mean", "largest")
    ]
    limits = dict(stated.tolerance or {})
    return {
        "simulated": any(d.kind == "simulated" for d in _descriptions(run)),
        "measurement": _measurement(run, stated),
        "result": _result(run),
        "workspace": _workspace(run, view),
        "growth": _growth(run),
        "draws": DRAWS,
        "coverage": coverage(rule),
        "errors": [
            {"robot": robot, "quantity": quantity, **_lengths(decide(values, 0.0, rule))}
            for robot, quantity, values in rows
        ],
        "rule": {**asdict(rule), "risk": rule.risk} if limits else None,
        "conformity": [
            _decision(robot, quantity, values, limit, rule)
            for robot, quantity, values in rows
            if (limit := limits.get(f"{quantity}_mm")) is not None
        ],
    }


def _rule(tolerance: ToleranceDetails | None) -> Rule:
    if tolerance is None:
        return Rule("guarded")
    return Rule(
        tolerance.rule, tolerance.coverage_factor, tolerance.guard_factor, tolerance.probability
    )


def _lengths(decision: Any) -> dict[str, float]:
    return {f"{key}_m": getattr(decision, key) for key in ("value", "sigma", "lower", "upper")}


def _decision(robot: str, quantity: str, values: Any, limit: float, rule: Rule) -> Content:
    decision = decide(values, limit / MM, rule)
    return {
        "robot": robot,
        "quantity": quantity,
        "tolerance_mm": limit,
        "probability": decision.probability,
        "verdict": decision.verdict,
    }


def _descriptions(run: RunData) -> list[Any]:
    tables = [*(c for _, c in run.tables), *(c for c, _ in run.held_out_tables)]
    return [*(r.description for _, r in run.read), *(table.description for table in tables)]


def _measurement(run: RunData, stated: CertificateDetails) -> Content:
    fitted = [r.name for r in run.recordings] + [name for name, _ in run.tables]
    poses = run.identification.poses
    logs = [r.recording.robot_log.t for r in run.recordings]
    return {
        "fitted": fitted,
        "held_out": [outcome.name for outcome in run.outcomes],
        "seconds": float(sum(t[-1] - t[0] for t in logs)),
        "samples": sum(r.estimate.samples for r in run.recordings),
        "poses": 0 if poses is None else poses.table.size,
        "temperature_C": _temperature(run, stated),
    }


def _temperature(run: RunData, stated: CertificateDetails) -> dict[str, float | None]:
    """Mean and spread as stated in the details, else as logged; None where neither tells."""
    logged = [getattr(d, "temperature_C", None) for d in _descriptions(run)]
    for _, content in run.tables:
        groups = content.table.groups
        logged += [float(t) for g in groups if g.temperature is not None for t in g.temperature]
    known = [t for t in logged if t is not None]
    mean = float(np.mean(known)) if known else None
    spread = max(known) - min(known) if len(known) > 1 else None
    own = stated.temperature_C, stated.temperature_spread_C
    return {
        "mean": mean if own[0] is None else own[0],
        "spread": spread if own[1] is None else own[1],
    }


def _result(run: RunData) -> Content:
    result = run.identification
    failed = any(not outcome.acceptable for outcome in run.outcomes)
    status = str(result.verdict.status)
    coefficients = sum(len(c.coefficients) for c in result.robot.corrections)
    return {
        "status": "held_out_failed" if failed and result.verdict.acceptable else status,
        "acceptable": run.acceptable,
        "unknowns": parameter_count(result) + coefficients,
        "tcp_sigma_m": float(result.robot.tcp.sigma.mean()),
        "tcp_sigma_without_scale_m": float(result.robot.tcp.without_scale.mean()),
    }


def _workspace(run: RunData, view: TcpView) -> Content:
    robot = run.identification.robot.identified
    ends = np.stack([view.position.min(axis=0), view.position.max(axis=0)], axis=1)
    joints = np.rad2deg(np.stack([robot.lower, robot.upper], axis=1))
    return {
        "poses": len(view.position),
        "box_mm": (ends * MM).round().tolist(),
        "joints_deg": joints.round().tolist(),
    }


def _growth(run: RunData) -> list[Content]:
    """What was identified of the growth of links during the measurement."""
    return [
        {"name": c.name, "value_m": c.value, "sigma_m": c.sigma}
        for correction in run.identification.robot.corrections
        if correction.name == "link_growth"
        for c in correction.coefficients
    ]
