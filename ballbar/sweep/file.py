"""Schema of a sweep file: one scenario, what changes in it, what varies, the seeds.

    schema: ballbar-sweep/1
    name: noise
    scenario: ../irb2400.yaml                       # relative to this file
    change: {plant.kind: kinematic}                 # once, for every run
    together:                                       # several keys at once; `label` names the row
      - {label: soft, errors: {rod_strain: {}}}
    vary: {errors.joint_noise.sigma_rad: [1.0e-6, 1.0e-5]}    # a grid: every combination
    draw: {clocks.offset_s: {uniform: [-1.0, 1.0]}} # drawn `draws` times, crossed with the grid
    draws: 10
    seed: 0                                         # of the draws; each key has its own stream
    seeds: {first: 1, count: 20}                    # of the runs

A dotted key names a value of the scenario, at any depth; `.0` picks an item of a list. Under
`change` and `together` a mapping is more keys of the same kind, so `errors: {rod_strain: {}}` is
`errors.rod_strain: {}`. Under `vary` each listed value replaces the whole value at its key. Nothing
is evaluated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from ballbar.cell.extended_yaml import SHIPPED, ExtendableKind, Value, load_extended, overlap
from ballbar.cell.schema import Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import YamlDocument, parse_model

LABEL = "label"  # name of a row of `together`: a column of the table, no key of the scenario
SEED = "seed"  # of a run, given under `seeds`

Changes = dict[str, Value]  # dotted key of the scenario -> value
Pair = tuple[float, float]


class Draw(Strict):
    """Distribution of one drawn value; exactly one key is given."""

    uniform: Pair | None = Field(None, description="Lower and upper bound.")
    log_uniform: Pair | None = None
    """Lower and upper bound, both above 0; the logarithm is uniform."""
    normal: Pair | None = Field(None, description="Mean and standard deviation.")

    @model_validator(mode="after")
    def _one_distribution(self) -> Draw:
        if len(self.model_fields_set) != 1 or None in (
            getattr(self, kind) for kind in self.model_fields_set
        ):
            raise ValueError("give exactly one of uniform, log_uniform, normal")
        low, high = self.uniform or self.log_uniform or (0.0, 1.0)
        if low >= high:
            raise ValueError("the first bound must be below the second")
        if self.log_uniform and low <= 0.0:
            raise ValueError("both bounds of log_uniform must be above 0")
        if self.normal and self.normal[1] < 0.0:
            raise ValueError("the standard deviation must be 0 or more")
        return self

    def at(self, variate: float) -> float:
        """The value for a standard normal variate, or for one uniform on [0, 1)."""
        if self.normal:
            mean, deviation = self.normal
            return mean + deviation * variate
        if self.uniform:
            low, high = self.uniform
            return low + (high - low) * variate
        low, high = self.log_uniform or (1.0, 1.0)
        value = low * math.exp(math.log(high / low) * variate)
        return min(max(value, low), high)  # rounding must not leave the bounds


class Seeds(Strict):
    """Consecutive seeds of the runs; each point runs with every one of them."""

    first: Annotated[int, Field(ge=0, le=2**62)] = Field(1, description="The lowest seed.")
    count: Annotated[int, Field(ge=1, le=2**62)] = Field(description="How many seeds.")


class SweepFile(Strict):
    """One YAML file of scenarios/sweeps/."""

    schema_: Annotated[Literal["ballbar-sweep/1"], Field(alias="schema")]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_\-]+$")]
    scenario: str = Field(description="Scenario file, relative to this file.")
    change: dict[str, Any] = Field(
        {}, description="Values that replace those of the scenario file in every run."
    )
    together: Annotated[list[dict[str, Any]], Field(min_length=1)] | None = None
    """Rows of values that change together."""
    vary: dict[str, Annotated[list[Any], Field(min_length=1)]] = Field(
        {}, description="Values of the grid, of which every combination is run."
    )
    draw: dict[str, Draw] = Field({}, description="Distributions of drawn values.")
    draws: Annotated[int, Field(ge=1, le=10_000_000)] | None = None
    """Number of draws."""
    seed: Annotated[int, Field(ge=0, le=2**62)] = Field(0, description="Seed of the draws.")
    seeds: Seeds = Field(description="Seeds of the runs.")

    @model_validator(mode="after")
    def _draws_are_counted(self) -> SweepFile:
        if self.draw and self.draws is None:
            raise wrong_key("draw", message="the number of draws is missing: add `draws: N`")
        if self.draws is not None and not self.draw:
            raise wrong_key(
                "draws",
                message="nothing is drawn: remove it, or add `draw: {key: {uniform: [low, high]}}`",
            )
        return self

    @model_validator(mode="after")
    def _each_key_once(self) -> SweepFile:
        """No value is set twice in one run, `change` apart, which the others override.

        The seed of a run is set by none of the sections.
        """
        together = sorted({key for row in self.together or [] for key in flattened(row)})
        keys = {"together": together, "vary": self.vary, "draw": self.draw}
        varied = [(section, key) for section, names in keys.items() for key in names]
        for section, key in (*(("change", key) for key in flattened(self.change)), *varied):
            if key == SEED:
                raise wrong_key(section, key, message="the seeds of the runs are given under seeds")
        for (first, key), (second, other) in itertools.combinations(varied, 2):
            if overlap(key, other) and not first == second == "together":
                message = f"{key} is given under {first} already; remove one of them"
                raise wrong_key(second, other, message=message)
        return self


SWEEPS = ExtendableKind(what="sweep", shipped=SHIPPED / "sweeps", files=("scenario",))


def load_sweep_file(path: Path, overrides: Sequence[str] = ()) -> tuple[SweepFile, YamlDocument]:
    """The checked sweep, and the document that knows its lines.

    overrides : texts `KEY=VALUE`, such as `seeds.count=40`, that replace values of the file.

    Raises DescriptionError naming file, line and key.
    """
    document = load_extended(path, SWEEPS, overrides=overrides)
    return parse_model(document, SweepFile), document


def flattened(mapping: dict[str, Value]) -> Changes:
    """Nested mappings as dotted keys: {a: {b: 1}, c: {}} -> {a.b: 1, c: {}}.

    Raises ValueError when a key comes twice.
    """
    flat: Changes = {}
    for key, value in mapping.items():
        inner = flattened(value) if isinstance(value, dict) and value else {"": value}
        for below, leaf in inner.items():
            dotted = f"{key}.{below}" if below else key
            if dotted in flat:
                raise ValueError(f"{dotted} is given twice; remove one")
            flat[dotted] = leaf
    return flat
