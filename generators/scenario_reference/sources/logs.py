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
        "`t_robot = offset + (1 + skew) t_bar`, both from the first row of their log.",
        "Instants of the rows: the ball-bar's log begins later.",
        "None: both logs begin together.",
        "All ball-bar angles are shifted in time. Plotted: 0.137 s.",
        clock_plot({"offset_s": 0.137}, "ms", 1e3),
        what="One log begins later than the other.",
    ),
    Source(
        "clocks.skew",
        "As above: the ball-bar's clock runs slow by 1 + skew.",
        "Instants of the rows.",
        "None; quartz clocks differ by 20 to 100 ppm.",
        "The shift grows along the run. Plotted: 5.0e-5.",
        clock_plot({"skew": 5e-5}, "ms", 1e3),
        what="The two clocks run at different rates.",
    ),
    Source(
        "clocks.wander",
        "`rate = r w(t) + c exp(-t / T)`, w a random walk of unit RMS; its integral less the best "
        "straight line is added to t_robot.",
        "Instants of the rows.",
        "Usual for quartz oscillators without an oven.",
        "Microseconds that no straight line takes out.",
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
        "As clocks.wander, of a stream of its own.",
        "Instants of the robot's rows.",
        "Usual for quartz oscillators without an oven.",
        "Microseconds that no straight line takes out.",
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
        "Ball-bar stamps; the rows are taken as ever.",
        "NTP's step threshold, 128 ms.",
        "A gap in the stamps, or stamps that go back.",
        clock_plot({"step": {"at_s": 20.0}}, "ms", 1e3),
    ),
    Source(
        "clocks.quantum",
        "`rint(stamp / quantum) quantum`, from the first row.",
        "Stamps of both logs.",
        "EGM headers and SYSTEMTIME count whole ms.",
        f"The robot's {PERIOD_MS:.3f} ms period becomes 4, 4, .., 5 ms; the ball-bar's stamps, "
        f"multiples of {TASK_MS:g} ms, do not change.",
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
        "Stamps of the robot's log.",
        "Assumed.",
        "White noise of the stamps: at 50 deg/s 0.2 ms is 175 urad.",
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
        f"A row takes {SAMPLE_TASKS} tasks of {TASK_MS:g} ms, or one more.",
        "Instants and stamps of the ball-bar's rows.",
        "None; thesis sec. 4.6 reports overruns, the scenarios assume 0.005.",
        "Intervals of 15 ms among those of 10 ms; the stamps are right. Plotted: 0.005.",
        rows_plot(
            signals.bar_file_time,
            signals.bar_file_interval_ms,
            "ball-bar interval [ms]",
            {"overrun_probability": 0.005},
            marks=True,
        ),
        what="A line of the ball-bar's log takes one task more.",
    ),
    Source(
        "clocks.dropped_rows",
        "Each row but the first is lost with the stated probability.",
        "Files of both logs.",
        "Assumed.",
        "Intervals of twice the period.",
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
        "Each row but the first is written twice with the stated probability.",
        "Files of both logs.",
        "Assumed.",
        "Intervals of zero, all columns equal.",
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
        "No rows from at_s to at_s + gap_s.",
        "Files of the ball-bar's log: two of them.",
        "Assumed.",
        "One long interval between ballbarOld.csv and ballbar.csv.",
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
        "Columns, units, separators and container of the dialect's file; angles of motors, axes or "
        "joints by the robot's file.",
        "Robot's log.",
        "The robot's file names its controller's dialect; the dialect's file the period.",
        f"abb-motor: rows of {PERIOD_MS:g} ms, stamped to a microsecond; comau-joint: 4 ms.",
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
        "Columns and separators of the dialect's file; a row takes two tasks.",
        "Ball-bar's log.",
        "Thesis sec. 4.6: a task of 5 ms; notes/log_formats secs. A.6, A.7.",
        "Rows of 10 ms; with a task of 2 ms, of 4 ms.",
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
        "`(tau (1 + gain z_i) + noise z) / ratio`: columns tau1..tau6, N m at the motor.",
        "Robot's log.",
        "Assumed.",
        "Here axis 1: gravity does not load it, friction is off, so it shows servo and rod.",
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
        "A third log, with its own rate, and a clock that begins offset_s after the robot's.",
        "Assumed, for a sensor like the JR3 of thesis sec. 5.3.",
        "The plate's weight turns with the wrist; the rod's force comes on top.",
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
        "A log of its own, with its own rate, and a clock that begins offset_s after the robot's.",
        "Thesis sec. 5.3: Nikon K600; the rest assumed.",
        "Noise of single rows; nominal robots are off by several times as much.",
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
