"""Stand-ins for the work of one run of a sweep; worker processes import them from here."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.scenario import Scenario
from ballbar.sim.streams import stream


def figures(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """Numbers that follow from the scenario and its seed alone."""
    rng = stream(scenario.seed, "figures")
    sigma = scenario.errors.joint_noise.sigma_rad if scenario.errors.joint_noise else 0.0
    return {
        "distance_mm_mrad": sigma * 1e3 * float(rng.normal()),
        "rows": scenario.seed,
        "cost": scenario.identify.cost,
    }


def figures_with_failures(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """Same as `figures`; seeds 2 to 5 fail in three ways, and seed 6 has one figure more."""
    if scenario.seed == 2:
        raise InputError(
            f"{folder / scenario.path.file}: no motion\nin {scenario.path.duration_s:g} s"
        )
    if scenario.seed == 3:
        raise ZeroDivisionError("division by zero")
    if scenario.seed in (4, 5):
        raise InputError(
            f"no motion at {scenario.cell.ballbar_position_m[0]:g} m in {scenario.seed} s"
        )
    return figures(scenario, folder) | ({"extra": 1.5} if scenario.seed == 6 else {})


def figures_or_death(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """Same as `figures`; one seed ends its process, as too little memory would."""
    if scenario.seed == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return figures(scenario, folder)


def path_text(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """Content of the scenario's path file, for a worker that has only what was sent to it."""
    return {"text": (folder / scenario.path.file).read_text()}


def no_such_file(scenario: Scenario, folder: Path) -> dict[str, float | int | str]:
    """Fails with a sentence that names the path file twice, through folders of this machine."""
    file = folder / scenario.path.file
    raise DescriptionError(f"{file} and {file.resolve()}: no such file.")
