"""How often a certificate accepts robots that do not conform: 200 drawn robots at the tolerance.

    python -m benchmarks.decision_rule              # 200 robots; two minutes of one core
    python -m benchmarks.decision_rule --robots 20

Drawn are the geometry of an IRB 2400 (1 mm, 1 mrad) and white noise of 100 urad on every angle of
300 paired samples with four encoders (kinematic samples, the plate exact); the stated covariance is
that of the fit. The true mean TCP error over the workspace of the nominal and of the identified
robot is known, and each robot is tried against two tolerances: one just below its true error, where
every acceptance is wrong and most likely, and one drawn evenly within three standard uncertainties
of it. Writes docs/studies/decision_rule.csv, a row for each robot, quantity and rule.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from typing import Any, cast

import numpy as np

from ballbar.certificate.conformity import Tolerance, decide, error_draws
from ballbar.ident.result import RobotEstimate
from ballbar.ident.robot.accuracy import accuracy_grid, tcp_error
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.ident.robot.tool_covariance import ToolCovariance
from ballbar.ident.thesis.paired_samples import fit_samples
from ballbar.scenario import Scenario, load_scenario
from ballbar.trial.sample_trial import sampled_cell, trial_samples
from benchmarks.study import SCENARIOS, STUDIES, study_parser, write_table

RULES = ("simple", "guarded", "probability")
ENCODERS = (1, 2, 4, 5)
NOISE, SAMPLES = 1e-4, 300  # [rad] of every angle; number
JUST_BELOW = 1e-9  # relative


class Estimate:
    """A robot with its covariance, as much of `RobotEstimate` as draws need."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        samples, rng = trial_samples(scenario, SCENARIOS), np.random.default_rng([seed, 106])
        noisy = (a + NOISE * rng.standard_normal(a.shape) for a in (samples.q, samples.b))
        found = fit_samples(samples.t, *noisy, ENCODERS, samples.nominal)
        cell, geometry = sampled_cell(scenario, SCENARIOS), found.fit.geometry()
        names = tuple(geometry.table.names[i] for i in found.parameters)
        values = found.fit.covariance[: len(names), : len(names)]
        values = values * max(1.0, found.fit.chi2_per_dof)
        masses = np.zeros((0, 4 + 4 * cell.robot.joints))
        self.truth, self.nominal = samples.true, samples.nominal
        self.identified = IdentifiedRobot(
            cell, geometry, stated=ToolCovariance(names, masses, values)
        )


def rows_of(seed: int) -> list[dict[str, Any]]:
    """Decisions about one robot."""
    base = load_scenario(SCENARIOS / "irb2400.yaml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    base |= {"plant": {"kind": "kinematic"}, "seed": seed, "accept": {}}
    base["errors"] = {"static": {"sigma_m": 1e-3, "sigma_rad": 1e-3}}
    base["encoders"] = {"fitted": list(ENCODERS)}
    base["identify"] = {"data": "samples", "samples": SAMPLES}
    estimate = Estimate(Scenario.model_validate(base, strict=False), seed)
    rng = np.random.default_rng([seed, 14253])
    rows, grid = [], accuracy_grid(estimate.identified.robot)
    _, draws = error_draws(cast(RobotEstimate, estimate))
    for robot, model in (
        ("nominal", estimate.nominal),
        ("identified", estimate.identified.geometry),
    ):
        own = draws[robot, "mean"]
        true = tcp_error(model, estimate.truth, grid).mean
        near = true + float(rng.uniform(-3.0, 3.0)) * float(own.std())
        for name in RULES:
            rule = Tolerance(rule=name)
            at, beside = (decide(own, t, rule) for t in (true * (1.0 - JUST_BELOW), near))
            rows.append(
                {
                    "seed": seed,
                    "robot": robot,
                    "rule": name,
                    "true_mm": 1e3 * true,
                    "value_mm": 1e3 * at.value,
                    "sigma_mm": 1e3 * at.sigma,
                    "accepted_at_the_limit": int(at.verdict == "conforms"),
                    "tolerance_mm": 1e3 * near,
                    "conforms": int(true <= near),
                    "verdict": beside.verdict,
                    "falsely_accepted": int(true > near and beside.verdict == "conforms"),
                }
            )
    return rows


def summary(rows: list[dict[str, Any]]) -> None:
    """Prints shares of each quantity and rule."""
    for robot in ("nominal", "identified"):
        for name in RULES:
            own = [row for row in rows if (row["robot"], row["rule"]) == (robot, name)]
            at = sum(row["accepted_at_the_limit"] for row in own)
            not_conforming = [row for row in own if not row["conforms"]]
            false = sum(row["falsely_accepted"] for row in own)
            conforming = [row for row in own if row["conforms"]]
            rejected = sum(row["verdict"] == "does not conform" for row in conforming)
            risk, share = f"{Tolerance(rule=name).risk:.1%}", f"{at / len(own):.1%}"
            print(
                f"{robot}, {name} (states at most {risk}): accepted at the limit {at} of "
                f"{len(own)} ({share}); near it falsely accepted {false} of "
                f"{len(not_conforming)}, falsely rejected {rejected} of {len(conforming)}"
            )


def main() -> None:
    """Draws, identifies, decides, and writes the rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--robots", type=int, default=200)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for own in pool.map(rows_of, range(1, options.robots + 1)):
            rows += own
            write_table(STUDIES / "decision_rule.csv", rows, ".5g")
    summary(rows)


if __name__ == "__main__":
    main()
