"""A result of still poses against another one of the same robot, or against the simulated truth.

The tool's difference is taken over poses within the fitted ranges of both, with the base aligned:
where the first frame lies is a gauge of each result. Parameters are compared by z, their difference
over the standard deviation of both; against a truth they also differ by what the gauge holds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.result.calibration import Calibration
from ballbar.units import MM
from cell.descriptions import Robot
from cell.errors import InputError
from cell.geometry import nominal_chain, parameter_named, parameter_table
from ident.estimator.unknowns import arm_parameters
from ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN
from ident.robot.accuracy import TcpError, position_error
from ident.robot.identified_arm import IdentifiedArm

if TYPE_CHECKING:
    from sim.poses.truth import PoseTruth

POSES = 1000
NOTABLE = 3.0  # z of a parameter that differs
LISTED = 8  # parameters that are printed
_SEED = 1000  # the poses are part of the metric


@dataclass(frozen=True, eq=False)
class ParameterDifference:
    """One parameter in both results."""

    name: str
    difference: float  # [m, rad] first minus second
    z: float  # over the standard deviation of both

    @property
    def notable(self) -> bool:
        """Whether it is more than chance, and than what matters at the tool."""
        length = parameter_named(self.name).is_length
        least = LITTLE_SHIFT if length else LITTLE_TURN
        return abs(self.z) > NOTABLE and abs(self.difference) > least

    @property
    def text(self) -> str:
        unit = "mm" if parameter_named(self.name).is_length else "mrad"
        return f"{self.name} {self.difference * 1e3:+.4f} {unit} (z {self.z:+.1f})"


@dataclass(frozen=True, eq=False)
class ResultComparison:
    """How far two results are from each other."""

    target: str  # whose position is compared
    own_target: bool  # whether both results have it
    tcp: TcpError  # of the first against the second
    tcp_nominal: TcpError  # of the nominal robot against the second
    predicted: tuple[float, ...]  # [m] mean errors that the cross-validations state
    parameters: tuple[ParameterDifference, ...]  # largest z first
    unlike_ranges: tuple[int, ...]  # axes, from 1, of which less than half is common


def compare_pose_results(
    first: Calibration, second: Calibration, target: str | None = None
) -> ResultComparison:
    """Two results of one robot. target : by default the first one that both have.

    Raises InputError for unlike robots, and where an axis has no angle within both fitted ranges.
    """
    predicted = (first.cross_validated, second.cross_validated)
    if first.robot.title != second.robot.title:
        raise InputError(
            f"the results are of robot {first.robot.title} and {second.robot.title}. Compare "
            "calibrations of the same robot."
        )
    lower = np.maximum(first.ranges[:, 0], second.ranges[:, 0])
    upper = np.minimum(first.ranges[:, 1], second.ranges[:, 1])
    if (upper <= lower).any():
        axis = int((upper - lower).argmin())
        raise InputError(
            f"axis {axis + 1} was fitted over {_degrees(first, axis)} in one result and over "
            f"{_degrees(second, axis)} in the other: they have no pose in common to compare."
        )
    shared = [name for name in first.targets if name in second.targets]
    name = target or (shared or list(first.targets))[0]
    model = first.arm(name)
    other = second.arm(name if name in shared else None)
    if name not in shared:
        other = replace(other, target=model.target)
    share = np.random.default_rng(_SEED).random((POSES, first.robot.joints))
    q = lower + share * (upper - lower)
    reference = other.tool(q)
    spans = np.maximum(np.diff(first.ranges)[:, 0], np.diff(second.ranges)[:, 0])
    return ResultComparison(
        target=name,
        own_target=name in shared,
        tcp=position_error(model.tool(q), reference),
        tcp_nominal=position_error(_nominal(model).tool(q), reference),
        predicted=predicted,
        parameters=_differences(first, _stated(second)),
        unlike_ranges=tuple(int(j) + 1 for j in np.flatnonzero(upper - lower < 0.5 * spans)),
    )


def compare_pose_truth(result: Calibration, truth: PoseTruth) -> ResultComparison:
    """A result against the truth of the table that it was simulated from."""
    name = next(iter(result.targets))
    if name not in truth.targets:
        raise InputError(
            f"target {name} is not in the truth, which has {', '.join(truth.targets)}. Name the "
            "truth file of this table."
        )
    arm = result.arm(name)
    share = np.random.default_rng(_SEED).random((POSES, arm.robot.joints))
    q = arm.lower + share * (arm.upper - arm.lower)
    actual = truth.arm.target(q, truth.targets[name].position)
    return ResultComparison(
        target=name,
        own_target=True,
        tcp=position_error(arm.tool(q), actual),
        tcp_nominal=position_error(_nominal(arm).tool(q), actual),
        predicted=(result.cross_validated,),
        parameters=_differences(result, _true(truth, arm.robot)),
        unlike_ranges=(),
    )


def say_result_comparison(out: Console, comparison: ResultComparison) -> None:
    """Print the tool's difference, then the parameters that differ."""
    tcp, nominal = comparison.tcp, comparison.tcp_nominal
    whose = "of both" if comparison.own_target else "of the first"
    out.print(
        escape(
            f"TCP difference over {POSES} poses within the fitted ranges, base aligned, target "
            f"{comparison.target} {whose}: mean {tcp.mean * MM:.4f} mm, largest "
            f"{tcp.maximum * MM:.4f} mm (nominal robot: "
            f"{nominal.mean * MM:.3f} and {nominal.maximum * MM:.3f} mm)"
        )
    )
    stated = " and ".join(f"{mean * MM:.4f}" for mean in comparison.predicted)
    out.print(f"mean error by cross-validation: {stated} mm")
    notable = [p for p in comparison.parameters if p.notable]
    listed = ", ".join(p.text for p in notable[:LISTED])
    more = f" and {len(notable) - LISTED} more" if len(notable) > LISTED else ""
    out.print(
        f"parameters that differ by more than {NOTABLE:.0f} sigma, and {LITTLE_SHIFT * 1e6:.0f} um "
        f"or {LITTLE_TURN * 1e6:.0f} urad: {listed or 'none'}{more} "
        f"({len(comparison.parameters)} compared; sigma without what the model leaves unexplained)"
    )
    if comparison.unlike_ranges:
        axes = ", ".join(map(str, comparison.unlike_ranges))
        out.print(f"[yellow]warning:[/] less than half of the fitted range is common: axes {axes}")


