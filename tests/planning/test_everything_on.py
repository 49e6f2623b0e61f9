"""Everything on: all error sources of a real cell, one list for scenarios, robots and plans."""

from __future__ import annotations

import pytest

from ballbar.planning.planned_scenario import EVERYTHING_ON, TWO_CLOCKS
from ballbar.scenario import load_scenario
from ballbar.sim.errors.sample_errors import SampleErrors
from ballbar.sim.settings import OF_POSES, ClockSettings, ErrorSettings
from tests.helpers.drawn_robots import scenario_of

# Of the rest, each cell has one and all have all.
FAULTS = {"amplitude_errors", "slipped_periods", "coupling_slips", "outliers", "step", "restart"}
OTHER_SHAPES = {"cycloid_ripple", "sinusoidal_gear_error"}  # of what transmission_error adds
# Each recording has its own, so a held-out one would tell little (docs/validation.md).
OF_A_RECORDING = {"thermal_growth"}
OF_A_LOGGER = {"quantum"}  # whole ms are those of EGM, whose rows have no jitter


def sources(section: type[ErrorSettings | ClockSettings]) -> set[str]:
    left_out = FAULTS | OTHER_SHAPES | OF_A_LOGGER | OF_A_RECORDING
    left_out |= set(SampleErrors.model_fields)
    of_still_poses = {key.removeprefix("errors.") for key in OF_POSES}
    return set(section.model_fields) - left_out - of_still_poses


def given(section: ErrorSettings | ClockSettings) -> dict[str, object]:
    """Values that a section states, without the deviations of a scenario from a table."""
    return section.model_dump(exclude_unset=True, exclude={"static"})


@pytest.mark.parametrize(
    "name", ["irb2400_full", "nj220_full", "irb2400_planned", "nj220_planned", "irb_2016"]
)
def test_every_error_source_of_a_real_cell_is_on(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.errors.model_fields_set == sources(ErrorSettings)
    assert scenario.clocks.model_fields_set == sources(ClockSettings)
    assert given(scenario.errors) == given(ErrorSettings.model_validate(EVERYTHING_ON))
    assert given(scenario.clocks) == given(ClockSettings.model_validate(TWO_CLOCKS))


@pytest.mark.parametrize("robot", ["irb2400", "nj220"])
def test_a_drawn_robot_has_what_a_plan_simulates(robot: str) -> None:
    drawn, planned = scenario_of(robot, "a", 3, 60.0), ErrorSettings.model_validate(EVERYTHING_ON)
    assert drawn.errors == planned
    assert drawn.clocks == ClockSettings.model_validate(TWO_CLOCKS)
