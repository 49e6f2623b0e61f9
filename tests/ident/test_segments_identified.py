"""A log of several segments is identified as the undisturbed one would be."""

from pathlib import Path

import numpy as np
import pytest

from ballbar.acquisition.recording import read_recording
from ballbar.ident.options import FitOptions
from tests.helpers.clock_truth import clock_error
from tests.helpers.one_recording import identify
from tests.helpers.simulated_recordings import record

RESET = 9_000_000  # counts, 3.8 rad


def test_a_clock_set_back_and_a_counter_reset_leave_the_alignment_within_100_us(
    tmp_path: Path,
) -> None:
    clocks = {
        "offset_s": 0.137,
        "skew": 2e-4,
        "wander": {"rate_rms_ppm": 0.5},
        "step": {"at_s": 36.0, "step_s": -0.04},
    }
    done = record(tmp_path / "recording", plant={"kind": "kinematic"}, clocks=clocks)
    file = done.folder / "raw/ballbar.csv"
    lines = file.read_bytes().decode().splitlines()
    for k in range(1500, len(lines)):  # b1 behind row 1500: C-reset, say
        cells = lines[k].split(";")
        cells[1] = str((int(cells[1]) + RESET) % 2**32)
        lines[k] = ";".join(cells)
    file.write_bytes(("\r\n".join(lines) + "\r\n").encode())
    read = read_recording(done.folder)
    assert [f.kind for f in read.report.findings if "overrun" not in f.kind] == [
        "counter jumped",
        "clock set back",
    ]
    found = identify(
        done.simulation.cell, read.robot_log, read.ballbar_log, options=FitOptions(samples=600)
    )
    assert np.abs(clock_error(done.simulation, found)).max() < 100e-6
    (recording,) = found.recordings
    (jump,) = [fault for fault in recording.step_faults if fault.kind == "encoder"]
    sign = read.description.encoders["b1"].sign * recording.directions[0]
    assert jump.joint == 1
    assert jump.size == pytest.approx(sign * RESET * 2 * np.pi / (3600 << 12), abs=1e-5)
