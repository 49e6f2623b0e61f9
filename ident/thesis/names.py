"""Names of the cost functions and of how each is used, and the encoders that it needs."""

from __future__ import annotations

from typing import Literal

CostName = Literal["length", "position", "position_angles", "transform"]  # thesis eqs. 2.1 to 2.4

ENCODERS_NEEDED: dict[CostName, tuple[int, ...]] = {
    "length": (),
    "position": (1, 2),
    "position_angles": (1, 2, 4, 5),
    "transform": (1, 2, 3, 4, 5),
}
# core: priorities 1 to 4 of thesis sec. 3.3 (encoder offsets, ball-bar origin, robot, rod);
# all: also 5, "ball-bar parameters not mentioned above"
ParameterSet = Literal["core", "all"]
# The printed scalars end by relative decrease of cost and step, whose size the thesis does not
# print. This one is near the minimum; Matlab's lsqnonlin, by default, ends at 1e-6.
PRINTED_STOP = 1e-10
ShiftAt = Literal["identified", "nominal"]  # geometry at which a log is moved (thesis sec. 5.2)
Smoothing = Literal["none", "moving_average", "spline"]  # of the logs of a cost
Pairing = Literal["fit", "logs"]  # clock and start of a cost on logs
Instants = Literal["all", "standing", "moving", "constant_speed"]  # samples of a cost
# not one of the thesis: the whole residual, weighed by its noise
# (ballbar.ident.estimator.whitening)
ML = "ml"
COSTS = (ML, *ENCODERS_NEEDED)
