"""The content of a certificate: everything that it prints, recomputed from its input files.

It is plain data in SI units and in one order, so that it has a digest and can be compared with what
another computer computes from the same files.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ballbar.cell.errors import InputError
from ballbar.certificate.conformity import DRAWS, Tolerance, decide, error_draws
from ballbar.certificate.details import CertificateDetails, load_details, measured_places
from ballbar.certificate.words import Locale
from ballbar.code_version import code_version
from ballbar.ident.options import SILENT, FitOptions, Listener
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.budget import Budget
from ballbar.report.parameters import parameter_count
from ballbar.report.provenance import hashed, input_places
from ballbar.result.calibration import Calibration, load
from ballbar.result.compare import compare
from ballbar.result.identify import identified
from ballbar.result.performance import performance
from ballbar.result.run_data import RunData
from ballbar.result.write_calibration import calibration_of
from ballbar.units import MM

SCHEMA = "ballbar-certificate/1"
SAME = 1e-3  # of the stated TCP uncertainty, by which a result may differ on another computer
LEAST_SHARE = 0.01  # of the variance, from which a row of the budget is printed
_NOT_PRINTED = {"schema_", "recordings", "validate_", "identify", "tolerance"}
Content = dict[str, Any]


def certificate_content(
    result: Path,
    details: Path,
    *,
    base: Path | None = None,
    locale: Locale,
    listener: Listener = SILENT,
) -> tuple[Content, Path]:
    """The content, and the folder from which it names its files.

    result : a calibration.yaml, or its folder. details : the file that `load_details` reads.
    base : that folder, by default the closest one that holds all files.

    Raises InputError for bad files, and where the result does not follow from the recordings.
    """
    stated, calibration = load_details(details), load(result)
    places = measured_places(stated, details, calibration.path)
    options = stated.identify.options if stated.identify else FitOptions()
    run = identified(*places, options=options, listener=listener)
    computed = Calibration(calibration_of(run), run.folder / calibration.path.name, run)
    _check_follows(calibration, computed, places[0], details)
    files = [details, calibration.path, *(folder / name for _, folder, name in input_places(run))]
    base = base or _common([*files, *(place for both in places for place in both)])
    listener.progress("drawing the TCP errors")
    content = {
        "schema": SCHEMA,
        "locale": locale,
        "program": code_version(),
        "details_file": _name(base, details),
        "result_file": _name(base, calibration.path),
        "files": [
            asdict(hashed(file.parent, file.name)) | {"name": _name(base, file)}
            for file in dict.fromkeys(files)
        ],
        "details": stated.model_dump(exclude=_NOT_PRINTED, mode="json"),
        "described": {
            "robot": run.identification.robot.robot.title,
            "instrument": calibration.file.instrument,
            "plate": calibration.file.plate,
        },
        "measurement": _measurement(run, computed, stated),
        "result": _result(run, computed),
        **_errors(run.identification.robot, stated.tolerance or Tolerance()),
        "budget": _budget(run.identification.budget),
        "performance": list(_performance(computed)),
    }
    return json.loads(canonical(content)), base


def canonical(content: Content) -> bytes:
    """The content as text in one order, of which the digest is taken."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, indent=0)
    return text.encode()


def digest_of(content: Content) -> str:
    """SHA-256 of the content."""
    return hashlib.sha256(canonical(content)).hexdigest()


def _name(base: Path, file: Path) -> str:
    """The name of a file from a folder, where links stay what they are."""
    return Path(os.path.relpath(file, base)).as_posix()


def _common(files: Sequence[Path]) -> Path:
    try:
        common = Path(os.path.commonpath([file.absolute() for file in files]))
    except ValueError:
        what = "lies on another drive than the recordings."
        raise InputError.at(files[0], what, "Copy them into one folder.") from None
    return common if common.is_dir() else common.parent


def _check_follows(
    stored: Calibration, computed: Calibration, places: Sequence[Path], details: Path
) -> None:
    """Refuse a result that these recordings do not give."""
    sigma, other = (each.tcp_sigma for each in (computed, stored))
    status, stated = (str(each.file.fit.status) for each in (computed, stored))
    distance = compare(stored, computed).tcp.maximum
    if max(distance, abs(other - sigma)) > SAME * sigma or status != stated:
        raise InputError(
            f"{stored.path}: does not follow from {', '.join(map(str, places))}, whose robot puts "
            f"the TCP up to {distance * 1e3:.3g} mm elsewhere, with a stated uncertainty of "
            f"{sigma * 1e3:.4g} mm (fit {status}) against {other * 1e3:.4g} mm ({stated}). Name in "
            f"{details} the recordings that it was identified from and, under `identify`, its "
            "options; or identify them again."
        )


