"""An identified robot against another one: parameters, and the error at the tool.

Parameter distance as in thesis sec. 3.4 (mm and mrad mixed), meaningful where the parameters held
fixed are true; and the TCP error, meaningful always. That of logs is taken over the accuracy grid.
That of still poses is taken over poses within the fitted ranges, with the base aligned: where the
first frame lies is a gauge of each result. Their parameters are compared by z, the difference over
the standard deviation of both; against a truth they also differ by what the gauge holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry, parameter_named, robot_geometry
from ballbar.cell.statistics import rms
from ballbar.ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN
from ballbar.ident.result import Identification
from ballbar.ident.robot.accuracy import TcpError, accuracy_grid, position_error
from ballbar.ident.robot.identified import IdentifiedRobot

if TYPE_CHECKING:  # an identification without a second result reads none
    from ballbar.result.calibration import Calibration

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


def compare(first: Calibration, second: Calibration, target: str | None = None) -> Comparison:
    """Two results of one robot.

    target : of still poses, by default the first one that both have.

    Raises InputError for a result of logs and one of still poses, for unlike robots, and where an
    axis has no angle within the fitted ranges of both.
    """
    _ = second.file_of_logs() if first.of_logs else second.file_of_poses()
    if first.robot.title != second.robot.title:
        what = f"is of robot {second.robot.title}, {first.path} of {first.robot.title}."
        raise InputError.at(second.path, what, "Compare calibrations of the same robot.")
    if not first.of_logs:
        return _compare_poses(first, second, target)
    cell = first.cell()
    shared = [name for name in first.file.identified if name in second.file.identified]
    other = second.identified_robot(cell=cell)
    actual = other.tool(accuracy_grid(cell.robot))
    return robot_comparison(
        first.identified_robot(cell=cell), first.nominal, other.geometry, actual, shared, None
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
    actual = IdentifiedRobot(cell, reference).tool(accuracy_grid(cell.robot))
    return robot_comparison(IdentifiedRobot(cell, model), nominal, reference, actual, names, clock)


def robot_comparison(
    model: IdentifiedRobot,
    nominal: Geometry,
    reference: Geometry,
    actual: Array,
    names: Sequence[str],
    clock: tuple[float, float] | None,
) -> Comparison:
    """Model and nominal robot over the accuracy grid.

    actual : (G, 3) [m] where the reference has the tool there. names : parameters to compare.
    clock : errors of (offset [s], skew [-]), if both sides have a clock
    """
    grid = accuracy_grid(model.cell.robot)
    offset, skew = clock or (None, None)
    return Comparison(
        compare_geometry(model.geometry, reference, names),
        position_error(model.tool(grid), actual),
        position_error(model.rigid(nominal).tool(grid), actual),
        offset,
        skew,
    )


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
        raise _nothing_in_common(first, second, int((upper - lower).argmin()))
    shared = [name for name in first.targets if name in second.targets]
    name = target or (shared or list(first.targets))[0]
    model = first.identified_robot(name)
    other = second.identified_robot(name if name in shared else None)
    if name not in shared:
        other = replace(other, target=model.target)
    q = poses_within(lower, upper)
    spans = np.maximum(np.diff(first.ranges)[:, 0], np.diff(second.ranges)[:, 0])
    return replace(
        target_comparison(first, model, q, other.tool(q), _values(second)),
        both_have_target=name in shared,
        target=name,
        predicted=(first.cross_validated, second.cross_validated),
        unlike_ranges=tuple(int(j) + 1 for j in np.flatnonzero(upper - lower < 0.5 * spans)),
    )


def _nothing_in_common(first: Calibration, second: Calibration, axis: int) -> InputError:
    here, there = (
        "{:.1f} to {:.1f} deg".format(*np.rad2deg(result.ranges[axis]))
        for result in (first, second)
    )
    return InputError(
        f"axis {axis + 1} was fitted over {here} in one result and over {there} in the other: they "
        "have no pose in common to compare."
    )


def poses_within(lower: Array, upper: Array) -> Array:
    """(POSES, J) [rad] the same random shares of ranges for everyone."""
    share = np.random.default_rng(_SEED).random((POSES, lower.size))
    return np.asarray(lower + share * (upper - lower))


def target_comparison(
    result: Calibration,
    model: IdentifiedRobot,
    q: Array,
    actual: Array,
    reference: Mapping[str, tuple[float, float]],
) -> Comparison:
    """The robot of a result at q (N, J) [rad], where its target actually is at (N, 3) [m].

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
        position_error(model.tool(q), actual),
        position_error(model.rigid(robot_geometry(model.robot)).tool(q), actual),
        z={name: z[name] for name in order},
    )


def _values(result: Calibration) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of every identified parameter."""
    parameters = result.file.parameters
    return {name: (parameters[name].value, sigma) for name, sigma in result.sigma.items()}
