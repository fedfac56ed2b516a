"""Plain data of a project as a project file: what a person reads as YAML, long tables as CSV beside it."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl

from mor.project.file.yaml_text import yaml_text
from mor.project.tables.guarded import any_unsafe, csv_lines, guarded

LONGEST = 20
"""Rows of a table, or of a covariance matrix, that stay in the project file."""


def matrix_text(rows: Sequence[Sequence[float | str]]) -> str:
    """The file of a covariance matrix, or of those of clusters."""
    alike = (np.array(list(some), dtype=float) for _, some in groupby(rows, len))
    return "".join(pl.DataFrame(matrix).write_csv(include_header=False) for matrix in alike)


def project_files(
    data: dict[str, Any],
    source: Path,
    target: Path,
    frames: Mapping[str, pl.DataFrame] = MappingProxyType({}),
) -> dict[Path, str]:
    """Texts by path: the project file ``target``, and its tables.

    ``source`` is the folder its files are found from; ``frames`` stand in place of files of these names.
    """
    texts: dict[Path, str] = {}
    written: dict[str, Any] = {}
    for section, content in data.items():
        if not isinstance(content, list):
            written[section] = content
            continue
        entries = []
        for number, entry in enumerate(content, start=1):
            table = target.with_name(f"{target.stem}_{section}_{number}.csv")
            frame = frames.get(str(entry.get("file")))
            if frame is not None:
                texts[table] = bytes(csv_lines(frame)).decode()
                entries.append({**entry, "file": table.name})
            else:
                entries.append(_entry(dict(entry), source, target, table, texts))
        written[section] = entries
    return {target: yaml_text(written, width=120), **texts}


def _entry(
    entry: dict[str, Any], source: Path, target: Path, table: Path, texts: dict[Path, str]
) -> dict[str, Any]:
    """An entry of a section, its rows moved into a table where they are many, its files found from the new place."""
    for key in ("file", "covariance"):
        if isinstance(entry.get(key), str):
            entry[key] = Path(os.path.relpath(source / entry[key], target.parent)).as_posix()
    if len(entry.get("covariance") or []) > LONGEST and not isinstance(entry["covariance"], str):
        matrix = table.with_stem(f"{table.stem}_covariance")
        texts[matrix] = matrix_text(entry["covariance"])
        entry["covariance"] = matrix.name
    rows, columns = entry.get("rows"), entry.get("columns")
    if not isinstance(rows, list) or len(rows) <= LONGEST or not isinstance(columns, list):
        return entry
    texts[table] = _csv(columns, rows)
    name = entry.get("name") or entry.get("type")
    kept = {key: value for key, value in entry.items() if key not in ("rows", "columns")}
    return {**kept, **({"name": name} if name else {}), "file": table.name}


def _csv(columns: list[str | None], rows: list[list[str | None]]) -> str:
    chosen = [k for k, name in enumerate(columns) if name is not None]
    text = io.StringIO()
    cells = [["" if k >= len(row) else row[k] or "" for k in chosen] for row in rows]
    unsafe = any_unsafe(cell for row in cells for cell in row)
    writer = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL if unsafe else csv.QUOTE_MINIMAL)
    writer.writerow([columns[k] for k in chosen])
    writer.writerows([[guarded(cell) for cell in row] for row in cells])
    return text.getvalue()
