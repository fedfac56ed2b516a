"""Options that all commands that write share, and the types that tell inputs from outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class _NamedPath(click.Path):
    """A path, as :class:`pathlib.Path`."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path. A name with a null byte is refused: no system has a file that is called so."""
        if "\0" in str(value):
            self.fail(f"{str(value)!r} is no name of a file", param, ctx)
        return super().convert(value, param, ctx)


class InputPath(_NamedPath):
    """A file or folder that a command reads: nothing is written over it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, noted as an input."""
        from mor.input_files import note_input

        path = super().convert(value, param, ctx)
        note_input(path)
        return path


class OutputPath(_NamedPath):
    """A file or folder that a command writes.

    Every option that names an output has this type: the tests find the outputs of all commands by it.
    """


force_option = click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
