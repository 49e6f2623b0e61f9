"""What to make of a fit, in words, before anyone reads a number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.descriptions import Cell
from cell.geometry import INDEX, NAMES, PARAMETERS, Geometry
from ident.start.automatic import Start

MISFIT = 2.0  # chi-square per degree of freedom above which the model does not explain the data
SUSPECT = 1.3  # above it something small is left in the residual
PLAUSIBLE = 0.020  # [m, rad] ten times the largest error expected of a robot (thesis sec. 5.4: 2 mm or mrad)
WELL_UNDER = 0.5  # below it the noise was overestimated
FEW_SAMPLES = 200
# autocorrelation of the complete model's residual: 0.2 to 0.5 where nothing is missing (friction), 0.5 to 0.6 without a good
# plate's bending, 0.7 to 0.9 without ripple, encoder harmonics, play or compliance (docs/identification.md)
ALIKE, ALIKE_MISFIT = 0.6, 0.7
STRAINED = (
    3.5  # prior deviations from which an unknown stands for something else that is not in the model
)
CORRELATED = 0.05  # two standard deviations of white noise at 1500 samples


@dataclass(frozen=True)
class Verdict:
    """A status and its sentence, remarks after it."""

    status: str  # "good", "suspect", "misfit", "ambiguous", "implausible", "not converged"
    sentence: str
    warnings: tuple[str, ...]

    @property
    def acceptable(self) -> bool:
        return self.status in ("good", "suspect")


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a verdict is made of."""

    converged: bool
    iterations: int
    chi2_per_dof: float
    autocorrelation: float  # of neighbours in the whitened residual
    geometry: Geometry
    identified: tuple[str, ...]
    samples: int
    complete: bool  # whether every known correction was asked for
    remarks: tuple[str, ...] = ()
    strained: tuple[
        str, ...
    ] = ()  # unknowns of the complete model further from their priors than chance explains


def judge(
    evidence: Evidence, start: Start, cell: Cell, nominal: Geometry, joints: tuple[int, ...]
) -> Verdict:
    """The first line of every output, and the remarks that follow it. joints : encoders fitted."""
    ratio = float(np.sqrt(evidence.chi2_per_dof))
    warnings = (*_sign_warnings(start, joints), *_data_warnings(evidence), *evidence.remarks)
    if not evidence.converged:
        return Verdict(
            "not converged",
            f"Not converged after {evidence.iterations} iterations: do not use these parameters.",
            warnings,
        )
    if strange := _implausible(evidence, nominal):
        sentence = (
            f"Not the declared cell: {strange}. The logs fit a mechanism, but not {cell.robot.title} on {cell.ballbar.title}; "
            "check `robot`, `ballbar` and `plate` in recording.yaml and the units of the logs."
        )
        return Verdict("implausible", sentence, warnings)
    if start.ambiguous:
        offsets = ", ".join(
            f"{c.fit.estimate.clock.offset:.3f} s" for c in (start.chosen, *start.rivals)
        )
        sentence = (
            f"Ambiguous: {1 + len(start.rivals)} ways to align the logs explain them alike (clock offsets {offsets}). "
            "Repeat the run so that it starts and ends at rest inside both logs."
        )
        return Verdict("ambiguous", sentence, warnings)
    if evidence.complete and evidence.autocorrelation > ALIKE_MISFIT:
        sentence = (
            f"Misfit: neighbouring residuals are alike (autocorrelation {evidence.autocorrelation:.2f}): something systematic is in the "
            "data that is not in the model; the stated intervals are too narrow."
        )
        return Verdict("misfit", sentence, warnings)
    if evidence.chi2_per_dof > MISFIT:
        sentence = (
            f"Misfit: the residual is {ratio:.1f} times what the noise in the logs explains. "
            "Something is in the data that is not in the model; the stated intervals are widened by that factor "
            "but may still be too narrow."
        )
        return Verdict("misfit", sentence, warnings)
    if evidence.strained:
        sentence = (
            f"Usable, with care: {', '.join(evidence.strained)} stand more than {STRAINED:g} standard deviations from what the cell files "
            "expect; either the files are wrong or something else is not in the model."
        )
        return Verdict("suspect", sentence, warnings)
    if evidence.complete and evidence.autocorrelation > ALIKE:
        sentence = (
            f"Usable, with care: neighbouring residuals are alike (autocorrelation {evidence.autocorrelation:.2f}), so something "
            "systematic is not in the model; the stated intervals may be too narrow."
        )
        return Verdict("suspect", sentence, warnings)
    if evidence.chi2_per_dof > SUSPECT or evidence.chi2_per_dof < WELL_UNDER:
        return Verdict(
            "suspect",
            f"Usable, with care: the residual is {ratio:.2f} times what the noise in the logs explains.",
            warnings,
        )
    return Verdict(
        "good",
        f"Good fit: the residual is {ratio:.2f} times what the noise in the logs explains.",
        warnings,
    )


def _implausible(evidence: Evidence, nominal: Geometry) -> str:
    """The parameters that are further from the catalogue than any built robot, in words; empty if none is."""
    identified = evidence.geometry.values - nominal.values
    dh = [
        INDEX[n] for n in evidence.identified if PARAMETERS[INDEX[n]].side == "robot" or n == "bd3"
    ]
    worst = sorted(
        (i for i in dh if abs(identified[i]) > PLAUSIBLE), key=lambda i: -abs(identified[i])
    )
    units = {"m": "mm", "rad": "mrad"}
    return ", ".join(
        f"{NAMES[i]} is {identified[i] * 1e3:+.0f} {units[PARAMETERS[i].unit]} off the catalogue"
        for i in worst[:3]
    )


def _sign_warnings(start: Start, joints: tuple[int, ...]) -> list[str]:
    return [
        f"encoder b{joint} counts against its declared sense; the found one is used (check `sign` in recording.yaml)"
        for joint, sign in zip(joints, start.chosen.hypothesis.signs, strict=True)
        if sign < 0
    ]


def _data_warnings(evidence: Evidence) -> list[str]:
    warnings = []
    if evidence.samples < FEW_SAMPLES:
        warnings.append(
            f"only {evidence.samples} samples in the fit; intervals are optimistic (thesis sec. 3.5 wants 750)"
        )
    if evidence.autocorrelation > CORRELATED and not evidence.complete:
        warnings.append(
            f"neighbouring residuals are alike (autocorrelation {evidence.autocorrelation:.2f}): something is not in this model, which is "
            "of kinematics alone (elastic gears, play, ripple, rod strain, eccentric encoders; --model complete asks for them)"
        )
    return warnings
