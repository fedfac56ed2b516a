"""``mor check``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="check")
@click.argument("project", type=click.Path(path_type=Path))
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
def command(project: Path, quiet: bool) -> None:
    """Read and check PROJECT, say what it contains, adjust nothing.

    \b
    Examples:
      mor check project.yaml
      mor check project.yaml --quiet && echo "fine"

    All mistakes are told at once, with file and line.

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.api.project import read

    found = read(project)
    if not quiet:
        for note in found.notes:
            click.echo(f"note: {note}", err=True)
        click.echo(str(found))
