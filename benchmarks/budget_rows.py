"""Rows of the uncertainty budget against what their sources do: each switched on and off.

    python -m benchmarks.budget_rows              # 250 seeds; five minutes of one core
    python -m benchmarks.budget_rows --seeds 60

A minute of an IRB 2400 with ripple in its gears on a ball-bar with four encoders, and 60 poses of a
UR5 seen by a tracker, in numpy. Every source is drawn from a stream of its own: the true robot,
ripple, plate, rod and axes of the instrument by their priors' deviations, with either sign; noise
of logs, stamps, gears and instrument is normal. Every row above 3 % of the variance is tried with
the weights of all sources: the fit with the source's errors and with their negatives (antithetic
draws), less the fit without them, in mean squares of the tool's error over the workspace. Writes
docs/studies/budget_rows.csv.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import Geometry, parameter_named, robot_geometry
from ballbar.cell.load import load_robot
from ballbar.cell.placement import Placement
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections import correction_named
from ballbar.ident.estimator.build_unknowns import (
    RecordingStart,
    arm_parameters,
    complete_unknowns,
    still_unknowns,
)
from ballbar.ident.estimator.fit import Fit, fit
from ballbar.ident.estimator.gauss_newton import inverse
from ballbar.ident.estimator.model import Model, gearing, still_model
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.priors import robot_prior
from ballbar.ident.estimator.robust_fit import fit_unweighted
from ballbar.ident.estimator.samples import Samples, samples_of
from ballbar.ident.estimator.unknowns import PlacedPoses
from ballbar.ident.estimator.variance_parts import variance_parts
from ballbar.ident.robot.accuracy import accuracy_grid, aligned_columns, position_error
from ballbar.ident.robot.budget import row_of
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.pose_covariance import PoseCovariance
from benchmarks.study import STUDIES, in_words, study_parser, write_table
from tests.helpers.still_poses import SEAT, TARGET, angles, group
from tests.helpers.synthetic_recording import (
    CELL,
    NO_CLOCK_ERROR,
    NOMINAL,
    ROWS_PER_SAMPLE,
    UNIVERSAL_AND_GIMBAL,
    closed,
    exact_log,
    minute,
)

LEAST = 0.03  # share of the variance from which a row is tried
Signs = dict[str, float]  # of each source: 1 or -1, 0 where it is off
Squares = Callable[[int, Signs], float]  # mean square of the tool's error [m^2] of a seed

LOG, ENCODER, STAMP = 4e-6, 4e-6, 2e-5  # [rad], [rad], [s] white noise of a sample
EXCESS = ExcessNoise(gear=8e-6, wrist=1.2e-5, bar=8e-6)
GRID = accuracy_grid(CELL.robot)[::4]
RIPPLE = correction_named("gear_ripple", CELL, UNIVERSAL_AND_GIMBAL)
ROUNDS = 3  # from actual angles to logged ones; each gains three digits

POSES, INSTRUMENT, ROUNDED = 60, 4e-5, 3e-5  # number, [m], [rad]
LEFT_OVER = ExcessNoise(position=8e-5)
SEEN_FROM = "tracker"
UR5 = load_robot("ur5")


def drawn(seed: int, source: str, sign: float, shape: tuple[int, ...]) -> Array:
    """Normal numbers of one source of one seed, from a stream of its own."""
    key = [seed, *source.encode()]
    return sign * np.random.default_rng(key).standard_normal(shape)


def of_prior(seed: int, source: str, signs: Signs, shape: tuple[int, ...]) -> Array:
    """Deviations of one source from its prior, in standard deviations: 1 with either sign."""
    return signs.get(source, 0.0) * np.sign(drawn(seed, source, 1.0, shape))


@dataclass(frozen=True)
class Case:
    """A measurement whose budget is tried."""

    name: str
    squares: Squares
    rows: dict[str, float] = field(default_factory=dict)  # [m^2] of each source


def bar_model() -> tuple[Model, Array]:
    """Model and start of the minute on a ball-bar; its samples hold the noise that is stated."""
    start = RecordingStart(UNIVERSAL_AND_GIMBAL, NOMINAL, NO_CLOCK_ERROR)
    layout, x = complete_unknowns(
        CELL, NOMINAL, [start], (RIPPLE,), gain_sigma=None, rod_sigma=None
    )
    samples = bar_samples(true_bar(NOMINAL, np.zeros(len(RIPPLE.coefficients))), 0, {})
    return Model(gearing(CELL.robot), None, (RIPPLE,), layout, (samples,)), x


def true_bar(geometry: Geometry, ripple: Array) -> IdentifiedRobot:
    """A robot of this geometry; ripple : (C,) [rad] coefficients of its gears."""
    return IdentifiedRobot(CELL, geometry, (RIPPLE,), ripple)


def bar_samples(true: IdentifiedRobot, seed: int, signs: Signs) -> Samples:
    """Samples of the minute of a true mechanism with the noise whose signs are not 0."""
    path, columns = minute(), [j - 1 for j in UNIVERSAL_AND_GIMBAL]
    make = partial(noise_of, seed=seed, signs=signs, count=path.t.size)
    actual = closed(true.geometry, path.b, path.q)
    q = actual.copy()
    for _ in range(ROUNDS):
        q += actual - true.joints(q)
    q += LOG * make("joint_log", 6)
    gears = np.repeat([EXCESS.gear, EXCESS.wrist], 3) * np.hstack(
        (make("gear", 3), make("wrist", 3))
    )
    q += gears @ CELL.robot.gear_to_joint + path.speed * (STAMP * make("stamps", 1))
    b = path.b + ENCODER * make("bar_log", 5) + EXCESS.bar * make("bar", 5)
    logs = exact_log(path.t, q), exact_log(path.t, b[:, columns])
    times = path.t[30:-30:ROWS_PER_SAMPLE]
    made = samples_of(*logs, UNIVERSAL_AND_GIMBAL, np.ones(len(columns)), times)
    noise = np.where(np.isin(np.arange(5), columns), ENCODER, 0.0)
    return replace(made, joint_noise=np.full(6, LOG), encoder_noise=noise, stamp_noise=STAMP)


def noise_of(source: str, width: int, *, seed: int, signs: Signs, count: int) -> Array:
    """(count, width) noise of a source in standard deviations."""
    return drawn(seed, source, signs.get(source, 0.0), (count, width))


def bar_squares(model: Model, x: Array, seed: int, signs: Signs) -> float:
    """Mean square [m^2] of the tool's error of one fit to the minute."""
    layout, values = model.unknowns, NOMINAL.values.copy()
    own, ripple = layout.shared, layout.coefficients
    rows = [row_of_parameter(name) for name in layout.names[: own.size]]
    for source in dict.fromkeys(rows):
        chosen = np.array([row == source for row in rows])
        z = of_prior(seed, source, signs, (int(chosen.sum()),))
        values[own[chosen]] += layout.sigma[: own.size][chosen] * z
    z = of_prior(seed, RIPPLE.name, signs, layout.sigma[ripple].shape)
    start = x.copy()  # the truth, from which the minimum is a step or two away
    start[: own.size], start[ripple] = values[own], layout.sigma[ripple] * z
    true = true_bar(NOMINAL.with_values(values), start[ripple])
    samples = bar_samples(true, seed, signs)
    found = fit(
        replace(model, recordings=(samples,)),
        start,
        [samples.ballbar_angles(NOMINAL, NO_CLOCK_ERROR)],
        EXCESS,
    )
    estimate = true_bar(found.geometry(), found.x[ripple])
    return float((position_error(estimate.tool(GRID), true.tool(GRID)).error ** 2).mean())


