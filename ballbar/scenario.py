"""A scenario: everything about one simulated run, its identification, and what counts as acceptable."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from cell.schema import Strict
from cell.strict_yaml import load_model
from ident.corrections import CORRECTIONS
from ident.identify import ModelName
from ident.machine import ForceSource
from sim.settings import SimulationSettings


def _known_correction(name: str) -> str:
    if name not in CORRECTIONS:
        raise ValueError(f"unknown; there are {', '.join(CORRECTIONS)}")
    return name


def _unless_auto(value: object) -> object:
    if value == "auto":
        return None
    return tuple(value) if isinstance(value, list) else value


Corrections = Annotated[tuple[Annotated[str, AfterValidator(_known_correction)], ...], Field(min_length=1)]


class IdentifySettings(Strict):
    """How the recording is identified."""

    cost: Literal["ml"] = "ml"
    samples: Annotated[int, Field(ge=50, le=100_000)] = 1500
    model: ModelName = Field("auto", description="Kinematics alone (dh), with corrections (complete), or what the recording asks for.")
    corrections: Annotated[Corrections | None, BeforeValidator(_unless_auto)] = Field(
        None, description="Of the complete model, by name; `auto` keeps those that the data support."
    )
    force: ForceSource = Field("auto", description="Where the rod's force comes from; auto takes the best signal that was logged.")
    rod_sigma_m: Annotated[float, Field(gt=0.0, le=0.01)] | None = Field(
        None, description="Of a measured rod: bd3 of the ball-bar's file is that length. Without it, the catalogue's tolerance."
    )


class AcceptSettings(Strict):
    """Limits against the truth; a run beyond one of them exits with code 1."""

    tcp_mean_mm: Annotated[float, Field(gt=0.0)] | None = Field(None, description="Mean TCP error over the accuracy grid.")
    tcp_max_mm: Annotated[float, Field(gt=0.0)] | None = Field(None, description="Largest TCP error over the accuracy grid.")
    parameter_distance_mm_mrad: Annotated[float, Field(gt=0.0)] | None = Field(
        None, description="Euclidean distance over the identified parameters, mm and mrad mixed (thesis sec. 3.4)."
    )
    clock_offset_us: Annotated[float, Field(gt=0.0)] | None = None
    clock_skew_ppm: Annotated[float, Field(gt=0.0)] | None = None
    iterations: Annotated[int, Field(gt=0)] | None = Field(None, description="From the automatic start to the result.")


class Scenario(SimulationSettings):
    """One YAML file of scenarios/."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
    identify: IdentifySettings = IdentifySettings()
    accept: AcceptSettings = AcceptSettings()


def load_scenario(path: Path) -> Scenario:
    """The checked scenario. Raises DescriptionError naming file, line and key."""
    return load_model(path, Scenario)
