"""``--help`` and mistakes of the command line in the language that was asked for."""

from __future__ import annotations

import re
from collections.abc import Iterable

import click

from mor.cli._language import LANGUAGES, add_language, told

_EXTRA = re.compile(r"^(.*?)(?:  \[(.*)\])?$", re.DOTALL)
"""Help of an option, and what click adds to it in brackets."""
_SYMBOLS = ("[OPTIONS]", "COMMAND [ARGS]...")


class HelpFormatter(click.HelpFormatter):
    """Headings, paragraphs and options in the language of the command."""

    def __init__(self, language: str, width: int | None, max_width: int | None):
        super().__init__(width=width, max_width=max_width)
        self._language = language

    def _told(self, text: str) -> str:
        return told(text, self._language)

    def write_usage(self, prog: str, args: str = "", prefix: str | None = None) -> None:
        for symbol in _SYMBOLS:
            args = args.replace(symbol, self._told(symbol))
        super().write_usage(prog, args, f"{self._told('Usage:')} " if prefix is None else prefix)

    def write_heading(self, heading: str) -> None:
        super().write_heading(self._told(heading))

    def write_text(self, text: str) -> None:
        super().write_text("\n\n".join(self._paragraph(part) for part in text.split("\n\n")))

    def write_dl(self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2) -> None:
        super().write_dl([(name, self._entry(text)) for name, text in rows], col_max, col_spacing)

    def _paragraph(self, text: str) -> str:
        """A paragraph; one that click is to leave as it is (\\b) has examples, or exit codes, which may be wrapped."""
        lines = text.split("\n")
        if lines[0] == "\b" and lines[1] == "Examples:":
            return "\n".join([lines[0], self._told(lines[1]), *lines[2:]])
        return self._told(" ".join(line for line in lines if line != "\b"))

    def _entry(self, text: str) -> str:
        """Help of an option: its sentence, and its default."""
        match = _EXTRA.match(text)
        if match is None or not match[2]:
            return self._told(text)
        extra = "; ".join(self._told(part) for part in match[2].split("; "))
        return f"{self._told(match[1])}  [{extra}]"


class Context(click.Context):
    """The context of every command: its help is written in the language of the command."""

    def make_formatter(self) -> click.HelpFormatter:
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
        add_language(command)
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
