"""Why the logs of a recording do not fit together, by cheap tests after a fit that failed.

In this order, and only what explains the recording at least three times better than the files do:

1. other columns and line counts (ballbar.ident.causes.columns), by what they leave of the rod's
   motion;
2. encoders and axes that stand still;
3. one channel that is late or scaled (ballbar.ident.causes.channels), where a fit can be judged;
4. the rod's length by the radius of the sphere, or one other length
   (ballbar.ident.causes.agreement);
5. too short a log;
6. a sphere without agreement at any lag: logs of different runs. The ball-bar's log played
   backwards shows how much agreement is chance;
7. no sphere: another robot.

A sound recording passes all of them, whatever the errors of an uncalibrated robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry, nominal_geometry, parameter_named
from ballbar.cell.number_text import significant_text
from ballbar.cell.robot_angles import joints_to_axes, joints_to_motors
from ballbar.ident.causes.agreement import (
    SPHERE_ROWS,
    Length,
    LoggedMotion,
    ToolPath,
    left_of,
    motion_of,
    single_lengths,
    tool_path,
)
from ballbar.ident.causes.channels import (
    BESIDE,
    ChannelError,
    channel_errors,
    channel_errors_beside,
)
from ballbar.ident.causes.columns import (
    ColumnReading,
    encoder_orders,
    encoder_scales,
    robot_columns,
)
from ballbar.ident.causes.effects import effects_beside
from ballbar.ident.causes.robot_log import PLURAL
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.recording_fit import Logs, RecordingFit

AGREES = 0.1  # unexplained share of the rod's motion up to which nothing is wrong with the columns
EXPLAINS = 0.2  # up to which another reading explains the recording
UNRELATED = 0.5  # from which logs have nothing in common; 0.9 to 1 by chance
DECISIVE = 3.0  # times less than as declared
COMPARABLE = 2.0  # times the best: a suspect that is named too
STILL = 1e-3  # [rad] range of a column that stands still
MOVES = 0.1  # [rad] range of a joint that does not
# [m] rms from the sphere; robots off by 10 mm and mrad stay below (notes/identification sec. 8)
OFF_SPHERE = 0.010
# [m] smallest error of the rod that is named, and in standard deviations of the sphere's radius
ROD_ERROR, ROD_SIGMAS = 5e-4, 2.0
# [m] rms from the sphere above which single lengths are tried, and [m, rad] what they then must be
# off by: no robot is built so badly (ballbar.ident.verdict.PLAUSIBLE is twice that)
LENGTH_RMS, LENGTH_ERROR = 0.003, 0.010
SHORT = 30.0  # [s] of a log that cannot determine a robot


@dataclass(frozen=True)
class Suspect:
    """One cause with its evidence, and its remedy."""

    cause: str
    evidence: str
    remedy: str
    hopeless: bool = True  # whether no fit of these logs can be right

    def __str__(self) -> str:
        return f"{self.cause}: {self.evidence}. {self.remedy}."


@dataclass(frozen=True)
class Causes:
    """The suspects of recordings whose fit failed; false where there are none."""

    names: tuple[str, ...]  # of all recordings
    suspects: tuple[tuple[Suspect, ...], ...]  # of each

    @classmethod
    def of(
        cls, cell: Cell, recordings: Sequence[Logs], fits: Sequence[RecordingFit] = ()
    ) -> Causes:
        """The suspects of these recordings; fits : by kinematics, of all of them if of any."""
        names = tuple(logs.name for logs in recordings)
        every = []
        for k, logs in enumerate(recordings):
            named = suspects(cell, logs)
            if fits and not any(suspect.hopeless for suspect in named):
                named = [*_channels(cell, fits[k]), *named]
            every.append(tuple(named))
        return cls(names, tuple(every))

    def __bool__(self) -> bool:
        return any(self.suspects)

    def before(self, statement: object) -> str:
        """A statement behind the causes, where there are any."""
        return f"{self} ({statement})" if self else str(statement)

    @property
    def hopeless(self) -> bool:
        """Whether no fit of these recordings can be right."""
        return any(suspect.hopeless for each in self.suspects for suspect in each)

    def __str__(self) -> str:
        """Sentences; a cause that all recordings share stands once."""
        causes = {tuple(suspect.cause for suspect in each) for each in self.suspects}
        if len(causes) == 1:
            return " Or ".join(map(str, self.suspects[0]))
        named = [(n, each) for n, each in zip(self.names, self.suspects, strict=True) if each]
        return " ".join(f"{name}: {' Or '.join(map(str, each))}" for name, each in named)


def suspects(cell: Cell, logs: Logs) -> list[Suspect]:
    """Possible causes of a failed fit, the most likely first; empty where none is found.

    Others than the first follow only if their evidence is comparable.
    """
    if logs.length is not None:
        return list(_duration(logs))
    nominal = nominal_geometry(cell, np.zeros(3))
    motion = _motion(logs)
    try:
        path = tool_path(nominal, motion.q)
    except ValueError:
        return list(_still_axes(cell, motion, 0.0))
    share = left_of(motion, path) if motion.gimbals else 0.0
    readings = _readings(cell, nominal, motion, path, share)
    if readings:
        return [_of_reading(r, share, path.rms, bool(motion.gimbals)) for r in readings]
    some = motion.q[:: 1 + len(motion.q) // SPHERE_ROWS]
    tests = (
        (_still_encoders(motion), _still_axes(cell, motion, path.rms)),
        (_duration(logs),),
        (_lengths(cell, nominal, some, path),),
        (_other_runs(motion, path, share), _other_robot(cell, path)),
    )
    for group in tests:
        if named := [suspect for each in group for suspect in each]:
            return named
    return []


def _motion(logs: Logs) -> LoggedMotion:
    robot, ballbar = logs.robot, logs.ballbar
    if ballbar is None:
        return motion_of(robot.t, robot.q, np.zeros(0), np.zeros((0, 0)), ())
    return motion_of(robot.t, robot.q, ballbar.t, ballbar.angles, ballbar.joints)


def _readings(
    cell: Cell, nominal: Geometry, motion: LoggedMotion, path: ToolPath, share: float
) -> list[ColumnReading]:
    """The readings that explain the recording, best first."""
    if motion.gimbals:
        if share <= AGREES:
            return []
        limit = min(EXPLAINS, share / DECISIVE)
        readings = [*encoder_scales(motion, path), *encoder_orders(motion, path)]
    else:
        if path.rms <= OFF_SPHERE:
            return []
        limit, readings = path.rms / nominal["bd3"] / DECISIVE, []
    readings += robot_columns(cell.robot, nominal, motion, path.rms)
    # Robots of one maker may differ by the sign of an axis and a few lengths: that is no sphere.
    good = [r for r in readings if r.left <= limit and r.rms <= OFF_SPHERE]
    good.sort(key=lambda reading: reading.left)
    return [r for r in good if r.left <= COMPARABLE * good[0].left]


def _of_reading(reading: ColumnReading, share: float, rms: float, encoders: bool) -> Suspect:
    sphere = (
        f"the tool's path by the robot is {reading.rms * 1e3:.1f} mm rms off a sphere, as declared "
        f"{rms * 1e3:.1f} mm"
    )
    motion = (
        f"{_percent(reading.left)} of the rod's motion stays unexplained, as declared "
        f"{_percent(share)}"
    )
    evidence = motion if encoders else sphere
    if encoders and reading.rms < rms / DECISIVE:
        evidence = f"{motion}, and {sphere}"
    return Suspect(reading.cause, f"once corrected, {evidence}{reading.remark}", reading.remedy)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _still_encoders(motion: LoggedMotion) -> Iterator[Suspect]:
    for joint, angles in zip(motion.encoders, motion.readings.T, strict=True):
        if np.ptp(angles) > STILL:
            continue
        others = (motion.readings.max(axis=0) - motion.readings.min(axis=0)).max()
        if others > MOVES:
            turn = significant_text(float(np.ptp(angles)) * 1e3, 2)
            yield Suspect(
                f"encoder b{joint} stands still",
                f"it turns by {turn} mrad in the whole log, others by up to "
                f"{significant_text(float(others), 2)} rad",
                "Check its cable, its coupling and its `column` in recording.yaml",
            )


def _still_axes(cell: Cell, motion: LoggedMotion, rms: float) -> Iterator[Suspect]:
    """rms : [m] of the tool's path from its sphere."""
    columns = {
        "axis": joints_to_axes(cell.robot, motion.q),
        "motor": joints_to_motors(cell.robot, motion.q),
        "joint": motion.q,
    }
    still = {
        kind: [str(k + 1) for k in np.flatnonzero(np.ptp(angles, axis=0) <= STILL)]
        for kind, angles in columns.items()
    }
    kind = max(still, key=lambda kind: len(still[kind]))
    if not still[kind]:
        return
    names = f"{kind} {still[kind][0]}"
    if len(still[kind]) > 1:
        names = f"{PLURAL[kind]} {', '.join(still[kind])}"
    if rms > OFF_SPHERE:
        yield Suspect(
            f"the robot's log does not hold the motion of {names}",
            f"there is none, and without it the tool's path is {rms * 1e3:.0f} mm rms off a sphere",
            "Correct the log of the robot, or its columns in the dialect",
        )
    else:
        yield Suspect(
            "too few joints move",
            f"there is no motion of {names} of the robot in the whole log",
            "Record a path that moves every joint (ballbar plan)",
            hopeless=False,
        )


