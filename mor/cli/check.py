"""``mor check``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command(name="check")
@click.argument("project", type=click.Path(path_type=Path))
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
def command(project: Path, quiet: bool) -> None:
    """Read and check PROJECT, say what was found, adjust nothing.

    \b
    Example:
      mor check project.yaml
    """
    from mor.pipeline import read_document, read_network
    from mor.report.contents import contents

    document = read_document(project)
    network = read_network(document, project.parent)
    if not quiet:
        for note in network.notes:
            click.echo(f"note: {note}", err=True)
        click.echo(contents(network))
