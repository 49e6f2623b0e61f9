"""`ballbar certificate`: what it prints and leaves missing, and every change that a check finds."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, get_args
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.certificate import check
from ballbar.certificate.check import certificate_file, check_certificate, content_of
from ballbar.certificate.conformity import Tolerance, decide
from ballbar.certificate.content import Content, canonical, certificate_content
from ballbar.certificate.details import TEMPLATE, RobotDetails, StandardDetails, load_details
from ballbar.certificate.html import document
from ballbar.certificate.words import LOCALES, Words, table
from ballbar.ident.corrections import OF_MACHINE, OF_RECORDINGS
from ballbar.ident.robot.budget import SOURCES, Distribution
from ballbar.ident.verdict import Status
from ballbar.result.calibration_schema import POSE_CORRECTIONS
from ballbar.result.identify import identified
from tests.helpers.command_line import ballbar, output, refusal
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.tracker_points import still_points

JOB = """\
schema: ballbar-certificate-details/1
recordings: [logs]
identify: {model: dh, samples: 300}
number: 2026-014
robot: {maker: ABB, type: IRB 2400, serial_number: 24-60311}
operator: Jörgen Åström
place: Göteborg
temperature_C: 21.4
load_kg: 6.5
tolerance: {mean_mm: 0.5, largest_mm: 12}
"""


@pytest.fixture(scope="module")
def certified(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, its result, details, and both certificates in German."""
    folder = tmp_path_factory.mktemp("certified")
    shutil.copytree(recorded.folder, folder / "logs")
    options = "--model", "dh", "--samples", 300
    output("identify", folder / "logs", "--out", folder / "result", *options)
    (folder / "job.yaml").write_text(JOB, "utf-8")
    job = folder / "job.yaml"
    said = output("certificate", folder / "result", "--details", job, "--locale", "de")
    assert "nominal robot, mean TCP error against 0.5 mm: does not conform" in said
    assert "identified robot, mean TCP error against 0.5 mm: conforms" in said
    return folder


@pytest.fixture
def copy(certified: Path, tmp_path: Path) -> Path:
    """The same folder elsewhere, to be changed."""
    return shutil.copytree(certified, tmp_path / "elsewhere")


@pytest.fixture(scope="module")
def recomputed(certified: Path) -> Content:
    """The content that the unchanged inputs give."""
    content, _ = content_of(certified / "certificate.html")
    base = certified / content["base"]
    paths = base / content["result_file"], base / content["details_file"]
    return certificate_content(*paths, base=base, locale=content["locale"])[0]