def _errors(robot: RobotEstimate, rule: Tolerance) -> Content:
    """Errors of the tool, where they are stated, and how they stand to the tolerance."""
    model, errors = robot.identified, []
    position, every = error_draws(robot)
    for (which, quantity), draws in every.items():
        limit = getattr(rule, f"{quantity}_mm")
        decision = asdict(decide(draws, (limit or 0.0) / MM, rule))
        errors.append({"robot": which, "quantity": quantity, "tolerance_mm": limit, **decision})
    return {
        "poses": len(position),
        "volume_m": np.stack([position.min(axis=0), position.max(axis=0)], 1).tolist(),
        "joints_rad": np.stack([model.lower, model.upper], axis=1).tolist(),
        "draws": DRAWS,
        "rule": rule.model_dump(mode="json") | {"coverage": rule.coverage, "risk": rule.risk},
        "errors": errors,
    }


def _budget(budget: Budget | None) -> Content | None:
    """Rows of the uncertainty budget that matter; None where there is none."""
    if budget is None:
        return None
    keys = "name", "evaluated", "distribution", "contribution", "share"
    large = [row for row in budget.rows if abs(row.share) >= LEAST_SHARE]
    return {
        "rows": [{key: getattr(row, key) for key in keys} for row in large],
        "others": 1.0 - sum(row.share for row in large),
        "combined": budget.combined,
        "expanded": budget.expanded[0],
        "k": budget.coverage_factor,
    }


def _performance(computed: Calibration) -> Iterator[Content]:
    """Positions of the test poses that the identified robot predicts, nominal and identified."""
    for row in performance(computed).rows:
        poses = re.findall(r"P\d", row.place)
        before, after = row.statements[:2]
        if poses and row.unit == "m" and None not in (before.value, after.value, after.high):
            symbol = row.symbol.partition("_")[0]
            numbers = {"nominal": before.value, "identified": after.value, "limit": after.high}
            yield {"symbol": symbol, "poses": poses, "clause": row.clause, **numbers}


def _measurement(run: RunData, computed: Calibration, stated: CertificateDetails) -> Content:
    """Names and extent of the recordings; day and temperatures as stated in the details, else as
    the recordings have them.
    """
    poses, times = run.identification.poses, [r.recording.robot_log.t for r in run.recordings]
    tables = [*(c for _, c in run.tables), *(c for c, _ in run.held_out_tables)]
    described = [*(r.description for _, r in run.read), *(table.description for table in tables)]
    columns = [group.temperature for _, c in run.tables for group in c.table.groups]
    logged = [t for t in (*(d.temperature_C for d in described), *columns) if t is not None]
    known = np.hstack(logged) if logged else np.zeros(0)
    mean, spread = stated.temperature_C, stated.temperature_spread_C
    if mean is None and known.size:
        mean = float(known.mean())
    if spread is None and known.size > 1:
        spread = float(np.ptp(known))
    warm = computed.file.temperature
    return {
        "simulated": any(d.kind == "simulated" for d in described),
        "measured": stated.measured or computed.file.measured_on,
        "fitted": [r.name for r in run.recordings] + [name for name, _ in run.tables],
        "held_out": [outcome.name for outcome in run.outcomes],
        "seconds": float(sum(t[-1] - t[0] for t in times)),
        "samples": sum(r.estimate.samples for r in run.recordings),
        "poses": 0 if poses is None else poses.table.size,
        "temperature_C": mean,
        "temperature_spread_C": spread,
        "factor_to_20_C": warm and warm.factor_to_20_C,
        "robot_expansion_per_K": warm and warm.robot_expansion_per_K,
    }


def _result(run: RunData, computed: Calibration) -> Content:
    result, corrections = run.identification, run.identification.robot.corrections
    grown = (c for known in corrections if known.name == "link_growth" for c in known.coefficients)
    return {
        "status": str(result.verdict.status),
        "held_out_explained": all(outcome.acceptable for outcome in run.outcomes),
        "acceptable": run.acceptable,
        "unknowns": parameter_count(result) + sum(len(c.coefficients) for c in corrections),
        "tcp_sigma": computed.tcp_sigma,
        "tcp_sigma_without_scale": float(result.robot.tcp.without_scale.mean()),
        "growth": [{"name": c.name, "value": c.value, "sigma": c.sigma} for c in grown],
    }
