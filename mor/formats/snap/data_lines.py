"""Observations of a project as lines of a SNAP data file: angles and their σ in decimal degrees, lengths in metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError
from mor.formats.content import Content
from mor.formats.networks.on_earth import SetUps, clusters
from mor.formats.networks.terrestrial import Group, circle_in_face_one, heights_of
from mor.formats.snap.observations import KINDS, Kind
from mor.formats.snap.projections import PROJECTIONS

VECTORS = ("gnss_vector", "gnss_position")
_POSITION = "geodetic_position"
_CODES = {kind.type: code for code, kind in KINDS.items() if code != "DR"}
TYPES = tuple(dict.fromkeys(kind.type for kind in KINDS.values()))
_RAISED = ("distance", "zenith_angle", "height_difference")
_A_LINE = 6
"""Covariances on a line."""
NO_REFRACTION = "NONE"


class Writing(NamedTuple):
    """Settings that the lines of all tables share."""

    content: Content
    set_ups: SetUps
    projection: str
    """Name of the projection of the project, or nothing."""


def data_lines(content: Content, found: list[Group], points: list[str], projection: str) -> list[str]:
    """All observations. Raises :class:`InputError` for what SNAP cannot say."""
    writing = Writing(content, SetUps(content, points), projection)
    lines = ["#deg_angles", "#gps_error_type full"]
    for group in found:
        lines += _of_group(writing, group)
    return lines


def _of_group(writing: Writing, group: Group) -> Iterator[str]:
    type_ = group.entry.type
    if type_ in VECTORS:
        yield from _gnss(writing, group)
    elif type_ == _POSITION:
        yield from _positions(writing, group)
    elif type_ == "directions":
        yield from _sets(writing, group)
    elif type_ == "distance" and group.entry.instrument:
        yield from _ratios(writing, group)
    else:
        yield from _scalars(writing, group)


def _degrees(angle: float) -> str:
    return repr(float(np.degrees(angle)))


def _texts(group: Group, kind: Kind, row: int, metres: float) -> str:
    """Value and σ."""
    value, sigma = float(group.values[row, 0]), float(group.sigma[row, 0])
    if kind.angular:
        return f"{_degrees(value)} {_degrees(sigma)}"
    return f"{value * metres!r} {sigma * metres!r}"


def _heights(writing: Writing, group: Group, references: dict[str, str], row: int) -> tuple[float, float]:
    if group.entry.type not in _RAISED:
        return 0.0, 0.0
    return heights_of(group, references, row, {}, writing.content.edge.metres)


def _scalars(writing: Writing, group: Group) -> Iterator[str]:
    """Observations of one line each."""
    code = _CODES[group.entry.type]
    kind = KINDS[code]
    ends = ("point",) if kind.point else ("from", "to")
    names = [group.rows.text(name) for name in ends]
    rows = np.flatnonzero(np.isfinite(group.values[:, 0])).tolist()
    heights = {
        row: _heights(
            writing, group, {end: column[row] for end, column in zip(ends, names, strict=True)}, row
        )
        for row in rows
    }
    plain = not any(any(two) for two in heights.values())
    if code == "ZD":
        yield f"#refraction_coefficient {refraction_code(group.entry.instrument)}"
    if code == "PB":
        yield f"#projection {_projection(writing, group)}"
    yield f"#data {code} error{' no_heights' if plain else ''}"
    for row in rows:
        own = [column[row] for column in names]
        words = own if plain else [f"{name} {h!r}" for name, h in zip(own, heights[row], strict=True)]
        yield f"{' '.join(words)} {_texts(group, kind, row, writing.content.edge.metres)}"


def refraction_code(instrument: str | None) -> str:
    """SNAP's code of the refraction of an instrument."""
    return instrument.removeprefix("refraction ").replace(" ", "_").upper() if instrument else NO_REFRACTION


def _projection(writing: Writing, group: Group) -> str:
    given = (group.entry.projection or "").upper()
    name = next((name for name, code in PROJECTIONS.items() if code == given), "")
    if not name and not given:
        name = writing.projection
    if not name:
        words = f"SNAP's projections are those of New Zealand, found {group.entry.projection or 'that of the world'}"
        raise InputError([writing.content.place("observations").problem(words)])
    return name


def _sets(writing: Writing, group: Group) -> Iterator[str]:
    """Sets of directions, each with its orientation; face two as it would read in face one."""
    rows = group.rows
    value = circle_in_face_one(group.values[:, 0], rows.number("face"))
    sets: dict[tuple[str, str], list[str]] = {}
    names = zip(rows.text("station"), rows.text("set"), rows.text("to"), strict=True)
    for row, (station, set_, to) in enumerate(names):
        if np.isfinite(value[row]):
            line = f"{to} {_degrees(value[row])} {_degrees(group.sigma[row, 0])}"
            sets.setdefault((station, set_), []).append(line)
    yield "#data HA error no_heights"
    for (station, _), lines in sets.items():
        yield from ("", writing.set_ups.point(station), *lines)


