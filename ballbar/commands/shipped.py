"""Commands that show what is shipped, and write it: `ballbar list`, `init` and `schema`."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.markup import escape

from ballbar.commands.options import AsJson, command, say_json
from ballbar.terminal import out

commands = typer.Typer()


@command(commands)
def list(as_json: AsJson = False) -> None:  # noqa: A001  the name of the command
    """List the shipped robots, ball-bars, instruments, plates, dialects and scenarios.

    Their names are taken wherever a robot, an instrument, a plate, a dialect or a scenario is
    named. Files of your own end in .yaml.

    Example: `ballbar list`, or for programs `ballbar list --json`
    """
    from ballbar.shipped import shipped

    everything = shipped()
    if as_json:
        say_json(everything)
    for kind, titles in everything.items():
        out.print(f"[bold]{kind}[/]")
        width = max(map(len, titles))
        for name, title in titles.items():
            out.print(f"  {name:<{width}}  {escape(title)}")


@command(commands)
def init(folder: Path) -> None:
    """Copy the shipped scenarios, paths, plan requests and sweeps, to change them.

    A scenario that only runs needs no copy: `ballbar run irb2400` takes the shipped one.

    Example: `ballbar init study`, then `ballbar run study/irb2400.yaml`

    DIR : New folder for the copies.
    """
    from ballbar.shipped import copy_scenarios

    names = copy_scenarios(folder)
    place = escape(str(folder))
    out.print(f"Wrote {len(names)} scenarios and folders to {place}.")
    out.print(f"Change them, and run them: ballbar run {place}/irb2400.yaml")


@command(commands)
def schema(folder: Path = Path("schemas")) -> None:
    """Write the JSON schema of every kind of YAML file, for editors.

    Writes KIND.schema.json to DIR for scenarios, sweeps, requests, recordings, robots and all other
    files. A first line `# yaml-language-server: $schema=schemas/scenario.schema.json` in a file
    makes the editor complete its keys, show what they mean and mark what is wrong.

    Example: `ballbar schema --out schemas`

    --out : Folder for the schemas; it must hold nothing else.
    """
    import json

    from ballbar.cell.files import claimed_folder, write_whole
    from ballbar.json_schemas import KINDS, json_schema

    files = {f"{kind}.schema.json": json_schema(kind) for kind in KINDS}
    with claimed_folder(folder, set(files), "the schemas"):
        for name, content in files.items():
            write_whole(folder / name, f"{json.dumps(content, indent=2)}\n".encode())
    out.print(f"{len(files)} schemas in {escape(str(folder))}: {', '.join(KINDS)}")
