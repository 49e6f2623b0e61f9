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
        "`true = nominal + deviation`; of the table, or `sigma z` with z normal, one draw a "
        "parameter.",
        "Geometry: DH rows of robot and ball-bar, base position; encoder zeros are drawn anyhow.",
        "Table: thesis Table 3.1. Drawn: no default; thesis sec. 3.1 draws 1 mm and 1 mrad.",
        "What calibration is for: millimetres that follow the pose. Drawn: 1 mm, 1 mrad.",
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
        "Motion of either plant: the ball-bar keeps the tool's pose, joints and motors turn until "
        "the longer arm fits; before a rod or wire the tool moves. Loads stay as they are.",
        "Assumed: links of 0.7 m of aluminium (2.3e-5 /K, EN 1999-1-1 cl. 3.2.5) that warm by "
        "2.5 K.",
        "The loop closes at the start and opens with time, by the direction of both links.",
        residual_plot(
            merged(KINEMATIC, error("thermal_growth", time_constant_s=20.0)), off=KINEMATIC, um=True
        ),
    ),
    Source(
        "errors.ballbar_axes",
        f"`sigma_m z` on {', '.join(AXIS_OFFSETS)}; `sigma_rad z` on {', '.join(AXIS_ANGLES)}; "
        f"with `all` on {', '.join(AXIS_ENDS)} too.",
        "Geometry: ball-bar rows.",
        "Assumed.",
        "Residual of the order of rod length times squareness error.",
        residual_plot(merged(KINEMATIC, error("ballbar_axes")), off=KINEMATIC, um=True),
    ),
    Source(
        "errors.base_tilt",
        "`otx, oty = sigma_rad z`, about x, then y.",
        "Geometry: base of the ball-bar.",
        "Assumed; the thesis's model has no base tilt.",
        "Residual of rod length times tilt, smooth over the sphere.",
        residual_plot(merged(KINEMATIC, error("base_tilt")), off=KINEMATIC),
    ),
    Source(
        "errors.motor_offsets",
        "`rtheta = nominal + (sigma_rad z) @ T`, z one draw a motor, T the transmission matrix.",
        "Geometry: joint offsets of the robot, but of axis 1.",
        "Assumed: a calibration by marks; within the 1 mrad of thesis sec. 3.1 at the joints.",
        "As joint offsets; an offset of motor 4 or 5 turns the wrist's joints behind it too.",
        residual_plot(merged(KINEMATIC, error("motor_offsets")), off=KINEMATIC),
    ),
    Source(
        "errors.plate_length",
        "`ra6 = nominal + sigma_m z`, one draw.",
        "Geometry: the one known length.",
        "Plate file, assumed: what a coordinate measuring machine gives.",
        "Its own size in the residual; a fit takes it for scale and gets all lengths wrong by the "
        "same share.",
        residual_plot(merged(KINEMATIC, error("plate_length")), off=KINEMATIC, um=True),
        of_machine=("m, standard deviation", lambda cell: cell.plate.length_sigma),
    ),
)
