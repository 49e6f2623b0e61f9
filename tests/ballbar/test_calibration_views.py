"""One result for all that is identified: tables, figures, notebook, files, pickle, kinematics."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

import ballbar
from ballbar import Calibration, FitOptions, InputError, Logs, PoseImport, PoseTable, Recording
from tests.helpers.drawn_pose_tables import DrawnRobot, drawn_robot, point_table
from tests.helpers.pose_results import write_pose_table
from tests.helpers.simulated_recordings import Recorded

OPTIONS = FitOptions(samples=300)


@pytest.fixture(scope="module")
def fresh(recorded: Recorded) -> Calibration:
    return ballbar.identify(str(recorded.folder), options=OPTIONS)


@pytest.fixture(scope="module")
def saved(fresh: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "identified"
    fresh.save(folder)
    return folder


@pytest.fixture(scope="module")
def drawn() -> DrawnRobot:
    return drawn_robot("ur10", np.random.default_rng(7))


@pytest.fixture(scope="module")
def poses(drawn: DrawnRobot) -> PoseTable:
    rng = np.random.default_rng(8)
    return point_table(drawn, drawn.angles(80, rng), 3e-5, rng)


@pytest.fixture(scope="module")
def still(poses: PoseTable) -> Calibration:
    return ballbar.identify(poses, options=FitOptions(joint_errors="none"))


def test_a_folder_its_file_and_the_path_as_text_are_one_recording(recorded: Recorded) -> None:
    every = (recorded.folder, str(recorded.folder), recorded.folder / "recording.yaml")
    read = [ballbar.read(path) for path in every]
    assert all(isinstance(each, Recording) for each in read)
    assert all(np.array_equal(each.robot_log.q, read[0].robot_log.q) for each in read[1:])


def test_a_file_of_data_is_refused_with_the_command_that_describes_it(recorded: Recorded) -> None:
    with pytest.raises(InputError, match=r"ballbar.csv: is a file of data.*ballbar new"):
        ballbar.read(recorded.folder / "raw/ballbar.csv")


def test_a_table_is_read_as_the_file_beside_it_describes(poses: PoseTable, tmp_path: Path) -> None:
    folder = write_pose_table(tmp_path / "poses", poses, "ur10", poses.groups[0].q, "ball")
    table = folder / "poses.csv"
    read = ballbar.read(table)
    assert isinstance(read, PoseImport)
    assert np.allclose(read.table.q, poses.q)
    table.with_name("other.csv").write_text(table.read_text())
    with pytest.raises(InputError, match=r"other.csv: is a file of data"):
        ballbar.read(table.with_name("other.csv"))


def test_nothing_is_refused_and_logs_as_arrays_need_their_cell(recorded: Recorded) -> None:
    with pytest.raises(InputError, match="nothing to identify"):
        ballbar.identify()
    log = ballbar.read(recorded.folder).robot_log
    with pytest.raises(InputError, match="do not say what stands in the cell"):
        ballbar.identify(Logs(log, None))


def test_arrays_give_what_their_recording_gives(fresh: Calibration, recorded: Recorded) -> None:
    read = ballbar.read(recorded.folder)
    logs = Logs(read.robot_log, read.ballbar_log, read.force_log, "arrays")
    given = ballbar.identify(logs, cell=recorded.simulation.cell, options=OPTIONS)
    assert given.sentence == fresh.sentence
    assert given.to_frame().loc["arrays"].equals(fresh.to_frame().loc["recording"])
    assert given.to_frame().loc[""].equals(fresh.to_frame().loc[""])


def test_a_cell_that_differs_from_the_files_is_refused(
    saved: Path, recorded: Recorded, poses: PoseTable, still: Calibration
) -> None:
    cell, read = recorded.simulation.cell, ballbar.read(recorded.folder)
    longer = replace(cell.robot, a=cell.robot.a + np.array([0, 1e-9, 0, 0, 0, 0]))
    logs, other = Logs(read.robot_log, read.ballbar_log), replace(cell, robot=longer)
    with pytest.raises(InputError, match="describes another robot, ball-bar or plate than `cell`"):
        ballbar.identify(recorded.folder, logs, cell=other)
    with pytest.raises(InputError, match="robot irb2400: has other nominal DH parameters"):
        ballbar.verify(saved, logs, cell=other)
    own = replace(poses, robot=replace(poses.robot, a=poses.robot.a + 1e-9))
    with pytest.raises(InputError, match="must be of one robot"):
        ballbar.identify(poses, own)
    with pytest.raises(InputError, match="robot ur10: has other nominal DH parameters"):
        ballbar.verify(still, own)


def test_the_table_of_parameters_is_near_the_truth_and_stands_in_the_file(
    fresh: Calibration, saved: Path, recorded: Recorded
) -> None:
    truth, frame = recorded.simulation.truth.geometry, fresh.to_frame()
    assert frame.loc[("", "ra2"), "unit"] == "m"
    assert frame.loc[("", "ra2"), "value"] == pytest.approx(truth["ra2"], abs=50e-6)
    robot = frame.loc[""]
    found = robot[robot["identified"]]
    z = [(row.value - truth[name]) / row.sigma for name, row in found.iterrows()]
    assert np.sqrt(np.mean(np.square(z))) < 2.0
    back = ballbar.load(saved)
    assert back.to_frame().equals(frame)
    assert {n: e.value for n, e in back.file.parameters.items()} == robot["value"].to_dict()
    assert back.to_frame("corrections").equals(fresh.to_frame("corrections"))


def test_residuals_are_those_of_the_fit(fresh: Calibration) -> None:
    frame = fresh.to_frame("residuals")
    (estimate,) = fresh.data.identification.recordings
    for robot, side in (("nominal", estimate.before), ("identified", estimate.after)):
        part = frame.loc[("recording", robot)]
        assert np.array_equal(part[["x", "y", "z"]], side.position)
        assert np.array_equal(part["t"], side.t)
    means = frame.groupby("robot")["norm"].mean()
    assert means["identified"] < 0.1 * means["nominal"]


def test_residuals_of_still_poses_are_those_of_their_table(still: Calibration) -> None:
    frame, poses = still.to_frame("residuals"), still.data.identification.poses
    assert poses is not None
    assert np.allclose(frame.xs("identified", level="robot")["norm"], poses.residual)
    assert np.allclose(frame.xs("nominal", level="robot")["norm"], poses.residual_nominal)


def test_a_calibration_that_was_read_back_says_that_it_has_no_residuals(saved: Path) -> None:
    back = ballbar.load(saved)
    for view in (back.plot_residuals, lambda: back.report(saved / "x.html")):
        with pytest.raises(InputError, match="was read back, and its file"):
            view()


@pytest.mark.parametrize("of", ["moving", "still"])
def test_a_pickled_calibration_predicts_the_same(
    fresh: Calibration, still: Calibration, of: str
) -> None:
    result = fresh if of == "moving" else still
    arm = result.kinematics()
    q = arm.identified.workspace()[:20]
    sigma = arm.uncertainty(q).sigma  # which the robot keeps as a function
    for copy in (pickle.loads(pickle.dumps(arm)), pickle.loads(pickle.dumps(result)).kinematics()):
        assert np.array_equal(copy.forward(q), arm.forward(q))
        assert np.array_equal(copy.uncertainty(q).sigma, sigma)


def test_what_was_saved_predicts_the_same(fresh: Calibration, saved: Path) -> None:
    arm, back = fresh.kinematics(), ballbar.load(saved).kinematics()
    q = arm.identified.workspace()[:20]
    assert np.array_equal(back.forward(q), arm.forward(q))
    assert np.allclose(back.uncertainty(q).sigma, arm.uncertainty(q).sigma, rtol=1e-9)
    assert {file.name for file in saved.iterdir()} == {
        "calibration.yaml", "report.html", "import_report.json"
    }  # fmt: skip


def test_still_poses_as_arrays_find_the_drawn_robot_and_are_saved(
    still: Calibration, drawn: DrawnRobot, tmp_path: Path
) -> None:
    q = drawn.angles(50, np.random.default_rng(9))
    q = q[still.kinematics().identified.covered(q)]
    assert len(q) > 5
    still.save(tmp_path / "out")
    there = ballbar.load(tmp_path / "out").kinematics().forward(q)
    assert np.allclose(there, still.kinematics().forward(q), atol=1e-12)
    assert "UR10" in (tmp_path / "out/report.html").read_text()


def test_arrays_of_a_robot_that_no_file_describes_are_identified_but_not_saved(
    poses: PoseTable, tmp_path: Path
) -> None:
    own = replace(poses.robot, axis_upper=poses.robot.axis_upper + 0.1)
    result = ballbar.identify(replace(poses, robot=own), options=FitOptions(joint_errors="none"))
    assert result.robot is own
    with pytest.raises(InputError, match="ur10 is not the robot of that name that is shipped"):
        result.save(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_fresh_calibration_holds_for_what_it_was_made_of(
    fresh: Calibration, still: Calibration, poses: PoseTable, recorded: Recorded
) -> None:
    assert ballbar.verify(fresh, recorded.folder).holds
    shown = replace(poses.groups[0], q=poses.groups[0].q + np.array([0, 0, 1e-3, 0, 0, 0]))
    assert ballbar.verify(still, poses).holds
    changed = ballbar.verify(still, replace(poses, groups=(shown,)))
    assert not changed.holds
    assert "zero of axis 3" in changed.sentence


def test_figures_take_axes_and_return_them(fresh: Calibration, still: Calibration) -> None:
    for result in (fresh, still):
        axes = Figure().subplots(2)
        assert result.plot_parameters(axes[0]) is axes[0]
        assert result.plot_residuals(axes[1]) is axes[1]
        identified = result.to_frame().loc[""]["identified"].sum()
        assert len(axes[0].get_xticks()) == identified
        assert [text.get_text() for text in axes[1].get_legend().get_texts()] == [
            "nominal robot", "identified robot"
        ]  # fmt: skip
    with mpl.rc_context({"backend": "Agg"}):
        assert fresh.plot_parameters().get_ylabel() == "deviation from the catalogue [mm, mrad]"


def test_a_notebook_shows_the_verdict_and_the_parameters(fresh: Calibration) -> None:
    page = fresh._repr_html_()
    assert f"<b>{fresh.sentence}</b>" in page
    assert "ra2" in page
    assert repr(fresh) == f"<Calibration of irb2400: {fresh.sentence}>"


def test_the_report_is_one_page(fresh: Calibration, tmp_path: Path) -> None:
    fresh.report(tmp_path / "page.html", command="my_script.py")
    page = (tmp_path / "page.html").read_text()
    assert fresh.sentence in page
    assert "my_script.py" in page


def test_a_simulation_in_memory_is_that_of_the_files(tmp_path: Path) -> None:
    overrides = ("path.duration_s=60", "plant.kind=kinematic", "errors.rod_strain=null")
    written = ballbar.simulate("irb2400", tmp_path / "logs", overrides=overrides)
    alone = ballbar.simulate("irb2400", overrides=overrides)
    assert alone.truth.geometry["ra2"] == written.truth.geometry["ra2"]
    assert isinstance(ballbar.read(tmp_path / "logs"), Recording)
    truth = ballbar.load_truth(tmp_path / "logs.truth.yaml")
    assert truth.geometry["ra2"] == alone.truth.geometry["ra2"]


def test_sentence_warnings_and_budget_are_those_of_the_file(fresh: Calibration) -> None:
    assert fresh.sentence == fresh.file.fit.verdict
    assert fresh.warnings == fresh.file.fit.warnings
    entry = fresh.file.uncertainty_budget
    assert entry is not None
    assert fresh.budget == entry.budget