def row_of_parameter(name: str) -> str:
    """The row in which the prior of a parameter of the machine stands."""
    if name == NOMINAL.table.plate:
        return "plate"
    if name == "bd3":
        return "rod"
    return "axes" if parameter_named(name).side == "bar" else "robot"


def bar_case() -> Case:
    """The minute on a ball-bar."""
    model, x = bar_model()
    nominal = fit(model, x, [model.recordings[0].ballbar_angles(NOMINAL, NO_CLOCK_ERROR)], EXCESS)
    robot = true_bar(nominal.geometry(), nominal.x[model.unknowns.coefficients])
    moves = robot.jacobian(GRID, model.unknowns.shared)
    columns = aligned_columns(robot.tool(GRID), moves)
    rows = rows_of(nominal, columns, model.unknowns.machine)
    return Case("ball-bar", partial(bar_squares, model, x), rows)


def rows_of(found: Fit, columns: Array, unknowns: Array) -> dict[str, float]:
    """[m^2] of each row of the budget; columns : (3G, U) of the unknowns (U,)."""
    parts = variance_parts(found, unknowns, partial(row_of, found))
    points = len(columns) / 3
    out: dict[str, float] = {}
    for part in parts:
        square = float(((columns @ part.covariance) * columns).sum()) / points
        out[part.row] = out.get(part.row, 0.0) + square
    return out


def pose_model(q: Array, values: Array) -> Model:
    """The model of the poses of a tracker; q : (N, J) [rad] as given. values : (N, 3) [m]."""
    robot = UR5
    seen = group("point", SEEN_FROM, q, values, np.full(values.shape, INSTRUMENT))
    table = PoseTable("ur5", robot, (seen,))
    still = PlacedPoses(table, {SEEN_FROM: SEAT}, {seen.target: TARGET})
    layout = still_unknowns(robot_geometry(robot), still, ())
    return still_model(table, layout, (), np.full(robot.joints, ROUNDED))


