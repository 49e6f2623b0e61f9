"""Sources in the angle sensors of robot and ball-bar, and in pairs of their samples."""

from __future__ import annotations

import numpy as np

from ballbar.sim.errors.sensor_effects import FREEZING_ONSET_HZ
from ballbar.sim.logging.encoders import SURE_BITS
from generators.scenario_reference import signals
from generators.scenario_reference.plots import (
    KINEMATIC,
    Plot,
    Source,
    T,
    error,
    residual_plot,
    sensor_plot,
)
from generators.scenario_reference.runs import Changes, merged

ROBOT_SENSORS = (
    Source(
        "errors.joint_noise",
        "`q + sigma z` at each row (thesis sec. 3.5: 10 urad).",
        "",
        Plot(
            signals.time,
            signals.robot_angle(1, 1e6),
            (T, "q1, change [urad]"),
            {"sigma_rad: 1.0e-5": merged(KINEMATIC, error("joint_noise", sigma_rad=1e-5))},
            KINEMATIC,
            window=(10.0, 11.0),
            points=120,
            marks=True,
        ),
    ),
    Source(
        "errors.joint_lag",
        "`y' = (m - y) / T_i`, `T_i = time_constant_s exp(spread z)`.",
        "EGM manual, 10 to 20 ms.",
        Plot(
            signals.time,
            signals.robot_angle(1, 1e3),
            (T, "q1, change [mrad]"),
            {"": merged(KINEMATIC, error("joint_lag"))},
            KINEMATIC,
        ),
    ),
    Source(
        "errors.resolver_error",
        "`m + sum A_k sin(k m + phi_k)`, then rounded.",
        "resolvers of the +-10 arcmin class, converters of 16 bits.",
        Plot(
            signals.robot_angle(1, 180.0 / np.pi),
            signals.robot_angle(1, 1e6),
            ("q1 [deg]", "q1, change [urad]"),
            {"": merged(KINEMATIC, error("resolver_error"))},
            KINEMATIC,
            window=(5.0, 7.5),
        ),
    ),
)

OUTLIERS = Source(
    "errors.outliers",
    "`angle + s`, s of log-uniform size and drawn sign.",
    "",
    Plot(
        signals.time,
        signals.robot_angle(1, 1e3),
        (T, "q1, change [mrad]"),
        {"": merged(KINEMATIC, error("outliers"))},
        KINEMATIC,
        window=(10.0, 12.0),
        points=200,
        marks=True,
    ),
)

FAST: Changes = {"path": {"duration_s": 26.0}}  # the encoders' signals pass the onset of freezing
ENCODERS = (
    Source(
        "errors.mounting_eccentricity",
        "`b + A sin(b + phi)`.",
        "",
        sensor_plot(5, error("mounting_eccentricity")),
    ),
    Source(
        "errors.encoder_eccentricity",
        "`s + sum A_k sin(k s + phi_k)`.",
        "within the ERN 1080's 18 arcsec.",
        sensor_plot(5, error("encoder_eccentricity")),
    ),
    Source(
        "errors.subdivisional_error",
        "`s + A sin(lines s + phi)`, after eccentricity.",
        "0.7 % of a period, assumed.",
        sensor_plot(5, error("subdivisional_error"), x="time", window=(2.0, 3.0), points=101),
    ),
    Source(
        "errors.signal_noise",
        "`s + share z / lines` at each row.",
        "thesis sec. 4.6.",
        Plot(
            signals.time,
            signals.bar_angle(1, 1e6),
            (T, "b1, change [urad]"),
            {
                f"{bits} bits": merged(
                    merged(KINEMATIC, error("signal_noise")), {"encoders": {"bits": bits}}
                )
                for bits in (12, 13)
            },
            KINEMATIC,
            window=(0.6, 1.6),
            points=101,
            counted=True,
        ),
    ),
    Source(
        "errors.frozen_bits",
        f"{SURE_BITS} bits are always live. Onset at {min(FREEZING_ONSET_HZ)} to "
        f"{max(FREEZING_ONSET_HZ)} bits: {', '.join(f'{f:g}' for f in FREEZING_ONSET_HZ.values())} "
        "Hz.",
        "EL5021 documentation.",
        Plot(
            signals.signal_frequency(5),
            signals.counts(5),
            ("signal of b5 [Hz]", "b5, change [counts]"),
            {"": merged(merged(KINEMATIC, FAST), error("frozen_bits"))},
            merged(KINEMATIC, FAST),
            window=(1.0, 25.0),
            points=500,
            marks=True,
            counted=True,
        ),
    ),
    Source(
        "errors.amplitude_errors",
        "",
        "",
        Plot(
            signals.time,
            signals.weak_signal(2),
            (T, "s2, bits 4 and 14"),
            {
                "": merged(
                    KINEMATIC,
                    {
                        "errors": {
                            "amplitude_errors": [{"encoder": 2, "start_s": 20.0, "end_s": 25.0}]
                        }
                    },
                )
            },
            KINEMATIC,
            points=600,
        ),
    ),
    Source(
        "errors.slipped_periods",
        "`counts + periods 2^bits` from at_s.",
        "",
        sensor_plot(2, {"errors": {"slipped_periods": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "errors.coupling_slips",
        "`shaft + angle_rad` from at_s.",
        "",
        sensor_plot(2, {"errors": {"coupling_slips": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "encoders.bits",
        "`rint(angle lines 2^bits / 2 pi)`.",
        "thesis sec. 4.6.",
        Plot(
            signals.time,
            signals.bar_error_urad(5),
            (T, "b5, log - true [urad]"),
            {"8 bits": merged(KINEMATIC, {"encoders": {"bits": 8}}), "12 bits": KINEMATIC},
            KINEMATIC,
            minus_off=False,
            counted=True,
            window=(2.0, 3.0),
            points=101,
            marks=True,
        ),
    ),
    Source(
        "encoders.noise_sigma_rad",
        "`scale + sigma z` at each row, before rounding.",
        "none; the ball-bar files assume 2 urad.",
        sensor_plot(
            5,
            {"encoders": {"noise_sigma_rad": 1e-5}},
            x="time",
            window=(10.0, 11.0),
            points=100,
            marks=True,
        ),
    ),
)

# on paired samples (`identify: {data: samples}`, kinematic plant)
PAIRS = (
    Source(
        "errors.synchronisation",
        "The sample of time t pairs `b(t)` with `q(t + delay_s)`.",
        "",
        residual_plot(merged(KINEMATIC, error("synchronisation", delay_s=1e-3)), off=KINEMATIC),
    ),
    Source(
        "errors.rod_deviation",
        "`bd3 + A (s - mean(s))`, s = +1 where the rod is pulled, -1 where it is pushed.",
        "thesis sec. 3.5; where the sign changes is chosen here.",
        residual_plot(
            merged(KINEMATIC, error("rod_deviation", amplitude_m=1e-5)), off=KINEMATIC, um=True
        ),
    ),
    Source(
        "errors.truncation",
        "`rint(b / step_rad) step_rad`.",
        "",
        sensor_plot(5, error("truncation", step_rad=1e-4), x="time", window=(2.0, 3.0), points=101),
    ),
)
