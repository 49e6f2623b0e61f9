"""The pages of text beside the pictures, in markdown.

The notes: the top of the report, then the machine's parameters and each recording's own. The
scenario: what was simulated or recorded, and how the files were read.
"""

from __future__ import annotations

import yaml

from acquisition.report import report_lines
from ballbar.report.numbers import with_and_without
from ballbar.report.parameters import left_at_nominal, parameter_groups
from ballbar.report.recording import overview
from ballbar.report.section import template
from ballbar.report.summary import summary
from ballbar.report.tcp_view import tcp_view
from ballbar.result.run_data import FittedRecording, Run, RunData


def replay_notes(run: Run) -> str:
    """Verdict, key figures and remarks; of logs the parameters of machine and recordings too."""
    if not isinstance(run, RunData):
        return template("notes.md").render(run=run, summary=summary(run, None, ""), moving=False)
    robot, comparison = run.identification.robot, run.comparison
    return template("notes.md").render(
        run=run,
        summary=summary(run, tcp_view(run), ""),
        moving=True,
        stated=with_and_without(robot.tcp.sigma, robot.tcp.without_scale, robot.cell),
        left_at_nominal=left_at_nominal(robot),
        groups=parameter_groups(robot, comparison),
        recordings=[
            (r.name, overview(r), parameter_groups(r.estimate, comparison)) for r in run.recordings
        ],
    )


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
