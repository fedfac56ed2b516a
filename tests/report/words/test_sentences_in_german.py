"""Every sentence that a person may read is there in German: mistakes, notes, reasons, help; found in the source."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest
import yaml

import mor
from mor.cli import group
from mor.report.language import Sentence, parts, sentences_of
from tests.sentences import sentences

ROOT = Path(mor.__file__).parent
GERMAN = sentences_of("de")
CATALOGUE = GERMAN.catalogue
NOT_SAID = {
    text
    for texts in yaml.safe_load((Path(__file__).parent / "not_said.yaml").read_text(encoding="utf-8")).values()
    for text in texts
}
SCHEMAS = ("schema.py",)
"""Modules that describe keys to editors, or write a project file: English, as the keys are."""
VERIFICATION = {"verification.py"}  # tests/api/test_verification.py looks its words up
MODULES = [
    path for path in sorted(ROOT.rglob("*.py")) if not path.name.startswith(SCHEMAS) and path.name not in VERIFICATION
]
ROOMS = sorted({path.parent for path in MODULES})


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.relative_to(ROOT).as_posix())
def test_every_sentence_has_its_german(room: Path) -> None:
    found = set().union(*(sentences(path) for path in MODULES if path.parent == room))
    assert sorted(found - set(CATALOGUE) - NOT_SAID) == []


def test_the_rooms_were_really_looked_at() -> None:
    found = set().union(*map(sentences, MODULES))
    assert len(found & set(CATALOGUE)) > 900
    assert {"unknown camera {}{}", "the table is empty", "{} is fixed but has no value"} <= found


def test_nothing_is_listed_as_unsaid_that_is_no_more() -> None:
    found = set().union(*map(sentences, ROOT.rglob("*.py")))
    assert sorted(NOT_SAID - found) == []


@cache
def counted_things() -> set[str]:
    """``{:ray|rays}`` for every ``counted(number, "ray")``."""
    found = set()
    texts = (path.read_text(encoding="utf-8") for path in MODULES)
    for text in (text for text in texts if "counted(" in text):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "counted":
                words = [word.value for word in node.args[1:] if isinstance(word, ast.Constant)]
                if words:
                    found.add(f"{{:{words[0]}|{words[1] if len(words) > 1 else f'{words[0]}s'}}}")
    return found


def test_every_counted_thing_has_its_german() -> None:
    assert len(counted_things()) > 10
    assert sorted(counted_things() - set(CATALOGUE)) == []


def commands(command: click.Command) -> Iterator[click.Command]:
    """A command and all below it."""
    yield command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from commands(below)


def help_texts() -> set[str]:
    """Paragraphs of help as they are looked up, and helps and defaults of options."""
    found = set()
    for command in commands(group):
        paragraphs = inspect.cleandoc(command.help or "").split("\n\n")
        found |= {" ".join(p.replace("\b", "").split()) for p in paragraphs if "Examples:" not in p}
        for option in command.params:
            said = getattr(option, "show_default", None)
            found |= {
                getattr(option, "help", None) or "",
                said if isinstance(said, str) and " " in said else "",
            }
    return found - {""}


def test_all_help_is_there_in_german() -> None:
    assert len(help_texts()) > 150
    assert sorted(text for text in help_texts() if GERMAN.say(text) == text and text not in CATALOGUE) == []


def places(template: str) -> set[str]:
    return {part.place for part in parts(template) if part.place is not None}


def test_both_languages_have_the_same_places() -> None:
    wrong = [text for text in CATALOGUE if "{" in text and places(text) != places(CATALOGUE[text])]
    assert wrong == []


def filled(sentence: Sentence) -> str:
    """The English sentence with values that are no words of it."""
    numbers = iter(range(2, 100))
    values = {name: f"Q{next(numbers)}" for name in places(sentence.english)}
    text = ""
    for part in parts(sentence.english):
        text += part.fixed
        if part.place is not None:
            many = part.words.partition("|")[2]
            text += f"3 {many}" if many else values[part.place]
    return text


def test_every_sentence_is_recognised_as_itself() -> None:
    """Whatever the values: no other sentence is taken for it that would be said in another way."""
    wrong = []
    for english, other in CATALOGUE.items():
        sentence = Sentence(english, other)
        if "{" not in english or sentence.letters <= 3:
            continue
        text = filled(sentence)
        found, _ = next(GERMAN.candidates(text), (None, {}))
        if found is None or _said(found, text) != _said(sentence, text):
            wrong.append((english, found and found.english))
    assert wrong == []


def _said(sentence: Sentence, text: str) -> str:
    values = sentence.values(text)
    assert values is not None
    return "".join(part.fixed + (values[part.place] if part.place else "") for part in parts(sentence.other))
