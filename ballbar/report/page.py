"""report.html: one page about one run, the verdict in words before any number. No script, no outside request.

RunData -> words and tables (tables.py), figures (figures.py), provenance (provenance.py) -> templates/report.html
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ballbar.report import figures, machine, sphere, tables
from ballbar.report.numbers import rms_norm, significant, to_sigma
from ballbar.report.provenance import InputFile, hashed, input_files, versions, without_folders
from ballbar.report.recording import recording_section
from ballbar.result.run_data import RunData
from cell.arrays import Array
from cell.files import write_whole
from ident.identify import Identification
from ident.robot.accuracy import accuracy_grid, position_error
from ident.robot.unloaded_robot import UnloadedRobot

_TONES = {"good": "Acceptable", "suspect": "Acceptable, with care"}


@dataclass(frozen=True)
class Tile:
    """One key figure."""

    label: str
    value: str
    note: str


@dataclass(frozen=True, eq=False)
class TcpView:
    """TCP error over the accuracy grid: against the truth, or what can be said without it."""

    against_truth: bool
    position: Array  # (G, 3) [m] robot base frame
    before: Array  # (G,) [m] error of the nominal model; against the identified one where the truth is not known
    after: Array  # (G,) [m] error of the identified model; its stated sigma where the truth is not known
    before_label: str
    after_label: str
    predicted: Array  # (G,) [m] distance between nominal and identified model: the error before, by the identified robot's account


def write_report(path: Path, data: RunData, *, command: str) -> None:
    """Writes the report of one run, whole or not at all.

    command : as the user typed it; absolute paths in it are cut to their last part.
    """
    write_whole(path, render_report(data, command=command, written=datetime.now(UTC)).encode())


def render_report(data: RunData, *, command: str, written: datetime) -> str:
    """The page as text; the same inputs give the same text."""
    environment = Environment(
        loader=PackageLoader("ballbar.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    result = data.identification
    tcp = tcp_view(data)
    return environment.get_template("report.html").render(
        data=data,
        result=result,
        description=data.recording.description,
        heading=_heading(data),
        in_short=_in_short(tcp),
        what_to_do=_what_to_do(data),
        confidence=_confidence(data),
        tiles=_tiles(data, tcp),
        tcp=tcp,
        tcp_rows=_tcp_rows(data, tcp),
        figures={
            name: Markup(svg) for name, svg in _figures(data, tcp).items()
        },  # no text from files is in them
        position_rows=tables.residual_rows(result.before.position, result.after.position, 1e6),
        angle_rows=tables.residual_rows(result.before.angle, result.after.angle, 1e6),
        groups=tables.parameter_groups(result, data.comparison),
        z_rms=tables.z_rms(result, data.comparison) if data.comparison else None,
        leftovers=tables.leftovers(result),
        never_asked=tables.never_asked(result),
        clock=_clock_rows(data),
        rivals=_rival_rows(result),
        directions=_sense_rows(result),
        noise=tables.noise_rows(result, _resolutions(data)),
        scale_ppm=result.cell.plate.length_sigma / result.cell.plate.length * 1e6,
        versions=versions(simulated=data.simulation is not None),
        machine=_machine(data),
        recorded=recording_section(data),
        imports=[(one.name, one.recording.report) for one in data.fitted]
        + [(one.outcome.name, one.recording.report) for one in data.validations],
        inputs=_inputs(data),
        command=without_folders(command),
        written=f"{written:%Y-%m-%d %H:%M:%S} UTC",
        significant=significant,
    )


def _machine(data: RunData) -> dict[str, object]:
    """Sections about the complete model, joint fits and held-out recordings; empty where there are none."""
    result = data.identification
    return {
        "held_out": machine.held_out_groups(data.validations),
        "sentences": [(one.outcome.sentence, one.outcome.acceptable) for one in data.validations],
        "recordings": machine.recording_columns(data.joined),
        "recording_rows": machine.RECORDING_ROWS,
        "corrections": machine.correction_tables(result),
        "at_prior": machine.standing_at_prior(result),
        "coefficients_at_prior": [
            (one.name, machine.coefficient_in_words(one))
            for one in machine.coefficients_at_prior(result)
        ],
        "groups": [", ".join(names) for names in machine.groups(result)],
        "tension": machine.tension_sentences(data),
        "events": machine.event_rows(data),
    }


def _inputs(data: RunData) -> list[InputFile]:
    """The files of every recording; under its name where there are several."""
    read = [(one.name, one.recording, one.folder) for one in data.fitted]
    read += [(one.outcome.name, one.recording, one.folder) for one in data.validations]
    scenario = (
        []
        if data.scenario_file is None
        else [hashed(data.scenario_file.parent, data.scenario_file.name)]
    )
    if len(read) == 1:
        return scenario + input_files(data.recording, data.folder)
    return scenario + [
        replace(file, name=f"{name}/{file.name}")
        for name, recording, folder in read
        for file in input_files(recording, folder)
    ]


def _heading(data: RunData) -> str:
    if failed := [one.outcome.name for one in data.validations if not one.outcome.acceptable]:
        return f"Held-out recording not explained: {', '.join(failed)}"
    missed = [limit.what for limit in data.limits if not limit.met]
    if data.identification.verdict.acceptable and missed:
        return f"Limits of the scenario missed: {', '.join(missed)}"
    return _TONES.get(data.identification.verdict.status, "Not acceptable")


def tcp_view(data: RunData) -> TcpView:
    """Error against the truth if there is a comparison, else the correction made and its stated uncertainty."""
    result = data.identification
    grid = accuracy_grid(result.cell.robot)
    shift = position_error(
        UnloadedRobot(result.cell, result.nominal).tool(grid), result.unloaded_robot().tool(grid)
    )
    if data.comparison:
        before, after = data.comparison.tcp_nominal, data.comparison.tcp
        return TcpView(
            True,
            before.position,
            before.error,
            after.error,
            "TCP error before",
            "TCP error after",
            shift.error,
        )
    return TcpView(
        False,
        shift.position,
        shift.error,
        result.tcp_sigma,
        "TCP correction",
        "Stated TCP sigma",
        shift.error,
    )


def _in_short(tcp: TcpView) -> str:
    """The error before and after, for who decides."""
    before, after, poses = _mm(tcp.before.mean()), _mm(tcp.after.mean()), tcp.before.size
    if tcp.against_truth:
        text = (
            f"Over {poses} poses of the workspace the mean TCP error is {before} with the nominal model "
            f"and {after} with the identified one."
        )
    else:
        text = (
            f"Over {poses} poses of the workspace the identified model moves the TCP by {before} on average against the nominal one; "
            f"the stated uncertainty of what remains is {after} (1 sigma, mean)."
        )
    return text


def _what_to_do(data: RunData) -> str:
    """The sentence for who decides, from verdict, limits and held-out recordings."""
    result = data.identification
    if not result.verdict.acceptable:
        return "Do not use these parameters before the cause has been found."
    if not data.acceptable:
        return "Do not use these parameters yet: the robot was identified, but not as well as was asked for."
    use = "The identified robot may be used: ballbar export writes it for other programs, ballbar correct corrects targets."
    return (
        f"{use} Clear up the remarks below first if the margin is tight."
        if result.verdict.status == "suspect"
        else use
    )


def _confidence(data: RunData) -> str:
    """How sure the figures are, and what they leave out."""
    result = data.identification
    left = names_of(tables.leftovers(result))
    text = (
        f"By its own account the identified model is within {_mm(2.0 * result.tcp_sigma.mean())} of the tool's place at an average pose "
        f"and within {_mm(2.0 * result.tcp_sigma.max())} at the worst, with 95 % confidence (2 sigma), under the assumptions below."
    )
    return (
        f"{text} Not determined by this path and kept at the catalogue's values: {left}."
        if left
        else text
    )


def names_of(leftovers: Sequence[tables.Leftover]) -> str:
    """Their names in words."""
    return tables.names_in_words([one.name for one in leftovers])


def _tiles(data: RunData, tcp: TcpView) -> list[Tile]:
    result = data.identification
    before, after = rms_norm(result.before.position), rms_norm(result.after.position)
    angles = rms_norm(result.before.angle), rms_norm(result.after.angle)
    poor = "" if result.converged else ", not converged"
    equations = result.whitened.shape[0]
    each = f"{equations} equation{'s' * (equations > 1)} each"
    return [
        _tcp_tile(result, tcp),
        _clock_tile(data),
        Tile(
            "Residual rms, before → after",
            f"{significant(before * 1e6)} → {significant(after * 1e6)} µm",
            f"angle {significant(angles[0] * 1e6)} → {significant(angles[1] * 1e6)} µrad",
        ),
        Tile("Iterations", f"{result.iterations}", f"from the automatic start{poor}"),
        Tile(
            "Samples",
            " + ".join(str(one.identification.after.t.size) for one in data.fitted),
            f"{each}, {_unknowns(result)}",
        ),
    ]


def _unknowns(result: Identification) -> str:
    count = sum(len(one.coefficients) for one in result.corrections)
    return (
        f"{result.parameters.size} parameters, {count} coefficients"
        if count
        else f"{result.covariance.shape[0]} unknowns"
    )


def _tcp_tile(result: Identification, tcp: TcpView) -> Tile:
    before, after = significant(tcp.before.mean() * 1e3), significant(tcp.after.mean() * 1e3)
    if tcp.against_truth:
        note = f"mean of {tcp.before.size} poses, against the truth; stated uncertainty {_mm(result.tcp_sigma.mean())} (1 sigma)"
        return Tile("TCP error, before → after", f"{before} → {after} mm", note)
    return Tile(
        "Stated TCP uncertainty",
        f"{after} mm",
        f"1 sigma, mean of {tcp.before.size} poses; correction made {before} mm",
    )


def _clock_tile(data: RunData) -> Tile:
    rows = _clock_rows(data)
    if not rows:
        return Tile("Clock", "one log", "no encoders, so there is no second clock")
    (_, offset, offset_sigma, _), (_, skew, skew_sigma, _) = rows
    return Tile("Clock offset", offset, f"± {offset_sigma}; skew {skew} ± {skew_sigma} (1 sigma)")


def _tcp_rows(data: RunData, tcp: TcpView) -> list[tuple[str, str, str, str, str]]:
    if data.comparison:
        nominal, identified = data.comparison.tcp_nominal, data.comparison.tcp
        rows = [("before (nominal)", nominal), ("after (identified)", identified)]
        errors = [tables.tcp_row(name, one.error, one.error_without_scale) for name, one in rows]
        errors.append(tables.tcp_row("predicted before", tcp.predicted, None))
    else:
        errors = [tables.tcp_row("correction (nominal to identified)", tcp.before, None)]
    return [*errors, tables.tcp_row("stated sigma", data.identification.tcp_sigma, None)]


def _figures(data: RunData, tcp: TcpView) -> Mapping[str, str]:
    result = data.identification
    landmarks = figures.Landmarks(result.geometry.origin, result.geometry["bd3"])
    before, after, clock = (
        result.before,
        result.after,
        "robot" if result.clock is None else "ball-bar",
    )
    curves = [
        figures.Curve(tcp.before_label, tcp.before, figures.BEFORE),
        figures.Curve(tcp.after_label, tcp.after, figures.AFTER),
    ]
    if tcp.against_truth:
        curves += [
            figures.Curve(
                "predicted before: nominal against identified",
                tcp.predicted,
                figures.BEFORE,
                dashed=True,
            )
        ]
        curves += [
            figures.Curve(
                "predicted after: stated sigma", result.tcp_sigma, figures.AFTER, dashed=True
            )
        ]
    position, angle = "position residual [µm]", "angle residual [µrad]"
    directions = sphere.tool_directions(data.fitted[0])
    pulled = [one.identification for one in data.fitted if one.identification.tension.any()]
    tension = {
        f"tension_{k}": figures.tension_over_time(one.after.t, one.tension, clock=clock)
        for k, one in enumerate(pulled)
    }
    return tension | {
        "cumulative": figures.cumulative(
            curves, label="TCP error" if tcp.against_truth else "distance of the TCP"
        ),
        "map_before": figures.workspace_map(
            tcp.position, tcp.before, landmarks, label=f"{tcp.before_label}, mean", before=True
        ),
        "map_after": figures.workspace_map(
            tcp.position, tcp.after, landmarks, label=f"{tcp.after_label}, mean", before=False
        ),
        "position_norm": figures.norms_over_time(
            after.t, before.position * 1e6, after.position * 1e6, label=position, clock=clock
        ),
        "angle_norm": figures.norms_over_time(
            after.t, before.angle * 1e6, after.angle * 1e6, label=angle, clock=clock
        ),
        "position": figures.components_over_time(
            after.t, after.position * 1e6, label=position, clock=clock
        ),
        "angle": figures.components_over_time(after.t, after.angle * 1e6, label=angle, clock=clock),
        "sphere_before": sphere.sphere_map(directions, before, before=True),
        "sphere_after": sphere.sphere_map(directions, after, before=False),
        "correlations": sphere.correlation_map(
            result.machine.values, result.machine.names, machine.groups(result)
        ),
        "histogram": figures.whitened_histogram(result.whitened),
    }


def _clock_rows(data: RunData) -> list[tuple[str, str, str, str]]:
    """(what, value, sigma, error against the truth) of offset and skew, each with its unit; empty without a second clock."""
    clock, comparison = data.identification.clock, data.comparison
    if clock is None:
        return []
    offset_sigma, skew_sigma = data.identification.clock_sigma
    errors = (comparison.offset, comparison.skew) if comparison else (None, None)
    shown = (
        ("offset", clock.offset, offset_sigma, 1e3, "ms", "µs"),
        ("skew", clock.skew, skew_sigma, 1e6, "ppm", "ppm"),
    )
    return [
        (
            name,
            f"{to_sigma(value * factor, sigma * factor)} {unit}",
            f"{significant(sigma * 1e6, 2)} {small}",
            _signed(error, small),
        )
        for (name, value, sigma, factor, unit, small), error in zip(shown, errors, strict=True)
    ]


def _rival_rows(result: Identification) -> list[tuple[str, str, str]]:
    """(clock offset, cost per residual, overlap) of the chosen hypothesis and its rivals; empty if there are none."""
    if not result.start.ambiguous:
        return []
    return [
        (
            f"{significant(one.fit.estimate.clock.offset, 4)} s",
            significant(one.cost),
            f"{significant(one.overlap)} s",
        )
        for one in (result.start.chosen, *result.start.rivals)
    ]


def _sense_rows(result: Identification) -> list[tuple[str, str]]:
    """(encoders, what was found about their sense of rotation)."""
    signs = dict(zip(result.joints, result.signs, strict=True))
    kinds = {
        "sense as declared": [j for j, sign in signs.items() if j not in (2, 4) and sign > 0],
        "sense opposite to the declared one; the found one is used": [
            j for j, sign in signs.items() if j not in (2, 4) and sign < 0
        ],
        "sense taken as declared: it cannot be observed, and does not change the result": [
            j for j in signs if j in (2, 4)
        ],
    }
    return [
        (tables.names_in_words([f"b{j}" for j in joints]), words)
        for words, joints in kinds.items()
        if joints
    ]


def _resolutions(data: RunData) -> dict[str, float]:
    """[rad] one count of each encoder."""
    return {
        name: 2.0 * np.pi / (one.lines * 2.0**one.bits)
        for name, one in data.recording.description.encoders.items()
    }


def _signed(value: float | None, unit: str) -> str:
    return "" if value is None else f"{significant(value * 1e6, 2, sign=True)} {unit}"


def _mm(metres: float) -> str:
    return f"{significant(float(metres) * 1e3)} mm"
