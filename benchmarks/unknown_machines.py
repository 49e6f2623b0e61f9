"""Machines that no file describes, recorded by the independent generator: is the answer right?

    python -m benchmarks.unknown_machines                        # 3 robots, all effects
    python -m benchmarks.unknown_machines --robots 12 --effects base,rod
    python -m benchmarks.unknown_machines --attacks              # wrong and poor input as well

Each robot is recorded on two paths of 120 s by tests/independent, with one effect at a time, and
identified from its files. Judged is the tool of the unloaded robot under its own weight over the
accuracy box, base aligned; clocks by their stated sigma; stiffness as identified over true, lowest
and highest gear. Beside them stand what priors and noise allow, whether 95 % intervals of geometry
and stiffness hold the truth (tests.helpers.independent_truth), and the limits of each figure,
which can be missed on either side: an error below its bound, or intervals that always hold, say
that the study is wrong. The bound's ratio comes with what chance leaves for so many robots, and
with the same at the drawn errors of plate and axis offset, which are most of that chance. The
largest error is also given over the poses where the true flank of every gear's backlash is clear:
elsewhere it depends on a load that is known to 0.1 N m in the wrist, and half a backlash is 0.03
mm. An attack succeeds where the verdict is acceptable and the mean error more than twice the stated
sigma, or a clock more than four sigma off. Writes a row for each case to --out.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbar import identify
from ballbar.cell.errors import FailureError, InputError
from ballbar.ident.options import FitOptions
from ballbar.ident.result import Identification
from ballbar.ident.start.automatic import StartError
from benchmarks.study import study_parser, write_table
from tests.helpers.independent_truth import (
    bound_draws,
    geometry_errors,
    held,
    stiffness_errors,
    true_compliance,
)
from tests.helpers.stated_uncertainty import COVERAGE, RATIO, place
from tests.independent.machine import Effects, files
from tests.independent.path import FIRST
from tests.independent.recording import (
    Faults,
    Plan,
    Truth,
    accuracy_box,
    aligned_distance,
    record_path,
)

ROD_KNOWN = 5e-6  # [m]
LAG = (8e-3, 10e-3, 12e-3, 8e-3, 10e-3, 12e-3)  # [s]
TOOL = 4.73  # [kg] of 4.30 that the plate's file states
UNLIKE = (1e-7, 3e-7, 3e-7, 1e-7, 2e-7, 3e-7)  # [rad/(N m)] x1 y1 x2 y2 x3 y3
TWICE, CLOCK = 2.0, 4.0  # stated sigmas
# Effects that are none, or that have other names
NO_ATTACKS = ("base", "listed", "rod", "rod50", "knee")
CLEAR = 0.95  # of the flank of a gear's backlash, -1 to 1
STUDIES = 2000  # of as many robots, drawn for what chance leaves of a median
# Limits on either side: TCP errors and deviations in mm, shares
LIMITS = {
    "base": {"mean": (0.0, 0.019), "largest": (0.0, 0.055)},
    "rod": {
        "mean": (0.0, 0.013),
        "largest": (0.0, 0.045),
        "worst mean": (0.0, 0.030),
        "worst largest": (0.0, 0.10),
    },
}
EACH = {
    "over the bound": (0.9, 1.1),
    "at drawn lengths": (0.9, 1.1),
    "over stated, rms": RATIO,
    "geometry held": COVERAGE,
    "stiffness held": COVERAGE,
}


@dataclass(frozen=True)
class Case:
    """One machine, or several of which one recording each is taken, and what spoils the files."""

    effects: tuple[Effects, ...] = (Effects(),)  # of each recording, the last one goes on
    faults: tuple[Faults, ...] = (Faults(),)  # of each recording, in the same way
    rod_known: float = 0.0  # [m]
    other_robot: bool = False  # whether the second recording is of another robot
    crossed: bool = False  # whether the logs of two runs are mixed
    single: bool = False  # whether the first recording is all there is
    reach: tuple[float, ...] = ()  # factors on the motion of b1..b5 in both recordings


def _of(**effects: object) -> Case:
    return Case((Effects(**effects),))  # type: ignore[arg-type]


def _with(**faults: object) -> Case:
    return Case(faults=(Faults(**faults),))  # type: ignore[arg-type]


def _first_with(**faults: object) -> Case:
    return Case(faults=(Faults(**faults), Faults()))  # type: ignore[arg-type]


EFFECTS: dict[str, Case] = {
    "base": Case(),
    "listed": _of(unlisted=0.0),
    "rod": Case(rod_known=ROD_KNOWN),
    "rod50": Case(faults=(Faults(rod_error=50e-6),), rod_known=ROD_KNOWN),
    "bearing1": _of(bearing=(1e-7,) * 6),
    "bearing3": _of(bearing=(3e-7,) * 6),
    "unlike": _of(bearing=UNLIKE),
    "lags": _of(lag=LAG),
    "growth": _of(growth=(40e-6, 32e-6)),
    "warm": _of(growth=(40e-6, 32e-6), growth_time=60.0),
    "knee": _of(knee=0.1),
    "remount20": _of(remount=(20e-6, 50e-6)),
    "remount100": _of(remount=(100e-6, 250e-6)),
    "tool": _of(tool_mass=TOOL),
    "tool_silent": Case((Effects(tool_mass=TOOL),), (Faults(no_torque=True),)),
    "combination": _of(
        tool_mass=TOOL, bearing=(3e-7,) * 6, lag=LAG, remount=(20e-6, 50e-6)
    ),
}  # fmt: skip

ATTACKS: dict[str, Case] = {
    **{name: EFFECTS[name] for name in EFFECTS if name not in NO_ATTACKS},
    "knee 5 %": _of(knee=0.05),
    "knee 10 %": _of(knee=0.1),
    "knee 15 %": _of(knee=0.15),
    "robot irb4600": _with(robot="irb4600"),
    "forearm stated 100 mm too long": _with(forearm_error=0.1),
    "b1 declared with 1800 lines": _with(lines=1800),
    "b1 declared with 5000 lines": _with(lines=5000),
    "columns b1 and b2 swapped": _with(swapped=(1, 2)),
    "columns b4 and b5 swapped": _with(swapped=(4, 5)),
    "motors 5 and 6 swapped": _with(swapped_motors=(5, 6)),
    "sign of b1": _with(sign=1),
    "sign of motor 1": _with(motor_sign=1),
    "sign of motor 6": _with(motor_sign=6),
    "rod stated 1 mm too long": _with(rod_error=1e-3),
    "rod stated 20 mm too long": _with(rod_error=20e-3),
    "measured rod 50 um wrong": EFFECTS["rod50"],
    "logs of different runs": Case(crossed=True),
    "10 s of one recording": Case(faults=(Faults(keep=(20.0, 30.0)),), single=True),
    "20 s of one recording": Case(faults=(Faults(keep=(20.0, 40.0)),), single=True),
    "few joints move": Case(reach=(1.0, 0.0, 0.0, 0.0, 1.0)),
    "b1 a row late": _with(late=1),
    "b5 a row late in one": _first_with(late=5),
    "motor 2 times 1.001": _with(scaled=(2, 1.001)),
    "motor 6 times 1.001": _with(scaled=(6, 1.001)),
    "b2 slips by 0.5 mrad": _first_with(slip=(2, 5e-4)),
    "motor 3 stuck": _with(still=(3,)),
    "clock set by 20 ms halfway": _first_with(clock_step=0.02),
    "two robots": Case(other_robot=True),
    "two tools": Case((Effects(), Effects(tool_mass=5.0))),
}


@dataclass(frozen=True)
class Row:
    """How one case ended."""

    robot: int
    case: str
    status: str
    tcp_mean_mm: float = np.nan
    tcp_max_mm: float = np.nan
    tcp_clear_mm: float = np.nan  # largest where every flank is clear
    tcp_sigma_mm: float = np.nan
    bound_mean_mm: float = np.nan
    bound_max_mm: float = np.nan
    bound_drawn_mm: float = np.nan  # of the mean, at the drawn errors of plate and axis offset
    geometry_held: int = 0
    geometry_count: int = 0
    stiffness_held: int = 0
    stiffness_count: int = 0
    clock_sigmas: float = np.nan  # the worst of offsets and rates
    clock_us: float = np.nan
    stiffness_low: float = np.nan
    stiffness_high: float = np.nan
    seconds: float = np.nan
    acceptable: bool = False
    sentence: str = field(default="")
    draws: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 0)), repr=False)
    at_drawn: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2, 0)), repr=False)

    @property
    def deceived(self) -> bool:
        """Whether the verdict is acceptable and the answer is not."""
        wrong = self.tcp_mean_mm > TWICE * self.tcp_sigma_mm or self.clock_sigmas > CLOCK
        return self.acceptable and wrong


def row_of(robot: int, name: str, case: Case) -> Row:
    """Record one case and identify it."""
    with tempfile.TemporaryDirectory() as scratch:
        folders, truths = _recordings(robot, case, Path(scratch))
        options = FitOptions(rod_sigma=case.rod_known or None)
        begun = time.perf_counter()
        try:
            found = identify(*folders, options=options).data.identification
        except (InputError, StartError, FailureError) as error:
            seconds = time.perf_counter() - begun
            return Row(robot, name, "refused", seconds=seconds, sentence=str(error))
        return _judged(robot, name, found, truths, time.perf_counter() - begun)


def _recordings(robot: int, case: Case, scratch: Path) -> tuple[list[Path], list[Truth]]:
    folders, truths = [], []
    for k in range(1 if case.single else 2):
        seed = robot + 1000 * (case.other_robot and k == 1)
        plan = Plan(seed, case.effects[min(k, len(case.effects) - 1)], rod_known=case.rod_known)
        if case.reach:
            degrees = tuple(r * f for r, f in zip(FIRST.reach_deg, case.reach, strict=True))
            chosen = replace(FIRST, reach_deg=degrees)
            plan = replace(plan, paths=(chosen, replace(chosen, seed=8)))
        folders.append(scratch / str(k + 1))
        faults = case.faults[min(k, len(case.faults) - 1)]
        truths.append(record_path(plan, k, folders[-1], faults))
    if case.crossed:
        a, b = (folder / "raw" / "robot.csv" for folder in folders)
        shutil.copy(b, a)
        return folders[:1], truths[:1]
    return folders, truths


def _judged(
    robot: int, name: str, found: Identification, truths: Sequence[Truth], seconds: float
) -> Row:
    q = accuracy_box(files())
    error = 1e3 * aligned_distance(found.robot.identified.tool(q), truths[0].tool(q))
    flanks = truths[0].flanks(q)
    clear = (np.abs(flanks - np.rint(flanks)) < 1.0 - CLEAR).all(axis=1)
    draws = 1e3 * bound_draws(found, q, robot)
    at_drawn = 1e3 * bound_draws(found, q, robot, truths[0].machine)
    geometry, stiffness = (
        errors(found, truths[0].machine) for errors in (geometry_errors, stiffness_errors)
    )
    clocks, offsets = [0.0], [0.0]
    for own, truth in zip(found.recordings, truths, strict=True):
        if own.clock is not None:
            pairs = (own.clock.offset - truth.offset, own.clock.skew - truth.skew)
            clocks += [abs(e) / s for e, s in zip(pairs, own.clock_sigma, strict=True)]
            offsets.append(1e6 * abs(pairs[0]))
    values = {c.name: c.value for group in found.robot.corrections for c in group.coefficients}
    compliance = np.array([values.get(f"compliance{i + 1}", np.nan) for i in range(6)])
    ratio = true_compliance(truths[0].machine) / compliance
    return Row(
        robot=robot,
        case=name,
        status=str(found.verdict.status),
        tcp_mean_mm=float(error.mean()),
        tcp_max_mm=float(error.max()),
        tcp_clear_mm=float(error[clear].max()),
        bound_mean_mm=float(np.median(draws[0])),
        bound_max_mm=float(np.median(draws[1])),
        bound_drawn_mm=float(np.median(at_drawn[0])),
        geometry_held=held(geometry),
        geometry_count=geometry.size,
        stiffness_held=held(stiffness),
        stiffness_count=stiffness.size,
        tcp_sigma_mm=1e3 * float(found.robot.tcp_sigma.mean()),
        clock_sigmas=float(max(clocks)),
        clock_us=float(max(offsets)),
        stiffness_low=float(ratio.min()),
        stiffness_high=float(ratio.max()),
        seconds=seconds,
        acceptable=found.verdict.acceptable,
        sentence=found.verdict.sentence,
        draws=draws,
        at_drawn=at_drawn,
    )


def main() -> None:
    """Records, identifies, prints every case as it ends, and writes all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=3)
    parser.add_argument("--effects", default=",".join(EFFECTS), help="names, by comma")
    parser.add_argument("--attacks", action="store_true", help="attacks instead of effects")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("unknown_machines.csv"))
    given = parser.parse_args()
    if unknown := set(given.effects.split(",")) - EFFECTS.keys():
        parser.error(f"no effect {', '.join(unknown)}; there are {', '.join(EFFECTS)}")
    cases = ATTACKS if given.attacks else {n: EFFECTS[n] for n in given.effects.split(",")}
    robots = [1] if given.attacks else range(1, given.robots + 1)
    with ProcessPoolExecutor(given.workers) as pool:
        jobs = [
            pool.submit(row_of, robot, name, case)
            for name, case in cases.items()
            for robot in robots
        ]
        rows = [_said(job.result()) for job in jobs]
    columns = [f.name for f in fields(Row) if f.name not in ("draws", "at_drawn")]
    write_table(given.out, rows, ".5g", columns)
    deceived = [row for row in rows if row.deceived]
    print(f"{len(deceived)} of {len(rows)} acceptable and wrong: "
          f"{', '.join(f'{r.case} ({r.robot})' for r in deceived) or 'none'}")  # fmt: skip
    if not given.attacks:
        _summary(rows)


