"""``mor schema``."""

from __future__ import annotations

import click


@click.command(name="schema")
@click.argument("what", metavar="[project|results]", type=click.Choice(["project", "results"]), default="project")
def command(what: str) -> None:
    """Print the JSON Schema of project files (for editors), or of results.json (for programs).

    \b
    Examples:
      mor schema > mor.schema.json
      mor schema results > mor-results.schema.json

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.project.schema import project_schema
    from mor.report.schema import results_schema

    click.echo(results_schema() if what == "results" else project_schema(), nl=False)
