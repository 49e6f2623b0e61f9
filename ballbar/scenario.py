"""A scenario: one simulated run, its identification, and the limits of an acceptable result.

A robot that moves with the double ball-bar, or before an instrument that logs a length, has a
`path`; one that stands still before any instrument has `poses`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ballbar.cell.errors import DescriptionError, InputError
from ballbar.cell.extended_yaml import SHIPPED, ExtendableKind, load_extended, named_file, portable
from ballbar.cell.files import beside, copied_description, write_yaml
from ballbar.cell.schema import Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import parse_model
from ballbar.ident.thesis.names import ENCODERS_NEEDED
from ballbar.identify_settings import IdentifySettings
from ballbar.sim.settings import A_PATH, SimulationSettings, refuse_keys

SCENARIOS = ExtendableKind(
    what="scenario",
    shipped=SHIPPED,
    files=("path.file", "path.recording", "accept.held_out_file"),
    descriptions=("cell.robot", "cell.ballbar", "cell.instrument", "cell.plate"),
)
Limit = Annotated[float, Field(gt=0.0)] | None


class AcceptSettings(Strict):
    """Limits of an acceptable run; beyond one of them it exits with code 1.

    Time of computation has no limit here: nothing in a run could be its measure, and a clock alone
    would judge the machine (docs/validation.md compares times with named rivals).
    """

    verdict: Literal["good", "suspect"] | None = None
    """Worst acceptable verdict; any worse than suspect fails the run anyway."""
    tcp_mean_mm: Limit = None
    """Mean TCP error over the accuracy grid; of still poses over random ones in the fitted ranges.
    """
    tcp_max_mm: Limit = None
    """Largest TCP error over the same poses."""
    tcp_sigma_mm: Limit = None
    """Stated TCP uncertainty (1 sigma), mean over the same poses, with the scale; of still poses in
    the instrument's.
    """
    tcp_over_stated: Limit = None
    """Mean TCP error over the mean stated uncertainty."""
    parameter_distance_mm_mrad: Limit = None
    """Euclidean distance over the identified parameters, mm and mrad mixed (thesis sec. 3.4)."""
    clock_offset_us: Limit = None
    clock_skew_ppm: Limit = None
    iterations: Annotated[int, Field(gt=0)] | None = None
    """From the automatic start to the result."""
    loop_closure_um: Limit = None
    """Largest distance by which the simulated loop is open, by DH; `simulate` checks it too."""
    rod_force_N: Limit = None
    """Largest force in the rod, pull or push; `simulate` checks it too."""
    held_out_ratio: Limit = None
    """Residual on held_out_file over what noise and stated uncertainty explain."""
    held_out_file: str = ""
    """Path file, relative to the scenario, on which the machine is recorded for it."""
    corrected_mean_mm: Limit = None
    """Mean distance of the tool from corrected targets, by `ballbar rehearse`."""
    corrected_max_mm: Limit = None
    """Largest such distance."""

    @model_validator(mode="after")
    def _held_out(self) -> Self:
        if bool(self.held_out_file) != (self.held_out_ratio is not None):
            raise ValueError("held_out_file and held_out_ratio go together; give both or neither")
        return self


# Limits that still poses have too
OF_EVERY_RUN = ("verdict", "tcp_mean_mm", "tcp_max_mm", "tcp_sigma_mm", "tcp_over_stated")


class Scenario(SimulationSettings):
    """One YAML file of scenarios/."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
    identify: IdentifySettings = IdentifySettings()
    accept: AcceptSettings = AcceptSettings()

    @model_validator(mode="after")
    def _can_be_identified(self) -> Self:
        """Every option belongs to the cost, the data and the instrument that are stated.

        A cost has its encoders, samples come from the kinematic plant, and options of the thesis's
        costs are not stated for others.
        """
        if self.path is None:
            limits = (k for k in AcceptSettings.model_fields if k not in OF_EVERY_RUN)
            refuse_keys(self, ("identify", *(f"accept.{k}" for k in limits)), A_PATH)
            return self
        settings, fitted = self.identify, self.encoders.fitted
        stated = settings.stated
        if self.cell.instrument is not None:
            for key in ("cost", "data", "force", "rod_sigma_m"):
                if key in stated:
                    message = "needs a ball-bar with encoders (cell.ballbar); leave it out"
                    raise wrong_key("identify", key, message=message)
        ml, files = settings.cost == "ml", settings.data == "files"
        needed = () if settings.cost == "ml" else ENCODERS_NEEDED[settings.cost]
        missing = [f"b{j}" for j in needed if j not in fitted]
        other_path = self.accept.held_out_file and (
            self.path.kind != "lissajous" or not self.path.file
        )
        not_kinematic = not files and self.plant.kind != "kinematic"
        of_samples = "is of the thesis's costs on samples; set cost and data = samples"
        for wrong, section, key, message in (
            (other_path, "accept", "held_out_file",
             "another path needs path.kind = lissajous and its file; leave it out"),
            (not_kinematic, "identify", "data",
             "samples come from the kinematic plant only; set plant.kind = kinematic"),
            (ml and "form" in stated, "identify", "form",
             "the thesis prints no ml; choose one of its costs, or vector"),
            (ml and "parameters" in stated, "identify", "parameters",
             "is of the thesis's costs; ml has identify.model and corrections"),
            (missing, "identify", "cost",
             f"needs encoders on {', '.join(missing)}, which are not in encoders.fitted"),
            *(((ml or files) and key in stated, "identify", key, of_samples)
              for key in ("rod_sign", "shift_rounds", "instants")),
            ("smoothing" in stated and (ml or not files), "identify", "smoothing",
             "is of the thesis's costs on logs; set cost and data = files"),
            ("pairing" in stated and (ml or not files or "smoothing" in stated),
             "identify", "pairing",
             "is of a thesis cost on files, and smooths itself; set cost, no smoothing"),
            (settings.shift_rounds and "instants" in stated, "identify", "instants",
             "a log is moved with evenly spread samples only; leave instants out"),
            (settings.rod_sign and settings.shift_rounds, "identify", "rod_sign",
             "the sign of the force is of logs on one clock; leave shift_rounds out"),
            (settings.rod_sign and settings.form != "vector", "identify", "rod_sign",
             "the rod's deviation is linear in the vector form only; set form = vector"),
        ):  # fmt: skip
            if wrong:
                raise wrong_key(section, key, message=message)
        return self


