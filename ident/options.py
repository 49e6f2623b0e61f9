"""Options of an identification, and the listener that hears of its progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Literal

from ballbar.ident.corrections import CORRECTIONS

if TYPE_CHECKING:
    from ballbar.cell.processes import Begin

DEFAULT_SAMPLES = 1500  # thesis sec. 3.5

ModelName = Literal["auto", "dh", "complete"]
ForceSource = Literal["auto", "none", "torque", "sensor"]


@dataclass(frozen=True)
class JointErrors:
    """Joint errors learned elsewhere: their amplitudes are kept."""

    orders: tuple[tuple[int, float], ...]  # joint, from 0, and order
    values: tuple[float, ...]  # [rad] cosine and sine amplitude of each


@dataclass(frozen=True)
class FitOptions:
    """Options of an identification. Raises ValueError for an unknown correction."""

    # `dh`: the parameters of thesis Table 3.1; `complete`: with corrections; `auto`: complete where
    # the kinematics alone leave something
    model: ModelName = "auto"
    # of ballbar.ident.corrections; None: those that data support
    corrections: tuple[str, ...] | None = None
    force: ForceSource = "auto"  # where the rod's force comes from; auto: the best logged signal
    rod_sigma: float | None = None  # [m] of a measured rod length (bd3 is then that length)
    samples: int = DEFAULT_SAMPLES  # of each recording
    # [m] stated TCP uncertainty that is asked for; None: half of the nominal robot's error
    accuracy: float | None = None
    # of still poses without recordings: searched, left out, or those learned elsewhere
    joint_errors: Literal["auto", "none"] | JointErrors = "auto"

    def __post_init__(self) -> None:
        for name in self.corrections or ():
            CORRECTIONS.known(name, f" correction {name!r}")

    @property
    def of_logs(self) -> list[str]:
        """Names of the options that are not at their defaults and that still poses do not have."""
        changed = [f.name for f in fields(self) if getattr(self, f.name) != f.default]
        return [name for name in changed if name != "joint_errors"]


@dataclass(frozen=True)
class Listener:
    """Callbacks of an identification."""

    progress: Callable[[str], None] = lambda _: None  # called with a sentence at each stage
    begin: Begin = partial  # takes over work while other work is done here


DEFAULTS = FitOptions()
SILENT = Listener()
