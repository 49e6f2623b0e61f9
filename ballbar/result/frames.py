"""Tables of a calibration as data frames, in SI units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from ballbar.cell.arrays import Array
from ballbar.cell.geometry import parameter_named
from ballbar.result.calibration_schema import CalibrationFile
from ballbar.result.run_data import RunData


def parameters(file: CalibrationFile) -> pd.DataFrame:
    """Unit, nominal value, value, standard deviation (NaN where not identified) and `identified`
    of every parameter, by recording (empty for what all share) and name.
    """
    own = {recording.name: recording.parameters for recording in file.logs}
    rows = {
        (recording, name): {"unit": parameter_named(name).unit} | entry.model_dump()
        for recording, entries in ({"": file.parameters} | own).items()
        for name, entry in entries.items()
    }
    frame = pd.DataFrame(list(rows.values()), index=_index(rows, "recording", "parameter"))
    return frame.astype({"sigma": float})


def corrections(file: CalibrationFile) -> pd.DataFrame:
    """Value, standard deviation, prior and information gain of every coefficient, by correction."""
    rows = {
        (correction, name): entry.model_dump()
        for correction, entries in file.corrections.items()
        for name, entry in entries.items()
    }
    columns = ["unit", "value", "sigma", "prior", "prior_sigma", "information_gain"]
    index = _index(rows, "correction", "coefficient")
    return pd.DataFrame(list(rows.values()), columns=columns, index=index)


def _index(rows: dict[tuple[str, str], dict[str, object]], *names: str) -> pd.MultiIndex:
    return pd.MultiIndex.from_tuples(list(rows), names=names)


def residuals(run: RunData) -> pd.DataFrame:
    """Position residuals x, y, z and their norm [m], robot base frame, with the time t [s] of logs
    (NaN for still poses), by recording or seat and target, and by robot: nominal or identified.
    """
    parts = list[pd.DataFrame]()
    for (source, robot), t, position in _residuals(run):
        columns = {"t": t, **dict(zip("xyz", position.T, strict=True))}
        part = pd.DataFrame(columns | {"norm": np.linalg.norm(position, axis=1)})
        index = pd.MultiIndex.from_tuples([(source, robot)] * len(t), names=["source", "robot"])
        parts.append(part.set_index(index))
    return pd.concat(parts)


def _residuals(run: RunData) -> Iterator[tuple[tuple[str, str], Array, Array]]:
    """Source and robot, times (N,) [s], and residuals (N, 3) [m] of each part."""
    for fitted in run.recordings:
        sides = {"nominal": fitted.estimate.before, "identified": fitted.estimate.after}
        for robot, side in sides.items():
            yield (fitted.name, robot), side.t, side.position
    if (poses := run.identification.poses) is None:
        return
    for robot, fit in {"nominal": poses.nominal, "identified": poses.fit}.items():
        points = fit.linear.evaluations[fit.still]
        for group, point in zip(fit.model.poses.groups, points, strict=True):
            source = f"{group.seat}, {group.target}"
            yield (source, robot), np.full(group.size, np.nan), point.closure.error[:3].T
