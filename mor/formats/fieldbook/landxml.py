"""Field books in XML: LandXML and JobXML."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import degrees, isfinite, sin
from pathlib import Path

from mor.errors import InputError, Message
from mor.formats.draft import Draft, Element, parse_number, parse_xml
from mor.formats.fieldbook.book import COMPUTED, GNSS, FieldBook, InstrumentSetUp, Sight, sexagesimal
from mor.input_files import PROJECT, read_bytes
from mor.project.document import Document

# ---- LandXML (1.0 to 2.0): instrument set-ups, raw and reduced observations, points north, east, elevation.
#
# Source: the LandXML 1.2 schema. Points are named by their name; references to a point (``pntRef``) that bear another
# name give it theirs, as instruments write it. Azimuths run clockwise from north, angles are those of the circle.
#
# Angles, distances and heights of observations are readings. An azimuth beside a circle reading was computed
# from it, or is the placeholder 0 that some programs write; so are the coordinates inside the target of an
# observation, and those of points that Leica's part of the file (HeXML) calls measured or averaged.

_INSIDE = ("ObservationGroup", "Survey", "InstrumentSetup")
"""Elements that observations and set-ups stand in."""


def read_landxml(path: Path) -> Document:
    """The project of a LandXML file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    if root.name != "LandXML":
        raise InputError([Message(f"found <{root.name}>, expected <LandXML>", draft.file, root.line)])
    survey = _Survey(FieldBook(draft), *_units(root, draft))
    # Leica's part of a file (HeXML), beside that of LandXML.
    leica = "HexagonLandXML"
    # Classes of points in Leica's part whose coordinates were computed from readings.
    survey.computed = {
        point.attributes.get("uniqueID", "").strip()
        for element in root.all(leica)
        for point in element.all("Point")
        if point.attributes.get("class", "").lower() in ("measured", "averaged", "estimated", "navigated")
    }
    for collection in _descendants(root, "CgPoints"):
        survey.points(collection)
    for element in root.all("Survey"):
        survey.set_ups_in(element)
    for element in root.all("Survey"):
        survey.observations_in(element, "")
    for element in root.all(leica):
        words = f"{leica} is not read: ppm, prism constants and codes; distances are those of LandXML's own part"
        draft.note(words, element.line)
    # Parts of a file that have no observations.
    design = (
        "Alignments",
        "GradeModel",
        "Monuments",
        "Parcels",
        "PipeNetworks",
        "PlanFeatures",
        "Roadways",
        "Surfaces",
    )
    for element in root.children:
        if element.name in design:
            survey.book.leave_out(element.name, element.line)
    survey.finish(_title(root) or path.stem)
    return draft.finish()


def _descendants(element: Element, name: str) -> Iterator[Element]:
    for child in element.children:
        if child.name == name:
            yield child
        elif child.name in _INSIDE:
            yield from _descendants(child, name)


def _title(root: Element) -> str:
    headers = [header for survey in root.all("Survey") for header in survey.all("SurveyHeader")]
    return next((e.attributes["name"] for e in [*headers, *root.all("Project")] if e.attributes.get("name")), "")


def _units(root: Element, draft: Draft) -> tuple[float, str, str]:
    """Metres of a unit of length, units of angles and of directions."""
    inner = next((child for units in root.all("Units") for child in units.children), None)
    if inner is None:
        draft.problem("found no <Units> with <Metric> or <Imperial>: lengths could be anything", root.line)
        return 1.0, "rad", "rad"
    given = inner.attributes.get("linearUnit", "meter" if inner.name == "Metric" else "foot")
    metres_by_name = {
        "millimeter": 1e-3,
        "centimeter": 1e-2,
        "meter": 1.0,
        "kilometer": 1e3,
        "foot": 0.3048,
        "ussurveyfoot": 1200.0 / 3937.0,
        "inch": 0.0254,
        "mile": 1609.344,
    }
    if given.lower() not in metres_by_name:
        draft.problem(f"found the linearUnit {given!r}, expected one of {', '.join(metres_by_name)}", inner.line)
    found = []
    angle_units = {
        "radians": "rad",
        "grads": "gon",
        "decimal degrees": "deg",
        "degrees": "deg",
        "decimal dd.mm.ss": "dms",
    }
    for name in ("angularUnit", "directionUnit"):
        unit = inner.attributes.get(name, "radians")
        known = angle_units.get(" ".join(unit.lower().split()))
        if known is None:
            draft.problem(f"found the {name} {unit!r}, expected one of {', '.join(angle_units)}", inner.line)
        found.append(known or "rad")
    return metres_by_name.get(given.lower(), 1.0), found[0], found[1]