@pytest.fixture
def recomputed_once(
    recomputed: Content, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A check knows what the unchanged inputs give; it asks only where they are unchanged.

    Nor is a content printed again: what is printed depends on nothing but the content.
    """
    if request.node.callspec.params.get("change") not in RECOMPUTED:
        monkeypatch.setattr(check, "certificate_file", printed_once)
        monkeypatch.setattr(
            check, "certificate_content", lambda *_, **__: (deepcopy(recomputed), None)
        )


PRINTED: dict[tuple[bytes, str], bytes] = {}


def printed_once(content: Content, kind: str) -> bytes:
    """The file of a content."""
    key = canonical(content), kind
    if key not in PRINTED:
        PRINTED[key] = certificate_file(content, kind)
    return PRINTED[key]


KINDS = ("certificate.html", "certificate.pdf")
RECOMPUTED = ("other result", "forged value")  # changes that are checked with another computation


def test_an_unchanged_certificate_holds_in_another_folder(copy: Path) -> None:
    assert check_certificate(copy / "certificate.pdf") == []


@pytest.mark.parametrize("name", KINDS)
def test_what_the_inputs_give_again_is_what_is_certified(
    copy: Path, recomputed_once: None, name: str
) -> None:
    assert check_certificate(copy / name) == []


@pytest.mark.slow
def test_it_holds_on_a_computer_that_rounds_otherwise(copy: Path) -> None:
    """OpenBLAS takes the routines of another processor, whose sums differ in the last bits."""
    environment = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}
    words = "-m", "ballbar", "certificate", "--check", str(copy / "certificate.pdf")
    done = subprocess.run(
        [sys.executable, *words], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_inputs_may_lie_elsewhere(copy: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone" / "certificate.pdf"
    alone.parent.mkdir()
    (copy / "certificate.pdf").rename(alone)
    code, said, _ = ballbar("certificate", "--check", alone)
    assert (code, "name the folder of the inputs with --inputs" in said) == (1, True)
    said = output("certificate", "--check", alone, "--inputs", copy)
    assert said.startswith("holds:")


def edited(name: str, old: str, new: str) -> Callable[[Path, Path], None]:
    """A single change of an input file."""

    def change(folder: Path, certificate: Path) -> None:
        text = (folder / name).read_text("utf-8")
        assert re.search(old, text), name
        (folder / name).write_text(re.sub(old, new, text, count=1), "utf-8")

    return change


def another_digit(name: str, row: int) -> Callable[[Path, Path], None]:
    """The last digit of a row of a log is another one."""

    def change(folder: Path, certificate: Path) -> None:
        lines = (folder / name).read_text("utf-8").splitlines(keepends=True)
        at = max(k for k, c in enumerate(lines[row]) if c.isdigit())
        lines[row] = f"{lines[row][:at]}{(int(lines[row][at]) + 1) % 10}{lines[row][at + 1 :]}"
        (folder / name).write_text("".join(lines), "utf-8")

    return change


def lost_row(folder: Path, certificate: Path) -> None:
    file = folder / "logs" / "raw" / "ballbar.csv"
    lines = file.read_text("utf-8").splitlines(keepends=True)
    file.write_text("".join(lines[:500] + lines[501:]), "utf-8")


def lost_file(folder: Path, certificate: Path) -> None:
    (folder / "logs" / "raw" / "ballbar.csv").unlink()


def printed(old: str, new: str) -> Callable[[Path, Path], None]:
    """A single change of the text that a reader sees, at its first place."""

    def change(folder: Path, certificate: Path) -> None:
        raw = certificate.read_bytes()
        at = raw.index(old.encode())
        assert len(old) == len(new)
        certificate.write_bytes(raw[:at] + new.encode() + raw[at + len(old) :])

    return change


def forged(change: Callable[[dict[str, Any]], object]) -> Callable[[Path, Path], None]:
    """A change of the content, printed as the program would print it."""

    def make(folder: Path, certificate: Path) -> None:
        content, _ = content_of(certificate)
        before = json.dumps(content)
        change(content)
        assert json.dumps(content) != before
        certificate.write_bytes(printed_once(content, certificate.suffix))

    return make


def in_content(old: bytes, new: bytes) -> Callable[[Path, Path], None]:
    """A change of the embedded content alone."""

    def change(folder: Path, certificate: Path) -> None:
        raw = certificate.read_bytes()
        assert raw.count(old)
        certificate.write_bytes(raw.replace(old, new, 1))

    return change


def covered(folder: Path, certificate: Path) -> None:
    """An update at the end that puts another page over the first one, as editors write it."""
    page = b"<< /Type /Page /Parent 1 0 R /Contents 90 0 R >>"
    stream = b"<< /Length 0 >>\nstream\n\nendstream"
    update = b"3 0 obj\n%b\nendobj\n90 0 obj\n%b\nendobj\n%%%%EOF\n" % (page, stream)
    certificate.write_bytes(certificate.read_bytes() + update)


def swapped(folder: Path, certificate: Path) -> None:
    """Two logs change their names."""
    raw = folder / "logs" / "raw"
    (raw / "robot.csv").rename(raw / "other.csv")
    (raw / "ballbar.csv").rename(raw / "robot.csv")
    (raw / "other.csv").rename(raw / "ballbar.csv")


def unprintable(change: Callable[[dict[str, Any]], object]) -> Callable[[Path, Path], None]:
    """A change of the content, of which the program would print nothing."""

    def make(folder: Path, certificate: Path) -> None:
        content, raw = content_of(certificate)
        before = canonical(content)
        change(content)
        at = raw.index(before[:40])
        certificate.write_bytes(raw[:at] + canonical(content) + raw[at + len(before) :])

    return make


def appended(folder: Path, certificate: Path) -> None:
    certificate.write_bytes(certificate.read_bytes() + b"\n")


CHANGES = {
    "digit of the robot's log": another_digit("logs/raw/robot.csv", 2000),
    "digit of the ball-bar's log": another_digit("logs/raw/ballbar.csv", 2000),
    "row of a log lost": lost_row,
    "log lost": lost_file,
    "direction of an encoder": edited("logs/recording.yaml", r"sign: -1", "sign: 1"),
    "notes of the recording": edited("logs/recording.yaml", r"notes: ''", "notes: 'x'"),
    "serial number": edited("job.yaml", "24-60311", "24-60312"),
    "tolerance": edited("job.yaml", "mean_mm: 0.5", "mean_mm: 0.6"),
    "identified value": edited("result/calibration.yaml", r"(value: 0\.\d*)\d\n", r"\g<1>0\n"),
    "stated sigma": edited("result/calibration.yaml", r"sigma: \d", "sigma: 0"),
    "status of the fit": edited("result/calibration.yaml", "status: good", "status: suspect"),
    "printed name": printed("rgen", "rgem"),
    "printed number": printed("2026-014", "2026-015"),
    "printed statement": printed("nicht konform", "doch! konform"),
    "printed word": printed("Messdatum", "Messdatun"),
    "embedded digit": in_content(b'"samples": 3', b'"samples": 4'),
    "byte appended": appended,
    "forged value": forged(lambda c: c["errors"][0].update(value=0.4e-3)),
    "forged statement": forged(lambda c: c["errors"][0].update(verdict="conforms")),
    "forged uncertainty": forged(lambda c: c["errors"][2].update(sigma=1e-6)),
    "forged operator": forged(lambda c: c["details"].update(operator="Somebody Else")),
    "forged digest": forged(lambda c: c["files"][3].update(sha256="0" * 64)),
    "page covered": covered,
    "logs swapped": swapped,
    "line ends of the details": edited("job.yaml", "\n", "\r\n"),
    "added key": forged(lambda c: c["result"].update(approved=True)),
    "added file": forged(lambda c: c["files"].append(c["files"][0])),
    "order of the files": forged(lambda c: c["files"].reverse()),
    "forged program and value": forged(
        lambda c: c.update(program="0.2.0+0") or c["errors"][0].update(value=0.4e-3)
    ),
    "other result": forged(lambda c: c.update(result_file="job.yaml")),
    "folder lost": unprintable(lambda c: c.pop("base")),
    "no files": unprintable(lambda c: c.update(files=None)),
    "name that is none": unprintable(lambda c: c["files"][0].update(name="a\0b")),
    "name of a device": forged(lambda c: c["files"][0].update(name="/dev/zero")),
    "unknown language": unprintable(lambda c: c.update(locale="fr")),
    "unknown statement": unprintable(lambda c: c["errors"][0].update(verdict="perfect")),
    "letter of no font": unprintable(lambda c: c["details"].update(operator="Łukasz")),
    "forged temperature": forged(lambda c: c["measurement"].update(temperature_C=20.0)),
}


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("change", CHANGES)
def test_a_single_change_is_found(
    copy: Path, recomputed_once: None, name: str, change: str
) -> None:
    CHANGES[change](copy, copy / name)
    code, said, _ = ballbar("certificate", "--check", copy / name)
    assert (code, "does not hold" in said) == (1, True), said


@pytest.mark.parametrize("name", KINDS)
def test_links_and_names_are_no_change(
    copy: Path, recomputed_once: None, tmp_path: Path, name: str
) -> None:
    """A recording may lie behind a link, and a certificate have another name."""
    (tmp_path / "archive").mkdir()
    (copy / "logs").rename(tmp_path / "archive" / "logs")
    (copy / "logs").symlink_to(tmp_path / "archive" / "logs")
    renamed = copy / f"2026-014{Path(name).suffix.upper()}"
    (copy / name).rename(renamed)
    assert check_certificate(renamed) == []
    (tmp_path / name).symlink_to(renamed)
    assert check_certificate(tmp_path / name) == []


def test_another_program_says_which_one_printed_the_text(copy: Path) -> None:
    """Files and numbers hold, and the text is judged by the program that printed it alone."""
    file = copy / "certificate.html"
    forged(lambda c: c.update(program="0.2.0+0123abcd"))(copy, file)
    said = output("certificate", "--check", file)
    assert re.search(r"holds: .*names the program 0.2.0\+0123abcd; this is 0", said, re.DOTALL)
    file.write_bytes(file.read_bytes().replace(b"</h1>", b" </h1>"))
    (problem,) = check_certificate(file)
    assert problem.endswith("check it with 0.2.0+0123abcd")


def test_certificates_of_other_shapes_are_refused(copy: Path) -> None:
    nested = b'<script type="application/json" id="content">{"a":' + 100_000 * b"[" + b"</script>"
    (copy / "nested.html").write_bytes(nested)
    lines = (copy / "certificate.pdf").read_bytes().replace(b"\n", b"\r\n")
    (copy / "lines.pdf").write_bytes(lines)
    for name in ("nested.html", "lines.pdf"):
        assert "so it does not hold" in refusal("certificate", "--check", copy / name)


def test_a_file_without_content_is_refused(copy: Path) -> None:
    (copy / "other.pdf").write_bytes(b"%PDF-1.7\n")
    assert "holds no content of a certificate" in refusal(
        "certificate", "--check", copy / "other.pdf"
    )
    assert "They end in .html or .pdf" in refusal("certificate", "--check", copy / "job.yaml")


def test_no_certificate_of_a_result_that_does_not_follow_from_its_recording(copy: Path) -> None:
    file = copy / "result" / "calibration.yaml"
    text = file.read_text("utf-8")
    changed = re.sub(r"(ra2:\n +nominal: \S+\n +value: 0\.70)", r"\g<1>1", text)
    assert changed != text
    file.write_text(changed, "utf-8")
    said = refusal(
        "certificate", copy / "result", "--details", copy / "job.yaml", "--out", copy / "new"
    )
    assert "does not follow from" in said
    assert "puts the TCP up to" in said
    assert not (copy / "new").exists()


def cells_of(content: dict[str, Any]) -> list[list[tuple[str, str]]]:
    """Text and class of each cell of each row that is printed."""
    rows = fromstring(document(content)).iter("tr")
    return [[(cell.text or "", cell.get("class", "")) for cell in row] for row in rows]


def test_what_the_details_leave_out_is_printed_as_missing(certified: Path) -> None:
    content, raw = content_of(certified / "certificate.html")
    pairs = [row for row in cells_of(content) if len(row) == 2]
    missing = [label for (label, _), value in pairs if value == ("fehlt", "missing")]
    assert not {Words("de")(key) for key in ("number", "operator", "place", "load")} & {*missing}
    absent = "customer", "software", "temperature_spread", "remarks"
    assert {Words("de")(key) for key in absent} <= {*missing}
    shown = re.findall(r'<td class="label">([^<]*)</td><td class="missing">', raw.decode())
    assert shown == missing
    assert raw.decode().count('class="missing"') == len(missing)
    pdf = (certified / "certificate.pdf").read_bytes().decode("latin-1")
    assert pdf.count("(fehlt) Tj") == len(missing)


@pytest.mark.parametrize("locale", LOCALES)
def test_no_page_is_half_translated(certified: Path, locale: str) -> None:
    """Beside details, names and numbers a page prints words of its own column alone."""
    content, _ = content_of(certified / "certificate.html")
    content |= {"locale": locale}
    column = LOCALES.index(Words(content["locale"]).locale)
    foreign = {row[k] for row in table().values() for k in range(3) if row[k] != row[column]}
    foreign -= {row[column] for row in table().values()}
    elements = fromstring(document(content)).iter()
    printed = [part for element in elements for part in (element.text or "").split(", ")]
    assert not foreign & set(printed)
    mark = "." if locale == "en" else ","
    assert f"21{mark}4\u00a0°C" in printed


def test_every_word_is_in_three_languages() -> None:
    for key, row in table().items():
        assert len(row) == len(LOCALES), key
        assert all(row), key
        assert len({frozenset(re.findall(r"{\w+}", words)) for words in row}) == 1, key


def test_every_word_is_used() -> None:
    folder = TEMPLATE.parent
    sources = [*folder.glob("*.py"), *folder.glob("templates/*")]
    text = "".join(file.read_text("utf-8") for file in sources)
    values = {*Status, *(f"rule_{rule}" for rule in ("simple", "guarded", "probability"))}
    values |= {*RobotDetails.model_fields, *StandardDetails.model_fields, "nominal", "identified"}
    corrections = {*OF_MACHINE, *OF_RECORDINGS, *POSE_CORRECTIONS}
    sources = {f"budget_{name}" for name in {*SOURCES, *corrections}}
    assert sources <= set(table())
    values |= sources | set(get_args(Distribution))
    unused = [k for k in table() if not re.search(f"[\"']{k}[\"']", text) and k not in values]
    assert not unused


def test_the_template_is_a_file_of_details(tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_text(output("certificate", "--template"), "utf-8")
    details = load_details(tmp_path / "job.yaml")
    assert details.robot is not None
    assert details.robot.maker is None


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("oprator: x", "job.yaml:2: unknown key oprator"),
        ("issued: 26.11.2026", "job.yaml:2: issued"),
        ("tolerance: {rule: guarded}", "states no limit"),
        ("tolerance: {mean_mm: -1}", "job.yaml:2: tolerance.mean_mm"),
        ("tolerance: {mean_mm: 1, rule: generous}", "job.yaml:2: tolerance.rule"),
        ("identify: {cost: length}", "expected one of accuracy_mm"),
    ],
)
def test_wrong_details_are_refused(tmp_path: Path, line: str, message: str) -> None:
    file = tmp_path / "job.yaml"
    file.write_text(f"schema: ballbar-certificate-details/1\n{line}\n")
    with pytest.raises(DescriptionError, match=re.escape(message)):
        load_details(file)


def test_a_recording_that_is_not_there_is_refused(certified: Path, tmp_path: Path) -> None:
    job = tmp_path / "job.yaml"
    job.write_text("schema: ballbar-certificate-details/1\n")
    assert "names no `recordings`" in refusal("certificate", certified / "result", "--details", job)
    job.write_text("schema: ballbar-certificate-details/1\nrecordings: [away]\n")
    assert "no such folder or file" in refusal(
        "certificate", certified / "result", "--details", job
    )


# A normal quantity of 1 mm with u = 0.1 mm, so that U (k = 2) is 0.2 mm.
# Quantiles of 400 000 draws are good to 0.5 um.
NORMAL = 1e-3 + 1e-4 * np.sort(np.random.default_rng(1).standard_normal(400_000))


@pytest.mark.parametrize(
    ("name", "tolerance", "verdict"),
    [
        ("simple", 1.01e-3, "conforms"),
        ("simple", 0.99e-3, "does not conform"),
        ("guarded", 1.21e-3, "conforms"),
        ("guarded", 1.19e-3, "neither"),
        ("guarded", 0.81e-3, "neither"),
        ("guarded", 0.79e-3, "does not conform"),
        ("probability", 1.17e-3, "conforms"),  # 1.645 u above the value: 95 %
        ("probability", 1.16e-3, "neither"),
        ("probability", 0.83e-3, "does not conform"),
    ],
)
def test_each_rule_decides_at_its_limit(name: Any, tolerance: float, verdict: str) -> None:
    decision = decide(NORMAL, tolerance, Tolerance(rule=name))
    assert decision.verdict == verdict
    assert decision.value == pytest.approx(1e-3, abs=1e-6)
    assert (decision.lower, decision.upper) == pytest.approx((0.8e-3, 1.2e-3), abs=2e-6)


def test_the_stated_risks_are_those_of_the_normal_distribution() -> None:
    """Beyond 0, 2 and 1 standard deviations: 50 %, 2.275 % and 15.866 %."""
    assert Tolerance(rule="simple").risk == 0.5
    assert Tolerance().risk == pytest.approx(0.02275, abs=1e-5)
    assert Tolerance(guard_factor=0.5).risk == pytest.approx(0.15866, abs=1e-5)
    assert Tolerance(rule="probability", probability=0.99).risk == pytest.approx(0.01)


def test_a_skewed_quantity_is_guarded_by_its_own_tail() -> None:
    """The size of one normal error: mean 0.798, u 0.603, 2.3 % of it above 2.28."""
    draws = np.abs(np.random.default_rng(2).standard_normal(400_000))
    assert decide(draws, 2.1, Tolerance()).verdict == "neither"
    assert decide(draws, 2.3, Tolerance()).verdict == "conforms"


@pytest.mark.parametrize("still", [False, True])
def test_draws_spread_as_stated(recorded: Recorded, still: bool) -> None:
    """Their mean square over draws and poses is that of the stated TCP uncertainty."""
    simulation = recorded.simulation
    points = still_points(simulation.cell, simulation.truth, 3, 100)
    robot = identified([points if still else recorded.folder]).identification.robot
    grid, errors = robot.identified.error_draws(2000, np.random.default_rng(5))
    stated = robot.identified.sigma(grid)
    drawn = np.sqrt((errors**2).sum(axis=2).mean(axis=0))
    assert drawn == pytest.approx(stated, rel=0.12)  # of 2000 draws; few of them matter
    assert np.sqrt((drawn**2).mean()) == pytest.approx(np.sqrt((stated**2).mean()), rel=0.05)


def test_letters_that_the_fonts_of_pdf_lack_are_refused(certified: Path) -> None:
    content, _ = content_of(certified / "certificate.pdf")
    content["details"]["operator"] = "Łukasz"
    with pytest.raises(InputError, match="U\\+0141"):
        certificate_file(content, ".pdf")
    assert "Łukasz".encode() in certificate_file(content, ".html")


def test_a_line_is_not_wider_than_its_column(certified: Path) -> None:
    """80 letters w, of 0.722 of the font's size by Adobe's metrics, in 29 % of the width."""
    content, _ = content_of(certified / "certificate.pdf")
    content["details"]["operator"] = 80 * "w"
    lines = re.findall(rb"\((w+)\) Tj", certificate_file(content, ".pdf"))
    assert b"".join(lines) == 80 * b"w"
    assert len(lines) > 3
    assert max(map(len, lines)) * 0.722 * 8.5 * 25.4 / 72.0 < 0.29 * 178.0


def test_bytes_behind_the_certificate_are_named_by_their_place(copy: Path) -> None:
    """A change is shown with its neighbours; behind the end there is nothing to compare."""
    file = copy / "certificate.html"
    raw = file.read_bytes()
    file.write_bytes(raw + b"<p>more</p>")
    (problem,) = check_certificate(file)
    assert f"from byte {len(raw)} (" in problem
    assert "<p>more</p>" in problem
    file.write_bytes(raw[:-5])
    (problem,) = check_certificate(file)
    assert f"from byte {len(raw) - 5} (" in problem
    at = raw.index(b"</h1>")
    file.write_bytes(raw[:at] + b" " + raw[at:])
    (problem,) = check_certificate(file)
    assert f"from byte {at} (" in problem
