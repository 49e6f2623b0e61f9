"""How often `ballbar verify` of a recording names rightly what changed, and how often falsely.

    python -m benchmarks.verify_recordings
    python -m benchmarks.verify_recordings --everything-on --robots 10     # ten minutes
    python -m benchmarks.verify_recordings --lengths --robots 40           # ten minutes

Robots with drawn geometry, ripple of gears and resolvers, listed and not, and errors of the
encoders, on the kinematic plant. Each is identified from 120 s of path a. Then come recordings of
60 s of path b, with the ball-bar's base placed and its encoders mounted again: of the robot as it
was, and after one change (`CHANGES`). Writes docs/studies/verify_recordings.csv.

--everything-on : robots with every error source in MuJoCo and motor torque, identified from both
manual paths; then three recordings of each as it was (`AGAIN`). Prints whether they hold.

--lengths : robots of the scenario irb2400_telescoping, each with its own geometry, identified from
120 s of its path; then a recording of the path as it was and one after a change (`OF_LENGTHS`), the
bar's seat placed again; a change that the stroke of the bar does not take is drawn again. Writes
docs/studies/verify_lengths.csv. Two processes.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry
from ballbar.ident.identify import identify_together
from ballbar.ident.options import FitOptions
from ballbar.ident.verification import Verification
from ballbar.ident.verify_recording import verify_recording
from ballbar.scenario import Scenario
from ballbar.sim.true_robot import TrueMachine
from benchmarks.study import STUDIES, study_parser, write_table
from tests.helpers import drawn_lengths
from tests.helpers.drawn_machines import OPTIONS, Truth, drawn, identified, recorded
from tests.helpers.drawn_robots import recorded as recorded_robot
from tests.helpers.drawn_robots import scenario_of

STUDY, LENGTH_STUDY = STUDIES / "verify_recordings.csv", STUDIES / "verify_lengths.csv"
# Sizes of the changes: log-uniform between these, of either sign. A gear has other phases of its
# ripple and resolver, and another zero.
CHANGES = {
    "axis": (5e-5, 2e-3),  # [rad] axes 2 to 6
    "tool": (3e-5, 1e-3),  # [m] along each direction of the flange
    "rod": (2e-5, 2e-4),  # [m]
    "plate": (2e-5, 2e-4),  # [m]
    "gear": (5e-5, 1e-3),  # [rad] of its zero
}
KINDS = tuple(CHANGES)
# Of a sensed length, whose stroke is 1 mm either way.
OF_LENGTHS = {
    "axis": (5e-5, 5e-4),  # [rad] axes 2 to 6
    "tool": (3e-5, 3e-4),  # [m] along each direction of the flange
    "length": (3e-5, 2e-4),  # [m] zero of the sensor
    "scale": (1e-4, 6e-4),  # [1] of the sensor
    "geometry": (5e-5, 4e-4),  # [m, rad] one of `BENT`
}
BENT = ("ra1", "ra2", "ra3", "rd4", "ralpha1", "ralpha2", "ralpha3", "ralpha4")
# Paths and positions [m] of the ball-bar of recordings with every error source
IDENTIFIED = (("a", None), ("b", None))
AGAIN = (*IDENTIFIED, ("planned", [0.897, -0.195, 0.486]))


def changed(truth: Truth, kind: str, rng: np.random.Generator) -> tuple[Truth, str, float]:
    """The robot after one change, its name, and the size of the change."""
    low, high = CHANGES[kind]
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))) * rng.choice([-1.0, 1.0]))
    axis = int(rng.integers(2, 7))
    if kind == "axis":
        return _with_zero(truth, axis, size), f"axis {axis}", size
    if kind == "rod":
        return _moved(truth, {"bd3": size}), "rod", size
    plate = truth.geometry.table.plate
    if kind == "plate":
        return _moved(truth, {plate: size}), "plate", size
    if kind == "tool":
        moves, size = _tool_moves(truth.geometry, (low, high), rng)
        return _moved(truth, moves), "tool", size
    ripples = tuple(
        replace(r, phase=float(rng.uniform(0.0, 2.0 * np.pi))) if r.gear == axis - 1 else r
        for r in truth.effects.ripples
    )
    motors = list(truth.resolvers.motors)
    motors[axis - 1] = tuple(
        h.model_copy(update={"phase_rad": float(rng.uniform(0.0, 2.0 * np.pi))})
        for h in motors[axis - 1]
    )
    resolvers = truth.resolvers.model_copy(update={"motors": tuple(motors)})
    exchanged = replace(truth, effects=replace(truth.effects, ripples=ripples), resolvers=resolvers)
    return _with_zero(exchanged, axis, size), f"gear {axis}", size


def _with_zero(truth: Truth, axis: int, size: float) -> Truth:
    """The zero of one axis moved by `size` [rad]."""
    return _moved(truth, _zero_moves(truth.cell, axis, size))


def _zero_moves(cell: Cell, axis: int, size: float) -> dict[str, float]:
    """Changes [rad] of joint angles when the zero of one axis moves by `size` [rad]."""
    shares = cell.robot.controller_to_joint[axis - 1]
    return {f"rtheta{j}": size * float(s) for j, s in enumerate(shares, start=1) if s}


def _tool_moves(
    geometry: Geometry, sizes: tuple[float, float], rng: np.random.Generator
) -> tuple[dict[str, float], float]:
    """Changes of the last row when the tool moves by `sizes` [m] along each direction of the
    flange, and by how much [m].
    """
    plate = geometry.table.plate
    x, y, z = rng.uniform(*sizes, 3) * rng.choice([-1.0, 1.0], 3)
    moves = {plate: x, "rtheta6": y / geometry[plate], "rd6": z}
    return moves, float(np.linalg.norm((x, y, z)))


def _moved(truth: Truth, moves: dict[str, float]) -> Truth:
    true = truth.geometry
    return replace(truth, geometry=true.replaced({n: true[n] + v for n, v in moves.items()}))


def changed_length(
    truth: TrueMachine, kind: str, rng: np.random.Generator
) -> tuple[TrueMachine, str, float]:
    """Same as `changed`, for a robot to whose tool a length is measured."""
    low, high = OF_LENGTHS[kind]
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))) * rng.choice([-1.0, 1.0]))
    true, table, name = truth.true, truth.true.table, kind
    moves = {"bd3": size}
    if kind == "axis":
        axis = int(rng.integers(2, 7))
        name = f"axis {axis}"
        moves = _zero_moves(truth.cell, axis, size)
    elif kind == "tool":
        moves, size = _tool_moves(true, (low, high), rng)
    elif kind == "scale":
        lengths = [p.name for p in table.parameters if p.side == "robot" and p.is_length]
        moves = {n: -size * true[n] for n in lengths}
    elif kind == "geometry":
        name = str(rng.choice(BENT))
        moves = {name: size}
    return drawn_lengths.moved(truth, moves), name, size


def rows_of(seed: int, checks: int, changes: int) -> list[dict[str, object]]:
    """Checks of one robot: unchanged, then `changes` of each kind."""
    truth = drawn(seed)
    machine = identified(truth)
    rows = []
    for kind, count in (("none", checks), *((kind, changes) for kind in KINDS)):
        for k in range(count):
            rng = np.random.default_rng([seed, 1 + ("none", *KINDS).index(kind), k])
            now, name, size = (truth, "none", 0.0) if kind == "none" else changed(truth, kind, rng)
            logs, begin = recorded(now, "b", 60.0, rng), time.process_time()
            outcome = verify_recording(machine, logs, options=OPTIONS)
            rows.append(
                {"robot": seed, "change": name, "size_um_urad": size * 1e6}
                | _columns(outcome)
                | {"cpu_s": time.process_time() - begin}
            )
    return rows


def rows_of_lengths(seed: int) -> list[dict[str, object]]:
    """Checks of one robot and its telescoping bar: unchanged, and after one change."""
    truth = drawn_lengths.drawn_machine(seed)
    machine, rng = drawn_lengths.identified(truth, seed), np.random.default_rng([seed, 1])
    kind, rows = tuple(OF_LENGTHS)[(seed - 1) % len(OF_LENGTHS)], []
    for recording, changes in enumerate((False, True), start=2):
        logs = None
        while logs is None:
            now, name, size = truth, "none", 0.0
            if changes:
                now, name, size = changed_length(truth, kind, rng)
            with suppress(InputError):  # the bar's stroke does not take every change
                scenario = drawn_lengths.bar_scenario(seed, recording)
                logs = drawn_lengths.recorded(now, scenario, rng)
        begin = time.process_time()
        outcome = verify_recording(machine, logs)
        rows.append(
            {"robot": seed, "change": name, "size_um_urad": size * 1e6}
            | _columns(outcome)
            | {"cpu_s": time.process_time() - begin}
        )
    return rows


def _columns(outcome: Verification) -> dict[str, object]:
    named = [
        e.cause.names[0] if e.cause.kind == "geometry" else f"{e.cause.kind} {e.cause.axis or ''}"
        for e in outcome.named
    ]
    return {
        "holds": outcome.holds,
        "named": ", or ".join(name.strip() for name in named),
        "evidence": outcome.figures["log_bayes_factor"],
        "limit": outcome.limit,
        "innovation": outcome.figures["normalised_innovation"],
        "misfit": outcome.figures["chi2_per_dof_with_free_machine"],
    }


def unchanged_with_everything(seed: int) -> Iterator[Verification]:
    """Checks of one robot with every error source, as it was."""
    options = FitOptions(model="complete", force="torque")
    with tempfile.TemporaryDirectory() as folder:
        logs = []
        for number, (path, position) in enumerate((*IDENTIFIED, *AGAIN), start=1):
            data = scenario_of("irb2400", "a", seed, 120.0).model_dump(
                mode="json", by_alias=True, exclude_none=True
            )
            data["path"]["file"] = f"paths/irb2400_{path}.yaml"
            data |= {"recording": number, "logs": {"torque": {}}}
            if position:
                data["cell"]["ballbar_position_m"] = position
            scenario = Scenario.model_validate(data, strict=False)
            cell, own, _ = recorded_robot(scenario, Path(folder) / str(number))
            logs.append(own)
    first = len(IDENTIFIED)
    machine = identify_together(cell, logs[:first], options=options).machine
    for own in logs[first:]:
        yield verify_recording(machine, own, options=FitOptions(force="torque"))


def main() -> None:
    """Runs the study and prints what it comes to."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--checks", type=int, default=20, help="of each robot, unchanged")
    parser.add_argument("--changes", type=int, default=2, help="of each kind, of each robot")
    parser.add_argument("--everything-on", action="store_true")
    parser.add_argument("--lengths", action="store_true")
    options = parser.parse_args()
    if options.everything_on:
        for seed in range(1, options.robots + 1):
            for outcome in unchanged_with_everything(seed):
                print(seed, outcome.sentence, flush=True)
        return
    rows: list[dict[str, object]] = []
    if options.lengths:
        with ProcessPoolExecutor(2) as pool:
            for done in pool.map(rows_of_lengths, range(1, options.robots + 1)):
                rows += done
                write_table(LENGTH_STUDY, rows, ".4g")
        _say(rows, (*OF_LENGTHS,))
        return
    for seed in range(1, options.robots + 1):
        rows += rows_of(seed, options.checks, options.changes)
        write_table(STUDY, rows, ".4g")
        print(f"robot {seed} of {options.robots}", flush=True)
    _say(rows, KINDS)


def _say(rows: Sequence[dict[str, object]], kinds: Sequence[str]) -> None:
    """Prints the counts of the checks of each kind of change."""
    for kind in ("none", *kinds):
        of_kind = [row for row in rows if _kind_of(str(row["change"])) == kind]
        print(kind, *_shares(of_kind))


def _kind_of(change: str) -> str:
    """The kind of a change, of its name."""
    return "geometry" if change in BENT else change.split(maxsplit=1)[0]


def _shares(rows: list[dict[str, object]]) -> list[str]:
    """Counts of checks of one kind: that hold, name the cause alone, among several, wrongly."""
    named = [(str(row["named"]).split(", or "), row["change"]) for row in rows]
    alone = sum(names == [change] for names, change in named)
    among = sum(change in names and len(names) > 1 for names, change in named)
    wrong = sum(names != [""] and change not in names for names, change in named)
    holds = sum(bool(row["holds"]) for row in rows)
    return [
        f"{len(rows)} checks:", f"{holds} hold,", f"{alone} named alone,",
        f"{among} named among several,", f"{wrong} named wrongly",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
