"""A project built of dictionaries and data frames: the same document that a project file is read into."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from mor.errors import InputError, Problem
from mor.project.file.nodes import Document, Path


@dataclass(frozen=True)
class BuiltDocument(Document):
    """Plain data without a file: a place in it is said by its keys, ``observations[0].sigma``."""

    def line(self, path: Path) -> int:
        """There are no lines."""
        return 0

    def file_of(self, path: Path) -> str:
        """The keys that lead to a value."""
        return said_path(path) or self.file


def said_path(path: Path) -> str:
    """A path in Python's words: ``observations[0].sigma``."""
    said = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return said.removeprefix(".")


def build(data: Mapping[str, Any]) -> BuiltDocument:
    """The document of a project given as a dictionary, as its file would say it.

    A data frame (polars, pandas, or anything with columns by name) may stand where a file is named. Numbers may be
    numbers. Raises :class:`InputError` for values that a project file cannot hold.
    """
    frames: dict[str, pl.DataFrame] = {}
    problems: list[Problem] = []
    plain = _plain(data, (), frames, problems)
    if problems:
        raise InputError(problems)
    document = BuiltDocument(plain, {}, "project", frames=frames)
    return replace(document, data={"mor": "1", **document.data})


def _plain(value: Any, path: Path, frames: dict[str, pl.DataFrame], problems: list[Problem]) -> Any:
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
    problems.append(Problem(words, said_path(path)))
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
