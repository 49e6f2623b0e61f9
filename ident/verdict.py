"""Verdict on a fit: a status and a sentence, to be read before any number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from cell.clock import UNSEEN_OFFSET
from cell.descriptions import Cell
from cell.geometry import Geometry, parameter_named
from cell.number_text import duration_text, significant_text
from ident.least_sizes import LITTLE_SHIFT
from ident.start.automatic import Start

MISFIT = 2.0  # chi-square per degree of freedom above which the model does not explain the data
SUSPECT = 1.3  # above it something small is left in the residual
PLAUSIBLE = 0.020  # [m, rad] ten times the largest error expected (thesis sec. 5.4: 2 mm or mrad)
WELL_UNDER = 0.5  # below it the noise was overestimated
FEW_SAMPLES = 200  # thesis sec. 3.5 wants 750
# Autocorrelation of the complete model's residual (docs/validation, incomplete models): 0.2 to 0.5
# where nothing is missing (friction), 0.5 to 0.6 without a good plate's bending, 0.7 to 0.9 without
# ripple, encoder harmonics, backlash or compliance.
AUTOCORRELATED, AUTOCORRELATED_MISFIT = 0.6, 0.7
# [m] error of the rod that is remarked on, unless its file allows more, and in stated deviations
ROD, ROD_SIGMAS = 5e-4, 3.0
# A result must be better than the nominal robot to be of use: by default its stated TCP uncertainty
# is at most this share of what the nominal robot is off, or below what no nominal robot keeps.
WORTHWHILE, ALWAYS_WORTHWHILE = 0.5, 1e-4  # [1], [m]
# Compliance of all gears over the catalogue's that is no chance of single gears (1.7 between those
# of a class, 1.2 in the mean of six)
ALL_SOFTER = 1.35
RIGID = 1.0 / 3.0  # as soft: gears are stiff then; no arm weighs that little of its catalogue mass
PULL = 3.5  # prior deviations from which an unknown stands for something that is not in the model
# Standard deviations by which the lengths that give the scale contradict each other, from which one
# of them is wrong: once in 370 sound machines
CONTRADICTION = 3.0
# Residual of a recording by the machine of the others over what noise and stated uncertainty
# explain: 0.1 to 2.7 where all are of one machine, 7 and more of two robots
UNLIKE_OTHERS = 4.0
FEW_BLOCKS = 12  # of time: the spread of fewer tells little of the uncertainty
# Autocorrelation that is remarked on: it widens a deviation by 5 %; and in its own standard
# deviations for white noise, 1 / sqrt(samples)
CORRELATED, CORRELATED_SIGMAS = 0.05, 2.0


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


# Of these, the logs themselves may show the cause (ident.causes).
UNEXPLAINED = (Status.IMPLAUSIBLE, Status.NOT_CONVERGED, Status.MISFIT, Status.UNCERTAIN)
_FIRST_WORDS = {
    Status.IMPLAUSIBLE: "Not the declared cell",
    Status.NOT_CONVERGED: "Not converged",
    Status.MISFIT: "Misfit",
    Status.UNCERTAIN: "Uncertain",
}


def noise_status(chi2_per_dof: float) -> Status:
    """The status by what the noise in the logs explains alone."""
    if chi2_per_dof > MISFIT:
        return Status.MISFIT
    suspect = chi2_per_dof > SUSPECT or chi2_per_dof < WELL_UNDER
    return Status.SUSPECT if suspect else Status.GOOD


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
        return replace(self, status=Status.SUSPECT, sentence=f"Usable, with care: {sentence}")

    def with_cause(self, cause: str) -> Verdict:
        """The verdict whose sentence names the cause; what the fit made of it becomes a remark."""
        sentence = f"{_FIRST_WORDS[self.status]}: {cause}"
        return replace(self, sentence=sentence, warnings=(self.sentence, *self.warnings))


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for a verdict, from the fit as a whole."""

    converged: bool
    iterations: int
    chi2_per_dof: float
    autocorrelation: float  # of neighbours in the whitened residual
    geometry: Geometry
    identified: tuple[str, ...]
    complete: bool  # whether the complete model was fitted
    pulled: tuple[str, ...] = ()  # unknowns further than PULL from their priors
    unphysical: tuple[str, ...] = ()  # stiffness, play or mass that is negative
    impossible: tuple[str, ...] = ()  # what is beyond physical size (ident.physical_bounds)
    disagreement: str = ""  # what is not the same in all recordings, or all along one
    ratios: str = ""  # gears that turn otherwise than logged
    softer: float = (
        1.0  # compliance of all gears over the catalogue's, where no torque tells masses
    )
    tcp_sigma: float = 0.0  # [m] stated, rms over the workspace, with the scale
    nominal_error: float = 0.0  # [m] mean distance of the nominal tool from the identified one
    accuracy: float | None = None  # [m] stated TCP uncertainty that is asked for

    blocks: int = FEW_BLOCKS  # of time, that the uncertainty of a complete model rests on
    lengths_apart: float = 0.0  # standard deviations by which known lengths contradict each other
    lengths_off: float = 0.0  # [m] by which they do
    rod_sigma: float = 0.0  # [m] stated, of the identified rod

    def tells(self, cell: Cell) -> bool:
        """Whether neighbours in the residual tell what the model lacks.

        The noise of a sensed length, the one residual, takes up what kinematics leaves over.
        """
        return self.complete or cell.ballbar.stroke is not None

    @property
    def ratio(self) -> float:
        """Residual over what the noise in the logs explains."""
        return float(np.sqrt(self.chi2_per_dof))

    @property
    def neighbours(self) -> str:
        return f"autocorrelation {self.autocorrelation:.2f}"

    @property
    def largest_sigma(self) -> float:
        """[m] stated TCP uncertainty above which the result is of no use."""
        if self.accuracy is not None:
            return self.accuracy
        return max(WORTHWHILE * self.nominal_error, ALWAYS_WORTHWHILE)


