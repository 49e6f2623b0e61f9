"""A recording of a draw-wire from its files to the result, the report and the replay."""

from __future__ import annotations

from pathlib import Path

import pytest

from ballbar.result.calibration import load_calibration
from cell.clock import Clock
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
    file = load_calibration(out / "calibration.yaml").file
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


def test_a_length_is_not_verified_but_validated(identified: tuple[LengthRun, Path, str]) -> None:
    out = identified[1]
    code, _, err = ballbar("verify", out, out.parent / "wire")
    assert code == 2
    assert "Take `ballbar identify --validate" in err
