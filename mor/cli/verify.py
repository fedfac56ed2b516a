"""``mor verify``."""

from __future__ import annotations

from pathlib import Path

import click

from mor.cli.console import language_option
from mor.cli.options import force_option, output_option, quiet_option
from mor.errors import ExitCode


@click.command(name="verify")
@output_option("Folder for the full report: text, page and JSON.")
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@language_option("the page and the messages")
@quiet_option
def command(output: Path | None, force: bool, as_json: bool, lang: str, quiet: bool) -> int:
    """Check that this installation computes correctly, and write a report.

    \b
    Examples:
      mor verify
      mor verify -o verification
      mor verify --json | jq .failed

    The checks compare numbers that this installation computes with reference values: NIST's data sets of linear
    regression, networks of textbooks and of other programs, blocks of images, closed forms, threads, processes, and a
    simulation. The report names the source, the reference value, the value found, the difference and its limit, and
    the program, the libraries and the machine. It takes about half a minute.

    \b
    Exit codes: 0 all checks passed; 1 a check failed; 2 input.
    """
    from mor.api.verification import tasks, verify
    from mor.cli.progress import progress
    from mor.output_files import check_folder, write_among
    from mor.report.language import words_of
    from mor.report.output_folder import to_json
    from mor.report.verification import verification_data, verification_page, verification_text

    words = words_of(lang, "planning")
    files = ("verification.txt", "verification.html", "verification.json")
    if output is not None:
        check_folder(output, force, files)
    with progress(quiet, False, words=words) as say:
        data = verification_data(verify(say.phase("verifying", len(tasks()))))
    if output is not None:
        contents = verification_text(data, words), verification_page(data, words), to_json(data)
        write_among(output, dict(zip(files, contents, strict=True)))
    if as_json:
        click.echo(to_json(data), nl=False)
    elif not quiet:
        click.echo(verification_text(data, words, everything=False), nl=False)
    if output is not None and not quiet:
        click.echo(words("report in {place}", place=output), err=True)
    return ExitCode.REJECTED if data["failed"] else ExitCode.DONE
