"""What the command line says of an identification from still poses: sentences first."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape

from ballbar.result.compare import Comparison
from ballbar.result.pose_run import PoseRun
from ballbar.units import MM


def say_poses(out: Console, run: PoseRun) -> None:
    """Print held-out tables, verdict, warnings, and what was fitted.

    Sentences are green or red, warnings yellow.
    """
    result, fit = run.identification, run.identification.fit
    sentences = [(h.sentence, h.acceptable) for _, _, h in run.held_out]
    sentences.append((result.verdict.sentence, result.verdict.acceptable))
    for sentence, good in sentences:
        out.print(f"[bold {'green' if good else 'red'}]{escape(sentence)}[/]")
    for warning in result.verdict.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}")
    layout = fit.model.unknowns
    seats, targets = len(layout.seats), len(layout.targets)
    coefficients = layout.coefficients.stop - layout.coefficients.start
    out.print(
        f"{len(layout.parameters)} parameters and {coefficients} coefficients of corrections from "
        f"{result.table.size} poses, {seats} seat{'s' * (seats > 1)} and {targets} "
        f"target{'s' * (targets > 1)}, in {fit.iterations} iterations"
    )
    if result.search is not None:
        names = ", ".join(f"joint {o.joint + 1}: {o.order:g}" for o in result.search.orders[:8])
        more = len(result.search.orders) - 8
        out.print(
            escape(
                f"joint errors found (cycles a turn): {names or 'none'}"
                + (f" and {more} more" if more > 0 else "")
            )
        )
    beside, over = result.sigma_at_poses.mean() * MM, result.tcp_sigma.mean() * MM
    out.print(
        f"stated TCP uncertainty: {beside:.4f} mm at the measured poses; extrapolated over the "
        f"whole of the fitted ranges {over:.4f} mm (means, 1 sigma, all axes together; without the "
        "scale of the instrument)"
    )


def say_pose_comparison(out: Console, comparison: Comparison) -> None:
    """Print how far the identified robot is from the true one."""
    tcp, before = comparison.tcp, comparison.tcp_nominal
    out.print(
        f"TCP error within the fitted ranges: mean {tcp.mean * MM:.4f} mm, "
        f"largest {tcp.maximum * MM:.4f} mm "
        f"(nominal robot {before.mean * MM:.3f} and {before.maximum * MM:.3f} mm)"
    )
