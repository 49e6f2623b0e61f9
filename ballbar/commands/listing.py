"""The list of all commands. The module of a command is imported when the command is called.

Importing all modules takes more than a second, and `--help`, `--version` and completion need none
of them: what a command is for is read from its docstring in the source.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from ballbar.cell.foreign_text import printable
from ballbar.commands.options import purpose
from ballbar.terminal import INTERRUPTED, say_interrupted

AT_THE_CELL, RESULT, TEST_BENCH = "At the cell", "With the result", "Test bench"  # panels of --help

# Modules of the commands, in the order of a day at the cell; the test bench last. The function of a
# command, or the callback of a group, has its name.
COMMANDS = {
    AT_THE_CELL: {
        "robot": "robots",
        "camera": "camera",
        "plan": "planning",
        "record": "live",
        "watch": "live",
        "new": "recordings",
        "check": "recordings",
        "align": "recordings",
        "identify": "identification",
    },
    RESULT: {
        "replay": "result",
        "compare": "comparison",
        "verify": "comparison",
        "history": "comparison",
        "performance": "comparison",
        "export": "result",
        "correct": "result",
        "certificate": "certificate",
    },
    TEST_BENCH: {
        "list": "shipped",
        "init": "shipped",
        "run": "bench",
        "simulate": "bench",
        "rehearse": "bench",
        "sweep": "bench",
        "claims": "bench",
        "identifiability": "identifiability",
        "schema": "shipped",
    },
}
MODULES = {name: module for modules in COMMANDS.values() for name, module in modules.items()}


class ListedCommands(TyperGroup):
    """All commands. Each takes --quiet and --verbose, before its name or after it."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for panel, modules in COMMANDS.items():
            for name in modules:
                self.add_command(TyperCommand(name, rich_help_panel=panel))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command as it is listed: name, panel and help text, without options."""
        command = super().get_command(ctx, cmd_name)
        if command is not None:
            command.help = _purposes(MODULES[cmd_name])[cmd_name]
        return command

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Name, command and remaining words of a call; imports the module of the command."""
        name, _, words = super().resolve_command(ctx, args)
        return name, name and self.imported(name), words

    def imported(self, name: str) -> Any:
        """The command, from its module."""
        app = typer.Typer(add_completion=False, rich_markup_mode=self.rich_markup_mode)
        app.add_typer(import_module(f"ballbar.commands.{MODULES[name]}").commands)
        group: Any = typer.main.get_command(app)
        shared = [option for option in self.params if option.name in ("quiet", "verbose")]
        command = group.commands[name]
        for member in getattr(command, "commands", {"": command}).values():
            member.params += shared
        return command

    def invoke(self, ctx: Any) -> Any:
        """Runs a command; exits with INTERRUPTED after Ctrl-C."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say_interrupted()
            raise typer.Exit(INTERRUPTED) from None
        except Exception as error:
            if isinstance(message := getattr(error, "message", None), str):  # of wrong usage
                error.message = printable(message)  # type: ignore[attr-defined]
            raise


@cache
def _purposes(module: str) -> dict[str, str]:
    """Purposes of the functions of a module of commands, by name; the module is not imported."""
    source = Path(__file__).with_name(f"{module}.py").read_text(encoding="utf-8")
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    return {function.name: purpose(ast.get_docstring(function) or "") for function in functions}
