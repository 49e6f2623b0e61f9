"""The rules of a verdict: one list for recordings of any instrument and for still poses.

Each recording of a fit, and the still poses in it, are judged by the first rule that applies; the
worst of them gives the verdict. A rule asks the evidence for what it needs, and says nothing where
that is not there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ballbar.cell.clock import UNSEEN_OFFSET
from ballbar.cell.number_text import duration_text, significant_text
from ballbar.cell.statistics import rms
from ballbar.ident.estimator.priors import PULL
from ballbar.ident.evidence import FEW_BLOCKS, Evidence
from ballbar.ident.least_sizes import LITTLE_SHIFT
from ballbar.ident.model_choice import AUTOCORRELATED, AUTOCORRELATED_MISFIT
from ballbar.ident.remarks import (
    CONTRADICTION,
    contradiction_remark,
    doubted_lengths,
    recording_remarks,
    rod_remark,
)
from ballbar.ident.table_remarks import table_remarks
from ballbar.ident.verdict import FIRST_WORDS, Status, Verdict, implausible, noise_status

# Compliance of all gears over the catalogue's that is no chance of single gears (1.7 between those
# of a class, 1.2 in the mean of six)
ALL_SOFTER = 1.35
RIGID = 1.0 / 3.0  # as soft: gears are stiff then; no arm weighs that little of its catalogue mass
# Residual of a recording by the machine of the others over what noise and stated uncertainty
# explain: 0.1 to 2.7 where all are of one machine, 7 and more of two robots
UNLIKE_OTHERS = 4.0
OVERFITTED = 1.8  # cross-validated error over that of the fitted poses
NO_GAIN = 0.9  # of the nominal robot's error: less than a tenth was won
UNDETERMINED = 0.5  # information gain below which the prior tells more than the data
LOST = 0.1  # of the poses: so many outliers have a cause
MORE_POSES = "measure more poses, spread over all joints."
LONGER_PATH = "record a longer path, over all joints."


def judge(parts: Sequence[Evidence]) -> Verdict:
    """The verdict on the worst part of a fit, by the first rule that applies, and all remarks."""
    judged = [next((s, said) for s, rule in RULES for said in rule(part)) for part in parts]
    worst = max(range(len(judged)), key=lambda k: (judged[k][0].severity, -k))
    (status, sentence), recording = judged[worst], parts[worst].recording
    sentence = FIRST_WORDS.get(status, "") + sentence
    if worst > 0 and recording:
        sentence = f"{recording.name}: {sentence}"
    closure = parts[0].closure
    warnings = [] if closure is None else [*rod_remark(closure), *doubted_lengths(closure)]
    several = sum(part.recording is not None for part in parts) > 1
    for part in parts:
        name = f"{part.recording.name}: " if part.recording and several else ""
        warnings += [name + remark for rule in REMARKS for remark in rule(part)]
    return Verdict(status, sentence, tuple(warnings))


def masses_in_doubt(softer: float) -> bool:
    """Whether gears, all together so many times as soft as the catalogue's, are no chance."""
    return softer > ALL_SOFTER or RIGID < softer < 1.0 / ALL_SOFTER


def _another_machine(e: Evidence) -> Iterator[str]:
    """The data are not of what the files declare."""
    c = e.closure
    if c and (strange := implausible(c.robot.geometry, [*c.robot.sigma], c.robot.nominal)):
        machine = f"{c.robot.robot.title} on {c.robot.cell.ballbar.title}"
        fits = f"The logs fit a mechanism, but not {machine}" if c.fit.converged else _unfinished(e)
        yield (
            f"Not the declared cell: {strange}. {fits}; check `robot`, `ballbar` and `plate` in "
            "recording.yaml and the units of the logs."
        )
    if (poses := e.judged_by) and poses.cross_validation.strange:
        yield (
            f"Not the declared robot, or not its joint angles: {poses.predicted}. Check `robot`, "
            "the order, signs and units of the joint columns, the unit of the measured values, and "
            "whether two seats of the instrument go by one name."
        )


def _several_machines(e: Evidence) -> Iterator[str]:
    """Recordings or files that contradict each other."""
    if e.closure and e.closure.disagreement:
        yield f"{e.closure.disagreement}."
    if e.held_out is not None and e.held_out > UNLIKE_OTHERS:
        yield (
            "the machine of the other recordings leaves "
            f"{e.held_out:.1f} times what noise and its uncertainty explain. Identify "
            "each recording by itself, and compare the results."
        )
    apart = e.closure.lengths_apart if e.closure else 0.0
    if e.closure and apart > CONTRADICTION and e.closure.lengths_off > LITTLE_SHIFT:
        yield (
            f"{contradiction_remark(e.closure)}. Measure the rod and the plate again, or state "
            "how well they are known."
        )


