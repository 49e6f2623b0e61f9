"""What the command line says of an identification: held-out recordings and the verdict first, then a few lines of numbers."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape

from ballbar.report.machine import TENSION_SOURCES, coefficients_at_prior, standing_at_prior
from ballbar.result.compare import Comparison
from ballbar.result.run_data import Joined, RunData
from sim.simulate import Simulation


def say_identification(out: Console, data: RunData) -> None:
    """Prints it; sentences green or red, remarks yellow."""
    for outcome in (validation.outcome for validation in data.validations):
        _sentence(out, outcome.sentence, good=outcome.acceptable)
        for event in outcome.events:
            out.print(f"[yellow]event:[/] {escape(f'{outcome.name}: {event.sentence}')}")
    result = data.identification
    _sentence(out, result.verdict.sentence, good=result.verdict.acceptable)
    for warning in result.verdict.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}")
    for line in _complete(data) if result.model == "complete" else _dh(data):
        out.print(escape(line))
    for one in data.fitted:
        _clock(out, one, named=bool(data.joined))
    out.print(
        f"stated TCP uncertainty over the workspace: mean {result.tcp_sigma.mean() * 1e3:.4f} mm (1 sigma)"
    )


def say_plant(out: Console, simulation: Simulation) -> None:
    """How well the plant closed its loop, and the force in the rod."""
    truth = simulation.truth
    out.print(
        f"plant: loop closed within {truth.closure_position * 1e6:.3f} um and {truth.closure_angle * 1e6:.3f} urad, "
        f"rod force {truth.rod_force_min:.0f} to {truth.rod_force_max:.0f} N"
    )


def say_comparison(out: Console, comparison: Comparison) -> None:
    """Model minus reference: tool, parameters, clock."""
    tcp, before = comparison.tcp, comparison.tcp_nominal
    out.print(
        f"TCP error over the workspace: mean {tcp.mean * 1e3:.4f} mm, largest {tcp.maximum * 1e3:.4f} mm "
        f"(nominal robot {before.mean * 1e3:.3f} and {before.maximum * 1e3:.3f} mm)"
    )
    if comparison.deviations:
        name, value = comparison.largest
        out.print(
            f"parameters: Euclidean distance {comparison.distance * 1e3:.4f} mm|mrad over {len(comparison.deviations)}, "
            f"largest {name} {value * 1e3:+.4f}"
        )
    if comparison.offset is not None and comparison.skew is not None:
        out.print(
            f"clock error: offset {comparison.offset * 1e6:+.2f} us, skew {comparison.skew * 1e6:+.4f} ppm"
        )


def _sentence(out: Console, words: str, *, good: bool) -> None:
    out.print(f"[bold {'green' if good else 'red'}]{escape(words)}[/]")


def _dh(data: RunData) -> list[str]:
    result = data.identification
    dropped = ", ".join(d.name for d in result.identifiability.dropped)
    return [
        f"{result.parameters.size} parameters from {result.after.t.size} samples in {result.iterations} iterations; "
        f"left at their nominal values: {dropped or 'none'}"
    ]


def _complete(data: RunData) -> list[str]:
    """Corrections, what the data did not tell, and where the rod's force came from."""
    result = data.identification
    count = sum(len(one.coefficients) for one in result.corrections)
    samples = " + ".join(str(one.identification.after.t.size) for one in data.fitted)
    standing = [*standing_at_prior(result), *(one.name for one in coefficients_at_prior(result))]
    corrections = f"{_counted(len(result.corrections), 'correction')} ({', '.join(one.name for one in result.corrections)})"
    lines = [
        f"complete model: {result.parameters.size} parameters and {count} coefficients of {corrections} "
        f"from {samples} samples in {result.iterations} iterations",
        f"told by their priors and not by the data (the uncertainty counts it): {', '.join(standing) or 'none'}",
    ]
    for one in data.fitted:
        found = one.identification
        if found.tension.any():
            where = f"force in the rod of {one.name}" if data.joined else "force in the rod"
            lines.append(
                f"{where}: {found.tension.min():.0f} to {found.tension.max():.0f} N, {TENSION_SOURCES[found.tension_source]}"
            )
    return lines


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


def _clock(out: Console, one: Joined, *, named: bool) -> None:
    result = one.identification
    if result.clock is None:
        return
    offset_sigma, skew_sigma = result.clock_sigma
    out.print(
        f"{escape(f'clock of {one.name}' if named else 'clock')}: "
        f"offset {result.clock.offset * 1e3:.4f} ms (sigma {offset_sigma * 1e6:.1f} us), "
        f"skew {result.clock.skew * 1e6:.3f} ppm (sigma {skew_sigma * 1e6:.3f} ppm)"
    )