@dataclass
class _Survey:
    """Content of a LandXML file."""

    book: FieldBook
    metres: float
    angle: str
    direction: str
    places: dict[str, tuple[tuple[float, ...], int]] = field(default_factory=dict)
    """North, east and perhaps height of the points, with their lines."""
    names: dict[str, str] = field(default_factory=dict)
    """What references call a point, by its name."""
    stations: dict[str, InstrumentSetUp] = field(default_factory=dict)
    backsights: list[tuple[InstrumentSetUp, Sight]] = field(default_factory=list)
    computed: set[str] = field(default_factory=set)
    """Points whose coordinates the instrument computed, by name or identifier."""

    def points(self, collection: Element) -> None:
        """Points of a collection and of those inside it; references to others are left to them."""
        for element in collection.children:
            if element.name == "CgPoints":
                self.points(element)
            elif element.name == "CgPoint" and element.text.strip():
                with self.book.draft.at(element.line, name=element.name):
                    self._point(element)

    def _point(self, element: Element) -> None:
        name = (element.attributes.get("name") or element.attributes.get("oID") or "").strip()
        if not name:
            raise ValueError("found no name")
        measured = element.attributes.get("pntSurv", "").lower() == "sideshot"
        if measured or element.attributes.get("oID", "").strip() in self.computed:
            self.computed.add(name)
        self._place(name, element)

    def _place(self, name: str, element: Element) -> None:
        place = tuple(parse_number(word) * self.metres for word in element.text.split())
        if len(place) not in (2, 3) or not all(map(isfinite, place)):
            raise ValueError(f"found {len(place)} coordinates, expected north, east and perhaps elevation")
        known = self.places.setdefault(name, (place, element.line))
        if known[0] != place:
            self.book.leave_out("other coordinates of a point that has some", element.line)

    def set_ups_in(self, element: Element) -> None:
        """Set-ups of a survey, wherever they stand in it."""
        for child in element.children:
            if child.name == "InstrumentSetup":
                with self.book.draft.at(child.line, name=child.name):
                    self._set_up(child)
            elif child.name == "ObservationGroup":
                self.set_ups_in(child)

    def _set_up(self, element: Element) -> None:
        key = element.attributes.get("id", "")
        point = next(iter(element.all("InstrumentPoint")), None)
        name = self._named(element.attributes.get("stationName", ""), point)
        if not key or key in self.stations:
            raise ValueError(f"found the id {key!r}, expected one that no other set-up has")
        if not name:
            raise ValueError("found no stationName and no InstrumentPoint with a name")
        height = self._length(element, "instrumentHeight") or 0.0
        self.stations[key] = set_up = self.book.set_up(name, element.line, height)
        set_up.orientation = _angle(element, "orientationAzimuth", self.direction)

    def _named(self, name: str, point: Element | None, observed: bool = False) -> str:
        """Name of a point that an element stands for: its own, else that of what it refers to."""
        attributes = point.attributes if point is not None else {}
        reference = attributes.get("pntRef", "").strip()
        own = name.strip() or attributes.get("name", "").strip() or reference or attributes.get("desc", "").strip()
        if reference and own != reference:
            self.names.setdefault(reference, own)
        if own and point is not None and point.text.strip():
            if observed:
                self.book.leave_out(COMPUTED, point.line)
            else:
                self._place(own, point)
        return own

    def observations_in(self, element: Element, key: str) -> None:
        """Observations inside an element; ``key`` is the set-up of those that name none."""
        describing = (
            "SurveyHeader",
            "Equipment",
            "FieldNote",
            "InstrumentPoint",
            "Backsight",
            "Corrections",
            "CgPoints",
            "InstrumentDetails",
            "Feature",
            "SurveyMonument",
        )
        for child in element.children:
            if child.name in ("RawObservation", "ReducedObservation", "ReducedArcObservation"):
                with self.book.draft.at(child.line, name=child.name):
                    self._observation(key, child)
            elif child.name == "Backsight":
                with self.book.draft.at(child.line, name=child.name):
                    self._backsight(key, child)
            elif child.name in _INSIDE:
                own = child.attributes.get("id" if child.name == "InstrumentSetup" else "setupID", "")
                self.observations_in(child, own or _set_up_of_backsight(child) or key)
            elif child.name not in describing:
                self.book.leave_out(child.name, child.line)

    def _observation(self, key: str, element: Element) -> None:
        if element.attributes.get("status", "").lower() == "deleted":
            self.book.leave_out("deleted observations", element.line)
            return
        station = self._station(element.attributes.get("setupID", "") or key)
        target = self._target(element)
        for name in sorted({"vertDistance", "northDiff", "eastDiff", "upDiff"} & element.attributes.keys()):
            self.book.leave_out(name, element.line)
        computed = {
            value: element.attributes.get(value, "").strip() != ""
            and (
                element.attributes.get(f"{kind}Type", "").lower() in ("computed", "calculated", "derived")
                or raw in element.attributes
            )
            for value, kind, raw in (
                ("azimuth", "azimuth", "horizAngle"),
                ("horizDistance", "distance", "slopeDistance"),
            )
        }
        for name in (name for name, no_measurement in computed.items() if no_measurement):
            self.book.leave_out(f"{name} that is computed", element.line)
        unit = self.angle
        sight = Sight(
            target,
            element.line,
            _angle(element, "horizAngle", unit),
            _angle(element, "zenithAngle", unit),
            self._length(element, "slopeDistance") or None,
            None if computed["horizDistance"] else self._horizontal_distance(element),
            self._length(element, "targetHeight") or 0.0,
            2 if element.attributes.get("directFace", "").lower() in ("false", "0") else 0,
            None if computed["azimuth"] else self._azimuth(element),
        )
        if not any(value is not None for value in (*sight[2:6], sight.bearing)):
            self.book.leave_out(f"{element.name} without readings", element.line)
            return
        station.sights.append(sight)

    def _horizontal_distance(self, element: Element) -> float | None:
        """Horizontal distance; that of an arc is its chord, 2 r sin(length / 2 r)."""
        radius, length = self._length(element, "radius"), self._length(element, "length")
        if element.name == "ReducedArcObservation" and radius and length:
            return 2.0 * radius * sin(length / (2.0 * radius))
        return self._length(element, "horizDistance") or None

    def _azimuth(self, element: Element) -> float | None:
        name = "chordAzimuth" if element.name == "ReducedArcObservation" else "azimuth"
        return _angle(element, name, self.direction)

    def _station(self, key: str) -> InstrumentSetUp:
        if key not in self.stations:
            raise ValueError(f"found the setupID {key!r}, which no InstrumentSetup has")
        return self.stations[key]

    def _target(self, element: Element) -> str:
        point = next(iter(element.all("TargetPoint")), None)
        name = self._named("", point, observed=True) if point is not None else ""
        other = element.attributes.get("targetSetupID", "")
        name = name or (self._station(other).station if other else "")
        if not name:
            raise ValueError("found no TargetPoint with a name and no targetSetupID")
        return name

    def _backsight(self, key: str, element: Element) -> None:
        """The reading of the circle at the backsight; a sight where no observation measures it."""
        circle = _angle(element, "circle", self.angle)
        point = next(iter(element.all("BacksightPoint")), None)
        name = self._named("", point) if point is not None else ""
        other = element.attributes.get("setupID", "")
        name = name or (self.stations[other].station if other in self.stations else "")
        if circle is None or not name:
            self.book.leave_out("Backsight without a circle or a point", element.line)
        else:
            self.backsights.append((self._station(key), Sight(name, element.line, circle, face=1)))

    def _length(self, element: Element, name: str) -> float | None:
        text = element.attributes.get(name, "").strip()
        return parse_number(text) * self.metres if text else None

    def _placeholders(self) -> None:
        """Leave out azimuths that are 0 to two or more targets of a set-up: programs write them for none."""
        for set_up in self.stations.values():
            zero = [k for k, sight in enumerate(set_up.sights) if sight.bearing == 0.0]
            if len({set_up.sights[k].target for k in zero}) < 2:
                continue
            for k in zero:
                self.book.leave_out("azimuths 0 to several targets of a set-up", set_up.sights[k].line)
                set_up.sights[k] = set_up.sights[k]._replace(bearing=None)

    def finish(self, title: str) -> None:
        """Put everything into the book: backsights that nothing measures, points under the names sights call them."""
        for station, sight in self.backsights:
            if not any(s.target == sight.target and s.horizontal is not None for s in station.sights):
                station.sights.insert(0, sight)
        self._placeholders()
        for name, (place, line) in self.places.items():
            height = place[2] if len(place) == 3 else None
            known = self.names.get(name, name)
            derived = name in self.computed and self.book.sighted(known)
            (self.book.computed_point if derived else self.book.point)(known, place[1], place[0], height, line)
        self.book.finish(title)