def _logged_wrongly(error: ChannelError, names: Sequence[str]) -> str:
    """How a channel is logged; names : of the recordings."""
    name, single = names[error.recording], len(names) == 1 or error.channel.startswith("encoder")
    words = {
        (True, True): ("late", "early"),
        (True, False): ("too large", "too small"),
        (False, True): ("later", "earlier"),
        (False, False): ("larger", "smaller"),
    }[single, error.late]
    cause = f"{error.channel} is logged {words[0] if error.size > 0 else words[1]}"
    if not single:
        return f"{cause} in {name} than elsewhere"
    return f"{name}: {cause}" if len(names) > 1 else cause


def beside_fit(cell: Cell, fit: Fit, names: Sequence[str], *, contested: bool = False) -> str:
    """Sentences about what a complete fit cannot contain and its residual shows; may be empty.

    Errors of single channels, and effects that no model has (ballbar.ident.causes.effects). The
    size of a channel's error is not stated: the fit has made up for a part of it. Of a gear it is
    said how recordings differ, as the model has what they share.

    names : of the recordings. contested : whether a change of the machine explains them too.
    """
    evidence = dict[str, tuple[float, str, str]]()
    for error in () if contested else channel_errors_beside(cell, fit):
        # from another recording the same is seen again
        cause = _logged_wrongly(error, names)
        evidence.setdefault(error.channel, (error.left, cause, error.remedy))
    effects = effects_beside(fit)
    changed = min((effect.left for effect in effects if not effect.cause), default=1.0)
    limit = min(changed, 1.0 - 2.0 * BESIDE) if contested else 1.0 - BESIDE
    for effect in effects:
        if effect.cause and effect.left < limit:
            evidence[effect.cause] = effect.left, effect.cause, effect.remedy
    ranked = sorted(evidence.values())
    share = "so corrected, the complete model leaves {} of what it leaves without"
    return " Or ".join(
        str(Suspect(cause, share.format(_percent(max(0.0, left))), remedy))
        for left, cause, remedy in ranked
        if 1.0 - left >= (1.0 - ranked[0][0]) / COMPARABLE
    )


