"""``mor check``."""

from __future__ import annotations

from pathlib import Path

import click

from mor.cli.console import language_of_command, tell_note, told_problem
from mor.cli.options import InputPath, format_option, only_project, quiet_option
from mor.errors import ExitCode, InputError, escaped, screenful


@click.command(name="check")
@click.argument("project", type=InputPath())
@click.option("-a", "--all", "everything", is_flag=True, help="List all mistakes and notes, not only the first twenty.")
@format_option
@quiet_option
def command(project: Path, everything: bool, source_format: str | None, quiet: bool) -> int:
    """Read and check PROJECT and list its contents, without adjusting it.

    \b
    Examples:
      mor check project.yaml
      mor check project.yaml --quiet && echo "fine"
      mor check project.yaml --all
      mor check - < project.yaml

    All mistakes are reported in one run, with file and line; the terminal shows the first twenty.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.api.project import read
    from mor.report.language import words_of
    from mor.report.summary import contents

    project = only_project(project, source_format)
    try:
        found = read(project, form=source_format or "")
    except InputError as error:
        if not everything:
            raise
        click.echo("\n".join(map(told_problem, error.problems)), err=True)
        return error.exit_code
    if not quiet:
        notes = found.network.notes
        for note in notes if everything else screenful(notes, "mor check --all"):
            tell_note(note)
        click.echo(escaped(contents(found.network, words_of(language_of_command()))))
    return ExitCode.DONE