@dataclass(frozen=True, eq=False)
class RecordingEvidence:
    """Evidence for a verdict, from one recording."""

    name: str
    start: Start
    encoders: tuple[int, ...]
    samples: int
    remarks: tuple[str, ...] = ()
    clock_sigma: float = 0.0  # [s] of the clock offset
    held_out: float | None = None  # its residual by the machine of the others (ident.consistency)


def judge(
    evidence: Evidence, recordings: Sequence[RecordingEvidence], cell: Cell, nominal: Geometry
) -> Verdict:
    """The worst verdict over all recordings, and the remarks of each.

    nominal : catalogue geometry of the cell.
    """
    judged = [_judged(evidence, recording, cell, nominal) for recording in recordings]
    worst = max(range(len(judged)), key=lambda k: (judged[k][0].severity, -k))
    status, sentence = judged[worst]
    if worst > 0:
        sentence = f"{recordings[worst].name}: {sentence}"
    warnings = _rod_warnings(evidence, cell, nominal)
    for recording in recordings:
        prefix = f"{recording.name}: " if len(recordings) > 1 else ""
        remarks = (*_direction_warnings(recording), *_data_warnings(evidence, recording))
        warnings += [prefix + remark for remark in (*remarks, *recording.remarks)]
    return Verdict(status, sentence, tuple(warnings))


def _judged(
    evidence: Evidence, recording: RecordingEvidence, cell: Cell, nominal: Geometry
) -> tuple[Status, str]:
    """The first rule that applies."""
    return (
        _wrong(evidence, recording, cell, nominal)
        or _unexplained(evidence, cell)
        or _uncertain(evidence)
        or _with_care(evidence, recording, cell)
        or (
            Status.GOOD,
            f"Good fit: the residual is {evidence.ratio:.2f} times what the noise in the logs "
            "explains.",
        )
    )