def true_positions(true: Geometry, q: Array) -> Array:
    """(N, 3) [m] of the target in the tracker's frame."""
    robot = IdentifiedRobot(UR5, true, target=TARGET)
    return np.asarray((robot.tool(q) - SEAT.origin) @ SEAT.rotation)


def pose_squares(q: Array, at: Array, seed: int, signs: Signs) -> float:
    """Mean square [m^2] of the target's error at poses `at`, seen from the tracker."""
    nominal = robot_geometry(UR5)
    values, z = nominal.values.copy(), of_prior(seed, "robot", signs, (99,))
    for parameter, size in zip(arm_parameters(UR5), z, strict=False):
        values[nominal.table.index[parameter.name]] += robot_prior(parameter) * size
    true = nominal.with_values(values)
    make = partial(noise_of, seed=seed, signs=signs, count=len(q))
    measured = true_positions(true, q + ROUNDED * make("joint_log", q.shape[1]))
    measured += INSTRUMENT * make("instrument", 3)
    measured += LEFT_OVER.position * make("position", 3)
    model = pose_model(q, measured)
    found = fit_unweighted(model, model.unknowns.mean.copy(), LEFT_OVER)
    error = seen_by(found, at) - true_positions(true, at)
    return float((error**2).sum(axis=1).mean())


def seen_by(found: Fit, q: Array) -> Array:
    """(N, 3) [m] of the target of a fit in the tracker's frame."""
    robot, seat = pose_robot(found), found.model.unknowns.seat(found.x, SEEN_FROM)
    return np.asarray((robot.tool(q) - seat.origin) @ seat.rotation)


def pose_robot(found: Fit) -> IdentifiedRobot:
    """The robot of a fit, with what the normal equations alone state of it."""
    layout, x = found.model.unknowns, found.x
    name = next(iter(layout.targets))
    index = pose_unknowns(found)
    q = found.model.poses.q
    place: Placement = layout.target(x, name)
    return IdentifiedRobot(
        UR5,
        layout.bare(x),
        target=place,
        ranges=np.stack((q.min(axis=0), q.max(axis=0)), axis=1),
        stated=PoseCovariance(
            seat=layout.seat(x, SEEN_FROM),
            seat_turns=True,
            parameters=layout.shared,
            values=inverse(found.linear.normal)[np.ix_(index, index)],
            discrepancy=0.0,
            factor=1.0,
        ),
    )


def pose_unknowns(found: Fit) -> Array:
    """(U,) indices of the unknowns that move the target as the tracker sees it."""
    layout = found.model.unknowns
    seat, target = layout.seats[SEEN_FROM], next(iter(layout.targets.values()))
    return np.r_[layout.machine, target.start : target.start + 3, seat]


def pose_case() -> Case:
    """The poses seen by a tracker."""
    q = angles("ur5", POSES)
    nominal = robot_geometry(UR5)
    model = pose_model(q, true_positions(nominal, q))
    found = fit_unweighted(model, model.unknowns.mean.copy(), LEFT_OVER)
    robot = pose_robot(found)
    assert isinstance(robot.stated, PoseCovariance)
    rows = rows_of(found, robot.stated.columns(robot), pose_unknowns(found))
    return Case("tracker", partial(pose_squares, q, robot.workspace()[::4]), rows)


def tried(case: Case, seeds: int) -> list[dict[str, object]]:
    """A row of the table for each row of a case's budget that is large enough, and for the sum."""
    total = sum(case.rows.values())
    large = [name for name, square in case.rows.items() if square > LEAST * total]
    sources = [name for name in case.rows if name not in ("rounding", "placement")]
    found: dict[str, list[float]] = {name: [] for name in [*large, "sum"]}
    for seed in range(1, seeds + 1):
        on = dict.fromkeys(sources, 1.0)
        found["sum"].append(case.squares(seed, on))
        for name in large:
            both = [case.squares(seed, on | {name: sign}) for sign in (1.0, -1.0, 0.0)]
            found[name].append(0.5 * (both[0] + both[1]) - both[2])
    rows = []
    for name, values in found.items():
        stated = total if name == "sum" else case.rows[name]
        ratio = np.array(values) / stated
        rows.append(
            {
                "case": case.name,
                "row": name,
                "seeds": seeds,
                "share": stated / total,
                "stated_mm": 1e3 * float(np.sqrt(stated)),
                "simulated_over_stated": float(ratio.mean()),
                "standard_error": float(ratio.std(ddof=1) / np.sqrt(seeds)),
            }
        )
    return rows


def main() -> None:
    """Tries the rows of both cases, prints and writes them."""
    parser = study_parser(__doc__)
    parser.add_argument("--seeds", type=int, default=250)
    seeds = parser.parse_args().seeds
    rows = [row for case in (bar_case(), pose_case()) for row in tried(case, seeds)]
    write_table(STUDIES / "budget_rows.csv", rows, ".4g")
    for row in rows:
        print(in_words(row))


if __name__ == "__main__":
    main()
