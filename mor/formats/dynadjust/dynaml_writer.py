"""A network on the earth as DynaML: a pair ``…stn.xml`` and ``…msr.xml``, and ``.geo`` where heights are above a geoid.

Written as DynAdjust writes it: order and names of the elements are those of its samples and of its source.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import escape

from mor.arrays import FloatArray
from mor.formats.dynadjust.dynaml import MEASURED, ROOT, STATIONS
from mor.formats.dynadjust.outgoing import (
    EPOCH,
    Cluster,
    Directions,
    Line,
    Measurement,
    Outgoing,
    fixed,
    outgoing,
    seconds_of,
    sexagesimal_text,
)
from mor.formats.dynadjust.terrestrial import KINDS
from mor.formats.dynadjust.writer import constraints, geoid_lines, station_heights
from mor.formats.written import Written
from mor.project.file.nodes import Document

_UPPER = (("XX", 0, 0), ("XY", 0, 1), ("XZ", 0, 2), ("YY", 1, 1), ("YZ", 1, 2), ("ZZ", 2, 2))


def write_dynaml(document: Document, folder: Path, target: Path) -> Written:
    """The files. Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what they cannot say."""
    found = outgoing(document, folder, target)
    name = target.name
    for end in (STATIONS, MEASURED, ".xml"):
        name = name[: -len(end)] if name.lower().endswith(end) else name
    name = name.rstrip("._- ") or "network"
    files = {
        f"{name}{STATIONS}": _document("Station File", found.frame, _stations(found)),
        f"{name}{MEASURED}": _document(
            "Measurement File",
            found.frame,
            (text for one in found.measured for text in _measured(one, found.frame)),
        ),
    }
    if found.above:
        files[f"{name}.geo"] = geoid_lines(found.stations)
    texts = {target.with_name(file): "\n".join([*lines, ""]).encode() for file, lines in files.items()}
    return Written(texts, found.notes)


def _document(type_: str, frame: str, lines: Iterator[str]) -> list[str]:
    head = f'<{ROOT} type="{type_}" referenceframe="{frame}" epoch="{EPOCH}">'
    return ['<?xml version="1.0" encoding="UTF-8"?>', head, *lines, f"</{ROOT}>"]


def _element(name: str, text: str) -> str:
    return f"<{name}>{escape(text)}</{name}>" if text else f"<{name}/>"


def _stations(found: Outgoing) -> Iterator[str]:
    stations = found.stations
    heights = station_heights(stations, found.above)
    for name, place, height, held in zip(
        stations.ids, stations.geodetic.tolist(), heights, stations.held.tolist(), strict=True
    ):
        latitude, longitude = (sexagesimal_text(value) for value in place[:2])
        yield "  <DnaStation>"
        yield f"    {_element('Name', name)}"
        yield f"    {_element('Constraints', constraints(held))}{_element('Type', 'LLH')}"
        yield f"    <StationCoord>{_element('Name', name)}{_element('XAxis', latitude)}"
        yield f"      {_element('YAxis', longitude)}{_element('Height', f'{height:.9f}')}</StationCoord>"
        yield f"    {_element('Description', name)}"
        yield "  </DnaStation>"


def _measured(one: Measurement, frame: str) -> Iterator[str]:
    yield "  <DnaMeasurement>"
    if isinstance(one, Cluster):
        lines = _cluster(one, frame)
    elif isinstance(one, Directions):
        lines = _directions(one)
    else:
        lines = _line(one)
    yield from (f"    {line}" for line in lines)
    yield "  </DnaMeasurement>"


def _head(code: str) -> Iterator[str]:
    yield _element("Type", code)
    yield "<Ignore/>"


def _line(one: Line) -> Iterator[str]:
    yield from _head(one.code)
    for tag, name in zip(("First", "Second", "Third"), one.names, strict=False):
        yield _element(tag, name)
    if KINDS[one.code].angle:
        yield from _angle(one.value, one.sigma)
    else:
        yield _element("Value", fixed(one.value, 4))
        yield _element("StdDev", fixed(one.sigma, 3))
    if one.heights is not None:
        for tag, height in zip(("InstHeight", "TargHeight"), one.heights, strict=True):
            yield _element(tag, fixed(height, 3))


def _angle(value: float, sigma: float) -> Iterator[str]:
    yield _element("Value", sexagesimal_text(value))
    yield _element("StdDev", fixed(seconds_of(sigma), 3))


def _directions(one: Directions) -> Iterator[str]:
    yield from _head("D")
    yield _element("First", one.station)
    yield _element("Second", one.targets[0])
    yield from _angle(one.values[0], one.sigmas[0])
    yield _element("Total", str(len(one.targets) - 1))
    for target, value, sigma in zip(one.targets[1:], one.values[1:], one.sigmas[1:], strict=True):
        yield "<Directions>"
        yield f"  <Ignore/>{_element('Target', target)}"
        yield from (f"  {line}" for line in _angle(value, sigma))
        yield "</Directions>"


def _cluster(one: Cluster, frame: str) -> Iterator[str]:
    yield from _head(one.code)
    yield _element("ReferenceFrame", frame)
    yield _element("Epoch", EPOCH)
    for scale in ("Vscale", "Pscale", "Lscale", "Hscale"):
        yield _element(scale, "1.000")
    if one.code == "Y":
        yield _element("Coords", one.form)
    if one.code != "G":
        yield _element("Total", str(len(one.names)))
    member, block = (
        ("Clusterpoint", "PointCovariance") if one.code == "Y" else ("GPSBaseline", "GPSCovariance")
    )
    for k, (names, values) in enumerate(zip(one.names, one.values, strict=True)):
        for tag, name in zip(("First", "Second"), names, strict=False):
            yield _element(tag, name)
        yield f"<{member}>"
        yield from (f"  {_element(axis, value)}" for axis, value in zip("XYZ", values, strict=True))
        own = one.Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        yield from (f"  {_element(f'Sigma{pair}', f'{own[i, j]:.15e}')}" for pair, i, j in _UPPER)
        for other in range(k + 1, len(one.names)):
            yield from (
                f"  {line}" for line in _block(block, one.Q[3 * k : 3 * k + 3, 3 * other : 3 * other + 3])
            )
        yield f"</{member}>"


def _block(name: str, Q: FloatArray) -> Iterator[str]:
    """Covariances of a member (rows) with one behind it (columns)."""
    yield f"<{name}>"
    for i in range(3):
        yield "  " + "".join(_element(f"m{i + 1}{j + 1}", f"{Q[i, j]:.15e}") for j in range(3))
    yield f"</{name}>"