def _channels(cell: Cell, fit: RecordingFit) -> Iterator[Suspect]:
    """Single channels that are late or scaled, those comparable to the best."""
    errors = channel_errors(cell, fit) if fit.logs.length is None else []
    for error in errors:
        if error.left > COMPARABLE * errors[0].left:
            continue
        evidence = f"so corrected, kinematics leave {_percent(error.left)} of the squared residual"
        percent = significant_text(100.0 * abs(error.size), 2)
        how = f"{percent} % too {'large' if error.size > 0 else 'small'}"
        if error.late:
            how = f"{abs(error.size) * 1e3:.1f} ms {'late' if error.size > 0 else 'early'}"
        hopeless = error.channel.startswith("encoder")
        cause = f"{error.channel} is logged {how}"
        yield Suspect(cause, evidence, error.remedy, hopeless=hopeless)


def _other_rod(cell: Cell, stated: float, path: ToolPath) -> Suspect:
    return Suspect(
        "the rod is not as long as stated",
        f"the tool's path by the robot lies on a sphere of {path.radius * 1e3:.1f} mm radius, "
        f"{path.rms * 1e3:.1f} mm rms off it, and the file of {cell.ballbar.name} states "
        f"{stated * 1e3:.1f} mm",
        "Name the ball-bar that was used, or correct bd3 in its file",
        hopeless=False,
    )


