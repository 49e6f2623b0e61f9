"""Sources that act on paired samples (`identify: {data: samples}`, kinematic plant)."""

from __future__ import annotations

from generators.scenario_reference.plots import KINEMATIC, error, residual_plot, sensor_plot
from generators.scenario_reference.runs import merged
from generators.scenario_reference.sources.source import Source

PAIRS = (
    Source(
        "errors.synchronisation",
        "The sample of time t pairs `b(t)` with `q(t + delay_s)`.",
        "Paired samples only (`identify.data: samples`); device logs have clocks.offset_s.",
        "No default: the size is what a study varies. Thesis secs. 2.3, 3.5, Fig. 3.4.",
        "Residual of the tool's speed times the delay. Plotted: 1 ms.",
        residual_plot(merged(KINEMATIC, error("synchronisation", delay_s=1e-3)), off=KINEMATIC),
    ),
    Source(
        "errors.rod_deviation",
        "`bd3 + A (s - mean(s))`, s = +1 where the rod is pulled, -1 where it is pushed: while its "
        "end rises or sinks, or moves one way or the other around the base, kept where it stands "
        "still; or over drawn stretches of 2 s.",
        "Paired samples only: the robot follows the longer or shorter rod. Device logs have "
        "rod_backlash and rod_strain (MuJoCo).",
        'No default. Thesis secs. 2.3, 3.5, Fig. 3.5 ("ball-bar backlash"); '
        "where the sign changes is chosen here.",
        "The rod's length jumps by 2 A where the sign changes. Plotted: 10 um, rising.",
        residual_plot(
            merged(KINEMATIC, error("rod_deviation", amplitude_m=1e-5)), off=KINEMATIC, um=True
        ),
    ),
    Source(
        "errors.truncation",
        "`rint(b / step_rad) step_rad`.",
        "Paired samples only; device logs have encoders.bits.",
        "No default. Thesis secs. 2.3, 3.5, Fig. 3.6.",
        "Steps; in motion they look like noise of step / sqrt(12). Plotted: 100 urad.",
        sensor_plot(5, error("truncation", step_rad=1e-4), x="time", window=(2.0, 3.0), points=101),
    ),
)
