"""The option ``--from``: the format of a foreign file whose content shall not tell."""

from __future__ import annotations

from pathlib import Path

import click

from mor.errors import InputError, Problem
from mor.input_files import is_folder, note_input

format_option = click.option(
    "--from",
    "source_format",
    metavar="FORMAT",
    help="Format of a foreign PROJECT, where its content shall not tell.",
)
"""``--from`` of the commands that read one project."""


def only_project(path: Path, source_format: str | None = None) -> Path:
    """Return the only project file of a folder; any other path, and a folder in a foreign format, as it is.

    Raises :class:`InputError` for a folder with several project files, and lists them.
    """
    if source_format or not is_folder(path):
        return path
    from mor.formats import is_foreign

    if is_foreign(path):
        return path
    found = sorted(file for file in path.iterdir() if _is_project(file))
    if len(found) > 1:
        names = ", ".join(file.name for file in found)
        raise InputError([Problem(f"this folder has several projects: {names}; name one of them", str(path))])
    if not found:
        return path
    note_input(found[0])
    return found[0]


def _is_project(file: Path) -> bool:
    """True for a YAML file with the key that every project file has."""
    if file.suffix.lower() not in (".yaml", ".yml") or not file.is_file():
        return False
    with file.open("rb") as content:
        return any(line.startswith(b"mor:") for line in content.read(_HEAD).splitlines())


_HEAD = 1 << 16
"""Bytes of a file in which its key ``mor`` is looked for."""
