"""A seat or a target that moved between two rows is found, named, and fitted as another one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.cell.placement import Placement
from ballbar.cell.poses import Measured, PoseTable
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.held_out import held_out_poses
from ballbar.ident.moved_seats import confirms
from ballbar.ident.options import FitOptions
from ballbar.ident.table_fit import fit_table
from ballbar.ident.table_steps import Step, instants, renamed
from tests.helpers.still_poses import SEAT, TARGET, angles, group, table_of, true_robot, verdict_of

PLAIN = FitOptions(joint_errors="none")
NOISE = 2e-5  # [m]
COUNT = 150


def stepped(measured: Measured, kind: str, shift: Array, at: int, seed: int = 0) -> PoseTable:
    """Poses of a UR5 whose seat or target is shifted (3,) [m] from pose `at` on."""
    true, q = true_robot("ur5", seed=seed), angles("ur5", COUNT, seed)
    rng, moved = np.random.default_rng([seed, 8]), np.arange(COUNT)[:, None] >= at
    target = Placement(TARGET.rotation, TARGET.origin + (shift if kind == "target" else 0.0))
    points = np.where(moved, true.positions(q, target), true.positions(q))
    away = points - SEAT.origin - (moved * shift if kind == "seat" else 0.0)
    if measured == "length":
        away = np.linalg.norm(away, axis=1)[:, None]
    values = away + rng.normal(0.0, NOISE, away.shape)
    sigma = np.full(values.shape, NOISE)
    return PoseTable("ur5", true.robot, (group(measured, "hall", q, values, sigma),))


@pytest.mark.parametrize("measured", ["point", "length"])
@pytest.mark.parametrize("kind", ["seat", "target"])
@pytest.mark.parametrize("size", [2e-4, 4e-3])
def test_a_step_is_found_with_its_row_and_size(measured: Measured, kind: str, size: float) -> None:
    shift = size * np.array([0.6, -0.64, 0.48])
    result = fit_table(stepped(measured, kind, shift, at=60), PLAIN)
    (step,) = result.findings.steps
    assert (step.kind, step.file) == (kind, "table.csv")
    assert abs(step.row - 62) <= 1
    assert step.size == pytest.approx(size, rel=0.15)
    name = "hall" if kind == "seat" else "ball"
    placed = result.table.seats if kind == "seat" else result.table.targets
    assert set(placed) == {name, f"{name} before row {step.row}"}
    assert result.cross_validation.mean < 4.0 * NOISE
    (said,) = [w for w in verdict_of(result).warnings if w.startswith(f"{kind} {name} moved by")]
    assert f"before table.csv:{step.row}" in said


def test_held_out_rows_of_the_same_file_belong_to_the_right_side() -> None:
    whole = stepped("point", "seat", np.array([0.0, 5e-3, 0.0]), at=60)
    fitted = np.random.default_rng(0).permutation(COUNT) < 110
    result = fit_table(whole.part(fitted), PLAIN)
    assert np.linalg.norm(result.deviations(whole.part(~fitted)), axis=1).max() < 1e-3
    assert result.within(whole.part(~fitted)).mean() > 0.8


@pytest.mark.parametrize("measured", ["point", "length"])
@pytest.mark.parametrize("kind", ["seat", "target"])
@pytest.mark.parametrize("size", [1e-2, 0.3])
def test_a_step_of_more_than_5_mm_is_another_seat_or_target(
    measured: Measured, kind: str, size: float
) -> None:
    """A reflector 150 mm away in a third file was called a target that moved, and the fit good."""
    shift = size * np.array([0.6, -0.64, 0.48])
    with pytest.raises(InputError, match=rf"table.csv:6[123] on: that is another {kind}, not"):
        fit_table(stepped(measured, kind, shift, at=60), PLAIN)


def three_targets(files: bool) -> PoseTable:
    """A rigid triangle of reflectors at the same poses: one file each, or rows of one file."""
    true, q = true_robot("ur5", seed=5, orders=[(0, 13)]), angles("ur5", COUNT, 5)
    rng, groups = np.random.default_rng(9), []
    for k, place in enumerate(([0.0, 0.0, 0.0], [0.12, 0.03, 0.02], [-0.05, 0.11, -0.03])):
        target = Placement(TARGET.rotation, TARGET.origin + place)
        values = true.positions(q, target) - SEAT.origin
        values = values + np.linspace(0.0, 8e-5, COUNT)[:, None] ** [1, 2, 1]  # it warms up
        values = values + rng.normal(0.0, NOISE, values.shape)
        rows = np.arange(COUNT) + 2 if files else 3 * np.arange(COUNT) + 2 + k
        part = group("point", "hall", q, values, np.full(values.shape, NOISE), f"ball {k}")
        groups.append(replace(part, rows=rows, file=f"{k}.csv" if files else "all.csv"))
    return PoseTable("triangle", true.robot, tuple(groups))


def test_three_targets_in_three_files_are_what_they_are_in_one() -> None:
    """Three passes over the same poses looked like three sessions, with five false steps."""
    results = [fit_table(three_targets(files), PLAIN) for files in (True, False)]
    assert [r.findings.steps for r in results] == [(), ()]
    assert results[0].fit.x == pytest.approx(results[1].fit.x, rel=1e-9, abs=1e-12)


def test_equal_poses_of_one_seat_and_target_far_apart_are_refused() -> None:
    table = three_targets(files=True)
    merged = replace(table, groups=tuple(replace(g, target="ball") for g in table.groups))
    with pytest.raises(InputError, match=r"0.csv and 1.csv and 2.csv: rows .* lie 1\d\d.\d mm"):
        fit_table(merged, PLAIN)
    same = [replace(table.groups[0], file=name) for name in ("a.csv", "b.csv")]
    assert fit_table(replace(table, groups=tuple(same)), PLAIN).findings.steps == ()


def test_instants_follow_time_or_rows_of_equal_poses() -> None:
    table = three_targets(files=True)
    count = np.arange(COUNT)
    assert (instants(table) == np.tile(count, 3)).all()
    part = replace(table, groups=(table.groups[0], table.groups[1].part(count % 2 == 1)))
    assert (instants(part) == np.concatenate((count, count[1::2]))).all()
    timed = [replace(g, time=10.0 * count + k) for k, g in enumerate(table.groups)]
    assert (
        np.diff(instants(replace(table, groups=tuple(timed))).reshape(3, -1), axis=0) == 1
    ).all()


def test_a_held_out_table_is_judged_with_the_target_as_it_stood() -> None:
    whole = stepped("point", "target", np.array([0.0, 1e-3, 0.0]), at=60)
    (group,) = whole.groups
    held = np.arange(COUNT) % 5 == 0
    result = fit_table(whole.part(~held), PLAIN)
    (step,) = result.findings.steps
    for early in (True, False):
        chosen = held & ((np.arange(COUNT) < 60) == early)
        table = replace(whole, name="held", groups=(replace(group.part(chosen), file="held.csv"),))
        outcome = held_out_poses(result, table)
        assert outcome.moved == ((step.other,) if early == step.before else ())
        assert outcome.error.mean() < 2e-4
        assert (step.other in outcome.sentence) == bool(outcome.moved)


def test_a_seat_may_move_between_two_files() -> None:
    whole = stepped("point", "seat", np.array([2e-3, 0.0, 4e-3]), at=70)
    (group,) = whole.groups
    parts = [
        replace(group.part(np.arange(COUNT) < 70), file="a.csv"),
        replace(group.part(np.arange(COUNT) >= 70), file="b.csv"),
    ]
    result = fit_table(replace(whole, groups=tuple(parts)), PLAIN)
    (step,) = result.findings.steps
    assert step.other == "hall before b.csv row 72"
    later = stepped("point", "seat", np.array([0.0, 5e-3, 0.0]), at=100)
    (step,) = fit_table(later, PLAIN).findings.steps
    assert step.other == f"hall from row {step.row}"


@pytest.mark.long
@pytest.mark.parametrize("measured", ["point", "length"])
def test_clean_and_drifting_tables_have_no_steps(measured: Measured) -> None:
    for name in ("ur5", "irb2400"):
        for seed in range(3):
            true = true_robot(name, seed=seed, orders=[(1, 3), (2, 2)], amplitude=8e-5)
            table = table_of(true, measured, count=100, seed=seed)
            assert fit_table(table, PLAIN).findings.steps == ()
    drift = np.linspace(0.0, 2e-4, COUNT)[:, None]
    (group,) = stepped("point", "seat", np.zeros(3), at=60).groups
    table = PoseTable("t", true_robot("ur5").robot, (replace(group, values=group.values + drift),))
    assert fit_table(table, PLAIN).findings.steps == ()


@pytest.mark.parametrize(("over", "steps"), [(1, 1), (32, 0), (48, 0)])
def test_a_gradual_change_is_no_step(over: int, steps: int) -> None:
    (group,) = stepped("point", "seat", np.zeros(3), at=60).groups
    gone = np.clip((np.arange(COUNT) - 75) / over + 0.5, 0.0, 1.0)
    values = group.values + 1e-3 * gone[:, None] * [0.6, -0.64, 0.48]
    table = PoseTable("t", true_robot("ur5").robot, (replace(group, values=values),))
    assert len(fit_table(table, PLAIN).findings.steps) == steps


def test_a_few_outliers_and_another_robot_are_no_steps() -> None:
    (group,) = stepped("point", "seat", np.zeros(3), at=60).groups
    values = group.values.copy()
    values[[20, 21, 22, 90]] += 5e-3
    table = PoseTable("t", true_robot("ur5").robot, (replace(group, values=values),))
    assert fit_table(table, PLAIN).findings.steps == ()
    wrong = replace(table, groups=(replace(group, q=group.q[:, [0, 2, 1, 3, 4, 5]]),))
    assert fit_table(wrong, PLAIN).findings.steps == ()


def test_the_steps_of_a_result_rename_the_rows_behind_them_alone() -> None:
    whole = stepped("point", "seat", np.array([0.0, 5e-3, 0.0]), at=60)
    found = fit_table(whole, PLAIN).findings.steps
    assert renamed(whole, ()) is whole
    table = renamed(whole, found)
    assert sum(len(group.q) for group in table.groups) == COUNT
    assert {group.seat: len(group.q) for group in table.groups} == pytest.approx(
        {"hall": COUNT - 60, found[0].other: 60}, abs=1
    )


@pytest.mark.parametrize(
    ("before", "after", "size", "out", "confirmed"),
    [
        (2e-4, 5e-5, 1.0e-3, 1.0e-3, True),
        (2e-4, 2e-4, 1.0e-3, 1.0e-3, False),  # the model leaves as much with it
        (2e-4, 5e-5, 1.0e-3, 3.0e-3, False),  # it depends on what else is fitted
        (2e-4, 5e-5, 1.2e-4, 1.2e-4, False),  # a base drifts by as much within hours
        (2e-3, 5e-4, 6.0e-3, 2.0e-2, True),  # of one so large the first size says little
        (2e-4, 1.9e-4, 2.5e-4, 2.5e-4, False),  # less than one and a half of what is left
    ],
)
def test_a_step_is_confirmed_by_the_fit_that_has_it(
    before: float, after: float, size: float, out: float, *, confirmed: bool
) -> None:
    def fit_with(position: float) -> Fit:
        return cast("Fit", SimpleNamespace(excess=SimpleNamespace(position=position)))

    first = Step(
        kind="seat", name="hall", other="hall from row 9", file="table.csv", row=9, before=False,
        sides={}, shift=np.array([size, 0.0, 0.0]), score=50.0,
    )  # fmt: skip
    second = replace(first, shift=np.array([out, 0.0, 0.0]))
    assert confirms(fit_with(before), fit_with(after), first, second) is confirmed
