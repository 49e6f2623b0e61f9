"""The experiments of thesis sec. 5.3 in the simulated cell: studies/experiments.csv and figures.

    python -m generators.thesis_5_3

The thesis looked at base, joints and rod with an optical system (90 um) and a force sensor; here
the plant's own coordinates stand beside what a simulated optical tracker sees of them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_whole
from ballbar.scenario import load_scenario
from ballbar.sim.logging.load_logs import OpticalTracker, drawn_tracker, tracker_rows
from ballbar.sim.motion import Motion, deflect
from ballbar.sim.simulate import Simulation, simulate
from tests.helpers.log_analysis import force_near_singularity
from tests.helpers.simulated_recordings import singular_passage

ROOT = Path(__file__).parent.parent
SCENARIOS, DOCS = ROOT / "scenarios", ROOT / "docs"
EXPERIMENTS = DOCS / "studies" / "experiments.csv"  # a part of docs/thesis_figures.md
mpl.rcParams |= {
    "svg.hashsalt": "thesis_5_3",
    "font.size": 8,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.axisbelow": True,
}
BANDS = [(0.0, 1.0), (1.0, 3.0), (3.0, 10.0), (10.0, 90.0)]  # [deg] from b4 = 0
_FEW = slice(None, None, 60)  # of a millisecond grid: what a curve needs

ROWS = (  # docs/studies/experiments.csv: what, of the thesis, here
    ("rod and two joints at 150 N (Fig. 5.8)", "2.7 + 2 x 2.8 um", "{strain:.2f} um"),
    (
        "backlash at force reversal (Fig. 5.9)",
        "below 5 um a joint",
        "{backlash:.2f} um, as the scenario sets it ({scenario:.1f} um)",
    ),
    (
        "distance of joint from seat, pull minus push, by an optical tracker (90 um a row)",
        '"can therefore not be completely trusted"',
        "{seen:.1f} um +- {sigma:.1f} (1 sigma of {pulled} and {pressed} rows), true {true:.1f} um",
    ),
    (
        "force along a path, soft servo, Table 3.1 errors (Fig. 5.7)",
        "150 N ([derived](notes/plant.md#experiment))",
        "{low:.0f} to {high:.0f} N",
    ),
    ("the same, everything on", "-", "{full_low:.0f} to {full_high:.0f} N"),
    (
        "deviation from a sphere along the path, everything on",
        "8.3 um computed, 25 um measured",
        "{sphere_low:.1f} to {sphere_high:.1f} um",
    ),
)


def simulated(name: str) -> Simulation:
    """One of the shipped scenarios."""
    return simulate(load_scenario(SCENARIOS / f"{name}.yaml"), relative_to=SCENARIOS)


def pull_push(motion: Motion) -> tuple[float, float]:
    """Stretch at 150 N beyond the backlash, and the backlash [m], from force and stretch."""
    force, stretch = motion.rod_force, motion.rod_stretch
    lines = [np.polyfit(force[side], stretch[side], 1) for side in (force > 20.0, force < -20.0)]
    (pull, zero), (push, other) = lines
    return 75.0 * float(pull + push), float(zero - other)


def sphere_deviation(motion: Motion) -> Array:
    """(K,) [m] distance of the ball-bar's end from its nominal seat, less the rod's length."""
    n = motion.t.size
    base, plate = np.broadcast_to(motion.base, (n, 3)), np.zeros(n)
    bar = deflect(
        motion.geometry, motion.q, motion.b, stretch=motion.rod_stretch, plate=plate, base=base
    ).bar
    rigid = deflect(
        motion.geometry, motion.q, motion.b, stretch=np.zeros(n), plate=plate, base=np.zeros((n, 3))
    ).bar
    seat = motion.geometry.origin[:, None]
    return np.asarray(
        np.linalg.norm(bar.tip - seat, axis=0) - np.linalg.norm(rigid.tip - seat, axis=0)
    )


def length_by_tracker(simulation: Simulation) -> dict[str, float]:
    """Distance [um] of joint from seat, pull minus push: true, and by a tracker with its sigma.

    The LED sits at the centre of the universal joint. `least` : [N] from which a row counts.
    """
    motion, seed = simulation.motion, simulation.truth.seed
    tracker = OpticalTracker(led_m=(0.0, 0.0, 0.0), offset_s=0.0)
    drawn = drawn_tracker(tracker, seed)
    assert drawn is not None
    seat = drawn.seen(motion.geometry.origin[None])
    (stamps, logged), (_, exact) = (
        tracker_rows(motion, (0.0, float(motion.t[-1])), tracker=each, drawn=drawn, seed=seed)
        for each in (tracker, tracker.model_copy(update={"noise_m": 0.0}))
    )
    force = np.interp(stamps - stamps[0], motion.t, motion.rod_force)
    least = 0.5 * float(min(force.max(), -force.min()))
    pull, push = force > least, force < -least
    lengths = (np.linalg.norm(points - seat, axis=1) for points in (exact, logged))
    true, seen = (float(length[pull].mean() - length[push].mean()) for length in lengths)
    return {
        "true": true * 1e6,
        "seen": seen * 1e6,
        "sigma": tracker.noise_m * float(np.sqrt(1.0 / pull.sum() + 1.0 / push.sum())) * 1e6,
        "least": least,
        "pulled": int(pull.sum()),
        "pressed": int(push.sum()),
    }


def main() -> None:
    """Runs the three scenarios, draws the figures and writes the table."""
    pushed, path, full = (
        simulated("irb2400_push_pull"),
        simulated("irb2400"),
        simulated("irb2400_full"),
    )
    strain, backlash = pull_push(pushed.motion)
    deviation = sphere_deviation(full.motion)
    _pull_push_figure(pushed.motion)
    _over_time(
        "path_force",
        {"main scenario": path.motion.rod_force, "everything on": full.motion.rod_force},
        path.motion.t,
        "rod force [N]",
    )
    _over_time(
        "sphere_deviation",
        {"everything on": deviation * 1e6},
        full.motion.t,
        "deviation from the sphere [um]",
    )
    numbers = dict(
        **length_by_tracker(pushed),
        strain=strain * 1e6,
        backlash=backlash * 1e6,
        scenario=2e6 * pushed.truth.plant.rod_backlash_half_width_m,
        low=path.truth.rod_force.min_N,
        high=path.truth.rod_force.max_N,
        full_low=full.truth.rod_force.min_N,
        full_high=full.truth.rod_force.max_N,
        sphere_low=deviation.min() * 1e6,
        sphere_high=deviation.max() * 1e6,
    )
    rows = [tuple(cell.format(**numbers) for cell in row) for row in ROWS]
    write_table(EXPERIMENTS, [("what", "thesis", "here"), *rows, _passage()])


def write_table(path: Path, rows: Sequence[tuple[str, ...]]) -> None:
    """Writes rows as CSV."""
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    write_whole(path, buffer.getvalue().encode())


def _passage() -> tuple[str, str, str]:
    """Row of the forces near a singularity of the ball-bar, with and without friction of it."""
    rubbing, smooth = (
        force_near_singularity(singular_passage(friction=friction), BANDS)
        for friction in (True, False)
    )
    bands = ", ".join(f"{low:g} to {high:g}" for low, high in BANDS)
    largest = ", ".join(f"{force:.0f}" for force, _ in rubbing)
    fast, without = (", ".join(f"{rms:.3f}" for _, rms in each) for each in (rubbing, smooth))
    return (
        f"force with b4 {bands} deg from singularity; rms above 2 Hz; without bearing friction",
        "larger force, oscillating",
        f"{largest} N; {fast} N; {without} N",
    )


def _pull_push_figure(motion: Motion) -> None:
    figure, axes = plt.subplots(figsize=(5.2, 3.0))
    along = np.linalg.norm(motion.base, axis=1) * np.sign(motion.rod_force)
    axes.plot(
        motion.rod_force[_FEW],
        motion.rod_stretch[_FEW] * 1e6,
        "-",
        lw=1.2,
        color="#1f5fa8",
        label="rod and joints",
    )
    axes.plot(motion.rod_force[_FEW], along[_FEW] * 1e6, "-", lw=1.2, color="#d9822b", label="base")
    axes.set_xlabel("force along the rod, tension positive [N]")
    axes.set_ylabel("movement [um]")
    axes.legend(frameon=False)
    _save(figure, "pull_push")


def _over_time(name: str, curves: dict[str, Array], t: Array, label: str) -> None:
    figure, axes = plt.subplots(figsize=(6.4, 2.4))
    for (title, values), colour in zip(curves.items(), ("#1f5fa8", "#d9822b"), strict=False):
        axes.plot(t[::100], values[::100], lw=0.9, color=colour, label=title)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.legend(frameon=False, loc="lower right")
    _save(figure, name)


def _save(figure: plt.Figure, name: str) -> None:
    path = DOCS / "images" / f"{name}.svg"
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    main()
