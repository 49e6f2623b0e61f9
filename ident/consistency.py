"""Do all parts of all recordings show one machine? They judge each other, to first order.

Freed of the others in a group of unknowns (a zero, the rod, all of the robot), the blocks of a
recording lower the cost of the fit by so much for each unknown: about one where all agree, some
times as much where small things are in no model. A group that exceeds this level by far has changed
between the recordings; likewise of the blocks behind an instant, within one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.arrays import Array
from cell.geometry import parameter_named
from ident.corrections.remounted_tool import KINDS
from ident.estimator.fit import Fit
from ident.estimator.time_blocks import TimeBlocks, time_blocks
from ident.estimator.unknowns import BASE_POSE

# Times the level that a group's decrease must reach for each of its unknowns. Drawn machines that
# did not change reach 9 between recordings and 15 within them, a zero of axis 4 that moved by
# 0.1 mrad 37 to 110 (notes/unknown_machines, 4).
CHANGED = 20.0
# A group is the cause if it brings this share of what any other, larger one does.
SHARE = 0.6
EDGE = 3  # blocks at either end of a recording, where a change is little more than another start


@dataclass(frozen=True)
class Change:
    """Something that is not the same in one recording as in the others, or behind an instant."""

    recording: int  # from 0
    time: float | None  # [s] on the ball-bar's clock; None: all of the recording
    group: str  # as of `_groups`
    size: float  # [m, rad] of a group with one unknown, or the length of its first three
    times: float  # decrease for each unknown, over the level


@dataclass(frozen=True, eq=False)
class Consistency:
    """How the recordings of a fit agree."""

    held_out: tuple[float, ...]  # residual of each by the machine of the others, over its own
    change: Change | None  # the surest


def consistency(fit: Fit) -> Consistency:
    """How the recordings of a fit, and the parts of each, agree with each other."""
    blocks, count = time_blocks(fit), len(fit.model.recordings)
    ratios = []
    for k in range(count if count > 1 else 0):
        left, own = blocks.recording == k, _own(fit, k)
        stated = blocks.cost[left].sum() + blocks.expected(left, own)
        ratios.append(float(np.sqrt(max(0.0, blocks.left_out(left, own)) / stated)))
    return Consistency(tuple(ratios), _surest(blocks))


def _surest(blocks: TimeBlocks) -> Change | None:
    """The change that explains most, if any does."""
    parts = [_Part.of(blocks, *part) for part in _parts(blocks)]
    if not parts:
        return None
    level = max(1.0, float(np.median([v for part in parts for v in part.each.values()])))
    changes = [change for part in parts if (change := part.change(level)) is not None]
    return max(changes, key=lambda change: change.times, default=None)


@dataclass(frozen=True, eq=False)
class _Part:
    """Blocks that may differ from the others, and what each group would explain of them."""

    recording: int
    time: float | None
    tests: dict[str, tuple[float, Array]]  # decrease of the cost, and change, of each group

    @classmethod
    def of(
        cls, blocks: TimeBlocks, recording: int, time: float | None, after: NDArray[np.bool_]
    ) -> _Part:
        groups = _groups(blocks.fit, recording, within=time is not None)
        tests = {name: blocks.changed(after, group) for name, group in groups.items()}
        return cls(recording, time, tests)

    @property
    def each(self) -> dict[str, float]:
        """Decrease for each unknown."""
        return {name: decrease / step.size for name, (decrease, step) in self.tests.items()}

    def change(self, level: float) -> Change | None:
        """The smallest group that explains nearly as much as any other, if it is beyond chance."""
        each = self.each
        beyond = {name: (each[name] - level) * v[1].size for name, v in self.tests.items()}
        enough = SHARE * max(beyond.values())
        causes = [n for n in each if beyond[n] >= enough and each[n] > CHANGED * level]
        if not causes:
            return None
        cause = min(causes, key=lambda name: self.tests[name][1].size)
        step = self.tests[cause][1]
        size = float(step[0]) if step.size == 1 else float(np.linalg.norm(step[:3]))
        return Change(self.recording, self.time, cause, size, each[cause] / level)


def _parts(blocks: TimeBlocks) -> Iterator[tuple[int, float | None, NDArray[np.bool_]]]:
    """Blocks that may differ from the others: each recording, and what follows an instant."""
    count = int(blocks.recording.max()) + 1
    for k in range(1 if count == 2 else 0, count if count > 1 else 0):
        yield k, None, blocks.recording == k
    for k in range(count):
        here = np.flatnonzero(blocks.recording == k)
        for first in here[EDGE : here.size - EDGE + 1]:
            after = np.zeros(blocks.recording.size, dtype=np.bool_)
            after[first : here[-1] + 1] = True
            yield k, float(blocks.start[first]), after


def _groups(fit: Fit, recording: int, *, within: bool) -> dict[str, NDArray[np.intp]]:
    """Unknowns that change together, by what they are called.

    within : whether during a recording, where its seat may change too.
    """
    layout = fit.model.unknowns
    shared = [(i, parameter_named(layout.names[i])) for i in range(layout.shared.size)]
    last = max(p.row for _, p in shared if p.side == "robot")
    groups = {p.name: [i] for i, p in shared if p.name == "bd3" or p.name.startswith("rtheta")}
    tool = [i for i, p in shared if p.side == "robot" and p.row == last and p.kind in KINDS]
    if within:
        tail = f"@{recording + 1}" if len(layout.own) > 1 else ""
        groups["seat"] = [layout.names.index(name + tail) for name in BASE_POSE]
        return {name: np.array(at) for name, at in {**groups, "tool": tool}.items() if at}
    coefficients = range(layout.coefficients.start, layout.coefficients.stop)
    compliant = [i for i in coefficients if layout.names[i].startswith("compliance")]
    for i in compliant:
        gear = layout.names[i].removeprefix("compliance")
        own = (f"compliance{gear}", f"backlash{gear}", f"ripple{gear}_")
        groups[f"gear{gear}"] = [j for j in coefficients if layout.names[j].startswith(own)]
    groups |= {"loads": compliant, "bar": [i for i, p in shared if p.side == "bar"]}
    groups["robot"] = [i for i, p in shared if p.side == "robot"]
    if not any(name.startswith("remount_") for name in layout.names):
        groups["tool"] = tool
    return {name: np.array(at) for name, at in groups.items() if at}


def _own(fit: Fit, k: int) -> NDArray[np.intp]:
    """Indices of the unknowns of recording k."""
    own = fit.model.unknowns.own[k]
    parts = (own.geometry, own.clock, own.steps, own.knots)
    return np.concatenate([np.arange(p.start, p.stop) for p in parts if p is not None])
