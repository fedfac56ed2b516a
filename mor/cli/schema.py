"""``mor schema``."""

from __future__ import annotations

import click


@click.command(name="schema")
def command() -> None:
    """Print the JSON Schema of the project file, for editors.

    \b
    Example:
      mor schema > mor.schema.json
    """
    from mor.project.schema import project_schema

    click.echo(project_schema(), nl=False)
