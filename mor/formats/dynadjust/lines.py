"""Lines of DynAdjust's files, and what is collected of them.

Source: *DynAdjust User's Guide*, appendix on DNA file formats: columns of 20 characters for names, values behind column
62, angles in degrees, minutes and seconds, their σ in seconds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.draft import LARGEST, Draft, Row, number
from mor.formats.text import read_lines

_MARK = "!#=DNA"
NAMES = (slice(2, 22), slice(22, 42), slice(42, 62))
VALUES = 62
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_NO_VALUE = re.compile(r"(?<=\s)(?:\d\d?\.\d\d?\.\d{4}|[A-Za-z]\w*)(?=\s|$)")
"""Frames and epochs behind the values of a measurement."""
OFF = "measurements that are switched off (*)"


def measured_words(text: str, least: int) -> list[str]:
    """Numbers of a measurement of one line, ``least`` or more; frame, epoch and the identifiers of a database go.

    Identifiers of measurement and cluster are whole numbers behind the values, which have a decimal point.
    """
    words = NUMBER.findall(_NO_VALUE.sub(" ", text))
    while len(words) > least and words[-1].isdecimal():
        words.pop()
    return words


@dataclass
class Collected:
    """Measurements read from DNA or DynaML."""

    draft: Draft
    geoid: dict[str, tuple[float, float, float]]
    """N (m), ξ, η (arc seconds) by station."""
    names: dict[str, int] = field(default_factory=dict)
    """Stations with the line that names them first."""
    left_out: dict[str, list[int]] = field(default_factory=dict)
    """Lines of the measurements that are not read, by what they are."""
    frames: dict[str, int] = field(default_factory=dict)
    sets: int = 0
    """Sets of directions so far."""
    tables: dict[str, list[Row]] = field(default_factory=dict)
    """Rows of the measurements that are in no cluster, by their letters."""
    clusters: dict[tuple[str, tuple[str, ...]], list[tuple[list[Row], FloatArray]]] = field(
        default_factory=dict
    )
    """Rows and covariance matrix of each cluster, by type and columns."""

    def skip(self, what: str, line: int) -> None:
        """The measurement at a line is not read."""
        self.left_out.setdefault(what, []).append(line)

    def known(self, names: list[str], line: int) -> list[str]:
        """Names of a measurement, noted. Raises ``ValueError`` where one is empty or there twice."""
        if not all(names) or len(set(names)) < len(names):
            raise ValueError(
                f"found the stations {', '.join(map(repr, names))}, expected {len(names)} different names"
            )
        for name in names:
            self.names.setdefault(name, line)
        return names


@dataclass
class Measurements(Collected):
    """Lines of a measurement file, and what is read of them."""

    lines: list[str] = field(default_factory=list)
    at: int = 1

    def numbers(self) -> list[float]:
        """Numbers of the next line. Raises ``ValueError`` where it has none."""
        text = self.lines[self.at] if self.at < len(self.lines) else ""
        if text[:1].strip():
            raise ValueError("the measurement is not complete: expected its values and covariances")
        self.at += 1
        words = NUMBER.findall(text[VALUES:])
        values = list(map(float, words))
        return values if all(-LARGEST <= value <= LARGEST for value in values) else list(map(number, words))

    def stations_of(self, text: str, count: int) -> list[str]:
        """Names of a line. Raises ``ValueError`` where there are not so many different ones."""
        return self.known([text[place].strip() for place in NAMES[:count]], self.at + 1)


def beside(path: Path, end: str) -> Path:
    """The file of a pair, in the case of letters that is there."""
    places = [path.with_suffix(end), path.with_suffix(end.upper())]
    return next((place for place in places if place.is_file()), places[0])


def marked_lines(path: Path, draft: Draft) -> list[str]:
    """Lines of a station or measurement file. Raises :class:`InputError` if it is none."""
    if not path.is_file():
        raise InputError(
            [Problem("this file does not exist; DynAdjust has a pair of .stn and .msr", str(path))]
        )
    lines = read_lines(path, draft)
    words = (lines[0] if lines else "").split()
    if not lines or not lines[0].startswith(_MARK) or len(words) < 2 or words[1].split(".")[0] != "3":
        said = lines[0][:30] if lines else ""
        raise InputError([Problem(f"found {said!r}, expected {_MARK} 3 in the first line", str(path), 1)])
    return lines


def read_geoid(path: Path, draft: Draft) -> dict[str, tuple[float, float, float]]:
    """N, ξ, η of the stations in the file ``.geo`` beside the pair; nothing if there is none."""
    found: dict[str, tuple[float, float, float]] = {}
    if not path.is_file():
        return found
    for line, text in enumerate(read_lines(path, draft), start=1):
        name, words = text[:20].strip(), text[20:].split()
        if not text.strip() or text.startswith("#"):
            continue
        try:
            N, xi, eta = (number(word) for word in words)
        except ValueError:
            draft.problem(f"found {text.strip()!r}, expected a station, N, ξ and η", line, str(path))
            continue
        found[name] = (N, xi, eta)
    return found
