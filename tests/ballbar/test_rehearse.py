"""`ballbar rehearse`: the whole day at small size, and the pieces of it that can fail."""

from __future__ import annotations

import json
import socket
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import yaml

from ballbar.acquisition.recording import read_recording
from ballbar.cell.arrays import Array
from ballbar.cell.egm_file import FILE_START, frame
from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.files import write_yaml
from ballbar.cell.load import load_robot
from ballbar.ident.robot.inverse_calibration import TargetError
from ballbar.plan.show import PlanOptions
from ballbar.planning.request import PlanRequest
from ballbar.rehearsal import files, second_path, targets
from ballbar.rehearsal.day import Day, Rehearsal, Stage
from ballbar.rehearsal.files import OUTPUTS, chain, rehearsal_page, rehearse_into
from ballbar.rehearsal.live import LivePath, as_recorded, check_fault, record_live
from ballbar.rehearsal.second_path import plan_second_path, request_data
from ballbar.rehearsal.targets import HeldTargets, correctable
from ballbar.run import simulate_scenario
from ballbar.scenario import Scenario, load_scenario, scenario_file
from ballbar.sim.live.delivery import EgmRobot, Pace
from ballbar.sim.live.device_logs import device_logs
from ballbar.sim.live.faults import OF_ENCODERS, OF_TRACKER
from ballbar.truth.limits import corrected_limits
from ballbar.watch.state import Alarm
from tests.helpers.command_line import ballbar
from tests.helpers.simulated_recordings import CLOCK, record

IRB, UR = "irb2400", "ur10e_telescoping"


def a_stage(name: str, *, met: bool = True, **figures: object) -> Stage:
    return Stage(name, f"what came of it: {name}", met, 1.25, figures)


def a_day(scenario: Scenario) -> Rehearsal:
    """A rehearsal of invented figures."""
    found = {"mean": 1e-5, "rms": 1e-5, "max": 3e-5, "rms_without_scale": 1e-5}
    identified = {"tcp_sigma_m": 2e-5, "true_tcp_error_m": found}
    states = [{"recorded_s": t, "tcp_sigma_m": 1e-3 / t} for t in (10.0, 20.0, 40.0)]
    held = HeldTargets(*(np.linspace(0.5, 1.0, 50) * size for size in (3e-3, 2e-5, 1e-5)))
    day = begun(scenario, Path())
    day.stages += [a_stage("identify path1", **identified), a_stage("verify with path3")]
    day.paths["path1"] = LivePath(Pace(10.0), seconds=40.0, states=states)
    return Rehearsal(day, corrected_limits(held.after, scenario.accept), 2.5e-3, held)


def begun(scenario: Scenario, out: Path) -> Day:
    command = "ballbar rehearse irb2400 --out /home/someone/x"
    return Day(scenario, scenario_file(IRB), out, 10.0, None, command, print, progress=print)


@pytest.mark.slow
def test_the_page_names_each_step_and_what_was_missed() -> None:
    day = a_day(load_scenario(IRB))
    page = rehearsal_page(day)
    assert "As required" in page
    assert "what came of it: identify path1" in page
    assert "/home" not in page
    day.day.stages.append(a_stage("verify with path3", met=False))
    page = rehearsal_page(day)
    assert "Not as required: verify with path3" in page


def test_the_chain_is_plain_data_and_a_missed_limit_makes_it_unacceptable() -> None:
    scenario = load_scenario(IRB)
    day = a_day(scenario)
    data = json.loads(json.dumps(chain(day)))
    assert data["acceptable"]
    assert [stage["name"] for stage in data["stages"]] == ["identify path1", "verify with path3"]
    assert {limit["what"]: limit["measured"] for limit in data["limits"]} == {
        "corrected targets in the plant, mean": pytest.approx(0.015),
        "corrected targets in the plant, largest": pytest.approx(0.02),
    }
    accept = scenario.accept.model_copy(update={"corrected_max_mm": 0.019})
    assert not replace(day, limits=corrected_limits(day.held.after, accept)).acceptable


def test_an_alarm_counts_as_noticed_once_the_fault_has_begun() -> None:
    alarms = {str(t): Alarm(f"kind{t:.0f}", "sentence", t) for t in (30.0, 61.0, 62.0)}
    path = LivePath(Pace(1.0), fault="slip", began=60.0, shows=60.0, alarms=alarms)
    assert path.noticed == alarms["61.0"]
    assert replace(path, began=63.0).noticed is None
    assert LivePath(Pace(1.0), alarms=alarms).noticed is None


