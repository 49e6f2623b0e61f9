"""Sources in the geometry: robot and ball-bar stand otherwise than their descriptions say."""

from __future__ import annotations

import numpy as np

from ballbar.sim.errors.static_errors import AXIS_ANGLES, AXIS_ENDS, AXIS_OFFSETS
from generators.scenario_reference import signals
from generators.scenario_reference.plots import KINEMATIC, Plot, Source, T, error, residual_plot
from generators.scenario_reference.runs import Changes, merged

STATIC_OFF: Changes = {"errors": {"static": None}, "plant": {"kind": "kinematic"}}
GEOMETRY = (
    Source(
        "errors.static",
        "`true = nominal + deviation` of the table, or `+ sigma z`.",
        "thesis Table 3.1, or as thesis sec. 3.1 draws.",
        Plot(
            signals.time,
            lambda view: 1e3 * np.linalg.norm(view.residual, axis=1),
            (T, "tool, bar - robot [mm]"),
            {
                "Table 3.1": KINEMATIC,
                "drawn": merged(KINEMATIC, error("static", sigma_m=1e-3, sigma_rad=1e-3)),
                "drawn, all": merged(
                    KINEMATIC, error("static", sigma_m=1e-3, sigma_rad=1e-3, parameters="all")
                ),
            },
            STATIC_OFF,
        ),
    ),
    Source(
        "errors.thermal_growth",
        "`a2 = a2(0) + a2_m s`, `d4` too; `s = t / T`, or `(1 - exp(-t / tau)) / (1 - "
        "exp(-T / tau))`, T the length of the run.",
        "assumed: links of 0.7 m of aluminium that warm by 2.5 K.",
        residual_plot(
            merged(KINEMATIC, error("thermal_growth", time_constant_s=20.0)), off=KINEMATIC, um=True
        ),
    ),
    Source(
        "errors.ballbar_axes",
        f"`sigma_m z` on {', '.join(AXIS_OFFSETS)}; `sigma_rad z` on {', '.join(AXIS_ANGLES)}; "
        f"with `all` on {', '.join(AXIS_ENDS)} too.",
        "",
        residual_plot(merged(KINEMATIC, error("ballbar_axes")), off=KINEMATIC, um=True),
    ),
    Source(
        "errors.base_tilt",
        "`otx, oty = sigma_rad z`, about x, then y.",
        "",
        residual_plot(merged(KINEMATIC, error("base_tilt")), off=KINEMATIC),
    ),
    Source(
        "errors.motor_offsets",
        "`rtheta = nominal + (sigma_rad z) @ T`, T the transmission matrix.",
        "",
        residual_plot(merged(KINEMATIC, error("motor_offsets")), off=KINEMATIC),
    ),
    Source(
        "errors.plate_length",
        "`ra6 = nominal + sigma_m z`.",
        "plate file.",
        residual_plot(merged(KINEMATIC, error("plate_length")), off=KINEMATIC, um=True),
        of_machine=("m, sigma", lambda cell: cell.plate.length_sigma),
    ),
)
