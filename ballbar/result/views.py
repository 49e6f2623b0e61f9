"""Views of a calibration: tables, figures, page, files, and its words in a notebook."""

from __future__ import annotations

from html import escape
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ballbar.cell.errors import InputError
from ballbar.ident.robot.budget import Budget
from ballbar.ident.verdict import Status
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.names import OUTPUTS
from ballbar.result.run_data import RunData

if TYPE_CHECKING:  # a result is computed without tables and figures
    import pandas as pd
    from matplotlib.axes import Axes

FrameName = Literal["parameters", "corrections", "residuals"]
SHORT = 12  # rows of parameters in a notebook


class Views:
    """Views of a calibration; those of residuals, report and files need a fresh one."""

    file: CalibrationFile
    run: RunData | None

    @property
    def data(self) -> RunData:
        """Measurements and fit.

        Raises InputError for a calibration that was read back from its file, which lacks it.
        """
        if self.run is None:
            raise InputError(
                "the calibration was read back, and its file holds neither logs nor residuals. "
                "Identify again, or keep the result of ballbar.identify by pickle."
            )
        return self.run

    @property
    def sentence(self) -> str:
        """The verdict on the fit."""
        return self.file.fit.verdict

    @property
    def budget(self) -> Budget | None:
        """Parts of the stated TCP uncertainty; None of a file of an older version."""
        entry = self.file.uncertainty_budget
        return None if entry is None else entry.budget

    @property
    def warnings(self) -> tuple[str, ...]:
        """Remarks on the fit."""
        return self.file.fit.warnings

    @property
    def acceptable(self) -> bool:
        """Whether the verdict and all held-out parts are acceptable."""
        good = Status(self.file.fit.status).acceptable
        return good and all(part.acceptable for part in self.file.held_out)

    def to_frame(self, of: FrameName = "parameters") -> pd.DataFrame:
        """A table of the calibration, in SI units.

        of : `parameters`, by recording (empty for what all share) and name; coefficients of the
            `corrections`; or `residuals` [m, rad] in the robot's base frame, before (nominal robot)
            and after the fit, by recording or seat and target.

        Raises InputError for residuals of a calibration that was read back.
        """
        from ballbar.result import frames  # noqa: PLC0415  imports pandas

        if of == "residuals":
            return frames.residuals(self.data)
        return frames.parameters(self.file) if of == "parameters" else frames.corrections(self.file)

    def plot_parameters(self, axes: Axes | None = None) -> Axes:
        """Axes with the deviation of each identified parameter from the catalogue, with 2 sigma."""
        from ballbar.result import figures  # noqa: PLC0415  imports matplotlib

        return figures.parameters(self.to_frame(), axes)

    def plot_residuals(self, axes: Axes | None = None) -> Axes:
        """Axes with the share of samples and poses whose residual is below a length, before and
        after the fit.

        Raises InputError for a calibration that was read back.
        """
        from ballbar.result import figures  # noqa: PLC0415

        return figures.residuals(self.to_frame("residuals"), axes)

    def report(self, path: str | PathLike[str], *, command: str = "ballbar.identify") -> None:
        """Write the report, a page that needs no other file.

        command : how it was made. Raises InputError for a calibration that was read back.
        """
        from ballbar.report.page import write_report  # noqa: PLC0415  imports Jinja

        write_report(Path(path), self.data, command=command)

    def save(self, folder: str | PathLike[str]) -> None:
        """Write calibration, report and import report, as `ballbar identify --out FOLDER` does.

        Raises InputError where the folder holds anything else, for a calibration that was read
        back, and for arrays of a robot, ball-bar or plate that is not shipped.
        """
        from ballbar.cell.files import claimed_folder  # noqa: PLC0415
        from ballbar.outputs import write_outputs  # noqa: PLC0415  writes what this module shows

        data = self.data
        with claimed_folder(Path(folder), OUTPUTS, "the result"):
            write_outputs(Path(folder), data)

    def __repr__(self) -> str:
        return f"<Calibration of {self.file.robot}: {self.sentence}>"

    def _repr_html_(self) -> str:
        """The verdict, remarks, and the first parameters for a notebook."""
        remarks = "".join(f"<li>{escape(warning)}</li>" for warning in self.warnings)
        frame = self.to_frame()
        shown = frame[frame["identified"]].drop(columns="identified")
        table = shown.to_html(max_rows=SHORT, float_format="{:.6g}".format)
        return f"<p><b>{escape(self.sentence)}</b></p><ul>{remarks}</ul>{table}"
