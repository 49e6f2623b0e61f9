"""Details of a certificate that no recording shows: `job.yaml`, which the user fills in.

Every key may be left out or empty; the certificate then prints that it is missing.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from ballbar.cell.errors import InputError
from ballbar.cell.schema import Day, Line, NotNegative, Strict
from ballbar.cell.schema_errors import wrong_key
from ballbar.cell.strict_yaml import check_schema, load_yaml, parse_model
from ballbar.cell.temperature import Celsius
from ballbar.certificate.conformity import Tolerance
from ballbar.identify_settings import IdentifySettings
from ballbar.result.names import RECORDING

DETAILS = "ballbar-certificate-details/1"
TEMPLATE = Path(__file__).with_name("job.yaml")
_OF_THE_FIT = {"samples", "model", "corrections", "force", "rod_sigma_m", "accuracy_mm"}


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
    calibrated: Day | None = None
    calibrated_by: Line | None = None
    certificate: Line | None = None
    uncertainty: Line | None = None


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
    """Number of the certificate."""
    laboratory: Line | None = None
    """Who issues it."""
    customer: Line | None = None
    """Whom it is for."""
    issued: Day | None = None
    """Day of issue."""
    robot: RobotDetails = RobotDetails()
    instrument: StandardDetails = StandardDetails()
    plate: StandardDetails = StandardDetails()
    operator: Line | None = None
    """Who measured."""
    place: Line | None = None
    """Where the measurement was made."""
    measured: Day | None = None
    """Day of measurement."""
    temperature_C: Celsius | None = None
    """Mean temperature of the air."""
    temperature_spread_C: NotNegative | None = None
    """Largest minus smallest temperature while it was measured."""
    load_kg: NotNegative | None = None
    """Mass at the flange."""
    load: Line | None = None
    """Kind of load."""
    tolerance: Tolerance | None = None
    """Limits of the error of the tool, and the decision rule."""
    traceability: Line | None = None
    """To which national standards, and by which chain."""
    remarks: tuple[Line, ...] | None = None
    """Sentences that the certificate prints as they are."""

    @model_validator(mode="after")
    def _is_complete_and_of_the_fit(self) -> CertificateDetails:
        limits = self.tolerance
        if limits is not None and limits.mean_mm is None and limits.largest_mm is None:
            what = "states no limit: give mean_mm, largest_mm or both, or remove `tolerance`"
            raise wrong_key("tolerance", message=what)
        for name in self.identify.stated if self.identify else ():
            if name not in _OF_THE_FIT:
                expected = f"expected one of {', '.join(sorted(_OF_THE_FIT))}"
                raise wrong_key("identify", name, message=expected)
        return self


def load_details(path: Path) -> CertificateDetails:
    """The details in a file. Raises DescriptionError naming file, line and key."""
    document = load_yaml(path)
    check_schema(document, DETAILS, "Begin with ballbar certificate --template.")
    return parse_model(document, CertificateDetails)


def measured_places(details: CertificateDetails, file: Path, result: Path) -> list[list[Path]]:
    """Places of the recordings that were fitted, and of those that were held out.

    file : of the details. result : calibration.yaml, beside which `ballbar run` leaves what it
    fitted.

    Raises InputError where neither says what was fitted, or where nothing is there.
    """
    named = details.recordings or (), details.validate_ or ()
    fitted, held_out = ([file.parent / name for name in names] for names in named)
    if not fitted and not (result.parent / RECORDING).exists():
        what = "names no `recordings`, and none lies beside the result."
        raise InputError.at(file, what, "Name the folders that it was identified from.")
    fitted = fitted or [result.parent / RECORDING]
    for place in (*fitted, *held_out):
        if not place.exists():
            raise InputError.at(place, "no such folder or file.", f"Correct its name in {file}.")
    return [fitted, held_out]
