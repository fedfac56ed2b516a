"""Edits of the files of a project that a hypothesis needs, and the unified diff of them. No file is written.

An edit replaces text in place: a value of the project file, or a cell of a table in it or beside it. Comments, order
and layout stay as they are. A hypothesis that cannot be expressed in this way has no diff: if a table is compressed,
stands in a data frame, or its cells are given for all rows together.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import yaml

from mor.errors import InputError
from mor.input_files import read_text
from mor.project.file.nodes import Document
from mor.project.file.table import Table
from mor.project.network.build import Network
from mor.project.observations.observation_rows import group_name
from mor.project.tables.texts import our_name
from mor.quality.solved import Amount

At: TypeAlias = tuple[str | int, ...]
"""Path of a value in the project file."""
CellChange: TypeAlias = Callable[[str, Amount | None], str | None]
"""New text of a cell from the old one and the estimated amount; None if there is none."""
LARGEST = 4_000_000
"""Characters of a file up to which a diff is made."""


class KeyEdit(NamedTuple):
    """A value of the project file that is set, or replaced."""

    at: At
    text: Callable[[str, Amount | None], str | None]
    """New text from the old one, which is empty if there is none yet."""


class CellEdit(NamedTuple):
    """A cell of a table that is replaced."""

    at: At
    """Path of the table in the project file, or of a section one of whose tables has the row."""
    column: str
    change: CellChange
    line: int = 0
    """Line of the row in its file; 0 if the row is found by its cells."""
    cells: Mapping[str, str] = {}
    """Cells by column that the row has."""


Edit: TypeAlias = KeyEdit | CellEdit


class _NotExpressibleError(Exception):
    """An edit that cannot be made in place."""


def key(at: At, text: str) -> KeyEdit:
    """Return the edit that sets a value of the project file to a fixed text."""
    return KeyEdit(at, lambda _old, _amount: text)


def table_of(network: Network, number: int) -> At | None:
    """Return the path of the table of a group of observations, None if it comes from none."""
    name = network.groups[number].name
    entries = network.project.observations
    found = [k for k, entry in enumerate(entries) if group_name(entry, k) == name]
    return ("observations", found[0]) if len(found) == 1 else None


def table_key(network: Network, number: int, name: str, text: str) -> tuple[Edit, ...]:
    """Return the edit that sets a key of the table of a group of observations."""
    at = table_of(network, number)
    return () if at is None else (key((*at, name), text),)


def cells(
    network: Network, number: int, rows: Iterable[int], column: str, change: CellChange
) -> tuple[Edit, ...]:
    """Return the edits of a column in some rows of a group of observations."""
    at, group = table_of(network, number), network.groups[number]
    rows = list(rows)
    if at is None or any(row >= len(group.lines) for row in rows):
        return ()
    names = [reference.name for reference in group.type.references]
    return tuple(
        CellEdit(
            at,
            column,
            change,
            int(group.lines[row]),
            dict(zip(names, (own[row] for own in group.references), strict=True)),
        )
        for row in rows
    )


def to(text: str) -> CellChange:
    """Return the change of a cell to a fixed text."""
    return lambda _old, _amount: text


def computed(change: Callable[[float], float]) -> CellChange:
    """Return the change of a number in a cell, written with the digits it has; None if it is not a plain number."""

    def changed(old: str, _amount: Amount | None) -> str | None:
        try:
            value = change(float(old))
        except ValueError:
            return None
        return _with_digits(value, old)

    return changed


def with_amount(change: Callable[[float, float], float]) -> CellChange:
    """Return the change of a number in a cell by the estimated amount; an empty cell counts as 0."""

    def changed(old: str, amount: Amount | None) -> str | None:
        if amount is None:
            return None
        try:
            value = change(float(old or "0"), amount.value)
        except ValueError:
            return None
        return _with_digits(value, old if "." in old else "0.0000")

    return changed


def _with_digits(value: float, like: str) -> str:
    if "e" in like.lower():
        return f"{value:.10g}"
    digits = len(like.strip().partition(".")[2])
    return f"{value:.{digits}f}"


def as_diff(
    document: Document, folder: Path, edits: Sequence[Edit], amount: Amount | None = None
) -> str | None:
    """Return the unified diff of the files that edits change, None if they cannot be expressed.

    Args:
        document: The project file as it was read; one in a foreign format has no diff.
        folder: Where its tables are.
        edits: What is changed, all at once.
        amount: The estimated parameter, for edits that write it.
    """
    project = Path(document.file)
    if (
        not edits
        or document.files
        or project.suffix.lower() not in (".yaml", ".yml")
        or not project.is_file()
    ):
        return None
    try:
        return _Files(document, project, folder).diff(edits, amount)
    except (_NotExpressibleError, InputError, yaml.YAMLError, RecursionError):
        return None


class _Files:
    """The texts of a project and the pieces of them that are replaced."""

    def __init__(self, document: Document, project: Path, folder: Path) -> None:
        self.document, self.project, self.folder = document, project, folder
        self.texts: dict[Path, str] = {}
        self.lines: dict[Path, tuple[list[str], list[int]]] = {}
        """Lines of a table, and the place in its text at which each begins."""
        self.pieces: dict[Path, dict[tuple[int, int], str]] = {}
        self.root: Any = None
        self.repeated: set[int] = set()

    def diff(self, edits: Sequence[Edit], amount: Amount | None) -> str:
        for edit in edits:
            if isinstance(edit, KeyEdit):
                self._set(edit, amount)
            else:
                self._change_cell(edit, amount)
        return "".join(self._of_file(path) for path in self.pieces)

    def _of_file(self, path: Path) -> str:
        old, new = self.texts[path], self.texts[path]
        for (start, end), text in sorted(self.pieces[path].items(), reverse=True):
            new = new[:start] + text + new[end:]
        name = path.name if path.parent == self.project.parent else str(path)
        lines = difflib.unified_diff(
            old.splitlines(keepends=True), new.splitlines(keepends=True), name, name, n=1
        )
        return "".join(line if line.endswith("\n") else f"{line}\n" for line in lines)

    def _text(self, path: Path) -> str:
        if path not in self.texts:
            if path.suffix.lower() in (".gz", ".parquet") or not path.is_file():
                raise _NotExpressibleError
            self.texts[path] = read_text(path)
            if len(self.texts[path]) > LARGEST:
                raise _NotExpressibleError
        return self.texts[path]

    def _replace(self, path: Path, start: int, end: int, text: str | None) -> None:
        pieces = self.pieces.setdefault(path, {})
        if text is None or pieces.get((start, end), text) != text:
            raise _NotExpressibleError
        pieces[start, end] = text

    def _tree(self) -> Any:
        if self.root is None:
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            self.root = yaml.compose(self._text(self.project), Loader=loader)
            seen: set[int] = set()
            waiting = [self.root]
            while waiting:
                node = waiting.pop()
                if id(node) in seen:  # an alias: what is changed in one place would be in another one as well
                    self.repeated.add(id(node))
                    continue
                seen.add(id(node))
                if isinstance(node, yaml.MappingNode):
                    waiting += [one for pair in node.value for one in pair]
                elif isinstance(node, yaml.SequenceNode):
                    waiting += node.value
        return self.root

    def _walk(self, at: At) -> tuple[Any, At]:
        """The deepest value there is on a path, and the rest of the path."""
        node = self._tree()
        for place, step in enumerate(at):
            below = None
            if isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                below = node.value[step]
            elif isinstance(node, yaml.MappingNode):
                below = next((v for k, v in node.value if k.value == str(step)), None)
            if below is None:
                return node, at[place:]
            if id(below) in self.repeated:
                raise _NotExpressibleError
            node = below
        return node, ()

    def _set(self, edit: KeyEdit, amount: Amount | None) -> None:
        node, rest = self._walk(edit.at)
        whole = self._text(self.project)
        if not rest:
            if not isinstance(node, yaml.ScalarNode) and not node.flow_style:
                raise _NotExpressibleError
            start, end = node.start_mark.index, node.end_mark.index
            self._replace(self.project, start, end, edit.text(whole[start:end], amount))
            return
        text = edit.text("", amount)
        if text is None or not isinstance(node, yaml.MappingNode):
            raise _NotExpressibleError
        first, *inner = (str(step) for step in rest)
        for step in reversed(inner):
            text = f"{{{step}: {text}}}"
        if node.flow_style:
            place = node.end_mark.index - 1
            comma = ", " if node.value else ""
            self._replace(self.project, place, place, f"{comma}{first}: {text}")
            return
        name, value = node.value[0]
        indent = " " * name.start_mark.column
        if isinstance(value, yaml.ScalarNode) and value.start_mark.line == value.end_mark.line:
            place = whole.find("\n", value.end_mark.index)
            place = len(whole) if place < 0 else place
            self._replace(self.project, place, place, f"\n{indent}{first}: {text}")
        else:
            self._replace(
                self.project, name.start_mark.index, name.start_mark.index, f"{first}: {text}\n{indent}"
            )

    def _change_cell(self, edit: CellEdit, amount: Amount | None) -> None:
        table: Any = self.document.data
        for step in edit.at:
            table = table[step]
        if isinstance(table, list):  # any table of the section
            self._change_in_any(edit, len(table), amount)
        elif table.get("rows") is not None:
            self._change_in_place(edit, table, amount)
        elif isinstance(table.get("file"), str):
            self._change_in_file(edit, table, amount)
        else:
            raise _NotExpressibleError

    def _change_in_any(self, edit: CellEdit, count: int, amount: Amount | None) -> None:
        done = 0
        for k in range(count):
            try:
                self._change_cell(edit._replace(at=(*edit.at, k)), amount)
                done += 1
            except _NotExpressibleError:
                continue
        if done != 1:
            raise _NotExpressibleError

    def _change_in_place(self, edit: CellEdit, table: Any, amount: Amount | None) -> None:
        columns = table["columns"]
        whole = self._text(self.project)
        fitting = []
        for k, row in enumerate(table["rows"]):
            named = dict(zip(columns, row, strict=False))
            line = self.document.line((*edit.at, "rows", k))
            if edit.line in (0, line) and all(named.get(c) == text for c, text in edit.cells.items()):
                fitting.append(k)
        if len(fitting) != 1 or edit.column not in columns:
            raise _NotExpressibleError
        node, rest = self._walk((*edit.at, "rows", fitting[0], columns.index(edit.column)))
        if rest or not isinstance(node, yaml.ScalarNode):
            raise _NotExpressibleError
        start, end = node.start_mark.index, node.end_mark.index
        text = edit.change(node.value, amount)
        if text is not None and (
            not text or re.search(r"[^\w.+\-]", text) or whole[start : start + 1] in "\"'"
        ):
            text = '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
        self._replace(self.project, start, end, text)

    def _change_in_file(self, edit: CellEdit, table: Any, amount: Amount | None) -> None:
        path = self.folder / table["file"]
        if table["file"] in self.document.frames:
            raise _NotExpressibleError
        if path not in self.lines:
            split = self._text(path).split("\n")
            ends = accumulate((len(line) + 1 for line in split), initial=0)
            self.lines[path] = split, list(ends)
        lines, begins = self.lines[path]
        delimiter = table.get("delimiter") or ","
        if delimiter == " ":
            raise _NotExpressibleError
        declared = table.get("columns")
        used = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
        if isinstance(declared, list):
            header = list(declared)
        else:
            model = Table.model_construct(columns=declared)
            header = [
                our_name(model, name.strip().lstrip("\ufeff")) for name in lines[used[0]].split(delimiter)
            ]
            used = used[1:]
        if edit.column not in header:
            raise _NotExpressibleError
        places = [edit.line - 1] if edit.line else used
        fitting = []
        for k in places:
            parts = lines[k].split(delimiter) if 0 <= k < len(lines) else []
            if '"' in lines[k] or " #" in lines[k] or len(parts) != len(header):
                if edit.line:
                    raise _NotExpressibleError
                continue
            named = {c: part.strip() for c, part in zip(header, parts, strict=True)}
            if all(named.get(c, text) == text for c, text in edit.cells.items()):
                fitting.append((k, parts))
        if len(fitting) != 1:
            raise _NotExpressibleError
        row, parts = fitting[0]
        column = header.index(edit.column)
        old = parts[column]
        bare = old.strip()
        start = begins[row] + sum(len(part) + 1 for part in parts[:column])
        start += len(old) - len(old.lstrip()) if bare else 0
        text = edit.change(bare, amount)
        if text is not None and (delimiter in text or '"' in text or "\n" in text):
            raise _NotExpressibleError
        self._replace(path, start, start + len(bare), text)
