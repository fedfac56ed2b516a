"""A network as a STAR*NET input file: metres, d-m-s, x east, with all the digits a round trip needs.

Source: MicroSurvey, *STAR*NET Reference Manual*, chapter 5.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.content import Content, Things, content_of, not_carried, points
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
from mor.formats.starnet.lines import SEPARATORS
from mor.formats.written import Written
from mor.observations import PLAIN_TYPES
from mor.project.file.nodes import Document
from mor.units import ANGLE_UNITS

_TYPES = (
    "distance",
    "horizontal_distance",
    "directions",
    "zenith_directions",
    "angle",
    "bearing",
    "zenith_angle",
    "vertical_direction",
    "height_difference",
)
"""Types that STAR*NET has."""
_SECOND = ANGLE_UNITS["arcsec"]
_DIMENSIONS = {"xyz": ".3D", "xy": ".2D", "z": ".1D"}


def write_starnet(document: Document, folder: Path, target: Path) -> Written:
    """The network; what STAR*NET has no place for is noted. Raises :class:`InputError` for what it cannot say."""
    content = content_of(document, folder)
    found, tables = points(content), groups(content, _TYPES)
    separator = _separator(found, content)
    problems = tilted_stations(content, "STAR*NET")
    for group in tables:
        if group.covariance is not None or group.entry.cluster:
            words = f"observations {group.entry.name or group.entry.type}: STAR*NET has no correlations"
            problems.append(Problem(words, group.rows.file))
    if problems:
        raise InputError(problems)
    dimensions = content.project.settings.dimensions
    lines = [f"# {content.project.title}".rstrip(), ".UNITS METERS DMS", ".ORDER EN ATFROMTO"]
    lines += [_DIMENSIONS[dimensions], *([f".SEPARATOR {separator}"] if separator != "-" else [])]
    written, guessed = _points(found, content)
    lines += written
    known = stations(content)
    for group in tables:
        lines += _set_lines(group, known, content, separator)
        lines += _single_lines(group, known, content, separator)
    if not written and not any(group.rows.count for group in tables):
        words = (
            "STAR*NET has networks: this project has no point with coordinates and no terrestrial observation"
        )
        raise InputError([Problem(words, document.file)])
    return Written({target: ("\n".join(lines) + "\n").encode()}, _notes(content, target, guessed))


def _notes(content: Content, target: Path, guessed: int) -> list[Problem]:
    notes = not_carried(content, _TYPES, ("stations",), "STAR*NET")
    entries = content.project.observations
    if content.project.images or content.project.cameras:
        notes.append(Problem("STAR*NET has no images", str(target)))
    if any(e.instrument or e.centring for e in entries):
        words = "scales, offsets, refraction and σ of centring stand in STAR*NET's project options, not in this file"
        notes.append(Problem(words, str(target)))
    if any(e.ppm for e in entries):
        words = "σ that grow with the distance are written as they are at the observed one"
        notes.append(Problem(words, str(target)))
    if content.project.datum != "fixed":
        words = "STAR*NET has no inner constraints: hold coordinates (!) there, or the network stays without a datum"
        notes.append(Problem(words, str(target)))
    if content.project.settings.dimensions == "z":
        notes.append(Problem("plan coordinates of a levelling network are not written", str(target)))
    if guessed:
        words = f"points without a height: {guessed}, written with the mean of the others as start value"
        notes.append(Problem(words, str(target)))
    return notes


def _separator(found: Things, content: Content) -> str:
    """Separator of names: - or a sign that is in none of them. Raises :class:`InputError`."""
    names = [*found.ids]
    for group in groups(content, _TYPES):
        for reference in PLAIN_TYPES[group.entry.type].references:
            names += group.rows.text(reference.name)
    signs = set("".join(names))
    odd = [name for name in dict.fromkeys(names) if set(name) & set(" \t#'\"") or name[:1] in ".&"]
    free = [sign for sign in SEPARATORS if sign not in signs]
    if odd or not free:
        words = (
            f"point {odd[0]!r}: names in STAR*NET have no blanks, # ' \" and no . or & in front"
            if odd
            else ""
        )
        raise InputError([Problem(words or f"every one of {SEPARATORS} is in a name", content.document.file)])
    return free[0]


def _points(found: Things, content: Content) -> tuple[list[str], int]:
    """Lines of points, and of how many the height is no more than a mean."""
    values, sigma, free = places(found, content)
    dimensions = content.project.settings.dimensions
    finite = np.isfinite(values)
    some = values[finite[:, 2], 2]
    mean = float(some.mean()) if len(some) else 0.0
    lines, guessed = [], 0
    for k, name in enumerate(found.ids):
        marks = [
            "!" if not f else plain(s) if np.isfinite(s) else "*"
            for f, s in zip(free[k], sigma[k], strict=True)
        ]
        if dimensions != "z" and finite[k, :2].all():
            height = [plain(values[k, 2]) if finite[k, 2] else plain(mean)] if dimensions == "xyz" else []
            guessed += dimensions == "xyz" and not finite[k, 2]
            number = 2 + len(height)
            lines.append(" ".join(["C", name, *map(plain, values[k, :2]), *height, *marks[:number]]))
        elif dimensions != "xy" and finite[k, 2]:
            lines.append(f"E {name} {plain(values[k, 2])} {marks[2]}")
    return lines, guessed


def _names(group: Group, row: int) -> dict[str, str]:
    return {r.name: group.rows.text(r.name)[row] for r in PLAIN_TYPES[group.entry.type].references}


def _set_lines(
    group: Group, known: dict[str, tuple[str, float]], content: Content, separator: str
) -> Iterator[str]:
    """Directions, set by set; zenith angles of the same readings behind them."""
    if "directions" not in group.entry.type:
        return
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    horizontal = circle_in_face_one(group.values[:, 0], face) * content.edge.sense
    sets: dict[tuple[str, str], list[str]] = {}
    vertical = []
    for row in range(group.rows.count):
        names = _names(group, row)
        station = known.get(names["station"], (names["station"], 0.0))[0]
        if np.isfinite(horizontal[row]):
            line = f"DN {names['to']} {dms(horizontal[row])} {seconds(group.sigma[row, 0])}"
            sets.setdefault((names["station"], group.rows.text("set")[row]), [f"DB {station}"]).append(line)
        if group.values.shape[1] > 1 and np.isfinite(group.values[row, 1]):
            zenith = float(zenith_in_face_one(group.values[row, 1], face[row]))
            ends = f"{station}{separator}{names['to']}"
            heights = _heights(heights_of(group, names, row, known, content.edge.metres))
            vertical.append(f"V {ends} {dms(zenith)} {seconds(group.sigma[row, 1])}{heights}")
    for lines in sets.values():
        yield from (*lines, "DE")
    yield from vertical


def _single_lines(
    group: Group, known: dict[str, tuple[str, float]], content: Content, separator: str
) -> Iterator[str]:
    """Observations that stand by themselves."""
    type_, edge = group.entry.type, content.edge
    if "directions" in type_:
        return
    horizontal = type_ == "horizontal_distance" and content.project.settings.dimensions == "xyz"
    if horizontal:
        yield ".DELTA ON"
    face = np.nan_to_num(group.rows.number("face"), nan=1.0)
    for row in range(group.rows.count):
        names, value, sigma = _names(group, row), group.values[row, 0], group.sigma[row, 0]
        if not np.isfinite(value):
            continue
        ends = separator.join(names.values())
        heights = _heights(heights_of(group, names, row, known, edge.metres))
        if type_ == "angle":
            yield f"A {ends} {dms(value * edge.sense)} {seconds(sigma)}"
        elif type_ == "bearing":
            yield f"B {ends} {dms(value * edge.sense + edge.zero_azimuth)} {seconds(sigma)}"
        elif type_ == "height_difference":
            yield f"L {ends} {plain(value * edge.metres)} & {plain(sigma * edge.metres)}"
        elif type_ in ("zenith_angle", "vertical_direction"):
            zenith = zenith_in_face_one(value, face[row]) if type_ == "zenith_angle" else np.pi / 2 - value
            yield f"V {ends} {dms(float(zenith))} {seconds(sigma)}{heights}"
        else:
            own = "" if horizontal else heights
            yield f"D {ends} {plain(value * edge.metres)} {plain(sigma * edge.metres)}{own}"
    if horizontal:
        yield ".DELTA OFF"


def _heights(pair: tuple[float, float]) -> str:
    return f" {plain(pair[0])}/{plain(pair[1])}" if any(pair) else ""


def plain(value: float) -> str:
    """A number with all its digits and without an exponent."""
    return np.format_float_positional(value, trim="-")


def seconds(sigma: float) -> str:
    """A σ (rad) in seconds of arc."""
    return plain(sigma / _SECOND)


def dms(angle: float) -> str:
    """An angle (rad) as d-m-s within the circle, seconds with nine decimals (5e-15 rad)."""
    parts = round(float(angle) / _SECOND * 1e9) % (1_296_000 * 10**9)
    degrees_, rest = divmod(parts, 3600 * 10**9)
    minutes, rest = divmod(rest, 60 * 10**9)
    return f"{degrees_}-{minutes:02d}-{rest // 10**9:02d}.{rest % 10**9:09d}"
