"""SINEX files: read and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import InputError, Message
from mor.formats.content import Content, content_of, not_carried
from mor.formats.draft import Draft, Row, Written, parse_number, read_lines
from mor.formats.networks import clusters, groups, world_of
from mor.model.geodetic import earth_types
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.project.network import build_network
from mor.project.reference_system import EarthModel
from mor.types import FloatArray

# ---- Blocks of a SINEX file: the estimated parameters, and the matrix of their covariances.
#
# Source: *SINEX - Solution (Software/technique) Independent Exchange Format*, version 2.02 (IERS, 2006): blocks
# SOLUTION/ESTIMATE and SOLUTION/MATRIX_ESTIMATE.

ESTIMATE, MATRIX, APRIORI = "SOLUTION/ESTIMATE", "SOLUTION/MATRIX_ESTIMATE", "SOLUTION/MATRIX_APRIORI"
MOST = 4_000
"""Most parameters of a file: its matrix is full."""


class SinexBlock(NamedTuple):
    """Lines of a block with their numbers, and what its first line says behind its name."""

    kind: list[str]
    line: int
    rows: list[tuple[int, list[str]]]


class Parameter(NamedTuple):
    """An estimated parameter."""

    type: str
    site: str
    """Code, point and solution of the station."""
    epoch: str
    value: float
    sigma: float
    line: int


def blocks_of(lines: list[str], draft: Draft) -> dict[str, SinexBlock]:
    """Blocks by their names; a block that does not end, or is there twice, is a mistake."""
    found: dict[str, SinexBlock] = {}
    name = ""
    for line, text in enumerate(lines[1:], start=2):
        words = text[1:].split()
        if text.startswith("+") and words:
            if name:
                draft.problem(f"block {name} does not end before the next begins", line)
            name = words[0].upper()
            if name in found:
                draft.problem(f"block {name} is there twice", line)
            found[name] = SinexBlock([word.upper() for word in words[1:]], line, [])
        elif text.startswith("-") and words:
            if words[0].upper() != name:
                draft.problem(f"found the end of {words[0]}, expected that of {name or 'no block'}", line)
            name = ""
        elif name and text.strip() and not text.startswith("*"):
            found[name].rows.append((line, text.split()))
    if name:
        draft.problem(f"block {name} does not end: the file is cut off", len(lines))
    return found


def parameters_of(block: SinexBlock, draft: Draft) -> dict[int, Parameter]:
    """Estimated parameters by their numbers."""
    found: dict[int, Parameter] = {}
    for line, words in block.rows:
        with draft.at(line):
            if len(words) != 10:
                raise ValueError(f"found {len(words)} words, expected the 10 of an estimate")
            index, type_, code, point, solution, epoch, unit, _, value, sigma = words
            if not index.isdecimal() or not index.isascii() or not 0 < int(index) <= MOST:
                raise ValueError(f"found the parameter {index!r}, expected a number from 1 to {MOST}")
            if int(index) in found:
                raise ValueError(f"parameter {index} is there twice")
            if type_.upper() in ("STAX", "STAY", "STAZ") and unit.lower() != "m":
                raise ValueError(f"found the unit {unit!r} of {type_}, expected m")
            site = " ".join((code, point, solution))
            values = parse_number(value.replace("D", "E")), parse_number(sigma.replace("D", "E"))
            found[int(index)] = Parameter(type_.upper(), site, epoch, *values, line)
    return found


def matrix_of(block: SinexBlock, parameters: dict[int, Parameter], draft: Draft) -> FloatArray | None:
    """Covariances (n, n) in the order of the numbers of the parameters; ``None`` if there is a mistake."""
    place = {index: k for k, index in enumerate(sorted(parameters))}
    kind = block.kind
    if len(kind) != 2 or kind[0] not in ("L", "U") or kind[1] not in ("CORR", "COVA", "INFO"):
        draft.problem(f"found {' '.join(kind)!r}, expected L or U, and CORR, COVA or INFO", block.line)
        return None
    M, good = np.zeros((len(place), len(place))), True
    for line, words in block.rows:
        try:
            if not 3 <= len(words) <= 5 or not all(word.isdecimal() and word.isascii() for word in words[:2]):
                raise ValueError("expected the numbers of two parameters and up to three values")
            row, first = int(words[0]), int(words[1])
            for column, word in enumerate(words[2:], start=first):
                if row not in place or column not in place:
                    raise ValueError(f"parameter {column if row in place else row} is not among the estimates")
                if (column > row) if kind[0] == "L" else (column < row):
                    raise ValueError(f"found row {row}, column {column}, expected the other triangle ({kind[0]})")
                M[place[row], place[column]] = M[place[column], place[row]] = parse_number(word.replace("D", "E"))
        except ValueError as error:
            draft.problem(str(error), line)
            good = False
    return _covariances(M, kind[1], block, draft) if good else None


def _covariances(M: FloatArray, kind: str, block: SinexBlock, draft: Draft) -> FloatArray | None:
    if kind == "CORR":  # correlations, and σ on the diagonal
        sigma = np.diagonal(M).copy()
        np.fill_diagonal(M, 1.0)
        M = M * np.outer(sigma, sigma)
    scale = np.sqrt(np.abs(np.diagonal(M)))
    if not np.isfinite(M).all() or not (scale > 0.0).all():
        draft.problem("a parameter has no variance in the matrix", block.line)
        return None
    least = np.linalg.eigvalsh(M / np.outer(scale, scale))[0]
    if not least > 1e-13:
        words = "is not positive definite"
        if kind == "INFO":
            words = "is singular: the solution has no datum, and positions cannot be had of it"
        draft.problem(f"the matrix {words}", block.line)
        return None
    if kind != "INFO":
        return M
    return np.asarray(np.linalg.inv(M / np.outer(scale, scale)) / np.outer(scale, scale))


# ---- A SINEX file as a project on the earth: positions of all stations, observed with their full covariance matrix.

_AXES = ("STAX", "STAY", "STAZ")


def read_sinex(path: Path) -> Document:
    """The project of a SINEX file. Raises :class:`InputError`."""
    draft = Draft(str(path))
    lines = read_lines(path, draft)
    if not lines or not lines[0].startswith("%=SNX"):
        words = f"found {(lines[0] if lines else '')[:30]!r}, expected %=SNX in the first line"
        raise InputError([Message(words, str(path), 1)])
    blocks = blocks_of(lines, draft)
    for name in (ESTIMATE, MATRIX):
        if name not in blocks:
            draft.problem(f"there is no block {name}", 1)
    if draft.problems:
        return draft.finish()
    parameters = parameters_of(blocks[ESTIMATE], draft)
    Q = None if draft.problems else matrix_of(blocks[MATRIX], parameters, draft)
    if Q is not None:
        _put(draft, parameters, Q)
        _tell(draft, parameters, APRIORI in blocks)
    return draft.finish()


def _put(draft: Draft, parameters: dict[int, Parameter], Q: FloatArray) -> None:
    """Stations as free points that begin where they were estimated, and their observed positions."""
    order = sorted(parameters)
    sites: dict[str, dict[str, int]] = {}
    for place, index in enumerate(order):
        found = parameters[index]
        if found.type in _AXES:
            axes = sites.setdefault(found.site, {})
            if found.type in axes:
                draft.problem(f"{found.type} of station {found.site!r} is there twice", found.line)
            axes[found.type] = place
    names = _names(list(sites))
    rows, places = [], []
    for site, axes in sites.items():
        line = parameters[order[next(iter(axes.values()))]].line
        if len(axes) < 3:
            draft.problem(f"station {site!r} has {', '.join(axes)} alone, expected STAX, STAY and STAZ", line)
            continue
        places += [axes[axis] for axis in _AXES]
        values = [repr(parameters[order[axes[axis]]].value) for axis in _AXES]
        rows.append(Row([names[site], *values], line))
    if not rows:
        draft.problem("no station has an estimated position", 1)
        return
    draft.put("units", {"length": "m", "angle": "deg"})
    # Geocentric axes: what a SINEX file says of its frame.
    system = "+proj=geocent +ellps=GRS80 +units=m +type=crs"
    draft.put("world", {"crs": system}, 1)
    draft.table("points", ("id", "x", "y", "z"), rows)
    covariance = Q[np.ix_(places, places)]
    draft.table("observations", ("point", "x", "y", "z"), rows, type="gnss_position", covariance=covariance.tolist())


def _names(sites: list[str]) -> dict[str, str]:
    codes = [site.split()[0] for site in sites]
    return {site: code if codes.count(code) == 1 else site for site, code in zip(sites, codes, strict=True)}


def _tell(draft: Draft, parameters: dict[int, Parameter], apriori: bool) -> None:
    words = "does not say its reference frame: coordinates are taken as geocentric, heights above GRS80"
    draft.note(f"SINEX {words}; name it in world: {{crs: …}}", 1)
    others = [found for found in parameters.values() if found.type not in _AXES]
    if others:
        types = ", ".join(dict.fromkeys(found.type for found in others))
        draft.note(f"not read: {len(others)} parameters ({types}); positions keep their covariances", others[0].line)
    epochs = list(dict.fromkeys(found.epoch for found in parameters.values() if found.type in _AXES))
    if len(epochs) > 1:
        draft.note(f"positions are of {len(epochs)} epochs ({epochs[0]}, {epochs[1]}, …), taken as they are", 1)
    if apriori:
        draft.note("a-priori constraints of the solution stay in its covariances", 1)


# ---- Observed positions of a project on the earth as a SINEX file: estimates with their covariance matrix.
#
# Source: *SINEX - Solution (Software/technique) Independent Exchange Format*, version 2.02 (IERS, 2006). An
# epoch that is not known is 00:000:00000 there.

_TYPE = "gnss_position"
_EPOCH = "00:000:00000"


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
        problems.append(Message(words, content.document.file))
    if problems:
        raise InputError(problems)
    Q, at = np.zeros((3 * len(names), 3 * len(names))), 0
    for _, own in parts:
        Q[at : at + len(own), at : at + len(own)] = own
        at += len(own)
    found = Estimates(names, np.concatenate([values for values, _ in parts]), Q)
    sites = _sites(found.names, document.file)
    count = 3 * len(found.names)
    name = "MOR"
    head = f"%=SNX 2.02 {name} {_EPOCH} {name} {_EPOCH} {_EPOCH} P {count:05d} 2 S"
    blocks = {
        "FILE/REFERENCE": [" DESCRIPTION        mor", f" OUTPUT             {content.project.title[:60] or 'network'}"],
        "SITE/ID": list(_site_lines(found, sites, world)),
        ESTIMATE: list(_estimate_lines(found, sites)),
        f"{MATRIX} L COVA": list(_matrix_lines(found.Q)),
    }
    lines = [head]
    for title, inside in blocks.items():
        lines += [f"+{title}", *inside, f"-{title}"]
    return Written({target: "\n".join([*lines, "%ENDSNX", ""]).encode("ascii", "replace")}, _notes(content, target))


def _notes(content: Content, target: Path) -> list[Message]:
    words = (
        "SINEX has estimated positions: start values, what is held and the datum are not written",
        f"SINEX does not say the reference frame, and epochs are written as not known ({_EPOCH})",
    )
    return [*not_carried(content, (_TYPE,), (), "SINEX"), *(Message(text, str(target)) for text in words)]


def _sites(names: list[str], file: str) -> list[str]:
    """Code, point and solution of each position in their columns.

    Raises :class:`InputError` for names that are none, and for points with several positions.
    """
    sites, problems = [], []
    for name, count in Counter(names).items():
        if count > 1:
            words = f"point {name!r} has {count} observed positions: a SINEX solution has one of a station"
            problems.append(Message(words, file))
    # Letters of the code of a site, of its point, of the solution.
    letters_of_code, letters_of_point, letters_of_solution = 4, 2, 4
    for name in names:
        words_ = name.split()
        words_ = words_ if len(words_) == 3 else [name, "A", "1"]
        code, point, solution = words_
        fits = len(code) <= letters_of_code and len(point) <= letters_of_point and len(solution) <= letters_of_solution
        if not fits or set(code) & set(" \t") or not name.isascii() or not name:
            words = f"{name!r}: SINEX has codes of up to four letters (with point and solution: 'AAAA A 2')"
            problems.append(Message(words, file))
        sites.append(f"{code:<{letters_of_code}} {point:>{letters_of_point}} {solution:>{letters_of_solution}}")
    if 3 * len(names) > MOST:
        problems.append(Message(f"found {3 * len(names)} coordinates, expected up to {MOST}: the matrix is full", file))
    if problems:
        raise InputError(problems)
    return sites


def _site_lines(found: Estimates, sites: list[str], world: EarthModel) -> Iterator[str]:
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
    text = repr(value)
    width = 21
    return f"{text if len(text) <= width else f'{value:.14E}':>{width}}"


def _matrix_lines(Q: FloatArray) -> Iterator[str]:
    """The lower triangle, up to three values a line; parts that are 0 are left out, as the format allows."""
    a_line = 3
    for i in range(len(Q)):
        for first in range(0, i + 1, a_line):
            values = Q[i, first : min(first + a_line, i + 1)]
            if values.any():
                yield f" {i + 1:5d} {first + 1:5d} " + " ".join(f"{value:21.14E}" for value in values.tolist())
