"""Sections about one recording each: everything that it does not share with the others."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ballbar.cell.arrays import Array
from ballbar.cell.statistics import rms
from ballbar.report import recording_figures as figures
from ballbar.report.cell_picture import cell_picture
from ballbar.report.maps import sphere_maps
from ballbar.report.motion import cell_motion, mark_sentences, marks, rms_norm
from ballbar.report.numbers import MISSING, significant, to_sigma
from ballbar.report.parameters import parameter_groups, taken_as_nominal
from ballbar.report.recording_figures import log_figures
from ballbar.report.recording_text import (
    TENSION_SOURCES,
    clock_rows,
    direction_sentences,
    start_rows,
    tension_sentence,
)
from ballbar.report.section import Section, section
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.units import MS, PPM, UM, URAD


def recording_sections(run: RunData) -> list[Section]:
    """A section for each recording that was fitted: everything that it has of its own."""
    if not run.recordings:
        return []
    return [_section(run, number, fitted) for number, fitted in enumerate(run.recordings, start=1)]


def _section(data: RunData, n: int, fitted: FittedRecording) -> Section:
    """n : number of the recording from 1, for anchors."""
    estimate, recording, comparison = fitted.estimate, fitted.recording, data.comparison
    name = fitted.name if data.several else ""
    corrected = bool(data.identification.robot.corrections)
    groups, force = parameter_groups(estimate, comparison), tension_sentence(estimate)
    clock = "robot"  # on which residuals are shown
    if estimate.clock is not None:
        clock = "ball-bar" if estimate.encoders else "sensor's"
    force_figure, motion = Markup(), cell_motion(fitted)
    passed = marks(fitted, motion)
    if estimate.tension is not None:
        force_figure = figures.tension_over_time(estimate.after.t, estimate.tension, clock=clock)
    placement = "Seat" if recording.description.instrument else "Offsets and base pose"
    links = {
        f"residuals-{n}": "Residuals",
        f"own-{n}": placement if groups else "",
        f"clock-{n}": "Clock",
        f"tracker-{n}": "Tracker" if estimate.tracker else "",
        f"tension-{n}": "Force" if force else "",
        f"step-faults-{n}": "Step faults" if corrected or estimate.step_faults else "",
        f"noise-{n}": "Noise",
        f"logs-{n}": "Logs",
        f"import-{n}": "Import",
    }
    return section(
        "recording.html",
        links,
        name or "Recording",
        n=n,
        name=name,
        own=recording.description,
        estimate=estimate,
        several=data.several,
        against_truth=comparison is not None,
        corrected=corrected,
        picture=cell_picture(data.identification.robot.cell, fitted),
        overview=overview(fitted),
        residuals=_residuals(fitted, clock),
        groups=groups,
        taken_as_nominal=taken_as_nominal(estimate),
        clock=clock_rows(estimate, comparison),
        rivals=start_rows(estimate.start),
        directions=direction_sentences(estimate),
        tension=force,
        tension_figure=force_figure,
        noise=_noise_rows(fitted),
        log_sentences=mark_sentences(passed),
        log_figures=log_figures(fitted, motion, passed),
        imported=recording.report,
    )


def _residuals(fitted: FittedRecording, clock: str) -> dict[str, object]:
    """Loop-closure residuals: before and after over time and on the sphere, and their sizes."""
    estimate, t = fitted.estimate, fitted.estimate.after.t
    before, after = estimate.before, estimate.after
    content: dict[str, object] = {
        "sphere": sphere_maps(fitted),
        "histogram": figures.whitened_histogram(estimate.whitened),
        "chi2": significant(rms(estimate.whitened) ** 2),
        "angle_rows": [],
    }
    quantities = {"position": (before.position * UM, after.position * UM, "µm")}
    if fitted.recording.length_log is None:  # a length sees no angle
        quantities["angle"] = before.angle * URAD, after.angle * URAD, "µrad"
    for name, (first, last, unit) in quantities.items():
        label = f"{name} residual [{unit}]"
        content[f"{name}_norm"] = figures.norms_over_time(t, first, last, label=label, clock=clock)
        content[name] = figures.components_over_time(t, last, label=label, clock=clock)
        content[f"{name}_rows"] = _residual_rows(first, last)
    return content


def _residual_rows(before: Array, after: Array) -> list[tuple[str, ...]]:
    """Components and norm of residuals (N, 3): rms before and after, largest after."""
    sizes = [
        (name, rms(b), rms(a), float(np.abs(a).max()))
        for name, b, a in zip("xyz", before.T, after.T, strict=True)
    ]
    largest = float(np.linalg.norm(after, axis=1).max())
    sizes.append(("norm", rms_norm(before), rms_norm(after), largest))
    return [(name, *map(significant, numbers)) for name, *numbers in sizes]


def _noise_rows(fitted: FittedRecording) -> list[tuple[str, str, str]]:
    """Noise of one row of each log; the resolution of an encoder is one count."""
    noise = fitted.estimate.noise
    rows = [
        (f"robot joint {joint}", significant(sigma * URAD), MISSING)
        for joint, sigma in enumerate(noise.joint.tolist(), start=1)
    ]
    if fitted.recording.length_log is not None:
        rows.append(("length [µm]", significant(noise.length * UM), MISSING))
    for name, fitting in sorted(fitted.recording.description.encoders.items()):
        sigma = float(noise.encoder[int(name[1]) - 1])
        count = 2.0 * np.pi / (fitting.lines * 2.0**fitting.bits)
        rows.append((f"encoder {name}", significant(sigma * URAD), significant(count * URAD)))
    return rows


def overview(fitted: FittedRecording) -> dict[str, str]:
    """Key figures of a recording by their names, each with its unit."""
    estimate, (offset_sigma, skew_sigma) = fitted.estimate, fitted.estimate.clock_sigma
    offset, skew, angle = MISSING, MISSING, MISSING
    if (clock := estimate.clock) is not None:
        offset = _with_sigma(clock.offset * MS, offset_sigma * MS, "ms")
        skew = _with_sigma(clock.skew * PPM, skew_sigma * PPM, "ppm")
    if fitted.recording.length_log is None:
        angle = f"{significant(rms_norm(estimate.after.angle) * URAD)} µrad"
    force = MISSING if estimate.tension is None else TENSION_SOURCES[estimate.tension_source]
    return {
        "length": f"{fitted.recording.robot_log.t[-1]:.0f} s",
        "samples": str(estimate.samples),
        "clock offset": offset,
        "clock skew": skew,
        "force in the rod": force,
        "position residual, rms": f"{significant(rms_norm(estimate.after.position) * UM)} µm",
        "angle residual, rms": angle,
        "chi-square per residual": significant(rms(estimate.whitened) ** 2, 2),
        "step faults repaired": str(len(estimate.step_faults)),
    }


def _with_sigma(value: float, sigma: float, unit: str) -> str:
    return f"{to_sigma(value, sigma)} ± {significant(sigma, 2)} {unit}"
