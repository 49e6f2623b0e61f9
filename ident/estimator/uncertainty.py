"""Autocorrelation-robust (jackknife) covariance, observability and correlation of a fit.

Were the residuals white, the normal equations would give the variance; where they are
autocorrelated, the estimates without each block of a few seconds do (blocks instead of lags, as for
Newey & West 1987; left out, so that the residual of what only a block tells is not fitted away).
The ratio inflates each unknown's standard deviation, so the correlations stay those of the normal
equations, which some tens of blocks could not give for a hundred unknowns. What the prior
contributes is not inflated, unless the lengths that are known beforehand contradict each other.

Ripple that no file lists (ballbar.ident.estimator.unlisted_ripple) would show in the blocks as
well. They are those of the residual without it, and it has a term of its own: the variance of the
estimate that allows for it, and what this differs by from the one of white noise, since the model
of that ripple stands for errors of other forms too. Either estimate may be nearer to the truth: a
share DOUBT of their difference is a standard deviation.

Rod, plate and axis offsets give the scale, and no log tells one of them from the other, only their
sum: what the data take from the prior of each is less than all. With priors of covariance D and a
posterior of C, the posterior mean is off the prior's by a normal deviate of covariance D - C, and
what the inflation adds to C, where everything stated is true. Where it is off by more, one of them
is wrong, and nothing says which. Without length k, of prior deviation s_k and off its prior by d_k,
the estimate would move by

    y_k = C[:, k] d_k / (s_k^2 - C_kk)

(a case left out; Cook 1977), which chance makes as large as `d_k^2 / (s_k^2 - C_kk) = t_k^2 = 1`.
The share `1 - 1 / t_k^2` of its square that is beyond chance adds to the covariance, so that what
is stated covers the result with and without each length: one factor on all of them (Birge 1932)
would leave a rod that is stated far too well nearly as sure as it was.

An unknown of the machine that stands further from its prior than chance explains, the robot's own
parameters apart, stands for something that the model does not have, and what that does elsewhere
nobody knows. Of the estimate x and the one in which such unknowns are at their priors' means,

    x_d = x - C_xs C_ss^-1 (x_s - m_s),

either may be nearer to the truth: a share DOUBT of their difference, which grows with what stands
beyond the priors, is a standard deviation.

The gain of a measured tension is fitted beside the errors of its log, as if those of one knot said
nothing of the next. They are those of a friction law and of masses, so they repeat with the motion:
logs of motor torques had the tension wrong by a factor of 1.9 % where independent knots would leave
0.8 %, and fitted gains were off by 3 %. So nothing that the geometry says of the gain counts: the
estimate at a gain off by its prior's deviation is a candidate too. Softer gears under a smaller
tension look the same.

Masses, lengths and instrument angles that a fit takes as given are consider parameters (Schmidt
1966; Tapley, Schutz & Born 2004, sec. 6.4): with the residual's change `r_m` for one standard
deviation of a direction of the masses, the estimate moves by

    x_m = -C J' W r_m

and its covariance grows by the sum of `x_m x_m'` over the directions. A parameter of the geometry
that was held is a direction like them. The tool of the unloaded robot moves with the masses
directly and through x; since heavier links under the same deflection mean stiffer gears, the two
nearly cancel, so the x_m are kept, not their squares alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Cell
from ballbar.cell.geometry import parameter_named
from ballbar.ident.estimator.fit import Fit
from ballbar.ident.estimator.left_out import held_tilts
from ballbar.ident.estimator.normal_equations import gradient_of, jacobian, normal_equations
from ballbar.ident.estimator.priors import beyond_priors, robot_unknowns
from ballbar.ident.estimator.time_blocks import BLOCK, each_block
from ballbar.ident.estimator.unknowns import Unknowns
from ballbar.ident.estimator.unlisted_ripple import RandomRipple, unlisted_ripple
from ballbar.ident.loads.gear_loads import mass_model

if TYPE_CHECKING:
    from ballbar.cell.processes import Begin

STRONG = 0.9  # correlation from which two unknowns are named together
KNOWN = 5e-5  # [m] standard deviation up to which a length is known beforehand
DOUBT = 0.5  # as of masses (ballbar.ident.fitted_robot.MASSES_IN_DOUBT)
ALONE = 0.9  # of its prior variance taken away by the data: they tell this length by itself
SEEN = 0.1  # the same for a combination: without the data nothing contradicts it
MISSTATED = 1e-4  # [m] error of a known length beyond which it is no explanation
FREE = 1e-6  # of the weight of a prior: 1000 of its deviations
SUSPECT = 0.5  # of the largest chi-square of a length: it may as well be the wrong one
SAMPLES = 300  # of each recording: four a second of a motion of 120 s, whose loads vary slowly


@dataclass(frozen=True, eq=False)
class KnownLengths:
    """The known lengths that share the scale, and how far they contradict each other."""

    unknowns: NDArray[np.intp]  # indices
    apart: float  # standard deviations
    off: float = 0.0  # [m] sum of what these lengths would have to change by, to agree
    # (P, L) what the estimate would move by without one of them, as far as chance does not explain
    doubt: Array = field(default_factory=lambda: np.zeros((0, 0)))
    named: tuple[str, ...] = ()  # those that may be the wrong one


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """How well the unknowns of a fit are known."""

    covariance: Array  # (P, P) what is considered included
    white: Array  # (P, P) part that the data would leave were their residuals white
    widened: Array  # (P, P) part by which it is more, as they are not
    considered: Array  # (P, K) shifts of the estimate for a deviation of each direction of masses
    candidates: Array  # (P, K) shifts by terms that the fit left out, and by unlisted ripple
    doubt: Array  # (P, L) shifts by what contradicts itself: known lengths, and beyond priors
    inflation: Array  # (P,) factor on each standard deviation over that of white residuals
    step: Array  # (P,) from the fit to the estimate that allows for ripple no file lists
    coloured: float  # variance of the residual along ripple of all orders, over white noise
    information_gain: Array  # (P,) 1 - (posterior sigma / prior sigma)^2: 0 prior alone, 1 data
    autocorrelation: float  # of neighbours in the whitened residual
    blocks: int  # of time, that the inflation comes from
    lengths: KnownLengths

    def undoubted(self) -> Uncertainty:
        """The same without the doubt: what contradicts itself is no excuse for more of it."""
        return replace(self, covariance=self.covariance - self.doubt @ self.doubt.T)


def uncertainty(fit: Fit, deviated: Sequence[Cell] = (), begin: Begin = partial) -> Uncertainty:
    """Autocorrelation-robust covariance of a fit, misfit included.

    deviated : cells with masses beside those that the fit took as given, as for
        `considered_shifts`. begin : takes over work (ballbar.cell.processes).
    """
    shifted = begin(considered_shifts, fit, deviated)
    layout, ripple = fit.model.unknowns, unlisted_ripple(fit)
    sigma, misfit = layout.sigma, max(1.0, fit.chi2_per_dof, ripple.noise)
    prior = fit.covariance @ (fit.covariance / sigma[:, None] ** 2)
    data = fit.covariance - prior
    variance, blocks = variance_by_blocks(fit, ripple=ripple)
    white = misfit * np.maximum(np.diag(data), np.finfo(float).tiny)
    inflation = np.sqrt(np.maximum(1.0, variance / white))
    inflated = misfit * data * np.outer(inflation, inflation)
    beside = np.column_stack((ripple.shifts, DOUBT * ripple.step))
    by_ripple = beside @ beside.T
    added = inflated + by_ripple - data
    lengths = known_lengths(layout, fit.x + ripple.step, fit.covariance, added)
    candidates = np.column_stack((_left_out(fit), beside, _gain(fit)))
    pulled = DOUBT * doubted_shift(fit, lengths.unknowns)
    doubt = np.column_stack((lengths.doubt, pulled))
    covariance = inflated + prior + doubt @ doubt.T + candidates @ candidates.T
    shifts = shifted()
    covariance += shifts @ shifts.T
    gain = 1.0 - np.clip(np.diag(fit.covariance) / sigma**2, 0.0, 1.0)
    return Uncertainty(
        covariance=0.5 * (covariance + covariance.T),
        white=data,
        widened=inflated - data,
        considered=shifts,
        candidates=candidates,
        doubt=doubt,
        inflation=np.sqrt(inflation**2 + np.diag(by_ripple) / white),
        step=ripple.step,
        coloured=ripple.noise,
        information_gain=gain,
        autocorrelation=mean_autocorrelation(fit),
        blocks=blocks,
        lengths=lengths,
    )


def inflation_factors(covariance: Array, power: Array, sums: Array) -> Array:
    """(P,) at least 1: standard deviation from blocks of time over that of independent samples.

    covariance : (P, P) of white residuals. power : (P, P) products of the scores, summed over the
    samples. sums : (P, B) scores summed over blocks of time.
    """
    white = np.einsum("ij,jk,ik->i", covariance, power, covariance, optimize=True)
    blocked = ((covariance @ sums) ** 2).sum(axis=1)
    ratio = blocked / np.where(white > 0.0, white, 1.0)
    return np.asarray(np.sqrt(np.maximum(1.0, ratio)))


def _left_out(fit: Fit) -> Array:
    """(P, K) shifts by terms that the fit left out and by bearings that gears hold."""
    layout = fit.model.unknowns
    second = np.diag(fit.covariance) + fit.x**2
    sizes = dict(zip(layout.names, np.sqrt(second).tolist(), strict=True))
    for part in fit.left_out:
        sizes |= part.sizes
    tilts = held_tilts(layout.names, sizes)
    terms = (part.of(layout.names) for part in fit.left_out)
    return np.column_stack([tilts, *terms])


def _gain(fit: Fit) -> Array:
    """(P, K) shift by which the gain of the measured tension is as open as by its prior."""
    layout = fit.model.unknowns
    if layout.gain is None:
        return np.zeros((fit.x.size, 0))
    own = fit.covariance[:, [layout.gain]]
    known = own[layout.gain]
    return np.asarray(
        own / known * np.sqrt(np.maximum(0.0, layout.sigma[layout.gain] ** 2 - known))
    )


def variance_by_blocks(
    fit: Fit, length: float = BLOCK, *, ripple: RandomRipple | None = None
) -> tuple[Array, int]:
    """(P,) variance by leaving out each block of time in turn, and how many blocks there are.

    length : [s] of a block. ripple : that the estimate of generalised least squares is without.

    The jackknife: `(B - 1) / B` times the sum of squares over B blocks (Efron & Stein 1981).
    Without a block of normal matrix N and gradient g the estimate moves by `(H - N)^-1 g`, so what
    single blocks hold alone counts for what it is.
    """
    variance, count = np.zeros(fit.model.unknowns.count), 0
    step = np.zeros(fit.x.size)
    if ripple is not None:
        step = ripple.step
        fit = replace(fit, linear=replace(fit.linear, residuals=ripple.residuals))
    for block in each_block(fit, length, followed=True):
        gradient = block.gradient + block.normal @ step[block.index]
        covariance = fit.covariance[:, block.index]
        without = np.eye(block.index.size) - block.normal @ covariance[block.index]
        moved = covariance @ np.linalg.solve(without, gradient)
        variance += moved**2
        count += 1
    return variance * (count - 1) / count, count


def correlation_time(residual: Array, times: Array) -> float:
    """[s] correlation time of residuals (E, N) at times (N,) [s], white noise in them aside.

    The integral of their autocovariance up to its first zero, over its largest value there: of
    `exp(-t / T)` beside white noise it is T. At least one row.
    """
    power = (np.abs(np.fft.rfft(residual, 2 * times.size)) ** 2).sum(axis=0)
    later = np.fft.irfft(power)[1 : times.size]
    later = later[: int(np.argmax(np.append(later, 0.0) <= 0.0))]
    rows = later.sum() / later.max() if later.size else 1.0
    return float(rows * np.median(np.diff(times)))


def mean_autocorrelation(fit: Fit) -> float:
    """Mean autocorrelation of neighbours in the whitened residuals of a fit's recordings."""
    each = [
        autocorrelation(residual, point.recording.times, point.recording.smoothing)
        for point, _, residual in fit.recorded
    ]
    return float(np.mean(each))


