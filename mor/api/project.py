"""Projects in Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from mor.errors import InputError, Message
from mor.project.document import Document, KeyPath

if TYPE_CHECKING:
    from mor.input_files import ReadFile
    from mor.project.network import Network


# ---- A project built of dictionaries and data frames: the same document that a project file is read into.


@dataclass(frozen=True)
class BuiltDocument(Document):
    """Plain data without a file: a place in it is said by its keys, ``observations[0].sigma``."""

    def line(self, path: KeyPath) -> int:
        """There are no lines."""
        return 0

    def file_of(self, path: KeyPath) -> str:
        """The keys that lead to a value."""
        return said_path(path) or self.file


def said_path(path: KeyPath) -> str:
    """A path in Python's words: ``observations[0].sigma``."""
    said = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return said.removeprefix(".")


def build(data: Mapping[str, Any]) -> BuiltDocument:
    """The document of a project given as a dictionary, as its file would say it.

    A data frame (polars, pandas, or anything with columns by name) may stand where a file is named. Numbers may be
    numbers. Raises :class:`InputError` for values that a project file cannot hold.
    """
    frames: dict[str, pl.DataFrame] = {}
    problems: list[Message] = []
    plain = _plain(data, (), frames, problems)
    if problems:
        raise InputError(problems)
    document = BuiltDocument(plain, {}, "project", frames=frames)
    return replace(document, data={"mor": "1", **document.data})


def _plain(value: Any, path: KeyPath, frames: dict[str, pl.DataFrame], problems: list[Message]) -> Any:
    """Dicts, lists, texts and None; data frames by a name of their own."""
    if value is None or isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(v, (*path, str(key)), frames, problems) for key, v in value.items()}
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if hasattr(value, "columns"):
        name = said_path(path)
        frames[name] = value if isinstance(value, pl.DataFrame) else _as_polars(value)
        return name
    if isinstance(value, (Sequence, np.ndarray)):
        return [_plain(v, (*path, k), frames, problems) for k, v in enumerate(value)]
    words = f"found {type(value).__name__}, expected texts, numbers, lists, dictionaries or data frames"
    problems.append(Message(words, said_path(path)))
    return None


def _as_polars(frame: Any) -> pl.DataFrame:
    """A data frame of another library; numbers stay numbers, all else becomes text."""
    columns: dict[str, pl.Series] = {}
    for name in frame.columns:
        values = np.asarray(frame[name])
        if values.dtype.kind in "iuf":
            columns[str(name)] = (
                pl.Series(str(name), values).fill_nan(None)
                if values.dtype.kind == "f"
                else (pl.Series(str(name), values))
            )
        else:
            missing = [v is None or v != v for v in values.tolist()]
            texts = [None if no else str(v) for v, no in zip(values.tolist(), missing, strict=True)]
            columns[str(name)] = pl.Series(str(name), texts, dtype=pl.String)
    return pl.DataFrame(columns)


# ---- Projects: read from a file, or built of dictionaries and data frames.

Source = str | PathLike[str] | Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Project:
    """A project that was read: everything is checked, nothing is adjusted yet.

    Attributes:
        document: the plain data of the project file, with the places they stand at.
        network: blocks of unknowns, groups of observations, datum, start values, in internal units and axes.
        folder: where its tables are found from.
        files: what it was read from.
    """

    document: Document
    network: Network
    folder: Path
    files: tuple[ReadFile, ...] = ()

    @property
    def title(self) -> str:
        """Title of the project."""
        return self.network.project.title

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes about assumptions made while the project was read."""
        return tuple(str(note) for note in self.network.notes)

    def __str__(self) -> str:
        from mor.report.summary import contents

        return contents(self.network)

    __repr__ = __str__


def read(source: Source, folder: str | PathLike[str] | None = None, form: str = "") -> Project:
    """Read and check a project.

    Args:
        source: a project file, a file or folder in a foreign format, or the project itself as a dictionary with the
            keys of a project file, in which a data frame may stand wherever a file of a table is named.
        folder: where the tables of a dictionary are found from; the current folder.
        form: format of a foreign file, as ``mor convert --from`` takes it, where its content shall not tell.

    Raises:
        InputError: with every mistake that was found: where it stands, what was found, what was expected.
    """
    from mor.api.pipeline import read_document, read_network
    from mor.input_files import files_read

    if isinstance(source, Mapping):
        from mor.project.schema import without_empty_keys

        document, place = without_empty_keys(build(source)), Path(folder or ".")
        with files_read() as files:
            network = read_network(document, place)
    else:
        path = Path(source)
        with files_read() as files:
            document, place = read_document(path, form), path.parent
            network = read_network(document, place)
    return Project(document, network, place, tuple(files.values()))
