"""A recording of a draw-wire from its files to the result, the report and the replay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ballbar.cell.clock import Clock
from ballbar.result.calibration import load
from tests.helpers.command_line import ballbar
from tests.helpers.length_recordings import LengthRun, wire_run, write_folder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[LengthRun, Path, str]:
    """The true values, the folder of the results, and the text that the command printed."""
    root = tmp_path_factory.mktemp("length")
    run = wire_run(Clock(0.4, 5e-5), seed=7)
    write_folder(run, root / "wire", "drawwire_2m")
    code, out, err = ballbar("identify", root / "wire", "--out", root / "out", "--rerun")
    assert code == 0, err
    return run, root / "out", out


def test_the_calibration_holds_instrument_clock_and_robot(
    identified: tuple[LengthRun, Path, str],
) -> None:
    run, out, _ = identified
    file = load(out / "calibration.yaml").file
    clock = file.logs[0].clock
    assert file.instrument == "drawwire_2m"
    assert clock is not None
    assert clock.offset_s == pytest.approx(run.clock.offset, abs=4.0 * clock.offset_sigma_s)
    assert file.logs[0].noise.length_m == pytest.approx(5e-5, rel=0.1)
    zero = file.parameters["bd3"]
    assert zero.sigma is not None
    assert zero.value - zero.nominal == pytest.approx(run.zero, abs=4.0 * zero.sigma)


def test_report_and_replay_are_written(identified: tuple[LengthRun, Path, str]) -> None:
    _, out, _ = identified
    page = (out / "report.html").read_text()
    assert "on Draw-wire sensor 2 m with its length sensed" in page
    assert (out / "run.rrd").stat().st_size > 10_000


def test_the_result_is_exported(identified: tuple[LengthRun, Path, str]) -> None:
    code, out, err = ballbar("export", identified[1], "--to", "dh")
    assert code == 0, err
    assert "theta" in out


def test_check_shows_the_length_log(identified: tuple[LengthRun, Path, str]) -> None:
    code, out, _ = ballbar("check", identified[1].parent / "wire", "--explain")
    assert code == 0
    assert "instrument drawwire_2m" in out
    assert "length log: " in out


def test_a_result_of_a_length_holds_for_its_own_recording(
    identified: tuple[LengthRun, Path, str],
) -> None:
    out = identified[1]
    code, said, err = ballbar("verify", out, out.parent / "wire")
    assert (code, said.startswith("Holds: the loop closes to ")) == (0, True), said + err


def test_a_wire_that_was_hooked_in_elsewhere_is_named(
    identified: tuple[LengthRun, Path, str], tmp_path: Path
) -> None:
    """The length from its zero to its hook is longer by 0.3 mm, on another path."""
    run, out, _ = identified
    again = wire_run(Clock(0.2, 2e-5), seed=7, zero=run.zero + 3e-4, motion=2)
    write_folder(again, tmp_path / "wire", "drawwire_2m")
    code, said, err = ballbar("verify", out, tmp_path / "wire", "--json")
    assert code == 1, err
    (best, *rest) = json.loads(said)["causes"]
    assert (best["kind"], best["parameters"], best["named"]) == ("length", ["bd3"], True)
    assert best["size"][0] == pytest.approx(3e-4, abs=4.0 * best["sigma"][0])
    assert not any(cause["named"] for cause in rest)
