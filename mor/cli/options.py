"""Options that several commands share."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from mor.errors import InputError, Message
from mor.input_files import is_folder, keep_standard_input, note_input
from mor.linalg.compilation import ASKED
from mor.machine import processors

# ---- Options that all commands that write share, and the types that tell inputs from outputs.


class _NamedPath(click.Path):
    """A path, as :class:`pathlib.Path`."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path. A name with a null byte is refused: no system has a file that is called so."""
        if "\0" in str(value):
            self.fail(f"{str(value)!r} is not a file name", param, ctx)
        return super().convert(value, param, ctx)


class InputPath(_NamedPath):
    """A file or folder that a command reads: nothing is written over it."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, noted as an input."""
        path = super().convert(value, param, ctx)
        note_input(path)
        return path


class OutputPath(_NamedPath):
    """A file or folder that a command writes.

    Every option that names an output has this type: the tests find the outputs of all commands by it.
    """


F = TypeVar("F", bound=Callable[..., object])


class MemorySize(click.ParamType):  # type: ignore[type-arg]
    """An amount of memory in bytes: 4GB, 800 MB."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The amount in bytes."""
        found = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", str(value).strip().lower(), re.ASCII)
        units = {"": 1.0, "b": 1.0, "kb": 1e3, "mb": 1e6, "gb": 1e9, "tb": 1e12, "mib": 2.0**20, "gib": 2.0**30}
        size = float(found[1]) * units.get(found[2], 0.0) if found else 0.0
        if not 0.0 < size < 1e18:
            self.fail(f"found {str(value)!r}, expected an amount of memory such as 4GB or 800MB", param, ctx)
        return size


def _ask_for_kernels(ctx: click.Context, param: click.Parameter, value: str) -> None:
    before = os.environ.get(ASKED)

    def take_back() -> None:
        os.environ.pop(ASKED, None)
        if before is not None:
            os.environ[ASKED] = before

    ctx.call_on_close(take_back)
    os.environ[ASKED] = value


coverage_option = click.option(
    "--coverage",
    metavar="K",
    type=click.FloatRange(min=0.0, min_open=True),
    help="State expanded uncertainties U = K sigma as well, with their coverage probability (GUM), e.g. 2.",
)


def output_option(words: str, shown: str | None = None, metavar: str = "FOLDER", **more: Any) -> Callable[[F], F]:
    """``--output`` of a command, with what is written there and where that is by default."""
    return click.option(
        "-o", "--output", metavar=metavar, type=OutputPath(), help=words, **{"show_default": shown, **more}
    )


force_option = click.option("-f", "--force", is_flag=True, help="Replace existing files.")
kernels_option = click.option(
    "--kernels",
    type=click.Choice(("auto", "numpy", "numba")),
    default="auto",
    envvar=ASKED,
    show_default=f"{ASKED}, or auto",
    expose_value=False,
    callback=_ask_for_kernels,
    help="Compute with NumPy or with compiled kernels; auto takes the faster one: NumPy below 20 000 observations.",
)
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")


# ---- The option ``--from``: the format of a foreign file whose content shall not tell.

format_option = click.option(
    "--from",
    "source_format",
    metavar="FORMAT",
    help="Format of PROJECT if it is a file of another program; by default found from its content.",
)
"""``--from`` of the commands that read one project."""


def only_project(path: Path, source_format: str | None) -> Path:
    """Return the only project file of a folder; any other path, and a folder in a foreign format, as it is.

    ``-`` is standard input, which is read here. Raises :class:`InputError` for a folder with several project files,
    and lists them.
    """
    if str(path) == "-":
        return keep_standard_input()
    if source_format or not is_folder(path):
        return path
    from mor.formats import is_foreign

    if is_foreign(path):
        return path
    found = sorted(file for file in path.iterdir() if _is_project(file))
    if len(found) > 1:
        names = ", ".join(file.name for file in found)
        raise InputError([Message(f"this folder has several projects: {names}; name one of them", str(path))])
    if not found:
        return path
    note_input(found[0])
    return found[0]


def _is_project(file: Path) -> bool:
    if file.suffix.lower() not in (".yaml", ".yml") or not file.is_file():
        return False
    with file.open("rb") as content:
        # Bytes of a file in which its key ``mor`` is looked for.
        return any(line.startswith(b"mor:") for line in content.read(1 << 16).splitlines())


# ---- ``--jobs`` and ``--cluster``: who shares what is to be done many times.


def jobs_option(words: str) -> Callable[[F], F]:
    """The option, with what the processes do; by default as many as there are processors."""
    return click.option("--jobs", metavar="N", show_default="all processors", type=click.IntRange(min=1), help=words)


cluster_option = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Address of a Dask scheduler whose workers do the work, e.g. tcp://host:8786 (needs mor-adjustment[dask]).",
)


def jobs_here(jobs: int | None, cluster: str | None) -> int:
    """Return the number of local processes. Raises :class:`InputError` if a cluster is given as well."""
    if jobs is not None and cluster is not None:
        raise InputError([Message("--jobs and --cluster together; give either of them")])
    return jobs or processors()
