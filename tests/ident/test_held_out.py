"""Held-out validation: what a machine's stated uncertainty makes of another recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.geometry import Geometry
from ballbar.cell.logs import BallBarLog
from ballbar.ident.held_machine import LoopClosure
from ballbar.ident.held_out import HeldOut, held_out
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions, Listener
from ballbar.ident.result import Identification
from ballbar.ident.signals.steps import StepFault
from tests.helpers.minute_logs import TRUE, minute_logs
from tests.helpers.synthetic_recording import CELL

FEW, MANY = FitOptions(model="dh", samples=60), FitOptions(model="dh", samples=300)


def identified(seed: int, options: FitOptions = FEW, **plants: object) -> Identification:
    return identify_together(CELL, [minute_logs(seed=seed, **plants)], options=options)


@pytest.fixture(scope="module")
def machine() -> Identification:
    return identified(1, MANY, true=TRUE)


def test_the_machine_explains_another_recording_of_it(machine: Identification) -> None:
    """Its own encoder offsets, base and clock are fitted: the ball-bar stands elsewhere."""
    moved = TRUE.replaced({"btheta2": 0.3, "btheta5": -0.2})
    outcome = held_out(machine, minute_logs(true=moved, seed=2, name="b"), options=MANY)
    assert outcome.acceptable
    assert outcome.name == "b"
    assert outcome.normalised_innovation == pytest.approx(1.0, abs=0.1)
    assert outcome.identified.position_rms < 3e-5  # 10 um of noise, three components
    assert outcome.nominal.position_rms > 1e-4
    assert outcome.identified.position_max >= outcome.identified.position_rms
    assert outcome.samples == machine.recordings[0].samples
    assert outcome.step_faults == ()
    assert not outcome.ambiguous


def with_identified(result: Identification, **changes: object) -> Identification:
    """The result with another identified robot."""
    identified = replace(result.robot.identified, **changes)
    return replace(result, robot=replace(result.robot, identified=identified))


def test_a_machine_that_is_off_is_a_misfit(machine: Identification) -> None:
    robot = machine.robot
    off = robot.geometry.replaced({"ra2": robot.geometry["ra2"] + 5e-4})
    wrong = with_identified(machine, geometry=off)
    outcome = held_out(wrong, minute_logs(true=TRUE, seed=2), options=MANY)
    assert not outcome.acceptable
    assert outcome.normalised_innovation > 3.0


@pytest.mark.long
@pytest.mark.slow
def test_the_expected_chi_square_is_what_the_machines_errors_add_on_average() -> None:
    """A machine of 60 samples on 300 others, against the same machine with its true geometry.

    What is added is chi-square of 21 parameters, so 6 pairs of recordings scatter by a tenth. The
    noise is white, and so is the covariance that stands for the stated one.
    """
    added, expected = [], []
    for seed in range(6):
        machine, logs = identified(2 * seed), minute_logs(seed=2 * seed + 1)
        stated, tool = machine.robot.covariance, machine.robot.tool
        white = replace(
            tool, names=stated.names, values=stated.white, masses=tool.masses[:0], held=()
        )
        machine = with_identified(machine, stated=white)
        outcome = held_out(machine, logs, options=MANY)
        exact = with_identified(machine, geometry=machine.robot.nominal)
        perfect = held_out(exact, logs, options=MANY)
        added.append(outcome.identified.ratio**2 - perfect.identified.ratio**2)
        expected.append((outcome.identified.ratio / outcome.normalised_innovation) ** 2 - 1.0)
    assert min(expected) > 0.03  # of chi-square: 60 samples say a fifth of what 300 do
    assert 0.7 < np.mean(added) / np.mean(expected) < 1.3


def test_a_slip_in_the_held_out_recording_is_found_by_the_complete_model_only() -> None:
    """The residual of a poor model passes for steps, so kinematics alone do not look for them."""
    options = FitOptions(model="complete", corrections=("gear_ripple",), samples=300)
    slipped = minute_logs(seed=4, ripple=1e-4, slip=(4, 30.0, 4e-4))
    complete = identified(3, options, ripple=1e-4)
    outcome = held_out(complete, slipped, options=options)
    (fault,) = outcome.step_faults
    assert (fault.kind, fault.joint) == ("encoder", 4)
    assert fault.size == pytest.approx(4e-4, abs=2e-5)
    assert outcome.acceptable
    simple = held_out(identified(3, MANY), slipped, options=MANY)
    assert simple.step_faults == ()


def test_a_held_out_recording_that_is_no_fit_names_the_cause(machine: Identification) -> None:
    sound = minute_logs(true=TRUE, seed=2)
    assert sound.ballbar is not None
    bar = sound.ballbar
    exchanged = BallBarLog(bar.t, bar.angles[:, [1, 0, 2, 3]], bar.joints)
    outcome = held_out(machine, replace(sound, ballbar=exchanged), options=MANY)
    assert not outcome.acceptable
    assert " Perhaps the columns of encoders b1 and b2 are exchanged: once " in outcome.sentence


def test_the_identification_is_left_as_it_was(machine: Identification) -> None:
    before = machine.robot.geometry.values.copy()
    stages: list[str] = []
    held_out(
        machine, minute_logs(true=TRUE, seed=5, name="c"), options=MANY,
        listener=Listener(stages.append),
    )  # fmt: skip
    geometry: Geometry = machine.robot.geometry
    assert np.array_equal(geometry.values, before)
    assert stages[-1] == "closing the loop of c"


CLOSURE = LoopClosure(position_rms=1.234e-5, position_max=4.2e-5, angle_rms=0.0, ratio=1.02)
NOMINAL_CLOSURE = replace(CLOSURE, position_rms=1.67e-3)
OUTCOME = HeldOut("run_2", CLOSURE, 0.98, NOMINAL_CLOSURE, 300, False, ())


def test_sizes_are_stated_with_two_digits_and_their_units() -> None:
    assert CLOSURE.sentence == "0.012 mm rms (largest 0.042), 0 mrad"
    assert OUTCOME.sentence == (
        "Held out run_2: the loop closes to 0.012 mm rms (largest 0.042), 0 mrad; nominal robot "
        "1.7 mm. 1.0 times what noise explains, 0.98 with the stated uncertainty."
    )


def test_an_angle_of_rounding_is_stated_as_zero() -> None:
    """A sensed length closes no angle; the rest of rounding was 0.00000000000024 mrad."""
    assert replace(CLOSURE, angle_rms=2.4e-16).sentence.endswith(", 0 mrad")


def test_a_misfit_and_an_ambiguous_alignment_are_said() -> None:
    misfit = replace(OUTCOME, normalised_innovation=1.5)
    assert not misfit.acceptable
    assert misfit.sentence.endswith(
        ": a misfit. The machine as identified does not explain this recording."
    )
    assert not replace(OUTCOME, ambiguous=True).acceptable
    doubtful = replace(misfit, ambiguous=True)
    assert doubtful.sentence.endswith("in more than one way, so this proves nothing.")
    assert "misfit" not in doubtful.sentence


def test_a_held_out_recording_with_a_repaired_fault_is_acceptable() -> None:
    faulty = replace(OUTCOME, step_faults=(StepFault(0, "clock", 0, 3.0, 0.1),))
    assert faulty.acceptable
