"""Simulated still poses: what stands in the table is what the true robot and instrument do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbar.acquisition.pose_tables import read_poses
from ballbar.cell.errors import InputError
from ballbar.cell.instruments.base import Instrument
from ballbar.cell.load import load_instrument, load_robot
from ballbar.cell.poses import PoseTable
from ballbar.sim.errors.plant_errors import JointCompliance
from ballbar.sim.plant.held import hold_with_instrument
from ballbar.sim.recording_files import truth_path, write_poses
from ballbar.sim.settings import ErrorSettings, PlantSettings, SimulationSettings
from ballbar.sim.still_poses import PoseSimulation, simulate_poses
from ballbar.sim.true_robot import TrueArm, true_arm
from ballbar.sim.truth import TruePlace, load_truth


def cell(
    robot: str, instrument: str, count: int, seats: list[Any], targets: list[Any], **poses: Any
) -> dict[str, Any]:
    """Sections of a scenario; a place is its name, position and, where it matters, rotation."""
    keys = ("name", "position_m", "rotvec_rad")
    placed = {
        key: [dict(zip(keys, place, strict=False)) for place in places]
        for key, places in (("seats", seats), ("targets", targets))
    }
    machines = {"robot": robot, "instrument": instrument}
    return {"cell": machines, "poses": {"count": count, **placed, **poses}}


CELLS: dict[str, dict[str, Any]] = {
    "tracker_point": cell(
        *("ur10e", "tracker_point", 40),
        seats=[("hall", [3.0, -1.0, 0.5], [0, 0, 2.8])],
        targets=[("r1", [0.1, 0, 0.05]), ("r2", [0, 0.1, 0.05])],
    ),
    "tracker_pose": cell(
        *("panda", "tracker_pose", 40),
        seats=[("hall", [2.0, 1.0, 0.5], [0.1, -0.2, 2.8])],
        targets=[("mac", [0, 0, 0.1], [0.3, 0.2, -0.1])],
    ),
    "socket_pair_50": cell(
        *("panda", "socket_pair_50", 20),
        seats=[("left", [0.45, -0.025, 0.05]), ("right", [0.45, 0.025, 0.05])],
        targets=[("ball", [0, 0, 0.1])],
        tilt_max_deg=60,
    ),
    "drawwire_2m": cell(
        *("irb120", "drawwire_2m", 30),
        seats=[("a", [0.8, 0.5, 0]), ("b", [0.8, -0.5, 0])],
        targets=[("hook", [0.05, 0, 0.08])],
    ),
    "qc20w_300": cell(
        *("irb2400", "qc20w_300", 12),
        seats=[("low", [0.9, 0.1, 0.8])],
        targets=[("cup", [0.05, 0, 0.12])],
        elevation_min_deg=-20,
    ),
}
SOURCES: dict[str, Any] = {
    "geometry": {},
    "joint_harmonics": [{"axis": 2, "order": 3, "amplitude_rad": 1e-4}],
    "drawn_harmonics": {},
    "unit_weights": {},
    "joint_noise": {"sigma_rad": 1e-5},
    "instrument_noise": {},
    "outliers": {"share": 0.1},
    "unsettled": {"share": 0.1},
    "rounding": {},
    "drift": {},
}
EXACT: dict[str, Any] = {"geometry": {}, "unit_weights": {}}


def simulated(name: str, errors: dict[str, Any] | None = None, **changes: Any) -> PoseSimulation:
    """A small table of one instrument; changes : of the scenario's sections."""
    data = CELLS[name] | {"errors": errors or {}, "seed": 1} | changes
    return simulate_poses(SimulationSettings.model_validate(data), relative_to=Path())


def read_back(name: str, folder: Path, errors: dict[str, Any]) -> tuple[PoseSimulation, PoseTable]:
    settings = SimulationSettings.model_validate(CELLS[name] | {"errors": errors, "seed": 1})
    simulation = simulate_poses(settings, relative_to=Path())
    write_poses(simulation, settings, folder)
    return simulation, read_poses(folder)


