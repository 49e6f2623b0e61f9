"""The report: verdict first, the numbers of the result, no request to the network.

What the recordings share stands once, what belongs to a recording once for each.
"""

from __future__ import annotations

import hashlib
import io
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from rich.console import Console

from ballbar.cell.clock import Clock
from ballbar.cell.geometry import robot_frames
from ballbar.cell.number_text import NOT_DETERMINED
from ballbar.figure_style import BEFORE
from ballbar.ident.result import NamedCovariance, RecordingEstimate
from ballbar.ident.robot.accuracy import accuracy_grid
from ballbar.ident.robot.tcp_correction import correction_parts
from ballbar.ident.verdict import Status, Verdict
from ballbar.replay.write import replay_notes
from ballbar.report import page as report_page
from ballbar.report import tcp_view
from ballbar.report.cell_picture import cell_picture
from ballbar.report.maps import EQUATOR, correlation_map, equal_area, tool_directions
from ballbar.report.numbers import MISSING, fixed, significant, to_sigma, with_and_without
from ballbar.report.page import write_report
from ballbar.report.provenance import without_folders
from ballbar.report.recording_text import clock_rows
from ballbar.report.shapes import PAINT, PLATE_BLUE
from ballbar.report.terminal import _clock, say_identification
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.result.write_calibration import calibration_of
from ballbar.truth.limits import Limit
from tests.helpers.identified_run import SCENARIO, simulated_run
from tests.helpers.page_cells import Cells
from tests.helpers.six_axes import INDEX, PARAMETERS

TEMPLATES = Path(report_page.__file__).parent / "templates"
COMMAND = "ballbar run scenarios/irb2400.yaml"


def _with(data: RunData, **changes: object) -> RunData:
    """The run with fields of its recording changed."""
    (fitted,) = data.recordings
    return replace(data, recordings=(replace(fitted, **changes),))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    run = simulated_run(tmp_path_factory.mktemp("five"), fitted=(1, 2, 3, 4, 5))
    return replace(run, limits=())


