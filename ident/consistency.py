"""Do all parts of all recordings show one machine? They judge each other, to first order.

Freed of the others in a group of unknowns (a zero, the rod, all of the robot), the blocks of a
recording lower the cost of the fit by so much for each unknown: about one where all agree, some
times as much where small things are in no model. A group that exceeds this level by far has changed
between the recordings; the same of the blocks after an instant, within one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import parameter_named
from ballbar.ident.corrections.remounted_tool import KINDS
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.priors import BASE_POSE
from ballbar.ident.estimator.time_blocks import BlocksLeftOut, TimeBlocks, time_blocks
from ballbar.ident.single_causes import WANDERS, worded

# Decrease for a single unknown, over what is left with the change in the model, from which it is
# one; for each of k unknowns 1 + (SINGLE - 1) / k^(1/4). SURE times that is asked for: machines
# that did not change reach 0.8, with forces that nothing measures 3.3; an axis zero that moved by
# 50 or 100 urad, another tool or another robot 13 to 160.
SINGLE, SURE = 25.0, 5.0
# A group is the cause if it brings this share of what any other, larger one does.
SHARE = 0.6
# Least change that matters, however many rows make it certain: of an axis zero or the rod, over
# what an unchanged machine is apart by from one recording to the next; of several unknowns
# together, the share of the cost of the blocks in question that it explains: 0.1 is 5 % of their
# rms residual.
# Sound recordings of a minute have 0.02, a zero that moved by 50 urad 0.96.
LEAST_CHANGE, LEAST_SHARE = 2.5, 0.1
# Share from which a change is the cause. Another robot explains 0.9 and more, a seat that fell by
# 0.1 mm 0.5; hysteresis of the gears passed for a seat or another robot that explained 0.1 to 0.3.
CAUSE = 0.4
EDGE = 3  # blocks at either end of a recording, where a change is little more than another start


Group = tuple[str, str]  # kind and name of what changed, as of a Cause


@dataclass(frozen=True, eq=False)
class Change:
    """Something that is not the same in one recording as in the others, or behind an instant."""

    recording: int  # from 0
    time: float | None  # [s] on the ball-bar's clock; None: all of the recording
    group: Group
    size: Array  # (K,) [m, rad] or SI of the coefficients, of the group's unknowns
    times: float  # what it explains over what chance and small things would
    share: float = 1.0  # of the cost of the blocks in question, that it explains

    @property
    def matters(self) -> bool:
        """Whether it is large enough to change the tool's position."""
        if self.size.size == 1 and self.group[0] in WANDERS:
            return abs(float(self.size[0])) > LEAST_CHANGE * WANDERS[self.group[0]]
        return self.share > LEAST_SHARE

    @property
    def sentence(self) -> str:
        """The sentence that names the change and its remedy."""
        number, cause = self.recording + 1, worded(*self.group, self.size)
        if self.share < CAUSE:
            since = "" if self.time is None else f" from t = {self.time:.0f} s on"
            return (
                f"recording {number}{since} deviates from the rest, and no change of one part "
                f"explains more than {100.0 * self.share:.0f} % of that: something else is in the "
                "data that is not in the model. Look where the residuals stand out (report.html)"
            )
        if self.time is None:
            return (
                f"recording {number} is not of the same machine as the others: {cause}. Identify "
                "it by itself"
            )
        return (
            f"from t = {self.time:.0f} s on the machine of recording {number} is another one: "
            f"{cause}. Leave out what follows, or what comes before, and identify again"
        )


@dataclass(frozen=True, eq=False)
class Consistency:
    """How the recordings of a fit agree."""

    # residual of each by the machine of the others, over what noise and its uncertainty explain
    held_out: tuple[float, ...]
    change: Change | None  # the surest

    @property
    def sentence(self) -> str:
        """The sentence about the change; empty where everything agrees."""
        return "" if self.change is None else self.change.sentence


AGREED = Consistency((), None)


def consistency(fit: Fit) -> Consistency:
    """How the recordings of a fit, and the parts of each, agree with each other."""
    blocks, count = time_blocks(fit), len(fit.model.recordings)
    ratios = []
    for k in range(count if count > 1 else 0):
        left = blocks.added(blocks.recording == k)
        held_out = BlocksLeftOut(blocks, left, _own(fit, k))
        ratios.append(float(np.sqrt(max(0.0, held_out.cost()) / (left.cost + held_out.expected()))))
    return Consistency(tuple(ratios), _surest(blocks))


