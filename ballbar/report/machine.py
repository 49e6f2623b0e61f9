"""Sections about the machine: what all recordings have in common stands once."""

from __future__ import annotations

from ballbar.report.maps import correlation_map
from ballbar.report.parameters import (
    coefficient_text,
    coefficients_at_prior,
    correction_tables,
    left_at_nominal,
    not_requested,
    parameter_groups,
    parameters_at_prior,
)
from ballbar.report.recording import overview
from ballbar.report.section import MACHINE, Section, section
from ballbar.result.compare import z_rms
from ballbar.result.run_data import RunData
from ident.estimator.uncertainty import correlated_groups


def machine_section(run: RunData) -> list[Section]:
    """Held-out recordings, parameters, corrections, fit, and an overview of the recordings."""
    if not run.recordings:
        return []
    robot, comparison = run.identification.robot, run.comparison
    covariance, corrections = robot.covariance, correction_tables(robot)
    groups = correlated_groups(covariance.values, covariance.names)
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
            held_out=run.outcomes,
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
            overviews={fitted.name: overview(fitted) for fitted in run.recordings},
        )
    ]


def held_out_imports(run: RunData) -> list[Section]:
    """How the held-out recordings were read."""
    if not run.recordings or not run.validations:
        return []
    imports = [(v.outcome.name, v.recording.report) for v in run.validations]
    return [section("held_out_imports.html", {}, MACHINE, imports=imports)]
