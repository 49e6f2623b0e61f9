"""Lines of device logs whose angles are known, and recording folders made of them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from ballbar.acquisition.flags import RowFlag
from ballbar.acquisition.recording import Recording
from ballbar.cell.load import load_robot
from ballbar.cell.robot_angles import joints_to_motors

ROBOT = load_robot("irb2400")
EPOCH = 1_100_000_000_000_000_003  # [ns]
PER_RAD = 3600 * 2**12 / (2 * np.pi)
ROBOT_T = 0.004032 * np.arange(800)
BAR_T = 0.01 * np.arange(300)
SIGNS = {"b1": 1, "b2": -1, "b4": 1, "b5": -1}


def joint_trajectory(t: np.ndarray) -> np.ndarray:
    """(N, 6) [rad] a trajectory within limits and speeds."""
    return np.stack(
        [0.2 * (i - 2.5) + 0.4 * np.sin((0.5 + 0.1 * i) * t + i) for i in range(6)], axis=1
    )


def bar_trajectory(t: np.ndarray) -> np.ndarray:
    """(N, 4) [rad] of b1, b2, b4, b5, through the zero of the counter."""
    return np.stack([0.3 * np.sin(0.8 * t + i) - 0.1 for i in range(4)], axis=1)


def robot_lines(t: np.ndarray = ROBOT_T) -> list[str]:
    motors = joints_to_motors(ROBOT, joint_trajectory(t))
    return [
        "time,m1,m2,m3,m4,m5,m6",
        *(",".join(map(repr, row)) for row in np.column_stack((100.0 + t, motors)).tolist()),
    ]


def bar_lines(t: np.ndarray = BAR_T) -> list[str]:
    counts = (
        np.rint(bar_trajectory(t) * list(SIGNS.values()) * PER_RAD)
        .astype(np.int64)
        .astype(np.uint32)
        .astype(np.int64)
    )
    stamps = EPOCH + np.rint(t * 1e9).astype(np.int64)
    return [
        "time;b1;b2;b4;b5",
        *(";".join(map(str, row)) for row in np.column_stack((stamps, counts)).tolist()),
    ]


def description() -> dict:
    return {
        "schema": "ballbar-recording/1",
        "kind": "real",
        "robot": "irb2400",
        "ballbar": "lund_600",
        "sources": {
            "robot": {"files": ["raw/robot.csv"], "dialect": "abb-motor"},
            "ballbar": {"files": ["raw/ballbar.csv"], "dialect": "twincat-plc"},
        },
        "encoders": {
            name: {"column": name, "lines": 3600, "bits": 12, "sign": sign}
            for name, sign in SIGNS.items()
        },
    }


def write(
    folder: Path,
    *,
    robot: list[str] | None = None,
    ballbar: list[str] | None = None,
    change: Callable[[dict], object] = id,
) -> Path:
    data = description()
    change(data)
    (folder / "raw").mkdir(exist_ok=True)
    (folder / "recording.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    (folder / "raw/robot.csv").write_text("\n".join(robot or robot_lines()) + "\n")
    (folder / "raw/ballbar.csv").write_text(
        "\r\n".join(ballbar or bar_lines()) + "\r\n", newline=""
    )
    return folder


def summaries(recording: Recording) -> list[tuple[str, str, str, tuple[int, ...], int]]:
    """Findings other than the missing status columns, which these recordings do not have."""
    findings = [entry for entry in recording.report.findings if entry.kind != "no status word"]
    return [
        (entry.kind, entry.severity, entry.file, entry.lines, entry.count) for entry in findings
    ]


def flagged(recording: Recording, flag: RowFlag) -> list[int]:
    """Rows of the ball-bar's log that have a flag, counted from 0."""
    assert recording.ballbar_log is not None
    assert recording.ballbar_log.flags is not None
    return np.flatnonzero(recording.ballbar_log.flags & np.uint32(flag)).tolist()


def motor_rows(motors: np.ndarray) -> list[str]:
    return [
        robot_lines()[0],
        *(",".join(map(repr, row)) for row in np.column_stack((ROBOT_T, motors)).tolist()),
    ]


def change_line(lines: list[str], number: int, text: str) -> list[str]:
    return [*lines[: number - 1], text, *lines[number:]]


def stamped(row: str, stamp: object) -> str:
    separator = ";" if ";" in row else ","
    return separator.join((str(stamp), *row.split(separator)[1:]))


def put(*keys: str, value: object) -> Callable[[dict], None]:
    def change(data: dict) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = value

    return change


ROBOT_FILES = ("sources", "robot", "files")
FORCE_T = 0.002 * np.arange(400)
WRENCH_HEADER = "time,fx,fy,fz,tx,ty,tz"


def wrench_trajectory() -> np.ndarray:
    """(N, 6) [N, N m] of the sensor, another one for each channel."""
    return np.random.default_rng(4).normal(0.0, 20.0, (FORCE_T.size, 6)) + 10.0 * np.arange(6)


def force_lines(t: np.ndarray = FORCE_T) -> list[str]:
    return [
        WRENCH_HEADER,
        *(
            ",".join(map(repr, row))
            for row in np.column_stack((17.0 + t, wrench_trajectory())).tolist()
        ),
    ]
