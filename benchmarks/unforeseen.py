"""Attacks that no list foresees: is a result then used with exit code 0, and which cause is named?

    python -m benchmarks.unforeseen                     # docs/studies/unforeseen.csv
    python -m benchmarks.unforeseen --only "ratio 4" --seconds 120

One robot is recorded on two paths by tests/independent, which shares no code with the product, with
one thing at a time that its files do not state or its logs do not show, and identified from both
recordings. Judged is the mean error of the unloaded robot's tool, base aligned, over the stated
standard deviation. A result is `deceived` where it is acceptable, which is exit code 0, and its
error is more than TWICE what is stated.

The rod is measured to ROD_KNOWN: with the plate alone the scale hides most of what is wrong.

Every attack lists the words of which one has to be in the verdict's sentence, in its remarks or in
what was found in the logs, if the cause is to be called right. NAMED holds the words by which a
cause is named at all: a sentence of the verdict that has some of them, where nothing has the right
ones, is a wrong cause. Healthy robots stand beside the attacks (`healthy N`, drawn with different
seeds): each has to be good.
"""

from __future__ import annotations

import pickle
import re
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ballbar import identify
from ballbar.acquisition.recording import read_recording
from ballbar.cell.errors import FailureError, InputError
from ballbar.ident.options import FitOptions
from ballbar.ident.start.automatic import StartError
from benchmarks.silent_faults import Logs, logs_of, spoilt
from benchmarks.study import STUDIES, study_parser, write_table
from tests.independent.machine import Effects, Ripple, files
from tests.independent.recording import (
    Faults,
    Plan,
    Truth,
    accuracy_box,
    aligned_distance,
    record_path,
)

RESULT = STUDIES / "unforeseen.csv"
ROBOT, SECONDS, HEALTHY = 1, 60.0, 12
ROD_KNOWN = 5e-6  # [m]
TWICE = 2.0  # stated standard deviations
SAID = 400  # characters of a sentence that are written
# Words that name a cause. What only says that something is wrong has none of them.
NAMED = (
    "gravity|gear \\d turns|logged (too )?(late|early|large|small)|line count|not of one tool|"
    "weighed|force of|repeat|burst|hysteresis|zero of|base of the ball-bar|not of the same machine|"
    "another one|clock|not of robot|rod is not"
)
Array = np.ndarray
Spoil = Callable[[Logs], object]


@dataclass(frozen=True)
class Attack:
    """One thing that is not as the files and the logs say, and the words that name it."""

    effects: Effects = field(default_factory=Effects)
    faults: Faults = field(default_factory=Faults)
    spoil: Spoil | None = None
    right: str = "nothing names it"  # expression of which the verdict should hold something
    robot: int = ROBOT


@dataclass(frozen=True)
class Row:
    """How one attack ended."""

    attack: str
    status: str
    exit_code: int
    error_mm: float
    largest_mm: float
    stated_mm: float
    times_stated: float
    deceived: bool
    cause: str  # right, wrong, none
    seconds: float
    sentence: str


def waves(gears: Sequence[int], order: float, size: float, **form: float) -> Attack:
    """Ripple of gears (from 1) that no file lists."""
    ripples = tuple(Ripple(g - 1, order, size, 0.7 * g, **form) for g in gears)
    return Attack(Effects(further=ripples), right="cycles a turn|ripple")


def machine(right: str = "nothing names it", **effects: object) -> Attack:
    """A machine with these effects."""
    return Attack(Effects(**effects), right=right)  # type: ignore[arg-type]


def scaled(motor: int, factor: float) -> Attack:
    """A motor's log times a factor."""
    return Attack(faults=Faults(scaled=(motor, factor)), right=f"gear {motor}.*(turns|large|small)")


# --- faults of the logs' rows


def replayed(source: str, rows: int) -> Spoil:
    """The rows of a stretch are those before it once more, behind stamps of their own."""

    def spoil(logs: Logs) -> None:
        log = logs[source]
        first = 3 * len(log.cells) // 7
        log.cells[first : first + rows, 1:] = log.cells[first - rows : first, 1:].copy()

    return spoil


