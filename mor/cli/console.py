"""Messages and help texts on the console, in the language of the user."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from mor.errors import Message


# ---- The language of what people read: ``--lang`` of any command, or ``MOR_LANG`` for all of them; English otherwise.

LANGUAGES = ("en", "de")
"""As :data:`mor.report.language.LANGUAGES`, which ``--help`` need not import."""
VARIABLE = "MOR_LANG"
_OPTION = "--lang"


def language_option(what: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """``--lang`` of a command, with what it is the language of."""
    return click.option(_OPTION, **_settings(what))


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
    from mor.report.language import words_of

    return words_of(language).told(text)


def tell(text: str, language: str = "") -> None:
    """Say a sentence on standard error, in the language of the command."""
    click.echo(told(text, language), err=True)


def told_problem(problem: Message, language: str = "") -> str:
    """A mistake or a note with its place, which is the same in every language."""
    return str(problem._replace(message=told(problem.message, language)))


def tell_note(note: Message) -> None:
    """Say what was left out or decided on its own."""
    click.echo(told("note: {}").replace("{}", told_problem(note)), err=True)


# ---- ``--help`` and mistakes of the command line in the language that was asked for.


class HelpFormatter(click.HelpFormatter):
    """Headings, paragraphs and options in the language of the command."""

    def __init__(self, language: str, width: int | None, max_width: int | None):
        super().__init__(width=width, max_width=max_width)
        self._language = language

    def _told(self, text: str) -> str:
        return told(text, self._language)

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        """Write the usage line."""
        for symbol in ("[OPTIONS]", "COMMAND [ARGS]..."):
            args = args.replace(symbol, self._told(symbol))
        super().write_usage(prog, args, f"{self._told('Usage:')} " if prefix is None else prefix)

    def write_heading(self, heading: str) -> None:
        """Write a heading."""
        super().write_heading(self._told(heading))

    def write_text(self, text: str) -> None:
        """Write paragraphs."""
        super().write_text("\n\n".join(self._paragraph(part) for part in text.split("\n\n")))

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        """Write a list of definitions."""
        super().write_dl([(name, self._entry(text)) for name, text in rows], col_max, col_spacing)

    def _paragraph(self, text: str) -> str:
        """A paragraph; one that click is to leave as it is (\\b) has examples, or exit codes, which may be wrapped."""
        lines = text.split("\n")
        if lines[0] == "\b" and lines[1] == "Examples:":
            return "\n".join([lines[0], self._told(lines[1]), *lines[2:]])
        return self._told(" ".join(line for line in lines if line != "\b"))

    def _entry(self, text: str) -> str:
        # Help of an option, and what click adds to it in brackets.
        match = re.match(r"^(.*?)(?:  \[(.*)\])?$", text, flags=re.DOTALL)
        if match is None or not match[2]:
            return self._told(text)
        extra = "; ".join(self._told(part) for part in match[2].split("; "))
        return f"{self._told(match[1])}  [{extra}]"


class Context(click.Context):
    """The context of every command: its help is written in the language of the command."""

    def make_formatter(self) -> click.HelpFormatter:
        """Return the formatter of the language."""
        language = self.find_root().obj or LANGUAGES[0]
        if language == LANGUAGES[0]:
            return super().make_formatter()
        return HelpFormatter(language, width=self.terminal_width, max_width=self.max_content_width)


def in_all_languages(command: click.Command) -> click.Command:
    """A command, and those below it, with ``--lang`` and help in the language that it names."""
    command.context_class = Context
    if isinstance(command, click.Group):
        for below in command.commands.values():
            in_all_languages(below)
    else:
        if not any(_OPTION in parameter.opts for parameter in command.params):
            command.params.append(click.Option([_OPTION], expose_value=False, **_settings("the messages")))
    return command


def show(error: click.ClickException, language: str) -> None:
    """Print a mistake in a command line in click's own words, or in the language of the user."""
    if language == LANGUAGES[0]:
        error.show()
        return
    context = error.ctx if isinstance(error, click.UsageError) else None
    if context is not None:
        click.echo(context.get_usage(), err=True)
        click.echo(told(f"Try '{context.command_path} --help' for help.", language) + "\n", err=True)
    message = told(error.format_message(), language)
    click.echo(told("Error: {}", language).replace("{}", message), err=True)
