"""Identifiability as the thesis prints it: Brand & Nilsson 2016, Tables 3.2 to 3.5, sec. 3.3.

Costs by this project's names (eqs. 2.1-2.4), parameters and groups in the notation of
ballbar.ident.estimator.dependencies. Table 3.1, the errors that were introduced, is
ballbar.sim.errors.static_errors.THESIS_3_1.
"""

from __future__ import annotations

from ballbar.ident.estimator.thesis_names import BAR_PARAMETERS, ENCODER_OFFSETS

THESIS_COSTS = {
    "length": "C_l",
    "position": "C_P",
    "position_angles": "C_Ptheta",
    "transform": "C_T",
}

_BY_ALL = ("rd2 | rd3", "rtheta1 | ox,y")
_WITH_DIRECTION = ("ra6 | bd3 | ba5", "rd1 | oz | bd1", *_BY_ALL, "rd6 | bd5")

TABLE_3_2: dict[str, tuple[str, ...]] = {  # dependencies: one of each group can be identified
    "length": ("ra6 | bd3", "rd1 | oz", *_BY_ALL),
    "position": (*_WITH_DIRECTION, "bd2 | balpha2"),
    "position_angles": _WITH_DIRECTION,
    "transform": (*_WITH_DIRECTION, "ralpha6 | balpha5"),
}

TABLE_3_3: dict[str, frozenset[str]] = {  # zero Jacobian
    "length": frozenset({*ENCODER_OFFSETS, *BAR_PARAMETERS, "ralpha6"}),
    "position": frozenset(
        {"ralpha6", "balpha3", "balpha4", "balpha5", "btheta3", "btheta4", "btheta5"}
    ),
    "position_angles": frozenset({"balpha3", "balpha4", "balpha5", "btheta3"}),
    "transform": frozenset(),
}

# sec. 3.3, all costs together
REMOVED = ("ra6", "ba5", "rd1", "bd1", "rd3", "rtheta1", "bd5", "balpha2", "balpha5")

MOST = "most parameters"
TABLE_3_4: dict[
    str, tuple[str, ...]
] = {  # moved by more than 0.05 mm|mrad by an error of 1 mm|mrad in the one left out
    "ra6": (MOST,),
    "ba5": (MOST,),
    "rd1": ("oz",),
    "bd1": ("oz",),
    "rd3": ("rd2",),
    "rtheta1": ("btheta1", "ox", "oy"),
    "bd5": ("rd6",),
    "balpha2": ("bd2", "bd3"),
    "balpha5": ("ralpha6",),
}

TABLE_3_5_IDENTIFIED = (
    frozenset(  # those with a number in Table 3.5; the others have a dash. The set of C_l
        {f"ra{i}" for i in (1, 2, 3, 4, 5)}
        | {f"rd{i}" for i in (2, 4, 5, 6)}
        | {f"ralpha{i}" for i in (1, 2, 3, 4, 5)}
        | {f"rtheta{i}" for i in (2, 3, 4, 5, 6)}
        | {"bd3", "ox", "oy", "oz"}
    )
)