def autocorrelation(residual: Array, times: Array, smoothing: float) -> float:
    """Mean over the equations of a residual's (E, N) correlation with its neighbour in time.

    times : (N,) [s]. smoothing : [s] over which the logs were smoothed; samples closer than that
    share noise, so the neighbour is the sample about as far away.
    """
    lag = max(1, round(smoothing / float(np.median(np.diff(times)))))
    products = (residual[:, lag:] * residual[:, :-lag]).sum(axis=1)
    return float((products / (residual * residual).sum(axis=1)).mean())


def correlated_groups(covariance: Array, names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Groups of unknowns that the data hardly separate: chains of correlations above STRONG.

    covariance : (P, P) of the unknowns `names` [m, rad, s and their products].
    """
    deviation = np.sqrt(np.diag(covariance))
    strong = np.abs(covariance / np.outer(deviation, deviation)) > STRONG
    left, groups = set(range(len(names))), []
    while left:
        group, front = set(), {left.pop()}
        while front:
            group |= front
            front = {int(j) for i in front for j in np.flatnonzero(strong[i])} - group
        left -= group
        if len(group) > 1:
            groups.append(tuple(names[i] for i in sorted(group)))
    return sorted(groups)


def observability(normal: Array, sigma: Array, selected: Array, samples: int) -> dict[str, float]:
    """Observability indices O1 to O5 of some unknowns (Sun & Hollerbach 2008).

    normal : (P, P) of the data and the prior. sigma : (P,) prior deviations, the units of the
    unknowns. selected : (S,) indices of the unknowns; all others count as unknown. samples : how
    many went into the normal matrix.
    """
    scaled = normal * np.outer(sigma, sigma)
    others = np.setdiff1d(np.arange(sigma.size), selected)
    own = scaled[np.ix_(selected, selected)]
    if others.size:
        mixed = scaled[np.ix_(selected, others)]
        own = own - mixed @ np.linalg.solve(scaled[np.ix_(others, others)], mixed.T)
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(own), np.finfo(float).tiny))
    return {
        "O1": float(np.exp(np.log(values).mean()) / np.sqrt(samples)),
        "O2": float(values[0] / values[-1]),
        "O3": float(values[0]),
        "O4": float(values[0] ** 2 / values[-1]),
        "O5": float(1.0 / (1.0 / values).sum()),
    }


def known_lengths(layout: Unknowns, x: Array, covariance: Array, added: Array) -> KnownLengths:
    """The known lengths of a fit with estimate x (P,) and white covariance (P, P).

    added : (P, P) to the covariance, by the inflation of what the data contribute.
    """
    known = np.array(
        [
            i
            for i in range(layout.shared.size)
            if parameter_named(layout.names[i]).is_length and layout.sigma[i] < KNOWN
        ],
        dtype=np.intp,
    )
    units = np.outer(layout.sigma[known], layout.sigma[known])
    alone = _determined_alone(covariance[np.ix_(known, known)] / units)
    known = shared = known[~alone]
    units = units[np.ix_(~alone, ~alone)]
    scale = layout.sigma[known]
    off = (x - layout.mean)[known] / scale
    moved = np.eye(known.size) - covariance[np.ix_(known, known)] / units
    size, directions = np.linalg.eigh(moved)
    seen = directions[:, size > SEEN]
    if not seen.size:
        return KnownLengths(known, 0.0, doubt=np.zeros((x.size, 0)))
    chance = moved + added[np.ix_(known, known)] / units
    expected = seen.T @ chance @ seen
    along = seen.T @ off
    apart = float(np.sqrt(along @ np.linalg.solve(expected, along) / along.size))
    needed = float(np.abs(scale * (seen @ along)).sum())
    onto = seen @ seen.T
    alone, variance = np.diag(onto @ moved @ onto), np.diag(onto @ chance @ onto)
    each = onto @ off
    plausible = np.abs(each) * scale < MISSTATED * alone
    known, scale, each = known[plausible], scale[plausible], each[plausible]
    square = each**2 / variance[plausible]
    moves = covariance[:, known] / scale * (each / alone[plausible])
    doubt = moves * np.sqrt(1.0 - 1.0 / np.maximum(square, 1.0))
    named = known[square > max(1.0, SUSPECT * square.max(initial=0.0))]
    return KnownLengths(shared, apart, needed, doubt, tuple(layout.names[i] for i in named))


def _determined_alone(covariance: Array) -> NDArray[np.bool_]:
    """(K,) whether the data tell a known length by themselves, whatever the others are.

    covariance : (K, K) in units of the prior deviations.
    """
    data = np.linalg.inv(covariance) - np.eye(len(covariance))
    out = []
    for k in range(len(data)):
        free = data + np.diag(np.where(np.arange(len(data)) == k, 1.0, FREE))
        out.append(np.linalg.inv(free)[k, k] < 1.0 - ALONE)
    return np.array(out, dtype=bool)


def doubted_shift(fit: Fit, known: NDArray[np.intp]) -> Array:
    """(P,) by which pulled unknowns moved the estimate from where their priors' means have it.

    The robot's own parameters are none: a zero may have been set anywhere, and it is measured. Nor
    are known lengths, of which `known_lengths` says more; known : their indices.
    """
    layout = fit.model.unknowns
    pulled = np.setdiff1d(beyond_priors(layout, fit.x), [*robot_unknowns(layout), *known])
    off = (fit.x - layout.mean)[pulled]
    own = fit.covariance[np.ix_(pulled, pulled)]
    return np.asarray(fit.covariance[:, pulled] @ np.linalg.solve(own, off))


def considered_shifts(fit: Fit, deviated: Sequence[Cell]) -> Array:
    """(P, K) shifts x_m of the estimate.

    deviated : K cells whose masses deviate by one standard deviation, in independent directions
    (ballbar.ident.loads.mass_uncertainty).
    """
    shape = (fit.model.unknowns.count, len(deviated))
    if fit.model.masses is None or not deviated:
        return np.zeros(shape)
    steps = [max(1, r.times.size // SAMPLES) for r in fit.model.recordings]
    recordings = [r.thinned(n) for r, n in zip(fit.model.recordings, steps, strict=True)]
    model = replace(fit.model, recordings=tuple(recordings), table=None)
    ballbars = [b[::n] for b, n in zip(fit.ballbars, steps, strict=False)]
    equations = normal_equations(model, fit.x, ballbars, fit.excess)
    blocks = [list(jacobian(model, equations, k)) for k in range(len(steps))]
    gradient = np.zeros(shape)
    for m, cell in enumerate(deviated):
        other = replace(model, masses=mass_model(cell))
        for k, n in enumerate(steps):
            point, weights = equations.evaluations[k], equations.weights[k]
            with_own_loads = replace(point, loads_at=None)
            moved = other.evaluate(fit.x, k, point.ballbar, with_own_loads)
            change = weights(moved.closure.error - point.closure.error)
            for block in blocks[k]:
                own = gradient_of(model, k, block, change[:, block.samples])
                gradient[:, m] += n * own
    return np.asarray(-fit.covariance @ gradient)


def held_shifts(fit: Fit, held: NDArray[np.intp], sigma: Array) -> tuple[Array, Array]:
    """Errors of parameters that a fit held at their nominal values, and the shifts they cause.

    Once freed under their priors, they would have the covariance D and go by the step h. Their
    error in the fit has the mean square D + h h', so what the data say of them counts.

    held : (H,) indices into the table, in its order. sigma : (H,) [m, rad] of their priors.
    Returns (H, H) the errors' independent directions, one a column, and (P, H) the shifts of the
    estimate for each of them.
    """
    model = fit.model
    layout, x = model.unknowns.with_shared(held, fit.x)
    linear = normal_equations(replace(model, unknowns=layout), x, fit.ballbars, fit.excess)
    freed = np.flatnonzero(np.isin(layout.shared, held))
    mixed = np.delete(linear.normal[:, freed], freed, axis=0)
    shift = -fit.covariance @ mixed  # of the estimate, per unit of each
    gradient = linear.gradient[freed] + shift.T @ np.delete(linear.gradient, freed)
    reduced = linear.normal[np.ix_(freed, freed)] + mixed.T @ shift
    scaled = np.outer(sigma, sigma) * reduced + np.eye(held.size)  # of order one and above
    covariance = np.linalg.inv(scaled)
    step = covariance @ (sigma * gradient)
    values, vectors = np.linalg.eigh(covariance + np.outer(step, step))
    root = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root, shift @ root
