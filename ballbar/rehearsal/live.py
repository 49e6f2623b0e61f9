"""A simulated path recorded while it happens, and identified meanwhile.

With a ball-bar `ballbar record` takes the encoders from a simulated PLC over ADS and the axes from
a simulated controller over EGM. A length has no live recorder: its files grow, as another logger
writes them, and `ballbar watch` reads them.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from acquisition.live.egm_source import LOOPBACK
from acquisition.live.recorder import POLL, LiveRecording
from ballbar.record.show import RecordOptions, record
from ballbar.scenario import Scenario, with_absolute_names
from ballbar.terminal import err
from ballbar.watch.beside import WatchBeside
from ballbar.watch.show import Data
from ballbar.watch.state import Alarm
from cell.clock import Clock
from cell.errors import FailureError, InputError
from cell.load import load_instrument, load_robot
from sim.live.delivery import EgmRobot, Pace
from sim.live.device_logs import GrowingRecording, Logs, device_logs
from sim.live.faults import FAULTS, OF_ENCODERS, moving_at
from sim.logging.load_logs import BallbarLogger, DeviceLogs, RobotLogger

if TYPE_CHECKING:  # pyads is an extra
    from sim.live.plc import Plc

LOOK = 0.05  # [s] between two looks at what is identified meanwhile
BEGINS = 60.0  # [s] for the recorder and the process that identifies to begin
LAST_UPDATE = 5.0  # [s] for an update with the last rows: one a second, each takes some tenths
AFTER_A_FAULT = 3  # updates with the last rows: an alarm may need two (ballbar.watch.alarms)
LATE = 25.0  # [s] of the recording without an update, after which the devices go on in real time
MIDWAY = 0.5  # of a path, where a fault begins if the robot moves there


@dataclass(eq=False)
class LivePath:
    """A path that is recorded live, and what a process identifies of it meanwhile."""

    pace: Pace
    fault: str = ""  # a key of FAULTS that begins midway
    began: float = np.inf  # [s] of the recording at which it begins
    shows: float = np.inf  # [s] of the recording from which it could be seen
    seconds: float = 0.0  # of the recording
    lost: int = 0  # records
    beside: WatchBeside | None = None  # the process
    seen: float = 0.0  # [s] that had been delivered at the latest update
    states: list[Data] = field(default_factory=list)  # what was identified, one for each update
    # by kind; raised: [s] that the devices had delivered when it was first shown
    alarms: dict[str, Alarm] = field(default_factory=dict)
    last: Data | None = None  # what was identified of the whole recording, once it had ended

    @property
    def noticed(self) -> Alarm | None:
        """The first alarm since the fault began."""
        return next((a for a in self.alarms.values() if a.raised >= self.began), None)

    @property
    def stated(self) -> list[tuple[float, float]]:
        """[s] of the recording and [m] stated TCP uncertainty, of each update that has one."""
        return [
            (s["recorded_s"], s["tcp_sigma_m"]) for s in self.states if s["tcp_sigma_m"] is not None
        ]

    def wait_for_update(self, seconds: float) -> None:
        """Waits for one update more. Raises FailureError when the process has ended."""
        if self.beside is None:
            return
        known, begun = self.beside.updates, time.monotonic()
        while self.beside.updates == known and time.monotonic() - begun < seconds:
            if self.beside.failure:
                raise FailureError(
                    f"the identification beside the recording: {self.beside.failure}"
                )
            time.sleep(LOOK)
        self.look()

    def wait_for_last(self) -> None:
        """Waits until what has been delivered is identified, and a fault had its chance."""
        for _ in range(AFTER_A_FAULT if self.fault else 1):
            self.wait_for_update(LAST_UPDATE)
            if self.noticed:
                return

    def look(self) -> bool:
        """Takes in the latest update, and has the devices wait for the next where it is late.

        Returns whether the fault has been noticed.
        """
        latest, delivered = None if self.beside is None else self.beside.latest, self.pace.delivered
        if latest is not None and (not self.states or latest is not self.states[-1]):
            self.states.append(latest)
            self.seen = delivered
            for kind, sentence in ((a["kind"], a["sentence"]) for a in latest["alarms"]):
                self.alarms.setdefault(kind, Alarm(kind, sentence, delivered))
        if self.beside is not None and delivered > 0.0:
            self.pace.hold_back(wanted=delivered - self.seen > LATE)
        return self.noticed is not None


def as_recorded(scenario: Scenario, *, relative_to: Path | None = None) -> Scenario:
    """The scenario as its devices deliver it: motor torques by EGM, but no force.

    relative_to : folder of the scenario's file. Raises InputError for what no device here delivers
    row by row.
    """
    clocks = scenario.clocks
    if clocks.restart is not None:
        raise InputError("clocks.restart: the recorder starts its own files. Leave it out")
    if (named := scenario.cell.instrument) is not None:
        if load_instrument(named, relative_to=relative_to).follows:
            raise InputError(
                f"cell.instrument: {named} follows the robot, and a rehearsal plans and records "
                "paths of a ball-bar or a length. `ballbar run` simulates and identifies this one."
            )
        logs = scenario.logs.model_copy(update={"torque": None, "tracker": None})
        return scenario.model_copy(update={"logs": logs})
    logged = scenario.logs
    logs = DeviceLogs(
        robot=RobotLogger(dialect="abb-motor", rate_hz=logged.robot.rate_hz),
        ballbar=BallbarLogger(task_s=logged.ballbar.task_s),
        torque=logged.torque,
    )
    encoders = scenario.encoders.model_copy(update={"directions": "unknown"})
    return scenario.model_copy(update={"logs": logs, "encoders": encoders})


def check_fault(scenario: Scenario, fault: str | None) -> None:
    """Raises InputError for a fault that does not exist, or needs encoders."""
    if fault is None:
        return
    length = scenario.cell.instrument is not None
    possible = [name for name in FAULTS if not (length and name in OF_ENCODERS)]
    if fault not in possible:
        reason = "needs a ball-bar with encoders" if fault in FAULTS else "is no fault"
        raise InputError(f"--fault {fault}: {reason}. There are {', '.join(possible)}.")


def record_live(
    simulated: Path,
    scenario: Scenario,
    *,
    folder: Path,
    relative_to: Path,
    speed: float,
    fault: str | None = None,
    identify: bool = True,
) -> LivePath:
    """The recording of a simulated path, taken while its devices deliver it.

    simulated : folder of the simulated recording. relative_to : folder of the scenario's file.
    speed : times real time. fault : a key of FAULTS that begins midway; the recording ends when it
    has been noticed. identify : whether it is identified meanwhile.

    Raises FailureError when a part of the cell does not come up.
    """
    clock = Clock(scenario.clocks.offset_s, scenario.clocks.skew)
    growing = None
    if scenario.cell.instrument is not None:
        growing = GrowingRecording(simulated, folder, clock)
    logs = growing.logs if growing else device_logs(simulated, clock)
    path = LivePath(Pace(speed))
    if fault is not None:
        rng = np.random.default_rng([scenario.seed, list(FAULTS).index(fault)])
        path.fault, path.began = fault, moving_at(logs, MIDWAY * scenario.needed_path.duration_s)
        path.shows = FAULTS[fault](logs, path.began, rng)
    if growing:
        _grown(growing, path, identify=identify)
    else:
        _recorded(logs, folder, with_absolute_names(scenario, relative_to), path, identify=identify)
    return path


def _grown(growing: GrowingRecording, path: LivePath, *, identify: bool) -> None:
    """Files that grow, watched by a process of its own."""
    if identify:
        path.beside = WatchBeside(growing.folder, accuracy=None, duration=None)
    try:
        path.wait_for_update(BEGINS)
        path.pace.start()
        while (now := path.pace.delivered) < growing.seconds:
            growing.write_until(now)
            if path.look():
                break
            time.sleep(LOOK)
        else:
            growing.write_until(np.inf)
            path.wait_for_last()
    finally:
        path.last = None if path.beside is None else path.beside.finish()
    path.seconds = min(now, growing.seconds)


def _recorded(
    logs: Logs, folder: Path, scenario: Scenario, path: LivePath, *, identify: bool
) -> None:
    """The recording of a simulated PLC and a simulated controller by the recorder."""
    with _devices(logs, scenario, path.pace) as (plc, robot, port):
        options = RecordOptions(
            plc=plc.net_id,
            egm=str(port),
            egm_torque=scenario.logs.torque is not None,
            robot=scenario.cell.robot,
            ballbar=scenario.cell.measured_by,
            plate=scenario.cell.plate,
            identify=identify,
        )

        def follow(recording: LiveRecording, beside: WatchBeside | None) -> None:
            path.beside = beside
            path.wait_for_update(BEGINS)
            _wait(lambda: bool(plc.header_reads), "the recorder did not reach the simulated PLC")
            plc.start()
            robot.start()
            path.pace.start()
            while not robot.wait(LOOK):
                if recording.wait(0.0):
                    raise KeyboardInterrupt
                if path.look():
                    return
            _wait(lambda: plc.written == len(logs["ballbar"].cells), "the simulated PLC hangs")
            time.sleep(3.0 * POLL)
            path.wait_for_last()
            if recording.wait(0.0):
                raise KeyboardInterrupt

        recorded = record(folder, options, err, meanwhile=follow)
    sources = {source.name: source for source in recorded.recording.progress}
    path.lost = sum(source.lost for source in sources.values())
    path.seconds = float(logs["robot"].t[sources["robot"].records - 1])
    path.last = recorded.identified


@contextmanager
def _devices(logs: Logs, scenario: Scenario, pace: Pace) -> Iterator[tuple[Plc, EgmRobot, int]]:
    """PLC, controller, and the port to which it sends; they wait to be started."""
    from sim.live.plc import Plc, logged_samples, loopback_address  # noqa: PLC0415  an extra

    program, joints = logged_samples(logs["ballbar"], pace)
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind((LOOPBACK, 0))
        port = int(probe.getsockname()[1])
    with (
        Plc(loopback_address(), program, joints=joints) as plc,
        EgmRobot(port, logs["robot"], load_robot(scenario.cell.robot), pace) as robot,
    ):
        yield plc, robot, port


def _wait(there: Callable[[], bool], failure: str) -> None:
    begun = time.monotonic()
    while not there():
        if time.monotonic() - begun > BEGINS:
            raise FailureError(failure)
        time.sleep(LOOK)
