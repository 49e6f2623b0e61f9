"""Results of every subset of parameters are written, also where our own reader refuses them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ballbar.acquisition.recording import Recording
from ballbar.cell.clock import Clock
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import Geometry
from ballbar.cell.load import load_cell
from ballbar.cell.payload import payload_of, with_payload
from ballbar.cell.recording import RecordingFile
from ballbar.ident.complete_fit import FIRST_EXCESS, fit_pose, posed
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.estimator.build_unknowns import arm_parameters
from ballbar.ident.estimator.fit import fit_kinematics
from ballbar.ident.estimator.identifiability import candidates
from ballbar.ident.estimator.priors import belongs_to_recording
from ballbar.ident.identify import kinematic_result, result_of
from ballbar.ident.loads.payload import PayloadEstimate
from ballbar.ident.options import FitOptions
from ballbar.ident.recording_fit import RecordingFit, fit_recording
from ballbar.ident.result import Identification
from ballbar.ident.robot.tool_covariance import ToolCovariance
from ballbar.result import calibration
from ballbar.result import write_calibration as writer
from ballbar.result.calibration import Calibration, load
from ballbar.result.machine_entries import CovarianceEntry, MassesEntry, covariance_entry
from ballbar.result.names import CALIBRATION, REFUSED
from ballbar.result.run_data import FittedRecording, RunData
from ballbar.result.write_calibration import RefusedResultError, write_calibration
from tests.helpers.command_line import ballbar
from tests.helpers.length_recordings import bar_run, first_seconds, wire_run, write_folder
from tests.helpers.minute_logs import minute_logs
from tests.helpers.pose_results import write_pose_table
from tests.helpers.six_axes import NAMES
from tests.helpers.still_poses import angles, table_of, true_robot
from tests.helpers.synthetic_recording import CELL

OPTIONS = FitOptions(model="dh", samples=60)
WITHOUT_LOADS = ("gear_ripple", "encoder_harmonics", "gear_ratio")


@lru_cache
def fitted(instrument: str) -> tuple[Cell, RecordingFit]:
    """A recording of a ball-bar or of a telescoping bar, fitted from few samples."""
    if instrument == "ball-bar":
        return CELL, fit_recording(CELL, minute_logs(), OPTIONS)
    run = bar_run(Clock(0.3, 0.0), seed=1, duration=40.0)
    return run.cell, fit_recording(run.cell, run.logs, OPTIONS)


def placed(found: RecordingFit) -> Geometry:
    """The nominal robot with the base pose and the encoder offsets of a fit."""
    own = filter(belongs_to_recording, found.nominal.table.names)
    return found.nominal.replaced({name: found.geometry[name] for name in own})


def run_data(result: Identification, names: Sequence[str] = ("made",)) -> RunData:
    """A result as of recordings that name shipped descriptions."""
    description = RecordingFile.model_construct(
        robot="irb2400", ballbar="lund_600", measured_on="2026-03-31"
    )
    recording = cast(Recording, SimpleNamespace(description=description, folder=Path()))
    fits = zip(names, result.recordings, strict=True)
    recordings = tuple(FittedRecording(name, recording, each) for name, each in fits)
    return RunData("made", recordings, result)


def read_back(data: RunData) -> Calibration:
    with TemporaryDirectory() as folder:
        write_calibration(Path(folder) / "calibration.yaml", data)
        return load(Path(folder) / "calibration.yaml")


def check(result: Identification, read: Calibration) -> None:
    """The file holds what the result holds, each number under its name."""
    stated, robot = read.file.covariance, result.robot
    assert stated is not None
    assert read.file.measured_on == "2026-03-31"
    assert stated.names == robot.tool.names
    assert np.array_equal(stated.covariance.values, robot.tool.values)
    assert {n: p.sigma for n, p in read.file.parameters.items() if p.identified} == robot.sigma
    for k, estimate in enumerate(result.recordings):
        assert np.array_equal(read.file.geometry(k).values, estimate.geometry.values)


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(
    instrument=st.sampled_from(["ball-bar", "length"]),
    names=st.lists(st.sampled_from(NAMES), unique=True),
    share=st.floats(0.0, 1.0),
)
@example(instrument="length", names=["ra4", "rd4", "ra2", "ox"], share=0.5)
@example(instrument="ball-bar", names=["ox"], share=1.0)  # nothing of robot or ball-bar
def test_a_result_of_any_subset_of_parameters_reads_back(
    instrument: str, names: list[str], share: float
) -> None:
    """share : of the fitted parameters that count as excited well."""
    cell, found = fitted(instrument)
    table = found.nominal.table
    every = candidates(table, found.samples.encoders, complete=True, declared=())
    parameters = np.array([i for i in map(table.index.get, names) if i in every], dtype=np.intp)
    strong = round(share * parameters.size)
    fit = fit_kinematics(
        found.samples, placed(found), found.clock, parameters, found.fit.excess,
        prior_sigma=np.full(parameters.size, 1e-3), max_iterations=1,
    )  # fmt: skip
    subset = replace(found.subset, parameters=parameters[:strong], weak=parameters[strong:])
    result = kinematic_result(cell, replace(found, subset=subset, fit=fit), OPTIONS)
    read = read_back(run_data(result))
    assert set(read.file.identified) <= set(names)
    check(result, read)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(count=st.integers(1, 3), names=st.lists(st.sampled_from(WITHOUT_LOADS), unique=True))
def test_a_result_of_several_recordings_reads_back(count: int, names: list[str]) -> None:
    cell, found = fitted("ball-bar")
    corrections = [CORRECTIONS[name](cell, found.samples.encoders) for name in names]
    pose = posed(cell, [found] * count, corrections, OPTIONS)
    fit = fit_pose(pose, FIRST_EXCESS, max_iterations=1)
    result = result_of(cell, [found] * count, fit, OPTIONS)
    read = read_back(run_data(result, [f"recording {k}" for k in range(count)]))
    assert list(read.file.corrections) == names
    check(result, read)


@pytest.mark.slow
def test_a_short_length_log_is_identified_and_its_result_written(tmp_path: Path) -> None:
    """It ended as a fault of the program, three times of three: `expected ra4 as name 4`."""
    run = first_seconds(wire_run(Clock(0.3, 0.0), seed=1), 16.0)
    write_folder(run, tmp_path / "short", "drawwire_2m")
    code, out, err = ballbar("identify", tmp_path / "short", "--model", "dh", "--samples", "200")
    assert code == 1, err
    assert out.startswith("Uncertain: the logs are too short")
    covariance = load(tmp_path / "short-identified/calibration.yaml").file.covariance
    assert covariance is not None
    assert "ra4" in covariance.names


def refused_order(covariance: ToolCovariance) -> CovarianceEntry:
    """The entry of a covariance with its names in another order than the reader expects."""
    entry = covariance_entry(covariance)
    return entry.model_copy(update={"names": entry.names[::-1]})


def test_a_result_that_its_reader_refuses_is_kept_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of numbers that no reader takes: not finite, negative sigma, or NumPy's own types."""
    cell, found = fitted("ball-bar")
    result = kinematic_result(cell, found, OPTIONS)
    path, kept = tmp_path / CALIBRATION, tmp_path / REFUSED
    write_calibration(path, run_data(result))
    sound = yaml.safe_load(path.read_text())
    with monkeypatch.context() as patch:
        patch.setattr(writer, "covariance_entry", refused_order)
        with pytest.raises(RefusedResultError) as error:
            write_calibration(path, run_data(result))
    assert f"whole in {kept}, and not in calibration.yaml" in str(error.value)
    assert f"{REFUSED}:" in str(error.value)
    assert "covariance.names[0] = 'bd3': expected ra1 as name 1" in str(error.value)
    assert [p.name for p in tmp_path.iterdir()] == [REFUSED], "no earlier result beside it"
    sound["covariance"]["names"].reverse()
    assert yaml.safe_load(kept.read_text()) == sound
    fit = replace(result.fit, chi2_per_dof=np.float64("nan"), rank=np.int64(5))
    sigma = {"ra2": np.float32(-1.0)}
    strange = replace(result, fit=fit, robot=replace(result.robot, sigma=sigma))
    with pytest.raises(RefusedResultError, match=r"fit\.chi2_per_dof = nan: expected a finite"):
        write_calibration(path, run_data(strange))
    again = yaml.safe_load(kept.read_text())
    assert again["parameters"]["ra2"]["sigma"] == -1.0
    assert again["fit"]["rank"] == 5
    write_calibration(path, run_data(result))
    assert [p.name for p in tmp_path.iterdir()] == [CALIBRATION]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["logs", "still poses"])
