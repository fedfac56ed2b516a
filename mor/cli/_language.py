"""The language of what people read: ``--lang`` of any command, or ``MOR_LANG`` for all of them; English otherwise."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from mor.errors import Problem

LANGUAGES = ("en", "de")
"""As :data:`mor.report.words.language.LANGUAGES`, which ``--help`` need not import."""
VARIABLE = "MOR_LANG"
_OPTION = "--lang"


def language_option(what: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``--lang`` of a command, with what it is the language of."""
    return click.option(_OPTION, **_settings(what))


def add_language(command: click.Command) -> None:
    """``--lang`` for a command that writes nothing in a language: for its mistakes, notes and help alone."""
    if not any(_OPTION in parameter.opts for parameter in command.params):
        what = "what the terminal says"
        command.params.append(click.Option([_OPTION], expose_value=False, **_settings(what)))


def _settings(what: str) -> dict[str, Any]:
    return {
        "type": click.Choice(LANGUAGES),
        "default": "en",
        "envvar": VARIABLE,
        "show_default": f"{VARIABLE}, or en",
        "help": f"Language of {what}.",
    }


def language_of(arguments: Sequence[str]) -> str:
    """The language that a command line asks for, before it is understood: its mistakes are told in it, too."""
    asked = [value for name, value in pairwise(arguments) if name == _OPTION]
    asked += [text.removeprefix(f"{_OPTION}=") for text in arguments if text.startswith(f"{_OPTION}=")]
    found = asked[-1] if asked else os.environ.get(VARIABLE, "")
    return found if found in LANGUAGES else LANGUAGES[0]


def language_of_command() -> str:
    """The language of the command that runs."""
    context = click.get_current_context(silent=True)
    return (context.find_root().obj if context else None) or LANGUAGES[0]


def told(text: str, language: str = "") -> str:
    """A finished sentence in a language, or in that of the command that runs."""
    language = language or language_of_command()
    if language == LANGUAGES[0]:
        return text
    from mor.report.words.language import words_of

    return words_of(language).told(text)


def tell(text: str, language: str = "") -> None:
    """Say a sentence on standard error, in the language of the command."""
    click.echo(told(text, language), err=True)


def told_problem(problem: Problem, language: str = "") -> str:
    """A mistake or a note with its place, which is the same in every language."""
    return str(problem._replace(message=told(problem.message, language)))


def tell_note(note: Problem) -> None:
    """Say what was left out or decided on its own."""
    click.echo(told("note: {}").replace("{}", told_problem(note)), err=True)
