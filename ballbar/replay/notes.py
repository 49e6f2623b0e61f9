"""The pages of text beside the pictures, in markdown.

The notes: verdict, key figures, the machine's parameters, then each recording's own. The scenario:
what was simulated or recorded, and how the files were read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import yaml

from acquisition.report import report_lines
from ballbar.replay.parameters import units_of
from ballbar.report.motion import rms_norm
from ballbar.report.numbers import with_and_without
from ballbar.result.compare import Comparison
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.truth.limits import Limit
from ballbar.units import MM, MS, PPM, UM, URAD, US
from cell.foreign_text import markdown
from cell.geometry import parameter_named
from ident.result import FitStatistics, Identification, RecordingEstimate, RobotEstimate

Rows = list[tuple[str, str]]


def replay_notes(run: RunData) -> str:
    """Verdict and remarks; of logs key figures, dropped parameters, machine and recordings too."""
    if run.recordings:
        return _notes_of_logs(run)
    verdict = run.identification.verdict
    sentences = (run.name, verdict.sentence, *(outcome.sentence for outcome in run.outcomes))
    title, *texts = map(markdown, sentences)
    warnings = [f"- {markdown(warning)}" for warning in verdict.warnings]
    return "\n\n".join([f"# {title}", *texts, *warnings])


def _notes_of_logs(data: RunData) -> str:
    result, comparison = data.identification, data.comparison
    robot, tcp = result.robot, result.robot.tcp
    stated = with_and_without(tcp.sigma, tcp.without_scale, robot.cell)
    rows = [*_truth_rows(comparison), ("TCP uncertainty as stated, mean", stated)]
    if not data.several:
        rows += _recording_rows(data.recordings[0].estimate)
    rows += _fit_rows(result.fit)
    errors = comparison.deviations if comparison else {}
    parts = [
        f"# {markdown(data.name)}",
        f"**{markdown(result.verdict.sentence)}** {_gain(comparison)}".strip(),
        _table(("key figure", "value"), rows),
        _limits(data.limits),
        "\n".join(f"- Note: {markdown(warning)}" for warning in result.verdict.warnings),
        _setup(data),
        "## Left at the nominal value",
        _dropped(result),
        "## Identified parameters",
        "Lengths in mm, sigma in um; angles in mrad, sigma in urad. Sigma is one standard "
        "deviation.",
        _parameters(robot, errors),
    ]
    for fitted in data.recordings:
        heading = markdown(fitted.name) if data.several else "Encoder offsets and base pose"
        parts.append(f"## {heading}")
        if data.several:
            parts.append(_table(("key figure", "value"), _recording_rows(fitted.estimate)))
        parts.append(_parameters(fitted.estimate, errors))
    return "\n\n".join(part for part in parts if part) + "\n"


def scenario_page(data: RunData, fitted: FittedRecording) -> str:
    """The scenario of a simulated run, or what the recording says of itself; its import report."""
    file = fitted.folder / "recording.yaml"
    parts = ["# What was simulated" if data.scenario else "# What was recorded"]
    if data.scenario is not None:
        settings = data.scenario.model_dump(mode="json", exclude_unset=True)
        parts.append(_code(yaml.safe_dump(settings, sort_keys=False, width=100)))
    if file.is_file():
        parts += ["## recording.yaml", _code(file.read_text(encoding="utf-8"))]
    lines = report_lines(fitted.recording.report)
    parts += ["## How the files were read", _code("\n".join(lines))]
    return "\n\n".join(parts) + "\n"


def _code(text: str) -> str:
    """A block of text, indented: no fence is safe from what a file may contain."""
    return "\n".join(f"    {line}" for line in text.splitlines())


def _gain(comparison: Comparison | None) -> str:
    if comparison is None:
        return ""
    before, after = comparison.tcp_nominal.mean * MM, comparison.tcp.mean * UM
    return (
        f"Over the workspace the mean TCP error is {before:.2f} mm with the nominal robot and "
        f"{after:.1f} um with the identified one."
    )


def _setup(data: RunData) -> str:
    robot = data.identification.robot
    encoders = ", ".join(f"b{joint}" for joint in robot.encoders)
    sensed = f"encoders {encoders}" if encoders else "no encoders"
    if robot.cell.ballbar.stroke is not None:
        sensed = "length sensed"
    lengths = " + ".join(f"{r.recording.robot_log.t[-1]:.0f} s" for r in data.recordings)
    return (
        f"{markdown(robot.cell.robot.title)} on {markdown(robot.cell.ballbar.title)}; "
        f"{sensed}; "
        f"{'simulated' if data.simulation else 'recorded'}, {lengths}."
    )


def _truth_rows(comparison: Comparison | None) -> Rows:
    if comparison is None:
        return []
    before, after = comparison.tcp_nominal, comparison.tcp
    nominal = f"{before.mean * MM:.3f} ({before.maximum * MM:.3f}) mm"
    identified = f"{after.mean * MM:.4f} ({after.maximum * MM:.4f}) mm"
    rows = [
        ("TCP error before, mean (largest)", nominal),
        ("TCP error after, mean (largest)", identified),
        ("parameter distance, Euclidean", f"{comparison.distance * MM:.4f} mm or mrad"),
    ]
    if comparison.offset is not None and comparison.skew is not None:
        error = f"{comparison.offset * US:+.2f} us, {comparison.skew * PPM:+.3f} ppm"
        rows.append(("clock error: offset, skew", error))
    return rows


def _fit_rows(fit: FitStatistics) -> Rows:
    return [
        ("iterations", f"{fit.iterations}, from the automatic start"),
        ("chi-square per degree of freedom", f"{fit.chi2_per_dof:.3f}"),
        ("rank; condition number", f"{fit.rank}; {fit.condition:.0f}"),
    ]


def _recording_rows(estimate: RecordingEstimate) -> Rows:
    rows = [("samples; equations each", f"{estimate.samples}; {estimate.whitened.shape[0]}")]
    for when, residuals in (("before", estimate.before), ("after", estimate.after)):
        position, angle = rms_norm(residuals.position) * UM, rms_norm(residuals.angle) * URAD
        angle_text = f", {angle:.1f} urad" if estimate.encoders or estimate.clock is None else ""
        rows.append((f"loop-closure residual {when}, RMS", f"{position:.1f} um{angle_text}"))
    if estimate.clock is not None:
        clock, (offset_sigma, skew_sigma) = estimate.clock, estimate.clock_sigma
        offset = f"{clock.offset * MS:.4f} ± {offset_sigma * MS:.4f} ms"
        skew = f"{clock.skew * PPM:.3f} ± {skew_sigma * PPM:.3f} ppm"
        rows += [("clock offset", offset), ("clock skew", skew)]
    return rows


def _limits(limits: Sequence[Limit]) -> str:
    if not limits:
        return ""
    rows = [(limit.what, *limit.sizes, "yes" if limit.met else "NO") for limit in limits]
    return _table(("limit of the scenario", "measured", "allowed", "met"), rows)


def _dropped(result: Identification) -> str:
    rows = [(d.name, f"{d.reason} {', '.join(d.on)}".strip()) for d in result.robot.dropped]
    if not rows:
        return "Nothing: every requested parameter was identified."
    return _table(("parameter", "why"), rows)


def _parameters(estimate: RobotEstimate | RecordingEstimate, errors: Mapping[str, float]) -> str:
    header = ["parameter", "nominal", "identified", "change", "sigma"]
    header += ["error"] if errors else []
    rows = [_parameter(estimate, name, errors)[: len(header)] for name in estimate.sigma]
    return _table(header, rows)


def _parameter(
    estimate: RobotEstimate | RecordingEstimate, name: str, errors: Mapping[str, float]
) -> tuple[str, ...]:
    parameter, (large, small) = parameter_named(name), units_of(name)
    nominal, value = estimate.nominal[name] * MM, estimate.geometry[name] * MM
    encoder_offset = (parameter.side, parameter.kind) == ("bar", "theta")
    catalogue = "", ""  # of the base position and encoder offsets the catalogue says nothing
    if parameter.kind != "origin" and not encoder_offset:
        catalogue = f"{nominal:.3f} {large}", f"{value - nominal:+.4f} {large}"
    error = f"{errors[name] * UM:+.2f} {small}" if name in errors else ""
    sigma = f"{estimate.sigma[name] * UM:.2f} {small}"
    return name, catalogue[0], f"{value:.4f} {large}", catalogue[1], sigma, error


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table, numbers to the right."""
    lines = [header, (":--", *(["--:"] * (len(header) - 1))), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
