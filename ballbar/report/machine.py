"""The page's sections about the machine: what all recordings have in common stands once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from acquisition.report import ImportReport
from ballbar.report.corrections import (
    CorrectionTable,
    coefficient_text,
    coefficients_at_prior,
    correction_tables,
    parameters_at_prior,
)
from ballbar.report.numbers import MISSING, capitalised, significant
from ballbar.report.parameters import (
    LeftAtNominal,
    ParameterGroup,
    left_at_nominal,
    not_requested,
    parameter_groups,
)
from ballbar.report.recording import OVERVIEW, overview_cells
from ballbar.report.tracker import TrackerSection, tracker_section
from ballbar.result.compare import z_rms
from ballbar.result.run_data import RunData, Validation
from ballbar.units import MM
from ident.estimator.uncertainty import correlated_groups
from ident.held_out import HeldOut


@dataclass(frozen=True)
class HeldOutRow:
    """One size of a held-out recording's loop-closure error, with its unit."""

    name: str
    nominal: str
    identified: str


@dataclass(frozen=True)
class HeldOutSection:
    """A recording that took no part in the identification."""

    name: str
    rows: list[HeldOutRow]
    step_faults: list[str]  # sentences
    tracker: TrackerSection | None
    imported: ImportReport


@dataclass(frozen=True)
class OverviewRow:
    """One property of every recording."""

    name: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class MachineSection:
    """Parameters, corrections and uncertainty of robot and ball-bar."""

    groups: list[ParameterGroup]
    z_rms: float | None  # None where the truth is not known
    left_at_nominal: list[LeftAtNominal]
    not_requested: list[str]
    correlated: list[str]  # names of each group
    corrections: list[CorrectionTable]
    at_prior: list[str]
    coefficients_at_prior: list[tuple[str, str]]  # name and value
    held_out: list[HeldOutSection]
    names: list[str]  # of the recordings
    overview: list[OverviewRow]


def machine_section(data: RunData) -> MachineSection:
    """The section of a run."""
    robot, comparison = data.identification.robot, data.comparison
    groups = correlated_groups(robot.covariance.values, robot.covariance.names)
    columns = [overview_cells(fitted) for fitted in data.recordings]
    overview = zip(OVERVIEW, zip(*columns, strict=True), strict=True)
    return MachineSection(
        groups=parameter_groups(robot, comparison),
        z_rms=z_rms(data.identification, comparison) if comparison else None,
        left_at_nominal=left_at_nominal(robot),
        not_requested=not_requested(robot),
        correlated=[", ".join(names) for names in groups],
        corrections=correction_tables(robot),
        at_prior=parameters_at_prior(robot),
        coefficients_at_prior=[(c.name, coefficient_text(c)) for c in coefficients_at_prior(robot)],
        held_out=held_out_sections(data.validations),
        names=[fitted.name for fitted in data.recordings],
        overview=[OverviewRow(*row) for row in overview],
    )


def held_out_sections(validations: Sequence[Validation]) -> list[HeldOutSection]:
    """A section for each held-out recording."""
    return [
        HeldOutSection(
            name=validation.outcome.name,
            rows=_held_out_rows(validation.outcome),
            step_faults=[capitalised(f.sentence) for f in validation.outcome.step_faults],
            tracker=tracker_section(validation.outcome.tracker),
            imported=validation.recording.report,
        )
        for validation in validations
    ]


def _held_out_rows(outcome: HeldOut) -> list[HeldOutRow]:
    nominal, identified = outcome.nominal, outcome.identified
    sizes = [
        ("position, rms", nominal.position_rms, identified.position_rms, "mm"),
        ("position, largest", nominal.position_max, identified.position_max, "mm"),
        ("angle, rms", nominal.angle_rms, identified.angle_rms, "mrad"),
    ]
    rows = [
        HeldOutRow(name, *(f"{significant(size * MM)} {unit}" for size in (before, after)))
        for name, before, after, unit in sizes
    ]
    ratios = significant(nominal.ratio, 2), significant(identified.ratio, 2)
    innovation = significant(outcome.normalised_innovation, 2)
    return [
        *rows,
        HeldOutRow("times what noise explains", *ratios),
        HeldOutRow("times what noise and stated uncertainty explain", MISSING, innovation),
        HeldOutRow("samples", "", str(outcome.samples)),
    ]
