"""poses.yaml of three public data sets of real robots, which lie beside the project.

They are never copied: a poses.yaml that is written to some folder refers to them by path.

| folder | public source, commit, licence |
|---|---|
| ur5_tracker | pauljac7700/serial_robots_datasets 759068d, MIT |
| ur10_tmac | christianlandgraf/ipa-robot-accuracy 507fba6, MIT |
| panda_sockets | platonics-delft/kinematics_calibration 05a05ab, MIT |
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ballbar.cell.files import write_yaml

DATA = Path(__file__).parents[3] / "shared" / "real_robots"
PANDA_SITES = {
    "panda_3": (
        *("backcenter", "backleft", "backright"),
        *("frontcenter", "frontleft", "frontright"),
    ),
    "panda_6": ("front", "left", "right"),
}
_UR10_JOINTS = (
    *("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"),
    *("wrist_1_joint", "wrist_2_joint", "wrist_3_joint"),
)


def ur5_grid(folder: Path, data: Path = DATA) -> Path:
    """poses.yaml of the 1000 poses of a UR5 on a grid, in a new folder."""
    return _ur5(folder, data / "ur5_tracker" / "3D_UR5_uncalibrated_grid_cleaned.csv")


def ur5_random(folder: Path, data: Path = DATA) -> Path:
    """poses.yaml of the 20 random poses of the same UR5, in a new folder."""
    return _ur5(folder, data / "ur5_tracker" / "3D_UR5_uncalibrated_random_cleaned.csv")


def ur10_a(folder: Path, data: Path = DATA) -> Path:
    """poses.yaml of the UR10's series A of July 2020, in a new folder."""
    table = data / "ur10_tmac" / "Series_A" / "measurements_grid.csv"
    return _ur10(folder, table, "Series A", {})


def ur10_b(folder: Path, data: Path = DATA) -> Path:
    """poses.yaml of the UR10's series B of November 2020, with a sigma of each value."""
    table = data / "ur10_tmac" / "Series_B" / "measurements_joint_configurations.csv"
    sigma = {"columns": [f"measurement_std_{name}" for name in _POSE]}
    return _ur10(folder, table, "Series B", {"sigma": sigma})


def panda(folder: Path, name: str, sites: Sequence[str] = (), data: Path = DATA) -> Path:
    """poses.yaml of a Panda's sockets in a new folder.

    name : panda_3 or panda_6. sites : those of PANDA_SITES that are read; all if none is named.
    """
    sites = tuple(sites) or PANDA_SITES[name]
    tables = [
        {
            "files": [str(data / "panda_sockets" / name / site / f"{hole}.csv")],
            "joints": {"columns": [1, 2, 3, 4, 5, 6, 7], "unit": "rad"},
            "seat": f"{site}/{hole}",
            "target": "ball",
        }
        for site in sites
        for hole in ("hole_0", "hole_1")
    ]
    pairs = [[f"{site}/hole_0", f"{site}/hole_1"] for site in sites]
    distances = [{"pairs": pairs}]  # 50 mm, as the instrument states
    description = {"robot": "panda", "instrument": "socket_pair_50", "tables": tables}
    return _written(folder, {**description, "distances": distances, "notes": name})


_POSE = ("x", "y", "z", "rx", "ry", "rz")


def _ur5(folder: Path, file: Path) -> Path:
    table = {
        "files": [str(file)],
        "joints": {"columns": [f"joint_{k}" for k in range(1, 7)], "unit": "deg"},
        "values": {"columns": [f"{c}_t - {c}_dif" for c in "xyz"], "unit": "mm"},
        "seat": "tracker",
        "target": "reflector",
    }
    description = {"robot": "ur5", "instrument": "tracker_point", "tables": [table]}
    return _written(folder, {**description, "notes": file.stem})


def _ur10(folder: Path, file: Path, notes: str, more: dict[str, Any]) -> Path:
    table = {
        "files": [str(file)],
        "joints": {"columns": list(_UR10_JOINTS), "unit": "rad"},
        "values": {
            "columns": [f"measurement_{name}" for name in _POSE],
            "unit": "mm",
            "angle_unit": "deg",
            "rotation": "XYZ",
        },
        "seat": "tracker",
        "target": "T-Mac",
        "time": {"column": "Timestamp"},
        "temperature": {"column": "measurement_temperature"},
        **more,
    }
    description = {"robot": "ur10", "instrument": "tracker_pose", "tables": [table]}
    return _written(folder, {**description, "notes": notes})


def _written(folder: Path, description: dict[str, Any]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "poses.yaml"
    write_yaml(path, {"schema": "ballbar-poses/1", "kind": "real", **description})
    return path
