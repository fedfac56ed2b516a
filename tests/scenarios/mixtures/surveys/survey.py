"""A survey: what is true, what is measured, and the tables of the project that says so, in units of its own.

A cell of a table is a text, a number, or a ``Start``: a value that is a start value and no more. It is left empty where
nothing is given, and is rough where the survey says so.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from mor.types import FloatArray

LENGTHS = {"um": 1e6, "mm": 1e3, "cm": 1e2, "m": 1.0, "km": 1e-3, "ft": 1.0 / 0.3048}
ANGLES = {"gon": 200.0 / np.pi, "deg": 180.0 / np.pi, "rad": 1.0, "mrad": 1e3}


class Start(NamedTuple):
    """A start value, and what is given of it where all others are taken away."""

    true: float
    rough: float | None = None


Cell = str | float | Start


@dataclass
class Mark:
    """A point: true place (m, about the middle of the survey), who may see it, how readily it is seen."""

    xyz: FloatArray
    by: str = "both"
    """``both``, ``images`` or ``stations``; ``none`` is seen by neither."""
    share: float = 1.0
    control: dict[str, float] = field(default_factory=dict)
    """Component → σ (m) of what is given of it; 0 is fixed."""
    rough: float = 0.0
    """σ (m) of the start values that it has, where it has any."""


@dataclass
class Camera:
    """A camera: constant, half format and σ in mm; ``free`` is to be calibrated, pixels are 5 µm."""

    c: float
    half: FloatArray
    sigma: float
    pixels: bool
    free: bool
    true: tuple[float, float, float]
    """c, xh, yh in mm as they are."""


@dataclass
class Photo:
    """An image: camera, projection centre, attitude (object to image)."""

    camera: str
    centre: FloatArray
    D: FloatArray
    sees: frozenset[str] | None = None
    """Names of the points it may see; ``None`` is all."""


@dataclass
class Survey:
    """Everything true of a survey, and the tables made of it."""

    seed: int
    draw: Generator
    size: float
    """Extent in metres."""
    length: str
    angle: str
    origin: FloatArray
    """(3,) metres from the origin of coordinates to the middle."""
    sigma_length: float
    sigma_angle: float
    marks: dict[str, Mark] = field(default_factory=dict)
    cameras: dict[str, Camera] = field(default_factory=dict)
    photos: dict[str, Photo] = field(default_factory=dict)
    stations: dict[str, str] = field(default_factory=dict)
    """Station → the point it stands over."""
    tables: dict[tuple[str, str], tuple[dict[str, Any], list[dict[str, Cell]]]] = field(default_factory=dict)
    times: dict[str, float] = field(default_factory=dict)
    """Frame → years since the first epoch; those that are not named are of the first one."""
    moves: dict[str, FloatArray] = field(default_factory=dict)
    """Point → velocity (3,) in metres a year."""
    more: dict[str, Any] = field(default_factory=dict)
    """Further sections of the project, as they are."""
    files: dict[str, bytes] = field(default_factory=dict)
    """Files beside the project."""
    tags: set[str] = field(default_factory=set)

    def row(self, section: str, table: str, keys: dict[str, Any], **cells: Cell) -> None:
        """Add a row to a table of a section; ``keys`` are those of the table beside its rows."""
        self.tables.setdefault((section, table), (keys, []))[1].append(cells)

    def chance(self, share: float, tag: str = "") -> bool:
        """True in a share of all cases, which are tagged."""
        happens = bool(self.draw.random() < share)
        self.tags |= {tag} if happens and tag else set()
        return happens

    def place(self, point: str, frame: str) -> FloatArray:
        """Where a point is while a frame sees it."""
        return self.marks[point].xyz + self.times.get(frame, 0.0) * self.moves.get(point, np.zeros(3))

    def one_of(self, *choices: Any) -> Any:
        """One of several things."""
        return choices[int(self.draw.integers(len(choices)))]

    def in_length(self, metres: float) -> float:
        """Metres in the unit of length of the project."""
        return float(metres) * LENGTHS[self.length]

    def in_angle(self, radians: float) -> float:
        """Radians in the unit of angles of the project."""
        return float(radians) * ANGLES[self.angle]

    def start(self, metres: float, rough: float | None = None) -> Start:
        """A length as a start value."""
        return Start(self.in_length(metres), None if rough is None else self.in_length(rough))

    def measured(self, metres: float) -> float:
        """A length with its error, in the unit of the project."""
        return self.in_length(metres + self.sigma_length * self.draw.standard_normal())

    def read(self, radians: float) -> float:
        """An angle with its error, in the unit of the project."""
        return self.in_angle(radians + self.sigma_angle * self.draw.standard_normal())

    @property
    def of_length(self) -> dict[str, Any]:
        """Keys of a table of lengths."""
        return {"values": {"sigma": self.in_length(self.sigma_length)}}

    @property
    def of_angle(self) -> dict[str, Any]:
        """Keys of a table of angles."""
        return {"values": {"sigma": self.in_angle(self.sigma_angle)}}

    def seen_marks(self, by: str) -> list[str]:
        """Points that images, or stations, may see."""
        return [name for name, mark in self.marks.items() if mark.by in ("both", by)]

    def write(self, folder: Path) -> tuple[Path, Path]:
        """The project with nothing given, and with the truth given."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        paths = folder / "project.yaml", folder / "truth.yaml"
        for path, given in zip(paths, (False, True), strict=True):
            path.write_text(self._document(given), encoding="utf-8")
        return paths

    def _document(self, given: bool) -> str:
        sections: dict[str, Any] = {
            "mor": "1",
            "title": f"survey {self.seed}: {', '.join(sorted(self.tags))}",
            "units": {"length": self.length, "angle": self.angle},
        }
        for (section, _), (keys, rows) in self.tables.items():
            columns = list(dict.fromkeys(name for row in rows for name in row))
            cells = [[_written(row.get(column, ""), given) for column in columns] for row in rows]
            sections.setdefault(section, []).append({**keys, "columns": columns, "rows": cells})
        sections.update(_resolved(self.more, given))
        return "\n".join(f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in sections.items()) + "\n"


def _written(cell: Cell, given: bool) -> str:
    if isinstance(cell, Start):
        cell = cell.true if given else "" if cell.rough is None else cell.rough
    return cell if isinstance(cell, str) else f"{cell:.15g}"


def _resolved(value: Any, given: bool) -> Any:
    """Sections with their start values; a key whose start value is not given is left out."""
    if isinstance(value, dict):
        return {
            key: _resolved(one, given)
            for key, one in value.items()
            if given or not (isinstance(one, Start) and one.rough is None)
        }
    if isinstance(value, list):
        return [_resolved(one, given) for one in value]
    return float(_written(value, given)) if isinstance(value, Start) else value
