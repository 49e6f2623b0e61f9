"""A simulated path recorded while it happens by `ballbar record`, and identified meanwhile.

With a ball-bar the encoders come from a simulated PLC over ADS and the axes from a simulated
controller over EGM. The log of a length or of a tracker, and of the robot beside these, is a file
that grows, as another program writes it.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ballbar.acquisition.live.egm_source import LOOPBACK
from ballbar.acquisition.live.recorder import POLL, LiveRecording
from ballbar.cell.clock import Clock
from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.load import load_instrument, load_robot
from ballbar.record.show import RecordOptions, record
from ballbar.scenario import Scenario, with_absolute_names
from ballbar.sim.live.delivery import Device, EgmRobot, GrowingFiles, Pace
from ballbar.sim.live.device_logs import GrowingRecording
from ballbar.sim.live.faults import FAULTS, OF_ENCODERS, OF_TRACKER, moving_at
from ballbar.sim.logging.load_logs import BallbarLogger, DeviceLogs, RobotLogger
from ballbar.sim.recording_files import truth_path
from ballbar.sim.truth import Truth, load_truth
from ballbar.terminal import err
from ballbar.watch.beside import WatchBeside
from ballbar.watch.show import Data
from ballbar.watch.state import Alarm

if TYPE_CHECKING:  # pyads is an extra
    from ballbar.sim.live.plc import Plc

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


def as_recorded(scenario: Scenario) -> Scenario:
    """The scenario as its devices deliver it: motor torques by EGM, but no force.

    Raises InputError for what no device here delivers row by row.
    """
    if scenario.clocks.restart is not None:
        raise InputError("clocks.restart: the recorder starts its own files. Leave it out")
    logged = scenario.logs
    if scenario.cell.instrument is not None:
        logs = logged.model_copy(update={"torque": None})
        return scenario.model_copy(update={"logs": logs})
    logs = DeviceLogs(
        robot=RobotLogger(dialect="abb-motor", rate_hz=logged.robot.rate_hz),
        ballbar=BallbarLogger(task_s=logged.ballbar.task_s),
        torque=logged.torque,
        tracker=logged.tracker,
    )
    encoders = scenario.encoders.model_copy(update={"directions": "unknown"})
    return scenario.model_copy(update={"logs": logs, "encoders": encoders})


def check_fault(scenario: Scenario, fault: str | None, *, relative_to: Path | None = None) -> None:
    """Raises InputError for a fault that does not exist, or that the cell cannot have.

    relative_to : folder of the scenario's file.
    """
    if fault is None:
        return
    named = scenario.cell.instrument
    instrument = None if named is None else load_instrument(named, relative_to=relative_to)
    encoders, tracker = instrument is None, scenario.tracker(instrument) is not None
    absent = (*(() if encoders else OF_ENCODERS), *(() if tracker else OF_TRACKER))
    possible = [name for name in FAULTS if name not in absent]
    if fault not in possible:
        needed = "a tracker" if fault in OF_TRACKER else "a ball-bar with encoders"
        reason = f"needs {needed}" if fault in FAULTS else "is no fault"
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
    truth = load_truth(truth_path(simulated))
    assert isinstance(truth, Truth)  # of a path
    clocks = (
        Clock(c.offset_s, c.skew) for c in (scenario.clocks, truth.logs.tracker) if c is not None
    )
    path = LivePath(Pace(speed))
    with TemporaryDirectory() as scratch:
        growing = GrowingRecording(simulated, Path(scratch), *clocks)
        logs = growing.logs
        if fault is not None:
            rng = np.random.default_rng([scenario.seed, list(FAULTS).index(fault)])
            path.fault = fault
            path.began = moving_at(logs, MIDWAY * scenario.needed_path.duration_s)
            path.shows = FAULTS[fault](logs, path.began, rng)
        _recorded(growing, folder, with_absolute_names(scenario, relative_to), path, identify)
    return path


def _recorded(
    growing: GrowingRecording, folder: Path, scenario: Scenario, path: LivePath, identify: bool
) -> None:
    """The recording of simulated devices by the recorder."""
    robot, bar = growing.logs["robot"], growing.logs.get("ballbar")
    bar_rows = len(bar.cells) if bar else 0
    with _devices(growing, scenario, path.pace) as (devices, plc, named):
        options = replace(named, identify=identify)

        def follow(recording: LiveRecording, beside: WatchBeside | None) -> None:
            path.beside = beside
            path.wait_for_update(BEGINS)
            if plc is not None:
                _wait(
                    lambda: bool(plc.header_reads), "the recorder did not reach the simulated PLC"
                )
                plc.start()
            for device in devices:
                device.start()
            path.pace.start()
            while not all(device.wait(LOOK) for device in devices):
                if recording.wait(0.0):
                    raise KeyboardInterrupt
                if path.look():
                    return
            _wait(lambda: plc is None or plc.written == bar_rows, "the simulated PLC hangs")
            time.sleep(3.0 * POLL)
            path.wait_for_last()
            if recording.wait(0.0):
                raise KeyboardInterrupt

        recorded = record(folder, options, err, meanwhile=follow)
    sources = {source.name: source for source in recorded.recording.progress}
    path.lost = sum(source.lost for source in sources.values())
    path.seconds = float(robot.t[sources["robot"].records - 1])
    path.last = recorded.identified


@contextmanager
def _devices(
    growing: GrowingRecording, scenario: Scenario, pace: Pace
) -> Iterator[tuple[list[Device], Plc | None, RecordOptions]]:
    """The devices of a cell, which wait to be started, and how they are recorded.

    With a ball-bar a PLC, and a controller that ends. Files grow by what these do not deliver.
    """
    cell, devices, plc = scenario.cell, list[Device](), None
    options = RecordOptions(plc=None, egm=None, egm_torque=False, robot=None, ballbar=None)
    with ExitStack() as stack:
        if cell.instrument is None:
            from ballbar.sim.live.plc import Plc, logged_samples, loopback_address  # noqa: PLC0415  an extra

            robot, ballbar = (growing.logs.pop(name) for name in ("robot", "ballbar"))
            program, joints = logged_samples(ballbar, pace)
            with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
                probe.bind((LOOPBACK, 0))
                port = int(probe.getsockname()[1])
            plc = stack.enter_context(Plc(loopback_address(), program, joints=joints))
            controller = EgmRobot(port, robot, load_robot(cell.robot), pace)
            devices.append(stack.enter_context(controller))
            torque = scenario.logs.torque is not None
            options = replace(options, plc=plc.net_id, egm=str(port), egm_torque=torque)
        if growing.logs:
            devices.append(stack.enter_context(GrowingFiles(growing, pace)))
            options = replace(options, files=growing.folder)
        else:
            options = replace(options, robot=cell.robot, ballbar=cell.measured_by, plate=cell.plate)
        yield devices, plc, options


def _wait(there: Callable[[], bool], failure: str) -> None:
    begun = time.monotonic()
    while not there():
        if time.monotonic() - begun > BEGINS:
            raise FailureError(failure)
        time.sleep(LOOK)
