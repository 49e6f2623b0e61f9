"""Static errors of the true geometry: thesis Table 3.1, or drawn per seed."""

from __future__ import annotations

import numpy as np

from cell.geometry import INDEX, PARAMETERS, Geometry
from sim.settings import StaticErrors

# Thesis Table 3.1, in mm and mrad. Only parameters that every cost function can identify deviate.
THESIS_3_1 = {
    "ra1": -0.40, "ra2": 0.14, "ra3": -1.52, "ra4": -1.88, "ra5": 0.80,
    "rd2": 0.27, "rd4": -0.16, "rd5": 1.80, "rd6": -1.47,
    "ralpha1": 0.37, "ralpha2": 0.78, "ralpha3": -1.36, "ralpha4": 0.35, "ralpha5": 0.08,
    "rtheta2": -0.09, "rtheta3": 0.19, "rtheta4": -0.12, "rtheta5": 0.72, "rtheta6": -0.22,
    "bd3": 0.24, "btheta1": -0.74, "btheta2": 1.27, "btheta3": -1.90, "btheta4": -0.19, "btheta5": 0.98,
    "ox": 0.16, "oy": 0.80, "oz": -0.70,
}  # fmt: skip
_MILLI = 1e-3


def true_geometry(nominal: Geometry, errors: StaticErrors | None, rng: np.random.Generator) -> Geometry:
    """The nominal geometry with its static errors; drawn ones fall on the parameters that Table 3.1 deviates."""
    if errors is None:
        return nominal
    if errors.table == "thesis_3_1":
        deviations = {name: value * _MILLI for name, value in THESIS_3_1.items()}
    else:
        drawn = rng.standard_normal(len(THESIS_3_1))
        sigma = {True: errors.sigma_m or 0.0, False: errors.sigma_rad or 0.0}
        deviations = {name: float(z) * sigma[PARAMETERS[INDEX[name]].is_length] for name, z in zip(THESIS_3_1, drawn, strict=True)}
    return nominal.replaced({name: nominal[name] + value for name, value in deviations.items()})
