"""The verdict: each rule with the evidence that triggers it, their order, several recordings."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.evidence import FEW_BLOCKS, ClosureEvidence, Evidence
from ballbar.ident.least_sizes import LITTLE_SHIFT
from ballbar.ident.remarks import CONTRADICTION, CORRELATED, DOUBTED, FEW_SAMPLES
from ballbar.ident.result import FitStatistics, NamedCovariance, RecordingEstimate, RobotEstimate
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tcp_uncertainty import TcpUncertainty
from ballbar.ident.rules import AUTOCORRELATED, AUTOCORRELATED_MISFIT, UNLIKE_OTHERS, judge
from ballbar.ident.start.automatic import Start
from ballbar.ident.verdict import (
    MISFIT,
    PLAUSIBLE,
    SUSPECT,
    WELL_UNDER,
    Status,
    Verdict,
    noise_status,
)
from tests.helpers.start_candidates import candidate
from tests.helpers.synthetic_recording import CELL, NOMINAL

SHARED = ("ra2", "rtheta3", "bd3", "ox")
ROBOT = RobotEstimate(
    IdentifiedRobot(CELL, NOMINAL),
    NOMINAL,
    dict.fromkeys(SHARED, 0.0),
    NamedCovariance((), np.zeros((0, 0)), np.zeros((0, 0))),
    (),
    TcpUncertainty(np.zeros(1), np.zeros(1), ()),
)
GOOD = ClosureEvidence(ROBOT, FitStatistics(True, 5, 30, 1.0, ExcessNoise()), complete=False)
CLEAR = Start(candidate(0.1), (), 3)
AMBIGUOUS = Start(candidate(0.1), (candidate(7.25), candidate(14.5)), 5)


@dataclass(frozen=True)
class Recorded:
    """The part of a recording that a verdict takes."""

    name: str = "first"
    start: Start = CLEAR
    encoders: tuple[int, ...] = (1, 2)
    samples: int = 1500
    remarks: tuple[str, ...] = ()
    clock_sigma: tuple[float, float] = (0.0, 0.0)
    held_out: float | None = None


RECORDING = Recorded()


def changed(evidence: ClosureEvidence, **changes: Any) -> ClosureEvidence:
    """The evidence with other figures of its fit, its robot, or its own."""
    figures = {f.name for f in fields(FitStatistics)} & changes.keys()
    fit = replace(evidence.fit, **{name: changes.pop(name) for name in figures})
    robot = evidence.robot
    if "geometry" in changes:
        identified = replace(robot.identified, geometry=changes.pop("geometry"))
        robot = replace(robot, identified=identified)
    if "sigma" in changes:
        robot = replace(robot, sigma=changes.pop("sigma"))
    if "tcp_sigma" in changes:
        robot = replace(robot, tcp=replace(robot.tcp, sigma=np.full(1, changes.pop("tcp_sigma"))))
    return replace(evidence, robot=robot, fit=fit, **changes)


UNCONVERGED = changed(GOOD, converged=False)
STRANGE = changed(GOOD, geometry=NOMINAL.replaced({"ra2": NOMINAL["ra2"] + 0.05}))
COMPLETE = changed(GOOD, complete=True)


def judged(closure: ClosureEvidence, *recordings: Recorded) -> Verdict:
    return judge(
        [
            Evidence(closure, cast("RecordingEstimate", r), None, r.remarks, r.held_out)
            for r in recordings or [RECORDING]
        ]
    )


@pytest.mark.parametrize(
    ("evidence", "status", "words"),
    [
        (GOOD, Status.GOOD, "Good fit: the residual is 1.00 times what the noise in the logs"),
        (
            changed(UNCONVERGED, iterations=40),
            Status.NOT_CONVERGED,
            "Not converged after 40 iterations: do not use these parameters.",
        ),
        (
            STRANGE,
            Status.IMPLAUSIBLE,
            "Not the declared cell: ra2 is +50 mm off the catalogue. The logs fit a mechanism, but "
            "not ABB IRB 2400/16 on",
        ),
        (
            changed(COMPLETE, autocorrelation=AUTOCORRELATED_MISFIT + 0.01),
            Status.MISFIT,
            "Misfit: neighbouring residuals are correlated (autocorrelation 0.71): something",
        ),
        (
            changed(GOOD, chi2_per_dof=9.0),
            Status.MISFIT,
            "Misfit: the residual is 3.0 times what the noise in the logs explains. Something",
        ),
        (  # the noise of what is left explains all of it
            changed(COMPLETE, given_up=81.0, converged=False, iterations=26),
            Status.MISFIT,
            "Misfit: after 26 iterations the residual is 9 times what the noise in the logs",
        ),
        (
            changed(COMPLETE, disagreement="recording 2 is of another tool"),
            Status.MISFIT,
            "Misfit: recording 2 is of another tool.",
        ),
        (
            changed(COMPLETE, lengths_apart=CONTRADICTION + 0.5, lengths_off=2e-5),
            Status.MISFIT,
            "Misfit: the lengths that the files state as known contradict each other by 3.5",
        ),
        (
            changed(COMPLETE, blocks=FEW_BLOCKS - 5),
            Status.UNCERTAIN,
            "Uncertain: the logs are too short for a complete model to state how well it is known "
            "(7 blocks",
        ),
        (
            changed(COMPLETE, unphysical=("compliance2", "the tool's mass")),
            Status.MISFIT,
            "Misfit: compliance2, the tool's mass came out negative, as no stiffness, play or mass",
        ),
        (
            changed(GOOD, tcp_sigma=0.8e-3, nominal_error=1.2e-3),
            Status.UNCERTAIN,
            "Uncertain: the tool is known to 0.80 mm (1 sigma, rms over the workspace, with the "
            "scale), and half of the 1.2 mm that the nominal robot is off would be the most. "
            "Record longer",
        ),
        (
            changed(GOOD, tcp_sigma=0.06e-3, nominal_error=1.2e-3, accuracy=0.05e-3),
            Status.UNCERTAIN,
            "Uncertain: the tool is known to 0.060 mm (1 sigma, rms over the workspace, with the "
            "scale), and the 0.05 mm that are asked for would be the most.",
        ),
        (
            changed(GOOD, tcp_sigma=0.8e-3, nominal_error=1.2e-3, accuracy=1e-3),
            Status.GOOD,
            "Good fit",
        ),
        (
            changed(COMPLETE, softer=1.6),
            Status.SUSPECT,
            "Usable, with care: all gears together are 1.60 times as soft as the catalogue's, as",
        ),
        (changed(GOOD, tcp_sigma=0.05e-3), Status.GOOD, "Good fit"),  # a robot that was right
        (
            changed(GOOD, pulled=("rod_compliance", "bd3")),
            Status.SUSPECT,
            "Usable, with care: rod_compliance, bd3 stand more than 3.5 standard deviations from",
        ),
        (
            changed(COMPLETE, autocorrelation=AUTOCORRELATED + 0.01),
            Status.SUSPECT,
            "Usable, with care: neighbouring residuals are correlated (autocorrelation 0.61), so",
        ),
        (
            changed(GOOD, chi2_per_dof=1.44),
            Status.SUSPECT,
            "Usable, with care: the residual is 1.20 times what the noise in the logs explains.",
        ),
        (
            changed(GOOD, chi2_per_dof=0.25),
            Status.SUSPECT,
            "Usable, with care: the residual is 0.50 times what the noise in the logs explains.",
        ),
    ],
)
def test_each_rule_has_its_evidence_and_its_first_words(
    evidence: ClosureEvidence, status: Status, words: str
) -> None:
    verdict = judged(evidence)
    assert verdict.status is status
    assert verdict.sentence.startswith(words)
    assert verdict.acceptable == (status in (Status.GOOD, Status.SUSPECT))


def test_a_strange_mechanism_from_a_fit_that_did_not_converge_is_said_to_be_both() -> None:
    strange = judged(changed(STRANGE, converged=False, iterations=50))
    assert strange.status is Status.IMPLAUSIBLE
    assert "Not converged after 50 iterations; check `robot`" in strange.sentence
    assert "The logs fit a mechanism, but not" in judged(STRANGE).sentence


def test_logs_that_can_be_aligned_in_several_ways_are_ambiguous_and_the_offsets_are_named() -> None:
    verdict = judged(GOOD, replace(RECORDING, start=AMBIGUOUS))
    assert verdict.status is Status.AMBIGUOUS
    assert verdict.sentence.startswith(
        "Ambiguous: 3 ways to align the logs explain them equally well (clock offsets 0.100 s, "
        "7.250 s, 14.500 s)."
    )
    assert not verdict.acceptable


ALL_AT_ONCE = changed(
    STRANGE, converged=False, chi2_per_dof=9.0, autocorrelation=0.9, complete=True, pulled=("bd3",)
)


def test_of_several_rules_the_first_one_speaks() -> None:
    """Each is mended in turn; the next one comes to the fore."""
    recording, evidence = replace(RECORDING, start=AMBIGUOUS), ALL_AT_ONCE
    first_words = []
    for mend in (
        {"geometry": NOMINAL},
        {"converged": True},
        {},
        {"autocorrelation": 0.65},
        {"chi2_per_dof": 1.44},
        {"pulled": ()},
        {"autocorrelation": 0.0},
        {"chi2_per_dof": 1.0},
    ):
        first_words.append(judged(evidence, recording).sentence[:34])
        if not mend:
            recording = RECORDING
        evidence = changed(evidence, **mend)
    first_words.append(judged(evidence, recording).sentence[:34])
    assert first_words == [
        "Not the declared cell: ra2 is +50 ",
        "Not converged after 5 iterations: ",
        "Ambiguous: 3 ways to align the log",
        "Misfit: neighbouring residuals are",
        "Misfit: the residual is 3.0 times ",
        "Usable, with care: bd3 stand more ",
        "Usable, with care: neighbouring re",
        "Usable, with care: the residual is",
        "Good fit: the residual is 1.00 tim",
    ]


@pytest.mark.parametrize(
    ("chi2", "status"),
    [
        (MISFIT + 1e-9, Status.MISFIT),
        (MISFIT, Status.SUSPECT),
        (SUSPECT + 1e-9, Status.SUSPECT),
        (SUSPECT, Status.GOOD),
        (WELL_UNDER, Status.GOOD),
        (WELL_UNDER - 1e-9, Status.SUSPECT),
    ],
)
def test_the_noise_alone_gives_a_status_by_three_limits(chi2: float, status: Status) -> None:
    assert noise_status(chi2) is status


def test_autocorrelation_speaks_only_of_the_complete_model() -> None:
    """Kinematics alone leave what the complete model explains: that is a remark and no misfit."""
    verdict = judged(changed(GOOD, autocorrelation=0.9))
    assert verdict.status is Status.GOOD
    (remark,) = verdict.warnings
    assert remark.startswith("neighbouring residuals are correlated (autocorrelation 0.90): ")
    assert "--model complete" in remark
    assert judged(changed(GOOD, autocorrelation=CORRELATED)).warnings == ()
    assert judged(changed(COMPLETE, autocorrelation=0.5)).warnings == ()


def test_known_lengths_contradict_each_other_only_by_a_size_that_matters() -> None:
    """Lengths stated to a micrometre were a misfit when they disagreed by four."""
    apart = changed(COMPLETE, lengths_apart=2.0 * CONTRADICTION)
    assert judged(changed(apart, lengths_off=0.9 * LITTLE_SHIFT)).status is Status.GOOD
    assert judged(changed(apart, lengths_off=1.1 * LITTLE_SHIFT)).status is Status.MISFIT


def test_known_lengths_that_hardly_agree_are_named_in_a_warning() -> None:
    apart = changed(COMPLETE, lengths_off=2e-5, lengths_named=("ra6", "bd3"))
    assert judged(changed(apart, lengths_apart=DOUBTED)).warnings == ()
    verdict = judged(changed(apart, lengths_apart=DOUBTED + 0.5))
    (warning,) = verdict.warnings
    assert verdict.status is Status.GOOD
    assert "(plate ra6, rod bd3) contradict each other by 2.5 standard deviations" in warning


def test_correlation_is_remarked_on_where_the_samples_tell_it_from_chance() -> None:
    correlated, few = changed(GOOD, autocorrelation=0.08), replace(RECORDING, samples=400)
    assert len(judged(correlated).warnings) == 1
    assert judged(correlated, few).warnings == ()


def test_a_rod_is_remarked_on_beyond_its_own_uncertainty() -> None:
    geometry = NOMINAL.replaced({"bd3": NOMINAL["bd3"] + 3e-3})
    evidence = changed(GOOD, geometry=geometry, sigma={"bd3": 0.0})
    known, unknown = (judged(changed(evidence, sigma={"bd3": s})).warnings for s in (1e-4, 1.5e-3))
    assert known[0].startswith("the rod comes out")
    assert unknown == ()


@pytest.mark.parametrize(
    ("name", "off", "strange"),
    [
        ("ra2", PLAUSIBLE + 1e-9, True),
        ("ra2", PLAUSIBLE - 1e-9, False),
        ("rtheta3", -0.5, True),
        ("bd3", -0.3, True),
        ("ox", 0.5, False),  # where the ball-bar stands is not in the catalogue
        ("rd4", 0.5, False),  # not identified
    ],
)
def test_a_mechanism_is_implausible_by_its_identified_machine_parameters(
    name: str, off: float, strange: bool
) -> None:
    geometry = NOMINAL.replaced({name: NOMINAL[name] + off})
    verdict = judged(changed(GOOD, geometry=geometry))
    assert (verdict.status is Status.IMPLAUSIBLE) == strange
    if strange:
        unit = "mrad" if name == "rtheta3" else "mm"
        assert f"{name} is {off * 1e3:+.0f} {unit} off the catalogue" in verdict.sentence


def test_of_many_implausible_parameters_the_three_worst_are_named() -> None:
    names = ("ra1", "ra2", "ra3", "bd3")
    offsets = dict(zip(names, (0.03, -0.06, 0.04, 0.05), strict=True))
    geometry = NOMINAL.replaced({name: NOMINAL[name] + off for name, off in offsets.items()})
    sentence = judged(changed(GOOD, geometry=geometry, sigma=dict.fromkeys(names, 0.0))).sentence
    assert sentence.startswith(
        "Not the declared cell: ra2 is -60 mm off the catalogue, bd3 is +50 mm off the catalogue, "
        "ra3 is +40 mm off the catalogue. The logs"
    )
    assert CELL.ballbar.title in sentence


def test_the_worst_of_several_recordings_speaks_with_its_name() -> None:
    second = replace(RECORDING, name="second", start=AMBIGUOUS)
    verdict = judged(GOOD, RECORDING, second)
    assert verdict.status is Status.AMBIGUOUS
    assert verdict.sentence.startswith("second: Ambiguous: 3 ways")
    assert judged(GOOD, second, RECORDING).sentence.startswith("Ambiguous: 3 ways")


def test_what_is_wrong_with_the_whole_fit_is_said_once_without_a_name() -> None:
    second = replace(RECORDING, name="second")
    assert judged(STRANGE, RECORDING, second).sentence.startswith("Not the declared cell: ra2")


def test_remarks_of_several_recordings_carry_their_names() -> None:
    first = replace(RECORDING, remarks=("a remark",))
    turned = Start(candidate(0.1, directions=(-1, 1)), (), 1)
    second = Recorded("second", turned, (1, 2), FEW_SAMPLES - 1, ("another",))
    assert judged(GOOD, first).warnings == ("a remark",)
    assert judged(GOOD, first, second).warnings == (
        "first: a remark",
        "second: encoder b1 counts against its declared direction; the identified one is used "
        "(check `sign` in recording.yaml)",
        f"second: only {FEW_SAMPLES - 1} samples in the fit; intervals are optimistic (thesis sec. "
        "3.5 wants 750). Record longer, or raise --samples",
        "second: another",
    )


def test_an_encoder_that_counts_backwards_is_named_by_its_joint() -> None:
    turned = Start(candidate(0.1, directions=(1, -1, 1, -1)), (), 1)
    (second, fifth) = judged(GOOD, Recorded("", turned, (1, 2, 4, 5))).warnings
    assert second.startswith("encoder b2 counts against its declared direction")
    assert fifth.startswith("encoder b5 counts against its declared direction")


def test_statuses_are_ordered_from_worst_to_best_and_their_words_are_those_of_the_files() -> None:
    severities = [status.severity for status in Status]
    assert severities == sorted(severities, reverse=True)
    assert Status.GOOD.severity == 0
    assert [str(status) for status in Status] == [
        "implausible",
        "not converged",
        "ambiguous",
        "misfit",
        "uncertain",
        "suspect",
        "good",
    ]
    assert [status.acceptable for status in Status] == [False] * 5 + [True] * 2


def test_a_clock_that_a_length_hardly_shows_is_said() -> None:
    (good, care) = (judged(GOOD, replace(RECORDING, clock_sigma=(s, 0.0))) for s in (0.009, 0.02))
    assert good.status is Status.GOOD
    assert care.status is Status.SUSPECT
    assert "the clock offset is known to 20 ms at best" in care.sentence


def test_a_named_cause_takes_the_place_of_the_sentence_and_leaves_it_as_a_remark() -> None:
    verdict = judged(STRANGE).with_cause("two columns are exchanged: 3 %, not 90 %. Correct them.")
    assert verdict.sentence == (
        "Not the declared cell: two columns are exchanged: 3 %, not 90 %. Correct them."
    )
    assert verdict.status is Status.IMPLAUSIBLE
    assert verdict.warnings[0] == judged(STRANGE).sentence


@pytest.mark.parametrize(("off", "remarks"), [(2.9e-3, 0), (-3.1e-3, 1)])  # tolerance 3 mm
def test_a_rod_beyond_its_tolerance_is_remarked_on_in_a_good_fit(off: float, remarks: int) -> None:
    verdict = judged(changed(GOOD, geometry=NOMINAL.replaced({"bd3": NOMINAL["bd3"] + off})))
    assert verdict.status is Status.GOOD
    assert len(verdict.warnings) == remarks
    if remarks:
        assert verdict.warnings[0].startswith(
            "the rod comes out 596.90 mm long, and the file of lund_600 states 600.00 mm (bd3); is"
        )


def test_a_recording_that_the_machine_of_the_others_does_not_explain_is_a_misfit() -> None:
    unlike = replace(RECORDING, name="second", held_out=UNLIKE_OTHERS + 1.0)
    verdict = judged(COMPLETE, replace(RECORDING, held_out=1.1), unlike)
    assert verdict.status is Status.MISFIT
    assert verdict.sentence.startswith(
        "second: Misfit: the machine of the other recordings leaves 5.0 times what noise and its"
    )


def test_what_contradicts_a_result_makes_it_no_better_than_usable_with_care() -> None:
    good = Verdict(Status.GOOD, "Good fit.", ("a remark",)).with_care("the tracker is off.")
    assert good == Verdict(Status.SUSPECT, "Usable, with care: the tracker is off.", ("a remark",))
    worse = Verdict(Status.MISFIT, "Misfit.", ()).with_care("the tracker is off.")
    assert worse == Verdict(Status.MISFIT, "Misfit.", ("the tracker is off",))
