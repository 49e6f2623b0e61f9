"""Parameters as the page prints them: name, default, unit and description, from the settings' models."""

from __future__ import annotations

from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from sim.settings import SimulationSettings

UNITS = {  # by the end of the parameter's name, the longest first
    "N_per_m": "N/m",
    "N_m": "N m",
    "_ppm": "ppm",
    "_rad": "rad",
    "_deg": "deg",
    "_hz": "Hz",
    "_m": "m",
    "_s": "s",
    "_N": "N",
}


def unit_of(name: str) -> str:
    """The unit that a parameter's name ends with; empty for none."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def models_in(annotation: object) -> list[type[BaseModel]]:
    """Settings models that a field may hold, also inside tuples, options and choices."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def field_at(key: str) -> FieldInfo:
    """The field of the settings that a dotted key names."""
    model: type[BaseModel] = SimulationSettings
    *parents, last = key.split(".")
    for parent in parents:
        (model,) = models_in(model.model_fields[parent].annotation)
    return model.model_fields[last]


def value_text(value: object) -> str:
    """A value as one writes it in a scenario, to four digits."""
    if value is None:
        return "null"
    if value == "":
        return '""'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.4g}"
    if "e" not in text and (value == 0.0 or 1e-3 < abs(value) < 1e4):
        return text if "." in text else text + ".0"
    mantissa, exponent = f"{value:.3e}".split("e")
    mantissa = mantissa.rstrip("0")
    return (
        f"{mantissa}0e{int(exponent)}" if mantissa.endswith(".") else f"{mantissa}e{int(exponent)}"
    )


def parameter_text(name: str, info: FieldInfo) -> str:
    """Name, default, unit and description of one parameter."""
    default = "required" if info.default is PydanticUndefined else value_text(info.default)
    parts = [
        f"`{name}: {default}`",
        unit_of(name),
        f"({' or '.join(choices)})" if (choices := choices_of(info.annotation)) else "",
    ]
    described = description(info)
    return " ".join(part for part in parts if part) + (f": {described}" if described else "")


def description(info: FieldInfo) -> str:
    """What the settings say of a field; empty for nothing."""
    return info.description or ""


def choices_of(annotation: object) -> list[str]:
    """The words that a field of words may hold."""
    parts = get_args(annotation)
    return (
        [str(part) for part in parts]
        if parts and all(isinstance(part, str) for part in parts)
        else []
    )
