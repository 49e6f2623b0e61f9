"""Verdict on a fit: a status and a sentence, to be read before any number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from ballbar.cell.geometry import Geometry, parameter_named

MISFIT = 2.0  # chi-square per degree of freedom above which the model does not explain the data
SUSPECT = 1.3  # above it something small is left in the residual
WELL_UNDER = 0.5  # below it the noise was overestimated
PLAUSIBLE = 0.020  # [m, rad] ten times the largest error expected (thesis sec. 5.4: 2 mm or mrad)


class Status(StrEnum):
    """The verdict's first word, from worst to best."""

    IMPLAUSIBLE = "implausible"
    NOT_CONVERGED = "not converged"
    AMBIGUOUS = "ambiguous"
    MISFIT = "misfit"
    UNCERTAIN = "uncertain"
    SUSPECT = "suspect"
    GOOD = "good"

    @property
    def severity(self) -> int:
        """0 for the best status, larger for worse ones."""
        return len(Status) - 1 - list(Status).index(self)

    @property
    def acceptable(self) -> bool:
        return self in (Status.GOOD, Status.SUSPECT)


# Of these, the logs themselves may show the cause (ballbar.ident.causes).
UNEXPLAINED = (Status.IMPLAUSIBLE, Status.NOT_CONVERGED, Status.MISFIT, Status.UNCERTAIN)
FIRST_WORDS = {  # of a sentence, where a rule does not say them itself
    Status.AMBIGUOUS: "Ambiguous: ",
    Status.MISFIT: "Misfit: ",
    Status.UNCERTAIN: "Uncertain: ",
    Status.SUSPECT: "Usable, with care: ",
    Status.GOOD: "Good fit: ",
}
_WITH_CAUSE = FIRST_WORDS | {
    Status.IMPLAUSIBLE: "Not the declared cell: ",
    Status.NOT_CONVERGED: "Not converged: ",
}


@dataclass(frozen=True)
class Verdict:
    """A status, one sentence, and remarks."""

    status: Status
    sentence: str
    warnings: tuple[str, ...]

    @property
    def acceptable(self) -> bool:
        return self.status.acceptable

    def with_warning(self, sentence: str) -> Verdict:
        """The verdict with one more remark."""
        return replace(self, warnings=(*self.warnings, sentence))

    def with_care(self, sentence: str) -> Verdict:
        """The verdict, no better than suspect, that names what contradicts the result."""
        if self.status is not Status.GOOD:
            return self.with_warning(sentence.removesuffix("."))
        return replace(self, status=Status.SUSPECT, sentence=FIRST_WORDS[Status.SUSPECT] + sentence)

    def with_cause(self, cause: str) -> Verdict:
        """The verdict whose sentence names the cause; what the fit made of it becomes a remark."""
        sentence = _WITH_CAUSE[self.status] + cause
        return replace(self, sentence=sentence, warnings=(self.sentence, *self.warnings))


def noise_status(chi2_per_dof: float) -> Status:
    """The status by what the noise in the logs explains alone."""
    if chi2_per_dof > MISFIT:
        return Status.MISFIT
    suspect = chi2_per_dof > SUSPECT or chi2_per_dof < WELL_UNDER
    return Status.SUSPECT if suspect else Status.GOOD


def implausible(geometry: Geometry, identified: Sequence[str], nominal: Geometry) -> str:
    """The parameters further from the catalogue than any built robot's, in words; or nothing."""
    off = {name: geometry[name] - nominal[name] for name in identified}
    parameters = [parameter_named(name) for name in identified]
    machine = [p for p in parameters if p.side == "robot" or p.name == "bd3"]
    worst = sorted(
        (p for p in machine if abs(off[p.name]) > PLAUSIBLE), key=lambda p: -abs(off[p.name])
    )
    return ", ".join(
        f"{p.name} is {off[p.name] * 1e3:+.0f} m{p.unit} off the catalogue" for p in worst[:3]
    )
