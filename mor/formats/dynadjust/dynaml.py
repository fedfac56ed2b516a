"""DynaML, DynAdjust's XML: the same stations and measurements as in its DNA files, an element each.

Source: *DynAdjust User's Guide*, appendix on DynaML. Angles and latitudes are ddd.mmssss…, σ of angles seconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.errors import InputError, Problem
from mor.formats.draft import Row, number
from mor.formats.dynadjust.clusters import COUNTED, put_cluster, scale_of
from mor.formats.dynadjust.directions import CODE, Sight, put_set
from mor.formats.dynadjust.lines import OFF, Collected
from mor.formats.dynadjust.stations import Station
from mor.formats.dynadjust.terrestrial import KINDS, LEFT_OUT
from mor.formats.fieldbook.book import sexagesimal
from mor.formats.xml import Element, parse_xml
from mor.input_files import PROJECT, read_bytes

ROOT = "DnaXmlFormat"
STATIONS, MEASURED = "stn.xml", "msr.xml"
_UPPER = ("XX", "XY", "XZ", "YY", "YZ", "ZZ")
_SCALES = ("Vscale", "Pscale", "Lscale", "Hscale")


def pair_of(path: Path) -> tuple[Path, Path, str]:
    """Files of stations and measurements, by one of them, and what both names begin with."""
    for end in (STATIONS, MEASURED):
        if path.name.lower().endswith(end):
            name = path.name[: -len(end)]
            return _beside(path, name, STATIONS), _beside(path, name, MEASURED), name.rstrip("._- ")
    words = f"found the name {path.name!r}, expected one that ends in {STATIONS} or {MEASURED}, as DynaML's pairs do"
    raise InputError([Problem(words, str(path))])


def _beside(path: Path, name: str, end: str) -> Path:
    places = [path.with_name(f"{name}{form}") for form in (end, end.upper(), end.capitalize())]
    return next((place for place in places if place.is_file()), places[0])


def root_of(path: Path) -> Element:
    """Root element of a file. Raises :class:`InputError` if it is none of DynaML."""
    if not path.is_file():
        words = f"this file does not exist; DynaML has a pair of …{STATIONS} and …{MEASURED}"
        raise InputError([Problem(words, str(path))])
    root = parse_xml(read_bytes(path, PROJECT), str(path))
    if root.name != ROOT:
        raise InputError([Problem(f"found <{root.name}>, expected <{ROOT}>", str(path), root.line)])
    return root


def stations_of_xml(path: Path) -> Iterator[Station]:
    """Stations of a file. Raises :class:`InputError` if it is none of DynaML."""
    for element in root_of(path).all("DnaStation"):
        place = next(iter(element.all("StationCoord")), element)
        values = [_text(place, name) for name in ("XAxis", "YAxis", "Height")]
        held, kind = _text(element, "Constraints").upper(), _text(element, "Type").upper()
        zone = _text(place, "HemisphereZone").lstrip("SsNn")
        yield Station(_text(element, "Name"), held, kind, values, zone, element.line)


def read_measurement(found: Collected, element: Element) -> None:
    """One measurement. Raises ``ValueError`` with words."""
    code = _text(element, "Type").upper()
    if _is_off(element):
        found.skip(OFF, element.line)
    elif code in ("G", "X", "Y"):
        _read_cluster(found, element, code)
    elif code == CODE:
        _read_directions(found, element)
    elif code in KINDS:
        _read_line(found, element, code)
    elif code in LEFT_OUT:
        found.skip(LEFT_OUT[code], element.line)
    else:
        known = ", ".join(sorted(["G", "X", "Y", CODE, *KINDS, *LEFT_OUT]))
        raise ValueError(f"found the measurement {code!r}, expected one of {known}")


def _read_line(found: Collected, element: Element, code: str) -> None:
    kind = KINDS[code]
    names = [_text(element, name) for name in ("First", "Second", "Third")[: len(kind.names)]]
    found.known(names, element.line)
    value, sigma = _needed(element, "Value"), _needed(element, "StdDev")
    if kind.angle:
        value = _sexagesimal(value)
    number(sigma)
    heights = [_text(element, name) or None for name in ("InstHeight", "TargHeight")]
    if kind.heights and None in heights and any(heights):
        raise ValueError("found one of InstHeight and TargHeight, expected both or none")
    cells = [*names, value, sigma, *(heights if kind.heights else [])]
    found.tables.setdefault(code, []).append(Row(cells, element.line))


def _read_directions(found: Collected, element: Element) -> None:
    """A set of directions: the first target, then an element for each other."""
    sights = [_sight(element, _text(element, "Second"))]
    sights += [_sight(child, _text(child, "Target")) for child in element.all("Directions")]
    said = _text(element, "Total") or str(len(sights) - 1)
    put_set(found, _text(element, "First"), sights, said, off=False)


def _sight(element: Element, target: str) -> Sight:
    value, sigma = _sexagesimal(_needed(element, "Value")), _needed(element, "StdDev")
    number(sigma)
    return Sight(target, value, sigma, element.line, _is_off(element))


def _is_off(element: Element) -> bool:
    return any(child.text.strip() not in ("", "0") for child in element.all("Ignore"))


def _sexagesimal(text: str) -> str:
    """ddd.mmssss… as d-m-s, all its digits kept. Raises ``ValueError``."""
    sexagesimal(text)
    whole, _, fraction = text.lstrip("+-").partition(".")
    fraction = fraction.ljust(4, "0")
    seconds = f"{fraction[2:4]}.{fraction[4:]}".rstrip(".")
    return f"{'-' if text.startswith('-') else ''}{whole or '0'}-{fraction[:2]}-{seconds}"


def _read_cluster(found: Collected, element: Element, code: str) -> None:
    """A baseline, or members of a cluster, each after its names, with the covariances with the members behind it."""
    form = _text(element, "Coords").upper() or "XYZ"
    if code == "Y" and form not in ("XYZ", "LLH"):
        raise ValueError(f"found positions in {form!r}, expected XYZ or LLH")
    rows, members = _members(found, element, code)
    count = len(rows)
    said = _text(element, "Total") if code in "XY" else "1"
    if not 0 < count <= COUNTED or (said and said != str(count)):
        raise ValueError(f"found {count} members of the cluster, expected {said or 'at least one'}")
    Q = np.zeros((3 * count, 3 * count))
    for k, member in enumerate(members):
        _covariances(member, Q, k)
    factor = scale_of([number(_text(element, name) or "1") for name in _SCALES])
    if not isfinite(factor * float(np.abs(Q).max())):
        raise ValueError("found a covariance that is no finite number after scaling")
    words = f"{_text(element, 'ReferenceFrame')} {_text(element, 'Epoch')}".strip()
    found.frames.setdefault(words, element.line)
    put_cluster(found, code, form, rows, Q * factor)


def _members(found: Collected, element: Element, code: str) -> tuple[list[Row], list[Element]]:
    """Names and values of each member, and its element; names stand before the member they belong to."""
    rows, members = [], []
    names = {"First": "", "Second": ""}
    for child in element.children:
        if child.name in names:
            names[child.name] = child.text.strip()
        elif child.name in ("GPSBaseline", "Clusterpoint"):
            own = list(names.values())[: 1 if code == "Y" else 2]
            values = [_needed(child, name) for name in "XYZ"]
            for value in values:
                number(value)
            rows.append(Row([*found.known(own, child.line), *values], child.line))
            members.append(child)
    return rows, members


def _covariances(member: Element, Q: FloatArray, k: int) -> None:
    """Covariances of a member, and with those behind it, into the lower triangle."""
    a, count = 3 * k, len(Q) // 3
    for name in _UPPER:
        i, j = sorted("XYZ".index(letter) for letter in name)
        Q[a + j, a + i] = number(_needed(member, f"Sigma{name}"))
    blocks = [child for child in member.children if child.name in ("GPSCovariance", "PointCovariance")]
    if len(blocks) != count - k - 1:
        words = f"found {len(blocks)} blocks of covariances, expected {count - k - 1}"
        raise ValueError(f"member {k + 1} of the cluster (line {member.line}): {words}")
    for other, block in enumerate(blocks, start=k + 1):
        for row in range(3):
            cells = [number(_needed(block, f"m{row + 1}{column}")) for column in (1, 2, 3)]
            Q[3 * other : 3 * other + 3, a + row] = cells


def _text(element: Element, name: str) -> str:
    return next((child.text.strip() for child in element.all(name)), "")


def _needed(element: Element, name: str) -> str:
    text = _text(element, name)
    if not text:
        raise ValueError(f"found no {name} (line {element.line})")
    return text