def torque(axis: int, added: float = 0.0, times: float = 1.0, late: int = 0) -> Spoil:
    """The logged torque of an axis [N m at the output] is changed."""

    def spoil(logs: Logs) -> None:
        log, ratio = logs["robot"], abs(float(files().transmission[axis - 1, axis - 1]))
        column = log.names.index(f"tau{axis}")
        values = times * log.numbers(column) + added * ratio
        log.put(np.arange(values.size), column, np.roll(values, late))

    return spoil


def angle(source: str, name: str, change: Callable[[Array], Array]) -> Spoil:
    """A channel's values are those of a function of its values."""

    def spoil(logs: Logs) -> None:
        log = logs[source]
        column = log.names.index(name)
        log.put(np.arange(len(log.cells)), column, change(log.numbers(column)))

    return spoil


def every_angle(source: str, change: Callable[[Array], Array]) -> Spoil:
    """All motor angles or counts are those of a function of their values."""

    def spoil(logs: Logs) -> None:
        log = logs[source]
        for column in log.columns("m" if source == "robot" else "b"):
            log.put(np.arange(len(log.cells)), column, change(log.numbers(column)))

    return spoil


def bursts(source: str, rows: int) -> Spoil:
    """So many rows at a time have the stamp at which they arrived together."""

    def spoil(logs: Logs) -> None:
        log = logs[source]
        last = np.minimum((np.arange(len(log.cells)) // rows + 1) * rows, len(log.cells)) - 1
        behind = np.arange(len(log.cells)) - last
        if "." in log.cells[0, 0]:
            log.cells[:, 0] = [f"{t:.6f}" for t in log.numbers(0)[last] + 2e-5 * (behind + rows)]
        else:
            stamps = log.cells[:, 0].astype(np.int64)
            log.cells[:, 0] = (stamps[last] + 20_000 * (behind + rows)).astype(str)

    return spoil


def bent_clock(source: str, size: float) -> Spoil:
    """A clock whose error is a parabola of this height [s]."""

    def spoil(logs: Logs) -> None:
        log, t = logs[source], np.linspace(0.0, 1.0, len(logs[source].cells))
        late = 4.0 * size * t * (1.0 - t)
        if "." in log.cells[0, 0]:
            log.cells[:, 0] = [f"{x:.6f}" for x in log.numbers(0) + late]
        else:
            stamps = log.cells[:, 0].astype(np.int64) + np.rint(1e9 * late).astype(np.int64)
            log.cells[:, 0] = stamps.astype(str)

    return spoil


def smoothed(rows: int) -> Callable[[Array], Array]:
    """A running mean."""
    return lambda x: np.convolve(np.pad(x, (rows - 1, 0), "edge"), np.ones(rows) / rows, "valid")


def rows_of(right: str, spoil: Spoil) -> Attack:
    """A fault of the rows of both recordings."""
    return Attack(spoil=spoil, right=right)


PER_RAD = 3600 * 2**12 / (2.0 * np.pi)  # counts
THREE = (1, 2, 3)
LEANS = "gravity"
ATTACKS: dict[str, Attack] = {
    "ratio 4": scaled(4, 1.0004),
    "ratio 1": scaled(1, 1.0003),
    "ratio 6": scaled(6, 0.9995),
    "ratio 2": scaled(2, 1.0002),
    "rectangle": waves(THREE, 9.0, 6e-5, edge=6.0),
    "rectangle of a turn": waves(THREE, 1.0, 6e-5, edge=6.0),
    "rectangle 2.3": waves(THREE, 2.3, 6e-5, edge=6.0),
    "order 57.3": waves((2,), 57.3, 5e-5),
    "order 12.6": waves((3, 5), 12.6, 5e-5),
    "half a turn": waves(THREE, 0.5, 1e-4),
    "growing ripple": waves((2, 3), 40.0, 3e-5, power=0.8),
    "slope x": machine(LEANS, slope=(np.deg2rad(5.0), 0.0)),
    "slope y": machine(LEANS, slope=(0.0, np.deg2rad(5.0))),
    "slope 1": machine(LEANS, slope=(np.deg2rad(0.7), np.deg2rad(-0.7))),
    "wall": machine(LEANS, slope=(np.deg2rad(90.0), 0.0)),
    "cable": machine("force at the tool|cable|hose", cable=25.0),
    "stiff cable": machine("force at the tool|cable|hose", cable=100.0),
    "hysteresis": machine("hysteresis", hysteresis=5e-5),
    "reversal": machine("hysteresis|reversal|turned last", reversal=3e-5),
    "sway slow": machine("base of the ball-bar", sway=(3e-5, 0.07)),
    "sway": machine("base of the ball-bar", sway=(3e-5, 0.7)),
    "settling": machine("base of the ball-bar", settling=1e-4),
    "dropped": machine("base of the ball-bar", dropped=1e-4),
    "soft base": machine("base of the ball-bar|rod_strain", base_stiffness=1e6),
    "soft gears": machine("soft|compliance", softer=2.5),
    "worn gears": machine("backlash", wider=3.0),
    "worn seats": machine("rod_backlash|seats", rod_play=5e-5),
    "bad resolvers": machine("ripple", worse_resolver=6.0),
    "balancer": machine("balancer|spring|torque", spring=400.0),
    "feeder": machine("weigh|masses|payload", feeder=12.0),
    "soft plate": machine("plate", plate_softer=8.0),
    "burst robot": rows_of("arriv|burst|when it got", bursts("robot", 12)),
    "burst ball-bar": rows_of("arriv|burst", bursts("ballbar", 12)),
    "replayed robot": rows_of("repeat|replay", replayed("robot", 250)),
    "replayed ball-bar": rows_of("repeat|replay", replayed("ballbar", 200)),
    "torque offset 2": rows_of("torque", torque(2, added=60.0)),
    "torque offset 5": rows_of("torque", torque(5, added=8.0)),
    "torque sign 3": rows_of("torque", torque(3, times=-1.0)),
    "torque gain 2": rows_of("torque", torque(2, times=1.3)),
    "torque late": rows_of("torque", torque(2, late=60)),
    "drifting zero": rows_of(
        "axis 3", angle("robot", "m3", lambda x: x + np.linspace(0.0, 0.02, x.size))
    ),
    "seven cycles b1": rows_of(
        "b1", angle("ballbar", "b1", lambda x: x + 1e-4 * PER_RAD * np.sin(7.0 * x / PER_RAD))
    ),
    "filtered encoder": rows_of("b2.*late", angle("ballbar", "b2", smoothed(5))),
    "filtered robot": rows_of("late|filter", every_angle("robot", smoothed(25))),
    "coarse robot": rows_of(
        "round|coarse|resolution", every_angle("robot", lambda x: np.round(x, 1))
    ),
    "bent clock": rows_of("clock|stamps", bent_clock("ballbar", 5e-3)),
    "scaled b2": Attack(faults=Faults(lines=3599), right="line count|b1"),
    "slip": Attack(faults=Faults(slip=(4, 3e-4)), right="b4"),
}  # fmt: skip


def record(attack: Attack, seconds: float, folder: Path) -> list[Truth]:
    """Write both recordings of an attack, unless they are there."""
    kept = folder / "truths.pickle"
    if kept.exists():
        return list(pickle.loads(kept.read_bytes()))
    truths, plan = [], Plan(attack.robot, attack.effects, duration=seconds, rod_known=ROD_KNOWN)
    for k in range(2):
        own = folder / str(k + 1)
        truths.append(record_path(plan, k, own, attack.faults))
        if attack.spoil is not None:
            logs = logs_of(own)
            attack.spoil(logs)
            sound = own.rename(folder / f"sound {k + 1}")
            spoilt(sound, own, logs)
    kept.write_bytes(pickle.dumps(truths))
    return truths


def row_of(name: str, attack: Attack, seconds: float, folder: Path) -> Row:
    """Record an attack, identify both recordings together, and judge."""
    folder.mkdir(parents=True, exist_ok=True)
    truths = record(attack, seconds, folder)
    begun = time.process_time()
    try:
        options = FitOptions(rod_sigma=ROD_KNOWN)
        both = [folder / "1", folder / "2"]
        found = identify(*both, options=options).data.identification
    except (InputError, StartError, FailureError) as refusal:
        used, said = time.process_time() - begun, str(refusal)
        nothing = (np.nan,) * 4
        cause = _cause(attack, said, said)
        return Row(name, "refused", 2, *nothing, False, cause, used, said[:SAID])
    used = time.process_time() - begun
    q = accuracy_box(files())
    error = 1e3 * aligned_distance(found.robot.identified.tool(q), truths[0].tool(q))
    stated = 1e3 * float(found.robot.tcp_sigma.mean())
    times = float(error.mean()) / stated
    verdict = found.verdict
    said = " | ".join((verdict.sentence, *verdict.warnings))
    return Row(
        name,
        str(verdict.status),
        0 if verdict.acceptable else 1,
        float(error.mean()),
        float(error.max()),
        stated,
        times,
        verdict.acceptable and times > TWICE,
        _cause(attack, verdict.sentence, " ".join((said, *_findings(both)))),
        used,
        said[:SAID],
    )


def _findings(folders: Sequence[Path]) -> list[str]:
    """The findings of reading the logs."""
    found = (read_recording(folder).report.findings for folder in folders)
    return [finding.sentence for findings in found for finding in findings]


def _cause(attack: Attack, sentence: str, said: str) -> str:
    if re.search(attack.right, said):
        return "right"
    return "wrong" if re.search(NAMED, sentence) else "none"


def cases() -> dict[str, Attack]:
    """All attacks, and healthy robots beside them."""
    healthy = {f"healthy {k}": Attack(robot=k) for k in range(1, HEALTHY + 1)}
    return {**ATTACKS, **healthy}


def main() -> None:
    """Records, identifies, prints every row as it ends, and writes the table."""
    parser = study_parser(__doc__)
    parser.add_argument("--only", default="", help="names, by comma")
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--recordings", type=Path, help="keep them here, for another run")
    parser.add_argument("--out", type=Path, default=RESULT)
    given = parser.parse_args()
    every = cases()
    names = given.only.split(",") if given.only else list(every)
    if unknown := set(names) - every.keys():
        parser.error(f"no attack {', '.join(unknown)}; there are {', '.join(every)}")
    with tempfile.TemporaryDirectory() as scratch, ProcessPoolExecutor(given.workers) as pool:
        place = Path(given.recordings or scratch)
        jobs = [pool.submit(_row_named, name, given.seconds, place / name) for name in names]
        rows = [_said(job.result()) for job in jobs]
    write_table(given.out, rows, ".4g")
    attacks = [row for row in rows if not row.attack.startswith("healthy")]
    deceived = [row.attack for row in attacks if row.deceived]
    causes = {
        kind: [r.attack for r in attacks if r.cause == kind] for kind in ("right", "wrong", "none")
    }
    print(f"{len(deceived)} of {len(attacks)} deceived: {', '.join(deceived) or 'none'}")
    for kind, own in causes.items():
        print(f"cause {kind}: {len(own)}: {', '.join(own)}")
    spoken = [row for row in rows if row.attack.startswith("healthy")]
    print(f"{sum(row.status == 'good' for row in spoken)} of {len(spoken)} healthy robots good")


def _row_named(name: str, seconds: float, place: Path) -> Row:
    """The row of an attack by its name, as a worker gets it: an attack may hold a closure."""
    return row_of(name, cases()[name], seconds, place)


def _said(row: Row) -> Row:
    print(
        f"{row.attack:20} {row.status:13} {row.error_mm:.3f} / {row.largest_mm:.3f}, stated "
        f"{row.stated_mm:.3f}, {row.times_stated:.1f} times{' DECEIVED' * row.deceived}; cause "
        f"{row.cause}; {row.seconds:.1f} s\n      {row.sentence}",
        flush=True,
    )
    return row


if __name__ == "__main__":
    main()
