"""The man page and the page of commands are those of the commands that there are."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType

import click
import pytest

from mor.cli import COMMANDS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_commands", DOCS / "write_commands.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["mor.1", "commands.md"])
def test_page_is_in_date(pages: ModuleType, name: str) -> None:
    written = (DOCS / name).read_text(encoding="utf-8")
    assert written == pages.PAGES[name](), "python docs/write_commands.py writes it anew"


def test_every_command_and_option_is_in_the_man_page(pages: ModuleType) -> None:
    man = (DOCS / "mor.1").read_text(encoding="utf-8").replace(r"\-", "-")
    paths = {context.command_path for context, _ in pages.all_commands()}
    assert {f"mor {name}" for name in COMMANDS} < paths
    for context, command in pages.all_commands():
        section = man if context.parent is None else man.split(f".SS {context.command_path} [OPTIONS]", 1)[1]
        own = section.split(".SS ", 1)[0]
        for option in (entry for entry in command.params if isinstance(entry, click.Option) and not entry.hidden):
            for name in (*option.opts, *option.secondary_opts):
                assert re.search(rf"^\\fB(.* )?{re.escape(name)}\b(?!-)", own, re.M), (
                    context.command_path,
                    name,
                )


def test_lines_that_begin_with_a_dot_are_text(pages: ModuleType) -> None:
    assert pages.roff(".yaml and 'x' -o a\\b\n'y") == "\\&.yaml and 'x' \\-o a\\eb\n\\&'y"


def test_wheel_installs_the_man_page() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shared = project["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    assert shared == {"docs/mor.1": "share/man/man1/mor.1"}
