"""The maximum-likelihood fit: damped Gauss-Newton on the whitened loop closure of all recordings.

Loads are frozen within an iteration but for their dependence on the rod's tension, without which
the steps oscillate (notes/identification sec. 6, trap 8).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ballbar.cell.arrays import Array
from ballbar.cell.clock import Clock
from ballbar.cell.geometry import Geometry
from ballbar.ident.estimator.build_unknowns import kinematic_unknowns
from ballbar.ident.estimator.gauss_newton import Marquardt, Search, Stop, inverse, minimise
from ballbar.ident.estimator.left_out import LeftOut
from ballbar.ident.estimator.model import Evaluation, Model, joints_as_logged
from ballbar.ident.estimator.noise import ExcessNoise
from ballbar.ident.estimator.normal_equations import (
    NormalEquations,
    Trial,
    add_normal,
    at_trial,
    gradient_of,
    jacobian,
    normal_equations,
    trial,
    whole_jacobian,
)
from ballbar.ident.estimator.samples import Samples
from ballbar.ident.estimator.whitening import Whitening
from ballbar.ident.signals.steps import StepFault

FREEZE_AFTER = 6  # iterations with new weights; loads near a reversal could change them for ever
# Predicted decrease, in units of the cost per degree of freedom, that ends the search: it leaves
# the estimate a hundredth of its standard deviation from the minimum.
NEGLIGIBLE = 1e-4
# Predicted decrease for each unknown below which a Jacobian is reused: within five standard
# deviations of each, it gives the same covariance at either end of the step.
REUSE_BELOW = 25.0
# A fit of so many samples comes first where there are so many times more.
COARSE_SAMPLES, COARSE_SHARE = 150, 4


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of one minimisation."""

    model: Model
    linear: NormalEquations
    covariance: Array  # (P, P) as if the residual were white
    excess: ExcessNoise
    iterations: int
    converged: bool
    step_faults: tuple[StepFault, ...] = ()
    left_out: tuple[LeftOut, ...] = ()  # terms of the machine that the data do not show
    # chi-square per degree of freedom at which the search was given up; 0 where it was not
    given_up: float = 0.0

    @property
    def x(self) -> Array:
        """(P,) the estimate."""
        return self.linear.x

    @property
    def recorded(self) -> list[tuple[Evaluation, Whitening, Array]]:
        """Evaluation, weights and (E, N) residual of each recording."""
        linear, count = self.linear, len(self.model.recordings)
        parts = zip(linear.evaluations, linear.weights, linear.residuals, strict=True)
        return list(parts)[:count]

    @cached_property
    def by_poses(self) -> tuple[Array, Array]:
        """(P, P) normal matrix and (P,) gradient of what the still poses tell, and the priors."""
        layout = self.model.unknowns
        normal, gradient = np.diag(layout.sigma**-2.0), (self.x - layout.mean) / layout.sigma**2
        for k in range(len(self.model.recordings), len(self.model.parts)):
            for block in jacobian(self.model, self.linear, k):
                add_normal(self.model, k, block, normal)
                residual = self.linear.residuals[k][:, block.samples]
                gradient += gradient_of(self.model, k, block, residual)
        return normal, gradient

    @property
    def still(self) -> slice:
        """The groups of still poses among the parts."""
        return slice(len(self.model.recordings), None)

    @cached_property
    def jacobians(self) -> tuple[Array, ...]:
        """(P, E, N) derivative of the whitened error of every group of still poses, robust weights
        included.
        """
        linear, first = self.linear, len(self.model.recordings)
        parts = list(zip(linear.evaluations, linear.weights, linear.robust, strict=False))[first:]
        return tuple(
            whole_jacobian(self.model, self.x, k, point, weights.scaled(robust))
            for k, (point, weights, robust) in enumerate(parts, first)
        )

    @property
    def ballbars(self) -> list[Array]:
        """(N, 5) [rad] ball-bar angles of each part, unmeasured joints as solved for."""
        return [point.ballbar for point in self.linear.evaluations]

    @property
    def degrees(self) -> int:
        """Degrees of freedom: equations less the unknowns that the data determined."""
        prior = np.diag(self.covariance) / self.model.unknowns.sigma**2
        return int(self.linear.equations - (self.model.unknowns.count - prior.sum()))

    @property
    def chi2_per_dof(self) -> float:
        return self.linear.data_cost / max(1, self.degrees)

    def geometry(self, k: int = 0) -> Geometry:
        """The kinematic parameters of recording k."""
        return self.model.unknowns.geometry(self.x, k)

    def clock(self, k: int = 0) -> Clock:
        """The clock of recording k."""
        return self.model.unknowns.clock(self.x, k)


