"""The command line, called in this process, and its commands."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from typing import Any

import pytest
import typer

from ballbar.commands import cli


def ballbar(*words: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of one command."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["ballbar", *map(str, words)])
        patch.setenv("COLUMNS", "400")
        try:
            cli.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    return code, out.getvalue(), err.getvalue()


def output(*words: object) -> str:
    """Standard output of a command that succeeds."""
    code, out, err = ballbar(*words)
    assert code == 0, err
    return out


def refusal(*words: object) -> str:
    """Standard error of a command that is refused as bad input."""
    code, _, err = ballbar(*words)
    assert code == 2, err
    return err


@cache
def application() -> Any:
    """The command line as typer builds it."""
    return typer.main.get_command(cli.app)


@cache
def commands() -> dict[str, Any]:
    """All commands from their modules, by the words that call them."""
    group = application()
    members = {name: group.imported(name) for name in group.commands}
    return {
        f"{name} {inner}".strip(): command
        for name, member in members.items()
        for inner, command in getattr(member, "commands", {"": member}).items()
    }


SHORT = """name: short
cell: {robot: irb2400, ballbar: lund_600, ballbar_position_m: [0.70, 0.0, 0.54]}
path: {kind: lissajous, file: PATHS/irb2400_a.yaml, duration_s: 40, dwell_s: 2, stops: 0}
plant: {kind: kinematic}
errors:
  static: {table: thesis_3_1}
  joint_noise: {sigma_rad: 1.0e-5}
encoders: {fitted: [1, 2, 4, 5], noise_sigma_rad: 1e-5}
clocks: {offset_s: -3.0, skew: 5.0e-5}
identify: {samples: 300}
accept: {tcp_mean_mm: 0.05}
seed: 3
"""