def _no_machine(e: Evidence) -> Iterator[str]:
    """Values that no machine has."""
    if e.closure and e.closure.unphysical and e.closure.fit.converged:
        yield (
            f"{', '.join(e.closure.unphysical)} came out negative, as no stiffness, play "
            "or mass can be: something else is not in the model, or `links` and `body` in the "
            "files are not those of this machine."
        )
    if e.closure and e.closure.impossible:
        yield (
            f"to fit, {', '.join(e.closure.impossible)}, as in no machine: something else "
            "is in the data that is not in the model."
        )


def _given_up(e: Evidence) -> Iterator[str]:
    if e.closure and e.closure.given_up:
        yield (
            f"after {e.closure.fit.iterations} iterations the residual is "
            f"{np.sqrt(e.closure.given_up):.0f} times what the noise in the logs explains, and no "
            "correction brings it down: do not use these parameters. Identify each recording by "
            "itself, and look where the residuals stand out (report.html)."
        )


def _not_converged(e: Evidence) -> Iterator[str]:
    converged, _ = e.ended
    if not converged:
        remedy = f" Check the joint columns and the robot's file; {MORE_POSES}" if e.table else ""
        yield f"{_unfinished(e)}: do not use these parameters.{remedy}"


def _ambiguous(e: Evidence) -> Iterator[str]:
    if e.recording and e.recording.start.ambiguous:
        answers = (e.recording.start.chosen, *e.recording.start.rivals)
        offsets = ", ".join(f"{c.fit.clock().offset:.3f} s" for c in answers)
        yield (
            f"{len(answers)} ways to align the logs explain them equally well (clock "
            f"offsets {offsets}). Repeat the run so that it starts and ends at rest inside both "
            "logs."
        )


def _unfinished(e: Evidence) -> str:
    return f"Not converged after {e.ended[1]} iterations"


def _unexplained(e: Evidence) -> Iterator[str]:
    """Something in the data, or in the files, that the model cannot have."""
    c = e.closure
    if c and c.tells and c.fit.autocorrelation > AUTOCORRELATED_MISFIT:
        yield (
            f"neighbouring residuals are correlated ({c.neighbours}): something "
            "systematic is in the data that is not in the model; the stated intervals are too "
            "narrow. Look where the residuals stand out (report.html); fit --model complete, or "
            "state what the robot's file lacks."
        )
    if c and noise_status(c.fit.chi2_per_dof) is Status.MISFIT:
        yield (
            f"the residual is {c.ratio:.1f} times what the noise in the logs explains. "
            "Something is in the data that is not in the model; the stated intervals are widened "
            "by that factor but may still be too narrow. Look where the residuals stand out "
            "(report.html), and check mounting, play of the joints and the cell's files."
        )


def _uncertain(e: Evidence) -> Iterator[str]:
    """Too little in the logs to be of use."""
    c = e.closure
    if c and c.complete and c.blocks < FEW_BLOCKS:
        yield (
            "the logs are too short for a complete model to state how well it is known "
            f"({c.blocks} blocks of a few seconds, {FEW_BLOCKS} are needed). Record two minutes of "
            "motion of every joint."
        )
    if c and (sigma := rms(c.robot.tcp_sigma)) > c.largest_sigma:
        limit = (
            f"the {c.accuracy * 1e3:.3g} mm that are asked for"
            if c.accuracy is not None
            else f"half of the {significant_text(c.nominal_error * 1e3, 2)} mm that the nominal "
            "robot is off"
        )
        known = significant_text(sigma * 1e3, 2)
        yield (
            f"the tool is known to {known} mm (1 sigma, rms over the workspace, with "
            f"the scale), and {limit} would be the most. Record longer, on a path that moves every "
            "joint further, or several recordings together."
        )


def _undetermined(e: Evidence) -> Iterator[str]:
    """A path along which an instrument saw less of the robot than its file tells."""
    poses = e.judged_by
    if poses is None or not (poses.alone and poses.table.moving.any()):
        return
    layout, noise = poses.fit.model.unknowns, np.sqrt(3.0) * poses.cross_validation.white
    known = float(np.hypot(poses.sigma_at_poses, noise).mean())  # as the nominal robot is judged
    nominal = float(poses.residual_nominal.mean())
    if known > nominal:
        gains = zip(layout.names, poses.information_gain[layout.geometric], strict=False)
        open_ones = ", ".join(name for name, gain in gains if gain < UNDETERMINED)
        yield (
            f"the target is known to {known * 1e3:.3g} mm (1 sigma, mean at the followed poses, "
            f"noise included), "
            f"and the nominal robot is off by {nominal * 1e3:.3g} mm. This path does not determine "
            f"{open_ones or 'the parameters together'}. Move every joint further and turn the tool."
        )


