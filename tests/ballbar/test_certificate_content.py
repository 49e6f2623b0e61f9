"""The content of a certificate: budget, errors, extent of the measurement, what follows."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ballbar.cell.arrays import Array
from ballbar.cell.errors import InputError
from ballbar.certificate import conformity, content
from ballbar.certificate.check import unlike
from ballbar.certificate.conformity import Tolerance, error_draws
from ballbar.certificate.content import (
    _budget,
    _check_follows,
    _common,
    _errors,
    _measurement,
    _name,
    _performance,
    _result,
    canonical,
    digest_of,
)


def space(**given: Any) -> Any:
    return SimpleNamespace(**given)


def row(name: str, share: float) -> Any:
    return space(
        name=name, evaluated="A", distribution="normal", contribution=1e-5, share=share, other=1
    )


def test_a_budget_prints_rows_from_a_hundredth_of_the_variance_and_sums_up_the_others() -> None:
    rows = (
        row("noise", 0.7),
        row("plate", 0.01),
        row("clock", 0.0099),
        row("rod", -0.02),
        row("x", 0.3001),
    )
    told = _budget(
        cast(Any, space(rows=rows, combined=2e-5, expanded=(4e-5, 0.0), coverage_factor=2.0))
    )
    assert told is not None
    assert [r["name"] for r in told["rows"]] == ["noise", "plate", "rod", "x"]
    assert set(told["rows"][0]) == {"name", "evaluated", "distribution", "contribution", "share"}
    assert told["others"] == pytest.approx(0.0099)
    assert (told["combined"], told["expanded"], told["k"]) == (2e-5, 4e-5, 2.0)
    assert _budget(None) is None


def a_robot(shift: Array) -> Any:
    """A robot over four poses whose nominal model puts the tool elsewhere by a shift (3,) [m]."""
    at = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    grow = 1.0 + shift[0]
    drawn = np.zeros((conformity.DRAWS, 4, 3))
    drawn[::2, :, 1] = 3e-3

    model = space(
        error_draws=lambda count, _: (np.zeros((4, 6)), drawn[:count]),
        tool=lambda _: at,
        rigid=lambda _: space(tool=lambda _: at * grow + [5.0, 0.0, 0.0]),
        lower=np.full(6, -1.0),
        upper=np.full(6, 2.0),
    )
    return space(identified=model, nominal="nominal")


def test_errors_are_drawn_about_the_identified_robot_and_about_the_nominal_ones_distance() -> None:
    """A base that stands elsewhere is no error; half the draws are 3 mm along y."""
    position, draws = error_draws(a_robot(np.zeros(3)))
    assert position.shape == (4, 3)
    assert set(draws) == {
        (which, what) for which in ("nominal", "identified") for what in ("mean", "largest")
    }
    for values in draws.values():
        assert values.shape == (conformity.DRAWS,)
        assert values[0] == pytest.approx(3e-3)
        assert values[1] == pytest.approx(0.0, abs=1e-9)
    _, grown = error_draws(a_robot(np.array([0.01, 0.0, 0.0])))
    assert grown["identified", "mean"] == pytest.approx(draws["identified", "mean"])
    still = grown["nominal", "largest"][1], grown["nominal", "mean"][1]
    assert still[0] > still[1] > 4e-3


def test_errors_are_stated_over_their_volume_with_the_tolerance_in_millimetres() -> None:
    told = _errors(a_robot(np.zeros(3)), Tolerance(mean_mm=1.6))
    assert told["poses"] == 4
    assert told["volume_m"] == [[0.0, 1.0]] * 3
    assert told["joints_rad"] == [[-1.0, 2.0]] * 6
    assert told["rule"]["risk"] == pytest.approx(0.02275, abs=1e-5)
    assert told["rule"]["coverage"] == pytest.approx(0.9545, abs=1e-4)
    first = told["errors"][0]
    assert (first["robot"], first["quantity"], first["tolerance_mm"]) == ("nominal", "mean", 1.6)
    assert first["value"] == pytest.approx(1.5e-3)
    assert first["probability"] == 0.5
    assert first["verdict"] == "neither"
    assert told["errors"][1]["tolerance_mm"] is None


def statement(value: float | None, high: float | None = None) -> Any:
    return space(value=value, high=high)


def test_positions_are_certified_where_nominal_identified_and_limit_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def line(place: str, unit: str, before: Any, after: Any) -> Any:
        return space(
            place=place, unit=unit, symbol="AP_p", clause="7.2", statements=(before, after, None)
        )

    known = statement(1e-3), statement(2e-4, 5e-4)
    rows = [
        line("P1 and P3", "m", *known), line("P1", "rad", *known), line("everywhere", "m", *known),
        line("P2", "m", statement(None), known[1]), line("P2", "m", known[0], statement(2e-4)),
        line("P2", "m", known[0], statement(None, 1.0)),
    ]  # fmt: skip
    monkeypatch.setattr(content, "performance", lambda _: space(rows=rows))
    assert list(_performance(cast(Any, None))) == [
        {"symbol": "AP", "poses": ["P1", "P3"], "clause": "7.2", "nominal": 1e-3,
         "identified": 2e-4, "limit": 5e-4},
    ]  # fmt: skip


def test_a_common_folder_is_that_of_the_files(tmp_path: Path) -> None:
    a, b = tmp_path / "one" / "a", tmp_path / "one" / "b"
    a.parent.mkdir()
    a.write_text("a")
    b.write_text("b")
    assert _common([a, b]) == tmp_path / "one"
    assert _common([a]) == tmp_path / "one"
    assert _name(tmp_path / "two", a) == "../one/a"


def logged(start: float, end: float, samples: int) -> Any:
    log = space(t=np.array([start, start + 1.0, end]))
    return space(
        name=f"r{samples}", recording=space(robot_log=log), estimate=space(samples=samples)
    )


def a_run(*temperatures: Any, kind: str = "real", columns: Any = ()) -> Any:
    groups = [space(temperature=column) for column in columns]
    tables = [
        ("t", space(table=space(groups=groups), description=space(kind="real", temperature_C=None)))
    ]
    read = [(None, space(description=space(kind=kind, temperature_C=t))) for t in temperatures]
    poses = space(table=space(size=40))
    return space(
        identification=space(poses=poses),
        recordings=[logged(2.0, 62.0, 300), logged(0.0, 30.0, 200)],
        tables=tables, held_out_tables=[], read=read, outcomes=[space(name="held")],
    )  # fmt: skip


def stated(**given: Any) -> Any:
    return space(**{"temperature_C": None, "temperature_spread_C": None, "measured": None} | given)


COMPUTED: Any = space(file=space(temperature=None, measured_on="2026-01-02"))


def test_the_extent_of_a_measurement_is_that_of_all_its_recordings() -> None:
    told = _measurement(a_run(20.0, 23.0), COMPUTED, stated())
    assert told["seconds"] == 90.0
    assert told["samples"] == 500
    assert told["poses"] == 40
    assert told["fitted"] == ["r300", "r200", "t"]
    assert told["held_out"] == ["held"]
    assert told["simulated"] is False
    assert _measurement(a_run(20.0, kind="simulated"), COMPUTED, stated())["simulated"] is True
    assert told["measured"] == "2026-01-02"
    assert (
        _measurement(a_run(20.0), COMPUTED, stated(measured="2026-01-01"))["measured"]
        == "2026-01-01"
    )
    none = a_run(20.0)
    none.identification.poses = None
    assert _measurement(none, COMPUTED, stated())["poses"] == 0


def test_temperatures_are_stated_or_those_of_recordings_and_columns() -> None:
    """Mean and span of all; of one alone no span; what is stated goes before."""

    def temperatures(run: Any, **given: Any) -> tuple[Any, Any]:
        told = _measurement(run, COMPUTED, stated(**given))
        return told["temperature_C"], told["temperature_spread_C"]

    assert temperatures(a_run(20.0, 23.0)) == (21.5, 3.0)
    assert temperatures(a_run(20.0, None)) == (20.0, None)
    assert temperatures(a_run(None)) == (None, None)
    column = a_run(20.0, columns=[np.array([21.0, 25.0]), None])
    assert temperatures(column) == (22.0, 5.0)
    assert temperatures(a_run(20.0, 23.0), temperature_C=19.0) == (19.0, 3.0)
    assert temperatures(a_run(20.0, 23.0), temperature_spread_C=1.0) == (21.5, 1.0)


def test_what_grows_with_the_temperature_is_stated_with_the_result() -> None:
    coefficient = space(name="link_growth", value=1e-4, sigma=1e-5)
    grown = space(name="link_growth", coefficients=[coefficient])
    other = space(name="compliance", coefficients=[coefficient, coefficient])
    robot = space(corrections=[other, grown], tcp=space(without_scale=np.array([1e-5, 3e-5])))
    run = space(
        identification=space(robot=robot, verdict=space(status="good")),
        outcomes=[space(acceptable=True), space(acceptable=False)], acceptable=False,
    )  # fmt: skip
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(content, "parameter_count", lambda _: 27)
        told = _result(cast(Any, run), cast(Any, space(tcp_sigma=4e-5)))
    assert told["unknowns"] == 30
    assert told["growth"] == [{"name": "link_growth", "value": 1e-4, "sigma": 1e-5}]
    assert told["tcp_sigma_without_scale"] == pytest.approx(2e-5)
    assert (told["tcp_sigma"], told["status"]) == (4e-5, "good")
    assert told["held_out_explained"] is False


@pytest.mark.parametrize(
    ("distance", "sigma", "status", "follows"),
    [(0.9e-8, 1e-5, "good", True), (1.1e-8, 1e-5, "good", False), (0.0, 1.0009e-5, "good", True),
     (0.0, 1.0011e-5, "good", False), (0.0, 1e-5, "suspect", False)],
)  # fmt: skip
def test_a_result_follows_that_moves_the_tool_by_less_than_a_thousandth_of_its_uncertainty(
    distance: float, sigma: float, status: str, follows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def result(sigma: float, status: str) -> Any:
        return space(tcp_sigma=sigma, file=space(fit=space(status=status)), path="c.yaml")

    compared = space(tcp=space(maximum=distance))
    monkeypatch.setattr(content, "compare", lambda *_: compared)
    places, details = [Path("logs")], Path("job.yaml")
    if follows:
        _check_follows(result(sigma, status), result(1e-5, "good"), places, details)
        return
    with pytest.raises(
        InputError, match=r"c\.yaml: does not follow from logs, whose robot puts the"
    ):
        _check_follows(result(sigma, status), result(1e-5, "good"), places, details)


def test_a_digest_is_of_the_content_in_its_order() -> None:
    one = {"b": 1, "a": [0.1, "é"]}
    assert canonical(one) == '{\n"b": 1,\n"a": [\n0.1,\n"é"\n]\n}'.encode()
    assert digest_of(one) != digest_of({"a": [0.1, "é"], "b": 1})
    with pytest.raises(ValueError, match=r"not JSON compliant|Out of range"):
        canonical({"a": np.nan})


@pytest.mark.parametrize(
    ("stated", "computed", "said"),
    [
        ({"a": 1.0}, {"a": 1.0 + 0.9e-5}, []),
        ({"a": 0.0}, {"a": 0.9e-12}, []),
        ({"a": 0.0}, {"a": 1e-9}, ["a: states 0, computed 1e-09"]),
        ({"a": 1.0}, {"a": 1.1}, ["a: states 1, computed 1.1"]),
        ({"a": [1, {"b": 2}]}, {"a": [1, {"b": 3}]}, ["a: 2: b: states 2, computed 3"]),
        ({"a": 1}, {"b": 1}, ["a: stated alone", "b: computed alone"]),
        ([1], [1, 2], ["states [1], computed [1, 2]"]),
        ({"a": True}, {"a": 1}, ["a: states True, computed 1"]),
        ({"a": 1}, {"a": 1.0}, ["a: states 1, computed 1.0"]),
        (None, None, []),
    ],
)
def test_plain_data_are_alike_but_for_the_last_bits_of_numbers(
    stated: Any, computed: Any, said: list[str]
) -> None:
    assert list(unlike(stated, computed)) == said
