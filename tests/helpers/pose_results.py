"""calibration.yaml of still poses for tests of what is done with it, and tables as files."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.files import write_yaml
from ballbar.cell.geometry import nominal_chain
from ballbar.cell.load import load_robot
from ballbar.cell.poses import PoseTable
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.build_unknowns import arm_parameters

RANGE = 2.0  # [rad] over which every joint is said to be fitted
ORDER = 17  # of the joint error of joint 2


def write_pose_result(path: Path, name: str, *, seed: int) -> Path:
    """A result with drawn errors of 1 mrad and 0.3 mm, sag, a joint error and two targets."""
    rng, robot = np.random.default_rng(seed), load_robot(name)
    nominal = nominal_chain(robot)
    parameters = {}
    for p in arm_parameters(robot):
        value = float(getattr(nominal, p.kind)[p.row])
        size = 3e-4 if p.is_length else 1e-3
        parameters[p.name] = {
            "nominal": value,
            "value": value + size * float(rng.standard_normal()),
            "sigma": 2e-5,
            "identified": True,
        }

    def coefficient(value: float, unit: str) -> dict[str, object]:
        return {
            "value": value, "sigma": 1e-6, "prior": 0.0, "prior_sigma": 1e-3,
            "information_gain": 0.9, "unit": unit,
        }  # fmt: skip

    weights = unit_weights(robot).coefficients
    placed = {"position_m": [0.05, -0.03, 0.12], "position_sigma_m": [1e-5, 1e-5, 1e-5]}
    _write(
        path,
        {
            "schema": "ballbar-calibration/2",
            "robot": name,
            "instrument": "tracker_point",
            "model": "poses",
            "parameters": parameters,
            "corrections": {
                "unit_weights": {c.name: coefficient(1e-4, c.unit) for c in weights},
                "joint_harmonics": {
                    f"joint2_{ORDER}_cos": coefficient(1e-4, "rad"),
                    f"joint2_{ORDER}_sin": coefficient(-5e-5, "rad"),
                },
            },
            "orders": [{"joint": 2, "order": ORDER, "score": 90.0, "gain": 0.2}],
            "seats": {"tracker": {**placed, "rotation_vector_rad": [0.1, 0.0, 0.4]}},
            "targets": {
                "big ball": placed,
                "frame": {**placed, "rotation_vector_rad": [0.3, -0.2, 0.1]},
            },
            "ranges": [{"lower_rad": -RANGE, "upper_rad": RANGE}] * robot.joints,
            "recordings": [
                {
                    "file": "made.csv", "measured": "point", "seat": "tracker",
                    "target": "big ball", "poses": 100, "position_rms_m": 5e-5,
                }
            ],
            "cross_validation": {
                "mean_m": 8e-5, "quantile_95_m": 1.5e-4, "sigma_m": 5e-5, "region_factor": 1.1,
            },
            "fit": {
                "status": "good", "verdict": "Made for a test.", "warnings": [], "iterations": 4,
                "unknowns": 40, "poses": 100, "tcp_sigma_mean_m": 9e-5, "discrepancy_m": 5e-5,
                "residual_mean_m": 8e-5, "nominal_mean_m": 1e-3,
            },
        },
    )  # fmt: skip
    return path


def _write(path: Path, content: dict[str, object]) -> None:
    """Writes plain data; what stands twice is written twice, since aliases are refused."""
    write_yaml(path, json.loads(json.dumps(content)))


def write_pose_table(folder: Path, table: PoseTable, robot: str, q: Array, target: str) -> Path:
    """The measured points of a table, said to be taken at angles q (N, J) [rad], as a folder."""
    folder.mkdir(parents=True)
    joints, values = [f"q{j + 1}" for j in range(q.shape[1])], table.groups[0].values
    with (folder / "poses.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*joints, "x", "y", "z"])
        writer.writerows(np.hstack((q, values)).tolist())
    write_yaml(
        folder / "poses.yaml",
        {
            "schema": "ballbar-poses/1",
            "kind": "real",
            "robot": robot,
            "instrument": "tracker_point",
            "tables": [
                {
                    "files": ["poses.csv"],
                    "joints": {"columns": joints, "unit": "rad", "angles": "joints"},
                    "values": {"columns": ["x", "y", "z"], "unit": "m"},
                    "seat": "tracker",
                    "target": target,
                }
            ],
        },
    )
    return folder
