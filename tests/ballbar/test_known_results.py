"""Which results `ballbar plan --after` takes: of the request's machine, each recording once."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml
from rich.console import Console

from ballbar.cell.errors import InputError
from ballbar.cell.geometry import Geometry
from ballbar.plan.known_results import known_from
from ballbar.planning.request import PlanCell, PlanRequest
from tests.helpers.calibrations import write_calibration_of

POSITION = (0.7, 0.0, 0.54)
ROBOT = Path(__file__).parents[2] / "cell" / "robots" / "irb2400.yaml"


def request(**cell: object) -> PlanRequest:
    named = {"robot": "irb2400", "ballbar": "lund_600", "ballbar_position_m": POSITION} | cell
    return PlanRequest(schema="ballbar-plan/1", name="test", cell=PlanCell.model_validate(named))


class Results:
    """Results written for a test, of one machine."""

    def __init__(self, folder: Path, nominal: Geometry) -> None:
        self._folder, self._nominal = folder, nominal

    def write(
        self, name: str, noise: Sequence[float] = (1e-5,), *, status: str = "good", **changes: str
    ) -> Path:
        """A result of recordings of these noises; changes : of the file's keys."""
        path = self._folder / name / "calibration.yaml"
        path.parent.mkdir()
        write_calibration_of(path, self._nominal, self._nominal, status=status)
        data = yaml.safe_load(path.read_text())
        (made,) = data["recordings"]
        data["recordings"] = [
            made | {"noise": {"joint_rad": [sigma] * 6, "encoder_rad": {}}} for sigma in noise
        ]
        data["covariance"] = {"names": ["ra2"], "masses": [], "held": [], "lower": ["1.5e-12"]}
        data["fit"]["excess"] = dict.fromkeys(("gear_rad", "wrist_rad", "bar_rad", "rod_m"), 1e-6)
        path.write_text(json.dumps(data | {"model": "complete"} | changes))  # JSON is YAML
        return path.parent


@pytest.fixture
def results(tmp_path: Path, nominal: Geometry) -> Results:
    return Results(tmp_path, nominal)


def said(found: list[Path], of: PlanRequest) -> str:
    text = io.StringIO()
    assert len(known_from(found, of, Console(file=text, width=400)).results) == len(found)
    return text.getvalue()


def test_results_of_unlike_recordings_of_the_machine_are_taken(results: Results) -> None:
    found = [results.write("one", [1e-5]), results.write("two", [1.1e-5])]
    assert said(found, request()) == ""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"instrument": "qc20w_300"}, "is of ball-bar qc20w_300, the request of lund_600"),
        ({"plate": "plate_250_thin"}, "is of plate plate_250_thin, the request of plate_250"),
        ({"robot": "irb1600"}, "is of robot irb1600, the request of irb2400"),
    ],
)
def test_a_result_of_another_cell_is_refused(
    results: Results, changes: dict[str, str], words: str
) -> None:
    """A result of a telescoping bar let a ball-bar be predicted at 1.9 um, 18.4 without."""
    result = results.write("one", **changes)
    with pytest.raises(InputError, match=words):
        said([result], request())


def test_a_choice_of_ballbars_is_refused_after_the_result_of_one(results: Results) -> None:
    result = results.write("one")
    with pytest.raises(InputError, match="of ball-bar lund_600, the request of lund_1000"):
        said([result], request(ballbar_choices=("lund_1000",)))


def test_robots_are_compared_by_their_description(results: Results, tmp_path: Path) -> None:
    """The title was compared, so a robot of other dimensions passed."""
    same, other = (tmp_path / folder / "mine.yaml" for folder in ("same", "other"))
    result = results.write("one", robot="descriptions/robot/mine.yaml")
    kept = result / "descriptions" / "robot" / "mine.yaml"
    for file in (same, other, kept):
        file.parent.mkdir(parents=True)
        file.write_text(ROBOT.read_text())
    other.write_text(ROBOT.read_text().replace("0.705", "0.805"))
    assert said([result], request(robot=str(same))) == ""
    with pytest.raises(InputError, match=r"mine\.yaml, whose content differs"):
        said([result], request(robot=str(other)))


@pytest.mark.parametrize("noise", [[1e-5], [1e-5 * (1.0 + 1e-12)], [2e-5, 1e-5]])
def test_a_recording_counts_once(results: Results, noise: list[float]) -> None:
    """Given twice, or beside the joint result that contains it, it halved the variance."""
    found = [results.write("one", [1e-5]), results.write("two", noise)]
    with pytest.raises(InputError, match=r"holds recording made, which .*one.* would count twice"):
        said(found, request())


def test_logs_without_noise_are_not_taken_for_one_recording(results: Results) -> None:
    found = [results.write("one", [0.0]), results.write("two", [0.0])]
    assert said(found, request()) == ""


@pytest.mark.parametrize("status", ["misfit", "suspect"])
def test_of_a_fit_that_is_not_good_it_is_said(results: Results, status: str) -> None:
    result = results.write("one", status=status)
    assert f"warning: {result / 'calibration.yaml'}: its fit is called '{status}'" in said(
        [result], request()
    )
