"""Limits of a scenario: every key can be missed, and every shipped scenario states some."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.errors import DescriptionError
from ballbar.ident.held_out import HeldOut
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import TcpError
from ballbar.ident.verdict import Status
from ballbar.result.compare import Comparison
from ballbar.scenario import OF_EVERY_RUN, SHIPPED, AcceptSettings, load_scenario
from ballbar.sim.truth import Truth
from ballbar.truth.limits import Limit, corrected_limits, plant_limits, result_limits, tcp_limits
from tests.helpers.command_line import SHORT, ballbar

PATHS = str(SHIPPED / "paths")
MOVING = sorted(
    file.stem
    for file in SHIPPED.glob("*.yaml")
    if load_scenario(file).path and file.stem != "irb2400_push_pull"
)

ERROR = TcpError(np.zeros((2, 3)), np.array([1e-5, 3e-5]), np.array([1e-5, 3e-5]))
COMPARISON = Comparison({"ra1": 3e-5, "rd1": 4e-5}, ERROR, ERROR, -7e-6, 3e-7)
FOUND = cast(
    Identification,
    SimpleNamespace(
        robot=SimpleNamespace(tcp_sigma=np.array([2e-5, 3e-5])),
        fit=SimpleNamespace(iterations=8),
        verdict=SimpleNamespace(status=Status.SUSPECT),
    ),
)
TRUTH = Truth.model_construct(
    closure=SimpleNamespace(position_m=8e-8), rod_force=SimpleNamespace(min_N=-110.0, max_N=74.0)
)
HELD = cast(HeldOut, SimpleNamespace(normalised_innovation=1.1))
CORRECTED = ("corrected_mean_mm", "corrected_max_mm")  # of rehearsals
# What the run above comes to, in the unit of each key.
SIZES: dict[str, float] = {
    "tcp_mean_mm": 0.02,
    "tcp_max_mm": 0.03,
    "tcp_sigma_mm": 0.025,
    "tcp_over_stated": 0.8,
    "parameter_distance_mm_mrad": 0.05,
    "clock_offset_us": 7.0,
    "clock_skew_ppm": 0.3,
    "iterations": 8,
    "loop_closure_um": 0.08,
    "rod_force_N": 110.0,
    "held_out_ratio": 1.1,
}


def limits(**accept: Any) -> tuple[Limit, ...]:
    if "held_out_ratio" in accept:
        accept["held_out_file"] = "paths/irb2400_b.yaml"
    chosen = AcceptSettings.model_validate(accept)
    return *result_limits(FOUND, COMPARISON, chosen, [HELD]), *plant_limits(TRUTH, chosen)


@pytest.mark.parametrize("key", CORRECTED)
def test_limits_of_corrected_targets_are_of_their_mean_and_largest(key: str) -> None:
    measured = 0.02 if key == "corrected_mean_mm" else 0.03
    for limit, met in ((1.01 * measured, True), (0.99 * measured, False)):
        chosen = AcceptSettings.model_validate({key: limit})
        (judged,) = corrected_limits(np.array([1e-5, 3e-5]), chosen)
        assert (judged.measured, judged.met) == (pytest.approx(measured), met)


@pytest.mark.parametrize("key", SIZES)
def test_a_limit_is_met_above_what_was_measured_and_missed_below(key: str) -> None:
    step = 1 if key == "iterations" else 0.01 * SIZES[key]
    (met,), (missed,) = limits(**{key: SIZES[key] + step}), limits(**{key: SIZES[key] - step})
    assert met.measured == missed.measured == pytest.approx(SIZES[key])
    assert met.met
    assert not missed.met


def test_no_key_is_without_a_limit() -> None:
    others = {"verdict", "held_out_file", *CORRECTED}
    assert set(SIZES) | others == set(AcceptSettings.model_fields)
    assert set(OF_EVERY_RUN) <= set(AcceptSettings.model_fields)


def test_a_verdict_worse_than_the_limit_misses_it() -> None:
    (met,), (missed,) = limits(verdict="suspect"), limits(verdict="good")
    assert met.met
    assert not missed.met
    assert missed.sizes == ("suspect", "good")


def test_still_poses_have_the_limits_of_the_tool_and_the_verdict() -> None:
    accept = AcceptSettings.model_validate(
        {key: 0.9 * SIZES[key] for key in OF_EVERY_RUN if key != "verdict"} | {"verdict": "good"}
    )
    stated = tcp_limits(FOUND.verdict.status, FOUND.robot.tcp_sigma, COMPARISON, accept)
    assert len(stated) == len(OF_EVERY_RUN)
    assert not any(limit.met for limit in stated)


def test_every_shipped_scenario_can_fail() -> None:
    for file in SHIPPED.glob("*.yaml"):
        accept = load_scenario(file).accept
        assert accept.model_dump(exclude_none=True, exclude_defaults=True), file.name


def test_a_held_out_path_needs_its_limit_and_a_path_to_stand_beside(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    text = SHORT.replace("PATHS", PATHS)
    old = "accept: {tcp_mean_mm: 0.05}"
    file.write_text(text.replace(old, "accept: {held_out_ratio: 1.2}"))
    with pytest.raises(DescriptionError, match="held_out_file and held_out_ratio go together"):
        load_scenario(file)
    pushing = text.replace("kind: lissajous", "kind: push_pull")
    held = f"accept: {{held_out_ratio: 1.2, held_out_file: {PATHS}/irb2400_b.yaml}}"
    file.write_text(pushing.replace(old, held))
    with pytest.raises(
        DescriptionError, match=r"accept.held_out_file = .*: another path needs path.kind"
    ):
        load_scenario(file)


@pytest.mark.long
def test_a_run_tries_the_robot_on_the_held_out_path(tmp_path: Path) -> None:
    """With the kinematic plant; noise of both recordings is drawn equally, their motions differ."""
    file, out = tmp_path / "own.yaml", tmp_path / "out"
    held = f"{{held_out_ratio: 0.5, held_out_file: {PATHS}/irb2400_b.yaml}}"
    file.write_text(SHORT.replace("PATHS", PATHS).replace("{tcp_mean_mm: 0.05}", held))
    code, said, _ = ballbar("run", file, "--out", out)
    assert code == 1
    assert said.startswith("Held out held_out: the loop closes to")
    assert "missed held-out residual over what noise and stated uncertainty explain" in said
    assert (out / "held_out" / "recording.yaml").is_file()
    assert (out / "held_out.truth.yaml").is_file()


def test_simulate_judges_the_plant_alone(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    text = SHORT.replace("PATHS", PATHS).replace("kind: kinematic", "kind: mujoco")
    text = text.replace("duration_s: 40", "duration_s: 60")  # the plant cannot do it in less
    accept = "{tcp_mean_mm: 1.0e-9, rod_force_N: 1.0}"
    file.write_text(text.replace("{tcp_mean_mm: 0.05}", accept))
    code, said, _ = ballbar("simulate", file, "--out", tmp_path / "logs", "--json")
    assert code == 1
    (limit,) = json.loads(said)["limits"]
    assert limit["met"] is False
    assert limit["what"] == "force in the rod, largest"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", MOVING)
def test_a_shipped_scenario_keeps_its_limits(name: str, tmp_path: Path) -> None:
    code, said, err = ballbar("run", name, "--out", tmp_path / "out")
    assert code == 0, said + err
    assert "missed" not in said


def test_pull_and_push_keep_their_limits(tmp_path: Path) -> None:
    """Nothing can be identified from one pose, so the plant alone is judged."""
    code, said, err = ballbar("simulate", "irb2400_push_pull", "--out", tmp_path / "logs")
    assert code == 0, said + err
    assert said.count("met   ") == 2


@pytest.mark.parametrize(
    ("measured", "text"), [(8e-13, "0 um"), (20998.81, "20999 um"), (11.0, "11 um")]
)
def test_a_measured_size_is_shown_without_exponent(measured: float, text: str) -> None:
    assert Limit("", measured, 1.0, "um", True).sizes == (text, "1 um")
