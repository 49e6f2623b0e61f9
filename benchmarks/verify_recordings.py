"""How often `ballbar verify` of a recording names rightly what changed, and how often falsely.

    python -m benchmarks.verify_recordings
    python -m benchmarks.verify_recordings --everything-on --robots 10     # ten minutes

Robots with drawn geometry, ripple of gears and resolvers, listed and not, and errors of the
encoders, on the kinematic plant. Each is identified from 120 s of path a. Then come recordings of
60 s of path b, with the ball-bar's base placed and its encoders mounted again: of the robot as it
was, and after one change (`CHANGES`). Writes docs/studies/verify_recordings.csv.

--everything-on : robots with every error source in MuJoCo and motor torque, identified from both
manual paths; then three recordings of each as it was (`AGAIN`). Prints whether they hold.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbar.scenario import Scenario
from benchmarks.study import STUDIES, study_parser, write_table
from ident.identify import identify_together
from ident.options import FitOptions
from ident.verification import RecordingVerification, verify_recording
from tests.helpers.drawn_machines import OPTIONS, Truth, drawn, identified, recorded
from tests.helpers.drawn_robots import recorded as recorded_robot
from tests.helpers.drawn_robots import scenario_of

STUDY = STUDIES / "verify_recordings.csv"
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
        x, y, z = rng.uniform(low, high, 3) * rng.choice([-1.0, 1.0], 3)
        moves = {plate: x, "rtheta6": y / truth.geometry[plate], "rd6": z}
        return _moved(truth, moves), "tool", float(np.linalg.norm((x, y, z)))
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
    shares = truth.cell.robot.controller_to_joint[axis - 1]
    moves = {f"rtheta{j}": size * float(s) for j, s in enumerate(shares, start=1) if s}
    return _moved(truth, moves)


def _moved(truth: Truth, moves: dict[str, float]) -> Truth:
    true = truth.geometry
    return replace(truth, geometry=true.replaced({n: true[n] + v for n, v in moves.items()}))


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


def _columns(outcome: RecordingVerification) -> dict[str, object]:
    named = [f"{e.cause.kind} {e.cause.axis or ''}".strip() for e in outcome.named]
    return {
        "holds": outcome.holds,
        "named": ", or ".join(named),
        "evidence": outcome.statistic,
        "limit": outcome.limit,
        "innovation": outcome.innovation,
        "misfit": outcome.misfit,
    }


def unchanged_with_everything(seed: int) -> Iterator[RecordingVerification]:
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
    options = parser.parse_args()
    if options.everything_on:
        for seed in range(1, options.robots + 1):
            for outcome in unchanged_with_everything(seed):
                print(seed, outcome.sentence, flush=True)
        return
    rows: list[dict[str, object]] = []
    for seed in range(1, options.robots + 1):
        rows += rows_of(seed, options.checks, options.changes)
        write_table(STUDY, rows, ".4g")
        print(f"robot {seed} of {options.robots}", flush=True)
    for kind in ("none", *KINDS):
        own = [row for row in rows if str(row["change"]).split()[0] == kind]
        print(kind, *_shares(own))


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
