"""What to make of a fit, in words, before anyone reads a number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.descriptions import Cell
from cell.geometry import NAMES, PARAMETERS, Geometry
from ident.problem import Problem
from ident.solver import Fit
from ident.start import Start

MISFIT = 2.0  # chi-square per degree of freedom above which the model does not explain the data
SUSPECT = 1.3  # above it something small is left in the residual
PLAUSIBLE = 0.020  # [m, rad] ten times the largest error expected of a robot (thesis sec. 5.4: 2 mm or mrad)
WELL_UNDER = 0.5  # below it the noise was overestimated
FEW_SAMPLES = 200
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


def judge(fit: Fit, start: Start, problem: Problem, cell: Cell, nominal: Geometry, autocorrelation: float) -> Verdict:
    """The first line of every output, and the remarks that follow it.

    autocorrelation : of the whitened residual, one sample apart.
    """
    ratio = float(np.sqrt(fit.chi2_per_dof))
    warnings = tuple(_sign_warnings(start, problem)) + tuple(_data_warnings(problem, autocorrelation))
    if not fit.converged:
        return Verdict("not converged", f"Not converged after {fit.iterations} iterations: do not use these parameters.", warnings)
    if strange := _implausible(fit, nominal):
        sentence = (
            f"Not the declared cell: {strange}. The logs fit a mechanism, but not {cell.robot.title} on {cell.ballbar.title}; "
            "check `robot`, `ballbar` and `plate` in recording.yaml and the units of the logs."
        )
        return Verdict("implausible", sentence, warnings)
    if start.ambiguous:
        offsets = ", ".join(f"{c.fit.estimate.clock.offset:.3f} s" for c in (start.chosen, *start.rivals))
        sentence = (
            f"Ambiguous: {1 + len(start.rivals)} ways to align the logs explain them alike (clock offsets {offsets}). "
            "Repeat the run so that it starts and ends at rest inside both logs."
        )
        return Verdict("ambiguous", sentence, warnings)
    if fit.chi2_per_dof > MISFIT:
        sentence = (
            f"Misfit: the residual is {ratio:.1f} times what the noise in the logs explains. "
            "Something is in the data that is not in the model; the stated intervals are widened by that factor "
            "but may still be too narrow."
        )
        return Verdict("misfit", sentence, warnings)
    if fit.chi2_per_dof > SUSPECT or fit.chi2_per_dof < WELL_UNDER:
        return Verdict("suspect", f"Usable, with care: the residual is {ratio:.2f} times what the noise in the logs explains.", warnings)
    return Verdict("good", f"Good fit: the residual is {ratio:.2f} times what the noise in the logs explains.", warnings)


def _implausible(fit: Fit, nominal: Geometry) -> str:
    """The parameters that are further from the catalogue than any built robot, in words; empty if none is."""
    identified = fit.estimate.geometry.values - nominal.values
    dh = [i for i in fit.parameters if PARAMETERS[i].side == "robot" or PARAMETERS[i].name == "bd3"]
    worst = sorted((i for i in dh if abs(identified[i]) > PLAUSIBLE), key=lambda i: -abs(identified[i]))
    units = {"m": "mm", "rad": "mrad"}
    return ", ".join(f"{NAMES[i]} is {identified[i] * 1e3:+.0f} {units[PARAMETERS[i].unit]} off the catalogue" for i in worst[:3])


def _sign_warnings(start: Start, problem: Problem) -> list[str]:
    return [
        f"encoder b{joint} counts against its declared sense; the found one is used (check `sign` in recording.yaml)"
        for joint, sign in zip(problem.joints, start.chosen.hypothesis.signs, strict=True)
        if sign < 0
    ]


def _data_warnings(problem: Problem, autocorrelation: float) -> list[str]:
    warnings = []
    if problem.times.size < FEW_SAMPLES:
        warnings.append(f"only {problem.times.size} samples in the fit; intervals are optimistic (thesis sec. 3.5 wants 750)")
    if autocorrelation > CORRELATED:
        warnings.append(
            f"neighbouring residuals are alike (autocorrelation {autocorrelation:.2f}): something small and slow, such as rod strain, "
            "is not in the model, and the stated intervals count it as white noise; take them three times as wide"
        )
    return warnings
