"""Sections about the machine: what all recordings have in common stands once."""

from __future__ import annotations

from ballbar.report.corrections import (
    coefficient_text,
    coefficients_at_prior,
    correction_tables,
    parameters_at_prior,
)
from ballbar.report.maps import correlation_map
from ballbar.report.numbers import MISSING, capitalised, significant
from ballbar.report.parameters import left_at_nominal, not_requested, parameter_groups
from ballbar.report.recording import OVERVIEW, overview_cells
from ballbar.report.section import MACHINE, Section, section
from ballbar.report.tracker import tracker_section
from ballbar.result.compare import z_rms
from ballbar.result.run_data import RunData, Validation
from ballbar.units import MM
from ident.estimator.uncertainty import correlated_groups
from ident.held_out import HeldOut


def machine_section(run: RunData) -> list[Section]:
    """Held-out recordings, parameters, corrections, fit, and an overview of the recordings."""
    if not run.recordings:
        return []
    robot, comparison = run.identification.robot, run.comparison
    covariance, corrections = robot.covariance, correction_tables(robot)
    groups = correlated_groups(covariance.values, covariance.names)
    columns = [overview_cells(fitted) for fitted in run.recordings]
    links = {
        "held-out": "Held-out" if run.validations else "",
        "parameters": "Parameters",
        "corrections": "Corrections" if corrections else "",
        "fit": "Fit",
        "recordings": "Recordings" if run.several else "",
    }
    return [
        section(
            "machine.html",
            links,
            MACHINE,
            result=run.identification,
            against_truth=comparison is not None,
            several=run.several,
            held_out=[_held_out(validation) for validation in run.validations],
            groups=parameter_groups(robot, comparison),
            z_rms=z_rms(run.identification, comparison) if comparison else None,
            left_at_nominal=left_at_nominal(robot),
            not_requested=not_requested(robot),
            correlated=[", ".join(names) for names in groups],
            correlations=correlation_map(covariance, groups),
            corrections=corrections,
            at_prior=parameters_at_prior(robot),
            coefficients_at_prior=[
                (c.name, coefficient_text(c)) for c in coefficients_at_prior(robot)
            ],
            names=[fitted.name for fitted in run.recordings],
            overview=list(zip(OVERVIEW, zip(*columns, strict=True), strict=True)),
        )
    ]


def held_out_imports(run: RunData) -> list[Section]:
    """How the held-out recordings were read."""
    if not isinstance(run, RunData) or not run.validations:
        return []
    imports = [(v.outcome.name, v.recording.report) for v in run.validations]
    return [section("held_out_imports.html", {}, MACHINE, imports=imports)]


def _held_out(validation: Validation) -> dict[str, object]:
    """A recording that took no part in the identification."""
    outcome = validation.outcome
    return {
        "name": outcome.name,
        "rows": _held_out_rows(outcome),
        "step_faults": [capitalised(fault.sentence) for fault in outcome.step_faults],
        "tracker": tracker_section(outcome.tracker),
    }


def _held_out_rows(outcome: HeldOut) -> list[tuple[str, str, str]]:
    """Sizes of the loop-closure error of a held-out recording: nominal and identified."""
    nominal, identified = outcome.nominal, outcome.identified
    sizes = [
        ("position, rms", nominal.position_rms, identified.position_rms, "mm"),
        ("position, largest", nominal.position_max, identified.position_max, "mm"),
        ("angle, rms", nominal.angle_rms, identified.angle_rms, "mrad"),
    ]
    rows = [
        (name, f"{significant(before * MM)} {unit}", f"{significant(after * MM)} {unit}")
        for name, before, after, unit in sizes
    ]
    ratios = significant(nominal.ratio, 2), significant(identified.ratio, 2)
    innovation = significant(outcome.normalised_innovation, 2)
    return [
        *rows,
        ("times what noise explains", *ratios),
        ("times what noise and stated uncertainty explain", MISSING, innovation),
        ("samples", "", str(outcome.samples)),
    ]
