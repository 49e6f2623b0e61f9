"""The masses that a fit used, in calibration.yaml."""

from __future__ import annotations

import numpy as np
import pytest

from ballbar.result.machine_entries import MassesEntry, masses_entry
from cell.load import load_cell
from cell.payload import payload_of, with_payload
from ident.loads.payload import PayloadEstimate


def test_the_masses_of_a_fit_are_those_of_its_file() -> None:
    """Also where none is beside its tolerance: the unloaded robot sags under them."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    deviations = 0.01 * np.random.default_rng(5).standard_normal(28)
    estimate = PayloadEstimate(
        payload=payload_of(cell, deviations, 1.02),
        stated=cell.plate.body.mass,
        mass_sigma=0.1,
        arm_sigma=0.01,
        added_load=np.zeros(6),
        significant=False,
        covariance=np.eye(28),
    )
    entry = masses_entry(estimate)
    assert entry is not None
    read = MassesEntry.model_validate_json(entry.model_dump_json(), strict=False)
    used, again = (with_payload(cell, p) for p in (estimate.payload, read.payload))
    pairs = zip(
        (*used.robot.required("links"), used.plate.body),
        (*again.robot.required("links"), again.plate.body),
        strict=True,
    )
    for before, after in pairs:
        assert after.mass == before.mass
        assert np.array_equal(after.com, before.com)
        assert np.array_equal(after.inertia, before.inertia)
    assert again.robot.required("links")[2].com != pytest.approx(
        cell.robot.required("links")[2].com, abs=1e-4
    )


def test_a_fit_with_the_masses_of_the_files_holds_none() -> None:
    assert masses_entry(None) is None