@pytest.fixture(scope="module")
def sensorless(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    return simulated_run(tmp_path_factory.mktemp("none"), fitted=())


@pytest.fixture(scope="module")
def page(run: RunData, tmp_path_factory: pytest.TempPathFactory) -> str:
    return _page(run, tmp_path_factory.mktemp("page"))


def _page(data: RunData, folder_of_page: Path, *, command: str = COMMAND) -> str:
    path = folder_of_page / "report.html"
    write_report(path, data, command=command)
    return path.read_text(encoding="utf-8")


class _Page(Cells):
    """Rows of every table as text cells, all attributes, all tags, all text."""

    def __init__(self, page: str) -> None:
        self.attributes: list[tuple[str, str]] = []
        self.tags: list[str] = []
        self.text = ""
        super().__init__(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        super().handle_starttag(tag, attrs)

    def handle_data(self, data: str) -> None:
        self.text += data
        super().handle_data(data)


def _number(text: str) -> float:
    return float(text.replace("\u2212", "-").split(maxsplit=1)[0])


def _half_digit(text: str) -> float:
    """Half a unit of the last digit shown: what rounding may change."""
    decimals = len(text.split(maxsplit=1)[0].partition(".")[2])
    return 0.5001 * 10.0**-decimals


def _shows(text: str, value: float) -> bool:
    return abs(_number(text) - value) <= _half_digit(text)


def test_every_identified_parameter_stands_in_the_table_with_the_numbers_of_the_result(
    run: RunData, page: str
) -> None:
    result, comparison, parsed = run.identification, run.comparison, _Page(page)
    geometry, nominal_values = run.recordings[0].estimate.geometry, result.recordings[0].nominal
    assert comparison is not None
    for name, sigma in result.sigma.items():
        _, nominal, identified, deviation, shown_sigma, significance, true_deviation, error, z = (
            parsed.row(name)
        )
        to_shown = 1e3 if PARAMETERS[INDEX[name]].is_length else 180.0 / np.pi
        assert _shows(identified, geometry[name] * to_shown), name
        assert _shows(shown_sigma, sigma * 1e6), name
        assert _shows(error, comparison.deviations[name] * 1e6), name
        assert _shows(z, comparison.deviations[name] / sigma), name
        if nominal != MISSING:
            off = geometry[name] - nominal_values[name]
            assert _shows(nominal, nominal_values[name] * to_shown), name
            assert _shows(deviation, off * 1e3), name
            assert _shows(significance, abs(off) / sigma), name
            assert _shows(true_deviation, (off - comparison.deviations[name]) * 1e3), name


def test_digits_reach_the_sigma_and_what_has_no_catalogue_value_or_stays_at_it_is_named(
    run: RunData, page: str
) -> None:
    parsed, result = _Page(page), run.identification
    for name in ("ra1", "rd6", "ox"):
        step_mm = 2.0 * _half_digit(parsed.row(name)[2])
        assert 0.01 * result.sigma[name] * 1e3 <= step_mm <= 1.001 * result.sigma[name] * 1e3, name
    for name in ("btheta1", "btheta5", "ox", "oz"):
        assert parsed.row(name)[1] == parsed.row(name)[3] == MISSING
    dropped = result.robot.dropped
    assert {one.name for one in dropped} >= {"rd1", "rd3", "rtheta1"}  # thesis sec. 3.2
    for one in dropped:
        assert one.reason == "prior" or f"{one.name}, kept at" in parsed.text
    assert "in this run a change of it looks exactly like a change of rd2" in parsed.text


def test_key_figures_are_those_of_the_comparison(run: RunData, page: str) -> None:
    comparison, clock = run.comparison, run.recordings[0].estimate.clock
    assert comparison is not None
    assert clock is not None
    assert (
        f"{significant(comparison.tcp_nominal.mean * 1e3)} → "
        f"{significant(comparison.tcp.mean * 1e3)} mm" in page
    )
    parsed = _Page(page)
    assert _shows(parsed.row("offset")[1], clock.offset * 1e3)
    assert _shows(parsed.row("skew")[1], clock.skew * 1e6)
    _, mean, _, largest, scale_free = parsed.row("after (identified)")
    assert _shows(mean, comparison.tcp.mean * 1e3)
    assert _shows(largest, comparison.tcp.maximum * 1e3)
    assert _shows(scale_free, comparison.tcp.error_without_scale.mean() * 1e3)


def test_noise_and_import_findings_are_those_of_the_logs(run: RunData, page: str) -> None:
    parsed, (fitted,) = _Page(page), run.recordings
    noise, report = fitted.estimate.noise, fitted.recording.report
    assert _shows(parsed.row("robot joint 3")[1], noise.joint[2] * 1e6)
    assert _shows(parsed.row("encoder b4")[1], noise.encoder[3] * 1e6)
    assert _shows(parsed.row("encoder b4")[2], 2.0 * np.pi / (3600 * 4096) * 1e6)
    assert report.findings, "overruns were simulated"
    for finding in report.findings:
        assert finding.sentence in parsed.text
    for file in report.files:
        assert any(
            row[0] == file.file and row[-2:] == [str(file.rows_kept), str(file.rows_read)]
            for row in parsed.rows
            if row
        )


def test_the_page_is_small_requests_nothing_and_runs_its_own_script_alone(page: str) -> None:
    parsed = _Page(page)
    assert len(page.encode()) < 6e6
    script = (TEMPLATES / "hover.js").read_text()
    assert page.count("<script") == 1
    assert f"<script>\n{script.strip()}</script>" in page  # nothing of a recording is in it
    assert not set(re.findall(r"fetch|XMLHttp|WebSocket|import|eval|innerHTML", script))
    assert not {"link", "iframe", "object", "embed", "base"} & set(parsed.tags)
    loading = [
        (name, value)
        for name, value in parsed.attributes
        if name in ("src", "href", "xlink:href", "srcset", "action", "poster", "data")
    ]
    assert loading
    targets = [value for _, value in loading] + re.findall(r"url\(([^)]*)\)", page)
    assert all(target.startswith("#") for target in targets)
    names = {value for name, value in parsed.attributes if name == "id"}
    assert {target[1:] for target in targets} <= names
    assert "@import" not in page
    assert "http" not in page
    assert not [name for name, _ in parsed.attributes if name.startswith("on")]


def test_the_cell_is_painted_with_robot_plate_and_path(run: RunData) -> None:
    element = cell_picture(run.identification.robot.cell, run.recordings[0])
    box = re.match(r'<svg viewBox="0 0 (\S+) (\S+)"', element)
    assert box is not None
    width, height = map(float, box.groups())
    paint, plate = (np.array(c, dtype=float) for c in (PAINT, PLATE_BLUE))
    areas = {"robot": 0.0, "plate": 0.0, "all": 0.0}
    for outline, fill in re.findall(r'<path d="([^"]*)" fill="#(\w{6})"', element):
        colour = np.array(list(bytes.fromhex(fill)), dtype=float)
        for face in outline.rstrip("Z").split("Z"):
            corners = np.array([v.split() for v in face.removeprefix("M").split("L")], dtype=float)
            assert ((corners >= 0.0) & (corners <= (width, height))).all(), "all of it is seen"
            x, y = corners.T
            area = 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
            areas["all"] += area
            for name, paint_of in (("robot", paint), ("plate", plate)):
                likeness = colour @ paint_of / np.linalg.norm(colour) / np.linalg.norm(paint_of)
                areas[name] += area * (likeness > 0.999)
    assert areas["robot"] > 0.3 * areas["all"], "the robot is the largest body"
    assert areas["plate"] > 0.005 * areas["all"]
    assert 0.1 < areas["all"] / (width * height) < 0.6, "the cell fills its picture"
    assert f'stroke="{BEFORE}"' in element, "the path of the tool"


def test_hostile_text_is_shown_and_not_obeyed(run: RunData, tmp_path: Path) -> None:
    evil = '<script>alert("1")</script><img src=x onerror=alert(1)>'
    recording = run.recordings[0].recording
    report = replace(
        recording.report,
        findings=(replace(recording.report.findings[0], sentence=evil, file=evil, kind=evil),),
    )
    hostile = replace(
        recording,
        description=recording.description.model_copy(update={"notes": evil}),
        report=report,
    )
    verdict = replace(run.identification.verdict, warnings=(f"`{evil}`", "it stands."))
    result = replace(run.identification, verdict=verdict)
    data = replace(_with(run, recording=hostile), name=evil, identification=result)
    page = _page(data, tmp_path, command=f"ballbar run {evil}")
    parsed = _Page(page)
    assert "<code>&lt;script&gt;" in page, "what stands between backticks is code"
    assert "<li>It stands.</li>" in page
    assert "img" not in parsed.tags
    assert parsed.tags.count("script") == 1
    assert parsed.text.count("onerror=alert(1)") >= 6


def test_same_inputs_give_the_same_bytes_but_for_the_line_with_the_time(
    run: RunData, page: str, tmp_path: Path
) -> None:
    first = page.splitlines()
    second = _page(run, tmp_path).splitlines()
    stamp = re.compile(r'<p class="written">Written \d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC\.</p>')
    assert len([line for line in first if stamp.fullmatch(line)]) == 1
    assert [line for line in first if not stamp.fullmatch(line)] == [
        line for line in second if not stamp.fullmatch(line)
    ]


def test_without_truth_the_page_states_the_uncertainty_and_claims_no_error(
    run: RunData, tmp_path: Path
) -> None:
    data = replace(run, simulation=None, comparison=None)
    parsed = _Page(_page(data, tmp_path))
    assert "Stated TCP uncertainty" in parsed.text
    assert f"{significant(data.identification.robot.tcp_sigma.mean() * 1e3)} mm" in parsed.text
    assert "true deviation" not in parsed.text
    assert "The true robot is not known here" in parsed.text
    assert len(parsed.row("ra1")) == 6
    assert "mujoco" not in parsed.text


def test_a_ball_bar_without_encoders_has_one_log_and_no_clock(
    sensorless: RunData, tmp_path: Path
) -> None:
    parsed = _Page(_page(sensorless, tmp_path))
    assert "there is one log, and no second clock to align" in parsed.text
    assert "time on the robot clock [s]" in parsed.text
    assert "raw/ballbar.csv" not in parsed.text
    assert "encoder b1" not in parsed.text
    assert _shows(parsed.row("ra1")[2], sensorless.identification.robot.geometry["ra1"] * 1e3)


@pytest.mark.parametrize(
    ("status", "band", "heading"),
    [
        (Status.GOOD, "verdict good", "Acceptable"),
        (Status.SUSPECT, "verdict care", "Acceptable, with care"),
        (Status.MISFIT, "verdict bad", "Not acceptable"),
    ],
)
def test_the_band_takes_colour_and_word_from_the_verdict(
    run: RunData, tmp_path: Path, status: Status, band: str, heading: str
) -> None:
    result = replace(
        run.identification, verdict=Verdict(status, "What the fit says.", ("one remark",))
    )
    page = _page(replace(run, identification=result), tmp_path)
    assert f'class="{band}"' in page
    assert f'<p class="heading">{heading}</p>\n<p class="sentence">What the fit says.</p>' in page
    assert "<li>One remark.</li>" in page
    assert ("Do not use these parameters" in page) == (not result.verdict.acceptable)


def test_rivals_of_the_clock_alignment_are_listed(run: RunData, tmp_path: Path) -> None:
    estimate = run.recordings[0].estimate
    assert "cost per residual" not in _page(run, tmp_path)
    start = replace(estimate.start, rivals=(estimate.start.chosen,), tried=5)
    parsed = _Page(_page(_with(run, estimate=replace(estimate, start=start)), tmp_path))
    assert "The automatic start tried 5 hypotheses" in parsed.text
    assert parsed.row("rival")[1:] == parsed.row("chosen")[1:]
    assert _shows(parsed.row("rival")[1], start.chosen.fit.clock().offset)


@pytest.mark.parametrize(("sigma", "determined"), [((0.21, 5e-3), False), ((1e-5, 1e-7), True)])
def test_a_clock_that_is_not_determined_has_no_value(
    sigma: tuple[float, float], determined: bool
) -> None:
    estimate = cast(
        "RecordingEstimate", SimpleNamespace(clock=Clock(0.0123, 2e-5), clock_sigma=sigma)
    )
    rows = clock_rows(estimate, None)
    assert [row.value == NOT_DETERMINED for row in rows] == [not determined] * 2
    assert rows[0].sigma == ("10 \u00b5s" if determined else "210 ms")
    out = Console(record=True, width=200)
    _clock(out, cast("FittedRecording", SimpleNamespace(estimate=estimate)), "clock")
    text = out.export_text()
    assert ("offset not determined (sigma 210 ms)" in text) == (not determined)
    assert ("offset +12.3000 ms (sigma 10 us)" in text) == determined


def test_input_files_stand_with_their_hashes_relative_to_the_recording(
    run: RunData, page: str
) -> None:
    parsed, folder = _Page(page), run.folder
    for name in ("recording.yaml", "raw/robot.csv", "raw/ballbar.csv"):
        content = (folder / name).read_bytes()
        (row,) = [
            row
            for row in parsed.rows
            if row and row[0] == name and row[-1] == hashlib.sha256(content).hexdigest()
        ]
        assert row[1] == str(len(content))
    assert str(folder) not in page
    assert str(folder.parent) not in page


def test_the_map_of_the_sphere_keeps_areas_poles_and_directions() -> None:
    rng = np.random.default_rng(1)
    z, turn = rng.uniform(-1.0, 1.0, 20_000), rng.uniform(-np.pi, np.pi, 20_000)
    flat = np.sqrt(1.0 - z * z)  # uniform over the sphere
    place = equal_area(np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1))
    reach = np.hypot(*place.T)
    for radius in (0.5, 1.0, EQUATOR, 1.8):  # share of points is that of area, in four deviations
        assert abs((reach < radius).mean() - radius**2 / 4.0) < 4.0 * np.sqrt(0.25 / z.size), radius
    assert np.allclose(
        equal_area(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
        [[0, 0], [EQUATOR, 0], [0, -EQUATOR]],
    )


def test_the_directions_on_the_sphere_are_those_of_the_true_rod(run: RunData) -> None:
    (fitted,), simulation = run.recordings, run.simulation
    estimate, clock = fitted.estimate, fitted.estimate.clock
    assert simulation is not None
    assert clock is not None
    true_time = np.interp(
        clock.robot_time(estimate.after.t),
        simulation.times.robot_stamp - simulation.times.robot_stamp[0],
        simulation.times.robot_true,
    )
    q = simulation.motion.shown_at(true_time)
    rod = robot_frames(simulation.truth.geometry, q).tip.T - simulation.truth.geometry.origin
    rod /= np.linalg.norm(rod, axis=1, keepdims=True)
    # 2 mm of base gauge over a rod of 600 mm
    assert np.abs(tool_directions(fitted) - rod).max() < 5e-3


def test_correlations_are_drawn_for_groups_and_only_while_names_are_readable() -> None:
    names = tuple(f"p{k}" for k in range(41))
    covariance = NamedCovariance(names, np.eye(41), np.eye(41))
    figure = correlation_map(covariance, [("p3", "p5")])
    assert ">p3<" in figure
    assert ">p4<" not in figure
    assert correlation_map(covariance, []) == ""
    assert correlation_map(covariance, [names]) == ""


def test_who_decides_reads_verdict_confidence_and_what_to_do_before_any_number(
    run: RunData, page: str
) -> None:
    sentence = page.index(run.identification.verdict.sentence)
    assert sentence < min(page.index(mark) for mark in ('class="tile"', "<svg", "<table"))
    text, sigma = _Page(page).text, run.identification.robot.tcp_sigma
    mean, worst = (significant(2.0 * size * 1e3) for size in (sigma.mean(), sigma.max()))
    assert f"within {mean} mm of the true tool position at an average pose" in text
    assert f"within {worst} mm at the worst, with 95 % confidence" in text
    assert "What to do. The identified robot may be used" in text


def test_both_meanings_of_the_stated_uncertainty_are_named_wherever_it_stands(
    run: RunData, page: str, tmp_path: Path
) -> None:
    tcp, cell = run.identification.robot.tcp, run.identification.robot.cell
    stated = with_and_without(tcp.sigma, tcp.without_scale, cell)
    with_scale, without = (
        f"{significant(sigma.mean() * 1e3)} mm" for sigma in (tcp.sigma, tcp.without_scale)
    )
    assert stated == f"{with_scale} with the scale of plate and rod, {without} without it"
    assert with_scale != without
    console = Console(record=True, width=500, file=io.StringIO())
    say_identification(console, run)
    assert f"(1 sigma, mean): {stated}" in console.export_text()
    assert stated in replay_notes(run)
    entry = calibration_of(run).fit
    assert entry.tcp_sigma_mean_m == pytest.approx(tcp.sigma.mean())
    assert entry.tcp_sigma_without_scale_mean_m == pytest.approx(tcp.without_scale.mean())
    parsed = _Page(page)
    assert f"stated {with_scale} with scale, {without} without (1 sigma)" in parsed.text
    row = parsed.row("stated sigma")
    assert (f"{row[1]} mm", f"{row[4]} mm") == (with_scale, without)
    unknown = replace(run, simulation=None, comparison=None)
    assert f"what remains is {stated} (1 sigma, mean)" in _Page(_page(unknown, tmp_path)).text


def test_drivers_and_next_steps_stand_in_the_page_with_their_numbers(
    run: RunData, page: str
) -> None:
    parsed, robot = _Page(page), run.identification.robot
    parts = correction_parts(robot, accuracy_grid(robot.cell.robot))
    ranked = [row for row in parsed.rows if row and row[0] == "1"]
    before, after = ranked
    assert before[1] == parts[0].name
    assert _shows(before[3], parts[0].size * 1e3)
    assert _shows(before[5], 100.0 * parts[0].share)
    largest = robot.tcp.directions[0]
    assert after[2].startswith("scale of all lengths")
    assert _shows(after[3], largest.rms * 1e3)
    assert _shows(after[4], 100.0 * robot.tcp.share(largest))
    ranks = [row[0] for row in parsed.rows if len(row) == 7 and row[0].isdigit()]
    assert ranks == list("12345678")
    assert "Most would help next: the rod measured to 5 µm" in parsed.text
    assert parsed.row("the same path once more")[1:]


@pytest.mark.parametrize(
    ("command", "shown"),
    [
        (f"{COMMAND} --seed 2", f"{COMMAND} --seed 2"),
        (
            "/home/me/.venv/bin/ballbar run /home/me/a.yaml --out=/data/run_1",
            "…/ballbar run …/a.yaml --out=…/run_1",
        ),
        (
            "ballbar identify 'C:\\cells\\cell 3' --samples 500",
            'ballbar identify "…/cell 3" --samples 500',
        ),
        ("ballbar run 'unclosed /home/me/a.yaml", "ballbar run 'unclosed …/a.yaml"),
    ],
)
def test_the_command_is_shown_without_folders_of_this_computer(command: str, shown: str) -> None:
    assert without_folders(command) == shown


def test_a_missed_limit_of_the_scenario_stands_in_the_heading_and_its_file_among_the_inputs(
    run: RunData, page: str, tmp_path: Path
) -> None:
    limits = (
        Limit("TCP error, mean", 0.02, 0.01, "mm", met=False),
        Limit("iterations", 4.0, 10.0, "", met=True),
    )
    missed = replace(run, limits=limits, scenario_files=(SCENARIO,))
    parsed = _Page(_page(missed, tmp_path))
    assert "Limits of the scenario missed: TCP error, mean" in parsed.text
    assert "Limits of the scenario missed" not in page
    assert parsed.row("irb2400.yaml")[-1] == hashlib.sha256(SCENARIO.read_bytes()).hexdigest()


def _raise(*_: object, **__: object) -> str:
    raise RuntimeError("no figure today")


def test_a_failure_leaves_no_half_written_page_and_the_old_one_untouched(
    run: RunData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "report.html"
    path.write_text("the report of yesterday")
    monkeypatch.setattr(tcp_view, "cumulative", _raise)
    with pytest.raises(RuntimeError, match="no figure today"):
        write_report(path, run, command=COMMAND)
    assert [p.read_text() for p in tmp_path.iterdir()] == ["the report of yesterday"]


def test_an_input_that_vanished_is_an_error_not_a_gap(run: RunData, tmp_path: Path) -> None:
    gone = replace(run.recordings[0].recording, folder=tmp_path / "gone")
    with pytest.raises(FileNotFoundError, match=r"recording\.yaml"):
        _page(_with(run, recording=gone), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        (lambda: significant(2714.2), "2714"),
        (lambda: significant(0.00157812), "0.00158"),
        (lambda: significant(9.996), "10.0"),
        (lambda: significant(-0.0274, 2, sign=True), "\u22120.027"),
        (lambda: significant(float("nan")), MISSING),
        (lambda: significant(0.0), "0"),
        (lambda: significant(-2.4e-13, 2), "0"),
        (lambda: fixed(-0.00004, 3, sign=True), "0.000"),
        (lambda: fixed(1.25, 1, sign=True), "+1.2"),
        (lambda: fixed(None, 2), MISSING),
        (lambda: to_sigma(137.001536, 0.000704), "137.00154"),
        (lambda: to_sigma(1.0, 0.0), "1.000"),
        (lambda: to_sigma(-12.3, 45.0), "\u221212"),
    ],
)
def test_numbers_carry_sensible_digits(shown: Callable[[], str], expected: str) -> None:
    assert shown() == expected
