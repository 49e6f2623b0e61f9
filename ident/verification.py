"""Does a stored calibration still hold? One recording against an identified machine.

The recording is fitted twice: with the machine held, and with it free within the priors of an
identification. The difference of the two estimates is

    x = G (e + B d) + n,   G = 1 - H P^-1,

with H the white covariance of the free fit, P the priors, e the error of the stored machine (its
stated covariance C) and what an unchanged one is apart by from one recording to the next, n the
noise of this recording (its autocorrelation-robust covariance), and d what changed since. Each
single cause has columns B and a prior of d; its evidence is the Bayes factor of that cause against
no change (Kass & Raftery 1995), in closed form as all of it is linear and Gaussian. Where the
largest is beyond what an unchanged machine exceeds in FALSE_ALARMS of the checks, the machine
changed. The distribution is that of draws of x with the tails of Student's t, as the noise is
estimated from some tens of blocks of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cell.arrays import Array
from cell.clock import UNSEEN_OFFSET, UNSEEN_SKEW
from cell.descriptions import Cell, Robot
from cell.geometry import parameter_named
from ident.causes import Causes
from ident.estimator.fit import Fit
from ident.estimator.smoothed_harmonics import smoothing_covariance
from ident.estimator.step_faults import step_faults_in_logs
from ident.estimator.uncertainty import uncertainty
from ident.held_out import (
    LoopClosure,
    closed_loop,
    freed,
    loop_closure,
    normalised_innovation,
    recording_alone,
)
from ident.options import DEFAULTS, SILENT, FitOptions, Listener
from ident.recording_fit import Logs, RecordingFit
from ident.result import Machine
from ident.single_causes import (
    Cause,
    covariance_of_wander,
    exchangeable,
    free_names,
    single_causes,
    with_exchangeable,
)
from ident.verdict import MISFIT

FALSE_ALARMS = 0.02  # share of checks of an unchanged machine that call it changed
DRAWS, SEED = 20000, 1  # of the distribution for an unchanged machine
# Of the covariance of the free fit that is added to that of the difference: where the recording
# tells nothing, both fits end within so much of where they began.
UNSETTLED = 0.01
# Logarithm of the factor by which a cause must be likelier than the next, and by which a second
# change beside it must not be likelier than none: 20, strong evidence after Kass & Raftery 1995.
RIVAL = 3.0
ROUNDS = 3  # of taking a change away and fitting again: one of a milliradian is not linear
SEEN = 4.0  # deviations by which a change must stand out
BLIND = 3e-4  # [rad] of an axis zero that may change unseen without being named


@dataclass(frozen=True, eq=False)
class Explanation:
    """One cause and how well it explains a recording."""

    cause: Cause
    size: Array  # (K,) [rad], [m] or SI of the coefficients
    sigma: Array  # (K,)
    evidence: float  # logarithm of the Bayes factor against no change

    @property
    def sentence(self) -> str:
        """The cause, its size, and what usually is behind it."""
        size, sigma = float(self.size[0]), float(self.sigma[0])
        kind, words = self.cause.kind, self.cause.words
        if kind == "axis":
            return (
                f"{words} by {size * 1e3:+.2f} mrad (sigma {sigma * 1e3:.2f} mrad; resolver or "
                "motor exchanged?)"
            )
        if kind == "scale":
            return f"{words} by {size * 1e6:+.0f} ppm (sigma {sigma * 1e6:.0f} ppm; exchanged?)"
        if kind in ("rod", "plate", "length"):
            return f"{words} by {size * 1e6:+.0f} um (sigma {sigma * 1e6:.0f} um; exchanged?)"
        if kind == "geometry":
            unit = "um" if parameter_named(self.cause.names[0]).is_length else "urad"
            return f"{words} by {size * 1e6:+.0f} {unit} (sigma {sigma * 1e6:.0f} {unit}; bent?)"
        if kind == "ball-bar":
            return f"{words} (bent, or taken apart?)"
        if kind == "tool":
            return f"{words} (bolted on anew, or bent?)"
        return f"{words} (transmission error, compliance or backlash; gear exchanged?)"


@dataclass(frozen=True, eq=False)
class RecordingVerification:
    """A stored calibration against one recording of today."""

    name: str
    identified: LoopClosure  # of the stored machine
    innovation: float  # its residual over what noise and stated uncertainty explain
    innovation_left: float  # the same after the likeliest change, where there is one
    misfit: float  # chi-square per degree of freedom with the machine free
    limit: float  # of the evidence, exceeded in FALSE_ALARMS of checks of an unchanged machine
    explanations: tuple[Explanation, ...]  # best first
    single: bool  # whether nothing speaks strongly for a second change beside the first
    blind: dict[int, float]  # axes, and the size [rad] up to which a change of the zero is unseen
    suspect: str = ""  # what may be wrong with the logs; empty where nothing is
    doubt: str = ""  # what is wrong with the stored calibration itself; empty where nothing is

    @property
    def statistic(self) -> float:
        """Logarithm of the largest Bayes factor of a single cause."""
        return self.explanations[0].evidence

    @property
    def unchanged(self) -> bool:
        """Whether nothing speaks for a change."""
        return self.statistic <= self.limit and self.innovation**2 <= MISFIT

    @property
    def comparable(self) -> bool:
        """Whether calibration and logs are sound, and some machine of this kind explains them.

        With the machine free the noise alone has to explain the rest; of the stored one, or of it
        after the likeliest change, the stated uncertainty counts as well.
        """
        explained = self.misfit <= MISFIT or self.innovation_left**2 <= MISFIT
        return explained and not self.suspect and not self.doubt

    @property
    def holds(self) -> bool:
        return self.unchanged and self.comparable

    @property
    def named(self) -> tuple[Explanation, ...]:
        """The cause; several where the recording hardly tells them apart, none where none is."""
        if not self.comparable or not self.single or self.statistic <= self.limit:
            return ()
        best = self.statistic
        return tuple(e for e in self.explanations if e.evidence > best - RIVAL)

    @property
    def sentence(self) -> str:
        """Whether it holds, and what changed."""
        closure = (
            f"the loop closes to {self.identified.sentence}, {self.innovation:.2f} times what "
            "noise and the stated uncertainty explain"
        )
        if self.holds:
            return f"Holds: {closure}."
        if self.doubt:
            return f"Not comparable: {self.doubt}; {closure}."
        if self.suspect:
            return f"Not comparable: perhaps {self.suspect}; {closure}."
        if not self.comparable:
            return (
                f"Not comparable: {closure}, and no machine of this kind explains the recording. "
                "Look at it with ballbar check; if nothing is wrong with it, identify again."
            )
        if self.named:
            each = ", or ".join(e.sentence for e in self.named)
            tail = "; this path does not tell which" if len(self.named) > 1 else ""
            return f"Changed since: {each}{tail}; {closure}."
        sensed = any(e.cause.kind == "length" for e in self.explanations)
        parts = "zero or scale of the length" if sensed else "rod, plate"
        return (
            f"Changed: {closure}. No single cause (zero of an axis, tool, {parts}, gear, "
            "another parameter) explains it clearly: identify again."
        )

    @property
    def warnings(self) -> list[str]:
        """Changes that this recording cannot show."""
        if not self.blind:
            return []
        each = ", ".join(f"{axis} ({size * 1e3:.1f} mrad)" for axis, size in self.blind.items())
        return [
            "changes of the zeros of these axes, up to the size named, would not show on this "
            f"path: {each}"
        ]


def verify_recording(
    machine: Machine, logs: Logs, *, options: FitOptions = DEFAULTS, listener: Listener = SILENT
) -> RecordingVerification:
    """Whether an identified machine still explains a recording, and if not, what changed.

    logs : of the same robot, instrument and plate; clock, base pose of the instrument and encoder
        offsets are fitted.

    Raises StartError when the logs cannot be brought together, with the cause (ident.causes).
    """
    cell = machine.robot.cell
    recording = recording_alone(cell, logs, options, listener)
    listener.progress("fitting the recording with the stored machine held, and free")
    if exchangeable(cell):
        machine = with_exchangeable(machine)
    compared = _compared(machine, recording, options)
    causes = single_causes(machine, compared.free)
    limit = compared.difference.limit(causes)
    ranked = compared.difference.ranked(causes)
    single, best, now = ranked[0].evidence <= limit, ranked[0], machine
    innovation = left = normalised_innovation(compared.closed, machine)
    for _ in range(0 if single else ROUNDS):
        listener.progress("fitting once more after the likeliest change")
        now = changed(now, compared.free, best)
        rest = _compared(now, recording, options)
        after, left = rest.difference, normalised_innovation(rest.closed, now)
        best = replace(best, size=after.explanation(best.cause).size)
        ranked[0] = replace(ranked[0], size=ranked[0].size + best.size)
        single = after.beside(best.cause).ranked(causes)[0].evidence <= RIVAL
        if single:
            break
    outcome = RecordingVerification(
        name=logs.name,
        identified=loop_closure(compared.closed),
        innovation=innovation,
        innovation_left=left,
        misfit=compared.free.chi2_per_dof,
        limit=limit,
        explanations=tuple(ranked),
        single=single,
        blind=_blind(ranked, limit, cell.robot),
    )
    if unseen := _unseen_clock(recording):
        return replace(outcome, suspect=unseen)
    ambiguous = recording.start.ambiguous
    if outcome.comparable and not ambiguous:
        return outcome
    return replace(outcome, suspect=_suspect(cell, logs, ambiguous=ambiguous))


def changed(machine: Machine, free: Fit, by: Explanation) -> Machine:
    """The machine after a change of the size that explains a recording."""
    robot, steps = machine.robot, by.cause.columns @ by.size
    moves = dict(zip(free_names(machine, free), steps.tolist(), strict=True))
    geometry = robot.geometry
    moved = {name: geometry[name] + v for name, v in moves.items() if name in geometry.table.index}
    names = [c.name for correction in robot.corrections for c in correction.coefficients]
    values = robot.values
    if values is not None:
        values = values + [moves.get(name, 0.0) for name in names]
    return replace(machine, robot=replace(robot, geometry=geometry.replaced(moved), values=values))


def _unseen_clock(recording: RecordingFit) -> str:
    """Why a recording of a length does not determine its clock; empty where it does.

    Its fit may then end at another clock, which passes for a change of the machine.
    """
    position = recording.fit.model.unknowns.own[0].clock
    if position is None or not recording.samples.measures_length:
        return ""
    offset, skew = np.sqrt(np.diag(recording.fit.covariance))[position]
    if offset <= UNSEEN_OFFSET and skew <= UNSEEN_SKEW:
        return ""
    return (
        "a length that changes too little to tell its clock (sigma of the offset "
        f"{offset * 1e3:.0f} ms, of the skew {skew * 1e6:.0f} ppm), so take a path along which it "
        "changes more"
    )


def _suspect(cell: Cell, logs: Logs, *, ambiguous: bool) -> str:
    """Probable error of logs that no machine explains, or that align in several ways."""
    causes = Causes.of(cell, [logs])
    if causes:
        return str(causes)
    return "its logs can be aligned in more than one way" if ambiguous else ""


def _blind(explanations: Sequence[Explanation], limit: float, robot: Robot) -> dict[int, float]:
    """Axes whose zero may have changed by more than BLIND unseen, axis 1 apart.

    Its zero turns the robot about its base, which is not known to the ball-bar anyway.
    """
    sigma = {e.cause.axis: float(e.sigma[0]) for e in explanations if e.cause.kind == "axis"}
    seen = max(SEEN, float(np.sqrt(2.0 * max(0.0, limit))))  # evidence is half a squared deviation
    sizes = {axis: seen * sigma.get(axis, np.inf) for axis in range(2, robot.joints + 1)}
    return {axis: size for axis, size in sizes.items() if size > BLIND}


@dataclass(frozen=True, eq=False)
class _Difference:
    """The estimate of the free fit minus the stored machine, of an unchanged one."""

    x: Array  # (U,)
    seen: Array  # (U, U) G: share of a change that the estimate shows
    covariance: Array  # (U, U)
    blocks: int  # of time, that the noise was estimated from

    @cached_property
    def information(self) -> Array:
        """(U, U) inverse of the covariance."""
        scale = np.sqrt(np.diag(self.covariance))
        units = np.outer(scale, scale)
        return np.asarray(np.linalg.inv(self.covariance / units) / units)

    def explanation(self, cause: Cause) -> Explanation:
        """The cause with its size by generalised least squares, and its evidence."""
        moved = self.seen @ cause.columns
        own = moved.T @ self.information @ moved
        right = moved.T @ self.information @ self.x
        scaled = own * np.outer(cause.prior, cause.prior) + np.eye(cause.prior.size)
        covariance = np.linalg.inv(scaled) * np.outer(cause.prior, cause.prior)
        gain = float(right @ covariance @ right)
        evidence = 0.5 * (gain - float(np.linalg.slogdet(scaled)[1]))
        return Explanation(cause, covariance @ right, np.sqrt(np.diag(covariance)), evidence)

    def ranked(self, causes: Sequence[Cause]) -> list[Explanation]:
        """Every cause, the best first."""
        return sorted((self.explanation(cause) for cause in causes), key=lambda e: -e.evidence)

    def beside(self, cause: Cause) -> _Difference:
        """The difference that a cause leaves, its size unknown within its prior."""
        moved = self.seen @ cause.columns * cause.prior
        return _Difference(self.x, self.seen, self.covariance + moved @ moved.T, self.blocks)

    def limit(self, causes: Sequence[Cause]) -> float:
        """Largest evidence of any cause, exceeded in FALSE_ALARMS of draws without a change."""
        rng = np.random.default_rng(SEED)
        drawn = rng.standard_normal((DRAWS, self.x.size)) @ np.linalg.cholesky(self.covariance).T
        freedom = max(1, self.blocks - 1)
        drawn *= np.sqrt(freedom / rng.chisquare(freedom, DRAWS))[:, None]
        best = np.full(DRAWS, -np.inf)
        for cause in causes:
            moved = self.seen @ cause.columns * cause.prior
            weighted = self.information @ moved
            scaled = moved.T @ weighted + np.eye(cause.prior.size)
            right = drawn @ weighted
            gain = (right * np.linalg.solve(scaled, right.T).T).sum(axis=1)
            best = np.maximum(best, 0.5 * (gain - np.linalg.slogdet(scaled)[1]))
        return float(np.quantile(best, 1.0 - FALSE_ALARMS))


@dataclass(frozen=True, eq=False)
class _Compared:
    """A recording with a machine held, and with it free."""

    closed: Fit
    free: Fit
    difference: _Difference


def _compared(machine: Machine, recording: RecordingFit, options: FitOptions) -> _Compared:
    faults = step_faults_in_logs(recording.samples, recording.clock)
    closed = closed_loop(machine.robot, recording, options, faults, machine.excess, SILENT)
    changes = {name: change for name, (change, _) in exchangeable(machine.robot.cell).items()}
    free = freed(closed, machine, changes)
    stated, names, layout = uncertainty(free), free_names(machine, free), free.model.unknowns
    before = dict(zip(closed.model.unknowns.names, closed.x, strict=True))
    values = [before[n] if n in before else machine.robot.geometry[n] for n in names]
    at = np.array([layout.names.index(name) for name in names])
    own = np.array([machine.names.index(name) for name in names])
    wander = covariance_of_wander(single_causes(machine, free), at.size)
    white, inflation = free.covariance[np.ix_(at, at)], stated.inflation[at]
    # what the priors of the recording's own unknowns contribute is noise as the data's part is
    by_data = white - white @ (white / layout.sigma[at][:, None] ** 2)
    noise = max(1.0, free.chi2_per_dof) * np.outer(inflation, inflation) * by_data
    seen = np.eye(at.size) - white / layout.sigma[at] ** 2
    smoothed = smoothing_covariance(free, machine.robot.cell)[np.ix_(at, at)]
    error = seen @ (machine.covariance[np.ix_(own, own)] + wander) @ seen.T
    difference = _Difference(
        x=free.x[at] - np.array(values),
        seen=seen,
        covariance=error + noise + smoothed + UNSETTLED * white,
        blocks=stated.blocks,
    )
    return _Compared(closed, free, difference)
