"""Comp3D: coordinates (``.cor``) with observations (``.obs``), and the project (``.comp``) that names both.

Lengths are in m, angles in gon, clockwise from north. A line of ``.cor``: code, name, E, N, h, and σ of E, N, h. Codes:
0 free, 1 observed E N h, 2 observed E N, 3 observed h; 4, 5 only h is unknown (free, observed), 6 to 9 only E and N
(free, observed, and both again for remote points); −1 ignored. σ 0 holds the coordinate, a negative σ frees it.

A line of ``.obs``: code, origin, target, value, σ, part of σ that depends on the distance, heights of instrument and
target. Codes: 1 and 3 slope distance, 4 height difference, 5 circle reading of the round that 7 begins, 6 zenith
angle, 8 azimuth, 9 centring in plan (differences 0; σ of E, then of N), 14 and 15 difference of E and N. A negative
code or σ switches an observation off. σ of a length is a + b s, that of an angle a + b / s rad, with b in m; s is the
spatial distance, and in horizontal angles of versions before 5.23 the horizontal one. ``@file`` reads another file.

A point that is in no ``.cor`` file and has observations in plan alone has two dimensions; its height is that of a
station that sees it.

``11 origin @file [V [K]]``: coordinates in a frame that is at the origin, levelled (V or 1) or not, with σ times K; a
line of the file has name, x, y, z, and σ, σ and its part by distance, or σ of x, y, z, this part, height of target.
``12``: angle from x to y, elevation, distance in such a frame, σ of angles (its part by 1/s), σ of the distance, its
part by distance, height of target. ``19 origin @file [K [height]]``: name, dx, dy, dz of a GNSS baseline, the upper
triangle of its covariances, height of target.

A project with ``use_proj`` lies on the ellipsoid: E, N, h are those of the projection ``proj_def``, and points have
deflections of the vertical η, ξ (arc seconds) behind their σ.

Source: Comp3D, *User's documentation*: OBS File, COR File, Project Configuration.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import asin, hypot, pi, radians, sin
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.draft import Draft, Row, parse_number, read_lines
from mor.model.earth import EARTH_RADIUS, LocalSphere, east_north_up, gaussian_radius
from mor.project.document import Document
from mor.project.reference_system import ReferenceSystem, ReferenceSystemError, reference_system
from mor.types import FloatArray

_REFRACTION = 0.12
"""Default of Comp3D's coefficient of refraction."""
_OBSERVED = {1: (0, 1, 2), 2: (0, 1), 3: (2,), 5: (2,), 7: (0, 1), 9: (0, 1)}
"""Components of a point that are held, and that are observed, by its code."""
_OFF = "observations that are switched off"
_COLUMNS = {
    "directions": ("station", "set", "to", "horizontal", "sigma"),
    "zenith_angle": ("from", "to", "zenith_angle", "from_height", "to_height", "sigma"),
    "distance": ("from", "to", "distance", "from_height", "to_height", "sigma"),
    "bearing": ("from", "to", "bearing", "sigma"),
    "height_difference": ("from", "to", "dz", "sigma"),
    "vector": ("from", "to", "dx", "dy", "sigma_dx", "sigma_dy"),
}
_IN_FRAMES = {
    "local": ("system", "point", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"),
    "directions": (*("station", "to", "horizontal", "vertical"), *("sigma_horizontal", "sigma_vertical", "to_height")),
    "distance": ("from", "to", "distance", "to_height", "sigma"),
}
_FIXED = 1e-6
"""σ (m) of a coordinate that is held in a projection while others of its point are not."""


def read_comp3d(path: Path) -> Document:
    """The project of a ``.comp``, ``.obs`` or ``.cor`` file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    reader = _Reader(draft)
    settings: dict[str, str] = {}
    files: Mapping[str, Path | None]
    project = path if path.suffix.lower() == ".comp" else _project_beside(path, draft)
    if project is not None:
        text = "\n".join(read_lines(project, draft))
        setting = re.compile(
            r'"(refraction|internal_constraints|use_proj|proj_def|center_latitude|local_center)"\s*:\s*'
            r'([\w.+-]+|\[[\s\d.,eE+-]*\]|"[^"]*")'
        )
        settings = dict(setting.findall(text))
        version = re.search(r'"COMP3D_VERSION"\s*:\s*"[^"]*?v(\d+)\.(\d+)', text)
        # The first version in which σ of a horizontal angle depends on the spatial distance.
        reader.horizontal = version is not None and (int(version[1]), int(version[2])) < (5, 23)
        try:
            files = _named_files(project, text)
            reader.settings(settings)
        except ValueError as error:
            raise InputError([Message(str(error), str(project))]) from None
    else:
        files = {kind: _beside(path, kind) for kind in ("COR", "OBS")}
    for kind, read in (("COR", reader.point), ("OBS", reader.observation)):
        file = files.get(kind)
        if file is None:
            words = f"found no .{kind.lower()} file that belongs to it, expected one of the same name beside it"
            raise InputError([Message(words, str(path))])
        reader.file(file, read)
        if kind == "COR":
            adjusted = file.with_suffix(".new")
            reader.adjusted = _adjusted(adjusted, draft)
    reader.finish(path.stem, settings)
    if reader.n_adjusted:
        draft.note(f"its coordinates give the distances in {reader.n_adjusted} σ", file=str(adjusted))
    return draft.finish()


def _named_files(project: Path, text: str) -> dict[str, Path]:
    """The files that a project names, by kind. Raises ``ValueError``."""
    root_file = re.compile(r'"root_(COR|OBS)_file"\s*:\s*("(?:[^"\\]|\\.)*")')
    named = {kind: json.loads(name) for kind, name in root_file.findall(text)}
    return {kind: project.parent / named[kind].replace("\\", "/") for kind in ("COR", "OBS") if named.get(kind)}


def _project_beside(path: Path, draft: Draft) -> Path | None:
    """The project in the folder of an ``.obs`` or ``.cor`` file that names it; of several, that of the same name."""
    found = []
    for other in sorted(path.parent.iterdir()):
        if other.suffix.lower() == ".comp":
            try:
                files = _named_files(other, "\n".join(read_lines(other, Draft(str(other)))))
            except (InputError, ValueError):
                continue
            if path.resolve() in (file.resolve() for file in files.values()):
                found.append(other)
    same = [other for other in found if other.stem == path.stem]
    if len(same or found) > 1:
        names = ", ".join(other.name for other in found)
        draft.note(f"{names} name this file: none of them is read. To read one of them, give its name instead")
        return None
    return [*same, *found, None][0]


def _adjusted(path: Path, draft: Draft) -> dict[str, list[float]]:
    """The coordinates that Comp3D has adjusted (``.new``: name, E, N, h, and σ), none if the file does not exist."""
    found: dict[str, list[float]] = {}
    try:
        lines = list(_words(path, Draft(str(path)))) if path.is_file() else []
    except InputError as error:
        draft.notes += error.problems
        return found
    for _, words in lines:
        with suppress(ValueError):
            name, *place = words[0], *map(parse_number, words[1:4])
            if len(place) > 2:
                found[name] = place
    return found


def _beside(path: Path, kind: str) -> Path | None:
    """The file of a kind that belongs to another: of the same name, or the only one in the folder."""
    suffix = f".{kind.lower()}"
    if path.suffix.lower() == suffix:
        return path
    found = sorted(other for other in path.parent.iterdir() if other.suffix.lower() == suffix)
    same = [other for other in found if other.stem == path.stem]
    return same[0] if same else found[0] if len(found) == 1 else None


_Lengths: TypeAlias = dict[tuple[str, str], float]
"""Lengths by the names of the points at both ends."""


class _Point(NamedTuple):
    code: int
    place: list[float]
    sigmas: list[float]
    deflection: list[float]
    """η and ξ, arc seconds."""
    line: int
    file: str


class _Frame(NamedTuple):
    """A frame at a point: others are measured in it, Cartesian (11), polar (12) or as baselines (19)."""

    code: int
    origin: str
    levelled: bool
    factor: float
    """Of all σ."""
    height: float
    """Of the instrument above the point."""
    path: Path
    line: int
    file: str


@dataclass
class _Reader:
    draft: Draft
    points: dict[str, _Point] = field(default_factory=dict)
    ignored: set[str] = field(default_factory=set)
    observations: list[tuple[int, list[str], int, str]] = field(default_factory=list)
    adjusted: dict[str, list[float]] = field(default_factory=dict)
    """Coordinates of an adjustment by Comp3D, for the parts of σ that depend on the distance."""
    n_adjusted: int = 0
    """Number of the σ that use them."""
    refraction: float = _REFRACTION
    centre: list[float] = field(default_factory=list)
    """East, north and height of the centre of the local frame, empty if unknown."""
    frames: list[_Frame] = field(default_factory=list)
    skipped: dict[str, list[tuple[int, str]]] = field(default_factory=dict)
    horizontal: bool = False
    """Whether σ of horizontal angles depends on the horizontal distance."""
    radius: float = EARTH_RADIUS
    sphere: LocalSphere | None = None
    """Of a project without a projection."""
    system: ReferenceSystem | None = None
    """Of a project in a projection that needs the plumb lines of single points."""
    middle: FloatArray = field(default_factory=lambda: np.zeros((1, 3)))
    """Latitude, longitude (rad) and height of the origin of the object system of such a project."""
    centrings: list[tuple[Row, list[Row]]] = field(default_factory=list)
    """Frames and observations of centrings in a projection."""

    def file(self, path: Path, read: Callable[[list[str], int, str], None], depth: int = 0) -> None:
        # Levels of files in files.
        if depth > 8:
            raise InputError([Message("files name each other in a circle", str(path))])
        for line, words in _words(path, self.draft):
            with self.draft.at(line, str(path)):
                if words[0].startswith("@"):
                    name = words[0][1:] or (words[1] if len(words) > 1 else "")
                    self.file(path.parent / name.replace("\\", "/"), read, depth + 1)
                else:
                    read(words, line, str(path))

    def settings(self, found: dict[str, str]) -> None:
        """Refraction and centre of a project. Raises ``ValueError``."""
        self.refraction = parse_number(found.get("refraction", repr(_REFRACTION)))
        words = found.get("local_center", "[]").strip("[]").split(",")
        self.centre = [parse_number(word) for word in words if word.strip()]
        if "center_latitude" in found:
            self.radius = gaussian_radius(radians(parse_number(found["center_latitude"])))

    def leave_out(self, what: str, line: int, file: str) -> None:
        self.skipped.setdefault(what, []).append((line, file))

    def point(self, words: list[str], line: int, file: str) -> None:
        code = _code(words)
        if code == -1 and len(words) > 1:
            self.ignored.add(words[1])
            return
        if not 0 <= code <= 9 or len(words) < 5:
            raise ValueError(f"found {' '.join(words[:6])!r}, expected a code (-1 to 9), a name, E, N, h")
        numbers = [parse_number(word) for word in words[2:8]]
        deflection = [*map(parse_number, words[8:10]), 0.0, 0.0][:2]
        sigmas = [*numbers[3:], 0.0, 0.0, 0.0][:3] if len(numbers) > 3 else [0.0, 0.0, 0.0]
        self.points[words[1]] = _Point(code, numbers[:3], sigmas, deflection, line, file)

    def observation(self, words: list[str], line: int, file: str) -> None:
        if words[0] in ("#VERT", "#NEW"):  # MMVII: levelled stations, a new one of the same kind
            return
        code = _code(words)
        not_read = {
            2: "distances on the ellipsoid (2)",
            18: "rotation axes (18)",
            21: "equal height differences (21)",
            22: "equal distances (22)",
        }
        if abs(code) in not_read:
            self.leave_out(not_read[abs(code)], line, file)
        elif abs(code) in (11, 12, 19):
            if len(words) < 3 or not words[2].startswith("@"):
                raise ValueError(f"found {' '.join(words[:4])!r}, expected a code, origin, @file")
            options = words[3:]
            levelled = abs(code) != 19 and options[:1] in (["V"], ["v"], ["1"])
            numbers = [parse_number(word) for word in options[abs(code) != 19 :]]
            factor, height = [*numbers, *(1.0, 0.0)[len(numbers) :]][:2]
            path = Path(file).parent / words[2][1:].replace("\\", "/")
            if code > 0:
                self.frames.append(_Frame(code, words[1], levelled, factor, height, path, line, file))
            else:
                self.leave_out(_OFF, line, file)
        elif abs(code) not in (1, 3, 4, 5, 6, 7, 8, 9, 14, 15) or len(words) < 5:
            raise ValueError(f"found {' '.join(words[:6])!r}, expected a code, origin, target, value and σ")
        elif code < 0 or (code != 9 and parse_number(words[4]) < 0.0):
            self.leave_out(_OFF, line, file)
            if abs(code) == 7:
                self.observations.append((-7, words, line, file))
        else:
            self.observations.append((code, words, line, file))

    def finish(self, title: str, settings: dict[str, str]) -> None:
        draft = self.draft
        draft.put("title", title)
        draft.put("units", {"length": "m", "angle": "gon"})
        draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
        if not settings:
            words = f"no .comp file that is read says the coefficient of refraction: {_REFRACTION} is Comp3D's default"
            draft.note(words)
        draft.put("instruments", {"comp3d": {"refraction": repr(self.refraction)}})
        projected = settings.get("use_proj") == "true"
        if projected:
            crs = settings.get("proj_def", "").strip('"').replace("\\/", "/").partition("<>")[0].strip()
            draft.put("world", {"crs": crs, "heights": "ellipsoidal"})
            if any(code == 9 for code, *_ in self.observations) or any(
                f.code == 11 and f.levelled for f in self.frames
            ):
                self._use_middle(crs)
        else:
            draft.put("curvature", self._sphere(settings))
            for name, point in self.points.items():
                if any(point.deflection):
                    words = f"point {name}: deflections of the vertical need a project in a projection (use_proj)"
                    draft.problem(words, point.line, point.file)
        free = settings.get("internal_constraints") == "true"
        tables = self._tables(projected)
        in_frames = self._put_frames(projected)
        centred = self._put_centrings()
        self._put_points(tables, free, in_frames, projected, centred)
        for type_, rows in tables.items():
            instrument = "comp3d" if type_ == "zenith_angle" else None
            if rows:
                own = "ellipsoidal_height_difference" if projected and type_ == "height_difference" else type_
                draft.table("observations", _COLUMNS[type_], rows, type=own, instrument=instrument)
        draft.put("settings", {"undetermined": "leave_out"})
        for what, places in self.skipped.items():
            draft.note(f"Comp3D: {what} not read ({counted(len(places), 'record')})", *places[0])
        if not any(tables.values()) and not in_frames and not centred:
            draft.problem(f"there are no observations that are read; left out: {'; '.join(self.skipped) or '-'}")

    def _sphere(self, settings: dict[str, str]) -> dict[str, object]:
        """The sphere of the local frame: plan coordinates are those of its level 0 about the centre of the project."""
        centre = self.centre
        if len(centre) < 2:
            centre = self._mean_place(self.points)
            words = "no .comp file that is read says the centre of the local frame: the mean of the points is taken"
            self.draft.note(words)
        origin = {"x": repr(centre[0]), "y": repr(centre[1]), "z": "0"}
        latitude = settings.get("center_latitude")
        self.sphere = LocalSphere(self.radius, (centre[0], centre[1], 0.0))
        return {**({"latitude": f"{latitude} deg"} if latitude else {}), "origin": origin}

    def _mean_place(self, names: Iterable[str]) -> list[float]:
        """The mean coordinates of points; 0, 0, 0 if none of them has coordinates."""
        places = [self.points[name].place for name in names if name in self.points] or [[0.0] * 3]
        return [sum(place[k] for place in places) / len(places) for k in range(3)]

    def _use_middle(self, crs: str) -> None:
        """Let the object system begin amid the points: attitudes refer to its axes."""
        try:
            system = reference_system(crs)
        except ReferenceSystemError:
            return
        places = [point.place for point in self.points.values() if point.code in _OBSERVED] or [[0.0] * 3]
        middle = system.to_geodetic(np.median(np.array(places), axis=0)[None])
        if system.kind == "projected" and np.isfinite(middle).all():
            self.system, self.middle = system, middle
            for code, words, line, file in self.observations:
                one, other = words[1:3]
                for new, known in ((one, other), (other, one)) if code == 9 else ():
                    if known in self.points and new not in self.points and new not in self.ignored:
                        place = list(self.points[known].place)
                        self.points[new] = _Point(0, place, [0.0] * 3, [0.0, 0.0], line, file)
            latitude, longitude = np.degrees(middle[0, :2]).tolist()
            self.draft.data["world"]["origin"] = {"latitude": f"{latitude!r} deg", "longitude": f"{longitude!r} deg"}

    def _vertical(self, names: Sequence[str]) -> FloatArray:
        """The plumb line amid points in a projection, in the axes of the object system."""
        assert self.system is not None
        known = [name for name in names if name in self.points]
        place = self.system.to_geodetic(np.array([self._mean_place(known or self.points)]))
        if not np.isfinite(place).all():  # far outside the projection, which is told of the point
            place = self.middle
        east, north = self.points[known[0]].deflection if known else (0.0, 0.0)
        own, here = east_north_up(*self.middle[0, :2]), east_north_up(*place[0, :2])
        up = here.T @ np.array([*np.radians(np.array([east, north]) / 3600.0), 1.0])
        return np.asarray(own @ up / np.linalg.norm(up))

    def _level_attitude(self, origin: str, targets: Sequence[str]) -> list[float]:
        """ω and φ (gon) of a levelled frame: its third axis is the vertical of its origin, not that of the centre."""
        names = [origin] if origin in self.points else targets
        if self.sphere is None:
            x, y, z = self._vertical(names)
        else:
            x, y, z = self.sphere.local_axes(np.array([self._mean_place(names)]))[0, 2]
        return [float(angle) * 200.0 / pi for angle in (np.arctan2(-y, z), np.arcsin(x))]

    def _tables(self, projected: bool) -> dict[str, list[Row]]:
        """Rows of observations by type; the stations of directions are their points."""
        distances, in_plan = self._distances()
        tables: dict[str, list[Row]] = {type_: [] for type_ in _COLUMNS}
        rounds: dict[str, int] = {}
        types = {1: "distance", 3: "distance", 4: "height_difference", 6: "zenith_angle", 8: "bearing"}
        # Codes that a project in a projection cannot have here: their north is that of the project's centre.
        on_a_sphere = {8: "azimuths (8)"} | {code: f"differences of plan coordinates ({code})" for code in (9, 14, 15)}
        for code, words, line, file in self.observations:
            origin, target = words[1:3]
            if abs(code) == 7:
                rounds[origin] = rounds.get(origin, 0) + 1
            if code < 0:
                continue
            if projected and code in on_a_sphere and (code != 9 or self.system is None):
                self.leave_out(f"{on_a_sphere[code]} in a projection (use_proj)", line, file)
                continue
            with self.draft.at(line, file):
                value, a, *rest = (parse_number(word) for word in words[3:8])
                if {origin, target} & self.ignored:
                    self.leave_out("observations of points that are ignored", line, file)
                    continue
                b, *heights = [*rest, 0.0, 0.0, 0.0][:3]
                if code == 9:
                    rows = self._centring(origin, target, a, b or a, line, file)
                    if projected and rows:
                        name = f"{origin}@9.{len(self.centrings) + 1}"
                        omega, phi = self._level_attitude(origin, [target])
                        _, _, east, north, sigma_east, sigma_north = rows[0].cells
                        self.centrings.append(
                            (
                                _row([name, origin, 1.0, omega, phi, 0.0], line),
                                [Row([name, target, east, north, sigma_east, sigma_north], line)],
                            )
                        )
                    else:
                        tables["vector"] += rows
                    continue
                lengths = in_plan if self.horizontal and code in (5, 7, 8) else distances
                length = lengths.get((origin, target)) or lengths.get((target, origin))
                if b and not length:
                    self.leave_out("parts of σ that depend on an unknown distance", line, file)
                elif length:
                    self.n_adjusted += b > 0.0 and {origin, target} <= self.adjusted.keys()
                    a += b / length * 200.0 / pi if code in (5, 6, 7, 8) else b * length
                if a <= 0.0:
                    self.draft.problem(f"found the σ {a:g}, expected more than 0", line, file)
                elif code in (5, 7):
                    number = str(rounds.setdefault(origin, 1))
                    tables["directions"].append(_row([origin, number, target, value, a], line))
                elif code in (14, 15):
                    partial = [value, None, a, None] if code == 14 else [None, value, None, a]
                    tables["vector"].append(_row([origin, target, *partial], line))
                else:
                    between = heights if code in (1, 3, 6) else []
                    tables[types[code]].append(_row([origin, target, value, *between, a], line))
        return tables

    def _put_frames(self, projected: bool) -> set[str]:
        """Write the frames of points; return the names of all points in them."""
        draft, counts, names = self.draft, Counter[str](), set[str]()
        frames: dict[tuple[int, bool, str], list[Row]] = {}
        measured: dict[tuple[str, str], list[Row]] = {}
        baselines: list[tuple[list[Row], FloatArray]] = []
        for frame in self.frames:
            if frame.origin in self.ignored:
                self.leave_out("observations of points that are ignored", frame.line, frame.file)
                continue
            refused = ""
            if frame.code == 19 and not projected:
                refused = "GNSS baselines (19) without a projection (use_proj)"
            elif frame.code == 11 and frame.levelled and projected and self.system is None:
                refused = "levelled frames (11) in a projection (use_proj)"
            if refused:
                self.leave_out(refused, frame.line, frame.file)
                continue
            counts[frame.origin] += 1
            name = f"{frame.origin}@{counts[frame.origin]}"
            key = (frame.code, frame.levelled, frame.file)
            lines = list(_words(frame.path, draft))
            cells: list[str | float | None] = [name, frame.origin]
            if frame.code == 11:
                targets = [words[0] for _, words in lines]
                cells += [1.0, *(self._level_attitude(frame.origin, targets) if frame.levelled else [])]
            if frame.code != 19:
                frames.setdefault(key, []).append(_row(cells, frame.line))
            names.add(frame.origin)
            for line, (point, *rest) in lines:
                if point in self.ignored:
                    self.leave_out("observations of points that are ignored", line, str(frame.path))
                    continue
                with draft.at(line, str(frame.path)):
                    numbers = [parse_number(word) for word in rest]
                    found: dict[str, Row] = {}
                    if frame.code == 19:
                        baselines += _baseline(frame, point, numbers, line)
                    elif frame.code == 11:
                        found = {"local": _cartesian(name, point, numbers, frame.factor, line)}
                    else:
                        found = _polar(frame, name, point, numbers, line)
                    names.add(point)
                    for type_, row in found.items():
                        measured.setdefault((type_, str(frame.path)), []).append(row)
        for (code, levelled, file), rows in frames.items():
            held = ["scale", "omega", "phi"] if levelled else ["scale"]
            if code == 11:
                draft.table("systems", ("id", "point", *held), rows, file, fixed=held)
            else:
                draft.table("stations", ("id", "point"), rows, file, level=None if levelled else "free")
        for (type_, file), rows in measured.items():
            draft.table("observations", _IN_FRAMES[type_], rows, file, type=type_)
        if baselines:
            draft.correlated(
                ("from", "to", "dx", "dy", "dz", "from_height", "to_height"),
                baselines,
                "gnss_vector",
                str(self.frames[0].path),
            )
        return names

    def _put_centrings(self) -> set[str]:
        """Write the centrings of a project in a projection, 0 across the plumb line; return their points."""
        if not self.centrings:
            return set()
        frames = [frame for frame, _ in self.centrings]
        rows = [row for _, rows in self.centrings for row in rows]
        held = ("scale", "omega", "phi", "kappa")
        self.draft.table("systems", ("id", "point", *held), frames, fixed=list(held))
        self.draft.table("observations", ("system", "point", "x", "y", "sigma_x", "sigma_y"), rows, type="local")
        return {str(row.cells[1]) for row in (*frames, *rows)}

    def _centring(self, origin: str, target: str, east: float, north: float, line: int, file: str) -> list[Row]:
        """Differences 0 of E and N; a negative σ switches one of them off."""
        if east <= 0.0 or north <= 0.0:
            self.leave_out(_OFF, line, file)
        at = [0.0 if sigma > 0.0 else None for sigma in (east, north)]
        sigmas = [sigma if sigma > 0.0 else None for sigma in (east, north)]
        return [_row([origin, target, *at, *sigmas], line)] if any(sigmas) else []

    def _distances(self) -> tuple[_Lengths, _Lengths]:
        """Distances between points: measured ones, else those between coordinates, adjusted ones if there are any.

        The second value has the horizontal ones: those between adjusted coordinates, else measured with a zenith
        angle or the heights of the file, else those between its coordinates.
        """
        places = {name: point.place for name, point in self.points.items()} | self.adjusted
        zeniths, between, in_plan, measured, reduced = _Lengths(), _Lengths(), _Lengths(), _Lengths(), _Lengths()
        for code, words, *_ in self.observations:
            if code == 6 and _is_number(words[3]):
                zeniths[words[1], words[2]] = parse_number(words[3]) * pi / 200.0
        for code, words, *_ in self.observations:
            names = (words[1], words[2])
            one, other = (places.get(name) for name in names)
            rise = 0.0
            if one is not None and other is not None:
                *plan, rise = (p - q for p, q in zip(one, other, strict=True))
                between[names], in_plan[names] = hypot(*plan, rise), hypot(*plan)
            if code in (1, 3) and _is_number(words[3]):
                slope = parse_number(words[3])
                zenith = zeniths.get(names, asin(min(abs(rise) / slope, 1.0)) + pi / 2.0)
                measured[names] = measured[names[::-1]] = slope
                if not {*names} <= self.adjusted.keys():
                    reduced[names] = reduced[names[::-1]] = slope * abs(sin(zenith))
        return between | measured, in_plan | reduced

    def _put_points(
        self, tables: dict[str, list[Row]], free: bool, in_frames: set[str], projected: bool, centred: set[str]
    ) -> None:
        draft = self.draft
        datum, flat = False, 0
        groups: dict[tuple[tuple[str, ...], str], list[Row]] = {}
        used = centred | {name for rows in tables.values() for row in rows for name in _ends(row)}
        # Types that tell of heights.
        vertical = ("distance", "zenith_angle", "height_difference")
        with_height = in_frames | {name for type_ in vertical for row in tables[type_] for name in _ends(row)}
        held_by_code = {4: ("x", "y"), 5: ("x", "y"), 6: ("z",), 7: ("z",), 8: ("z",), 9: ("z",)}
        for name, point in self.points.items():
            sigma: list[float | None] = [0.0 if axis in held_by_code.get(point.code, ()) else None for axis in "xyz"]
            for k in () if free else _OBSERVED.get(point.code, ()):
                if point.sigmas[k] >= 0.0:
                    sigma[k] = point.sigmas[k]
            datum |= any(s is not None for s in sigma)
            if name in used - with_height and sigma[2] is None:
                sigma[2], flat = 0.0, flat + 1
            fixed = tuple(axis for axis, s in zip("xyz", sigma, strict=True) if s == 0.0)
            if projected and len(fixed) < 3:
                sigma = [_FIXED if s == 0.0 else s for s in sigma]
                fixed = ()
            deflection = [value or None for value in point.deflection]
            row = _row([name, *point.place, *(s or None for s in sigma), *deflection], point.line)
            groups.setdefault((fixed, point.file), []).append(row)
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "deflection_east", "deflection_north")
        if projected:
            columns = ("id", "east", "north", "height", "sigma_east", "sigma_north", "sigma_up", *columns[-2:])
        for (held, file), rows in groups.items():
            other = file if file != draft.file else ""
            deflected = any(cell is not None for row in rows for cell in row.cells[-2:])
            units = dict.fromkeys(columns[-2:], "arcsec") if deflected else None
            draft.table("points", columns, rows, other, fixed=list(held) or None, units=units)
        if flat:
            draft.note(f"{counted(flat, 'point')} without an observation of the height: their heights are held")
        rest = (used | in_frames) - self.points.keys()
        rest -= self._put_heights(tables, used - with_height - self.points.keys(), projected)
        if rest:
            draft.table("points", ("id",), [Row([name], 0) for name in sorted(rest)])
        stations = sorted({str(row.cells[0]) for row in tables["directions"]})
        if stations:
            draft.table("stations", ("id", "point"), [Row([name, name], 0) for name in stations])
        if free or not datum:
            draft.put("datum", "free")

    def _put_heights(self, tables: dict[str, list[Row]], names: set[str], projected: bool) -> set[str]:
        """Hold the heights of points with observations in plan alone at that of a station or target.

        Returns the points that are written with them.
        """
        pairs = [_ends(row) for type_ in ("directions", "bearing", "vector") for row in tables[type_]]
        rays = Counter(pair for ends in set(pairs) for pair in ends)
        known = {name: point.place[2] for name, point in self.points.items()}
        found: dict[str, float] = {}
        n_found = -1
        while len(found) > n_found:
            n_found = len(found)
            for one, other in pairs:
                for name, neighbour in ((other, one), (one, other)):
                    if name in names and name not in known and rays[name] > 1 and neighbour in known:
                        known[name] = found[name] = known[neighbour]
        if not found:
            return set()
        if projected:
            rows = [_row([name, height, _FIXED], 0) for name, height in found.items()]
            self.draft.table("observations", ("point", "height", "sigma"), rows, type="ellipsoidal_height")
        else:
            rows = [_row([name, height], 0) for name, height in found.items()]
            self.draft.table("points", ("id", "z"), rows, fixed=["z"])
        points = counted(len(found), "point")
        words = "it gets the height of a point at the other end and holds it"
        if len(found) > 1:
            words = "each gets the height of a point at the other end and holds it"
        self.draft.note(f"{points} in no .cor file, seen in plan alone: {words}")
        return set() if projected else set(found)


def _cartesian(frame: str, point: str, numbers: list[float], factor: float, line: int) -> Row:
    """Coordinates in a frame; a negative σ switches one of them off. Raises ``ValueError``."""
    if len(numbers) < 4:
        raise ValueError(f"found {len(numbers)} numbers behind {point}, expected x, y, z and σ")
    place, (first, *rest) = numbers[:3], numbers[3:]
    if len(rest) < 2:
        sigmas, relative = [first] * 3, sum(rest)
    else:
        sigmas, relative = [first, *rest[:2]], sum(rest[2:3])
    if any(rest[3:]):
        raise ValueError(f"the height of the target {point} in a Cartesian frame is not read")
    sigmas = [factor * (sigma + relative * hypot(*place)) if sigma > 0.0 else sigma for sigma in sigmas]
    if 0.0 in sigmas:
        raise ValueError(f"found the σ 0 of {point}, expected more than 0")
    on = [sigma > 0.0 for sigma in sigmas]
    cells = [value if used else None for value, used in zip([*place, *sigmas], on * 2, strict=True)]
    return _row([frame, point, *cells], line)


def _polar(frame: _Frame, name: str, point: str, numbers: list[float], line: int) -> dict[str, Row]:
    """Directions in a frame and distance, each unless its σ switches it off. Raises ``ValueError``."""
    if len(numbers) < 6:
        raise ValueError(f"found {len(numbers)} numbers behind {point}, expected two angles, a distance and three σ")
    alpha, beta, distance, a, *rest = numbers
    b, c, d, *height = rest if len(rest) > 2 else [0.0, *rest]
    up = height[0] if height else 0.0
    found = {}
    if a > 0.0:
        sigma = frame.factor * (a + (b / distance * 200.0 / pi if distance > 0.0 else 0.0))
        found["directions"] = _row([name, point, -alpha, beta, sigma, sigma, up], line)
    if c > 0.0:
        sigma = frame.factor * (c + d * distance)
        found["distance"] = _row([frame.origin, point, distance, up, sigma], line)
    return found


def _baseline(frame: _Frame, point: str, numbers: list[float], line: int) -> list[tuple[list[Row], FloatArray]]:
    """A baseline with its covariances, none if a negative variance switches it off. Raises ``ValueError``."""
    if len(numbers) < 9:
        raise ValueError(f"found {len(numbers)} numbers behind {point}, expected dx, dy, dz and six covariances")
    matrix = np.zeros((3, 3))
    upper = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    for (i, j), value in zip(upper, numbers[3:9], strict=True):
        matrix[i, j] = matrix[j, i] = value * frame.factor**2
    if matrix.diagonal().min() < 0.0:
        return []
    cells: list[str | float | None] = [frame.origin, point, *numbers[:3], frame.height, *[*numbers, 0.0][9:10]]
    return [([_row(cells, line)], matrix)]


def _ends(row: Row) -> tuple[str, str]:
    first, second, third = (str(cell) for cell in row.cells[:3])
    return (first, third) if len(row.cells) == len(_COLUMNS["directions"]) and second.isdecimal() else (first, second)


def _row(cells: Sequence[str | float | None], line: int) -> Row:
    return Row([None if c is None else c if isinstance(c, str) else repr(c) for c in cells], line)


def _is_number(text: str) -> bool:
    try:
        return parse_number(text) > 0.0
    except ValueError:
        return False


def _code(words: list[str]) -> int:
    if not re.fullmatch(r"-?\d{1,2}", words[0]):
        raise ValueError(f"found {words[0]!r}, expected a code")
    return int(words[0])


def _words(path: Path, draft: Draft) -> Iterator[tuple[int, list[str]]]:
    """Words of the lines of a file, without what follows a ``*``."""
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.partition("*")[0].split()
        if words:
            yield line, words