def _set_up_of_backsight(group: Element) -> str:
    """The set-up of a group that only its backsight names, as Civil 3D writes it."""
    backsights = (child for child in group.all("Backsight") if child.all("BacksightPoint"))
    return next((name for child in backsights if (name := child.attributes.get("setupID", ""))), "")


def _angle(element: Element, name: str, unit: str) -> float | None:
    """An angle in degrees (of gon: the same as 0.9°). Raises ``ValueError``."""
    text = element.attributes.get(name, "").strip()
    if not text:
        return None
    if unit == "dms":
        return sexagesimal(text)
    return {"rad": degrees(1.0), "gon": 0.9, "deg": 1.0}[unit] * parse_number(text)


# ---- Trimble JobXML (``.jxl``): the field book of a job, degrees and metres whatever the job showed.
#
# Stations, targets and atmospheres are records of their own that points refer to; a point that names no
# station belongs to the last one before it. ``EDMDistance`` is raw: the prism constant of the target, and the
# ppm of the atmosphere where it says so, are added here. ``Circle`` and ``EDMDistance`` are readings;
# ``Grid`` of keyed-in points and ``ComputedGrid`` of GNSS points, with their precision, are given; other
# ``ComputedGrid``, ``Reductions``, mean turned angles and points by calculation are derived. Source: Trimble, *JobXML*.


