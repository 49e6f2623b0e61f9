"""The page of text beside the pictures: verdict first, key figures, then every parameter with its uncertainty (markdown)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import yaml

from acquisition.report import report_lines
from ballbar.replay.motion import residual_norms
from ballbar.result.compare import Comparison, Limit
from ballbar.result.run_data import RunData
from cell.geometry import INDEX, PARAMETERS
from ident.identify import Identification


def replay_notes(data: RunData) -> str:
    """Markdown: name, verdict sentence, key figures, remarks, what was left at its nominal value, parameters with sigma."""
    result = data.identification
    parts = [
        f"# {data.name}",
        f"**{result.verdict.sentence}** {_gain(data.comparison)}".strip(),
        _table(("key figure", "value"), [*_truth_figures(data.comparison), *_figures(result)]),
        _limits(data.limits),
        "\n".join(f"- Note: {warning}" for warning in result.verdict.warnings),
        f"{_setup(result)}; {'simulated' if data.simulation else 'recorded'}, {data.recording.robot_log.t[-1]:.0f} s.",
        "## Left at the nominal value",
        _dropped(result),
        "## Identified parameters",
        "Lengths in mm, sigma in um; angles in mrad, sigma in urad. Sigma is one standard deviation.",
        _parameters(result, data.comparison),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def scenario_page(data: RunData) -> str:
    """Markdown: the scenario of a simulated run, or what the recording says about itself; and how its files were read."""
    file = data.folder / "recording.yaml"
    parts = ["# What was simulated" if data.scenario else "# What was recorded"]
    if data.scenario is not None:
        parts.append(
            _code(
                yaml.safe_dump(
                    data.scenario.model_dump(mode="json", exclude_unset=True),
                    sort_keys=False,
                    width=100,
                )
            )
        )
    if file.is_file():
        parts += ["## recording.yaml", _code(file.read_text(encoding="utf-8"))]
    parts += ["## How the files were read", _code("\n".join(report_lines(data.recording.report)))]
    return "\n\n".join(parts) + "\n"


def _code(text: str) -> str:
    """As it stands, whatever it holds: indented, since no fence is safe from what a file may contain."""
    return "\n".join(f"    {line}" for line in text.splitlines())


def _gain(comparison: Comparison | None) -> str:
    if comparison is None:
        return ""
    before, after = comparison.tcp_nominal.mean, comparison.tcp.mean
    return f"Over the workspace the tool was {before * 1e3:.2f} mm off on average before, and is {after * 1e6:.1f} um off now."


def _setup(result: Identification) -> str:
    fitted = ", ".join(f"b{joint}" for joint in result.joints)
    return f"{result.cell.robot.title} on {result.cell.ballbar.title}; {f'encoders {fitted}' if fitted else 'no encoders'}"


def _truth_figures(comparison: Comparison | None) -> list[tuple[str, str]]:
    if comparison is None:
        return []
    before, after = comparison.tcp_nominal, comparison.tcp
    rows = [
        (
            "TCP error before, mean (largest)",
            f"{before.mean * 1e3:.3f} ({before.maximum * 1e3:.3f}) mm",
        ),
        (
            "TCP error after, mean (largest)",
            f"{after.mean * 1e3:.4f} ({after.maximum * 1e3:.4f}) mm",
        ),
        ("parameter distance, Euclidean", f"{comparison.distance * 1e3:.4f} mm or mrad"),
    ]
    if comparison.offset is not None and comparison.skew is not None:
        rows.append(
            (
                "clock error: offset, skew",
                f"{comparison.offset * 1e6:+.2f} us, {comparison.skew * 1e6:+.3f} ppm",
            )
        )
    return rows


def _figures(result: Identification) -> list[tuple[str, str]]:
    rows = [("TCP uncertainty as stated, mean", f"{result.tcp_sigma.mean() * 1e3:.4f} mm")]
    for what, residuals in (("before", result.before), ("after", result.after)):
        position, angle = (float(np.sqrt(np.mean(norm**2))) for norm in residual_norms(residuals))
        rows.append(
            (
                f"loop-closure residual {what}, RMS",
                f"{position * 1e6:.1f} um, {angle * 1e6:.1f} urad",
            )
        )
    if result.clock is not None:
        offset_sigma, skew_sigma = result.clock_sigma
        rows.append(
            ("clock offset", f"{result.clock.offset * 1e3:.4f} ± {offset_sigma * 1e3:.4f} ms")
        )
        rows.append(("clock skew", f"{result.clock.skew * 1e6:.3f} ± {skew_sigma * 1e6:.3f} ppm"))
    rows.append(("iterations", f"{result.iterations}, from the automatic start"))
    rows.append(("samples; equations each", f"{result.after.t.size}; {result.whitened.shape[0]}"))
    rows.append(("chi-square per degree of freedom", f"{result.chi2_per_dof:.3f}"))
    rows.append(
        (
            "rank; condition number",
            f"{result.identifiability.rank}; {result.identifiability.condition:.0f}",
        )
    )
    return rows


def _limits(limits: Sequence[Limit]) -> str:
    if not limits:
        return ""
    rows = [
        (
            one.what,
            f"{one.measured:.4g} {one.unit}",
            f"{one.allowed:g} {one.unit}",
            "yes" if one.met else "NO",
        )
        for one in limits
    ]
    return _table(("limit of the scenario", "measured", "allowed", "met"), rows)


def _dropped(result: Identification) -> str:
    dropped = result.identifiability.dropped
    if not dropped:
        return "Nothing: every parameter asked for was identified."
    return _table(
        ("parameter", "why"), [(d.name, f"{d.reason} {', '.join(d.on)}".strip()) for d in dropped]
    )


def _parameters(result: Identification, comparison: Comparison | None) -> str:
    header = (
        "parameter",
        "nominal",
        "identified",
        "change",
        "sigma",
        *(["error"] if comparison else []),
    )
    errors = comparison.deviations if comparison else {}
    return _table(
        header, [_parameter(result, name, errors)[: len(header)] for name in result.sigma]
    )


def _parameter(result: Identification, name: str, errors: Mapping[str, float]) -> tuple[str, ...]:
    parameter = PARAMETERS[INDEX[name]]
    large, small = ("mm", "um") if parameter.is_length else ("mrad", "urad")
    nominal, value = result.nominal[name] * 1e3, result.geometry[name] * 1e3
    placed = parameter.kind == "origin" or (parameter.side, parameter.kind) == (
        "bar",
        "theta",
    )  # wherever it was set up: no nominal value
    known = ("", "") if placed else (f"{nominal:.3f} {large}", f"{value - nominal:+.4f} {large}")
    error = f"{errors[name] * 1e6:+.2f} {small}" if name in errors else ""
    return (
        name,
        known[0],
        f"{value:.4f} {large}",
        known[1],
        f"{result.sigma[name] * 1e6:.2f} {small}",
        error,
    )


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A markdown table, numbers to the right."""
    lines = [header, (":--", *(["--:"] * (len(header) - 1))), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
