"""A terrestrial network as JAG3D's column text: a file for each kind of points and each set of directions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, not_carried, points
from mor.formats.jag3d.columns import AXES, OBSERVATIONS, POINTS
from mor.formats.networks.terrestrial import (
    Group,
    circle_in_face_one,
    groups,
    heights_of,
    places,
    stations,
    tilted_stations,
    zenith_in_face_one,
)
from mor.formats.written import Written
from mor.observations import PLAIN_TYPES
from mor.project.file.model import Datum
from mor.project.file.nodes import Document
from mor.units import ANGLE_UNITS

_GON = ANGLE_UNITS["gon"]
_TYPES = (*OBSERVATIONS.values(), "zenith_directions")
_KINDS = {type_: kind for kind, type_ in OBSERVATIONS.items()}
_LEAST = 2
"""Files: one of points, one of observations."""
Files = dict[str, list[str]]


def write_jag3d(document: Document, folder: Path, target: Path) -> Written:
    """A folder of files; what JAG3D's text has no place for is noted. Raises :class:`InputError` for the rest."""
    content = content_of(document, folder)
    tables = groups(content, _TYPES)
    problems = tilted_stations(content, "JAG3D's text")
    for group in tables:
        if group.covariance is not None or group.entry.cluster:
            words = f"observations {group.entry.name or group.entry.type}: JAG3D's text has no correlations"
            problems.append(Problem(words, group.rows.file))
    files = _points(content, problems)
    if problems:
        raise InputError(problems)
    known = stations(content)
    sets: Files = {}
    for group in tables:
        _observations(group, known, content, files, sets)
    files |= {f"directions_{number}.txt": lines for number, lines in enumerate(sets.values(), start=1)}
    if not any(name.partition("_points_")[1] == "" for name in files) or len(files) < _LEAST:
        words = "JAG3D's text has points and terrestrial observations: this project has none that it can hold"
        raise InputError([Problem(words, content.document.file)])
    notes = not_carried(content, _TYPES, ("stations",), "JAG3D's text")
    if any(e.instrument or e.centring or e.ppm for e in content.project.observations):
        words = (
            "scales, offsets, refraction, centring: not written; σ that grow with the distance as they are"
        )
        notes.append(Problem(words, str(target)))
    notes.append(Problem("units are m and gon: set them in JAG3D before the import", str(target)))
    texts = {target / name: ("\n".join(lines) + "\n").encode() for name, lines in files.items()}
    return Written(texts, notes)


def _points(content: Content, problems: list[Problem]) -> Files:
    """Points by kind, with their coordinates and σ in the order of the columns."""
    found = points(content)
    values, sigma, free = places(found, content)
    dimensions = content.project.settings.dimensions
    size = {"z": "1", "xy": "2", "xyz": "3"}[dimensions]
    columns = ["xyz".index(axis) for axis in AXES[size]]
    datum = _datum(content, found.ids, AXES[size], problems)
    files: Files = {}
    for k, name in enumerate(found.ids):
        if set(name) & set(" \t#"):
            words = f"point {name!r}: names in JAG3D's text have no blanks and no #"
            problems.append(Problem(words, content.document.file))
        held, observed = ~free[k, columns], np.isfinite(sigma[k, columns])
        if held.all():
            kind = "reference"
        elif observed.all():
            kind = "stochastic"
        elif held.any() or observed.any():
            words = f"point {name!r}: JAG3D holds or observes all coordinates of a point, or none"
            problems.append(Problem(words, content.document.file))
            continue
        else:
            kind = "datum" if name in datum else "new"
        numbers = values[k, columns].tolist()
        if not np.isfinite(numbers).all():
            words = f"point {name!r} has no coordinates, which JAG3D needs; convert an adjusted project (adjusted.yaml)"
            problems.append(Problem(words, content.document.file))
            continue
        numbers += sigma[k, columns].tolist() if kind == "stochastic" else []
        files.setdefault(f"{kind}_points_{size}d.txt", []).append(" ".join([name, *map(repr, numbers)]))
    return {name: files[name] for kind in POINTS for name in files if name.startswith(kind)}


def _datum(content: Content, ids: list[str], axes: tuple[str, ...], problems: list[Problem]) -> set[str]:
    """Points that carry the datum, all coordinates of each."""
    datum = content.project.datum
    if datum == "fixed":
        return set()
    chosen = datum.free if isinstance(datum, Datum) and datum.minimal is None else "all"
    components = datum.components if isinstance(datum, Datum) else ["x", "y", "z"]
    by_axes = (
        chosen if isinstance(chosen, dict) else {"".join(components): ids if chosen == "all" else chosen}
    )
    names = [{str(name) for key, found in by_axes.items() if axis in key for name in found} for axis in axes]
    if (isinstance(datum, Datum) and datum.minimal is not None) or any(one != names[0] for one in names):
        words = "JAG3D has inner constraints over all coordinates of points only"
        problems.append(content.place("datum").problem(words))
    return names[0]


def _observations(
    group: Group, known: dict[str, tuple[str, float]], content: Content, files: Files, sets: Files
) -> None:
    """Lines of a table: from, to, heights, value, σ; directions by station and set."""
    type_, edge = group.entry.type, content.edge
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    for row in range(group.rows.count):
        names = {r.name: group.rows.text(r.name)[row] for r in PLAIN_TYPES[type_].references}
        heights = heights_of(group, names, row, known, edge.metres)
        value, sigma, flat = group.values[row], group.sigma[row], (0.0, 0.0)
        ends = f"{names.get('from', '')} {names['to']}"
        if "station" in names:
            ends = f"{known.get(names['station'], (names['station'], 0.0))[0]} {names['to']}"
            if np.isfinite(value[0]):
                key = f"{names['station']}\0{group.rows.text('set')[row]}"
                circle = float(circle_in_face_one(value[0], face[row])) * edge.sense % (2 * np.pi)
                sets.setdefault(key, []).append(_line(ends, flat, circle / _GON, sigma[0] / _GON))
        if "zenith" in type_ and np.isfinite(value[-1]):
            zenith = float(zenith_in_face_one(value[-1], face[row]))
            line = _line(ends, heights, zenith / _GON, sigma[-1] / _GON)
            files.setdefault("zenith_angles.txt", []).append(line)
        elif type_ in ("height_difference", "horizontal_distance", "distance") and np.isfinite(value[0]):
            own = heights if type_ == "distance" else flat
            line = _line(ends, own, value[0] * edge.metres, sigma[0] * edge.metres)
            files.setdefault(f"{_KINDS[type_]}.txt", []).append(line)


def _line(ends: str, heights: tuple[float, float], value: float, sigma: float) -> str:
    """All six columns. Raises :class:`InputError` for a σ that JAG3D would take for a distance."""
    if not sigma < 1.0:
        raise InputError(
            [Problem(f"{ends}: JAG3D reads a σ of 1 and more ({sigma:g}, m or gon) as a distance")]
        )
    return " ".join([ends, *(repr(float(number)) for number in (*heights, value, sigma))])