def _wrong(
    evidence: Evidence, recording: RecordingEvidence, cell: Cell, nominal: Geometry
) -> tuple[Status, str] | None:
    """Another machine than the declared one, or no answer at all."""
    start, unfinished = recording.start, f"Not converged after {evidence.iterations} iterations"
    if strange := implausible(evidence.geometry, evidence.identified, nominal):
        machine = f"{cell.robot.title} on {cell.ballbar.title}"
        fits = f"The logs fit a mechanism, but not {machine}" if evidence.converged else unfinished
        return Status.IMPLAUSIBLE, (
            f"Not the declared cell: {strange}. {fits}; check `robot`, `ballbar` and `plate` in "
            "recording.yaml and the units of the logs."
        )
    if evidence.disagreement:
        return Status.MISFIT, f"Misfit: {evidence.disagreement}."
    if recording.held_out is not None and recording.held_out > UNLIKE_OTHERS:
        return Status.MISFIT, (
            f"Misfit: the machine of the other recordings leaves {recording.held_out:.1f} times "
            "what noise and its uncertainty explain. Identify each recording by itself, and "
            "compare the results."
        )
    if evidence.lengths_apart > CONTRADICTION and evidence.lengths_off > LITTLE_SHIFT:
        return Status.MISFIT, (
            "Misfit: the lengths that the files state as known contradict each other by "
            f"{evidence.lengths_apart:.1f} standard deviations. Measure the rod and the plate "
            "again, or state how well they are known."
        )
    if evidence.unphysical and evidence.converged:
        return Status.MISFIT, (
            f"Misfit: {', '.join(evidence.unphysical)} came out negative, as no stiffness, play or "
            "mass can be: something else is not in the model, or `links` and `body` in the files "
            "are not those of this machine."
        )
    if evidence.impossible:
        return Status.MISFIT, (
            f"Misfit: to fit, {', '.join(evidence.impossible)}, as in no machine: something else "
            "is in the data that is not in the model."
        )
    if not evidence.converged:
        return Status.NOT_CONVERGED, f"{unfinished}: do not use these parameters."
    if start.ambiguous:
        answers = (start.chosen, *start.rivals)
        offsets = ", ".join(f"{c.fit.clock().offset:.3f} s" for c in answers)
        return Status.AMBIGUOUS, (
            f"Ambiguous: {len(answers)} ways to align the logs explain them equally well (clock "
            f"offsets {offsets}). Repeat the run so that it starts and ends at rest inside both "
            "logs."
        )
    return None


def _unexplained(evidence: Evidence, cell: Cell) -> tuple[Status, str] | None:
    """Something in the data, or in the files, that the model cannot have."""
    if evidence.tells(cell) and evidence.autocorrelation > AUTOCORRELATED_MISFIT:
        return Status.MISFIT, (
            f"Misfit: neighbouring residuals are correlated ({evidence.neighbours}): something "
            "systematic is in the data that is not in the model; the stated intervals are too "
            "narrow. Look where the residuals stand out (report.html); fit --model complete, or "
            "state what the robot's file lacks."
        )
    if noise_status(evidence.chi2_per_dof) is Status.MISFIT:
        return Status.MISFIT, (
            f"Misfit: the residual is {evidence.ratio:.1f} times what the noise in the logs "
            "explains. Something is in the data that is not in the model; the stated intervals are "
            "widened by that factor but may still be too narrow. Look where the residuals stand "
            "out (report.html), and check mounting, play of the joints and the cell's files."
        )
    return None


def _uncertain(evidence: Evidence) -> tuple[Status, str] | None:
    """Too little in the logs to be of use."""
    if evidence.complete and evidence.blocks < FEW_BLOCKS:
        return Status.UNCERTAIN, (
            "Uncertain: the logs are too short for a complete model to state how well it is known "
            f"({evidence.blocks} blocks of a few seconds, {FEW_BLOCKS} are needed). Record two "
            "minutes of motion of every joint."
        )
    if evidence.tcp_sigma > evidence.largest_sigma:
        limit = (
            f"the {evidence.accuracy * 1e3:.3g} mm that are asked for"
            if evidence.accuracy is not None
            else f"half of the {significant_text(evidence.nominal_error * 1e3, 2)} mm that the "
            "nominal robot is off"
        )
        known = significant_text(evidence.tcp_sigma * 1e3, 2)
        return Status.UNCERTAIN, (
            f"Uncertain: the tool is known to {known} mm (1 sigma, rms over the workspace, with "
            f"the scale), and {limit} would be the most. Record longer, on a path that moves every "
            "joint further, or several recordings together."
        )
    return None


