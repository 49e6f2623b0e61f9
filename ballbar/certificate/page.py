"""The panels of a certificate, the same for HTML and PDF, in the words of its locale."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ballbar.certificate.words import Words
from ballbar.units import MM, PPM

_MARKS = {"conforms": "good", "does not conform": "bad", "neither": "open"}


@dataclass(frozen=True)
class Row:
    """Cells beside each other: a label and its value, or a row of a table."""

    cells: tuple[str, ...]
    widths: tuple[float, ...]  # shares of the panel's width
    mark: str = ""  # of the last cell: missing, good, bad, open
    ruled: bool = False  # a table's: a line below, and all cells but the first to their right
    head: bool = False


@dataclass(frozen=True)
class Panel:
    """A part of the page: a heading, labelled values, a table, and paragraphs."""

    heading: str
    pairs: tuple[Row, ...] = ()
    table: tuple[Row, ...] = ()
    texts: tuple[str, ...] = ()
    half: bool = False  # of the page's width, beside the next one
    small: bool = False
    signed: bool = False


@dataclass(frozen=True)
class Page:
    """A certificate as it is printed."""

    words: Words
    title: str
    subtitle: str
    title_and_number: str
    warning: str
    head: tuple[Row, ...]
    panels: tuple[Panel, ...]
    digest: str


def page_of(content: dict[str, Any], digest: str) -> Page:
    """The printed page of a certificate's content; digest : of that content."""
    w, details = Words(content["locale"]), content["details"]
    head = {w(key): details[key] for key in ("number", "laboratory", "customer", "issued")}
    return Page(
        words=w,
        title=w("title"),
        subtitle=w("subtitle"),
        title_and_number=" ".join(filter(None, (w("title"), details["number"]))),
        warning=w("simulated") if content["simulated"] else "",
        head=_pairs(w, head, 0.4),
        panels=(
            _described(w, content, "robot"),
            Panel(w("measurement"), _pairs(w, dict(_measurement(w, content)), 0.4), half=True),
            *(_described(w, content, key) for key in ("instrument", "plate")),
            _results(w, content),
            _conformity(w, content),
            Panel(w("workspace"), _pairs(w, _workspace(w, content))),
            *_performance(w, content["performance"]),
            *_budget(w, content["budget"]),
            _remarks(w, details),
            _inputs(w, content, digest),
        ),
        digest=digest,
    )


def _pairs(w: Words, values: Mapping[str, str | None], share: float = 0.3) -> tuple[Row, ...]:
    """Labels and values; what is None is missing."""
    return tuple(
        Row((label, value or w("missing")), (share, 1.0 - share), "" if value else "missing")
        for label, value in values.items()
    )


def _table(
    head: Sequence[str], rows: Sequence[Sequence[str]], widths: tuple[float, ...], *marks: str
) -> tuple[Row, ...]:
    """A table with a mark of each row, or none."""
    marked = zip(rows, marks or [""] * len(rows), strict=True)
    body = (Row(tuple(row), widths, mark, ruled=True) for row, mark in marked)
    return (Row(tuple(head), widths, ruled=True, head=True), *body)


def _described(w: Words, content: dict[str, Any], key: str) -> Panel:
    """Details of robot, instrument or plate, then the description that the computation used."""
    stated = {w(name): value for name, value in content["details"][key].items()}
    described = content["described"][key] or "\u2013"
    return Panel(w(key), _pairs(w, stated | {w("description"): described}, 0.4), half=True)


def _measurement(w: Words, content: dict[str, Any]) -> Iterator[tuple[str, str | None]]:
    details, measured = content["details"], content["measurement"]
    yield from ((w(key), details[key]) for key in ("operator", "place", "measured"))
    yield w("temperature"), w.measured(measured["temperature_C"], "\u00b0C")
    yield w("temperature_spread"), w.measured(measured["temperature_spread_C"], "K")
    if (factor := measured["factor_to_20_C"]) is not None:
        per_kelvin = w.number(measured["robot_expansion_per_K"] * PPM, 1)
        yield w("factor"), f"{w.number(factor, 6)} ({per_kelvin}\u00a0\u00b5m/(m\u00a0K))"
    load = w.measured(details["load_kg"], "kg"), details["load"]
    yield w("load"), ", ".join(filter(None, load)) or None
    yield w("recordings"), ", ".join(measured["fitted"])
    if measured["held_out"]:
        yield w("held_out"), ", ".join(measured["held_out"])
    extent = {key: w.number(measured[key], 0) for key in ("seconds", "samples", "poses")}
    kinds = [kind for kind, n in (("moving", "samples"), ("still", "poses")) if measured[n]]
    yield w("extent"), ", ".join(w(kind, **extent) for kind in kinds)