@pytest.mark.parametrize("name", list(CELLS))
def test_the_reader_reads_what_the_true_robot_and_instrument_do(name: str, tmp_path: Path) -> None:
    errors = EXACT if name != "qc20w_300" else {"geometry": {}}
    simulation, table = read_back(name, tmp_path / "t", errors)
    truth = load_truth(truth_path(tmp_path / "t"))
    arm = truth.arm(simulation.robot)
    assert table.size == len(simulation.rows.seat)
    for group in table.groups:
        seat, target = truth.seats[group.seat], truth.targets[group.target]
        away = arm.target(group.q, target.position) - seat.position
        expected = away @ seat.rotation
        if group.measured == "length":
            expected = np.linalg.norm(away, axis=1)[:, None]
        elif group.measured == "socket":
            assert np.abs(away).max() < 1e-8  # nothing but the digits of the angles
            continue
        assert group.values[:, :3] == pytest.approx(expected, abs=1e-10)
        if group.measured == "pose":
            turned = arm.flange(group.q).rotation().transpose(2, 0, 1) @ target.rotation
            read = Rotation.from_rotvec(group.values[:, 3:].copy()).as_matrix()
            assert seat.rotation @ read == pytest.approx(turned, abs=1e-8)


@pytest.mark.parametrize("source", list(SOURCES))
def test_switching_a_source_on_changes_the_table_but_no_draw_of_another(source: str) -> None:
    every = simulated("tracker_point", SOURCES)
    without = {key: value for key, value in SOURCES.items() if key != source}
    other = simulated("tracker_point", without)
    changed = np.abs(every.rows.values - other.rows.values).max() > 1e-9
    assert changed or np.abs(every.rows.axes - other.rows.axes).max() > 1e-9, source
    if source not in ("geometry", "unit_weights"):  # those move the target in and out of sight
        assert every.truth.dh.a == pytest.approx(other.truth.dh.a, abs=0.0)
    if source not in ("outliers", "geometry"):
        assert every.truth.outliers == other.truth.outliers
    if source != "unsettled":
        assert every.truth.unsettled == other.truth.unsettled


def test_a_seed_of_the_poses_keeps_them_while_the_errors_change() -> None:
    section = CELLS["tracker_point"]["poses"] | {"seed": 7}
    first, second = (
        simulated("tracker_point", {"unit_weights": {}}, poses=section, seed=seed)
        for seed in (1, 2)
    )
    assert first.rows.axes == pytest.approx(second.rows.axes, abs=0.0)
    assert np.abs(first.rows.values - second.rows.values).max() > 1e-6


@pytest.mark.parametrize("name", ["qc20w_300", "drawwire_2m"])
def test_every_length_is_within_the_range_though_the_robot_is_wrong_by_millimetres(
    name: str,
) -> None:
    simulation = simulated(name, {"geometry": {"sigma_m": 3e-3, "sigma_rad": 3e-3}})
    lengths = simulation.rows.values[:, 0]
    assert lengths.min() > simulation.instrument.lower
    assert lengths.max() < simulation.instrument.upper


def test_the_noise_is_that_of_the_file_along_the_sight_and_across() -> None:
    section = CELLS["tracker_point"]["poses"] | {"count": 2000}
    exact = simulated("tracker_point", poses=section).rows.values
    noisy = simulated("tracker_point", {"instrument_noise": {}}, poses=section).rows.values
    distance = np.linalg.norm(exact, axis=1)
    along = np.linalg.norm(noisy, axis=1) - distance
    across = np.linalg.norm(noisy - exact - along[:, None] * exact / distance[:, None], axis=1)
    instrument = load_instrument("tracker_point")
    assert along.std() == pytest.approx(instrument.sigma_length, rel=0.05)  # of 4000: 1.1 %
    sideways = np.sqrt((across**2 / distance**2).mean() / 2.0)
    assert sideways == pytest.approx(instrument.sigma_direction, rel=0.05)


FIXED = [
    {"name": f"floor{k}", "position_m": place}
    for k, place in enumerate(([1.0, 1.2, -0.8], [-1.1, 0.9, -0.8], [0.8, -1.4, 0.7]))
]


