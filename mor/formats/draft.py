"""Drafts of project files, and helpers for reading text, JSON and XML."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn
from xml.parsers import expat

import numpy as np

from mor.errors import InputError, Message
from mor.input_files import CODE_PAGES, PROJECT, TABLE, decoded, not_utf8, read_bytes
from mor.project.document import Document, KeyPath
from mor.types import FloatArray

if TYPE_CHECKING:
    import polars as pl


# ---- A project in the making: the plain data of a project file, put together from the lines of another file.


class Row(NamedTuple):
    """Cells of a table row, and the line they come from."""

    cells: list[str | None]
    line: int


class Line(NamedTuple):
    """Words of a line, with those of lines that continue it, and its number."""

    words: list[str]
    number: int


@dataclass
class Draft:
    """Sections, tables and settings of a project, each with the line it comes from."""

    file: str
    data: dict[str, Any] = field(default_factory=lambda: {"mor": "1"})
    lines: dict[KeyPath, int] = field(default_factory=dict)
    files: dict[KeyPath, str] = field(default_factory=dict)
    """Files of the tables that do not come from ``file``."""
    frames: dict[str, pl.DataFrame] = field(default_factory=dict)
    """Tables with many rows, by the names that stand for them."""
    problems: list[Message] = field(default_factory=list)
    notes: list[Message] = field(default_factory=list)
    """What was left out, and why."""

    @contextmanager
    def at(self, line: int, file: str = "", name: str = "") -> Iterator[None]:
        """Report a ``ValueError`` as a problem of a line, which begins with the name of what stands there."""
        try:
            yield
        except ValueError as error:
            self.problem(f"{name}: {error}" if name else str(error), line, file)

    def problem(self, message: str, line: int = 0, file: str = "") -> None:
        """A mistake at a line of the file, or of another file that belongs to it."""
        self.problems.append(Message(message, file or self.file, line))

    def note(self, message: str, line: int = 0, file: str = "") -> None:
        """Something the reader did of its own accord, to be told to the user."""
        self.notes.append(Message(message, file or self.file, line))

    def put(self, key: str, value: Any, line: int = 0) -> None:
        """A key at the top of the project."""
        self.data[key] = value
        if line:
            self.lines[key,] = line

    def table(self, section: str, columns: Sequence[str], rows: Sequence[Row], file: str = "", **keys: Any) -> KeyPath:
        """Add a table to a section; columns without any value are left out. Returns its path."""
        tables = self.data.setdefault(section, [])
        path: KeyPath = (section, len(tables))
        used = [k for k in range(len(columns)) if any(row.cells[k] is not None for row in rows)]
        keys = {key: value for key, value in keys.items() if value is not None and value != []}
        cells = [[row.cells[k] for k in used] for row in rows]
        tables.append({**keys, "columns": [columns[k] for k in used], "rows": cells})
        self.lines[path] = rows[0].line
        for i, row in enumerate(rows):
            self.lines[*path, "rows", i] = row.line
        if file:
            self.files[path] = file
        return path

    def correlated(
        self, columns: Sequence[str], clusters: Sequence[tuple[Sequence[Row], FloatArray]], type_: str, file: str = ""
    ) -> None:
        """Add observations of one type in clusters, rows with their covariance matrix each, as one table."""
        if len(clusters) == 1:
            rows, matrix = clusters[0]
            self.table("observations", columns, rows, file, type=type_, covariance=matrix.tolist())
            return
        named = [
            Row([*row.cells, str(number)], row.line)
            for number, (rows, _) in enumerate(clusters, start=1)
            for row in rows
        ]
        covariance = [line for _, matrix in clusters for line in matrix.tolist()]
        self.table("observations", (*columns, "cluster"), named, file, type=type_, covariance=covariance)

    def frame(self, section: str, name: str, frame: pl.DataFrame, **keys: Any) -> None:
        """Add a table with many rows to a section; ``name`` is what stands for it."""
        self.frames[name] = frame
        self.data.setdefault(section, []).append({"file": name, **keys})

    def finish(self) -> Document:
        """The finished document. Raises :class:`InputError` with every mistake found."""
        if self.problems:
            raise InputError(sorted(self.problems, key=lambda problem: (problem.file, problem.line)))
        return Document(self.data, self.lines, self.file, self.files, tuple(self.notes), frames=self.frames)


FLIP = np.diag([1.0, -1.0, -1.0])
"""Camera axes of other programs (right, down, forward) from mor's (right, up, backward), and back."""
LARGEST = 1e30
"""Numbers beyond it are none of a measurement, and their squares leave the range of floating point."""


def usable(values: FloatArray | Sequence[float]) -> bool:
    """Return True if all of them are numbers up to 1e30."""
    with np.errstate(invalid="ignore"):
        return bool((np.abs(values) <= LARGEST).all())


def parse_number(text: str) -> float:
    """A number up to 1e30. Raises ``ValueError`` with words."""
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"found {text!r}, expected a number") from None
    if not isfinite(value) or "_" in text:
        raise ValueError(f"found {text!r}, expected a number")
    if abs(value) > LARGEST:
        raise ValueError(f"found {text!r}, a number beyond {LARGEST:g}")
    return value


# ---- Text of foreign files: in whatever encoding programs and instruments write, decoded in one place and said by
# name.


def read_lines(path: Path, draft: Draft) -> list[str]:
    """Lines of a text file without their ends; what follows the last end is no line where it is empty.

    UTF-8 and UTF-16 by their mark, UTF-8 without one; else Windows' Western European or Cyrillic letters, which a
    note says. Raises :class:`InputError` if the file cannot be read.
    """
    text, encoding = decoded(read_bytes(path, PROJECT))
    if encoding in CODE_PAGES:
        line = next(k for k, one in enumerate(text.split("\n"), start=1) if not one.isascii())
        draft.note(not_utf8(encoding), line, str(path))
    lines = text.split("\n")
    if lines and not lines[-1]:
        lines.pop()
    return lines


