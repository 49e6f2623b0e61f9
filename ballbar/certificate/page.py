"""The blocks of a certificate, the same for HTML and PDF, in the words of its locale."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ballbar.certificate.words import Words

Pair = tuple[str, str | None]  # label and value; None is printed as missing


@dataclass(frozen=True)
class Block:
    """A part of the page: a heading, then pairs, a table, and paragraphs."""

    heading: str
    pairs: tuple[Pair, ...] = ()
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    texts: tuple[str, ...] = ()
    half: bool = False  # beside the next or the one before
    widths: tuple[float, ...] = ()  # of the columns, in shares
    verdicts: tuple[str, ...] = ()  # of each row: good, bad or open
    small: bool = False
    signed: bool = False


@dataclass(frozen=True)
class Page:
    """A certificate as it is printed."""

    words: Words
    title: str
    subtitle: str
    warning: str
    number: str | None
    head: tuple[Pair, ...]
    blocks: tuple[Block, ...]
    digest: str
    program: str


def page_of(content: dict[str, Any], digest: str) -> Page:
    """The printed page of a certificate's content; digest : of that content."""
    w, details = Words(content["locale"]), content["details"]
    head = tuple((w(key), details[key]) for key in ("number", "laboratory", "customer", "issued"))
    return Page(
        words=w,
        title=w("title"),
        subtitle=w("subtitle"),
        warning=w("simulated") if content["simulated"] else "",
        number=details["number"],
        head=head,
        blocks=tuple(_blocks(w, content, digest)),
        digest=digest,
        program=content["program"],
    )


def _blocks(w: Words, content: dict[str, Any], digest: str) -> Iterator[Block]:
    details, described = content["details"], content["described"]
    yield Block(w("robot"), _identity(w, details["robot"], described["robot"], _ROBOT), half=True)
    yield Block(w("measurement"), tuple(_measurement(w, content)), half=True)
    for key in ("instrument", "plate"):
        stated = _identity(w, details[key], described[key], _STANDARD)
        yield Block(w(key), stated, half=True)
    yield _results(w, content)
    yield _conformity(w, content)
    yield Block(w("workspace"), tuple(_workspace(w, content)))
    remarks = ((w("remarks"), remark) for remark in details["remarks"] or [None])
    pairs = ((w("traceability"), details["traceability"]), *remarks)
    yield Block(w("traceability"), pairs, signed=True)
    yield _inputs(w, content, digest)


_ROBOT = ("maker", "type", "serial_number", "controller", "controller_serial_number", "software")
_STANDARD = (
    *("maker", "type", "serial_number"),
    *("calibrated", "calibrated_by", "certificate", "uncertainty"),
)


def _identity(
    w: Words, stated: dict[str, str | None] | None, described: str, keys: tuple[str, ...]
) -> tuple[Pair, ...]:
    """What the details state, then the description that the computation used."""
    own = tuple((w(key), (stated or {}).get(key)) for key in keys)
    return (*own, (w("description"), described or "\u2013"))


def _measurement(w: Words, content: dict[str, Any]) -> Iterator[Pair]:
    details, measured = content["details"], content["measurement"]
    for key in ("operator", "place", "measured"):
        yield w(key), details[key]
    for label, key in (("temperature", "mean"), ("temperature_spread", "spread")):
        value = measured["temperature_C"][key]
        unit = "\u00b0C" if key == "mean" else "K"
        yield w(label), None if value is None else f"{w.plain(value)} {unit}"
    load = details["load_kg"]
    mass = [] if load is None else [f"{w.plain(load)} kg"]
    yield w("load"), ", ".join(filter(None, (*mass, details["load"]))) or None
    yield w("recordings"), ", ".join(measured["fitted"])
    if measured["held_out"]:
        yield w("held_out"), ", ".join(measured["held_out"])
    parts = []
    if measured["samples"]:
        seconds = w.number(measured["seconds"], 0)
        parts.append(w("moving", seconds=seconds, samples=str(measured["samples"])))
    if measured["poses"]:
        parts.append(w("still", poses=str(measured["poses"])))
    yield w("extent"), ", ".join(parts)