@dataclass(frozen=True, eq=False)
class WhitenedLoopClosure:
    """The problem that `gauss_newton.minimise` solves."""

    model: Model
    x: Array
    ballbars: Sequence[Array]
    excess: ExcessNoise
    keep_blocks: bool = False
    freeze_after: int | None = None  # iterations after which weights stay; None for never
    robust: Sequence[Array] = ()
    previous: Sequence[Evaluation] = ()  # evaluations near the start

    def start(self) -> NormalEquations:
        return normal_equations(
            self.model,
            self.x,
            self.ballbars,
            self.excess,
            previous=self.previous,
            keep_blocks=self.keep_blocks,
            robust=self.robust,
        )

    def trial(self, equations: NormalEquations, step: Array) -> Trial:
        return trial(self.model, equations, step)

    def accept(
        self, equations: NormalEquations, accepted: Trial, iterations: int
    ) -> NormalEquations:
        frozen = self.freeze_after is not None and iterations >= self.freeze_after
        return normal_equations(
            self.model,
            accepted.x,
            [point.ballbar for point in equations.evaluations],
            self.excess,
            weights=equations.weights if frozen else (),
            previous=accepted.evaluations,
            keep_blocks=self.keep_blocks,
            robust=self.robust,
        )

    def reuse(self, equations: NormalEquations, accepted: Trial) -> NormalEquations:
        return at_trial(self.model, equations, accepted)


def fit(
    model: Model,
    x: Array,
    ballbars: Sequence[Array],
    excess: ExcessNoise,
    *,
    negligible: float = NEGLIGIBLE,
    max_iterations: int = 50,
    reuse_below: float = 0.0,
    freeze_after: int | None = FREEZE_AFTER,
    search: Search | None = None,
    robust: Sequence[Array] = (),
    previous: Sequence[Evaluation] = (),
    give_up: Callable[[NormalEquations, int], bool] = lambda *_: False,
) -> Fit:
    """Fit the model from x (P,).

    ballbars : (N, 5) [rad] of each recording, where its unmeasured joints start.
    negligible, reuse_below, freeze_after : as `NEGLIGIBLE`, `REUSE_BELOW` and `FREEZE_AFTER` above.
    search, give_up : as in `minimise`. robust : as of NormalEquations. previous : evaluations near
    x (Model.evaluate).

    Raises SingularError where the model has no finite linearisation.
    """
    minimum = minimise(
        WhitenedLoopClosure(
            model=model,
            x=x,
            ballbars=ballbars,
            excess=excess,
            keep_blocks=reuse_below > 0.0,
            freeze_after=freeze_after,
            robust=robust,
            previous=previous,
        ),
        Stop(decrease=negligible),
        max_iterations=max_iterations,
        reuse_below=reuse_below,
        search=search,
        give_up=give_up,
    )
    linear = replace(minimum.equations, blocks=())
    covariance = inverse(linear.normal)
    out = Fit(model, linear, covariance, excess, minimum.iterations, minimum.converged)
    return replace(out, given_up=out.chi2_per_dof) if minimum.given_up else out


def fit_kinematics(
    samples: Samples,
    start: Geometry,
    clock: Clock,
    parameters: NDArray[np.intp],
    excess: ExcessNoise,
    *,
    prior_sigma: Array | None = None,
    negligible: float = NEGLIGIBLE,
    max_iterations: int = 50,
) -> Fit:
    """Fit kinematic parameters and the clock of one recording, without corrections.

    start, clock : values to start from; parameters that are not fitted keep theirs.
    parameters : (P,) indices into the table. prior_sigma : (P,) [m, rad] about the start.
    Other arguments and errors as in `fit`.
    """
    seen = clock if samples.has_clock else None
    layout, x = kinematic_unknowns(start, seen, parameters, prior_sigma)
    model = Model(joints_as_logged(start.table.joints), None, (), layout, (samples,))
    ballbars = [samples.ballbar_angles(start, clock)]
    step = partial(fit, max_iterations=max_iterations)
    iterations = 0
    if (thin := thinned(model, ballbars, samples=COARSE_SAMPLES, times=COARSE_SHARE)) is not None:
        coarse = step(
            thin[0], x, thin[1], excess, negligible=1.0, reuse_below=np.inf, search=Marquardt()
        )
        if coarse.converged:
            x, iterations = coarse.x, coarse.iterations
            ballbars = [samples.ballbar_angles(coarse.geometry(), coarse.clock())]
    minimum = step(
        model,
        x,
        ballbars,
        excess,
        negligible=negligible,
        reuse_below=REUSE_BELOW,
        search=Marquardt(),  # a start far away needs shorter steps that turn to the gradient
    )
    return replace(minimum, iterations=iterations + minimum.iterations)


def thinned(
    model: Model, ballbars: Sequence[Array], *, samples: int, times: int
) -> tuple[Model, list[Array]] | None:
    """The model with about so many samples of each recording; None unless there are `times` more.

    A fit of a few of very many samples goes most of the way for a fraction of the time.
    """
    step = min(r.times.size for r in model.recordings) // samples
    if step < times:
        return None
    recordings, count = tuple(r.thinned(step) for r in model.recordings), len(model.recordings)
    thin = [b[::step] for b in ballbars[:count]]
    return replace(model, recordings=recordings), [*thin, *ballbars[count:]]


def moved(fit: Fit, step: Array) -> Fit:
    """The fit with an estimate that is off its minimum by a step (P,), its covariance as it is."""
    if not step.any():
        return fit
    model, linear = fit.model, fit.linear
    x = model.unknowns.moved(fit.x, step)
    at = normal_equations(
        model,
        x,
        fit.ballbars,
        fit.excess,
        weights=linear.weights,
        previous=linear.evaluations,
        robust=linear.robust,
    )
    return replace(fit, linear=at)
