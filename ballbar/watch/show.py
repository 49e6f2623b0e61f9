"""Output of `ballbar watch`: a panel that is refreshed, a line for each update, or JSON.

All three show the plain data of `WatchState.to_dict`, which `ballbar record --identify` reads from
the process that watches its folder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ballbar.cell.clock import Clock
from ballbar.cell.foreign_text import printable
from ballbar.cell.number_text import clock_offset_text, clock_skew_text, significant_text
from ballbar.units import MM, URAD

Data = dict[str, Any]
Show = Callable[[Data], None]


def panel(data: Data) -> RenderableType:
    """The state of a recording as a table, alarms below it."""
    table = Table(
        title=f"{data['recorded_s']:.0f} s recorded", title_justify="left", box=None, pad_edge=False
    )
    table.add_column("")
    table.add_column("")
    for name, text in _facts(data).items():
        table.add_row(name, Text(text))
    alarms = [
        Text(f"{a['kind']} at {a['raised']:.0f} s: {a['sentence']}", style="red")
        for a in data["alarms"]
    ]
    return Group(table, *(alarms or [Text("no alarm", style="green")]))


def line(data: Data) -> str:
    """The state of a recording in one line."""
    facts = "; ".join(f"{name} {text}" for name, text in _facts(data).items() if name in _SHORT)
    alarms = "".join(f"; ALARM {a['kind']}: {a['sentence']}" for a in data["alarms"])
    return f"{data['recorded_s']:.1f} s: {facts}{alarms}"


_SHORT = ("waiting", "TCP uncertainty", "verdict", "latest rows")


def _facts(data: Data) -> dict[str, str]:
    """Facts about a recording, by the name that they are shown under."""
    if data["waiting"]:
        return {"waiting": printable(data["waiting"])}
    facts = {"TCP uncertainty": _uncertainty(data)}
    facts["verdict"] = f"{data['verdict']}, model {data['model']}"
    if data["clock_offset_s"] is not None:
        clock = Clock(data["clock_offset_s"], data["clock_skew"])
        offset, skew = data["clock_sigma"]
        shown = clock_offset_text(clock, offset), clock_skew_text(clock, skew)
        facts["clock"] = "offset {}; skew {}".format(*shown)
    axes = " ".join(f"{100 * share:.0f}" for share in data["axes_covered"])
    sphere = data["sphere_covered"]
    held = "" if sphere is None else f"sphere {100 * sphere:.0f} %; "
    facts["coverage"] = f"{held}axes {axes} %"
    facts["noise"] = " ".join(
        f"{name} {significant_text(sigma * MM, 2)} mm"
        if name == "length"
        else f"{name} {significant_text(sigma * URAD, 2)} urad"
        for name, sigma in data["noise"].items()
    )
    if data["predicted"] is not None:
        facts["latest rows"] = f"{data['predicted']:.2f} times what the fit of the others explains"
    return facts


def _uncertainty(data: Data) -> str:
    with_scale, without = data["tcp_sigma_m"], data["tcp_sigma_without_scale_m"]
    text = (
        f"{significant_text(with_scale * MM)} mm with the scale, "
        f"{significant_text(without * MM)} mm without"
    )
    if data["model"] == "poses":
        text = f"{significant_text(without * MM)} mm, without the scale of the instrument"
    if data["tcp_sigma_end_m"] is not None:
        end = significant_text(data["tcp_sigma_end_m"] * MM, 2)
        text += f", at the end about {end} mm (estimate)"
    return text + (" - enough" if data["enough"] else "")