@pytest.mark.parametrize("name", OF_ENCODERS)
def test_a_fault_of_encoders_is_refused_where_there_are_none(name: str) -> None:
    check_fault(load_scenario(IRB), name)
    with pytest.raises(InputError, match=f"--fault {name}: needs a ball-bar with encoders"):
        check_fault(load_scenario(UR), name, relative_to=scenario_file(UR).parent)


@pytest.mark.parametrize("name", OF_TRACKER)
def test_a_fault_of_a_tracker_is_refused_where_there_is_none(name: str) -> None:
    check_fault(load_scenario("ur10e_mocap"), name)
    with pytest.raises(InputError, match=f"--fault {name}: needs a tracker"):
        check_fault(load_scenario(IRB), name)


def test_a_tracker_is_delivered_alone_and_beside_a_ballbar() -> None:
    assert as_recorded(load_scenario("ur10e_mocap")).logs.tracker is not None
    beside = load_scenario(IRB, overrides=["logs.tracker={}"])
    assert as_recorded(beside).logs.tracker is not None


def test_an_unknown_fault_is_refused_with_the_list() -> None:
    code, _, error = ballbar("rehearse", IRB, "--fault", "gremlins")
    assert code == 2
    assert "--fault gremlins: is no fault. There are encoder_frozen, motor_frozen" in error


@pytest.mark.parametrize("name", [IRB, UR])
def test_the_second_path_is_planned_for_the_cell_and_times_of_the_first(name: str) -> None:
    file, scenario = scenario_file(name), load_scenario(name)
    data = request_data(scenario, file.parent)
    request = PlanRequest.model_validate(data, strict=False)
    assert request.cell.robot == scenario.cell.robot
    assert request.telescoping == (scenario.cell.instrument is not None)
    assert request.timing.duration_s == scenario.path.duration_s
    lower, upper = np.array(request.cell.region)
    assert (lower < scenario.cell.ballbar_position_m).all()
    assert (upper > scenario.cell.ballbar_position_m).all()


def test_the_devices_of_a_ballbar_deliver_torque_but_no_force() -> None:
    given = load_scenario("irb2400_full")
    scenario = as_recorded(given)
    assert scenario.logs.torque == given.logs.torque is not None
    assert scenario.logs.force_sensor is None
    assert as_recorded(load_scenario(IRB)).logs.torque is None
    assert scenario.encoders.directions == "unknown"


def test_a_rehearsal_that_breaks_off_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object, **__: object) -> None:
        raise FailureError("the recorder did not reach the simulated PLC")

    monkeypatch.setattr(files, "rehearse", breaks)
    out = tmp_path / "out"
    out.mkdir()
    (out / "rehearsal.json").write_text("{}")
    with pytest.raises(FailureError):
        rehearse_into(begun(load_scenario(IRB), out))
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]
    assert (out / "rehearsal.json").read_text() == "{}"


def test_ctrl_c_while_the_day_plans_ends_the_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`plan` keeps its best path; the day went on with it for 41 s and ended with 0."""

    def stopped(_: object, __: object, options: PlanOptions) -> bool:
        write_yaml(options.folder / "plan.yaml", {"search": {"stopped": True}, "tcp_sigma_m": {}})
        return True

    monkeypatch.setattr(second_path, "make_plan", stopped)
    named = scenario_file(IRB).parent
    with pytest.raises(KeyboardInterrupt):
        plan_second_path(load_scenario(IRB), tmp_path, tmp_path / "result1", named)


def test_targets_of_the_day_are_those_that_no_check_refuses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A day ended with a target out of reach, which shows once singular ones are left out."""
    reasons = iter([{1: "at a singularity"}, {0: "out of reach", 2: "out of reach"}, {}])

    def refuse(robot: object, nominal: object, q: Array) -> None:
        if faults := next(reasons):
            raise TargetError(faults)

    monkeypatch.setattr(targets, "corrected_targets", refuse)
    assert correctable(MagicMock(), np.arange(5.0)[:, None])[:, 0].tolist() == [2.0, 4.0]


