"""Mutations of tables: cells, columns, rows, headings and names."""

from __future__ import annotations

import csv
import io

import numpy as np

from .values import changed_text, chosen, hostile

Rows = list[list[str]]


def mutated_table(rng: np.random.Generator, content: bytes) -> bytes:
    """A CSV file with one mutation of its cells, written as CSV again."""
    rows = [row for row in csv.reader(io.StringIO(content.decode("utf-8", "replace"), newline="")) if row]
    if not rows:
        return content
    delimiter = str(chosen(rng, ",,,,,,;\t"))
    text = io.StringIO()
    csv.writer(text, delimiter=delimiter, lineterminator="\n").writerows(mutated_rows(rng, rows, 1))
    return text.getvalue().encode("utf-8", "replace")


def mutated_rows(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """Rows with one mutation; the first ``headings`` of them name the columns."""
    copy = [list(row) for row in rows]
    if len(copy) <= headings or not any(copy):
        return [*copy, [hostile(rng)]]
    return _KINDS[int(rng.integers(len(_KINDS)))](rng, copy, headings)


def _row(rng: np.random.Generator, rows: Rows, headings: int) -> int:
    return int(rng.integers(headings, len(rows)))


def _cell(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    row = rows[_row(rng, rows, headings)]
    if row:
        k = int(rng.integers(len(row)))
        row[k] = changed_text(rng, row[k] or "")
    return rows


def _swapped_cells(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    a, b = rows[_row(rng, rows, headings)], rows[_row(rng, rows, headings)]
    if a and b:
        i = int(rng.integers(min(len(a), len(b))))
        a[i], b[i] = b[i], a[i]
    return rows


def _column(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """A whole column: emptied, made equal, taken out, doubled, or changed by one factor."""
    k = int(rng.integers(max(len(rows[0]), 1)))
    what = str(chosen(rng, ("empty", "equal", "out", "double", "hostile", "scaled", "first")))
    new, factor = hostile(rng), float(chosen(rng, (0, -1, 1e-3, 1e3, 0.9, 1e-12, 1e12)))  # type: ignore[arg-type]
    first = rows[headings][k] if k < len(rows[headings]) else ""
    for row in rows if what in ("out", "double") else rows[headings:]:
        if k >= len(row):
            continue
        if what == "out":
            del row[k]
        elif what == "double":
            row.insert(k, row[k])
        elif what == "scaled":
            row[k] = _times(row[k], factor)
        else:
            row[k] = {"empty": "", "equal": new, "hostile": new, "first": first}[what]
    return rows


def _times(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except (TypeError, ValueError):
        return cell


def _fewer(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """Many rows taken out, up to all of them."""
    share = float(chosen(rng, (0.1, 0.5, 0.9, 1.0)))  # type: ignore[arg-type]
    return [row for k, row in enumerate(rows) if k < headings or rng.random() >= share]


def _more(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """A row again, at the end, as it is or with one cell changed; or all rows twice."""
    if rng.random() < 0.2:
        return [*rows, *rows[headings:]]
    again = list(rows[_row(rng, rows, headings)])
    if again and rng.random() < 0.5:
        k = int(rng.integers(len(again)))
        again[k] = changed_text(rng, again[k] or "")
    return [*rows, again]


def _renamed(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """Every cell with one text gets another one, or the name of something else."""
    row = rows[_row(rng, rows, headings)]
    old = row[int(rng.integers(len(row)))] if row else ""
    other = rows[_row(rng, rows, headings)]
    new = other[0] if other and rng.random() < 0.5 else hostile(rng)
    return [[new if cell == old else cell for cell in row] for row in rows]


def _headed(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    """Another heading, or two of them exchanged."""
    k, m = (int(x) for x in rng.integers(max(len(rows[0]), 1), size=2))
    if rng.random() < 0.5 and len(rows[0]) > max(k, m):
        rows[0][k], rows[0][m] = rows[0][m], rows[0][k]
    elif len(rows[0]) > k:
        rows[0][k] = str(chosen(rng, ("sigma", "x", "z", "sigma_x", "set", "start_x", "height", "point", hostile(rng))))
    return rows


def _shuffled(rng: np.random.Generator, rows: Rows, headings: int) -> Rows:
    order = rng.permutation(len(rows) - headings) + headings
    return [*rows[:headings], *(rows[int(k)] for k in order)]


_KINDS = (
    *(_cell,) * 4,
    *(_column,) * 3,
    _swapped_cells,
    _fewer,
    _more,
    _renamed,
    _renamed,
    _headed,
    _shuffled,
)