def test_a_refused_result_ends_as_a_fault_with_all_files_written(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    if kind == "logs":
        run = first_seconds(wire_run(Clock(0.3, 0.0), seed=1), 16.0)
        write_folder(run, tmp_path / "in", "drawwire_2m")
        options, files = (
            ["--model", "dh", "--samples", "200"],
            {"report.html", "import_report.json"},
        )
    else:
        q, robot = angles("ur5", 100), true_robot("ur5")
        write_pose_table(tmp_path / "in", table_of(robot, q=q), "ur5", q, "ball")
        options, files = ["--joint-errors", "none"], {"report.html"}
    words = ["identify", tmp_path / "in", "--out", out, "--json", *options]
    with monkeypatch.context() as patch:
        patch.setattr(writer, "covariance_entry", refused_order)
        patch.setattr(calibration, "arm_parameters", lambda robot: arm_parameters(robot)[1:])
        code, said, err = ballbar(*words)
    assert code == 3
    assert said == ""
    assert f"fault of the program: RefusedResultError: the result stands whole in {out}" in err
    assert {p.name for p in out.iterdir()} == {REFUSED, *files}
    assert yaml.safe_load((out / REFUSED).read_text())["fit"]["verdict"]
    code, said, err = ballbar(*words)
    assert code in (0, 1), err
    assert json.loads(said)["calibration"]
    assert {p.name for p in out.iterdir()} == {CALIBRATION, *files}


def test_the_masses_of_a_fit_are_those_of_its_file() -> None:
    """Also where none is beside its tolerance: the unloaded robot sags under them."""
    cell = load_cell("irb2400", "lund_600", "plate_250")
    deviations = 0.01 * np.random.default_rng(5).standard_normal(28)
    estimate = PayloadEstimate(
        payload=payload_of(cell, deviations, 1.02),
        stated=cell.plate.body.mass,
        mass_sigma=0.1,
        arm_sigma=0.01,
        added_load=np.zeros(6),
        significant=False,
        covariance=np.eye(28),
    )
    entry = writer._content(MassesEntry, estimate)
    read = MassesEntry.model_validate_json(entry.model_dump_json(), strict=False)
    used, again = (with_payload(cell, p) for p in (estimate.payload, read.payload))
    pairs = zip(
        (*used.robot.required("links"), used.plate.body),
        (*again.robot.required("links"), again.plate.body),
        strict=True,
    )
    for before, after in pairs:
        assert after.mass == before.mass
        assert np.array_equal(after.com, before.com)
        assert np.array_equal(after.inertia, before.inertia)
    assert again.robot.required("links")[2].com != pytest.approx(
        cell.robot.required("links")[2].com, abs=1e-4
    )