# ---- JSON with places: plain data, and the line in which a name stands.


class JsonFile:
    """The content of a JSON file. Raises :class:`InputError` if it is none, or has a key twice."""

    def __init__(self, path: Path):
        self.file = str(path)
        self.text = decoded(read_bytes(path, TABLE))[0]
        try:
            self.data: Any = json.loads(self.text, object_pairs_hook=self._once, parse_constant=self._constant)
        except json.JSONDecodeError as error:
            raise self._refused(f"this is not valid JSON: {error.msg}", error.lineno) from None
        except (RecursionError, ValueError) as error:
            words = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
            raise self._refused(f"this is not usable JSON: {words}", 0) from None

    def _refused(self, words: str, line: int) -> InputError:
        return InputError([Message(words, self.file, line)])

    def _once(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        data = dict(pairs)
        if len(data) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise self._refused(f"key {twice!r} is given twice", self.line(twice))
        return data

    def _constant(self, name: str) -> NoReturn:
        raise self._refused(
            f"found {name}, expected a finite number", self.text[: self.text.find(name)].count("\n") + 1
        )

    def line(self, name: object) -> int:
        """The line in which a name stands between quotes for the first time, 0 where it does not."""
        at = self.text.find(json.dumps(str(name)))
        at = at if at >= 0 else self.text.find(json.dumps(str(name), ensure_ascii=False))
        return self.text.count("\n", 0, at) + 1 if at >= 0 else 0


class Wrong(ValueError):  # noqa: N818 - what is wrong with a value, not a failure
    """A value is not what was expected; the words say how."""


def mapping(value: Any, what: str) -> dict[str, Any]:
    """A mapping. Raises :class:`Wrong`."""
    if not isinstance(value, dict):
        raise Wrong(f"{what}: found {_said(value)}, expected a mapping")
    return value


def json_number(value: Any, what: str) -> float:
    """A finite number. Raises :class:`Wrong`."""
    try:
        result = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else float("nan")
    except OverflowError:
        result = float("nan")
    if not isfinite(result) or abs(result) > 1e30:
        raise Wrong(f"{what}: found {_said(value)}, expected a number")
    return result


def numbers(value: Any, count: int, what: str) -> list[float]:
    """A list of so many finite numbers. Raises :class:`Wrong`."""
    if not isinstance(value, list) or len(value) != count:
        raise Wrong(f"{what}: found {_said(value)}, expected a list of {count} numbers")
    return [json_number(item, what) for item in value]


def _said(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}…"


# ---- XML with line numbers: a plain tree of elements. Documents that declare entities are refused.


@dataclass
class Element:
    """An element: name without namespace, attributes, children, the text directly inside it, its line."""

    name: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, name: str) -> list[Element]:
        """Children of a name."""
        return [child for child in self.children if child.name == name]

    def inside(self, *names: str, but: str = "") -> Iterator[Element]:
        """Elements of these names at any depth, the outermost of each branch; not those below an element ``but``."""
        for child in self.children:
            if child.name in names:
                yield child
            elif child.name != but:
                yield from child.inside(*names, but=but)


class _EntityError(Exception):
    """An entity declaration was met."""


def parse_xml(content: bytes, file: str) -> Element:
    """Root element of an XML document.

    Raises :class:`InputError` if the document is not well-formed or declares entities.
    """
    parser = expat.ParserCreate()
    parser.buffer_text = True
    stack: list[Element] = []
    roots: list[Element] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        element = Element(name.rpartition(":")[2], attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def end(name: str) -> None:
        stack.pop()

    def text(data: str) -> None:
        stack[-1].text += data

    def entity(*_: object) -> None:
        raise _EntityError

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        words = f"this is not well-formed XML: {expat.errors.messages[error.code]}"
        raise InputError([Message(words, file, error.lineno)]) from None
    except LookupError as error:
        words = f"this XML is said to be in an encoding that nobody knows ({error})"
        raise InputError([Message(words, file, 1)]) from None
    except _EntityError:
        words = "entity declarations are not allowed in an input file"
        raise InputError([Message(words, file, parser.CurrentLineNumber)]) from None
    return roots[0]


# ---- Longitude, latitude and height on WGS84 as east, north, up about a reference point: exact, without a projection.


def east_north_up(places: FloatArray, reference: FloatArray) -> FloatArray:
    """East, north, up (n, 3), m, of latitudes, longitudes (degrees) and heights (m) (n, 3) about ``reference`` (3,)."""
    lat, lon = np.radians(reference[:2])
    turn = np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )
    return np.asarray((geocentric(places) - geocentric(reference[None])) @ turn.T)


def geocentric(places: FloatArray) -> FloatArray:
    """Geocentric coordinates (n, 3), m, of latitudes, longitudes (degrees) and heights (m) (n, 3)."""
    lat, lon = np.radians(places[:, 0]), np.radians(places[:, 1])
    axis, flattening = 6378137.0, 1.0 / 298.257223563
    e2 = flattening * (2.0 - flattening)
    normal = axis / np.sqrt(1.0 - e2 * np.sin(lat) ** 2)
    across = (normal + places[:, 2]) * np.cos(lat)
    up = (normal * (1.0 - e2) + places[:, 2]) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), up], axis=1)


# ---- Files produced by a writer, and notes on content that they cannot hold.


class Written(NamedTuple):
    """Contents by path, and what was left out of them."""

    files: dict[Path, bytes]
    notes: list[Message]


Writer = Callable[[Document, Path, Path], Written]
"""Document, the folder its tables are found from, target."""