def _results(w: Words, content: dict[str, Any]) -> Block:
    rows = [
        (
            f"{w(error['robot'])}, {w(error['quantity'])}",
            w.millimetres(error["value_m"], error["sigma_m"]),
            w.millimetres(error["sigma_m"], error["sigma_m"]),
            _interval(w, error),
        )
        for error in content["errors"]
    ]
    percent = w.percent(content["coverage"])
    head = (w("tcp_error"), w("value"), w("standard_uncertainty"), w("interval", percent=percent))
    result = content["result"]
    sigma, without = result["tcp_sigma_m"], result["tcp_sigma_without_scale_m"]
    stated, less = (w.millimetres(s, s).removesuffix("\u00a0mm") for s in (sigma, without))
    pairs: tuple[Pair, ...] = (
        (w("fit_status"), w(result["status"])),
        (w("unknowns"), str(result["unknowns"])),
        (w("stated"), w("with_scale", sigma=stated, without=less)),
    )
    poses, draws = str(content["workspace"]["poses"]), str(content["draws"])
    texts = (w("method", poses=poses, draws=draws),)
    return Block(w("results"), pairs, head, tuple(rows), texts, widths=(0.4, 0.15, 0.21, 0.24))


def _interval(w: Words, error: dict[str, Any]) -> str:
    ends = (w.millimetres(error[key], error["sigma_m"]) for key in ("lower_m", "upper_m"))
    return w("range", low=next(ends).removesuffix("\u00a0mm"), high=next(ends))


def _conformity(w: Words, content: dict[str, Any]) -> Block:
    rule, decisions = content["rule"], content["conformity"]
    if rule is None:
        return Block(w("conformity"), texts=(w("no_tolerance"),))
    percent = w.percent
    named = {
        "simple": lambda: w("simple", risk=percent(rule["risk"])),
        "guarded": lambda: w(
            "guarded",
            risk=percent(rule["risk"]),
            guard=w.plain(rule["guard_factor"]),
            k=w.plain(rule["coverage_factor"]),
        ),
        "probability": lambda: w(
            "by_probability", risk=percent(rule["risk"]), probability=percent(rule["probability"])
        ),
    }[rule["name"]]()
    if not content["result"]["acceptable"]:
        return Block(w("conformity"), texts=(w("no_statement"), named))
    rows = tuple(
        (
            f"{w(d['robot'])}, {w(d['quantity'])}",
            f"{w.plain(d['tolerance_mm'])} mm",
            _probability(w, d["probability"], content["draws"]),
            w(d["verdict"]),
        )
        for d in decisions
    )
    head = (w("tcp_error"), w("tolerance"), w("probability"), w("statement"))
    classes = {"conforms": "good", "does not conform": "bad", "neither": "open"}
    return Block(
        w("conformity"),
        head=head,
        rows=rows,
        texts=(named,),
        widths=(0.4, 0.15, 0.23, 0.22),
        verdicts=tuple(classes[d["verdict"]] for d in decisions),
    )


def _probability(w: Words, probability: float, draws: int) -> str:
    """In percent; what no draw shows is stated as a limit."""
    least = 10.0 / draws
    if probability > 1.0 - least:
        return w("above", percent=w.percent(1.0 - least))
    if probability < least:
        return w("below", percent=w.percent(least))
    return f"{w.percent(probability)} %"


def _workspace(w: Words, content: dict[str, Any]) -> Iterator[Pair]:
    space = content["workspace"]
    yield w("volume"), "; ".join(w.range(*ends) for ends in space["box_mm"]) + " mm"
    angles = "; ".join(w.range(*ends) for ends in space["joints_deg"])
    yield w("joints", count=str(len(space["joints_deg"]))), f"{angles}\u00b0"
    grown = [
        f"{g['name']}: {w.millimetres(g['value_m'], g['sigma_m'])} "
        f"(u = {w.millimetres(g['sigma_m'], g['sigma_m'])})"
        for g in content["growth"]
    ]
    yield w("growth"), "; ".join(grown) or w("no_growth")


def _inputs(w: Words, content: dict[str, Any], digest: str) -> Block:
    rows = tuple((f["name"], str(f["size"]), f["sha256"]) for f in content["files"])
    return Block(
        w("inputs"),
        pairs=(
            (w("program"), f"ballbar-bench {content['program']}"),
            (w("content_digest"), digest),
        ),
        head=(w("file"), w("bytes"), w("digest")),
        rows=rows,
        texts=(w("checked").replace("`", ""),),
        widths=(0.31, 0.11, 0.58),
        small=True,
    )