def _surest(blocks: TimeBlocks) -> Change | None:
    """The change that explains most, if it explains more than chance and small things do.

    Those are known by what is left once it is part of the model.
    """
    parts = list(_parts(blocks))
    changes = [(part.change(blocks), part) for part in parts]
    changes = [(change, part) for change, part in changes if change.matters]
    if not changes:
        return None
    change, part = max(changes, key=lambda pair: pair[0].times)
    if change.times < SURE:
        return None
    rest = blocks.freed(part.blocks, part.groups[change.group])
    left = [decrease / step.size for p in parts for decrease, step in p.tests(rest).values()]
    times = change.times / max(1.0, float(np.median(left)))
    return replace(change, times=times) if times > SURE else None


@dataclass(frozen=True, eq=False)
class _Part:
    """Blocks that may differ from the others, and the groups of unknowns that may do so there."""

    recording: int
    time: float | None
    blocks: NDArray[np.bool_]  # (B,)
    groups: dict[Group, NDArray[np.intp]]

    def tests(self, blocks: TimeBlocks) -> dict[Group, tuple[float, Array]]:
        """Decrease of the cost, and change, of each group."""
        part = blocks.added(self.blocks)
        return {name: blocks.changed(part, group) for name, group in self.groups.items()}

    def change(self, blocks: TimeBlocks) -> Change:
        """The smallest group that explains nearly as much as any other."""
        tests = self.tests(blocks)
        beyond = {name: decrease - step.size for name, (decrease, step) in tests.items()}
        enough = SHARE * max(0.0, *beyond.values())
        causes = [name for name in tests if beyond[name] >= enough] or list(tests)
        cause = min(causes, key=lambda name: (tests[name][1].size, -beyond[name]))
        decrease, step = tests[cause]
        times = decrease / step.size / (1.0 + (SINGLE - 1.0) / step.size**0.25)
        share = decrease / sum(blocks.blocks[b].cost for b in np.flatnonzero(self.blocks))
        size = step[:3] if cause[0] == "seat" else step  # the first three are its position
        return Change(self.recording, self.time, cause, size, float(times), share)


def _parts(blocks: TimeBlocks) -> Iterator[_Part]:
    """Blocks that may differ from the others: each recording, and what follows an instant."""
    count = int(blocks.recording.max()) + 1
    for k in range(1 if count == 2 else 0, count if count > 1 else 0):
        yield _Part(k, None, blocks.recording == k, _groups(blocks.fit, k, within=False))
    for k in range(count):
        here, groups = np.flatnonzero(blocks.recording == k), _groups(blocks.fit, k, within=True)
        for first in here[EDGE : here.size - EDGE + 1 : 2]:
            after = np.zeros(blocks.recording.size, dtype=np.bool_)
            after[first : here[-1] + 1] = True
            yield _Part(k, blocks.blocks[first].start, after, groups)


def _groups(fit: Fit, recording: int, *, within: bool) -> dict[Group, NDArray[np.intp]]:
    """Unknowns that change together, by what they are called.

    within : whether during a recording, where its seat may change too.
    """
    layout = fit.model.unknowns
    shared = [(i, parameter_named(layout.names[i])) for i in range(layout.shared.size)]
    last = max(p.row for _, p in shared if p.side == "robot")
    groups: dict[Group, list[int]] = {}
    for i, p in shared:
        if p.side == "robot" and p.kind == "theta":
            groups["axis", str(p.row + 1)] = [i]
        elif p.name == "bd3":
            groups["rod", ""] = [i]
    tool = [i for i, p in shared if p.side == "robot" and p.row == last and p.kind in KINDS]
    if within:
        tail = f"@{recording + 1}" if len(layout.own) > 1 else ""
        seat = {name + tail for name in BASE_POSE}
        groups["seat", ""] = [i for i, name in enumerate(layout.names) if name in seat]
        groups["tool", ""] = tool
        return {name: np.array(at) for name, at in groups.items() if at}
    coefficients = range(layout.coefficients.start, layout.coefficients.stop)
    compliant = [i for i in coefficients if layout.names[i].startswith("compliance")]
    for i in compliant:
        gear = layout.names[i].removeprefix("compliance")
        own = (f"compliance{gear}", f"backlash{gear}", f"ripple{gear}_")
        groups["gear", gear] = [j for j in coefficients if layout.names[j].startswith(own)]
    groups["loads", ""] = compliant
    groups["ball-bar", ""] = [i for i, p in shared if p.side == "bar"]
    groups["robot", ""] = [i for i, p in shared if p.side == "robot"]
    if not any(name.startswith("remount_") for name in layout.names):
        groups["tool", ""] = tool
    return {name: np.array(at) for name, at in groups.items() if at}


def _own(fit: Fit, k: int) -> NDArray[np.intp]:
    """Indices of the unknowns of recording k."""
    own = fit.model.unknowns.own[k]
    parts = (own.geometry, own.clock, own.steps, own.knots)
    return np.concatenate([np.arange(p.start, p.stop) for p in parts if p is not None])