def _lost(e: Evidence) -> Iterator[str]:
    if (poses := e.judged_by) and poses.ignored > LOST * poses.table.size:
        yield (
            f"{poses.ignored} of {poses.table.size} poses lie too far from the model to count. "
            f"Look for what they have in common. Of the others, {poses.predicted}."
        )


def _worse(e: Evidence) -> Iterator[str]:
    if (poses := e.judged_by) and poses.cross_validation.mean > poses.residual_nominal.mean():
        yield (
            "the identified robot is worse than the nominal one where it was not fitted; "
            f"{poses.predicted}. Do not use these parameters. Check the joint columns, and "
            f"whether instrument or target moved; {MORE_POSES}"
        )


def _extrapolated(e: Evidence) -> Iterator[str]:
    """Poses that say little of others."""
    if (poses := e.judged_by) is None:
        return
    validation, (fitted, _) = poses.cross_validation, poses.residual_means
    few, more = "too few poses for so many parameters; fitted ones", MORE_POSES
    if poses.table.moving.any():
        few, more = "too short a path for so many parameters; fitted poses", LONGER_PATH
    if validation.mean > NO_GAIN * float(np.median(poses.residual_nominal)):
        yield (f"little was won over the nominal robot; {poses.predicted}. {more.capitalize()}")
    if poses.alone and validation.mean > OVERFITTED * fitted:  # else recordings tell the parameters
        yield (
            f"{few} lie within {fitted * 1e3:.3f} mm, but {poses.predicted}. {more.capitalize()}"
        )
    if poses.at_one_place and not e.elsewhere:
        yield (
            f"all was measured at one place, and the statement holds there; "
            f"elsewhere the robot may be several times worse: {poses.predicted}. Measure at "
            "another place too, or validate with poses of another place."
        )


def _cares(e: Evidence) -> Iterator[str]:
    """Usable, but something small is not as it should be."""
    c = e.closure
    if (poses := e.judged_by) and poses.doubts:
        yield f"{poses.doubts[0]}; {poses.predicted}."
    if c is None:
        return
    noise = noise_status(c.fit.chi2_per_dof)
    if masses_in_doubt(c.softer):
        yield (
            f"all gears together are {c.softer:.2f} times as soft as the catalogue's, as if the "
            "tool or the arm weighed that much more than the files say. State what the flange "
            "carries (`body` in the plate's file), or log motor torques."
        )
    if c.ratios:
        yield (
            f"{c.ratios}. A ratio of teeth is exact: the robot's file is of other gears, or its "
            "log is scaled otherwise than the dialect says. The result holds for angles as they "
            "were logged."
        )
    if c.pulled:
        yield (
            f"{', '.join(c.pulled)} stand more than {PULL:g} standard deviations from what the "
            "cell files expect; either the files are wrong or something else is not in the model. "
            "Check these values in the files first."
        )
    if c.tells and c.fit.autocorrelation > AUTOCORRELATED:
        yield (
            f"neighbouring residuals are correlated ({c.neighbours}), so something systematic is "
            "not in the model; the stated intervals may be too narrow. Test the result on a "
            "held-out recording (--validate)."
        )
    offset_sigma = e.recording.clock_sigma[0] if e.recording else 0.0
    if noise is Status.GOOD and offset_sigma > UNSEEN_OFFSET:
        yield (
            f"the clock offset is known to {duration_text(offset_sigma)} at best, since "
            "the length hardly changes. Vary it within its stroke, or move faster."
        )
    if noise is Status.SUSPECT:
        yield (
            f"the residual is {c.ratio:.2f} times what the noise in the logs explains. Test the "
            "result on a held-out recording (--validate)."
        )


def _good(e: Evidence) -> Iterator[str]:
    if e.closure:
        explained = f"{e.closure.ratio:.2f} times what the noise in the logs explains"
        yield f"the residual is {explained}."
    if e.table:
        yield f"{e.table.predicted}."


Rule = Callable[[Evidence], Iterator[str]]
RULES: tuple[tuple[Status, Rule], ...] = (
    (Status.IMPLAUSIBLE, _another_machine),
    (Status.MISFIT, _several_machines),
    (Status.MISFIT, _no_machine),
    (Status.MISFIT, _given_up),
    (Status.NOT_CONVERGED, _not_converged),
    (Status.AMBIGUOUS, _ambiguous),
    (Status.MISFIT, _unexplained),
    (Status.UNCERTAIN, _uncertain),
    (Status.UNCERTAIN, _undetermined),
    (Status.SUSPECT, _lost),
    (Status.MISFIT, _worse),
    (Status.SUSPECT, _extrapolated),
    (Status.SUSPECT, _cares),
    (Status.GOOD, _good),
)
REMARKS: tuple[Rule, ...] = (recording_remarks, table_remarks)