def read_jobxml(path: Path) -> Document:
    """The project of a job. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    root = parse_xml(read_bytes(path, PROJECT), draft.file)
    records = next(iter(root.all("FieldBook")), None)
    if root.name != "JOBFile" or records is None:
        found = f"<{root.name}>" + (" without a <FieldBook>" if root.name == "JOBFile" else "")
        words = f"found {found}, expected <JOBFile> with a <FieldBook>"
        raise InputError([Message(words, draft.file, root.line)])
    reader = _LandXmlReader(FieldBook(draft))
    for record in records.children:
        with draft.at(record.line, name=record.name):
            reader.record(record)
    reader.book.finish(root.attributes.get("jobName") or path.stem)
    return draft.finish()


class _LandXmlReader:
    """Records that others refer to, and the book."""

    def __init__(self, book: FieldBook) -> None:
        self.book = book
        self.stations: dict[str, InstrumentSetUp] = {}
        self.targets: dict[str, tuple[float, float]] = {}
        """Height and prism constant, m."""
        self.ppm = 0.0

    def record(self, record: Element) -> None:
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
        given_by_others = ("MeanTurnedAngle", "MTA", "Intersect", "Resection", "Calculated", "Copied")
        if circle is not None and method not in given_by_others:
            self._sight(record, circle, name)
        elif record.all("Grid") and method in ("Coordinates", "", "KeyedIn"):
            (grid, *_) = record.all("Grid")
            east, north, height = (_number(grid, axis) for axis in ("East", "North", "Elevation"))
            self.book.point(name, east, north, height, record.line)
        elif any(child.name.startswith(("ECEF", "WGS84")) for child in record.children):
            self._gnss_point(record, name)
        else:
            self.book.leave_out(f"points by {method or 'no method'}", record.line)

    def _gnss_point(self, record: Element, name: str) -> None:
        grid = next(iter(record.all("ComputedGrid")), record)
        east, north, height = (_number(grid, axis) for axis in ("East", "North", "Elevation"))
        if east is None or north is None:
            self.book.leave_out(GNSS, record.line)
            return
        if record.all("ECEFDeltas"):
            self.book.leave_out("GNSS vectors (ECEFDeltas)", record.line)
        self.book.point(name, east, north, height, record.line)
        for precision in record.all("Precision"):
            sigma = (_number(precision, axis) or 0.0 for axis in ("Horizontal", "Vertical"))
            self.book.precision[name] = next(sigma), next(sigma)

    def _sight(self, record: Element, circle: Element, name: str) -> None:
        named = _text(record, "StationID")
        last = self.book.set_ups[-1] if self.book.set_ups and not named else None
        station = self.stations.get(named, last)
        if station is None:
            raise ValueError(f"point {name!r}: found no StationRecord {_text(record, 'StationID')!r} before it")
        height, prism = self.targets.get(_text(record, "TargetID"), (0.0, 0.0))
        raw = _number(circle, "EDMDistance")
        slope = None if raw is None else raw * (1.0 + 1e-6 * self.ppm) + prism
        angles = _number(circle, "HorizontalCircle"), _number(circle, "VerticalCircle")
        if angles == (None, None) and slope is None:
            self.book.leave_out("points without readings", record.line)
            return
        face = {"Face1": 1, "Face2": 2}.get(_text(circle, "Face"), 0)
        station.sights.append(Sight(name, record.line, *angles, slope, None, height, face))


def _text(element: Element, name: str) -> str:
    return next((child.text.strip() for child in element.all(name)), "")


def _number(element: Element, name: str) -> float | None:
    text = _text(element, name)
    return parse_number(text) if text else None
