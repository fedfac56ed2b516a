"""The help of every command: examples first and valid, defaults shown, exit codes named, within 100 columns."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator

import click
import pytest

from mor.cli import COMMANDS, WIDTH, group


def commands(
    command: click.Command = group, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name="mor")
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from commands(found, (*path, name))


ALL = dict(commands())
NAMES = [" ".join(("mor", *path)) for path in ALL]


def help_of(path: tuple[str, ...], width: int = WIDTH) -> str:
    context = None
    for k in range(len(path) + 1):
        command = ALL[path[:k]]
        settings = {"terminal_width": width} if k == 0 else {}
        context = click.Context(
            command,
            parent=context,
            info_name=path[k - 1] if k else "mor",
            **command.context_settings | settings,
        )
    assert context is not None
    return ALL[path].get_help(context)


def examples(path: tuple[str, ...]) -> list[str]:
    """Command lines of mor among the examples of a help text."""
    block = help_of(path).split("Examples:\n")[1].split("\n\n")[0]
    pieces = re.split(r"&&|\|\||[|>]", block.replace("\n", "&&"))
    return [piece.strip() for piece in pieces if piece.strip().startswith("mor ")]


@pytest.mark.parametrize("path", ALL, ids=NAMES)
class TestHelpText:
    def test_order_is_sentence_examples_details_exit_codes_options(self, path: tuple[str, ...]) -> None:
        text = help_of(path)
        places = [text.index(part) for part in ("Usage:", "Examples:", "Exit codes:", "Options:")]
        assert places == sorted(places)
        between = text[: text.index("Examples:")].strip().split("\n\n")
        assert len(between) == 2, "one sentence stands before the examples"
        assert re.search(r"Exit codes: 0 ", text)

    def test_fits_the_width(self, path: tuple[str, ...]) -> None:
        assert max(map(len, help_of(path).splitlines())) <= WIDTH

    def test_examples_are_understood(self, path: tuple[str, ...]) -> None:
        assert any(line.startswith(" ".join(("mor", *path))) for line in examples(path))
        for line in examples(path):
            words = shlex.split(line.partition(" < ")[0])[1:]  # a file on standard input is no argument
            chosen: tuple[str, ...] = ()
            while (*chosen, *words[:1]) in ALL and words:
                chosen, words = (*chosen, words[0]), words[1:]
            assert chosen, line
            ALL[chosen].make_context(" ".join(chosen), list(words))  # raises for what is not understood

    def test_every_option_is_explained_with_its_default(self, path: tuple[str, ...]) -> None:
        for option in ALL[path].params:
            if not isinstance(option, click.Option) or option.hidden:
                continue
            assert option.help, option.name
            assert option.help.endswith((".", "?", '".')), option.help
            shown = "default: " in (option.get_help_record(click.Context(ALL[path])) or ("", ""))[1]
            given = option.get_default(click.Context(ALL[path]))
            has_default = not option.is_flag and isinstance(given, str | int | float)
            assert shown or not has_default, option.name
            assert option.metavar or option.is_flag or isinstance(option.type, click.Choice), option.name


def test_list_of_commands_says_what_their_help_says() -> None:
    for name in COMMANDS:
        sentence = COMMANDS[name]
        assert sentence.endswith(".")
        first = ALL[(name,)].get_short_help_str(WIDTH).split()[0]
        assert first == sentence.split()[0], name


def test_the_same_option_has_the_same_words_everywhere() -> None:
    words: dict[str, set[str]] = {}
    for command in ALL.values():
        for option in command.params:
            if isinstance(option, click.Option) and option.name in ("quiet", "as_json", "force"):
                words.setdefault(str(option.name), set()).add(str(option.help))
    assert words["quiet"] == {"Print nothing but errors."}
    assert all(text.startswith("Replace ") and " existing " in text for text in words["force"])


@pytest.mark.parametrize(
    ("line", "expected"),
    [("mor adj", {"adjust"}), ("mor adjust --lang ", {"en", "de"}), ("mor orient p", {"planar"})],
)
def test_shells_can_complete(line: str, expected: set[str]) -> None:
    words = line.split()
    environment = {**os.environ, "_MOR_COMPLETE": "bash_complete", "COMP_WORDS": line}
    environment["COMP_CWORD"] = str(len(words) - (0 if line.endswith(" ") else 1))
    done = subprocess.run([sys.executable, "-m", "mor"], env=environment, capture_output=True, text=True, check=False)
    assert {row.removeprefix("plain,") for row in done.stdout.splitlines()} == expected
