"""Any robot on a double ball-bar: a path, a simulation and an identification without editing.

    python -m benchmarks.any_robot               # every robot; about two minutes each
    python -m benchmarks.any_robot ur5e heavy    # these; the other rows of the table stay
    python -m benchmarks.any_robot --keep FOLDER # with the plans and recordings that are there

All shipped robots, and three made here from DH rows or a URDF: `light`, a UR3e (3 kg), `heavy`, an
arm of the class of 210 kg, and `seven`, a KUKA LBR iiwa 7 from its URDF with masses. The request
names the robot alone. Where its file lacks masses, gears or servo, the true machine is drawn about
the typical one (`plant.typical_spread`, a seed for each robot), and so are all other errors of
the scenario that the plan writes. Writes docs/studies/any_robot.csv.
"""

from __future__ import annotations

import csv
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from ballbar.cell.errors import FailureError, InputError
from ballbar.cell.load import load_robot, robot_names
from ballbar.cell.typical_machine import arm_length
from ballbar.planning.files import SCENARIO, write_plan
from ballbar.planning.plan import PathPlan, plans
from ballbar.planning.request import PlanRequest, load_request
from ballbar.result.identify import identify
from ballbar.robot_file.dh_table import draft_from_table
from ballbar.robot_file.draft import draft_from_urdf
from ballbar.robot_file.new_robot import write_robot
from ballbar.run import simulate_scenario
from ballbar.scenario import load_scenario
from ballbar.sim.truth import load_truth
from ballbar.truth.compare import identification_against_truth
from benchmarks.study import STUDIES, in_words, study_parser, write_table

SECONDS, EVALUATIONS, WORKERS = 60.0, 1500, 1  # of the search at most, after the first path
HEADINGS = "a_m;d_m;alpha_deg;theta_deg;lower_deg;upper_deg;speed_deg_per_s\n"
TABLES = {
    # Universal Robots, "DH parameters", and data sheet of the UR3e
    "light": """\
0;0.15185;90;0;-360;360;180
-0.24355;0;0;0;-360;360;180
-0.2132;0;0;0;-360;360;180
0;0.13105;90;0;-360;360;360
0;0.08535;-90;0;-360;360;360
0;0.0921;0;0;-360;360;360
""",
    # class of a FANUC R-2000iC/210F (data sheet: reach 2.655 m, 1090 kg), lengths rounded
    "heavy": """\
0.312;0.670;-90;0;-185;185;120
1.075;0;0;-90;-60;76;105
0.225;0;-90;0;-132;132;110
0;1.280;90;0;-360;360;140
0;0;-90;0;-125;125;140
0;0.215;0;0;-360;360;220
""",
}
# Joint origins [m, rad], masses [kg] and centres [m] after iiwa_stack, iiwa7.xacro; inertias of
# balls of 6 cm radius of gyration
SEVEN = (
    ("0 0 0.15", "0 0 0", 2.9668, 3.4525, "0 -0.03 0.12"),
    ("0 0 0.19", "1.57079632679 0 3.14159265359", 2.0942, 3.4821, "0.0003 0.059 0.042"),
    ("0 0.21 0", "1.57079632679 0 3.14159265359", 2.9668, 4.05623, "0 0.03 0.13"),
    ("0 0 0.19", "1.57079632679 0 0", 2.0942, 3.4822, "0 0.067 0.034"),
    ("0 0.21 0", "-1.57079632679 3.14159265359 0", 2.9668, 2.1633, "0.0001 0.021 0.076"),
    ("0 0.0607 0.19", "1.57079632679 0 0", 2.0942, 2.3466, "0 0.0006 0.0004"),
    ("0 0.081 0.0607", "-1.57079632679 3.14159265359 0", 3.0542, 3.129, "0 0 0.02"),
)


def seven_axes() -> str:
    """The URDF of `seven`."""
    body = (
        '<inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia ixx="{i:.5g}" ixy="0" '
        'ixz="0" iyy="{i:.5g}" iyz="0" izz="{i:.5g}"/></inertial>'
    )
    text = f'<link name="link0">{body.format(com="-0.1 0 0.07", mass=5.0, i=0.05)}</link>\n'
    for k, (xyz, rpy, limit, mass, com) in enumerate(SEVEN, start=1):
        inertial = body.format(com=com, mass=mass, i=mass * 0.06**2)
        text += (
            f'<link name="link{k}">{inertial}</link>\n<joint name="a{k}" type="revolute">'
            f'<parent link="link{k - 1}"/><child link="link{k}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
            f'<axis xyz="0 0 1"/><limit lower="-{limit}" upper="{limit}" velocity="1.7" '
            'effort="100"/></joint>\n'
        )
    flange = '<link name="flange"/><joint name="end" type="fixed"><parent link="link7"/>'
    flange += '<child link="flange"/><origin xyz="0 0 0.045"/></joint>'
    return f'<robot name="seven">\n{text}{flange}</robot>'


