"""The top of the page: verdict, what it means, what to do, and the key figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.clock import UNSEEN_OFFSET
from ballbar.cell.number_text import duration_text
from ballbar.ident.result import Identification
from ballbar.ident.table_estimate import TableEstimate
from ballbar.ident.verdict import Status
from ballbar.report.motion import rms_norm
from ballbar.report.numbers import MISSING, listed, millimetres, significant, with_and_without
from ballbar.report.parameters import left_at_nominal, parameter_count
from ballbar.report.recording_text import clock_rows
from ballbar.report.tcp_view import TcpView
from ballbar.result.compare import Comparison
from ballbar.result.run_data import RunData
from ballbar.units import MM, MS, UM, URAD

_HEADINGS = {Status.GOOD: "Acceptable", Status.SUSPECT: "Acceptable, with care"}
_BANDS = {Status.GOOD: "good", Status.SUSPECT: "care"}  # classes of report.css


@dataclass(frozen=True)
class Tile:
    """One key figure."""

    label: str
    value: str
    note: str


@dataclass(frozen=True)
class Summary:
    """Verdict and key figures, before the first section."""

    band: str  # class of the verdict's band: "good", "care" or "bad"
    heading: str
    sentences: tuple[str, ...]  # of the held-out recordings, then of the verdict
    warnings: tuple[str, ...]
    subtitle: str = ""
    paragraphs: tuple[str, ...] = ()  # in short, and how sure the figures are
    what_to_do: str = ""
    tiles: tuple[Tile, ...] = ()
    even: bool = False  # whether the tiles are of one width


def summary(run: RunData, tcp: TcpView, advice: str) -> Summary:
    """The summary of a run; advice : what would help most next."""
    verdict = run.identification.verdict
    common = Summary(
        band=_BANDS.get(verdict.status, "bad") if run.acceptable else "bad",
        heading=_heading(run),
        sentences=(*(outcome.sentence for outcome in run.outcomes), verdict.sentence),
        warnings=verdict.warnings,
    )
    if not run.recordings:
        poses = run.identification.poses
        assert poses is not None, "without recordings there are still poses"
        table, tiles = poses.table, _pose_tiles(poses, run.comparison)
        kinds = listed(sorted({group.kind.noun for group in table.groups}))
        subtitle = f"{table.robot.title}; {table.size} {table.what}, {kinds}."
        return replace(common, subtitle=subtitle, tiles=tiles, even=True)
    return replace(
        common,
        subtitle=_subtitle(run),
        paragraphs=(_in_short(tcp, run.identification), _confidence(run.identification)),
        what_to_do=f"{_what_to_do(run)} {advice}".strip(),
        tiles=_tiles(run, tcp),
    )


def _subtitle(data: RunData) -> str:
    robot = data.identification.robot
    encoders = f"{len(robot.encoders)} encoders" if robot.encoders else "no encoders"
    if robot.cell.ballbar.stroke is not None:
        encoders = "its length sensed"
    recordings = [fitted.recording for fitted in data.recordings]
    kinds = listed(sorted({recording.description.kind for recording in recordings}))
    measured = f"{kinds} recording of {recordings[0].robot_log.t[-1]:.0f} s"
    if data.several:
        measured = f"{len(recordings)} {kinds} recordings together"
    cell = robot.cell
    return f"{cell.robot.title} on {cell.ballbar.title} with {encoders}; {measured}."


def _heading(run: RunData) -> str:
    verdict = run.identification.verdict
    if failed := [outcome.name for outcome in run.outcomes if not outcome.acceptable]:
        measured = "recording" if run.recordings else "poses"
        return f"Held-out {measured} not explained: {', '.join(failed)}"
    missed = [limit.what for limit in run.limits if not limit.met]
    if verdict.acceptable and missed:
        return f"Limits of the scenario missed: {', '.join(missed)}"
    return _HEADINGS.get(verdict.status, "Not acceptable")


def _in_short(tcp: TcpView, result: Identification) -> str:
    """The error before and after."""
    before, after = millimetres(tcp.before.mean()), millimetres(tcp.after.mean())
    poses = f"Over {tcp.before.size} poses of the workspace"
    if tcp.against_truth:
        return (
            f"{poses} the mean TCP error is {before} with the nominal model and {after} with the "
            "identified one."
        )
    stated = with_and_without(tcp.stated, tcp.stated_without_scale, result.robot.cell)
    return (
        f"{poses} the identified model moves the TCP by {before} on average against the nominal "
        f"one; the stated uncertainty of what remains is {stated} (1 sigma, mean)."
    )


def _what_to_do(data: RunData) -> str:
    """The sentence for a decision, from verdict, limits and held-out recordings."""
    verdict = data.identification.verdict
    if not verdict.acceptable:
        return "Do not use these parameters before the cause has been found."
    if not data.acceptable:
        return (
            "Do not use these parameters yet: the robot was identified, but not as well as was "
            "required."
        )
    use = (
        "The identified robot may be used: ballbar export writes it for other programs, ballbar "
        "correct corrects targets."
    )
    if verdict.status is Status.SUSPECT:
        return f"{use} Clear up the remarks below first if the margin is tight."
    return use


def _confidence(result: Identification) -> str:
    """How sure the figures are, and what they leave out."""
    tcp, at_nominal = result.robot.tcp, left_at_nominal(result.robot)
    mean, worst = (millimetres(2.0 * size) for size in (tcp.sigma.mean(), tcp.sigma.max()))
    without = millimetres(2.0 * tcp.without_scale.mean())
    sentence = (
        f"By its own account the identified model is within {mean} of the true tool position at an "
        f"average pose and within {worst} at the worst, with 95 % confidence (2 sigma), under the "
        f"assumptions below; without the scale, which no recording shows, within {without} at an "
        "average pose."
    )
    if not at_nominal:
        return sentence
    names = listed([name for name, *_ in at_nominal])
    return f"{sentence} Not determined here and kept at the catalogue's values: {names}."


def _rms_of(errors: Sequence[Array], unit: float) -> str:
    return significant(rms_norm(np.concatenate(errors)) * unit)


def _tiles(data: RunData, tcp: TcpView) -> tuple[Tile, ...]:
    result, estimates = data.identification, [fitted.estimate for fitted in data.recordings]
    both = [e.before for e in estimates], [e.after for e in estimates]
    position = [_rms_of([r.position for r in residuals], UM) for residuals in both]
    angle = [_rms_of([r.angle for r in residuals], URAD) for residuals in both]
    sensed = result.robot.cell.ballbar.stroke is not None
    equations = max(estimate.whitened.shape[0] for estimate in estimates)
    equations_text = f"{equations} equation{'s' * (equations > 1)} each"
    samples = " + ".join(str(estimate.samples) for estimate in estimates)
    poor = "" if result.fit.converged else ", not converged"
    return (
        _tcp_tile(tcp),
        _clock_tile(data),
        Tile(
            "Residual rms, before → after",
            f"{' → '.join(position)} µm",
            "of the length" if sensed else f"angle {' → '.join(angle)} µrad",
        ),
        Tile("Iterations", f"{result.fit.iterations}", f"from the automatic start{poor}"),
        Tile("Samples", samples, f"{equations_text}, {_unknowns(result)}"),
    )


def _truth_tile(comparison: Comparison) -> Tile:
    tcp, before = comparison.tcp, comparison.tcp_nominal
    note = f"mean; largest {tcp.maximum * MM:.3f} mm; nominal robot {before.mean * MM:.3f} mm"
    return Tile("TCP error against the truth", f"{tcp.mean * MM:.3f} mm", note)


def _pose_tiles(result: TableEstimate, comparison: Comparison | None) -> tuple[Tile, ...]:
    validation, fit = result.cross_validation, result.fit
    orders = result.search.orders if result.search else ()
    fitted, nominal = result.residual_means
    return (
        *([] if comparison is None else [_truth_tile(comparison)]),
        Tile(
            "Stated TCP uncertainty",
            f"{result.sigma_at_poses.mean() * MM:.3f} mm",
            "mean at the measured poses; extrapolated over the whole ranges "
            f"{result.tcp_sigma.mean() * MM:.3f} mm",
        ),
        Tile(
            "Error where it was not fitted",
            f"{validation.mean * MM:.3f} mm",
            f"mean; 95 % below {validation.quantile * MM:.3f} mm",
        ),
        Tile("Nominal robot", f"{nominal * MM:.3f} mm", "mean, seats and targets fitted"),
        Tile("Fitted poses", f"{fitted * MM:.3f} mm", f"mean of {validation.counting.sum()}"),
        Tile("Joint errors", str(len(orders)), "orders found by evidence"),
        Tile("Unknowns", str(fit.model.unknowns.count), f"{fit.iterations} iterations"),
    )


def _unknowns(result: Identification) -> str:
    coefficients = sum(len(c.coefficients) for c in result.robot.corrections)
    if not coefficients:
        return f"{result.fit.unknowns} unknowns"
    return f"{parameter_count(result)} parameters, {coefficients} coefficients"


def _tcp_tile(tcp: TcpView) -> Tile:
    before, after = (significant(values.mean() * MM) for values in (tcp.before, tcp.after))
    poses = f"mean of {tcp.before.size} poses"
    without = millimetres(tcp.stated_without_scale.mean())
    if not tcp.against_truth:
        note = f"1 sigma, {poses}, with scale; {without} without; correction made {before} mm"
        return Tile("Stated TCP uncertainty", f"{after} mm", note)
    stated = f"stated {millimetres(tcp.stated.mean())} with scale, {without} without (1 sigma)"
    note = f"{poses}, against the truth; {stated}"
    return Tile("TCP error, before → after", f"{before} → {after} mm", note)


def _clock_tile(data: RunData) -> Tile:
    estimates = [fitted.estimate for fitted in data.recordings]
    if data.several:
        clocks = [estimate.clock for estimate in estimates]
        largest = max(estimate.clock_sigma[0] for estimate in estimates)
        offsets = ", ".join(
            f"{clock.offset * MS:.3f}" if estimate.clock_sigma[0] <= UNSEEN_OFFSET else MISSING
            for clock, estimate in zip(clocks, estimates, strict=True)
            if clock is not None
        )
        if offsets:
            most = duration_text(largest).replace("us", "µs")
            note = f"one for each recording, ± {most} or less (1 sigma)"
            return Tile("Clock offsets", f"{offsets} ms", note)
    elif rows := clock_rows(estimates[0], data.comparison):
        offset, skew = rows
        note = f"± {offset.sigma}; skew {skew.value} ± {skew.sigma} (1 sigma)"
        return Tile("Clock offset", offset.value, note)
    return Tile("Clock", "one log", "no encoders, so there is no second clock")
