"""Sources in the logs: clocks and stamps, which rows stand in the files, logged loads."""

from __future__ import annotations

from ballbar.cell.dialect import ABB_PERIOD
from ballbar.sim.logging.clocks import SAMPLE_TASKS
from ballbar.sim.logging.load_logs import BallbarLogger
from generators.scenario_reference import signals
from generators.scenario_reference.plots import KINEMATIC, Plot, Source, T, clock_plot, rows_plot
from generators.scenario_reference.runs import merged

PERIOD_MS, TASK_MS = 1e3 * ABB_PERIOD, 1e3 * BallbarLogger().task_s
CLOCKS = (
    Source(
        "clocks.offset_s",
        "The ball-bar's log begins later.",
        "",
        clock_plot({"offset_s": 0.137}, "ms", 1e3),
    ),
    Source(
        "clocks.skew",
        "Quartz clocks differ by 20 to 100 ppm.",
        "",
        clock_plot({"skew": 5e-5}, "ms", 1e3),
    ),
    Source(
        "clocks.wander",
        "`rate = r w(t) + c exp(-t / T)`, w a random walk of unit RMS; its integral less the best "
        "straight line is added to t_robot.",
        "quartz without an oven.",
        Plot(
            signals.bar_row_time,
            signals.clock_difference(1e6),
            (T, "t_robot - t_bar [us]"),
            {
                "default": merged(KINEMATIC, {"clocks": {"wander": {}}}),
                "warm_up_ppm: 5": merged(KINEMATIC, {"clocks": {"wander": {"warm_up_ppm": 5.0}}}),
            },
            KINEMATIC,
            minus_off=False,
            rows=True,
        ),
    ),
    Source(
        "clocks.robot_wander",
        "",
        "",
        rows_plot(
            signals.robot_row_time,
            signals.stamp_error(1e6),
            "robot stamp - true [us]",
            {"robot_wander": {}},
        ),
    ),
    Source(
        "clocks.step",
        "`stamp + step_s` from at_s.",
        "NTP's threshold for a step.",
        clock_plot({"step": {"at_s": 20.0}}, "ms", 1e3),
    ),
    Source(
        "clocks.quantum",
        "`rint(stamp / quantum) quantum`.",
        "",
        rows_plot(
            signals.robot_row_time,
            signals.stamp_error(1e3),
            "robot stamp - true [ms]",
            {"quantum": {}},
            window=(5.0, 6.5),
        ),
    ),
    Source(
        "clocks.jitter",
        "`stamp + sigma_s z`.",
        "",
        rows_plot(
            signals.robot_row_time,
            signals.stamp_error(1e3),
            "robot stamp - true [ms]",
            {"jitter": {}},
            window=(5.0, 6.0),
            marks=True,
        ),
    ),
)

LOGGERS = (
    Source(
        "clocks.overrun_probability",
        f"A row takes {SAMPLE_TASKS} tasks of {TASK_MS:g} ms, or one more (thesis sec. 4.6).",
        "",
        rows_plot(
            signals.bar_file_time,
            signals.bar_file_interval_ms,
            "ball-bar interval [ms]",
            {"overrun_probability": 0.005},
            marks=True,
        ),
    ),
    Source(
        "clocks.dropped_rows",
        "",
        "",
        rows_plot(
            signals.robot_file_time,
            signals.robot_file_interval_ms,
            "robot interval [ms]",
            {"dropped_rows": {}},
            marks=True,
        ),
    ),
    Source(
        "clocks.duplicated_rows",
        "",
        "",
        rows_plot(
            signals.robot_file_time,
            signals.robot_file_interval_ms,
            "robot interval [ms]",
            {"duplicated_rows": {}},
            marks=True,
        ),
    ),
    Source(
        "clocks.restart",
        "",
        "",
        rows_plot(
            signals.bar_file_time,
            signals.bar_file_interval_ms,
            "ball-bar interval [ms]",
            {"restart": {"at_s": 20.0}},
            marks=True,
        ),
    ),
)

FORMS = (
    Source(
        "logs.robot",
        "Columns, units and container are the dialect's; angles those of motors, axes or joints.",
        "",
        Plot(
            signals.robot_file_time,
            signals.robot_file_interval_ms,
            (T, "robot interval [ms]"),
            {
                name: merged(KINEMATIC, {"logs": {"robot": {"dialect": name}}})
                for name in ("abb-motor", "comau-joint")
            },
            KINEMATIC,
            minus_off=False,
            rows=True,
            window=(5.0, 5.2),
            marks=True,
        ),
    ),
    Source(
        "logs.ballbar",
        "",
        "thesis sec. 4.6.",
        Plot(
            signals.bar_file_time,
            signals.bar_file_interval_ms,
            (T, "ball-bar interval [ms]"),
            {
                f"task_s: {task}": merged(KINEMATIC, {"logs": {"ballbar": {"task_s": task}}})
                for task in (0.005, 0.002)
            },
            KINEMATIC,
            minus_off=False,
            rows=True,
            window=(5.0, 5.2),
            marks=True,
        ),
    ),
)

LOADS = (
    Source(
        "logs.torque",
        "`(tau (1 + gain z_i) + noise z) / ratio`, N m at the motor.",
        "",
        Plot(
            signals.time,
            signals.logged_and_true_torque,
            (T, "tau1 at the motor [N m]"),
            {"": {"logs": {"torque": {}}}},
            minus_off=False,
            columns=("logged", "true"),
            window=(10.0, 16.0),
        ),
    ),
    Source(
        "logs.force_sensor",
        "`load (1 + gain z_c) + bias z_c + noise z`: force and torque of plate and ball-bar on the "
        "flange, in its frame, about its origin.",
        "like the JR3 of thesis sec. 5.3, assumed.",
        Plot(
            signals.sensor_time,
            signals.sensor_force_and_truth,
            (T, "fx [N]"),
            {"": {"logs": {"force_sensor": {}}}},
            minus_off=False,
            rows=True,
            columns=("logged", "true"),
            window=(10.0, 16.0),
        ),
    ),
    Source(
        "logs.tracker",
        "`R (x + F l - o) + noise z`: LED at l of the true tool, deflection included; frame R, o "
        "drawn, 3 m from the robot's base.",
        "Nikon K600 of thesis sec. 5.3; the rest assumed.",
        Plot(
            signals.tracker_time,
            signals.tracker_error_um,
            (T, "x less the true one [um]"),
            {"": {"logs": {"tracker": {}}}},
            minus_off=False,
            rows=True,
            window=(10.0, 16.0),
        ),
    ),
)
