"""A stored machine against a recording of a sensed length: what holds, and what is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbar.cell.clock import Clock
from ballbar.cell.logs import LengthLog
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Machine
from ballbar.ident.verification import Verification
from ballbar.ident.verify_recording import verify_recording
from ballbar.sim.true_robot import TrueMachine
from tests.helpers.drawn_lengths import bar_scenario, drawn_machine, identified, moved, recorded
from tests.helpers.drawn_robots import SCENARIOS
from tests.helpers.length_recordings import wire_run

pytestmark = pytest.mark.slow
SEED = 1
DH = FitOptions(model="dh", samples=1000)


@pytest.fixture(scope="module")
def truth() -> TrueMachine:
    return drawn_machine(SEED)


@pytest.fixture(scope="module")
def machine(truth: TrueMachine) -> Machine:
    return identified(truth, SEED)


def verified(
    machine: Machine, truth: TrueMachine, recording: int = 3, **moves: float
) -> Verification:
    """A recording of today, the parameters of the robot or the bar moved by so much."""
    rng = np.random.default_rng([SEED, recording])
    logs = recorded(moved(truth, moves), bar_scenario(SEED, recording), rng)
    return verify_recording(machine, logs)


def kinds(outcome: Verification) -> list[tuple[str, int]]:
    return [(e.cause.kind, e.cause.axis) for e in outcome.named]


def test_an_unchanged_machine_holds(machine: Machine, truth: TrueMachine) -> None:
    outcome = verified(machine, truth)
    assert outcome.holds, outcome.sentence
    assert outcome.named == ()
    assert outcome.blind == {}, "the path shows the zeros of all axes but the first"


@pytest.mark.long
def test_an_unchanged_machine_holds_against_the_result_of_two_recordings(
    truth: TrueMachine,
) -> None:
    """It was called changed in 4 of 4 checks: the tool's length and the zero of the bar were taken
    as exact, and the arm had to take up their errors."""
    both = identified(truth, SEED, recordings=2)
    assert all(verified(both, truth, recording).holds for recording in (3, 4))


def test_the_zero_of_an_axis_is_named_with_its_size(machine: Machine, truth: TrueMachine) -> None:
    """The play of a gear loaded on one side is such a zero too, only a little less likely."""
    outcome = verified(machine, truth, rtheta4=2e-4)
    assert kinds(outcome) == [("axis", 4), ("gear", 4)]
    named, gear = outcome.named
    assert gear.size[1] == pytest.approx(named.size[0], rel=1e-2)
    assert named.size[0] == pytest.approx(2e-4, abs=4.0 * named.sigma[0])


def test_a_longer_tool_is_named_though_its_length_was_taken_as_exact(
    machine: Machine, truth: TrueMachine
) -> None:
    """No machine of this kind explained it, or a link of the arm was named."""
    assert truth.true.table.plate not in machine.names
    outcome = verified(machine, truth, ra6=1e-4)
    assert kinds(outcome) == [("tool", 0)]
    (named,) = outcome.named
    sizes = dict(zip(named.cause.names, named.size, strict=True))
    assert sizes["ra6"] == pytest.approx(1e-4, abs=1.5e-5)
    assert abs(sizes["rd6"]) < 1.5e-5


@pytest.mark.long
def test_a_short_stroke_does_not_tell_zero_and_scale_apart(
    machine: Machine, truth: TrueMachine
) -> None:
    """40 um of a bar of 300 mm are 133 ppm, and its length varies by a quarter of a millimetre."""
    outcome = verified(machine, truth, bd3=4e-5)
    assert sorted(kinds(outcome)) == [("length", 0), ("scale", 0)]
    sizes = {e.cause.kind: float(e.size[0]) for e in outcome.named}
    assert sizes["length"] == pytest.approx(4e-5, abs=5e-6)
    assert sizes["scale"] == pytest.approx(4e-5 / 0.3, rel=0.15)
    assert "zero of the measured length by +4" in outcome.sentence
    assert "; what was measured does not tell which" in outcome.sentence


@pytest.mark.long
def test_two_changes_have_no_single_cause(machine: Machine, truth: TrueMachine) -> None:
    outcome = verified(machine, truth, rtheta4=3e-4, bd3=1e-4)
    assert not outcome.holds
    assert outcome.named == ()
    assert "tool, zero or scale of the length, gear" in outcome.sentence


@pytest.mark.long
def test_a_length_that_hardly_changes_is_not_comparable(
    machine: Machine, truth: TrueMachine, tmp_path: Path
) -> None:
    """Its clock ended elsewhere, and an unchanged machine was called changed."""
    scenario, file = bar_scenario(SEED, 3), tmp_path / "still_rod.yaml"
    assert scenario.path.file
    shape, _, _ = (SCENARIOS / scenario.path.file).read_text().partition("rod:")
    file.write_text(shape)
    path = scenario.path.model_copy(update={"file": str(file)})
    scenario = scenario.model_copy(update={"path": path})
    logs = recorded(truth, scenario, np.random.default_rng([SEED, 3]))
    outcome = verify_recording(machine, logs)
    assert (outcome.comparable, outcome.named) == (False, ())
    assert "perhaps a length that changes too little to tell its clock" in outcome.sentence


@pytest.mark.long
def test_a_wire_tells_its_scale_from_its_zero() -> None:
    """Its length varies by a metre."""
    run = wire_run(Clock(0.3, 5e-5), seed=1)
    machine = identify_together(run.cell, [run.logs], options=DH).machine
    again = wire_run(Clock(0.4, 2e-5), seed=1, motion=2)
    assert verify_recording(machine, again.logs, options=DH).holds
    log = again.logs.length
    assert log is not None
    stretched = replace(again.logs, length=LengthLog(log.t, log.length / (1.0 + 5e-4)))
    (named,) = verify_recording(machine, stretched, options=DH).named
    assert named.cause.kind == "scale"
    assert named.size[0] == pytest.approx(5e-4, abs=4.0 * named.sigma[0])