def scenario_file(name: str | Path) -> Path:
    """The file of a scenario: the path itself, or the shipped scenario of that name.

    name : a path, or a bare name such as `irb2400`. Raises DescriptionError when a bare name is
    neither a file here nor a shipped scenario.
    """
    return named_file(str(Path(name)), SCENARIOS)


def load_scenario(
    path: str | Path, *, overrides: Sequence[str] = (), moving: bool = False
) -> Scenario:
    """The checked scenario of a file, or the shipped one of a bare name.

    overrides : texts `KEY=VALUE`, such as `seed=2`, that replace values of the file. moving :
        whether the robot must move.

    Raises DescriptionError naming file, line and key, and for still poses where it must move.
    """
    scenario = parse_model(
        load_extended(scenario_file(path), SCENARIOS, overrides=overrides), Scenario
    )
    if moving:
        try:
            _ = scenario.needed_path
        except InputError as error:
            raise DescriptionError(f"{scenario_file(path)}: {error}") from None
    return scenario


def with_absolute_names(scenario: Scenario, folder: Path) -> Scenario:
    """The scenario with absolute names of its robot, ball-bar and plate files."""
    return _renamed(scenario, lambda _, name: str((folder / name).resolve()))


def with_copied_descriptions(scenario: Scenario, folder: Path, recording: Path) -> Scenario:
    """The scenario whose robot, ball-bar and plate files are copies in a recording's folder.

    recording.yaml or poses.yaml takes over their names, so that the folder can be moved. folder :
    of the scenario's file.
    """
    return _renamed(scenario, lambda key, name: copied_description(recording, key, folder / name))


def _renamed(scenario: Scenario, rename: Callable[[str, str], str]) -> Scenario:
    """The scenario with other names of the description files of its cell that are not shipped."""
    names = scenario.cell.model_dump(include={"robot", "ballbar", "instrument", "plate"})
    own = {k: rename(k, name) for k, name in names.items() if (name or "").endswith(".yaml")}
    return scenario.model_copy(update={"cell": scenario.cell.model_copy(update=own)})


def scenario_path(recording: Path) -> Path:
    """File of the scenario that made a simulated recording: beside its folder, as the truth is."""
    return beside(recording, ".scenario.yaml")


def write_scenario(scenario: Scenario, folder: Path, recording: Path) -> None:
    """Writes the scenario of a simulated recording, complete and without `extends`.

    The files that it names are copied into the recording. folder : of the scenario file.
    recording : folder of the recording.
    """
    path = scenario_path(recording)
    data = scenario.model_dump(mode="json", exclude_unset=True)
    write_yaml(path, portable(data, SCENARIOS, folder, recording, path.parent))
