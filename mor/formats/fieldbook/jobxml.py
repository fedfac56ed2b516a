"""Trimble JobXML (``.jxl``): the field book of a job, degrees and metres whatever the job showed.

Stations, targets and atmospheres are records of their own that points refer to; a point that names no station belongs
to the last one before it. ``EDMDistance`` is raw: the prism constant of the target, and the ppm of the atmosphere where
it says so, are added here. ``Circle`` and ``EDMDistance`` are readings; ``Grid`` of keyed-in points is given;
``ComputedGrid``, ``Reductions``, mean turned angles and points by calculation are derived. Source: Trimble, *JobXML*.
"""

from __future__ import annotations

from pathlib import Path

from mor.errors import InputError, Problem
from mor.formats.draft import Draft, number
from mor.formats.fieldbook.book import FieldBook, SetUp, Sight
from mor.formats.xml import Element, parse_xml
from mor.input_files import PROJECT, read_bytes
from mor.project.file.nodes import Document

_FACES = {"Face1": 1, "Face2": 2}
_COMPUTED = ("MeanTurnedAngle", "MTA", "Intersect", "Resection", "Calculated", "Copied")
"""Methods of points that other records of the job gave."""


def read_jobxml(path: Path) -> Document:
    """The project of a job. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    records = next(iter(root.all("FieldBook")), None)
    if root.name != "JOBFile" or records is None:
        found = f"<{root.name}>" + (" without a <FieldBook>" if root.name == "JOBFile" else "")
        words = f"found {found}, expected <JOBFile> with a <FieldBook>"
        raise InputError([Problem(words, draft.file, root.line)])
    reader = _Reader(FieldBook(draft))
    for record in records.children:
        try:
            reader.record(record)
        except ValueError as error:
            draft.problem(f"{record.name}: {error}", record.line)
    reader.book.finish(root.attributes.get("jobName") or path.stem)
    return draft.finish()


class _Reader:
    """Records that others refer to, and the book."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.stations: dict[str, SetUp] = {}
        self.targets: dict[str, tuple[float, float]] = {}
        """Height and prism constant, m."""
        self.ppm = 0.0

    def record(self, record: Element) -> None:
        """One record."""
        if record.name == "StationRecord":
            name = _text(record, "StationName")
            if not name:
                raise ValueError("found no StationName")
            height = _number(record, "TheodoliteHeight") or 0.0
            self.stations[record.attributes.get("ID", "")] = self.book.set_up(name, record.line, height)
        elif record.name == "TargetRecord":
            target = _number(record, "TargetHeight") or 0.0, _number(record, "PrismConstant") or 0.0
            self.targets[record.attributes.get("ID", "")] = target
        elif record.name == "AtmosphereRecord":
            applied = _text(record, "ApplyPPMToRawDistances").lower() in ("true", "1")
            self.ppm = (_number(record, "PPM") or 0.0) if applied else 0.0
        elif record.name == "PointRecord":
            self._point(record)
        else:
            self.book.leave_out(f"{record.name}", record.line)

    def _point(self, record: Element) -> None:
        if _text(record, "Deleted").lower() in ("true", "1"):
            self.book.leave_out("deleted points", record.line)
            return
        name, method = _text(record, "Name"), _text(record, "Method")
        if not name:
            raise ValueError("found no Name")
        circle = next(iter(record.all("Circle")), None)
        if circle is not None and method not in _COMPUTED:
            self._sight(record, circle, name)
        elif record.all("Grid") and method in ("Coordinates", "", "KeyedIn"):
            (grid, *_) = record.all("Grid")
            east, north, height = (_number(grid, axis) for axis in ("East", "North", "Elevation"))
            self.book.point(name, east, north, height, record.line)
        else:
            gnss = any(child.name.startswith(("ECEF", "WGS84")) for child in record.children)
            self.book.leave_out("GNSS points" if gnss else f"points by {method or 'no method'}", record.line)

    def _sight(self, record: Element, circle: Element, name: str) -> None:
        named = _text(record, "StationID")
        last = self.book.set_ups[-1] if self.book.set_ups and not named else None
        station = self.stations.get(named, last)
        if station is None:
            raise ValueError(
                f"point {name!r}: found no StationRecord {_text(record, 'StationID')!r} before it"
            )
        height, prism = self.targets.get(_text(record, "TargetID"), (0.0, 0.0))
        raw = _number(circle, "EDMDistance")
        slope = None if raw is None else raw * (1.0 + 1e-6 * self.ppm) + prism
        angles = _number(circle, "HorizontalCircle"), _number(circle, "VerticalCircle")
        if angles == (None, None) and slope is None:
            self.book.leave_out("points without readings", record.line)
            return
        face = _FACES.get(_text(circle, "Face"), 0)
        station.sights.append(Sight(name, record.line, *angles, slope, None, height, face))


def _text(element: Element, name: str) -> str:
    return next((child.text.strip() for child in element.all(name)), "")


def _number(element: Element, name: str) -> float | None:
    text = _text(element, name)
    return number(text) if text else None
