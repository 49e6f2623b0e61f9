"""The command `ballbar certificate`: a document that a quality system files."""

from __future__ import annotations

from pathlib import Path

import typer
from rich.markup import escape

from ballbar.cell.errors import InputError
from ballbar.certificate.words import Locale
from ballbar.commands.options import command
from ballbar.terminal import out, progress_bar

commands = typer.Typer()


@command(commands)
def certificate(
    result: Path | None = None,
    *,
    details: Path | None = None,
    file: Path | None = None,
    locale: Locale = "en",
    template: bool = False,
    check: Path | None = None,
    inputs: Path | None = None,
) -> None:
    """Write the certificate of a calibration as PDF and HTML, or check that one still holds.

    The result is computed again from its recordings before anything is written. A check does the
    same, compares files, numbers and text, and exits with 1 when something does not hold.

    Example: `ballbar certificate runs/irb2400 --details job.yaml`, or `ballbar certificate --check
    certificate.pdf`

    RESULT : A calibration.yaml, or the folder that holds it.
    --details FILE : What no recording shows, such as serial numbers; see --template.
    --out PLACE : Folder for certificate.pdf and certificate.html (default: that of the details), or
        one file of either kind.
    --locale : Language.
    --template : Print a file for --details to fill in.
    --check FILE : Certificate to be checked.
    --inputs FOLDER : Where its input files lie, if not where they were.
    """
    from ballbar.certificate.details import TEMPLATE

    if template:
        typer.echo(TEMPLATE.read_text("utf-8"), nl=False)
    elif check is not None:
        _check(check, inputs)
    elif result is None or details is None:
        raise InputError(
            "name a RESULT and its --details FILE (ballbar certificate --template prints one), or "
            "--check FILE."
        )
    else:
        _write(result, details, file, locale)


def _write(result: Path, details: Path, place: Path | None, locale: Locale) -> None:
    from ballbar.cell.files import name_from, write_new_together
    from ballbar.certificate.check import KINDS, certificate_file
    from ballbar.certificate.content import certificate_content
    from ballbar.ident.options import Listener

    place = place or details.parent
    files = (
        [place]
        if place.suffix.lower() in KINDS
        else [place / f"certificate{kind}" for kind in KINDS]
    )
    with progress_bar() as progress:
        content, base = certificate_content(
            result, details, locale=locale, listener=Listener(progress)
        )
    content["base"] = name_from(files[0].parent, base)
    write_new_together({each: certificate_file(content, each.suffix.lower()) for each in files})
    for each in files:
        out.print(f"Wrote {escape(str(each))}")
    for error in content["errors"]:
        if (limit := error["tolerance_mm"]) is not None:
            what = f"{error['robot']} robot, {error['quantity']} TCP error against {limit:g} mm"
            out.print(f"{what}: {error['verdict']}")


def _check(file: Path, inputs: Path | None) -> None:
    from ballbar.certificate.check import check_certificate, content_of
    from ballbar.code_version import code_version
    from ballbar.ident.options import Listener

    with progress_bar() as progress:
        problems = check_certificate(file, inputs, listener=Listener(progress))
    for problem in problems:
        out.print(f"[bold red]does not hold:[/] {escape(problem)}")
    if not problems:
        out.print("[bold green]holds:[/] its files, its numbers computed again, and its text")
        if (program := content_of(file)[0]["program"]) != code_version():
            out.print(f"It names the program {escape(program)}; this is {code_version()}.")
    raise typer.Exit(1 if problems else 0)
