"""Tables of the report: digits follow the uncertainty, signs and units those of each column."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ballbar.cell.geometry import parameter_named
from ballbar.ident.result import CoefficientEstimate
from ballbar.ident.verdict import Status
from ballbar.planning import next_step
from ballbar.report import machine, parameters
from ballbar.report.line_plot import Curve, Plot, draw
from ballbar.report.numbers import MISSING
from ballbar.report.polar_plot import SHARE, polar_plot

Stub = SimpleNamespace
MINUS = "\u2212"


class Values(dict[str, float]):
    """Kinematic parameters by name, with their table."""

    @property
    def table(self) -> Stub:
        return Stub(parameters=tuple(map(parameter_named, self)), index=dict.fromkeys(self, 0))


def robot(**changes: Any) -> Any:
    """Deviations of 0.25 mm and -1 mrad, known to 5 um and 0.02 mrad; a seat without catalogue."""
    nominal = Values(ra2=0.705, rtheta3=0.5, btheta1=0.1, ox=0.7, bd3=0.6)
    base = {
        "nominal": nominal,
        "geometry": Values(ra2=0.70525, rtheta3=0.499, btheta1=0.3, ox=0.71, bd3=0.6),
        "sigma": {"ra2": 5e-6, "rtheta3": 2e-5, "btheta1": 1e-5, "ox": 3e-6},
        "dropped": (), "corrections": (),
    }  # fmt: skip
    return Stub(**base | changes)


def test_parameters_are_grouped_with_the_digits_of_their_sigma() -> None:
    groups = {group.title: group for group in parameters.parameter_groups(robot(), None)}
    assert list(groups) == ["Robot, lengths", "Robot, angles", "Encoder offsets", "Base position"]
    lengths = groups["Robot, lengths"]
    assert (lengths.value_unit, lengths.deviation_unit, lengths.sigma_unit) == ("mm", "mm", "µm")
    (row,) = lengths.rows
    assert row == {
        "name": "ra2", "nominal": "705.000", "identified": "705.250", "deviation": "+0.250",
        "sigma": "5.0", "significance": "50", "true_deviation": MISSING, "error": MISSING,
        "z": MISSING, "remarkable": False,
    }  # fmt: skip
    angles = groups["Robot, angles"]
    assert (angles.value_unit, angles.deviation_unit, angles.sigma_unit) == ("deg", "mrad", "µrad")
    (row,) = angles.rows
    assert (row["nominal"], row["identified"]) == ("28.648", "28.591")
    assert (row["deviation"], row["sigma"], row["significance"]) == (f"{MINUS}1.00", "20", "50")
    (row,) = groups["Base position"].rows
    assert (row["nominal"], row["identified"], row["deviation"]) == (MISSING, "710.000", MISSING)
    (row,) = groups["Encoder offsets"].rows
    assert (row["nominal"], row["significance"]) == (MISSING, MISSING)


def test_against_the_truth_errors_are_model_minus_truth_and_marked_beyond_three_sigma() -> None:
    truth: Any = Stub(deviations={"ra2": 14e-6, "rtheta3": -6.2e-5})
    (length,), (angle,), *_ = (group.rows for group in parameters.parameter_groups(robot(), truth))
    assert (length["error"], length["z"], length["remarkable"]) == ("+14.0", "+2.8", False)
    assert length["true_deviation"] == "+0.236"
    assert (angle["error"], angle["z"], angle["remarkable"]) == (f"{MINUS}62", f"{MINUS}3.1", True)
    assert angle["true_deviation"] == f"{MINUS}0.94"


def dropped(name: str, reason: str, *on: str) -> Stub:
    return Stub(name=name, reason=reason, on=on)


def test_what_stays_nominal_says_why_and_what_carries_its_deviation() -> None:
    left = [
        dropped("ra2", "depends on", "bd3"), dropped("rtheta3", "depends on", "ox", "oy"),
        dropped("skew", "no effect"), dropped("bd3", "prior"), dropped("ox", "another"),
    ]  # fmt: skip
    rows = parameters.left_at_nominal(robot(dropped=left))
    assert [row[:2] for row in rows] == [
        ("ra2", "705.000 mm"), ("rtheta3", "28.6479 deg"), ("skew", MISSING), ("ox", "700.000 mm"),
    ]  # fmt: skip
    assert rows[0][2].endswith("looks exactly like a change of bd3")
    assert "What is identified as bd3 carries its deviation" in rows[0][3]
    assert "identified as ox and oy carry its deviation" in rows[1][3]
    assert rows[3][2:] == ("another", "")
    assert parameters.parameters_at_prior(robot(dropped=left)) == ["bd3"]
    one = robot(dropped=[dropped("rtheta3", "prior")], sigma={"ra2": 5e-6})
    assert parameters.not_requested(one) == ["bd3"], "seat and encoder offsets have no catalogue"


def test_a_recording_names_its_own_parameters_that_it_does_not_determine() -> None:
    one: Any = Stub(encoders=(1, 4), geometry=Values(ox=0.0, oy=0.0, ra2=0.0), sigma={"ox": 1.0})
    assert parameters.taken_as_nominal(one) == ["btheta1", "btheta4", "oy"]
    result: Any = Stub(robot=Stub(sigma={"a": 1, "b": 2}), recordings=[one, one])
    assert parameters.parameter_count(result) == 4


def coefficient(name: str, value: float, sigma: float, unit: str, gain: float = 0.9) -> Any:
    return CoefficientEstimate(
        name=name, unit=unit, value=value, sigma=sigma, prior=2.0 * value, prior_sigma=0.5 * value,
        information_gain=gain,
    )  # fmt: skip


def test_a_compliance_is_shown_as_stiffness_too() -> None:
    """A compliance of 2.5 +- 0.05 urad/(N m) is 400 000 +- 8 000 N m/rad."""
    made = Stub(
        sentence="elastic gears.",
        coefficients=[
            coefficient("k1", 2.5e-6, 5e-8, "rad/(N m)"),
            coefficient("k2", -1e-6, 5e-8, "rad/(N m)", 0.2),
        ],
    )  # fmt: skip
    (table,) = parameters.correction_tables(robot(corrections=(made,)))
    assert (table.title, table.unit) == ("Elastic gears.", "µrad/(N m)")
    assert table.stiffness_unit == "N m/rad"
    first, second = table.rows
    assert (first["value"], first["sigma"], first["prior"]) == ("2.50", "0.050", "5.00")
    assert (first["prior_sigma"], first["information_gain"]) == ("1.25", "90 %")
    assert first["stiffness"] == "400\u202f000 ± 8\u202f000"
    assert (second["stiffness"], second["value"]) == (MISSING, f"{MINUS}1.00")
    assert (first["from_data"], second["from_data"]) == (True, False)
    at_prior = parameters.coefficients_at_prior(robot(corrections=(made,)))
    assert [c.name for c in at_prior] == ["k2"]
    assert parameters.coefficient_text(at_prior[0]) == f"{MINUS}1.0 ± 0.050 µrad/(N m)"


def test_sine_and_cosine_are_one_amplitude_and_units_have_tables_of_their_own() -> None:
    made = Stub(
        sentence="waves",
        coefficients=[
            coefficient("ripple2_40_sin", 3e-5, 1e-6, "rad", 0.8),
            coefficient("ripple2_40_cos", 4e-5, 2e-6, "rad", 0.4),
            coefficient("encoder3_1_sin", 0.0, 2e-6, "rad"),
            coefficient("encoder3_1_cos", 0.0, 3e-6, "rad"),
            coefficient("other_1_sin", 1e-5, 1e-6, "rad"),
            coefficient("lag", 1e-3, 1e-5, "s"),
            coefficient("odd", 2.0, 0.5, "furlong"),
        ],
    )
    angles, times, odd = parameters.correction_tables(robot(corrections=(made,)))
    assert [row["name"] for row in angles.rows] == [
        "gear 2, 40 a turn",
        "encoder b3, 1 a turn",
        "other_1",
    ]
    wave, none, _ = angles.rows
    assert (wave["value"], wave["information_gain"]) == ("50", "40 %")
    assert wave["sigma"] == f"{np.hypot(3 * 1.0, 4 * 2.0) / 5.0:.1f}"
    assert (none["value"], none["sigma"]) == ("0", "2.0")
    assert (angles.unit, times.unit, odd.unit) == ("µrad", "µs", "furlong")
    assert (times.rows[0]["value"], times.stiffness_unit) == ("1000", "")
    assert odd.rows[0]["value"] == "2.0"


# -- diagnosis and next steps


def step(key: str, value: str, sigma: float) -> Any:
    predicted = Stub(sigma=np.array([sigma, sigma]), without_scale=np.array([0.5 * sigma] * 2))
    return Stub(key=key, value=value, predicted=predicted)


def test_the_step_that_lowers_the_uncertainty_most_is_advised() -> None:
    present: Any = Stub(sigma=np.array([3e-5, 5e-5]), without_scale=np.array([2e-5]))
    steps = [
        step("repeat", "", 3.9e-5), step("encoders", "b3 b5", 3e-5), step("rod_sigma", "", 3.8e-5),
    ]  # fmt: skip
    assert machine._advice(steps, present) == (
        "Most would help next: an encoder on b3 and b5 too; the uncertainty would be 25 % less, as "
        "far as it can be predicted."
    )
    assert machine._advice(steps[:1], present).startswith("None of the steps below")
    words, with_scale, without, change = machine._step_row(steps[1], present)
    assert (with_scale, without, change) == ("0.0300", "0.0150", f"{MINUS}25")
    assert machine._step_row(steps[0], present)[3] == f"{MINUS}2.5"
    assert words == "an encoder on b3 and b5 too"
    size = f"{next_step.ROD_SIGMA * 1e6:.0f} µm"
    assert machine._words(steps[2]) == f"the rod measured to {size} (--rod-sigma)"


def test_nothing_is_advised_where_something_is_to_be_repaired_or_no_encoder_helps() -> None:
    cell = Stub(ballbar=Stub(stroke=(0.1, 0.2)))
    result = Stub(robot=Stub(cell=cell), verdict=Stub(status=Status.GOOD))
    run: Any = Stub(recordings=[1], identification=result)
    assert machine.advised_steps(run) == machine.Steps()
    cell.ballbar.stroke, result.verdict.status = None, Status.MISFIT
    assert machine.advised_steps(run) == machine.Steps()
    run.recordings = []
    assert machine.advised_steps(run) == machine.Steps()
    assert machine.diagnosis_section(run, machine.Steps()) == []


def test_drivers_beyond_those_shown_are_added_up() -> None:
    parts = [
        Stub(name="ra2", source="", share=0.5 / (k + 1), size=1e-5, sigma=1e-6)
        for k in range(machine.SHOWN + 3)
    ]
    parts[0] = Stub(name="k1", source="compliance", share=0.6, size=2e-5, sigma=1e-6)
    rows = machine._before(parts, {"compliance": "Elastic gears."})  # type: ignore[arg-type]
    assert (rows[0].names, rows[0].what, rows[0].share) == ("k1", "Elastic gears.", 0.6)
    assert rows[1].what == machine._meaning("ra2")
    assert rows[1].what.endswith("row 2")
    assert len(rows) == machine.SHOWN + 1
    assert rows[-1].what == "3 smaller ones together"
    assert rows[-1].share == pytest.approx(sum(part.share for part in parts[-3:]))
    assert len(machine._before(parts[1 : 1 + machine.SHOWN], {})) == machine.SHOWN  # type: ignore[arg-type]


def test_directions_of_the_uncertainty_name_their_members_and_the_rest() -> None:
    def direction(name: str, share: float, *members: tuple[str, float]) -> Any:
        return Stub(name=name, members=members, rms=share * 1e-4, share=share)

    known = direction("1", 0.5, ("ra2", 0.98), ("rd4", -0.2), (f"{machine.MASSES}1", 0.1))
    tcp: Any = Stub(
        directions=[direction(machine.SCALE, 0.3), known, direction("3", 0.1)],
        share=lambda d: d.share,
    )
    scale, named, many, rest = machine._after(tcp)
    assert scale.what == "scale of all lengths, which no recording shows"
    assert (named.names, named.what) == (f"ra2 +0.98, rd4 {MINUS}0.20", "")
    assert many.what == "many unknowns, each a little"
    assert (rest.what, rest.share) == ("all other directions", pytest.approx(0.1))
    assert machine._rate(np.array([0.0, 0.004, 0.008, 0.5])) == pytest.approx(250.0)
    assert [machine._percent(share) for share in (0.1, 0.0994, -0.25)] == [
        "10",
        "9.9",
        f"{MINUS}25",
    ]


# -- plots


def numbers(pattern: str, text: str) -> list[list[float]]:
    return [[float(x) for x in found] for found in re.findall(pattern, text)]


def test_plots_stand_above_each_other_on_one_axis_with_their_curves_inside() -> None:
    x = np.array([0.0, 10.0])
    plots = [Plot([Curve(x, x - 5.0, "#111")], "a", y=(-10.0, 10.0), zero=True, lines=(5.0,))]
    plots.append(
        Plot(
            [Curve(x, x, "#222", dashed=True)], "b", y=(0.0, 20.0), spans=((2.0, 4.0, "#333", 0.5),)
        )
    )
    text = str(draw(plots, "t [s]", height=300.0, x=(0.0, 10.0)))
    boxes = numbers(r'data-box="([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+)"', text)
    (left, top, wide, tall), (left2, top2, wide2, tall2) = boxes
    assert (left, wide, tall) == (left2, wide2, tall2)
    assert top2 > top + tall
    assert top2 + tall2 < 300.0
    paths = re.findall(r'd="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)"', text)
    a, b, c, d = map(float, paths[0])
    assert (a, c) == (pytest.approx(left, abs=0.06), pytest.approx(left + wide, abs=0.06))
    assert (b, d) == (
        pytest.approx(top + 0.75 * tall, abs=0.01),
        pytest.approx(top + 0.25 * tall, abs=0.01),
    )
    a, b, c, d = map(float, paths[1])
    assert (b, d) == (
        pytest.approx(top2 + tall2, abs=0.01),
        pytest.approx(top2 + 0.5 * tall2, abs=0.01),
    )
    assert text.count('stroke-dasharray="5 3"') >= 1
    (span,) = numbers(
        r'<rect x="([\d.]+)" y="([\d.]+)" width="([\d.]+)" height="([\d.]+)" fill="#333"', text
    )
    assert span == pytest.approx([left + 0.2 * wide, top2, 0.2 * wide, tall2], abs=0.02)


def test_bars_and_filled_curves_reach_down_to_the_axis() -> None:
    x, y = np.array([1.0, 2.0]), np.array([1.0, 2.0])
    bars = Plot([Curve(x, y, "#111", bars=True)], "a", y=(0.0, 4.0))
    text = str(draw([bars], "t", height=200.0, x=(0.0, 4.0)))
    ((_, top, _, tall),) = numbers(r'data-box="([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+)"', text)
    found = numbers(r"M[\d.]+ ([\d.]+)V([\d.]+)", text)
    assert [y for y, _ in found] == pytest.approx([top + 0.75 * tall, top + 0.5 * tall], abs=0.01)
    assert [end for _, end in found] == pytest.approx(2 * [top + tall], abs=0.06)
    filled = Plot([Curve(x, y, "#111", filled=True)], "a", y=(0.0, 4.0))
    text = str(draw([filled], "t", height=200.0, x=(0.0, 4.0)))
    assert re.search(rf'L[\d.]+ [\d.]+V{top + tall:.1f}H[\d.]+Z" fill="#111"', text)


def test_a_circle_is_magnified_as_its_label_says() -> None:
    """Deviations of 20 um on a radius of 0.1 m take 0.3 of it: 1500 times."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    test: Any = Stub(
        angle=angle, deviation=2e-5 * np.cos(angle), radius=0.1,
        counter_clockwise=np.ones(200, dtype=bool),
    )  # fmt: skip
    text = str(polar_plot(test))
    assert f"magnified {SHARE * 0.1 / 2e-5:.0f} times" in text
    assert re.search(r"a division is (5|10) µm, magnified", text)
    assert "counter-clockwise" in text
    assert text.count("clockwise") == 1
    test.counter_clockwise = ~test.counter_clockwise
    assert "counter-clockwise" not in str(polar_plot(test))