def _with_care(
    evidence: Evidence, recording: RecordingEvidence, cell: Cell
) -> tuple[Status, str] | None:
    """Usable, but something small is not as it should be."""
    care: str | None = None
    noise = noise_status(evidence.chi2_per_dof)
    if masses_in_doubt(evidence.softer):
        care = (
            f"all gears together are {evidence.softer:.2f} times as soft as the "
            "catalogue's, as if the tool or the arm weighed that much more than the files say. "
            "State what the flange carries (`body` in the plate's file), or log motor torques."
        )
    elif evidence.ratios:
        care = (
            f"{evidence.ratios}. A ratio of teeth is exact: the robot's file is of other gears, or "
            "its log is scaled otherwise than the dialect says. The result holds for angles as "
            "they were logged."
        )
    elif evidence.pulled:
        care = (
            f"{', '.join(evidence.pulled)} stand more than {PULL:g} standard "
            "deviations from what the cell files expect; either the files are wrong or something "
            "else is not in the model. Check these values in the files first."
        )
    elif evidence.tells(cell) and evidence.autocorrelation > AUTOCORRELATED:
        care = (
            f"neighbouring residuals are correlated ({evidence.neighbours}), so "
            "something systematic is not in the model; the stated intervals may be too narrow. "
            "Test the result on a held-out recording (--validate)."
        )
    elif noise is Status.GOOD and recording.clock_sigma > UNSEEN_OFFSET:
        care = (
            f"the clock offset is known to {duration_text(recording.clock_sigma)} "
            "at best, since the length hardly changes. Vary it within its stroke, or move faster."
        )
    elif noise is Status.SUSPECT:
        care = (
            f"the residual is {evidence.ratio:.2f} times what the noise in the logs explains. "
            "Test the result on a held-out recording (--validate)."
        )
    return None if care is None else (Status.SUSPECT, f"Usable, with care: {care}")


def masses_in_doubt(softer: float) -> bool:
    """Whether gears, all together so many times as soft as the catalogue's, are no chance."""
    return softer > ALL_SOFTER or RIGID < softer < 1.0 / ALL_SOFTER


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


def _rod_warnings(evidence: Evidence, cell: Cell, nominal: Geometry) -> list[str]:
    """Warnings about a rigid rod whose length differs from its file; the fit is no worse for it."""
    length, stated = evidence.geometry["bd3"], nominal["bd3"]
    sensed = cell.ballbar.stroke is not None or "bd3" not in evidence.identified
    off = abs(length - stated)
    least = max(ROD, cell.ballbar.length_tolerance, ROD_SIGMAS * evidence.rod_sigma)
    if sensed or not least < off <= PLAUSIBLE:
        return []  # beyond it the verdict's sentence says so
    return [
        f"the rod comes out {length * 1e3:.2f} mm long, and the file of {cell.ballbar.name} states "
        f"{stated * 1e3:.2f} mm (bd3); is it the ball-bar that was used? Name it, or correct bd3"
    ]


def _direction_warnings(recording: RecordingEvidence) -> list[str]:
    directions = recording.start.chosen.hypothesis.directions
    return [
        f"encoder b{joint} counts against its declared direction; the identified one is used "
        "(check `sign` in recording.yaml)"
        for joint, direction in zip(recording.encoders, directions, strict=True)
        if direction < 0
    ]


def _data_warnings(evidence: Evidence, recording: RecordingEvidence) -> list[str]:
    warnings = []
    if recording.samples < FEW_SAMPLES:
        warnings.append(
            f"only {recording.samples} samples in the fit; intervals are optimistic (thesis sec. "
            "3.5 wants 750). Record longer, or raise --samples"
        )
    chance = CORRELATED_SIGMAS / np.sqrt(max(1, recording.samples))
    if evidence.autocorrelation > max(CORRELATED, chance) and not evidence.complete:
        left_out = "elastic gears, backlash, ripple"
        if recording.encoders:
            left_out += ", rod strain, eccentric encoders"
        warnings.append(
            f"neighbouring residuals are correlated (autocorrelation "
            f"{evidence.autocorrelation:.2f}): something is not in this model, which is of "
            f"kinematics alone ({left_out}; --model complete fits them)"
        )
    return warnings
