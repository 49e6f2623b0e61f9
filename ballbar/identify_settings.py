"""How a recording is identified: options of `ballbar identify`, and key `identify` of scenarios."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from ballbar.cell.schema import Strict
from ballbar.ident.corrections import CORRECTIONS
from ballbar.ident.options import FitOptions, ForceSource, ModelName
from ballbar.ident.thesis.names import (
    PRINTED_STOP,
    Instants,
    Pairing,
    ParameterSet,
    ShiftAt,
    Smoothing,
)


def _unless_auto(value: object) -> object:
    if value == "auto":
        return None
    return tuple(value) if isinstance(value, list) else value


Corrections = Annotated[
    tuple[Annotated[str, AfterValidator(CORRECTIONS.known)], ...], Field(min_length=1)
]


class IdentifySettings(Strict):
    """How the recording is identified."""

    cost: Literal["ml", "length", "position", "position_angles", "transform"] = "ml"
    """Maximum likelihood of the whitened loop closure with the clock as parameter, or a cost
    function of thesis eqs. 2.1-2.4.
    """
    form: Literal["vector", "thesis"] = "vector"
    """Form of a thesis cost: signed components, or the printed scalar."""
    data: Literal["files", "samples"] = "files"
    """Device logs through reader and clock alignment; or the angles of both logs at the same
    instants (thesis ch. 3), of the kinematic plant only.
    """
    samples: Annotated[int, Field(ge=50, le=100_000)] = 1500
    """Instants of the fit at most; of device logs none are closer than they are smoothed."""
    parameters: ParameterSet = "core"
    """With a thesis cost: encoder offsets, origin, robot and rod, or all of thesis sec. 3.3."""
    relative_stop: Annotated[float, Field(gt=0.0, le=1e-2)] = PRINTED_STOP
    """Relative decrease of a printed scalar's cost, or size of its step, at which to end; not
    printed in the thesis.
    """
    smoothing: Smoothing = "none"
    """With a thesis cost on files: none, a moving average of 100 ms (thesis sec. 5.2), or the
    splines of ml.
    """
    pairing: Pairing = "fit"
    """Clock and start of a thesis cost on files: those of the default fit, or `logs`, the thesis's
    procedure (sec. 5.2): moving average, rough synchronisation where all joints stand still,
    encoder offsets matched at a few points, shift of least cost, and with every cost the same
    parameters of the robot (sec. 5.4).
    """
    instants: Instants = "all"
    """Samples of a thesis cost: all, or those at which the robot stands still, moves, or moves at
    nearly constant speed (thesis ch. 7).
    """
    rod_sign: bool = False
    """Vector cost on samples: the elongation of the rod is unknown, the sign of its force known
    (thesis ch. 6).
    """
    shift_rounds: Annotated[int, Field(ge=0, le=50)] = 0
    """Cost on samples: how often to move a log to the least cost before the fit (thesis sec.
    5.2).
    """
    shift_at: ShiftAt = "identified"
    """Geometry of each move: identified before it, or nominal with encoder offsets matched at a few
    points (thesis sec. 5.2).
    """
    model: ModelName = "auto"
    """Kinematics alone (dh), with corrections (complete), or chosen by the data."""
    corrections: Annotated[
        Corrections | None,
        BeforeValidator(_unless_auto, json_schema_input_type=Corrections | None | Literal["auto"]),
    ] = None
    """Corrections of the complete model; `auto` takes those that the data support."""
    force: ForceSource = "auto"
    """Source of the rod's force; `auto` takes the best signal that was logged."""
    rod_sigma_m: Annotated[float, Field(gt=0.0, le=0.01)] | None = None
    """Sigma of a measured rod, whose length is bd3 in the ball-bar's file; by default the
    catalogue's tolerance.
    """

    accuracy_mm: Annotated[float, Field(gt=0.0)] | None = None
    """Stated TCP uncertainty (1 sigma, rms over the workspace, with the scale) up to which a result
    is acceptable; by default half of the nominal robot's error, at least 0.1 mm.
    """

    @property
    def stated(self) -> list[str]:
        """Names of the settings that are not at their defaults."""
        fields = type(self).model_fields
        return [name for name in fields if getattr(self, name) != fields[name].default]

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
