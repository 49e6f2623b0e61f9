"""Whether two files of still poses share seat and target, over drawn robots, seats and targets."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ballbar.cell.poses import PoseTable
from ballbar.recordings.file_relations import MeasuredFile, relation
from tests.helpers.drawn_pose_tables import SEAT, TARGET, drawn_robot, point_table

WAYS = list(product((True, False), repeat=2))


def measured(name: str, table: PoseTable) -> MeasuredFile:
    return MeasuredFile(name, table.groups[0], table.robot)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["ur5", "panda", "irb2400"])
@pytest.mark.parametrize("again", [True, False], ids=["equal poses", "other poses"])
def test_what_two_files_share_is_seen_over_drawn_robots(robot: str, again: bool) -> None:
    """Seats move by 0.3 m, targets by 40 mm, in drawn directions; 40 poses and a tenth bad rows."""
    rng = np.random.default_rng(7)
    seen = []
    for seat, target in 4 * WAYS:
        drawn = drawn_robot(robot, rng)
        q = drawn.angles(40, rng)
        first = point_table(drawn, q, 2e-5, rng)
        q = q[rng.permutation(40)] if again else drawn.angles(40, rng)
        away, beside = rng.standard_normal((2, 3))
        second = point_table(
            drawn,
            q,
            2e-5,
            rng,
            seat=SEAT if seat else SEAT + 0.3 * away / np.linalg.norm(away),
            target=TARGET if target else TARGET + 0.04 * beside / np.linalg.norm(beside),
        )
        bad = second.groups[0].values.copy()
        bad[:4] += 2e-3 * rng.standard_normal((4, 3))
        second = replace(second, groups=(replace(second.groups[0], values=bad, q=np.round(q, 3)),))
        seen.append(relation(measured("a", first), measured("b", second)).shared)
    assert seen == 4 * WAYS
