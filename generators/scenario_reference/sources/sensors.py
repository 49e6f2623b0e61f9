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
        "`q + sigma z` at each row.",
        "Robot's log, before the motor angles are formed.",
        "No default; scenarios/irb2400.yaml takes the 10 urad of thesis sec. 3.5.",
        "White at the log's rate.",
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
        "`y' = (m - y) / T_i`, `T_i = time_constant_s exp(spread z)`, m the motor's angle at its "
        "gear's output.",
        "Robot's log. The servo is not misled.",
        "EGM manual, 10 to 20 ms (notes/log_formats sec. D); the spread is assumed.",
        "Speed times time constant. What is common to all axes is part of the clock offset; what "
        "differs looks like a joint that trails its motion.",
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
        "`m + sum A_k sin(k m + phi_k)`, k = 1, 2, m the motor's angle; then rounded to the "
        "quantum.",
        "Robot's log. The servo is not misled.",
        "Resolvers of the +-10 arcmin class and converters of 16 bits (recalled).",
        "One and two cycles a motor turn, divided by the gear ratio; looks like gear error of the "
        "input side.",
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
    "`angle + s`, s of log-uniform size and drawn sign, on one angle of a row.",
    "Both logs: joint angles before the motor angles are formed, ball-bar angles before they are "
    "counted.",
    "Assumed: bits flipped, frames torn, encoders disturbed. A share of 5 % is far more than any "
    "healthy device has.",
    "Single values off the motion; they do not repeat.",
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
        "`b + A sin(b + phi)`, A = offset / radius of the restraint; phase drawn.",
        "Ball-bar encoder, first in its chain.",
        "Assumed: a mount that was not adjusted.",
        "One cycle a turn of the joint; larger than the encoder's own errors.",
        sensor_plot(5, error("mounting_eccentricity")),
    ),
    Source(
        "errors.encoder_eccentricity",
        "`s + sum A_k sin(k s + phi_k)`, k = 1..3, s the shaft's angle; phases drawn.",
        "Ball-bar encoder, after mounting and coupling.",
        "Sized to stay near the ERN 1080's 18 arcsec; shape: Renishaw, The accuracy of rotary "
        "encoders.",
        "Slow wave over the joint's angle, the same in both directions.",
        sensor_plot(5, error("encoder_eccentricity")),
    ),
    Source(
        "errors.subdivisional_error",
        "`s + A sin(lines s + phi)`, after eccentricity.",
        "Ball-bar encoder, last before noise and rounding.",
        "Assumed: 0.7 % of a signal period.",
        "Cycles of 0.1 deg. Plotted in rows of 10 ms as a motion begins: from 5 deg/s on they "
        "alias it into noise of the same size.",
        sensor_plot(5, error("subdivisional_error"), x="time", window=(2.0, 3.0), points=101),
    ),
    Source(
        "errors.signal_noise",
        "`s + share z / lines` at each row: the arctangent of two noisy signals.",
        "Ball-bar encoder, before its white noise and rounding.",
        "Thesis sec. 4.6: 13 bits fluctuated in a dwell and 12 were taken; notes/log_formats sec. "
        "B gives the arctangent.",
        "At rest the lowest of 13 bits changes, of 12 seldom. Plotted: a dwell.",
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
        "Low bits keep their last value from the onset up, one more each octave of signal "
        f"frequency, {SURE_BITS} bits always live. "
        "Onset by bits: "
        + ", ".join(f"{bits}: {hz:g} Hz" for bits, hz in FREEZING_ONSET_HZ.items())
        + ".",
        "Ball-bar counter.",
        "EL5021 documentation; +-15 % by the maker.",
        "A count at speed, three at twice the speed; no status says so. Plotted: a fast run of 26 "
        "s.",
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
        "Status bits 4 and 14 from start_s to end_s.",
        "Ball-bar status words; the counts stay right.",
        "No default: a stated fault.",
        "Status word only.",
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
        "Ball-bar counter.",
        "No default: a stated fault. One period of 3600 lines is 1.745 mrad.",
        "A step of whole periods between two rows; the zero is another one afterwards.",
        sensor_plot(2, {"errors": {"slipped_periods": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "errors.coupling_slips",
        "`shaft + angle_rad` from at_s.",
        "Ball-bar encoder, between mounting and graduation.",
        "Assumed.",
        "A step that is no whole number of periods.",
        sensor_plot(2, {"errors": {"coupling_slips": [{"encoder": 2, "at_s": 20.0}]}}, x="time"),
    ),
    Source(
        "encoders.bits",
        "`rint(angle lines 2^bits / 2 pi)`.",
        "Ball-bar counter.",
        "Thesis sec. 4.6.",
        "Steps of 6.8 urad at 8 bits, 0.4 urad at 12, 0.2 urad at 13; in motion they look like "
        "noise.",
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
        what="Quantisation of the ball-bar angles; always there.",
    ),
    Source(
        "encoders.noise_sigma_rad",
        "`scale + sigma z` at each row, before rounding.",
        "Ball-bar encoder.",
        "None. The ball-bar files assume 2 urad for the identifier; scenarios/irb2400.yaml takes "
        "10 urad (thesis sec. 3.5).",
        "White at the log's rate.",
        sensor_plot(
            5,
            {"encoders": {"noise_sigma_rad": 1e-5}},
            x="time",
            window=(10.0, 11.0),
            points=100,
            marks=True,
        ),
        what="White noise of the ball-bar angles. Plotted: 1.0e-5.",
    ),
)

# on paired samples (`identify: {data: samples}`, kinematic plant)
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