def result_comparison_data(comparison: ResultComparison) -> dict[str, object]:
    """JSON of `compare` for results of still poses, SI units."""
    return {
        "target": comparison.target,
        "tcp_difference": _tcp(comparison.tcp),
        "tcp_difference_nominal": _tcp(comparison.tcp_nominal),
        "cross_validated_mean_m": list(comparison.predicted),
        "parameters": {
            p.name: {"difference": p.difference, "z": p.z} for p in comparison.parameters
        },
        "axes_with_unlike_ranges": list(comparison.unlike_ranges),
    }


def _nominal(arm: IdentifiedArm) -> IdentifiedArm:
    """The nominal robot with the identified one's target."""
    return replace(arm, chain=nominal_chain(arm.robot), corrections=(), values=np.zeros(0))


def _stated(result: Calibration) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of every identified parameter."""
    entries = result.file.parameters.items()
    return {name: (e.value, e.sigma) for name, e in entries if e.sigma is not None}


def _true(truth: PoseTruth, robot: Robot) -> dict[str, tuple[float, float]]:
    """True values, sigma 0; of parallel axes the first d has what the others differ by."""
    nominal, chain = nominal_chain(robot), truth.arm.chain
    d = chain.d.copy()
    for name in reversed(parameter_table(robot).hayati[:-1]):
        row = parameter_named(name).row
        d[row] += d[row + 1] - nominal.d[row + 1]
    values = {"d": d, "a": chain.a, "alpha": chain.alpha, "theta": chain.theta, "beta": chain.beta}
    return {p.name: (float(values[p.kind][p.row]), 0.0) for p in arm_parameters(robot)}


def _differences(
    first: Calibration, reference: Mapping[str, tuple[float, float]]
) -> tuple[ParameterDifference, ...]:
    out = []
    for name, (value, sigma) in _stated(first).items():
        if name in reference:
            difference = value - reference[name][0]
            both = float(np.hypot(sigma, reference[name][1]))
            out.append(ParameterDifference(name, difference, difference / both))
    return tuple(sorted(out, key=lambda p: -abs(p.z)))


def _tcp(error: TcpError) -> dict[str, float]:
    return {"mean_m": float(error.mean), "max_m": float(error.maximum)}


def _degrees(result: Calibration, axis: int) -> str:
    low, high = np.rad2deg(result.ranges[axis])
    return f"{low:.1f} to {high:.1f} deg"
