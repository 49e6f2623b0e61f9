"""Two results of still poses of one robot against each other.

The tool's difference is taken over poses within the fitted ranges of both, with the base aligned:
where the first frame lies is a gauge of each result. Parameters are compared by z, their difference
over the standard deviation of both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.markup import escape

from ballbar.result.pose_calibration import PoseCalibration
from ballbar.units import MM
from cell.errors import InputError
from cell.geometry import parameter_named
from ident.poses.unknowns import nominal_chain
from ident.robot.accuracy import TcpError, position_error

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
    def text(self) -> str:
        unit = "mm" if parameter_named(self.name).is_length else "mrad"
        return f"{self.name} {self.difference * 1e3:+.4f} {unit} (z {self.z:+.1f})"


@dataclass(frozen=True, eq=False)
class PoseComparison:
    """How far two results are from each other."""

    target: str  # whose position is compared
    own_target: bool  # whether both results have it
    tcp: TcpError  # of the first against the second
    tcp_nominal: TcpError  # of the nominal robot against the second
    predicted: tuple[float, float]  # [m] mean errors that the cross-validations state
    parameters: tuple[ParameterDifference, ...]  # largest z first
    unlike_ranges: tuple[int, ...]  # axes, from 1, of which less than half is common


def compare_poses(
    first: PoseCalibration, second: PoseCalibration, target: str | None = None
) -> PoseComparison:
    """Two results of one robot. target : by default the first one that both have.

    Raises InputError for unlike robots, and where an axis has no angle within both fitted ranges.
    """
    if first.robot.title != second.robot.title:
        raise InputError(
            f"the results are of robot {first.robot.title} and {second.robot.title}. Compare "
            "calibrations of the same robot."
        )
    lower = np.maximum(first.lower, second.lower)
    upper = np.minimum(first.upper, second.upper)
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
    chain = nominal_chain(first.robot)
    bare = replace(model, chain=chain, corrections=(), values=np.zeros(0))
    reference = other.tool(q)
    spans = np.maximum(first.upper - first.lower, second.upper - second.lower)
    return PoseComparison(
        target=name,
        own_target=name in shared,
        tcp=position_error(model.tool(q), reference),
        tcp_nominal=position_error(bare.tool(q), reference),
        predicted=(first.file.cross_validation.mean_m, second.file.cross_validation.mean_m),
        parameters=_parameters(first, second),
        unlike_ranges=tuple(int(j) + 1 for j in np.flatnonzero(upper - lower < 0.5 * spans)),
    )


def say_pose_comparison(out: Console, comparison: PoseComparison) -> None:
    """Print the tool's difference, then the parameters that differ."""
    tcp, nominal = comparison.tcp, comparison.tcp_nominal
    whose = "of both" if comparison.own_target else "of the first"
    out.print(
        escape(
            f"TCP difference over {POSES} poses within both fitted ranges, base aligned, target "
            f"{comparison.target} {whose}: mean {tcp.mean * MM:.4f} mm, largest "
            f"{tcp.maximum * MM:.4f} mm (nominal robot against the second: "
            f"{nominal.mean * MM:.3f} and {nominal.maximum * MM:.3f} mm)"
        )
    )
    first, second = comparison.predicted
    out.print(
        f"their cross-validations state mean errors of {first * MM:.4f} and {second * MM:.4f} mm"
    )
    notable = [p for p in comparison.parameters if abs(p.z) > NOTABLE]
    listed = ", ".join(p.text for p in notable[:LISTED])
    more = f" and {len(notable) - LISTED} more" if len(notable) > LISTED else ""
    out.print(
        f"parameters that differ by more than {NOTABLE:.0f} sigma: {listed or 'none'}{more} "
        f"({len(comparison.parameters)} compared; sigma without what the model leaves unexplained)"
    )
    if comparison.unlike_ranges:
        axes = ", ".join(map(str, comparison.unlike_ranges))
        out.print(f"[yellow]warning:[/] less than half of the fitted range is common: axes {axes}")


def pose_comparison_data(comparison: PoseComparison) -> dict[str, object]:
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


def _parameters(first: PoseCalibration, second: PoseCalibration) -> tuple[ParameterDifference, ...]:
    out = []
    for name, entry in first.file.parameters.items():
        other = second.file.parameters.get(name)
        if other is None or entry.sigma is None or other.sigma is None:
            continue
        difference = entry.value - other.value
        sigma = float(np.hypot(entry.sigma, other.sigma))
        out.append(ParameterDifference(name, difference, difference / sigma))
    return tuple(sorted(out, key=lambda p: -abs(p.z)))


def _tcp(error: TcpError) -> dict[str, float]:
    return {"mean_m": float(error.mean), "max_m": float(error.maximum)}


def _degrees(result: PoseCalibration, axis: int) -> str:
    low, high = np.rad2deg(result.lower[axis]), np.rad2deg(result.upper[axis])
    return f"{low:.1f} to {high:.1f} deg"