def test_reference_points_are_read_once_at_each_pose_from_the_seat_that_drifts() -> None:
    section = CELLS["tracker_point"]["poses"] | {"reference": FIXED}
    drift = {"drift": {"shift_m": 1e-3, "turn_rad": 1e-3}}
    simulation = simulated("tracker_point", drift, poses=section)
    rows, truth = simulation.rows, simulation.truth
    read = np.isfinite(rows.reference).all(axis=(1, 2))
    assert read.tolist() == [target == "r1" for target in rows.target]
    points = rows.reference[read]
    fixed = np.array([point["position_m"] for point in FIXED])
    for n, share in enumerate(np.linspace(0.0, 1.0, len(points))):
        turn = Rotation.from_rotvec(np.array(truth.drift.turn_rad) * share).as_matrix()
        seat = truth.seats["hall"]
        rotation, origin = (
            turn @ seat.rotation,
            turn @ seat.position + np.array(truth.drift.shift_m) * share,
        )
        assert points[n] == pytest.approx((fixed - origin) @ rotation, abs=1e-12)
    moved = np.linalg.norm(points[-1] - points[0], axis=1)
    assert (moved > 2e-4).all()
    without = simulated("tracker_point", drift)
    assert rows.values == pytest.approx(without.rows.values, abs=0.0)


def test_an_instrument_that_measures_no_points_reads_no_reference_points() -> None:
    section = CELLS["socket_pair_50"]["poses"] | {"reference": FIXED}
    with pytest.raises(InputError, match=r"poses.reference: socket_pair_50 measures a socket, and"):
        simulated("socket_pair_50", poses=section)


def test_unsettled_poses_miss_a_share_of_the_last_move() -> None:
    errors = {"unsettled": {"share": 0.2, "fraction": 0.1}}
    calm, hasty = simulated("drawwire_2m"), simulated("drawwire_2m", errors)
    lines = np.array(hasty.truth.unsettled) - 2
    assert 3 <= lines.size <= 20
    missing = 0.1 * np.diff(calm.rows.axes, axis=0)[lines - 1]
    assert calm.rows.axes[lines] - hasty.rows.axes[lines] == pytest.approx(missing, abs=1e-12)
    others = np.setdiff1d(np.arange(len(calm.rows.axes)), lines)
    assert hasty.rows.axes[others] == pytest.approx(calm.rows.axes[others], abs=0.0)


def test_the_second_socket_lies_at_the_true_distance_of_the_fixture() -> None:
    simulation = simulated("socket_pair_50")
    seats = [place.position for place in simulation.truth.seats.values()]
    apart = float(np.linalg.norm(seats[1] - seats[0]))
    assert apart != 0.05
    assert apart == pytest.approx(0.05, abs=4 * 2e-4)


def test_a_robot_without_masses_is_kinematic_and_the_sentence_says_so() -> None:
    sentence = simulated("drawwire_2m").plant
    assert sentence.startswith("The poses are kinematic: irb120's file states no masses")
    with pytest.raises(InputError, match=r"plant.kind = mujoco: irb120's file states no masses"):
        simulated("drawwire_2m", plant={"kind": "mujoco"})
    errors: dict[str, Any] = {"joint_compliance": {}, "unit_weights": {}}
    with pytest.raises(InputError, match=r"errors.unit_weights stand for masses"):
        simulated("qc20w_300", errors, plant={"kind": "mujoco"})


