"""The command line in programs and pipes: JSON, quiet, verbose, colours, Ctrl-C, completion."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ballbar.code_version import code_version
from ballbar.commands import cli
from tests.helpers.command_line import SHORT, ballbar, commands
from tests.helpers.simulated_recordings import SCENARIOS

pytestmark = pytest.mark.slow

ESCAPE = "\x1b["
# A shell starts what runs in the background with SIGINT ignored, which is inherited.
HEARS_CTRL_C = """
import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("ballbar", run_name="__main__")
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scenario") / "short.yaml"
    file.write_text(SHORT.replace("PATHS", str(SCENARIOS / "paths")))
    return file


@pytest.fixture(scope="module")
def made(
    scenario: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A run in a process of its own, piped, with every stage reported."""
    folder = tmp_path_factory.mktemp("run") / "out"
    words = ["run", str(scenario), "--out", str(folder), "--json", "--verbose"]
    command = [sys.executable, "-m", "ballbar", *words]
    return folder, subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_json_of_a_run_holds_calibration_comparison_and_limits(
    made: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, done = made
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data["acceptable"] is True
    assert data["files"] == ["calibration.yaml", "import_report.json", "report.html", "run.rrd"]
    assert data["calibration"]["schema"] == "ballbar-calibration/2"
    assert (
        0.0
        < data["comparison"]["tcp_error"]["mean_m"]
        < 5e-5
        < data["comparison"]["tcp_error_nominal"]["mean_m"]
    )
    assert [limit["what"] for limit in data["limits"]] == ["TCP error, mean"]
    assert (
        f"value: {data['calibration']['parameters']['ra1']['value']!r}"
        in (folder / "calibration.yaml").read_text()
    )


def test_verbose_tells_the_stages_on_standard_error(
    made: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    _, done = made
    stages = [re.fullmatch(r" *(\d+\.\d) s  (.+)", line) for line in done.stderr.splitlines()]
    assert all(stages), done.stderr
    assert {"simulating the cell", "fitting", "writing the report"} <= {
        stage[2] for stage in stages if stage
    }
    times = [float(stage[1]) for stage in stages if stage]
    assert times == sorted(times)


def test_compare_says_the_same_in_words_in_json_and_nothing_when_quiet(
    made: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, _ = made
    words = ("compare", folder / "calibration.yaml", folder / "recording.truth.yaml")
    _, said, _ = ballbar(*words)
    _, printed, _ = ballbar(*words, "--json")
    assert f"mean {json.loads(printed)['tcp_error']['mean_m'] * 1e3:.4f} mm" in said
    assert ballbar(*words, "--quiet") == (0, "", "")
    assert ballbar("-q", *words) == (0, "", "")
    assert json.loads(ballbar(*words, "-q", "--json")[1]) == json.loads(printed)
    assert ballbar(*words)[1] == said, "quiet is for one command"
    code, said, told = ballbar("check", folder / "nothing", "--quiet")
    assert (code, said) == (2, "")
    assert "nothing" in told


def test_simulate_and_identify_print_json(
    made: tuple[Path, subprocess.CompletedProcess[str]], scenario: Path, tmp_path: Path
) -> None:
    _, done = made
    _, printed, _ = ballbar("simulate", scenario, "--out", tmp_path / "rec", "--json")
    simulated = json.loads(printed)
    assert (Path(simulated["recording"]) / "recording.yaml").is_file()
    assert Path(simulated["truth"]).is_file()
    _, printed, _ = ballbar("identify", tmp_path / "rec", "--samples", 300, "--json")
    identified, run = json.loads(printed), json.loads(done.stdout)
    assert identified["comparison"] is None
    assert identified["calibration"]["parameters"] == run["calibration"]["parameters"], (
        "the same scenario gives the same logs"
    )


def test_colours_are_for_a_terminal_unless_they_are_forced(
    made: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, piped = made
    assert ESCAPE not in piped.stdout + piped.stderr
    command = [sys.executable, "-m", "ballbar", "check", str(folder / "recording")]
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"FORCE_COLOR": "1"}
    forced = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert forced.returncode == 0
    assert ESCAPE in forced.stdout


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_with_130_and_leaves_nothing_half_written(
    scenario: Path, tmp_path: Path, number: signal.Signals
) -> None:
    """So does the end of a batch job, which left the folder under way for ever."""
    words = ["run", str(scenario), "--out", str(tmp_path / "out"), "--verbose"]
    command = [sys.executable, "-c", HEARS_CTRL_C, *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stderr is not None
        while "fitting" not in running.stderr.readline():
            assert running.poll() is None
        running.send_signal(number)
        said, told = running.communicate(timeout=60.0)
    assert running.returncode == 130
    assert said == ""
    assert "interrupted; no incomplete file was left behind" in told
    assert not list(tmp_path.rglob("*.part"))
    assert not {"calibration.yaml", "report.html", "run.rrd"} & {
        path.name for path in tmp_path.rglob("*")
    }


@pytest.mark.parametrize("command", sorted(commands()))
def test_every_command_has_an_example_and_is_quiet_on_request(command: str) -> None:
    code, said, _ = ballbar(*command.split(), "--help")
    assert code == 0
    assert f"ballbar {command} " in said.split("Example")[1]
    assert "--quiet" in said
    assert "--verbose" in said
    if command not in ("replay", "robot show"):  # these show something, and have no result
        assert "--json" in said


def test_the_version_is_that_of_the_code() -> None:
    assert ballbar("--version") == (0, f"ballbar {code_version()}\n", "")


def test_completion_knows_the_commands(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for key, value in (
        ("_BALLBAR_COMPLETE", "complete_bash"),
        ("COMP_WORDS", "ballbar ident"),
        ("COMP_CWORD", "1"),
    ):
        monkeypatch.setenv(key, value)
    with pytest.raises(SystemExit, match=r"^0$"):
        cli.app(args=[], prog_name="ballbar")
    assert capsys.readouterr().out.split() == ["identify", "identifiability"]
