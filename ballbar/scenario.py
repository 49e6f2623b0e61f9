"""A scenario: one simulated run, its identification, and the limits of an acceptable result.

A robot that moves with the double ball-bar, or before an instrument that logs a length, has a
`path`; one that stands still before any instrument has `poses`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cell.errors import DescriptionError
from cell.schema import Strict
from cell.schema_errors import nearest, wrong_key
from cell.strict_yaml import load_yaml, parse_model
from ident.corrections import CORRECTIONS
from ident.options import FitOptions, ForceSource, ModelName
from ident.thesis.cost_fit import PRINTED_STOP, ParameterSet
from ident.thesis.cost_shift import ShiftAt
from ident.thesis.costs import ENCODERS_NEEDED
from sim.kinematic_samples import Instants
from sim.poses.settings import PoseSimulationSettings
from sim.settings import SimulationSettings

SHIPPED = Path(__file__).parents[1] / "scenarios"  # beside the packages, in the tree and installed


def _known_correction(name: str) -> str:
    if name not in CORRECTIONS:
        raise ValueError(f"unknown; there are {', '.join(CORRECTIONS)}")
    return name


def _unless_auto(value: object) -> object:
    if value == "auto":
        return None
    return tuple(value) if isinstance(value, list) else value


Smoothing = Literal["none", "moving_average", "spline"]
Corrections = Annotated[
    tuple[Annotated[str, AfterValidator(_known_correction)], ...], Field(min_length=1)
]


class IdentifySettings(Strict):
    """How the recording is identified."""

    cost: Literal["ml", "length", "position", "position_angles", "transform"] = Field(
        "ml",
        description="Maximum likelihood of the whitened loop closure with the clock as parameter, "
        "or a cost function of thesis eqs. 2.1-2.4.",
    )
    form: Literal["vector", "thesis"] = Field(
        "vector", description="Form of a thesis cost: signed components, or the printed scalar."
    )
    data: Literal["files", "samples"] = Field(
        "files",
        description="Device logs through reader and clock alignment; or the angles of both logs at "
        "the sample instants, clocks already matched (thesis ch. 3), of the kinematic plant only.",
    )
    samples: Annotated[int, Field(ge=50, le=100_000)] = 1500
    parameters: ParameterSet = Field(
        "core",
        description="Parameters of a thesis cost, of which it identifies what it determines: "
        "encoder offsets, origin, robot and rod, or all of thesis sec. 3.3.",
    )
    relative_stop: Annotated[float, Field(gt=0.0, le=1e-2)] = Field(
        PRINTED_STOP,
        description="Relative decrease of a printed scalar's cost, or size of its step, at which "
        "the minimisation ends; not printed in the thesis.",
    )
    smoothing: Smoothing = Field(
        "none",
        description="Logs of a thesis cost on files: as logged, after a moving average of 100 ms "
        "(thesis sec. 5.2), or as least-squares splines, which ml uses.",
    )
    instants: Instants = Field(
        "all",
        description="Samples of a thesis cost: evenly over the motion, those at which the robot "
        "stands still, those at which it moves, or those at nearly constant speed (thesis ch. 7).",
    )
    rod_sign: bool = Field(
        False,
        description="For a vector cost on samples: the elongation of the rod is an unknown, the "
        "sign of its force is known (thesis ch. 6).",
    )
    shift_rounds: Annotated[int, Field(ge=0, le=50)] = Field(
        0,
        description="For a cost on samples: how often to move a log to the least cost before the "
        "fit (thesis sec. 5.2).",
    )
    shift_at: ShiftAt = Field(
        "identified",
        description="Geometry of each move: identified before it, or the nominal one with encoder "
        "offsets matched at a few points, which is the thesis's procedure (sec. 5.2).",
    )
    model: ModelName = Field(
        "auto",
        description="Kinematics alone (dh), with corrections (complete), or chosen by the data.",
    )
    corrections: Annotated[Corrections | None, BeforeValidator(_unless_auto)] = Field(
        None,
        description="Corrections of the complete model; `auto` takes those that the data support.",
    )
    force: ForceSource = Field(
        "auto",
        description="Source of the rod's force; `auto` takes the best signal that was logged.",
    )
    rod_sigma_m: Annotated[float, Field(gt=0.0, le=0.01)] | None = Field(
        None,
        description="Standard deviation of a rod that was measured; bd3 in the ball-bar's file is "
        "its length. Without this key the catalogue's tolerance is used.",
    )

    accuracy_mm: Annotated[float, Field(gt=0.0)] | None = Field(
        None,
        description="Stated TCP uncertainty (1 sigma, rms over the workspace) up to which a result "
        "is acceptable; by default half of the nominal robot's error, and 0.1 mm in any case.",
    )

    @property
    def options(self) -> FitOptions:
        """The options of the identification itself."""
        return FitOptions(
            model=self.model,
            corrections=self.corrections,
            force=self.force,
            rod_sigma=self.rod_sigma_m,
            samples=self.samples,
            accuracy=None if self.accuracy_mm is None else self.accuracy_mm * 1e-3,
        )


class AcceptSettings(Strict):
    """Limits of errors against the truth; a run beyond one of them exits with code 1."""

    tcp_mean_mm: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Mean TCP error over the accuracy grid."
    )
    tcp_max_mm: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Largest TCP error over the accuracy grid."
    )
    parameter_distance_mm_mrad: Annotated[float, Field(gt=0.0)] | None = Field(
        None,
        description="Euclidean distance over the identified parameters, mm and mrad mixed (thesis "
        "sec. 3.4).",
    )
    clock_offset_us: Annotated[float, Field(gt=0.0)] | None = None
    clock_skew_ppm: Annotated[float, Field(gt=0.0)] | None = None
    iterations: Annotated[int, Field(gt=0)] | None = Field(
        None, description="From the automatic start to the result."
    )


class Scenario(SimulationSettings):
    """One YAML file of scenarios/."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
    identify: IdentifySettings = IdentifySettings()
    accept: AcceptSettings = AcceptSettings()

    @model_validator(mode="after")
    def _can_be_identified(self) -> Scenario:
        """The cost has its encoders and a form, samples come from the kinematic plant."""
        identify, fitted = self.identify, self.encoders.fitted
        if self.cell.instrument is not None:
            for key in ("cost", "data", "force", "rod_sigma_m"):
                if getattr(identify, key) != IdentifySettings.model_fields[key].default:
                    message = "needs a ball-bar with encoders (cell.ballbar); leave it out"
                    raise wrong_key("identify", key, message=message)
        if identify.data == "samples" and self.plant.kind != "kinematic":
            message = "samples come from the kinematic plant only; set plant.kind = kinematic"
            raise wrong_key("identify", "data", message=message)
        if identify.cost == "ml":
            if identify.form != "vector":
                message = "the thesis prints no ml; choose one of its costs, or vector"
                raise wrong_key("identify", "form", message=message)
            if identify.parameters != "core":
                message = "is of the thesis's costs; ml has identify.model and corrections"
                raise wrong_key("identify", "parameters", message=message)
        elif missing := [f"b{j}" for j in ENCODERS_NEEDED[identify.cost] if j not in fitted]:
            message = f"needs encoders on {', '.join(missing)}, which are not in encoders.fitted"
            raise wrong_key("identify", "cost", message=message)
        return self

    @model_validator(mode="after")
    def _options_have_their_cost(self) -> Scenario:
        """What is of the thesis's costs on samples is not asked of others."""
        identify = self.identify
        for key in ("rod_sign", "shift_rounds", "instants"):
            given = getattr(identify, key) != IdentifySettings.model_fields[key].default
            if given and (identify.cost == "ml" or identify.data == "files"):
                message = "is of the thesis's costs on samples; set cost and data = samples"
                raise wrong_key("identify", key, message=message)
        if identify.smoothing != "none" and (identify.cost == "ml" or identify.data != "files"):
            message = "is of the thesis's costs on logs; set cost and data = files"
            raise wrong_key("identify", "smoothing", message=message)
        if identify.shift_rounds and identify.instants != "all":
            message = "a log is moved with evenly spread samples only; leave instants out"
            raise wrong_key("identify", "instants", message=message)
        if identify.rod_sign and identify.shift_rounds:
            message = "the sign of the force is of logs on one clock; leave shift_rounds out"
            raise wrong_key("identify", "rod_sign", message=message)
        if identify.rod_sign and identify.form != "vector":
            message = "the rod's deviation is linear in the vector form only; set form = vector"
            raise wrong_key("identify", "rod_sign", message=message)
        return self