def _said(row: Row) -> Row:
    print(
        f"{row.case:28} {row.robot:3} {row.status:13} TCP {row.tcp_mean_mm:.4f} / "
        f"{row.tcp_max_mm:.4f}, stated {row.tcp_sigma_mm:.4f}; clock {row.clock_sigmas:.1f} sigma; "
        f"stiffness {row.stiffness_low:.2f} to {row.stiffness_high:.2f}; {row.seconds:.1f} s"
        f"{'; DECEIVED' * row.deceived}\n      {row.sentence}",
        flush=True,
    )
    return row


def _summary(rows: Iterable[Row]) -> None:
    """Median over the robots of each effect."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.case, []).append(row)
    for name, group in groups.items():
        columns = ("tcp_mean_mm", "tcp_max_mm", "tcp_sigma_mm", "clock_sigmas")
        mean, top, stated, clock = (
            np.median([getattr(r, column) for r in group]) for column in columns
        )
        print(f"{name:14} median TCP {mean:.4f} / {top:.4f}, stated {stated:.4f}; "
              f"clock {clock:.1f} sigma; {sum(r.acceptable for r in group)} of {len(group)} "
              "acceptable")  # fmt: skip
        if judged := [r for r in group if r.draws.size]:
            _uncertainty(name, judged)


def _uncertainty(name: str, group: Sequence[Row]) -> None:
    """The bound of priors and noise, the truth of the stated, and each figure within its limits."""

    def column(key: str) -> NDArray[np.float64]:
        return np.array([getattr(row, key) for row in group], dtype=float)

    mean, largest = column("tcp_mean_mm"), column("tcp_max_mm")
    bound = np.median(np.concatenate([r.draws for r in group], axis=1), axis=1)
    low, high = _chance(group)
    ratio = np.median(mean) / bound[0], np.median(largest) / bound[1]
    print(f"    bound {bound[0]:.4f} / {bound[1]:.4f}; found over it {ratio[0]:.2f} / "
          f"{ratio[1]:.2f}, where chance with {len(group)} robots leaves {low:.2f} to {high:.2f} "
          "(95 %); largest where every flank is clear "
          f"{np.median(column('tcp_clear_mm')):.4f}")  # fmt: skip
    shares = {
        kind: column(f"{kind}_held").sum() / max(1.0, column(f"{kind}_count").sum())
        for kind in ("geometry", "stiffness")
    }
    figures = {
        "mean": np.median(mean),
        "largest": np.median(largest),
        "worst mean": mean.max(),
        "worst largest": largest.max(),
        "over the bound": np.median(mean) / bound[0],
        "at drawn lengths": np.median(mean) / np.median([r.at_drawn[0] for r in group]),
        "over stated, rms": np.sqrt(((mean / column("tcp_sigma_mm")) ** 2).mean()),
        **{f"{kind} held": share for kind, share in shares.items()},
    }
    for key, limits in (LIMITS.get(name, {}) | EACH).items():
        print(f"    {key:17} {figures[key]:.4f}, {place(float(figures[key]), limits)} "
              f"{limits[0]:g} to {limits[1]:g}")  # fmt: skip


def _chance(group: Sequence[Row]) -> tuple[float, float]:
    """95 % range of the median robot's mean error over the bound, were the bound attained."""
    rng, draws = np.random.default_rng(0), np.stack([r.draws[0] for r in group])
    picked = rng.integers(draws.shape[1], size=(STUDIES, len(group)))
    medians = np.median(draws[np.arange(len(group)), picked], axis=1) / np.median(draws)
    low, high = np.quantile(medians, (0.025, 0.975))
    return float(low), float(high)


if __name__ == "__main__":
    main()
