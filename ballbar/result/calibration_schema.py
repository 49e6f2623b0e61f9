"""Schema of calibration.yaml (`ballbar-calibration/2`): the identified machine, in SI units.

What the recordings share stands once. Of logs, encoder offsets, base pose and clock stand with each
recording, also when there is only one. Tables of still poses hold seats and targets instead, the
fitted range of every joint, and what cross-validation says of poses that were not fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from ballbar.cell.descriptions import Robot
from ballbar.cell.geometry import Geometry, ParameterTable, parameter_named, table_of_names
from ballbar.cell.payload import TOOL
from ballbar.cell.schema import Day, Strict
from ballbar.cell.schema_errors import Loc, missing_key, nearest, wrong_key
from ballbar.ident.corrections import OF_MACHINE
from ballbar.ident.corrections.base import Correction
from ballbar.ident.corrections.gear_backlash import gear_backlash
from ballbar.ident.corrections.gear_ripple import gear_ripple
from ballbar.ident.corrections.joint_compliance import joint_compliance
from ballbar.ident.corrections.joint_harmonics import JOINT_HARMONICS, joint_harmonics, orders_of
from ballbar.ident.corrections.joint_lag import joint_lag
from ballbar.ident.corrections.unit_weights import unit_weights
from ballbar.ident.estimator.priors import belongs_to_recording, shared_names
from ballbar.result.budget_entries import BudgetEntry
from ballbar.result.machine_entries import (
    RESTORE,
    CoefficientEntry,
    CovarianceEntry,
    DroppedEntry,
    MassesEntry,
    ParameterEntry,
    RangeEntry,
)
from ballbar.result.recording_entries import (
    LOGS,
    POSES,
    AnyHeldOut,
    AnyRecording,
    CameraEntry,
    CrossValidationEntry,
    FitEntry,
    GroupEntry,
    Of,
    OfPoses,
    OrderEntry,
    PlacementEntry,
    RecordingEntry,
    marks_of,
)
from ballbar.result.temperature_entries import TemperatureEntry

SCHEMA: Final = "ballbar-calibration/2"

LEARNED_HARMONICS: Final = "learned_harmonics"  # joint errors kept from another result

# Corrections of still poses by name, formed again from the names of their coefficients.
POSE_CORRECTIONS: dict[str, Callable[[Robot, Iterable[str]], Correction]] = {
    "unit_weights": lambda robot, _: unit_weights(robot),
    "joint_compliance": lambda robot, _: joint_compliance(robot),
    "gear_backlash": lambda robot, _: gear_backlash(robot),
    "gear_ripple": lambda robot, _: gear_ripple(robot),
    "joint_lag": lambda robot, _: joint_lag(robot),
    JOINT_HARMONICS: lambda _, coefficients: joint_harmonics(orders_of(coefficients)),
    LEARNED_HARMONICS: lambda _, coefficients: replace(
        joint_harmonics(orders_of(coefficients)), name=LEARNED_HARMONICS
    ),
}

Places = dict[str, PlacementEntry]


class CalibrationFile(Strict):
    """Schema of calibration.yaml."""

    model_config = ConfigDict(
        populate_by_name=True,  # `schema` is a method of pydantic's
        ser_json_inf_nan="constants",  # a refused result shows what was fitted
    )

    schema_: Annotated[Literal["ballbar-calibration/2"], Field(alias="schema")]
    robot: str
    instrument: str
    plate: Annotated[str, Of(LOGS)] = ""
    model: Literal["dh", "complete", "poses"]
    parameters: dict[str, ParameterEntry]  # of logs, of robot and instrument
    dropped: Annotated[tuple[DroppedEntry, ...], Of(LOGS, needed=False)] = ()
    corrections: dict[str, dict[str, CoefficientEntry]] = Field(default_factory=dict)
    # absent where those of the files were used
    masses: Annotated[MassesEntry | None, Of(LOGS, needed=False)] = None
    orders: Annotated[tuple[OrderEntry, ...], Of(POSES, needed=False)] = ()
    seats: Annotated[Places, Field(min_length=1), Of(POSES)] = Field(default_factory=dict)
    targets: Annotated[Places, Field(min_length=1), Of(POSES)] = Field(default_factory=dict)
    cameras: Annotated[dict[str, CameraEntry], Of(POSES, needed=False)] = Field(
        default_factory=dict
    )
    ranges: Annotated[tuple[RangeEntry, ...], Field(max_length=8)] = ()  # of the joints
    covariance: Annotated[CovarianceEntry | None, Of(LOGS, needed=False)] = None
    recordings: Annotated[tuple[AnyRecording, ...], Field(min_length=1)]
    cross_validation: OfPoses[CrossValidationEntry] = None
    fit: FitEntry
    temperature: TemperatureEntry | None = None  # absent where it was not stated
    uncertainty_budget: BudgetEntry | None = None  # older files do not state it
    held_out: tuple[AnyHeldOut, ...] = ()
    # last day of measurement; absent where neither stamps nor descriptions of the recordings say it
    measured_on: Day | None = None

    @property
    def logs(self) -> tuple[RecordingEntry, ...]:
        """The recordings of a moving robot."""
        return tuple(r for r in self.recordings if isinstance(r, RecordingEntry))

    @property
    def groups(self) -> tuple[GroupEntry, ...]:
        """The still poses of each seat and target."""
        return tuple(r for r in self.recordings if isinstance(r, GroupEntry))

    @property
    def kinds(self) -> set[str]:
        """Kinds of the recordings."""
        return {POSES if isinstance(r, GroupEntry) else LOGS for r in self.recordings}

    @model_validator(mode="after")
    def _is_of_its_recordings(self) -> CalibrationFile:
        """The file has the keys of its recordings' kinds, and no others."""
        of_poses = self.kinds == {POSES}
        if of_poses != (self.model == POSES):
            message = f"the recordings are {'still poses' if of_poses else 'logs'}"
            raise wrong_key("model", message=message)
        for (*place, key), mark in _marked_keys():
            part = self.fit if place else self
            stated = key in part.model_fields_set and getattr(part, key) is not None
            if mark.kind in self.kinds:
                # what follows from still poses alone is not there beside logs
                if mark.needed and not stated and (mark.kind == LOGS or of_poses):
                    raise missing_key(*place, key)
            elif stated:
                only = "still poses" if mark.kind == POSES else "logs"
                raise wrong_key(*place, key, message=f"only a result of {only} has this key")
        valid = POSE_CORRECTIONS if of_poses else OF_MACHINE
        for name in self.corrections:
            if name not in valid:
                what = "still poses" if of_poses else "results, or of a plug-in that is installed"
                hint = nearest(name, valid, noun="name")
                raise wrong_key("corrections", name, message=f"no correction of {what}.{hint}")
        return self

    @model_validator(mode="after")
    def _recordings_have_their_seats_and_targets(self) -> CalibrationFile:
        for k, group in enumerate(self.recordings):
            if isinstance(group, GroupEntry):
                for key, places in (("seat", self.seats), ("target", self.targets)):
                    if (name := getattr(group, key)) not in places:
                        hint = nearest(name, places, noun="name")
                        raise wrong_key("recordings", k, key, message=f"not in `{key}s`.{hint}")
        return self

    @model_validator(mode="after")
    def _is_of_one_mechanism(self) -> CalibrationFile:
        """Parameters, ranges, masses and covariance are of the same joints and unknowns."""
        if not self.logs:  # the robot's file says which parameters still poses tell
            return self
        _check_names(("parameters",), self.parameters, lambda name: not belongs_to_recording(name))
        table = table_of_names(self.parameters)
        _check_complete(("parameters",), self.parameters, shared_names(table))
        expected = [name for name in table.names if belongs_to_recording(name)]
        for k, recording in enumerate(self.recordings):
            if isinstance(recording, RecordingEntry):
                place = ("recordings", k, "parameters")
                _check_names(place, recording.parameters, belongs_to_recording)
                _check_complete(place, recording.parameters, expected)
        self._check_counts(table.joints)
        if self.covariance is not None:
            self._check_unknowns(self.covariance, table)
        return self

    def _check_counts(self, joints: int) -> None:
        """There is a range, and a mass where any is stated, for each joint."""
        counts: dict[Loc, int] = {("ranges",): len(self.ranges)}
        if self.masses is not None:
            counts["masses", "links"] = len(self.masses.links)
        for loc, count in counts.items():
            if count not in (0, joints):
                expected = f"one for each of the {joints} joints that `parameters` has"
                raise wrong_key(*loc, message=f"expected {expected}, found {count}")

    def _check_unknowns(self, stated: CovarianceEntry, table: ParameterTable) -> None:
        """The covariance names parameters in the order of the table, then all coefficients."""
        names, shared = set(stated.names), shared_names(table)
        coefficients = [name for entries in self.corrections.values() for name in entries]
        expected = {
            "names": [*(n for n in shared if n in names), *coefficients],
            "held": [n for n in shared if n in stated.held and n not in names],
        }
        for key, order in expected.items():
            for k, pair in enumerate(zip_longest(getattr(stated, key), order)):
                if pair[0] != pair[1]:
                    raise wrong_key(
                        *("covariance", key, k)[: 3 if pair[0] else 2],
                        message=f"expected {pair[1] or 'no further name'} as name {k + 1}: each "
                        "name once, parameters in the order ra, rd, ralpha, rtheta, rbeta, ba, bd, "
                        f"balpha, then the coefficients in the order of `corrections`. {RESTORE}",
                    )
        _check_masses(stated, table.joints)

    @model_serializer(mode="wrap")
    def _with_keys_of_its_recordings(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = plain(self)
        for (*place, key), mark in _marked_keys():
            if mark.kind not in self.kinds:
                (content["fit"] if place else content).pop(key, None)
        return content

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the identified parameters, those of the first recording of logs included."""
        entries = self.parameters | (self.logs[0].parameters if self.logs else {})
        names = table_of_names(entries).names if self.logs else entries
        return tuple(name for name in names if entries[name].identified)

    def geometry(self, recording: int = 0, *, nominal: bool = False) -> Geometry:
        """All kinematic parameters, base pose and encoder offsets those of one recording."""
        entries = self.parameters | self.logs[recording].parameters
        table = table_of_names(entries)
        values = [entries[k].nominal if nominal else entries[k].value for k in table.names]
        return Geometry(np.array(values), table)


def _marked_keys() -> Iterator[tuple[tuple[str, ...], Of]]:
    """Places of the keys that only one kind of recordings gives."""
    yield from (((name,), mark) for name, mark in marks_of(CalibrationFile))
    yield from ((("fit", name), mark) for name, mark in marks_of(FitEntry))


def _check_names(place: Loc, entries: Iterable[str], belongs: Callable[[str], bool]) -> None:
    """Each name stands for a parameter, and for one of those that belong here."""
    for name in entries:
        try:
            parameter_named(name)
        except KeyError:
            raise wrong_key(*place, name, message="no parameter has this name") from None
        if not belongs(name):
            raise wrong_key(
                *place,
                name,
                message="this parameter does not belong here: encoder offsets and base pose stand "
                "with each recording, all others in `parameters`",
            )


def _check_complete(place: Loc, entries: Iterable[str], expected: Sequence[str]) -> None:
    """No parameter is missing of the mechanism that the entries describe."""
    present = {name: parameter_named(name) for name in entries}
    missing = [parameter_named(name) for name in expected if name not in present]
    extra = [name for name in present if name not in expected]
    if missing:
        first = missing[0]
        row = [p for p in missing if (p.side, p.row) == (first.side, first.row)]
        beside = [n for n, p in present.items() if (p.side, p.row) == (first.side, first.row)]
        listed = ", ".join(p.name for p in row)
        others = f" beside {', '.join(beside)}" if beside else ""
        remove = f", or remove {', '.join(beside)}" if len(beside) < len(row) else ""
        raise wrong_key(*place, message=f"without {listed}{others}. Add what is missing{remove}")
    if extra:
        raise wrong_key(*place, extra[0], message="no parameter of this mechanism. Remove it")


def _check_masses(stated: CovarianceEntry, joints: int) -> None:
    """A direction of masses is of the tool and of all links."""
    size = TOOL + 4 * joints
    for k, direction in enumerate(stated.masses):
        if len(direction) != size:
            raise wrong_key(
                *("covariance", "masses", k),
                message=f"expected {size} numbers, of the tool and of {joints} links, found "
                f"{len(direction)}",
            )
