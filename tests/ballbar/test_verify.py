"""`ballbar verify` of recordings and still poses: a result read back, edited, and its refusals."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from ballbar.cell.errors import DescriptionError
from ballbar.result.calibration import load
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.machine_entries import CovarianceEntry
from ballbar.result.verification import temperature_remarks
from tests.helpers.command_line import ballbar
from tests.helpers.pose_results import write_pose_table
from tests.helpers.simulated_recordings import Recorded
from tests.helpers.tracker_points import still_points


@pytest.fixture(scope="module")
def result(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verified") / "result"
    code, _, error = ballbar(
        "identify", recorded.folder, "--out", folder, "--model", "dh", "--samples", 300
    )
    assert code == 0, error
    return folder


def changed(result: Path, folder: Path, change: Any) -> Path:
    data = yaml.safe_load((result / "calibration.yaml").read_text())
    change(data)
    folder.mkdir()
    (folder / "calibration.yaml").write_text(yaml.safe_dump(data))
    return folder


def test_a_result_holds_for_its_own_recording(result: Path, recorded: Recorded) -> None:
    code, said, error = ballbar("verify", result, recorded.folder)
    assert (code, said.startswith("Holds: the loop closes to 0.0")) == (0, True), said + error


def test_a_zero_that_differs_is_named(result: Path, recorded: Recorded, tmp_path: Path) -> None:
    def before(data: dict[str, Any]) -> None:
        data["parameters"]["rtheta4"]["value"] -= 3.1e-4

    code, said, error = ballbar(
        "verify", changed(result, tmp_path / "before", before), recorded.folder, "--json"
    )
    assert code == 1, error
    data = json.loads(said)
    assert data["sentence"].startswith("Changed since: zero of axis 4 by +0.31 mrad")
    best = data["causes"][0]
    assert (best["kind"], best["axis"], best["named"]) == ("axis", 4, True)
    assert best["size"][0] == pytest.approx(3.1e-4, abs=2e-5)


def test_a_result_without_covariance_is_refused(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    older = changed(result, tmp_path / "older", lambda data: data.pop("covariance"))
    code, _, error = ballbar("verify", older, recorded.folder)
    assert (code, "Identify its recordings again" in error) == (2, True), error


def test_a_recording_on_another_plate_is_refused(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    other = changed(result, tmp_path / "other", lambda data: data.update(plate="plate_150"))
    code, _, error = ballbar("verify", other, recorded.folder)
    assert (code, "is of plate plate_250" in error) == (2, True), error


Data = dict[str, Any]  # of calibration.yaml
COEFFICIENT = {
    "value": 0.0, "sigma": 1e-5, "prior": 0.0, "prior_sigma": 1e-4,
    "information_gain": 0.5, "unit": "rad",
}  # fmt: skip


def rows(data: Data, k: int, text: str) -> None:
    data["covariance"]["lower"][k] = text


def scaled(data: Data, factor: float) -> None:
    """All covariances of the second unknown by a factor, its variance as it was."""
    lower = [row.split() for row in data["covariance"]["lower"]]
    lower[1][0] = repr(factor * float(lower[1][0]))
    for row in lower[2:]:
        row[1] = repr(factor * float(row[1]))
    data["covariance"]["lower"] = [" ".join(row) for row in lower]


def turned(entries: list[Any]) -> None:
    entries[0], entries[1] = entries[1], entries[0]


# What a hand makes of a calibration.yaml, and what is said of it.
EDITED: dict[str, tuple[Callable[[Data], Any], str]] = {
    "parameter missing": (
        lambda d: d["parameters"].pop("rd6"),
        "parameters: without rd6 beside ra6, ralpha6, rbeta6, rtheta6. Add what is missing",
    ),
    "joint too many": (
        lambda d: d["parameters"].update(ra7=d["parameters"]["ra6"].copy()),
        "without rd7, ralpha7, rtheta7 beside ra7. Add what is missing, or remove ra7",
    ),
    "no parameter": (
        lambda d: d["parameters"].update(rx1=d["parameters"]["ra6"].copy()),
        "parameters.rx1: no parameter has this name",
    ),
    "parameter of a recording": (
        lambda d: d["parameters"].update(ox=d["parameters"]["ra6"].copy()),
        "parameters.ox: this parameter does not belong here",
    ),
    "recording without base": (
        lambda d: d["recordings"][0]["parameters"].pop("ox"),
        "recordings[0].parameters: without ox",
    ),
    "other structure": (
        lambda d: d["parameters"].pop("rbeta2"),
        "of 6 joints with rbeta6; robot irb2400 has 6 joints with rbeta2, rbeta6",
    ),
    "encoder unknown": (
        lambda d: d["recordings"][0]["encoder_directions"].update(b9=1),
        "recordings[0].encoder_directions.b9 = 1: expected text of the form ^b[1-5]$",
    ),
    "correction unknown": (
        lambda d: d["corrections"].update(magic={"x": COEFFICIENT.copy()}),
        "corrections.magic: no correction of results, or of a plug-in that is installed. "
        "Valid names: bearing_tilt, ",
    ),
    "coefficient without covariance": (
        lambda d: d["corrections"].update(rod_strain={"strain": COEFFICIENT.copy()}),
        "covariance.names: expected strain as name 22",
    ),
    "ranges too few": (
        lambda d: d["ranges"].pop(),
        "ranges: expected one for each of the 6 joints that `parameters` has, found 5",
    ),
    "range reversed": (
        lambda d: d["ranges"][2].update(lower_rad=2.0, upper_rad=1.0),
        "ranges[2].lower_rad = 2.0: expected at most upper_rad, 1",
    ),
    "names reordered": (
        lambda d: turned(d["covariance"]["names"]),
        "covariance.names[0] = 'ra2': expected ra1 as name 1",
    ),
    "names unknown": (
        lambda d: d["covariance"]["names"].__setitem__(3, "rq9"),
        "covariance.names[3] = 'rq9': expected ra5 as name 4",
    ),
    "name twice": (
        lambda d: d["covariance"]["names"].__setitem__(1, "ra1"),
        "covariance.names[1] = 'ra1': expected ",
    ),
    "held reordered": (
        lambda d: turned(d["covariance"]["held"]),
        "covariance.held[0] = 'ba1': expected ra6 as name 1",
    ),
    "row missing": (
        lambda d: d["covariance"]["lower"].pop(),
        "covariance.lower: expected 36 rows, one for each of names, held and masses, found 35",
    ),
    "text": (
        lambda d: rows(d, 2, "a b c"),
        "covariance.lower[2] = 'a b c': expected numbers, 3 finite ones with spaces between",
    ),
    "not a number": (lambda d: rows(d, 1, "0.0 nan"), "covariance.lower[1] = '0.0 nan': expected"),
    "infinite": (lambda d: rows(d, 1, "0.0 inf"), "covariance.lower[1] = '0.0 inf': expected"),
    "number missing": (lambda d: rows(d, 1, "1.0e-9"), "covariance.lower[1] = '1.0e-9': expected"),
    "row empty": (lambda d: rows(d, 1, ""), "covariance.lower[1] = '': expected numbers, 2"),
    "negative": (
        lambda d: rows(d, 0, "-1.0e-9"),
        "covariance.lower[0] = '-1.0e-9': expected a variance of ra1 above 0 as the last number",
    ),
    "zero": (lambda d: rows(d, 0, "0.0"), "covariance.lower[0] = '0.0': expected a variance of"),
    "no covariance": (
        lambda d: scaled(d, 1e3),
        "covariance.lower: these numbers are no covariance: some combination of the unknowns would",
    ),
    "direction of masses short": (
        lambda d: (
            d["covariance"]["masses"].append([1.0]),
            d["covariance"]["lower"].append(" ".join(["0.0"] * 36 + ["1.0"])),
        ),
        "covariance.masses[0]: expected 28 numbers, of the tool and of 6 links, found 1",
    ),
    "tool far off": (
        lambda d: d.update(
            masses={
                "tool_kg": 4.0, "tool_sigma_kg": 0.1, "tool_stated_kg": 4.0,
                "tool_com_m": [0.0, 0.0, 100.0], "arm_scale": 1.0, "arm_scale_sigma": 0.01,
            }
        ),
        "masses: payload: centre of mass [0, 0, 100] m is 100 m from the flange",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("edit", "said"), EDITED.values(), ids=EDITED.keys())
def test_a_result_that_was_edited_wrongly_is_refused_by_name(
    edit: Callable[[Data], Any], said: str, result: Path, tmp_path: Path
) -> None:
    """A stranger's edits ended as faults of the program, or passed: names of the covariance in
    another order made 0.98 of what noise and uncertainty explain 0.11."""
    folder = changed(result, tmp_path / "edited", edit)
    with pytest.raises(DescriptionError, match=re.escape(said)) as refusal:
        load(folder).kinematics()
    assert str(folder / "calibration.yaml") in str(refusal.value)


def test_a_result_that_was_edited_wrongly_ends_a_command_with_2(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    folder = changed(result, tmp_path / "edited", EDITED["text"][0])
    code, _, error = ballbar("verify", folder, recorded.folder)
    assert (code, "covariance.lower[2]" in error) == (2, True), error


def test_a_lost_direction_and_a_part_that_its_file_takes_as_exact_are_covariances() -> None:
    entry = CovarianceEntry(
        names=("ra2", "ra3"), masses=(), held=("bd3",), lower=("1.0", "3.0 9.0", "0.0 0.0 0.0")
    )
    assert np.linalg.matrix_rank(entry.covariance.values) == 1
    with pytest.raises(ValidationError, match="expected a variance of bd3 above 0"):
        CovarianceEntry(names=("ra2",), masses=(), held=("bd3",), lower=("1.0", "1e-3 0.0"))


def test_a_joint_that_did_not_move_and_keys_in_another_order_are_no_fault(
    result: Path, tmp_path: Path
) -> None:
    def edit(data: Data) -> None:
        data["ranges"][5].update(lower_rad=0.1, upper_rad=0.1)
        data["parameters"] = dict(reversed(data["parameters"].items()))

    before, after = (load(folder / "calibration.yaml") for folder in (
        result, changed(result, tmp_path / "edited", edit)
    ))  # fmt: skip
    assert (after.geometry.values == before.geometry.values).all()


@pytest.fixture
def damaged(recorded: Recorded, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded.folder, tmp_path / "damaged"))


def test_rows_that_were_left_out_are_named(result: Path, damaged: Path) -> None:
    """A channel stood still for two seconds, its rows were left out, and not a word said of it."""
    log = damaged / "raw" / "robot.csv"
    lines = log.read_text().splitlines()
    frozen = lines[3000].split(",")[2]
    for i in range(3001, 3500):
        cells = lines[i].split(",")
        lines[i] = ",".join([*cells[:2], frozen, *cells[3:]])
    log.write_text("\n".join(lines) + "\n")
    code, said, error = ballbar("verify", result, damaged, "--json")
    data = json.loads(said)
    assert code == 0, said + error
    assert any("frozen channel" in warning for warning in data["warnings"])


def test_a_recording_that_is_too_short_is_bad_input(result: Path, damaged: Path) -> None:
    """Its exit code was that of a machine that changed."""
    log = damaged / "raw" / "robot.csv"
    lines = log.read_text().splitlines()
    log.write_text("\n".join(lines[: len(lines) // 20]) + "\n")
    code, _, error = ballbar("verify", result, damaged)
    assert (code, "cannot be held against" in error) == (2, True), error


def test_a_result_that_is_itself_a_misfit_is_not_said_to_hold(
    result: Path, recorded: Recorded, tmp_path: Path
) -> None:
    def poor(data: dict[str, Any]) -> None:
        data["fit"]["status"] = "misfit"

    code, said, _ = ballbar("verify", changed(result, tmp_path / "poor", poor), recorded.folder)
    assert code == 2
    assert said.startswith('Not comparable: the stored result\'s own verdict is "misfit"')


def content(result: Path, *temperatures: float | None) -> CalibrationFile:
    file = load(result / "calibration.yaml").file
    (entry,) = file.logs
    entries = [entry.model_copy(update={"temperature_C": t}) for t in temperatures]
    return file.model_copy(update={"recordings": tuple(entries)})


def test_another_temperature_is_said(result: Path) -> None:
    (said,) = temperature_remarks(content(result, 21.0, None, 22.0), 28.0)
    assert said.startswith("identified at 21.5 deg C, this recording is of 28.0 deg C")
    assert "of steel are longer by +78 um/m" in said
    assert temperature_remarks(content(result, 21.0), 22.0) == ()
    assert temperature_remarks(content(result, None), 30.0) == ()
    assert temperature_remarks(content(result, 21.0), None) == ()


def written(folder: Path, recorded: Recorded, seed: int, turned: float = 0.0) -> Path:
    """Twelve points of the recorded robot; the zero of axis 4 turned by so much [rad]."""
    cell, truth = recorded.simulation.cell, recorded.simulation.truth
    table = still_points(cell, truth, seed)
    (group,) = table.groups
    q = group.q - [0.0, 0.0, 0.0, turned, 0.0, 0.0]
    table = replace(table, groups=(replace(group, q=q),))
    return write_pose_table(folder, table, "irb2400", q, "reflector")


@pytest.fixture(scope="module")
def mixed(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mixed")
    table = written(folder / "points", recorded, 1)
    code, _, error = ballbar(
        "identify", recorded.folder, table, "--out", folder / "result", "--samples", 300
    )
    assert code == 0, error
    return folder / "result"


def test_a_result_of_both_holds_for_its_recording(mixed: Path, recorded: Recorded) -> None:
    code, said, error = ballbar("verify", mixed, recorded.folder)
    assert (code, said.startswith("Holds: the loop closes to 0.0")) == (0, True), said + error


def test_a_result_of_both_holds_for_new_points(
    mixed: Path, recorded: Recorded, tmp_path: Path
) -> None:
    code, said, error = ballbar("verify", mixed, written(tmp_path / "today", recorded, 2))
    assert (code, said.startswith("Holds: 12 poses to 0.0")) == (0, True), said + error


def test_points_name_the_zero_of_an_axis_of_a_result_of_both(
    mixed: Path, recorded: Recorded, tmp_path: Path
) -> None:
    today = written(tmp_path / "today", recorded, 3, turned=1e-3)
    code, said, error = ballbar("verify", mixed, today, "--json")
    assert code == 1, error
    best = json.loads(said)["causes"][0]
    assert (best["kind"], best["name"], best["named"]) == ("axis", "4", True)
    assert best["size"][0] == pytest.approx(1e-3, abs=4.0 * best["sigma"][0])
