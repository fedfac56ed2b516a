"""``mor explain``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from mor.cli.console import language_option

if TYPE_CHECKING:
    from mor.report.language import Term


@click.command(name="explain")
@click.argument("term", nargs=-1)
@language_option("the explanation")
def command(term: tuple[str, ...], lang: str) -> None:
    """Explain TERM, a statistic, a column or an exit code, and what to do about it.

    \b
    Examples:
      mor explain w
      mor explain nabla
      mor explain exit code 4
      mor explain Redundanzanteil --lang de

    Without TERM, all terms are listed. English and German names are found.

    \b
    Exit codes: 0 done; 2 unknown term.
    """
    from mor.report.language import find, terms

    if not term:
        for entry in terms(lang):
            click.echo(_title(entry, lang))
        return
    click.echo("\n\n".join(_explained(entry, lang) for entry in find(" ".join(term), lang)))


def _title(term: Term, lang: str) -> str:
    names = ", ".join(term.names)
    return f"{names} (German: {term.german})" if lang == "en" else f"{term.german}: {names}"


def _explained(term: Term, lang: str) -> str:
    import textwrap

    todo = "What to do" if lang == "en" else "Was zu tun ist"
    width = 100
    lines = [_title(term, lang), textwrap.fill(term.text, width)]
    lines += [textwrap.fill(f"{todo}: {term.advice}", width)] if term.advice else []
    return "\n".join(lines)