@pytest.mark.long
def test_a_simulated_controller_sends_what_the_robots_log_holds(tmp_path: Path) -> None:
    """Angles and torques of its messages, read with their dialect, are those of the log in rad."""
    made = record(tmp_path / "made", logs={"torque": {}})
    given = read_recording(made.folder).robot_log
    log = device_logs(made.folder, CLOCK)["robot"]
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        pace = Pace(30.0)
        with EgmRobot(receiver.getsockname()[1], log, load_robot("irb2400"), pace) as robot:
            robot.start()
            pace.start()
            messages = [receiver.recv(65536) for _ in log.t]
            assert robot.wait(5.0)
    file = made.folder / "raw" / "robot.egm"
    file.write_bytes(FILE_START + b"".join(map(frame, messages)))
    description = yaml.safe_load((made.folder / "recording.yaml").read_text())
    description["sources"]["robot"] = {"files": ["raw/robot.egm"], "dialect": "abb-egm-torque"}
    (made.folder / "recording.yaml").write_text(yaml.safe_dump(description))
    sent = read_recording(made.folder).robot_log
    assert sent.torque is not None
    np.testing.assert_allclose(sent.q, given.q, atol=1e-9)
    np.testing.assert_allclose(sent.torque, given.torque, rtol=1e-9, atol=1e-9)
    assert np.abs(sent.torque).max() > 100.0  # [N m] the weight of the arm


@pytest.mark.long
def test_files_that_grow_hold_the_recording_in_the_end_and_a_fault_from_its_instant_on(
    tmp_path: Path,
) -> None:
    file = scenario_file(UR)
    changes = ["path.duration_s=40", "path.stops=0", "logs.robot.rate_hz=100"]
    scenario = as_recorded(load_scenario(UR, overrides=changes))
    simulated = tmp_path / "simulated"
    simulate_scenario(scenario, file, simulated, progress=lambda _: None)
    live = {
        fault: record_live(
            simulated,
            scenario,
            folder=tmp_path / str(fault),
            relative_to=file.parent,
            speed=20.0,
            fault=fault,
            identify=False,
        )
        for fault in (None, "motor_frozen")
    }
    for log in ("robot.csv", "length.csv"):
        sound = (tmp_path / "None" / "raw" / log).read_text()
        assert sound == (simulated / "raw" / log).read_text()
    assert not live[None].fault
    began = live["motor_frozen"].began
    rows = [
        np.loadtxt(tmp_path / name / "raw" / "robot.csv", delimiter=",", skiprows=1)
        for name in ("None", "motor_frozen")
    ]
    since = rows[0][:, 0] - rows[0][0, 0]
    changed = np.abs(rows[1] - rows[0]).max(axis=1) > 0.0
    assert not changed[since < began].any()
    assert changed[since > began + 1.0].all()


@pytest.mark.long
def test_a_day_of_short_paths_comes_out_as_required(tmp_path: Path) -> None:
    """With a slip, which is noticed; every step of the day is in the folder."""
    out = tmp_path / "day"
    code, said, error = ballbar(
        "rehearse", IRB, "--fault", "slip", "--set", "path.duration_s=80", "--out", out
    )
    assert code == 0, said + error
    assert {entry.name for entry in out.iterdir()} == OUTPUTS
    data = json.loads((out / "rehearsal.json").read_text())
    stages = {stage["name"]: stage["figures"] for stage in data["stages"]}
    assert data["acceptable"]
    assert stages["record with a fault"]["fault"] == "slip"
    assert stages["record with a fault"]["alarm"]["kind"] in ("misfit", "step")
    assert stages["record path1"]["lost"] == stages["record path2"]["lost"] == 0
    stated = [stages[f"identify {name}"]["tcp_sigma_m"] for name in ("path1", "path1 and path2")]
    assert stated[1] < stated[0]
    held = stages["hold them in the plant"]
    assert held["corrected_targets_m"]["mean"] < 0.01 * held["nominal_targets_m"]["mean"]
    assert (out / "result" / "report.html").exists()


@pytest.mark.long
def test_a_day_with_a_tracker_that_follows_comes_out_as_required(tmp_path: Path) -> None:
    """A lost target is noticed; no path is planned, and the others are recorded from files."""
    out = tmp_path / "day"
    changes = ("path.duration_s=60", "path.stops=0", "accept.tcp_max_mm=0.4")
    words = [word for change in changes for word in ("--set", change)]
    code, said, error = ballbar(
        "rehearse", "ur10e_mocap", "--fault", "tracker_frozen", *words, "--out", out
    )
    assert code == 0, said + error
    assert {entry.name for entry in out.iterdir()} == OUTPUTS - {"plan", "request.yaml"}
    data = json.loads((out / "rehearsal.json").read_text())
    stages = {stage["name"]: stage["figures"] for stage in data["stages"]}
    assert stages["record with a fault"]["alarm"]["kind"] == "frozen channel"
    assert stages["record path1"]["lost"] == stages["record path2"]["lost"] == 0
    held = stages["hold them in the plant"]
    assert held["corrected_targets_m"]["mean"] < 0.3 * held["nominal_targets_m"]["mean"]
    assert "plan.svg" not in (out / "rehearsal.html").read_text()
