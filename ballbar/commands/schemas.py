"""The command `ballbar schema`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from ballbar.terminal import out

commands = typer.Typer()


@commands.command(epilog="Example: `ballbar schema --out schemas`")
def schema(
    folder: Annotated[
        Path, typer.Option("--out", help="Folder for the schemas; it must hold nothing else.")
    ] = Path("schemas"),
) -> None:
    """Write the JSON schema of every kind of YAML file, for editors.

    Writes KIND.schema.json to DIR for scenarios, sweeps, requests, recordings, robots and all other
    files. A first line `# yaml-language-server: $schema=schemas/scenario.schema.json` in a file
    makes the editor complete its keys, show what they mean and mark what is wrong.
    """
    import json

    from ballbar.json_schemas import KINDS, json_schema
    from cell.files import claimed_folder, write_whole

    files = {f"{kind}.schema.json": json_schema(kind) for kind in KINDS}
    with claimed_folder(folder, set(files), "the schemas"):
        for name, content in files.items():
            write_whole(folder / name, f"{json.dumps(content, indent=2)}\n".encode())
    out.print(f"{len(files)} schemas in {escape(str(folder))}: {', '.join(KINDS)}")
