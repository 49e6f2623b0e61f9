"""Words of the command line on an identification: sentences first, then a few lines of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from ballbar.cell.geometry import parameter_named
from ballbar.cell.number_text import clock_offset_text, clock_skew_text
from ballbar.ident.held_out import HeldOut
from ballbar.ident.least_sizes import LITTLE_SHIFT, LITTLE_TURN
from ballbar.report.numbers import with_and_without
from ballbar.report.parameters import coefficients_at_prior, parameter_count, parameters_at_prior
from ballbar.report.recording_text import TENSION_SOURCES
from ballbar.result.compare import NOTABLE, POSES, Comparison
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.units import MM, PPM, US

LISTED = 8  # parameters that differ, printed

if TYPE_CHECKING:  # an identification without tracker does without it
    from ballbar.ident.table_estimate import TableEstimate
    from ballbar.ident.tracker import TrackerCheck


def say_identification(out: Console, run: RunData) -> None:
    """Print held-out recordings, verdict, remarks, fit and clocks.

    Sentences are green or red, remarks yellow.
    """
    verdict = run.identification.verdict
    for outcome in run.outcomes:
        _sentence(out, outcome.sentence, good=outcome.acceptable)
        if isinstance(outcome, HeldOut):
            for fault in outcome.step_faults:
                sentence = escape(f"{outcome.name}: {fault.sentence}")
                out.print(f"[yellow]step fault:[/] {sentence}")
            _tracker(out, outcome.tracker, outcome.name)
    _sentence(out, verdict.sentence, good=verdict.acceptable)
    for warning in verdict.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}")
    for line in (*_model(run), *_forces(run)):
        out.print(escape(line))
    for fitted in run.recordings:
        _clock(out, fitted, f"clock of {fitted.name}" if run.several else "clock")
        _tracker(out, fitted.estimate.tracker, fitted.name if run.several else "")
    _say_stated(out, run)


def _say_stated(out: Console, run: RunData) -> None:
    """Print the stated uncertainty, and what the still poses among the data tell."""
    tcp, poses = run.identification.robot.tcp, run.identification.poses
    if run.recordings:
        if poses is not None:
            out.print(escape(poses.sentence))
        stated = with_and_without(tcp.sigma, tcp.without_scale, run.identification.robot.cell)
        out.print(f"stated TCP uncertainty over the workspace (1 sigma, mean): {stated}")
    elif poses is not None:
        _say_poses(out, poses)


def _counted(poses: TableEstimate) -> str:
    seats, targets = len(poses.seats), len(poses.targets)
    seen = f"{seats} seat{'s' * (seats > 1)} and {targets} target{'s' * (targets > 1)}"
    return f"{poses.table.size} poses, {seen},"


def _model(data: RunData) -> list[str]:
    """Numbers of unknowns that were identified and of samples or poses, and names of the rest."""
    result, robot, poses = data.identification, data.identification.robot, data.identification.poses
    counted = f"{parameter_count(result)} parameters"
    if names := [correction.name for correction in robot.corrections]:
        coefficients = sum(len(correction.coefficients) for correction in robot.corrections)
        corrections = f"{len(names)} correction{'s' * (len(names) > 1)} ({', '.join(names)})"
        counted += f" and {coefficients} coefficients of {corrections}"
        what = "known from their priors more than from the data (the uncertainty counts it)"
        left = [*parameters_at_prior(robot), *(c.name for c in coefficients_at_prior(robot))]
    else:
        what = "left at nominal values or priors"
        left = [parameter.name for parameter in robot.dropped]
    used = " + ".join(str(r.estimate.samples) for r in data.recordings) + " samples"
    if poses is not None and not data.recordings:
        used = _counted(poses)
    model = "complete model: " * (result.model == "complete")
    return [
        f"{model}{counted} from {used} in {result.fit.iterations} iterations",
        f"{what}: {', '.join(left) or 'none'}",
    ]


def _forces(data: RunData) -> Iterator[str]:
    """Force in the rod of each recording that knows it, and its source."""
    for fitted in data.recordings:
        tension, source = fitted.estimate.tension, fitted.estimate.tension_source
        if tension is not None and data.identification.robot.corrections:
            force_of = "along the instrument" if source == "instrument" else "in the rod"
            name = f"force {force_of}" + (f" of {fitted.name}" if data.several else "")
            force = f"{tension.min():.0f} to {tension.max():.0f} N"
            yield f"{name}: {force}, {TENSION_SOURCES[source]}"


def _say_poses(out: Console, poses: TableEstimate) -> None:
    """Joint errors that were found in still poses, and the uncertainty stated of them."""
    if (search := poses.search) is not None:
        names = ", ".join(f"joint {o.joint + 1}: {o.order:g}" for o in search.orders[:8])
        more = f" and {len(search.orders) - 8} more" * (len(search.orders) > 8)
        out.print(escape(f"joint errors found (cycles a turn): {names or 'none'}{more}"))
    beside, over = poses.sigma_at_poses.mean() * MM, poses.tcp_sigma.mean() * MM
    scaled = {group.common is not None for group in poses.table.groups if group.kind.scales}
    without = "; without the scale of the instrument" * (False in scaled)
    without += "; the scale is that of the board" * (scaled == {True})
    for name, camera in poses.cameras.items():
        out.print(escape(f"camera {name}: {camera.sentence}"))
    out.print(
        f"stated TCP uncertainty: {beside:.4f} mm at the measured poses; extrapolated over the "
        f"whole of the fitted ranges {over:.4f} mm (means, 1 sigma, all axes together{without})"
    )


def say_comparison(out: Console, comparison: Comparison) -> None:
    """Print model minus reference: tool, parameters, clock."""
    if comparison.target:
        _comparison_of_poses(out, comparison)
    else:
        _comparison_of_logs(out, comparison)
    if comparison.offset is not None and comparison.skew is not None:
        offset, skew = comparison.offset * US, comparison.skew * PPM
        out.print(f"clock error: offset {offset:+.2f} us, skew {skew:+.4f} ppm")


def _comparison_of_logs(out: Console, comparison: Comparison) -> None:
    tcp, before = comparison.tcp, comparison.tcp_nominal
    out.print(
        f"TCP error over the workspace: mean {tcp.mean * MM:.4f} mm, "
        f"largest {tcp.maximum * MM:.4f} mm, "
        f"mean without scale {tcp.error_without_scale.mean() * MM:.4f} mm "
        f"(nominal robot {before.mean * MM:.3f} and {before.maximum * MM:.3f} mm)"
    )
    if comparison.deviations:
        (name, value), count = comparison.largest, len(comparison.deviations)
        out.print(
            f"parameters: Euclidean distance {comparison.distance * MM:.4f} mm|mrad over {count}, "
            f"largest {name} {value * MM:+.4f}"
        )


def _comparison_of_poses(out: Console, comparison: Comparison) -> None:
    tcp, nominal = comparison.tcp, comparison.tcp_nominal
    errors = (
        f"mean {tcp.mean * MM:.4f} mm, largest {tcp.maximum * MM:.4f} mm (nominal robot "
        f"{nominal.mean * MM:.3f} and {nominal.maximum * MM:.3f} mm)"
    )
    if not comparison.predicted:  # an identification against its truth
        out.print(f"TCP error within the fitted ranges: {errors}")
        return
    whose = "of both" if comparison.both_have_target else "of the first"
    out.print(
        escape(
            f"TCP difference over {POSES} poses within the fitted ranges, base aligned, target "
            f"{comparison.target} {whose}: {errors}"
        )
    )
    stated = " and ".join(f"{mean * MM:.4f}" for mean in comparison.predicted)
    out.print(f"mean error by cross-validation: {stated} mm")
    notable = comparison.notable
    listed = ", ".join(
        f"{name} {comparison.deviations[name] * 1e3:+.4f} "
        f"{'mm' if parameter_named(name).is_length else 'mrad'} (z {comparison.z[name]:+.1f})"
        for name in notable[:LISTED]
    )
    more = f" and {len(notable) - LISTED} more" if len(notable) > LISTED else ""
    out.print(
        f"parameters that differ by more than {NOTABLE:.0f} sigma, and {LITTLE_SHIFT * 1e6:.0f} um "
        f"or {LITTLE_TURN * 1e6:.0f} urad: {listed or 'none'}{more} "
        f"({len(comparison.z)} compared; sigma without what the model leaves unexplained)"
    )
    if comparison.unlike_ranges:
        axes = ", ".join(map(str, comparison.unlike_ranges))
        out.print(f"[yellow]warning:[/] less than half of the fitted range is common: axes {axes}")


def _sentence(out: Console, sentence: str, *, good: bool) -> None:
    out.print(f"[bold {'green' if good else 'red'}]{escape(sentence)}[/]")


def _tracker(out: Console, tracker: TrackerCheck | None, name: str) -> None:
    if tracker is not None:
        prefix = f"{name}: " if name else ""
        _sentence(out, prefix + tracker.sentence, good=tracker.acceptable)


def _clock(out: Console, fitted: FittedRecording, name: str) -> None:
    clock, (offset_sigma, skew_sigma) = fitted.estimate.clock, fitted.estimate.clock_sigma
    if clock is not None:
        out.print(
            f"{escape(name)}: "
            f"offset {clock_offset_text(clock, offset_sigma)}, "
            f"skew {clock_skew_text(clock, skew_sigma)}"
        )
