"""A scenario: everything about one simulated run, its identification, and what counts as acceptable."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from cell.schema import Strict
from cell.strict_yaml import load_model
from sim.settings import SimulationSettings


class IdentifySettings(Strict):
    """How the recording is identified."""

    cost: Literal["ml"] = "ml"
    samples: Annotated[int, Field(ge=50, le=100_000)] = 1500


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
