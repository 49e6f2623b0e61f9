"""Random candidates, and one number for each: what a search makes smaller, feasible or not."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from cell.arrays import Array
from planning.candidate import space_of
from planning.judge import Judge, Judgement, judged
from planning.screen import screen

SEARCHED = 1  # robots weighed in a search: with two, random paths rank as with all at 0.988 instead of 0.982, and take half as long again
BATCH = 128  # candidates screened at a time
VIOLATES, OFF = (
    10.0,
    30.0,
)  # figures of candidates that violate a limit, and of those that do not pass screening


@dataclass(eq=False)
class Sampled:
    """Random candidates that can be run, and why others cannot."""

    z: list[Array] = field(default_factory=list)
    tcp: list[float] = field(default_factory=list)  # [m]
    reasons: Counter[str] = field(default_factory=Counter)
    nearest: tuple[float, str] = (
        np.inf,
        "",
    )  # the least violation among those that cannot, in words
    tried: int = 0


def sampled(judge: Judge, *, seed: int, seconds: float, wanted: int | None = None) -> Sampled:
    """Uniform draws from the search space, for so long or until so many can be run."""
    space, rng, out, since = (
        space_of(judge.request),
        np.random.default_rng(seed),
        Sampled(),
        time.monotonic(),
    )
    while time.monotonic() - since < seconds:
        z = rng.random((BATCH, space.size))
        screened = screen(judge.cell, space, judge.limits, z)
        out.tried += BATCH
        out.reasons.update(screened.reason[screened.excess > 0.0].tolist())
        for k in np.flatnonzero(screened.excess <= 0.0):
            found = judged(judge, space.candidate(z[k]), robots=SEARCHED)
            if found.violations:
                out.reasons[found.violations[0].limit] += 1
                if found.excess < out.nearest[0]:
                    out.nearest = (found.excess, found.violations[0].sentence)
                continue
            out.z.append(z[k])
            out.tcp.append(found.tcp)
            if wanted is not None and len(out.z) >= wanted:
                return out
            if time.monotonic() - since > seconds:
                break
    return out


def figure(judge: Judge, z: Array, *, robots: int = SEARCHED) -> float:
    """Natural logarithm of the TCP sigma in um where z can be run; more, the more it violates, where not."""
    space = space_of(judge.request)
    off = float(screen(judge.cell, space, judge.limits, z[None]).excess[0])
    if off > 0.0:
        return OFF + off
    return figure_of(judged(judge, space.candidate(z), robots=robots))


def figure_of(found: Judgement) -> float:
    """The same, of a judgement."""
    return VIOLATES + found.excess if found.violations else float(np.log(found.tcp * 1e6))