def _results(w: Words, content: dict[str, Any]) -> Panel:
    result, errors = content["result"], content["errors"]
    sigmas = result["tcp_sigma"], result["tcp_sigma_without_scale"]
    stated, without = (w.millimetres(sigma, sigma) for sigma in sigmas)
    rows = [
        (
            f"{w(e['robot'])}, {w(e['quantity'])}",
            *(w.millimetres(e[key], e["sigma"]) for key in ("value", "sigma")),
            w("range", low=w.length(e["lower"], e["sigma"]), high=w.length(e["upper"], e["sigma"]))
            + "\u00a0mm",
        )
        for e in errors
    ]
    interval = w("interval", percent=w.percent(content["rule"]["coverage"]))
    head = w("tcp_error"), w("value"), w("standard_uncertainty"), interval
    quality = w(result["status"] if result["held_out_explained"] else "held_out_failed")
    pairs = {
        w("fit_status"): quality,
        w("unknowns"): str(result["unknowns"]),
        w("stated"): w("with_scale", sigma=stated, without=without),
    }
    method = w("method", poses=str(content["poses"]), draws=str(content["draws"]))
    table = _table(head, rows, (0.4, 0.15, 0.21, 0.24))
    return Panel(w("results"), _pairs(w, pairs), table, (method,))


def _conformity(w: Words, content: dict[str, Any]) -> Panel:
    rule = content["rule"]
    decided = [error for error in content["errors"] if error["tolerance_mm"] is not None]
    if not decided:
        return Panel(w("conformity"), texts=(w("no_tolerance"),))
    values = {key: w.percent(rule[key]) for key in ("risk", "probability")}
    factors = {"guard": w.plain(rule["guard_factor"]), "k": w.plain(rule["coverage_factor"])}
    named = w(f"rule_{rule['rule']}", **values, **factors)
    if not content["result"]["acceptable"]:
        return Panel(w("conformity"), texts=(w("no_statement"), named))
    rows = [
        (
            f"{w(e['robot'])}, {w(e['quantity'])}",
            w.measured(e["tolerance_mm"], "mm") or "",
            _probability(w, e["probability"], 10.0 / content["draws"]),
            w(e["verdict"]),
        )
        for e in decided
    ]
    head = w("tcp_error"), w("tolerance"), w("probability"), w("statement")
    marks = (_MARKS[error["verdict"]] for error in decided)
    table = _table(head, rows, (0.36, 0.12, 0.29, 0.23), *marks)
    return Panel(w("conformity"), table=table, texts=(named,))


def _probability(w: Words, probability: float, least: float) -> str:
    """In percent; what hardly any draw shows is stated as a limit."""
    if least <= probability <= 1.0 - least:
        return f"{w.percent(probability)}\u00a0%"
    above = probability > 0.5
    return w("above" if above else "below", percent=w.percent(1.0 - least if above else least))


def _workspace(w: Words, content: dict[str, Any]) -> dict[str, str | None]:
    volume, joints = np.array(content["volume_m"]) * MM, np.rad2deg(content["joints_rad"])
    grown = [
        f"{g['name']}: {w.millimetres(g['value'], g['sigma'])} "
        f"(u = {w.millimetres(g['sigma'], g['sigma'])})"
        for g in content["growth"]
    ]
    return {
        w("volume"): f"{w.ranges(volume)}\u00a0mm",
        w("joints", count=str(len(joints))): f"{w.ranges(joints)}\u00b0",
        w("growth"): "; ".join(grown) or w("no_growth"),
    }


def _performance(w: Words, rows: Sequence[dict[str, Any]]) -> Iterator[Panel]:
    """Characteristics at the test poses that the identified robot predicts."""
    cells = [
        (
            " ".join((row["symbol"], "\u2013".join(row["poses"]))),
            row["clause"],
            *(w.millimetres(row[key], row["limit"]) for key in ("nominal", "identified", "limit")),
        )
        for row in rows
    ]
    head = w("characteristic"), w("clause"), w("nominal"), w("identified"), w("limit_95")
    if rows:
        table = _table(head, cells, (0.16, 0.21, 0.2, 0.23, 0.2))
        yield Panel(w("performance"), table=table, texts=(w("predicted"),))


def _budget(w: Words, budget: dict[str, Any] | None) -> Iterator[Panel]:
    """Sources of the stated TCP uncertainty."""
    if budget is None:
        return
    rows = [
        (
            *(w.source(r["name"]), r["evaluated"], w(r["distribution"])),
            *(w.millimetres(r["contribution"], r["contribution"]), w.percent(r["share"])),
        )
        for r in budget["rows"]
    ]
    rows.append((w("others"), "", "", "", w.percent(budget["others"])))
    head = w("source"), w("evaluated"), w("distribution"), w("contribution"), w("share")
    sizes = {key: w.millimetres(budget[key], budget[key]) for key in ("combined", "expanded")}
    text = w("combined", k=w.number(budget["k"], 2), **sizes)
    yield Panel(
        w("budget"), table=_table(head, rows, (0.46, 0.08, 0.15, 0.16, 0.15)), texts=(text,)
    )


def _remarks(w: Words, details: dict[str, Any]) -> Panel:
    remarks = " ".join(details["remarks"] or [])
    pairs = {w("traceability"): details["traceability"], w("remarks"): remarks}
    return Panel(w("traceability_and_remarks"), _pairs(w, pairs), signed=True)


def _inputs(w: Words, content: dict[str, Any], digest: str) -> Panel:
    rows = [(f["name"], str(f["size"]), f["sha256"]) for f in content["files"]]
    program = {w("program"): f"ballbar-bench {content['program']}", w("content_digest"): digest}
    table = _table((w("file"), w("bytes"), w("digest")), rows, (0.31, 0.11, 0.58))
    return Panel(w("inputs"), _pairs(w, program), table, (w("checked"),), small=True)