def _wrong_length(cell: Cell, length: Length) -> str:
    """The parameter that is wrong, and by how much."""
    parameter, size = parameter_named(length.name), f"{length.change * 1e3:+.1f} mm"
    what = f"{length.name} of the file of robot {cell.robot.name}"
    if parameter.row == cell.robot.joints - 1 and parameter.kind == "a":
        what = f"the length of plate {cell.plate.name} ({length.name})"
    elif parameter.kind == "theta":
        joint, size = parameter.row + 1, f"{np.rad2deg(length.change):+.2f} deg"
        what = f"the zero of joint {joint} in the robot's log or file ({length.name})"
    return f"{what} is wrong by {size}"


def _lengths(cell: Cell, nominal: Geometry, q: Array, path: ToolPath) -> Iterator[Suspect]:
    if abs(path.radius - nominal["bd3"]) > max(ROD_ERROR, ROD_SIGMAS * path.radius_sigma):
        yield _other_rod(cell, nominal["bd3"], path)
    if path.rms <= LENGTH_RMS:
        return
    lengths = single_lengths(nominal, q)
    for length in lengths:
        if abs(length.change) < LENGTH_ERROR:
            continue
        if length.rms <= min(path.rms / DECISIVE, COMPARABLE * lengths[0].rms, OFF_SPHERE):
            yield Suspect(
                _wrong_length(cell, length),
                f"so changed, the tool's path is {length.rms * 1e3:.1f} mm rms off a sphere, as "
                f"stated {path.rms * 1e3:.1f} mm",
                "Correct the file, or name that of the cell that was recorded",
                hopeless=False,
            )


def _duration(logs: Logs) -> Iterator[Suspect]:
    other = logs.length or logs.ballbar or logs.robot
    duration = float(min(np.ptp(logs.robot.t), np.ptp(other.t)))
    if duration < SHORT:
        yield Suspect(
            "the logs are too short",
            f"they share at most {duration:.1f} s",
            f"Record at least {SHORT:g} s, better two minutes, of motion of every joint",
            hopeless=False,
        )


def _other_runs(motion: LoggedMotion, path: ToolPath, share: float) -> Iterator[Suspect]:
    if not motion.gimbals or path.rms > OFF_SPHERE or share < UNRELATED:
        return
    chance = left_of(motion.reversed(), path)
    yield Suspect(
        "the logs are not of one run",
        f"the best of all clock offsets leaves {_percent(share)} "
        f"of the rod's motion unexplained, and {_percent(chance)} with the ball-bar's log played "
        "backwards; no other order, sign or scale of the columns explains more",
        "Name logs of one run in recording.yaml",
    )


def _other_robot(cell: Cell, path: ToolPath) -> Iterator[Suspect]:
    if path.rms > OFF_SPHERE:
        yield Suspect(
            f"this is not the log of robot {cell.robot.name} with plate {cell.plate.name}",
            f"the tool's path is {path.rms * 1e3:.0f} mm rms off the sphere that fits it best, and "
            "no exchanged or reversed column and no single length explains that",
            "Correct `robot` and `plate` in recording.yaml, or the dialect of the log",
        )