class PoseAcceptSettings(Strict):
    """Limits of errors against the truth; a run beyond one of them exits with code 1."""

    tcp_mean_mm: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Mean TCP error over random poses within the fitted ranges of the joints."
    )
    tcp_max_mm: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Largest TCP error over the same poses."
    )


class PoseScenario(PoseSimulationSettings):
    """One YAML file of scenarios/ with still poses."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
    accept: PoseAcceptSettings = PoseAcceptSettings()


def scenario_file(name: str | Path) -> Path:
    """The file of a scenario: the path itself, or the shipped scenario of that name.

    name : a path, or a bare name such as `irb2400`. Raises DescriptionError when a bare name is
    neither a file here nor a shipped scenario.
    """
    path = Path(name)
    if path.is_file() or path.suffix or path.name != str(path):
        return path
    names = sorted(file.stem for file in SHIPPED.glob("*.yaml"))
    if path.name in names:
        return SHIPPED / f"{path.name}.yaml"
    hint = nearest(path.name, names, noun="name")
    raise DescriptionError(
        f"unknown scenario {path.name!r}.{hint} A file of your own ends in .yaml."
    )


def load_scenario(path: str | Path) -> Scenario:
    """The checked scenario of a file, or the shipped one of a bare name.

    Raises DescriptionError naming file, line and key, also for a scenario of still poses.
    """
    scenario = load_any_scenario(path)
    if isinstance(scenario, PoseScenario):
        raise DescriptionError(
            f"{scenario_file(path)}: a scenario of still poses, and this needs one with a path. "
            "`ballbar run` and `ballbar simulate` take it."
        )
    return scenario


def with_absolute_names(scenario: Scenario, folder: Path) -> Scenario:
    """The scenario with absolute names of its robot, ball-bar and plate files.

    recording.yaml, in another folder, takes over these names.
    """
    names = scenario.cell.model_dump(include={"robot", "ballbar", "instrument", "plate"})
    own = {key: name for key, name in names.items() if (name or "").endswith(".yaml")}
    absolute = {key: str((folder / name).resolve()) for key, name in own.items()}
    return scenario.model_copy(update={"cell": scenario.cell.model_copy(update=absolute)})


def load_any_scenario(path: str | Path) -> Scenario | PoseScenario:
    """The checked scenario of a file or of a shipped name: of still poses if it has `poses`.

    Raises DescriptionError naming file, line and key.
    """
    document = load_yaml(scenario_file(path))
    if "poses" in document.data:
        return parse_model(document, PoseScenario)
    return parse_model(document, Scenario)
