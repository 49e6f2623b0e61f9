"""Information of poses about a robot: whitened rows at the nominal robot, predicted TCP error.

The rows are those of an identification (ballbar.ident.estimator.model): seats, targets, DH
parameters and sag with their priors, the instrument's noise, and what the model leaves unexplained.
Smooth errors of the joints are among the unknowns too. Without them a design gathers its poses at
few angles of
each joint, where such errors, which are there but not fitted, spoil the result: on simulated robots
the gain over random poses was lost (docs/planning). With the unknowns in standard deviations of
their priors, the information of a set of poses is `N = I + sum A_k' A_k`, A_k (E, P) the rows of
pose k, and the mean square TCP error over the workspace is `trace(R' N^-1 R)`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ballbar.cell.arrays import Array
from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import geometry_of_chain, parameter_table
from ballbar.cell.placement import Placement
from ballbar.cell.poses import CommonErrors, PoseGroup, PoseTable
from ballbar.cell.robot_angles import controller_to_joints
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.joint_harmonics import joint_harmonics
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.build_unknowns import still_unknowns
from ballbar.ident.estimator.model import Model, still_model
from ballbar.ident.estimator.normal_equations import whole_jacobian
from ballbar.ident.estimator.robust_fit import equations_at
from ballbar.ident.estimator.unknowns import PlacedPoses, Unknowns
from ballbar.ident.robot.accuracy import aligned_columns, position_sigma
from ballbar.ident.robot.identified import IdentifiedRobot
from ballbar.planning.crlb import PredictedInformation
from ballbar.planning.expected_pictures import expected_common, with_pictures
from ballbar.planning.feasible_poses import Candidates, random_candidates
from ballbar.planning.stations import PoseSetup, Station, nominal_stand, station_frames

# Smooth joint errors: orders, and [rad] sigma of an amplitude of order 1, falling with the root of
# the order. 3e-5 to 3e-4 and four or five orders gave poses as good on simulated robots.
ORDERS, AMPLITUDE = (1, 2, 3), 1e-4


@dataclass(frozen=True, eq=False)
class Information:
    """The model of a setup, of which every pose has rows of its own."""

    setup: PoseSetup
    layout: Unknowns
    corrections: tuple[Correction, ...]
    common: CommonErrors | None = None  # of a camera's lens and board

    def rows(self, poses: Candidates) -> Array:
        """(K, E, P) whitened rows of poses, per standard deviation of each prior."""
        layout, all_rows = self.layout, np.zeros((0, 0, 0))
        for k in np.unique(poses.station):
            of_station = np.flatnonzero(poses.station == k)
            station, axes = self.setup.stations[k], poses.axes[of_station]
            group = expected_group(self.setup, station, axes, self.common)
            model = self._model((group,))
            (point,) = model.at_rest(layout.mean)
            weights = model.weights(layout.mean, point, self.setup.unexplained)
            jacobian = whole_jacobian(model, layout.mean, 0, point, weights)
            rows = jacobian.transpose(2, 1, 0) * layout.sigma
            if not all_rows.size:
                all_rows = np.empty((poses.size, *rows.shape[1:]))
            all_rows[of_station] = rows
        return all_rows

    @cached_property
    def prior(self) -> Array:
        """(P, P) information of priors and known distances, per their standard deviations."""
        equations = equations_at(self._model(()), self.layout.mean, self.setup.unexplained, ())
        return equations.normal * np.outer(self.layout.sigma, self.layout.sigma)

    @cached_property
    def root(self) -> Array:
        """(P, P) [m] root R of the weights; the base is aligned as in
        ballbar.ident.robot.accuracy."""
        positions, moves = self.before.tool
        columns = np.zeros((positions.size, self.layout.count))
        columns[:, self.before.moving] = aligned_columns(positions, moves)
        triangle = np.asarray(np.linalg.qr(columns * self.layout.sigma, mode="r"))
        return np.asarray(triangle.T / np.sqrt(len(positions)))

    def prediction(self, rows: Array) -> PredictedInformation:
        """Information of the poses of whitened rows (K, E, P); the tool is the first target."""
        flat, sigma = rows.reshape(-1, self.layout.count), self.layout.sigma
        return replace(self.before, normal=(self.prior + flat.T @ flat) / np.outer(sigma, sigma))

    def catalogue_sigma(self) -> Array:
        """(G,) [m] standard deviation of the nominal robot, its target known exactly."""
        machine, (positions, moves) = self.layout.machine, self.before.tool
        variance = np.diag(self.layout.sigma[machine] ** 2)
        return position_sigma(positions, moves[machine], variance)

    @cached_property
    def before(self) -> PredictedInformation:
        """The prediction without any pose."""
        layout, setup, station = self.layout, self.setup, self.setup.stations[0]
        robot = IdentifiedRobot(
            setup.robot,
            geometry_of_chain(parameter_table(setup.robot), setup.chain),
            self.corrections,
            layout.mean[layout.coefficients],
            target=Placement(station.target_rotation, station.point),
        )
        return PredictedInformation(
            layout=layout,
            normal=np.diag(layout.sigma**-2.0),
            robot=robot,
            grid=setup.grid,
            target=station.target,
        )

    def _model(self, groups: tuple[PoseGroup, ...]) -> Model:
        setup = self.setup
        table = PoseTable(setup.request.name, setup.robot, groups, setup.distances)
        return still_model(table, self.layout, self.corrections, np.zeros(setup.robot.joints))


def information_of(setup: PoseSetup) -> Information:
    """The model of a setup at its nominal robot, seats and targets."""
    middle, common = 0.5 * (setup.lower + setup.upper)[None], _common(setup)
    groups = tuple(expected_group(setup, station, middle, common) for station in setup.stations)
    seats = {s.seat: Placement(s.seat_rotation, s.origin) for s in setup.stations}
    targets = {s.target: Placement(s.target_rotation, s.point) for s in setup.stations}
    corrections = (unit_weights(setup.robot), smooth_joint_errors(setup.robot))
    nominal = geometry_of_chain(parameter_table(setup.robot), setup.chain)
    table = PoseTable(setup.request.name, setup.robot, groups, setup.distances)
    layout = still_unknowns(nominal, PlacedPoses(table, seats, targets), corrections)
    return Information(setup, layout, corrections, common)


def _common(setup: PoseSetup) -> CommonErrors | None:
    """Errors of lens and board after as many pictures as planned, at random poses."""
    if setup.instrument.view is None:
        return None
    rng, station = np.random.default_rng(setup.request.seed), setup.stations[0]
    axes = random_candidates(setup, setup.request.poses, rng).axes
    stand = nominal_stand(station, station_frames(setup, station, axes))
    return expected_common(setup.instrument, stand)


def smooth_joint_errors(robot: Robot) -> Correction:
    """Errors of the lowest orders of every joint."""
    orders = [(joint, order) for joint in range(robot.joints) for order in ORDERS]
    correction = joint_harmonics(orders)
    waves = len(correction.coefficients) // len(orders)
    sigmas = [AMPLITUDE / np.sqrt(order) for _, order in orders for _ in range(waves)]
    expected = tuple(
        replace(coefficient, sigma=float(sigma))
        for coefficient, sigma in zip(correction.coefficients, sigmas, strict=True)
    )
    return replace(correction, coefficients=expected)


def expected_group(
    setup: PoseSetup, station: Station, axes: Array, common: CommonErrors | None = None
) -> PoseGroup:
    """The values that the nominal robot lets an instrument measure at axis angles (N, J) [rad].

    common : errors of a camera's lens and board. Of still poses; those of a robot that moves have
    a time and a motion besides.
    """
    instrument = setup.instrument
    stand = nominal_stand(station, station_frames(setup, station, axes))
    values = instrument.kind.measure(stand, np.zeros((6, len(axes))), instrument)
    group = PoseGroup(
        measured=instrument.measured,
        seat=station.seat,
        target=station.target,
        q=controller_to_joints(setup.robot, axes),
        values=values,
        sigma=instrument.sigma(values),
        rows=np.arange(1, len(axes) + 1),
        file="plan",
    )
    return with_pictures(group, instrument, stand, common)
