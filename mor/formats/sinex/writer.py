"""Observed positions of a project on the earth as a SINEX file: estimates with their covariance matrix.

Source: *SINEX - Solution (Software/technique) Independent Exchange Format*, version 2.02 (IERS, 2006). An epoch that is
not known is 00:000:00000 there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, not_carried
from mor.formats.networks.on_earth import clusters, world_of
from mor.formats.networks.terrestrial import groups
from mor.formats.sinex.blocks import ESTIMATE, MATRIX, MOST
from mor.formats.written import Written
from mor.observations import PLAIN_TYPES
from mor.observations.earth import earth_types
from mor.project.file.nodes import Document
from mor.project.network.build import build_network
from mor.project.world.world import World

_TYPE = "gnss_position"
_EPOCH = "00:000:00000"
_AXES = ("STAX", "STAY", "STAZ")
_CODE, _POINT, _SOLUTION = 4, 2, 4
"""Letters of the code of a site, of its point, of the solution."""
_A_LINE = 3
_WIDTH = 21


class Estimates(NamedTuple):
    """Names, geocentric coordinates (n, 3) in metres, and their covariances (3n, 3n)."""

    names: list[str]
    values: FloatArray
    Q: FloatArray


def write_sinex(document: Document, folder: Path, target: Path) -> Written:
    """The file. Raises :class:`InputError` for what it cannot say."""
    content = content_of(document, folder)
    world_of(content, "SINEX")
    world = build_network(content.project, document, folder).world
    assert world is not None
    found = _estimates(content, world)
    sites = _sites(found.names, document.file)
    count = 3 * len(found.names)
    name = "MOR"
    head = f"%=SNX 2.02 {name} {_EPOCH} {name} {_EPOCH} {_EPOCH} P {count:05d} 2 S"
    blocks = {
        "FILE/REFERENCE": [
            " DESCRIPTION        mor",
            f" OUTPUT             {content.project.title[:60] or 'network'}",
        ],
        "SITE/ID": list(_site_lines(found, sites, world)),
        ESTIMATE: list(_estimate_lines(found, sites)),
        f"{MATRIX} L COVA": list(_matrix_lines(found.Q)),
    }
    lines = [head]
    for title, inside in blocks.items():
        lines += [f"+{title}", *inside, f"-{title}"]
    return Written(
        {target: "\n".join([*lines, "%ENDSNX", ""]).encode("ascii", "replace")}, _notes(content, target)
    )


def _notes(content: Content, target: Path) -> list[Problem]:
    words = (
        "SINEX has estimated positions: start values, what is held and the datum are not written",
        f"SINEX does not say the reference frame, and epochs are written as not known ({_EPOCH})",
    )
    return [*not_carried(content, (_TYPE,), (), "SINEX"), *(Problem(text, str(target)) for text in words)]


def _estimates(content: Content, world: World) -> Estimates:
    """Positions of all tables; those that are in no table together are not correlated."""
    types = {**PLAIN_TYPES, **earth_types(world.horizon)}
    metres, problems = content.edge.metres, []
    for number, entry in enumerate(content.project.observations):
        if entry.type == _TYPE and (entry.cluster or entry.instrument):
            words = "SINEX has positions with one matrix, without instruments and clusters of several tables"
            problems.append(content.place("observations", number).problem(words))
    names: list[str] = []
    parts: list[tuple[FloatArray, FloatArray]] = []
    for group in [] if problems else groups(content, (_TYPE,), types):
        for rows, Q in clusters(content, group, "SINEX"):
            names += [group.rows.text("point")[row] for row in rows]
            parts.append((group.values[rows] * metres, Q))
    if not names and not problems:
        words = f"SINEX has observed positions ({_TYPE}); this project has none"
        problems.append(Problem(words, content.document.file))
    if problems:
        raise InputError(problems)
    Q, at = np.zeros((3 * len(names), 3 * len(names))), 0
    for _, own in parts:
        Q[at : at + len(own), at : at + len(own)] = own
        at += len(own)
    return Estimates(names, np.concatenate([values for values, _ in parts]), Q)


def _sites(names: list[str], file: str) -> list[str]:
    """Code, point and solution of each position in their columns.

    Raises :class:`InputError` for names that are none, and for points with several positions.
    """
    sites, problems = [], []
    for name, count in Counter(names).items():
        if count > 1:
            words = f"point {name!r} has {count} observed positions: a SINEX solution has one of a station"
            problems.append(Problem(words, file))
    for name in names:
        words_ = name.split()
        words_ = words_ if len(words_) == 3 else [name, "A", "1"]
        code, point, solution = words_
        fits = len(code) <= _CODE and len(point) <= _POINT and len(solution) <= _SOLUTION
        if not fits or set(code) & set(" \t") or not name.isascii() or not name:
            words = f"{name!r}: SINEX has codes of up to four letters (with point and solution: 'AAAA A 2')"
            problems.append(Problem(words, file))
        sites.append(f"{code:<{_CODE}} {point:>{_POINT}} {solution:>{_SOLUTION}}")
    if 3 * len(names) > MOST:
        problems.append(
            Problem(f"found {3 * len(names)} coordinates, expected up to {MOST}: the matrix is full", file)
        )
    if problems:
        raise InputError(problems)
    return sites


def _site_lines(found: Estimates, sites: list[str], world: World) -> Iterator[str]:
    """Sites with their approximate longitude (0 to 360°), latitude and height."""
    geodetic = world.system.ellipsoid.geodetic(found.values)
    for name, site, (latitude, longitude, height) in zip(found.names, sites, geodetic.tolist(), strict=True):
        angles = f"{_sexagesimal(longitude % (2 * np.pi), 3)} {_sexagesimal(latitude, 3)}"
        yield f" {site[:7]} --------- P {name:<22.22} {angles} {height:7.1f}"


def _sexagesimal(angle: float, width: int) -> str:
    tenths = round(abs(float(np.degrees(angle))) * 36_000.0)
    degrees, rest = divmod(tenths, 36_000)
    minutes, seconds = divmod(rest, 600)
    sign = "-" if angle < 0.0 else ""
    return f"{sign + str(degrees):>{width}} {minutes:2d} {seconds / 10.0:4.1f}"


def _estimate_lines(found: Estimates, sites: list[str]) -> Iterator[str]:
    sigma = np.sqrt(np.diagonal(found.Q)).reshape(-1, 3).tolist()
    index = 0
    for site, values, own in zip(sites, found.values.tolist(), sigma, strict=True):
        for axis, value, s in zip(_AXES, values, own, strict=True):
            index += 1
            yield f" {index:5d} {axis:<6} {site} {_EPOCH} m    2 {_number(value)} {s:11.5E}"


def _number(value: float) -> str:
    """All digits of a coordinate in the 21 columns of an estimate."""
    text = repr(value)
    return f"{text if len(text) <= _WIDTH else f'{value:.14E}':>{_WIDTH}}"


def _matrix_lines(Q: FloatArray) -> Iterator[str]:
    """The lower triangle, up to three values a line; parts that are 0 are left out, as the format allows."""
    for i in range(len(Q)):
        for first in range(0, i + 1, _A_LINE):
            values = Q[i, first : min(first + _A_LINE, i + 1)]
            if values.any():
                yield f" {i + 1:5d} {first + 1:5d} " + " ".join(
                    f"{value:21.14E}" for value in values.tolist()
                )