def _ratios(writing: Writing, group: Group) -> Iterator[str]:
    """Distances with a free scale of their own, as a set of ratios from one station."""
    metres, from_ = writing.content.edge.metres, group.rows.text("from")
    rows = np.flatnonzero(np.isfinite(group.values[:, 0])).tolist()
    heights = [_heights(writing, group, {}, row) for row in rows]
    if len({from_[row] for row in rows}) > 1 or len({first for first, _ in heights}) > 1:
        words = "SNAP has distances of a free scale as ratios from one station at one height: give each its instrument"
        raise InputError([writing.content.place("observations").problem(words)])
    if not rows:
        return
    plain = not any(any(two) for two in heights)
    yield f"#data DR error{' no_heights' if plain else ''}"
    yield from_[rows[0]] + ("" if plain else f" {heights[0][0]!r}")
    for row, (_, height) in zip(rows, heights, strict=True):
        to = group.rows.text("to")[row] + ("" if plain else f" {height!r}")
        yield f"{to} {_texts(group, KINDS['DR'], row, metres)}"


def _positions(writing: Writing, group: Group) -> Iterator[str]:
    """Latitudes, longitudes and heights by themselves; correlated ones are a mistake."""
    Q = group.covariance
    if group.entry.covariance is not None or (Q is not None and np.any(Q - np.diag(np.diagonal(Q)))):
        words = "SNAP has latitudes, longitudes and heights without correlations: observe gnss_position"
        raise InputError([writing.content.place("observations").problem(words)])
    names, metres = group.rows.text("point"), writing.content.edge.metres
    for k, (code, letters) in enumerate((("LT", "NS"), ("LN", "EW"), ("EH", ""))):
        rows = np.flatnonzero(np.isfinite(group.values[:, k])).tolist()
        if rows:
            yield f"#data {code} error no_heights"
        for row in rows:
            value, sigma = float(group.values[row, k]), float(group.sigma[row, k])
            if letters:
                text = f"{_degrees(abs(value))} {letters[int(value < 0.0)]} {_degrees(sigma)}"
            else:
                text = f"{value * metres!r} {sigma * metres!r}"
            yield f"{names[row]} {text}"


def _gnss(writing: Writing, group: Group) -> Iterator[str]:
    """Vectors and positions: alone with their covariances, clusters as sets with their matrix."""
    code = "GB" if group.entry.type == "gnss_vector" else "GX"
    alone = group.entry.covariance is None
    for number, (rows, Q) in enumerate(clusters(writing.content, group, "SNAP")):
        heights = [_antennas(writing, group, row, code) for row in rows]
        plain = not any(any(two) for two in heights)
        if not alone:
            yield f"#data {code} error grouped{' no_heights' if plain else ''}"
            yield from _set(writing, group, rows, [] if plain else heights)
            yield from ("#end_set", *_lower(Q))
            continue
        if number == 0 or not plain:
            yield f"#data {code} error{' no_heights' if plain else ''}"
        lower = " ".join(repr(float(Q[i, j])) for i in range(3) for j in range(i + 1))
        ends = _ends(writing, group, rows[0])
        words = ends if plain else [f"{name} {h!r}" for name, h in zip(ends, heights[0], strict=True)]
        yield f"{' '.join(words)} {_three(writing, group, rows[0])} {lower}"
        if not plain:
            yield f"#data {code} error no_heights"


def _antennas(writing: Writing, group: Group, row: int, code: str) -> tuple[float, float]:
    return heights_of(group, {}, row, {}, writing.content.edge.metres) if code == "GB" else (0.0, 0.0)


def _ends(writing: Writing, group: Group, row: int) -> list[str]:
    names = ("from", "to") if group.entry.type == "gnss_vector" else ("point",)
    return [group.rows.text(name)[row] for name in names]


def _three(writing: Writing, group: Group, row: int) -> str:
    return " ".join(repr(float(value) * writing.content.edge.metres) for value in group.values[row])


def _set(
    writing: Writing, group: Group, rows: list[int], heights: list[tuple[float, float]]
) -> Iterator[str]:
    """Members of a set; vectors all begin in the station of its first line."""
    ends = [_ends(writing, group, row) for row in rows]
    starts = {(own[0], heights[k][0] if heights else 0.0) for k, own in enumerate(ends)}
    if len(starts) > 1 and len(ends[0]) > 1:
        words = "SNAP has clusters of vectors that begin in one station at one height of its antenna"
        raise InputError([writing.content.place("observations").problem(words)])
    if len(ends[0]) > 1:
        yield ends[0][0] + (f" {heights[0][0]!r}" if heights else "")
    for k, (own, row) in enumerate(zip(ends, rows, strict=True)):
        height = f" {heights[k][1]!r}" if heights else ""
        yield f"{own[-1]}{height} {_three(writing, group, row)}"


def _lower(Q: FloatArray) -> Iterator[str]:
    """The lower triangle of a matrix, row by row."""
    for i in range(len(Q)):
        row = [repr(float(value)) for value in Q[i, : i + 1]]
        for first in range(0, len(row), _A_LINE):
            yield " ".join(row[first : first + _A_LINE])
