"""What a certificate states that no recording shows: `job.yaml`, filled in by hand.

Every key may be left out or empty; the certificate then prints that it is missing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from ballbar.cell.errors import InputError
from ballbar.cell.schema import Line, NotNegative, Positive, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import check_schema, load_yaml, parse_model
from ballbar.certificate.conformity import RuleName
from ballbar.ident.options import FitOptions
from ballbar.identify_settings import IdentifySettings
from ballbar.result.names import RECORDING

DETAILS = "ballbar-certificate-details/1"
TEMPLATE = Path(__file__).with_name("job.yaml")
_OF_THE_FIT = {"samples", "model", "corrections", "force", "rod_sigma_m", "accuracy_mm"}

Date = Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]  # ISO 8601
Celsius = Annotated[float, Field(ge=-50.0, le=100.0)]


class RobotDetails(Strict):
    """Identity of the robot."""

    maker: Line | None = None
    type: Line | None = None
    serial_number: Line | None = None
    controller: Line | None = None
    controller_serial_number: Line | None = None
    software: Line | None = None


class StandardDetails(Strict):
    """A standard that the lengths come from, and its own calibration."""

    maker: Line | None = None
    type: Line | None = None
    serial_number: Line | None = None
    calibrated: Date | None = None
    calibrated_by: Line | None = None
    certificate: Line | None = None
    uncertainty: Line | None = None


class ToleranceDetails(Strict):
    """Limits of the TCP error over the workspace, and the rule that decides about them."""

    mean_mm: Positive | None = None
    largest_mm: Positive | None = None
    rule: RuleName = "guarded"
    guard_factor: Annotated[float, Field(ge=0.0, le=5.0)] = 1.0
    coverage_factor: Annotated[float, Field(gt=0.0, le=3.0)] = 2.0
    probability: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.95

    @model_validator(mode="after")
    def _states_a_limit(self) -> ToleranceDetails:
        if self.mean_mm is None and self.largest_mm is None:
            message = "states no limit: give mean_mm, largest_mm or both, or remove `tolerance`"
            raise wrong_key("mean_mm", message=message)
        return self


class CertificateDetails(Strict):
    """The content of `job.yaml`."""

    schema_: Literal["ballbar-certificate-details/1"] = Field(alias="schema")
    recordings: tuple[Line, ...] | None = None
    """Folders or files that were fitted, from the folder of this file."""
    validate_: tuple[Line, ...] | None = Field(alias="validate", default=None)
    """The same, held out."""
    identify: IdentifySettings | None = None
    """Settings that the result was identified with, where they were not the defaults."""
    number: Line | None = None
    laboratory: Line | None = None
    customer: Line | None = None
    robot: RobotDetails | None = None
    instrument: StandardDetails | None = None
    plate: StandardDetails | None = None
    operator: Line | None = None
    place: Line | None = None
    measured: Date | None = None
    issued: Date | None = None
    temperature_C: Celsius | None = None
    temperature_spread_C: NotNegative | None = None
    load_kg: NotNegative | None = None
    load: Line | None = None
    tolerance: ToleranceDetails | None = None
    traceability: Line | None = None
    remarks: tuple[Line, ...] | None = None

    @model_validator(mode="after")
    def _settings_are_of_the_fit(self) -> CertificateDetails:
        stated = self.identify.stated if self.identify else []
        if wrong := [name for name in stated if name not in _OF_THE_FIT]:
            options = ", ".join(sorted(_OF_THE_FIT))
            raise wrong_key("identify", wrong[0], message=f"expected one of {options}")
        return self

    @property
    def options(self) -> FitOptions:
        """The options of the fit."""
        return (self.identify or IdentifySettings()).options


def load_details(path: Path) -> CertificateDetails:
    """The details in a file. Raises DescriptionError naming file, line and key."""
    document = load_yaml(path)
    check_schema(document, DETAILS, "Begin with ballbar certificate --template.")
    return parse_model(document, CertificateDetails)


def measured_places(details: CertificateDetails, file: Path, result: Path) -> list[list[Path]]:
    """Places of what was fitted, and of what was held out.

    file : of the details. result : calibration.yaml, beside which `ballbar run` leaves what it
    fitted.

    Raises InputError where neither says what was fitted, or where nothing is there.
    """
    fitted = [file.parent / name for name in details.recordings or ()]
    if not fitted:
        fitted = [result.parent / RECORDING]
        if not fitted[0].exists():
            what = "names no `recordings`, and none lies beside the result."
            raise InputError.at(file, what, "Name the folders that it was identified from.")
    held_out = [file.parent / name for name in details.validate_ or ()]
    for place in (*fitted, *held_out):
        if not place.exists():
            raise InputError.at(place, "no such folder or file.", f"Correct its name in {file}.")
    return [fitted, held_out]


def stated_details(details: CertificateDetails) -> Iterator[tuple[str, object]]:
    """Keys and values as they are printed; the places of files and settings are no part of it."""
    content = details.model_dump(by_alias=True, mode="json")
    for key, value in content.items():
        if key not in ("schema", "recordings", "validate", "identify"):
            yield key, value
