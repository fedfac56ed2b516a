"""Write the man page and the page of all commands from the commands themselves: ``python docs/write_commands.py``."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click

from mor import __version__
from mor.cli import group

DOCS = Path(__file__).parent
WIDTH = 100
NAME = "one least-squares adjustment for everything measured around an object"
FILES = (
    ("project.yaml", "the project: cameras, points, observations, datum, with tables beside it"),
    ("project.results/", "report.txt and report.html for people, results.json and tables for programs"),
)
ENVIRONMENT = (
    ("MOR_LANG", "language of reports and messages, en or de, unless --lang is given"),
    ("MOR_KERNELS", "auto, numpy or numba, unless --kernels is given"),
    ("NUMBA_CACHE_DIR", "folder for compiled kernels instead of the cache of the user"),
    ("MOR_DEBUG", "1 shows where an internal error happened"),
)

Command = tuple[click.Context, click.Command]


def all_commands() -> Iterator[Command]:
    """Every command with its context, groups before their members."""

    def below(context: click.Context, command: click.Command) -> Iterator[Command]:
        yield context, command
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                member = command.get_command(context, name)
                if member is not None:
                    yield from below(click.Context(member, info_name=name, parent=context), member)

    names = ["-h", "--help"]
    return below(click.Context(group, info_name="mor", terminal_width=WIDTH, help_option_names=names), group)


def man_page() -> str:
    """The man page mor(1) in roff."""
    first, *others = all_commands()
    parts = [f'.TH MOR 1 "" "mor {__version__}" "User Commands"', _section("NAME"), f"mor \\- {roff(NAME)}"]
    parts += [_section("SYNOPSIS"), f"{roff(_usage(first))}", _section("DESCRIPTION"), *_help(first)]
    parts += [*_options(first), _section("COMMANDS")]
    for command in others:
        parts += [f".SS {roff(_usage(command))}", *_help(command), *_options(command)]
    parts += [_section("EXIT STATUS"), *_list(_exit_codes()), _section("FILES"), *_list(FILES)]
    parts += [_section("ENVIRONMENT"), *_list(ENVIRONMENT)]
    return "\n".join(parts) + "\n"


def command_page() -> str:
    """The page of all commands: what ``--help`` says."""
    parts = [
        "# Commands",
        "The help text of each command, as printed by `--help` and `man mor`. `mor "
        "explain TERM` explains a term of a report.",
    ]
    for context, command in all_commands():
        parts += [f"## {context.command_path}", f"```text\n{command.get_help(context)}\n```"]
    return "\n\n".join(parts) + "\n"


def roff(text: str) -> str:
    """Text with what roff takes for its own escaped."""
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return re.sub(r"^([.'])", r"\\&\1", escaped, flags=re.M)


def _section(title: str) -> str:
    return f".SH {title}"


def _usage(command: Command) -> str:
    context, what = command
    return " ".join([context.command_path, *what.collect_usage_pieces(context)])


def _help(command: Command) -> list[str]:
    parts: list[str] = []
    for paragraph in inspect.cleandoc(command[1].help or "").split("\n\n"):
        lines = paragraph.split("\n")
        if lines[0] == "\b":
            parts += [".PP", ".nf", *map(roff, lines[1:]), ".fi"]
        else:
            parts += [".PP", *map(roff, lines)]
    return parts[1:] if parts[:1] == [".PP"] else parts


def _options(command: Command) -> list[str]:
    context, what = command
    options = (entry for entry in what.get_params(context) if isinstance(entry, click.Option))
    return _list([record for option in options if (record := option.get_help_record(context)) is not None])


def _list(rows: Sequence[tuple[str, str]]) -> list[str]:
    return [line for term, text in rows for line in (".TP", rf"\fB{roff(term)}\fR", roff(text))]


def _exit_codes() -> list[tuple[str, str]]:
    page = (DOCS / "exit-codes.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (.*?) \|", page, re.M)
    return [(code, text.replace("`", "")) for code, text in rows]


PAGES = {"mor.1": man_page, "commands.md": command_page}


def main() -> int:
    """Write both pages."""
    for name, text in PAGES.items():
        (DOCS / name).write_text(text(), encoding="utf-8", newline="\n")
        print(f"{name}: written", file=sys.stderr)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
