"""Options that all commands that write share, and the types that tell inputs from outputs."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import click

from mor.compilation import ASKED, WAYS


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


_UNITS = {"": 1.0, "b": 1.0, "kb": 1e3, "mb": 1e6, "gb": 1e9, "tb": 1e12, "mib": 2.0**20, "gib": 2.0**30}


class Amount(click.ParamType):  # type: ignore[type-arg]
    """An amount of memory in bytes: 4GB, 800 MB."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The amount in bytes."""
        found = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", str(value).strip().lower(), re.ASCII)
        size = float(found[1]) * _UNITS.get(found[2], 0.0) if found else 0.0
        if not 0.0 < size < 1e18:
            self.fail(f"found {str(value)!r}, expected an amount of memory such as 4GB or 800MB", param, ctx)
        return size


def _ask_for_kernels(ctx: click.Context, param: click.Parameter, value: str) -> None:
    """Tell this process and those that it begins, until the command ends."""
    before = os.environ.get(ASKED)

    def take_back() -> None:
        os.environ.pop(ASKED, None)
        if before is not None:
            os.environ[ASKED] = before

    ctx.call_on_close(take_back)
    os.environ[ASKED] = value


force_option = click.option("-f", "--force", is_flag=True, help="Replace files that are there already.")
kernels_option = click.option(
    "--kernels",
    type=click.Choice(WAYS),
    default="auto",
    envvar=ASKED,
    show_default=f"{ASKED}, or auto",
    expose_value=False,
    callback=_ask_for_kernels,
    help="Work in NumPy or by compiled kernels; auto takes what is sooner done, below 20 000 observations NumPy.",
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Say nothing but mistakes.")
