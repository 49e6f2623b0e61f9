"""An identified robot against the truth, or against another result of the same robot.

Parameter distance as in thesis sec. 3.4 (mm and mrad mixed), meaningful where the parameters held
fixed are true; and the TCP error, meaningful always. That of logs is taken over the accuracy grid.
That of still poses is taken over poses within the fitted ranges, with the base aligned: where the
first frame lies is a gauge of each result. Their parameters are compared by z, the difference over
the standard deviation of both; against a truth they also differ by what the gauge holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ballbar.result.calibration import Calibration
from ballbar.result.true_robot import true_tool
from cell.arrays import Array
from cell.descriptions import Cell, Robot
from cell.errors import InputError
from cell.geometry import Geometry, mirrored, nominal_chain, parameter_named, parameter_table
from cell.statistics import rms
from ident.estimator.build_unknowns import arm_parameters
from ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN
from ident.pose_result import PoseIdentification
from ident.result import Identification
from ident.robot.accuracy import TcpError, accuracy_grid, position_error
from ident.robot.identified_arm import IdentifiedArm
from ident.robot.unloaded_robot import UnloadedRobot

if TYPE_CHECKING:  # an identification of recordings does without the simulation
    from sim.truth import PoseTruth, Truth

POSES = 1000
NOTABLE = 3.0  # z of a parameter that differs
_SEED = 1000  # the poses are part of the metric


@dataclass(frozen=True, eq=False)
class Comparison:
    """How far a model is from a reference."""

    deviations: dict[str, float]  # [m, rad] model minus reference, of the parameters compared
    tcp: TcpError  # of the model
    tcp_nominal: TcpError  # of the nominal robot, against the same reference
    offset: float | None = None  # [s] clock offset minus the true one
    skew: float | None = None  # [1]
    target: str = ""  # of still poses, whose position is compared; of logs it is the plate's end
    both_have_target: bool = True
    z: dict[str, float] = field(default_factory=dict)  # of the deviations, over the sigma of both
    predicted: tuple[float, ...] = ()  # [m] mean errors that the cross-validations state
    unlike_ranges: tuple[int, ...] = ()  # axes, from 1, of which less than half is common

    @property
    def distance(self) -> float:
        """[m | rad] Euclidean distance over the compared parameters."""
        return float(np.linalg.norm(list(self.deviations.values())))

    @property
    def largest(self) -> tuple[str, float]:
        """Name and value [m | rad] of the largest deviation."""
        return max(self.deviations.items(), key=lambda item: abs(item[1]))

    @property
    def notable(self) -> list[str]:
        """Parameters that differ by more than chance, and by more than matters at the tool."""
        return [n for n, size in self.deviations.items() if is_notable(n, size, self.z[n])]


def is_notable(name: str, difference: float, z: float) -> bool:
    """Whether a parameter differs by more than chance, and by more than matters at the tool."""
    least = LITTLE_SHIFT if parameter_named(name).is_length else LITTLE_TURN
    return abs(z) > NOTABLE and abs(difference) > least


def compare_files(result: Path, reference: Path) -> Comparison:
    """A result against another one, or against the truth that it was simulated from.

    Raises InputError as `compare`, and where one of the files fails.
    """
    from sim.truth import load_pose_truth, load_truth  # noqa: PLC0415  as above

    model = Calibration.load(result)
    if not reference.name.endswith(".truth.yaml"):
        return compare(model, Calibration.load(reference))
    if not model.of_logs:
        return _poses_against_truth(model, load_pose_truth(reference))
    clock = model.file.logs[0].clock
    return compare_with_truth(
        model.unloaded_robot(model.cell()),
        model.nominal,
        load_truth(reference),
        model.file.identified,
        (clock.offset_s, clock.skew) if clock else None,
    )


def compare(first: Calibration, second: Calibration, target: str | None = None) -> Comparison:
    """Two results of one robot.

    target : of still poses, by default the first one that both have.

    Raises InputError for a result of logs and one of still poses, for unlike robots, and where an
    axis has no angle within the fitted ranges of both.
    """
    _ = second.file_of_logs() if first.of_logs else second.file_of_poses()
    if first.robot.title != second.robot.title:
        raise InputError(
            f"{second.path}: is of robot {second.robot.title}, {first.path} of "
            f"{first.robot.title}. Compare calibrations of the same robot."
        )
    if not first.of_logs:
        return _compare_poses(first, second, target)
    cell = first.cell()
    shared = [name for name in first.file.identified if name in second.file.identified]
    other = second.unloaded_robot(cell)
    actual = other.tool(accuracy_grid(cell.robot))
    return _compared(
        first.unloaded_robot(cell), first.nominal, other.geometry, actual, shared, None
    )


def compare_with_truth(
    model: UnloadedRobot,
    nominal: Geometry,
    truth: Truth,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    """Model and nominal robot against what the recording was simulated from.

    clock : (offset [s], skew [-]) as identified, or None
    """
    reference = reference_of(truth)
    errors = (clock[0] - truth.clock.offset_s, clock[1] - truth.clock.skew) if clock else None
    actual = true_tool(model.cell, truth, reference, accuracy_grid(model.cell.robot))
    return _compared(model, nominal, reference, actual, names, errors)


def identification_against_truth(
    result: Identification, truth: Truth, recording: int = 0
) -> Comparison:
    """The result against the truth that one of its recordings was simulated from."""
    estimate = result.recordings[recording]
    clock = (estimate.clock.offset, estimate.clock.skew) if estimate.clock else None
    model = replace(result.robot.unloaded(), geometry=estimate.geometry)
    names = [*result.robot.sigma, *estimate.sigma]
    return compare_with_truth(model, estimate.nominal, truth, names, clock)


def poses_against_truth(result: PoseIdentification, truth: PoseTruth) -> Comparison:
    """The first target of a robot from still poses against the truth that they are simulated from.

    The nominal robot has its target fitted to the same poses.
    """
    name, arm, before = result.target, result.arm(), result.nominal
    q = arm.workspace()
    actual = truth.arm(arm.robot).target(q, truth.targets[name].position)
    bare = replace(_nominal(arm), target=before.model.unknowns.target(before.x, name))
    return Comparison(
        {}, position_error(arm.tool(q), actual), position_error(bare.tool(q), actual), target=name
    )


def z_rms(result: Identification, comparison: Comparison) -> float:
    """Root mean square of error over stated sigma; near 1 if the intervals hold."""
    sigma = result.sigma
    errors = comparison.deviations.items()
    return rms([error / sigma[name] for name, error in errors if sigma[name] > 0.0])


def compare_kinematics(
    cell: Cell,
    model: Geometry,
    nominal: Geometry,
    reference: Geometry,
    names: Sequence[str],
    *,
    clock: tuple[float, float] | None = None,
) -> Comparison:
    """Rigid robots against each other.

    clock : errors of (offset [s], skew [-]), if both sides have a clock
    """
    actual = UnloadedRobot(cell, reference).tool(accuracy_grid(cell.robot))
    return _compared(UnloadedRobot(cell, model), nominal, reference, actual, names, clock)


def _compared(
    model: UnloadedRobot,
    nominal: Geometry,
    reference: Geometry,
    actual: Array,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    grid = accuracy_grid(model.cell.robot)
    offset, skew = clock or (None, None)
    bare = UnloadedRobot(model.cell, nominal)
    return Comparison(
        compare_geometry(model.geometry, reference, names),
        position_error(model.tool(grid), actual),
        position_error(bare.tool(grid), actual),
        offset,
        skew,
    )


def reference_of(truth: Truth) -> Geometry:
    """The true geometry as the declared directions of b2 and b4 describe it.

    Which of the two directions is positive is a gauge: the logs do not tell.
    """
    geometry = truth.geometry
    for joint in (2, 4):
        if truth.directions.get(f"b{joint}") == -1:
            geometry = mirrored(geometry, joint)
    return geometry


def compare_geometry(
    model: Geometry, reference: Geometry, names: Sequence[str]
) -> dict[str, float]:
    """[m, rad] model minus reference of the named parameters; angles within half a turn."""

    def difference(name: str) -> float:
        size = model[name] - reference[name]
        if parameter_named(name).is_length:
            return size
        return float(np.arctan2(np.sin(size), np.cos(size)))

    return {name: difference(name) for name in names}


def _compare_poses(first: Calibration, second: Calibration, target: str | None) -> Comparison:
    lower = np.maximum(first.ranges[:, 0], second.ranges[:, 0])
    upper = np.minimum(first.ranges[:, 1], second.ranges[:, 1])
    if (upper <= lower).any():
        axis = int((upper - lower).argmin())
        here, there = (
            "{:.1f} to {:.1f} deg".format(*np.rad2deg(result.ranges[axis]))
            for result in (first, second)
        )
        raise InputError(
            f"axis {axis + 1} was fitted over {here} in one result and over "
            f"{there} in the other: they have no pose in common to compare."
        )
    shared = [name for name in first.targets if name in second.targets]
    name = target or (shared or list(first.targets))[0]
    model = first.arm(name)
    other = second.arm(name if name in shared else None)
    if name not in shared:
        other = replace(other, target=model.target)
    q = _poses_within(lower, upper)
    spans = np.maximum(np.diff(first.ranges)[:, 0], np.diff(second.ranges)[:, 0])
    return replace(
        _compared_arm(first, model, q, other.tool(q), _values(second)),
        both_have_target=name in shared,
        target=name,
        predicted=(first.cross_validated, second.cross_validated),
        unlike_ranges=tuple(int(j) + 1 for j in np.flatnonzero(upper - lower < 0.5 * spans)),
    )


def _poses_against_truth(result: Calibration, truth: PoseTruth) -> Comparison:
    name = next(iter(result.targets))
    if name not in truth.targets:
        raise InputError(
            f"target {name} is not in the truth, which has {', '.join(truth.targets)}. Name the "
            "truth file of this table."
        )
    arm = result.arm(name)
    q = _poses_within(arm.lower, arm.upper)
    actual = truth.arm(arm.robot).target(q, truth.targets[name].position)
    compared = _compared_arm(result, arm, q, actual, _true_values(truth, arm.robot))
    return replace(compared, target=name, predicted=(result.cross_validated,))


def _poses_within(lower: Array, upper: Array) -> Array:
    """(POSES, J) [rad] the same random shares of ranges for everyone."""
    share = np.random.default_rng(_SEED).random((POSES, lower.size))
    return np.asarray(lower + share * (upper - lower))


def _compared_arm(
    result: Calibration,
    arm: IdentifiedArm,
    q: Array,
    actual: Array,
    reference: Mapping[str, tuple[float, float]],
) -> Comparison:
    """The arm of a result at q (N, J) [rad], where its target actually is at (N, 3) [m].

    reference : value and standard deviation of parameters.
    """
    differences = {
        name: (value - reference[name][0], float(np.hypot(sigma, reference[name][1])))
        for name, (value, sigma) in _values(result).items()
        if name in reference
    }
    z = {name: difference / sigma for name, (difference, sigma) in differences.items()}
    order = sorted(z, key=lambda name: -abs(z[name]))
    return Comparison(
        {name: differences[name][0] for name in order},
        position_error(arm.tool(q), actual),
        position_error(_nominal(arm).tool(q), actual),
        z={name: z[name] for name in order},
    )


def _nominal(arm: IdentifiedArm) -> IdentifiedArm:
    """The nominal robot with the identified one's target."""
    return replace(arm, chain=nominal_chain(arm.robot), corrections=(), values=np.zeros(0))


def _values(result: Calibration) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of every identified parameter."""
    parameters = result.file.parameters
    return {name: (parameters[name].value, sigma) for name, sigma in result.sigma.items()}


def _true_values(truth: PoseTruth, robot: Robot) -> dict[str, tuple[float, float]]:
    """True values, sigma 0; of parallel axes the first d has what the others differ by."""
    nominal, chain = nominal_chain(robot), truth.arm(robot).chain
    d = chain.d.copy()
    for name in reversed(parameter_table(robot).hayati[:-1]):
        row = parameter_named(name).row
        d[row] += d[row + 1] - nominal.d[row + 1]
    values = {"d": d, "a": chain.a, "alpha": chain.alpha, "theta": chain.theta, "beta": chain.beta}
    return {p.name: (float(values[p.kind][p.row]), 0.0) for p in arm_parameters(robot)}
