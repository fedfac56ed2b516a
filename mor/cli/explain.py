"""``mor explain``."""

from __future__ import annotations

import click

_WIDTH = 100


@click.command(name="explain")
@click.argument("term", nargs=-1)
def command(term: tuple[str, ...]) -> None:
    """Say what TERM means: a statistic, a column, an exit code; and what to do.

    \b
    Examples:
      mor explain w
      mor explain nabla
      mor explain exit code 4
      mor explain Redundanzanteil

    Without TERM all are listed. Names are found in English and in German.

    \b
    Exit codes: 0 done; 2 unknown term.
    """
    import textwrap

    from mor.report.words.terms import find, terms

    if not term:
        for entry in terms():
            click.echo(f"{', '.join(entry.names)} ({entry.german})")
        return
    parts = []
    for entry in find(" ".join(term)):
        lines = [f"{', '.join(entry.names)} (German: {entry.german})", textwrap.fill(entry.text, _WIDTH)]
        lines += [textwrap.fill(f"What to do: {entry.advice}", _WIDTH)] if entry.advice else []
        parts.append("\n".join(lines))
    click.echo("\n\n".join(parts))