@pytest.mark.parametrize(
    ("name", "section", "message"),
    [
        ("drawwire_2m", {"axis_lower_deg": [0, 0]}, "2 angles, but irb120 has 6 axes"),
        ("drawwire_2m", {"axis_lower_deg": [-999] * 6}, "beyond the robot's own limit -165"),
        ("qc20w_300", {"seats": [{"name": "far", "position_m": [5, 0, 0]}]}, "only 0 can be"),
        (
            "socket_pair_50",
            {"seats": [{"name": x, "position_m": [0.4, 0, z]} for x, z in (("a", 0), ("b", 0.2))]},
            "a and b are 0.2 m apart, those of socket_pair_50 0.05 m",
        ),
    ],
)
def test_poses_that_cannot_be_are_refused(name: str, section: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulated(name, poses=CELLS[name]["poses"] | section)


# --- MuJoCo -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def elastic() -> TrueArm:
    errors = ErrorSettings.model_validate(
        {"geometry": {}, "joint_compliance": {"spread": 0.3}, "drawn_harmonics": {}}
    )
    return true_arm(load_robot("irb2400"), errors, 5)


CUP = TruePlace(position_m=(0.05, 0.0, 0.12))
HELD_Q = np.array([[0.1, 0.2, 0.3, 0.2, -0.6, 0.4], [-0.3, -0.1, 0.2, -0.5, 0.7, 1.0]])


def held(
    arm: TrueArm, instrument: Instrument, plant: dict[str, float], friction: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Actual joints (2, 6), force (2,), and the unit vectors (2, 3) from seat to target."""
    joints, force, sight = [], [], []
    for q in HELD_Q[:, None]:
        target = arm.target(q, CUP.position)[0]
        seat = target - instrument.nominal * np.array([0.6, 0.0, 0.8])
        actual, along = hold_with_instrument(
            arm,
            instrument,
            PlantSettings.model_validate(plant),
            seat=TruePlace(position_m=tuple(seat)),
            target=CUP,
            q=q,
            friction=np.array([friction]),
        )
        joints.append(actual[0])
        force.append(along[0])
        sight.append(np.array([0.6, 0.0, 0.8]))
    return np.stack(joints), np.array(force), np.stack(sight)


def test_mujoco_sags_as_the_arm_does_where_the_rod_weighs_nothing(elastic: TrueArm) -> None:
    plant = {"rod_mass_kg": 1e-6, "rod_spring_N_per_m": 0.0}
    joints, _, _ = held(elastic, load_instrument("qc20w_300"), plant)
    sag = np.abs(elastic.joints(HELD_Q) - elastic.rotors(HELD_Q) @ elastic.robot.gear_to_joint)
    assert sag.max() > 2e-4
    # two independent ways to the same angles; MuJoCo stops at 1e-8 rad/s
    assert joints == pytest.approx(elastic.joints(HELD_Q), abs=1e-8)


def yielded(arm: TrueArm, force: np.ndarray) -> np.ndarray:
    """(2, 6) [rad] to first order, of the joints under forces (2, 3) [N] at the target."""
    robot, frames = arm.robot, arm.flange(HELD_Q)
    place = frames.tip + np.einsum("ijn,j->in", frames.rotation(), CUP.position)
    columns = np.cross(frames.z[:-1], place[None] - frames.origin[:-1], axis=1)  # (J, 3, N)
    torque = np.einsum("jcn,nc->nj", columns, force)
    assert arm.effects.gear_stiffness is not None
    out = torque @ robot.gear_to_joint.T / arm.effects.gear_stiffness @ robot.gear_to_joint
    assert np.abs(out).max() > 1e-5
    return np.asarray(out)


@pytest.mark.parametrize("name", ["qc20w_300", "drawwire_2m"])
def test_the_arm_yields_under_rod_and_wire_by_the_gears_that_the_force_loads(
    elastic: TrueArm, name: str
) -> None:
    """To first order; the force is at most 20 N, the second order below 1e-8 rad."""
    plant = {"rod_mass_kg": 1e-6, "rod_spring_N_per_m": 0.0, "wire_tension_N": 20.0}
    friction = 20.0 if name == "qc20w_300" else 0.0
    joints, force, sight = held(elastic, load_instrument(name), plant, friction)
    assert force == pytest.approx([20.0, 20.0], rel=1e-6)
    expected = yielded(elastic, -force[:, None] * sight)  # tension pulls back
    assert joints - elastic.joints(HELD_Q) == pytest.approx(expected, abs=5e-8)


def test_half_of_a_rods_weight_hangs_on_the_arm(elastic: TrueArm) -> None:
    """Its halves have equal mass; the tool's cup carries the upper one, whose slide is free."""
    rod = load_instrument("qc20w_300")
    light, heavy = (
        held(elastic, rod, {"rod_mass_kg": mass, "rod_spring_N_per_m": 0.0})[0]
        for mass in (1e-6, 2.0)
    )
    expected = yielded(elastic, np.tile([0.0, 0.0, -1.0 * 9.81], (2, 1)))
    # first order of a yield of 1e-4 rad
    assert heavy - light == pytest.approx(expected, abs=5e-8)


def test_auto_takes_mujoco_for_a_rod_on_elastic_gears() -> None:
    simulation = simulated("qc20w_300", {"joint_compliance": JointCompliance().model_dump()})
    assert simulation.truth.plant == "mujoco"
    assert simulation.truth.force_N is not None
    low, high = simulation.truth.force_N
    assert -1.5 < low < high < 1.5, "spring of 0.5 N at the ends, friction 0.3 N"
    kinematic = simulated(
        "qc20w_300", {"joint_compliance": {}}, plant={"kind": "kinematic"}
    ).rows.values
    change = np.abs(simulation.rows.values - kinematic).max()
    assert 1e-8 < change < 2e-5, "half the rod's weight, 1.2 N, on gears of 4e4 N m/rad and more"
