"""Fixtures of the identification's tests: a mechanism that is off, a minute of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, bar_frames
from ballbar.cell.inverse import refine
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.identify import identify_together
from ballbar.ident.recording_fit import Logs
from ballbar.ident.result import Identification
from ballbar.sim.truth import Truth
from tests.helpers.drawn_robots import recorded as logs_of
from tests.helpers.drawn_robots import scenario_of
from tests.helpers.simulated_recordings import perturbed
from tests.helpers.synthetic_recording import Loop, recording
from tests.helpers.tracker_points import still_points


@pytest.fixture(scope="session")
def loop(nominal: Geometry) -> Loop:
    rng = np.random.default_rng(20)
    b = rng.uniform(-0.5, 0.5, (9, 5)) + np.array([-0.4, -0.9, 0.3, -2.2, 2.4])
    start = np.array([-0.13, 0.4, 0.16, -0.17, -1.0, 2.3]) + np.zeros((9, 6))
    q = refine(nominal.robot, start, bar_frames(nominal, b).poses(), iterations=60)
    return Loop(perturbed(nominal, rng, 0.02), q, b)


@pytest.fixture(scope="session")
def noisy() -> Samples:
    """A minute of the nominal mechanism with 10 urad of white noise on every angle."""
    return recording(noise=1e-5)


@pytest.fixture(scope="session")
def drawn_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Cell, Logs, Truth]:
    """A recording of a drawn robot with everything on, beside which still poses are fitted."""
    return logs_of(scenario_of("irb2400", "a", 3, 90.0), tmp_path_factory.mktemp("drawn"))


@pytest.fixture(scope="session")
def drawn_mixed(drawn_run: tuple[Cell, Logs, Truth]) -> Identification:
    """The robot that they identify with a tracker's points, one of which is off by 20 mm."""
    cell, logs, truth = drawn_run
    table = still_points(cell, truth, 3)
    (group,) = table.groups
    values = group.values.copy()
    values[4, 1] += 0.02
    off = replace(table, groups=(replace(group, values=values),))
    return identify_together(cell, [logs], off)


@pytest.fixture(scope="session")
def drawn_alone(drawn_run: tuple[Cell, Logs, Truth]) -> Identification:
    """The robot that its recording alone identifies."""
    cell, logs, _ = drawn_run
    return identify_together(cell, [logs])