def made(name: str, folder: Path) -> str:
    """The robot's name in a request, whose file is written to a folder where it is not shipped."""
    file = folder / f"{name}.yaml"
    if name == "seven":
        source = folder / "seven.urdf"
        source.write_text(seven_axes())
        write_robot(draft_from_urdf(name, source, None, None), file)
    elif name in TABLES:
        source = folder / f"{name}.csv"
        source.write_text(HEADINGS + TABLES[name])
        write_robot(draft_from_table(name, source), file)
    return str(file) if file.exists() else name


def planned(name: str, robot: str, folder: Path, seed: int) -> PathPlan:
    """A quick plan for a robot, whose files stand in a folder."""
    file = folder / "request.yaml"
    file.write_text(
        f"schema: ballbar-plan/1\nname: {name}\ncell: {{robot: {robot}}}\nseed: {seed}\n"
    )
    request = load_request(file)
    assert isinstance(request, PlanRequest)
    plan = next(
        plans(
            request,
            relative_to=folder,
            workers=WORKERS,
            seconds=SECONDS,
            evaluations=EVALUATIONS,
            since=lambda: 0.0,
        )
    )
    write_plan(plan, folder)
    return plan


def row_of(name: str, seed: int, folder: Path) -> dict[str, object]:
    """The row of one robot, whose plan and recording may stand in a folder."""
    plan = folder / "row.json"
    if not plan.exists():
        plan.write_text(json.dumps(planned_row(name, seed, folder)))
    row = json.loads(plan.read_text())
    try:
        return row | (identified(folder) if row["path"] == "yes" else {})
    except (InputError, FailureError) as error:
        return row | {"verdict": str(error)}


def planned_row(name: str, seed: int, folder: Path) -> dict[str, object]:
    """The part of a row that the plan of a robot gives; its recording is simulated."""
    row: dict[str, object] = {"robot": name, "seed": seed}
    robot, since = made(name, folder), time.monotonic()
    row |= {"axes": load_robot(robot).joints, "arm_m": arm_length(load_robot(robot))}
    try:
        plan = planned(name, robot, folder, seed)
    except InputError as error:
        return row | {"path": "no", "verdict": str(error)}
    assert plan.forces is not None
    low, high = plan.forces.interval
    row |= {"path": "yes", "plan_s": time.monotonic() - since, "ballbar": plan.rod}
    row |= {"typical": " ".join(plan.evaluator.typical.keys), "covered": plan.coverage}
    row |= {"limit_N": plan.request.limits.force_N, "low_N": low, "high_N": high}
    file = folder / SCENARIO
    simulate_scenario(load_scenario(file), file, folder / "recording", progress=lambda _: None)
    return row


def identified(folder: Path) -> dict[str, object]:
    """Force and TCP error of the recording of a plan."""
    truth, recording = load_truth(folder / "recording.truth.yaml"), folder / "recording"
    force = truth.rod_force  # type: ignore[union-attr]
    out: dict[str, object] = {"true_low_N": force.min_N, "true_high_N": force.max_N}
    data = identify(recording).data
    result = data.identification
    compared, stated = identification_against_truth(result, truth), result.robot.tcp_sigma  # type: ignore[arg-type]
    return out | {
        "nominal_mm": compared.tcp_nominal.mean * 1e3,
        "tcp_mm": compared.tcp.mean * 1e3,
        "stated_mm": float(np.mean(stated)) * 1e3,
        "ratio": compared.tcp.mean / float(np.mean(stated)),
        "verdict": result.verdict.status.value,
    }


COLUMNS = (
    *("robot", "seed", "axes", "arm_m", "typical", "path", "plan_s", "ballbar", "covered"),
    *("limit_N", "low_N", "high_N", "true_low_N", "true_high_N"),
    *("nominal_mm", "tcp_mm", "stated_mm", "ratio", "verdict"),
)


def main() -> None:
    """Runs the study and writes its table after every robot."""
    parser = study_parser(__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--keep", type=Path, help="folder of plans and recordings, kept")
    chosen = parser.parse_args()
    names = [*robot_names(), *TABLES, "seven"]
    file, rows = STUDIES / "any_robot.csv", dict[str, dict[str, object]]()
    if chosen.robots and file.exists():
        rows = {row["robot"]: dict(row) for row in csv.DictReader(file.open())}
    with tempfile.TemporaryDirectory() as temporary:
        for seed, name in enumerate(names, start=1):
            if not chosen.robots or name in chosen.robots:
                folder = (chosen.keep or Path(temporary)) / name
                folder.mkdir(parents=True, exist_ok=True)
                rows[name] = row_of(name, seed, folder)
                print(in_words(rows[name]), flush=True)
                write_table(file, [rows[n] for n in names if n in rows], ".4g", COLUMNS)


if __name__ == "__main__":
    main()
