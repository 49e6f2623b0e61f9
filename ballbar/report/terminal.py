"""What the command line says of an identification: sentences first, then a few lines of numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

from ballbar.report.corrections import coefficients_at_prior, parameters_at_prior
from ballbar.report.numbers import with_and_without
from ballbar.report.parameters import parameter_count
from ballbar.report.rod_force import TENSION_SOURCES
from ballbar.result.compare import Comparison
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.units import MM, PPM, UM, URAD, US
from cell.number_text import clock_offset_text, clock_skew_text

if TYPE_CHECKING:
    from ident.tracker import TrackerCheck
    from sim.simulate import Simulation


def say_identification(out: Console, data: RunData) -> None:
    """Print held-out recordings, verdict, remarks, fit and clocks.

    Sentences are green or red, remarks yellow.
    """
    for outcome in (validation.outcome for validation in data.validations):
        _sentence(out, outcome.sentence, good=outcome.acceptable)
        for fault in outcome.step_faults:
            out.print(f"[yellow]step fault:[/] {escape(f'{outcome.name}: {fault.sentence}')}")
        _tracker(out, outcome.tracker, outcome.name)
    result = data.identification
    _sentence(out, result.verdict.sentence, good=result.verdict.acceptable)
    for warning in result.verdict.warnings:
        out.print(f"[yellow]warning:[/] {escape(warning)}")
    for line in _complete(data) if result.model == "complete" else _dh(data):
        out.print(escape(line))
    for fitted in data.recordings:
        _clock(out, fitted, f"clock of {fitted.name}" if data.several else "clock")
        _tracker(out, fitted.estimate.tracker, fitted.name if data.several else "")
    if result.poses is not None:
        out.print(escape(result.poses.sentence))
    tcp, cell = result.robot.tcp, result.robot.cell
    stated = with_and_without(tcp.sigma, tcp.without_scale, cell)
    out.print(f"stated TCP uncertainty over the workspace (1 sigma, mean): {stated}")


def say_plant(out: Console, simulation: Simulation) -> None:
    """Print how well the plant closed its loop, and the force in the rod."""
    truth = simulation.truth
    position, angle = truth.closure_position * UM, truth.closure_angle * URAD
    out.print(
        f"plant: loop closed within {position:.3f} um and {angle:.3f} urad, "
        f"rod force {truth.rod_force_min:.0f} to {truth.rod_force_max:.0f} N"
    )


def say_comparison(out: Console, comparison: Comparison) -> None:
    """Print model minus reference: tool, parameters, clock."""
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
    if comparison.offset is not None and comparison.skew is not None:
        offset, skew = comparison.offset * US, comparison.skew * PPM
        out.print(f"clock error: offset {offset:+.2f} us, skew {skew:+.4f} ppm")


def _sentence(out: Console, sentence: str, *, good: bool) -> None:
    out.print(f"[bold {'green' if good else 'red'}]{escape(sentence)}[/]")


def _tracker(out: Console, tracker: TrackerCheck | None, name: str) -> None:
    if tracker is not None:
        prefix = f"{name}: " if name else ""
        _sentence(out, prefix + tracker.sentence, good=tracker.acceptable)


def _dh(data: RunData) -> list[str]:
    result = data.identification
    dropped = ", ".join(parameter.name for parameter in result.robot.dropped)
    return [
        f"{parameter_count(result)} parameters from {_samples(data)} samples in "
        f"{result.fit.iterations} iterations; left at nominal values or priors: {dropped or 'none'}"
    ]


def _samples(data: RunData) -> str:
    return " + ".join(str(fitted.estimate.samples) for fitted in data.recordings)


def _complete(data: RunData) -> list[str]:
    """Corrections, what the data did not determine, and the source of the rod's force."""
    result, robot = data.identification, data.identification.robot
    names = [correction.name for correction in robot.corrections]
    coefficients = sum(len(correction.coefficients) for correction in robot.corrections)
    corrections = f"{len(names)} correction{'s' * (len(names) != 1)} ({', '.join(names)})"
    at_prior = [*parameters_at_prior(robot), *(c.name for c in coefficients_at_prior(robot))]
    lines = [
        f"complete model: {parameter_count(result)} parameters and {coefficients} coefficients of "
        f"{corrections} from {_samples(data)} samples in {result.fit.iterations} iterations",
        "known from their priors more than from the data (the uncertainty counts it): "
        f"{', '.join(at_prior) or 'none'}",
    ]
    for fitted in data.recordings:
        tension, source = fitted.estimate.tension, fitted.estimate.tension_source
        if tension is not None:
            force_of = "along the instrument" if source == "instrument" else "in the rod"
            name = f"force {force_of}" + (f" of {fitted.name}" if data.several else "")
            force = f"{tension.min():.0f} to {tension.max():.0f} N"
            lines.append(f"{name}: {force}, {TENSION_SOURCES[source]}")
    return lines


def _clock(out: Console, fitted: FittedRecording, name: str) -> None:
    clock, (offset_sigma, skew_sigma) = fitted.estimate.clock, fitted.estimate.clock_sigma
    if clock is not None:
        out.print(
            f"{escape(name)}: "
            f"offset {clock_offset_text(clock, offset_sigma)}, "
            f"skew {clock_skew_text(clock, skew_sigma)}"
        )
