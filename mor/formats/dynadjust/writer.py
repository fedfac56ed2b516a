"""Write DynAdjust files: DNA text and DynaML."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from mor.errors import InputError, Message
from mor.formats.content import Content, content_of, not_carried
from mor.formats.draft import Written
from mor.formats.dynadjust.reader import KINDS, MEASURED, ROOT, SINGLE, STATIONS, SYSTEMS
from mor.formats.networks import (
    EarthPoints,
    ObservationTable,
    SetUps,
    circle_in_face_one,
    clockwise_from_north,
    clusters,
    earth_points,
    groups,
    raised,
    tilted_stations,
    world_of,
)
from mor.model.geodetic import earth_types
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.project.network import build_network
from mor.project.reference_system import EarthModel
from mor.types import FloatArray

# ---- A network on the earth in DynAdjust's terms, for the writers of DNA and DynaML.

_CODES = {kind.type: code for code, kind in KINDS.items()}
_CLUSTERS = ("gnss_vector", "gnss_position", "geodetic_position")
EPOCH = "01.01.2020"


class SingleMeasurement(NamedTuple):
    """A measurement of its own: rad or m, its σ, heights of instrument and target (m)."""

    code: str
    names: list[str]
    value: float
    sigma: float
    heights: tuple[float, float] | None


class MeasuredDirections(NamedTuple):
    """A set: station, targets, directions and their σ (rad)."""

    station: str
    targets: list[str]
    values: list[float]
    sigmas: list[float]


class MeasurementCluster(NamedTuple):
    """A baseline (G), or members of a cluster (X, Y in XYZ or LLH); m, m², and rad of latitudes and longitudes."""

    code: str
    form: str
    names: list[list[str]]
    values: list[list[str]]
    """Three texts of each member: latitudes and longitudes as ddd.mmss…"""
    Q: FloatArray
    """(3n, 3n)."""


Measurement = SingleMeasurement | MeasuredDirections | MeasurementCluster


class Outgoing(NamedTuple):
    """All that is written."""

    frame: str
    stations: EarthPoints
    above: bool
    """True if heights are above the geoid."""
    measured: list[Measurement]
    notes: list[Message]


def outgoing(document: Document, folder: Path, target: Path) -> Outgoing:
    """Return the content of DynAdjust files for a project.

    Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what the files cannot say.
    """
    content = content_of(document, folder)
    world_of(content, "DynAdjust")
    clockwise_from_north(content, "DynAdjust")
    project, problems = content.project, tilted_stations(content, "DynAdjust")
    for number, entry in enumerate(project.observations):
        place = content.place("observations", number)
        if entry.cluster:
            problems.append(place.problem("DNA has covariances of one group of vectors or positions at a time"))
        elif entry.covariance is not None and entry.type not in _CLUSTERS:
            problems.append(place.problem(f"DNA has no covariances of {entry.type}"))
        if entry.instrument or entry.ppm or entry.centring:
            problems.append(place.problem("DNA has no instruments, ppm and centring: each value has its σ"))
    if problems:
        raise InputError(problems)
    network = build_network(content.project, document, folder)
    world = network.world
    assert world is not None
    frame = _frame(content, world)
    points = earth_points(content, network, "DNA")
    long = [name for name in points.ids if len(name) > 20 or name != name.strip()]
    if long:
        words = "names in DNA files have up to 20 letters"
        raise InputError([Message(f"{name!r}: {words}", document.file) for name in long])
    N = points.geoid_by_name if world.orthometric else {}
    kinds = (*_CODES, *_CLUSTERS, "directions")
    types = {**PLAIN_TYPES, **earth_types(world.horizon)}
    found = groups(content, kinds, types)
    set_ups = SetUps(content, points.ids)
    measured = [one for group in found for one in _measurements(content, group, N, set_ups)]
    notes = not_carried(content, kinds, ("stations",), "DynAdjust")
    notes.append(Message(f"the epoch is written as {EPOCH}: a project has none", str(target)))
    if raised(content, found):
        notes.append(Message("directions have no heights of instrument and target in DynAdjust", str(target)))
    return Outgoing(frame, points, world.orthometric, measured, notes)


def _frame(content: Content, world: EarthModel) -> str:
    geodetic = world.system.crs.geodetic_crs
    name = geodetic.name.upper() if geodetic is not None else ""
    frame = next((frame for frame in SYSTEMS if name == frame), "")
    if not frame:
        words = f"DynAdjust's files are in {' or '.join(SYSTEMS)}, found {world.system.name}"
        raise InputError([content.place("world").problem(words)])
    return frame


def _measurements(
    content: Content, group: ObservationTable, N: dict[str, float], set_ups: SetUps
) -> Iterator[Measurement]:
    if group.entry.type in _CLUSTERS:
        yield from _coordinates(group, content.edge.metres)
        yield from _clusters(content, group, N)
    elif group.entry.type == "directions":
        yield from _sets(group, set_ups)
    else:
        kind = KINDS[_CODES[group.entry.type]]
        code, metres = _CODES[kind.type], content.edge.metres
        names = [group.rows.text(name) for name in kind.names]
        heights = [np.nan_to_num(group.rows.number(f"{end}_height")) * metres for end in ("from", "to")]
        unit = 1.0 if kind.angle else metres
        for row, (value, sigma) in enumerate(zip(group.values[:, 0], group.sigma[:, 0], strict=True)):
            if np.isfinite(value):
                ends = (float(heights[0][row]), float(heights[1][row])) if kind.heights else (0.0, 0.0)
                own = [column[row] for column in names]
                yield SingleMeasurement(
                    code, own, float(value) * unit, float(sigma) * unit, ends if any(ends) else None
                )


def _coordinates(group: ObservationTable, metres: float) -> Iterator[SingleMeasurement]:
    """Latitudes (P), longitudes (Q) and ellipsoidal heights (R) of positions without their other components."""
    some = ~np.isfinite(group.values).all(axis=1) & (group.entry.type == "geodetic_position")
    names = group.rows.text("point")
    for row in np.flatnonzero(some).tolist():
        for k, code in enumerate("PQR"):
            value, sigma = (
                float(number[row, k]) * (metres if code == "R" else 1.0) for number in (group.values, group.sigma)
            )
            if np.isfinite(value):
                yield SingleMeasurement(code, [names[row]], value, sigma, None)


def _sets(group: ObservationTable, set_ups: SetUps) -> Iterator[MeasuredDirections]:
    """Sets in the order of their first sights; face two as it would read in face one."""
    rows = group.rows
    value = circle_in_face_one(group.values[:, 0], rows.number("face"))
    sets: dict[tuple[str, str], MeasuredDirections] = {}
    names = zip(rows.text("station"), rows.text("set"), rows.text("to"), strict=True)
    for row, (station, set_, to) in enumerate(names):
        if np.isfinite(value[row]):
            one = sets.setdefault((station, set_), MeasuredDirections(set_ups.point(station), [], [], []))
            one.targets.append(to)
            one.values.append(float(value[row]))
            one.sigmas.append(float(group.sigma[row, 0]))
    yield from sets.values()


def _clusters(content: Content, group: ObservationTable, N: dict[str, float]) -> Iterator[MeasurementCluster]:
    vectors, geodetic = group.entry.type == "gnss_vector", group.entry.type == "geodetic_position"
    code = "Y" if not vectors else "X" if group.entry.covariance is not None else "G"
    names = [group.rows.text(name) for name in (("from", "to") if vectors else ("point",))]
    for rows, Q in clusters(content, group, "DNA"):
        values = [_values(content, group, row, N.get(names[0][row], 0.0) if geodetic else 0.0) for row in rows]
        own = [[column[row] for column in names] for row in rows]
        yield MeasurementCluster(code, "LLH" if geodetic else "XYZ", own, values, Q)


def _values(content: Content, group: ObservationTable, row: int, N: float) -> list[str]:
    three = group.values[row].tolist()
    if group.entry.type != "geodetic_position":
        return [repr(float(value) * content.edge.metres) for value in three]
    height = three[2] * content.edge.metres - N
    return [sexagesimal_text(three[0]), sexagesimal_text(three[1]), repr(height)]


def fixed(value: float, least: int) -> str:
    """Ten decimals without the zeros at their end, but so many decimals at least."""
    whole, _, decimals = f"{value:.10f}".partition(".")
    return f"{whole}.{decimals.rstrip('0').ljust(least, '0')}"


def seconds_of(angle: float) -> float:
    """Arc seconds of an angle in radians."""
    return float(np.degrees(angle)) * 3600.0


def sexagesimal_text(angle: float) -> str:
    """ddd.mmss… of an angle in radians, seconds to ten decimals."""
    degrees, minutes, seconds, sign = parts_of(angle, 10)
    return f"{sign}{degrees}.{minutes:02d}{seconds:013.10f}".replace(".", "#", 1).replace(".", "").replace("#", ".")


def parts_of(angle: float, decimals: int) -> tuple[int, int, float, str]:
    """Degrees, minutes, seconds and the sign of an angle in radians; the seconds to so many decimals."""
    units = round(abs(seconds_of(angle)) * 10**decimals)
    minutes, rest = divmod(units, 60 * 10**decimals)
    return minutes // 60, minutes % 60, rest / 10**decimals, "-" if angle < 0.0 else ""


# ---- A network on the earth as DynAdjust's files: ``.stn``, ``.msr`` and, where heights are above a geoid, ``.geo``.


def write_dynadjust(document: Document, folder: Path, target: Path) -> Written:
    """The files. Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what DNA cannot say."""
    found = outgoing(document, folder, target)
    stem = target.with_suffix("") if target.suffix.lower() in (".stn", ".msr") else target
    head = f"!#=DNA 3.01 {{}}    {EPOCH}{found.frame:>14}    {EPOCH}{{:>10}}"
    measured = [line for one in found.measured for line in _measurement_lines(one, found.frame)]
    files = {
        ".stn": [head.format("STN", len(found.stations.ids)), *_station_lines(found.stations, found.above)],
        ".msr": [head.format("MSR", len(found.measured)), *measured],
    }
    if found.above:
        files[".geo"] = geoid_lines(found.stations)
    texts = {stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()}
    return Written(texts, found.notes)


def station_heights(stations: EarthPoints, above: bool) -> list[float]:
    """Heights of stations as the files have them, m."""
    heights = stations.geodetic[:, 2] - (np.nan_to_num(stations.geoid) if above else 0.0)
    return [float(height) for height in heights]


def constraints(held: list[bool]) -> str:
    """DynAdjust's letters (latitude, longitude, height) of what is held of east, north, up."""
    return "".join("FC"[int(held[k])] for k in (1, 0, 2))


def _station_lines(stations: EarthPoints, above: bool) -> Iterator[str]:
    heights = station_heights(stations, above)
    for name, place, height, held in zip(stations.ids, stations.geodetic, heights, stations.held.tolist(), strict=True):
        latitude, longitude = (sexagesimal_text(value) for value in place[:2].tolist())
        yield f"{name:<20}{constraints(held)} LLH {latitude:>20}{longitude:>20}{height:>20.9f}"


def geoid_lines(stations: EarthPoints) -> list[str]:
    """The file of geoid heights (m) and deflections (arc seconds)."""
    lines = ["# DNA geoid file."]
    for name, N, (xi, eta) in zip(
        stations.ids, np.nan_to_num(stations.geoid).tolist(), stations.deflections.tolist(), strict=True
    ):
        angles = "".join(f"{fixed(seconds_of(angle), 3):>19}" for angle in (xi, eta))
        lines.append(f"{name:<20}{fixed(N, 3):>20}{angles}")
    return lines


def _measurement_lines(one: Measurement, frame: str) -> Iterator[str]:
    if isinstance(one, MeasurementCluster):
        scales, count = "   1.00      1.00      1.00      1.00", len(one.names)
        for k, (names, values) in enumerate(zip(one.names, one.values, strict=True)):
            second = one.form if one.code == "Y" else names[1]
            head = f"{one.code} {names[0]:<20}{second:<20}" + (f"{count:<20}" if one.code != "G" else "")
            yield f"{head:<62}{scales}{frame:>20}{EPOCH:>20}" if k == 0 else f"{head[:42]:<62}"
            for i in range(3):
                covariances = "".join(f"{v:20.13e}" for v in one.Q[3 * k + i, 3 * k : 3 * k + i + 1])
                yield f"{'':<62}{values[i]:>20}{covariances}"
            for other in range(k + 1, count):
                for i in range(3):
                    block = one.Q[3 * k + i, 3 * other : 3 * other + 3]
                    yield f"{'':<82}" + "".join(f"{v:20.13e}" for v in block)
    elif isinstance(one, MeasuredDirections):
        angles = [_angle(value, sigma) for value, sigma in zip(one.values, one.sigmas, strict=True)]
        yield f"D {one.station:<20}{one.targets[0]:<20}{len(angles) - 1:<20}{angles[0]}"
        for target, angle in zip(one.targets[1:], angles[1:], strict=True):
            yield f"D {'':<40}{target:<20}{angle}"
    else:
        yield _plain_line(one)


def _plain_line(one: SingleMeasurement) -> str:
    head = f"{one.code} " + "".join(f"{name:<20}" for name in one.names)
    if SINGLE[one.code].angle:
        text = _angle(one.value, one.sigma)
    else:
        text = f"{fixed(one.value, 4):>14} {fixed(one.sigma, 3):>22}"
    if one.heights is not None:
        text += "".join(f" {fixed(height, 3):>6}" for height in one.heights)
    return f"{head:<62}{text}"


def _angle(value: float, sigma: float) -> str:
    degrees, minutes, seconds, sign = parts_of(value, 8)
    return f"{f'{sign}{degrees}':>17} {minutes:02d} {fixed(seconds, 4):0>7} {fixed(seconds_of(sigma), 3):>8}"


# ---- A network on the earth as DynaML: a pair ``…stn.xml`` and ``…msr.xml``, and ``.geo`` where heights are above
# a geoid.
#
# Written as DynAdjust writes it: order and names of the elements are those of its samples and of its source.


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
            "Measurement File", found.frame, (text for one in found.measured for text in _measured(one, found.frame))
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
    if isinstance(one, MeasurementCluster):
        lines = _cluster(one, frame)
    elif isinstance(one, MeasuredDirections):
        lines = _directions(one)
    else:
        lines = _line(one)
    yield from (f"    {line}" for line in lines)
    yield "  </DnaMeasurement>"


def _head(code: str) -> Iterator[str]:
    yield _element("Type", code)
    yield "<Ignore/>"


def _line(one: SingleMeasurement) -> Iterator[str]:
    yield from _head(one.code)
    for tag, name in zip(("First", "Second", "Third"), one.names, strict=False):
        yield _element(tag, name)
    if SINGLE[one.code].angle:
        yield from _dynaml_writer_angle(one.value, one.sigma)
    else:
        yield _element("Value", fixed(one.value, 4))
        yield _element("StdDev", fixed(one.sigma, 3))
    if one.heights is not None:
        for tag, height in zip(("InstHeight", "TargHeight"), one.heights, strict=True):
            yield _element(tag, fixed(height, 3))


def _dynaml_writer_angle(value: float, sigma: float) -> Iterator[str]:
    yield _element("Value", sexagesimal_text(value))
    yield _element("StdDev", fixed(seconds_of(sigma), 3))


def _directions(one: MeasuredDirections) -> Iterator[str]:
    yield from _head("D")
    yield _element("First", one.station)
    yield _element("Second", one.targets[0])
    yield from _dynaml_writer_angle(one.values[0], one.sigmas[0])
    yield _element("Total", str(len(one.targets) - 1))
    for target, value, sigma in zip(one.targets[1:], one.values[1:], one.sigmas[1:], strict=True):
        yield "<Directions>"
        yield f"  <Ignore/>{_element('Target', target)}"
        yield from (f"  {line}" for line in _dynaml_writer_angle(value, sigma))
        yield "</Directions>"


def _cluster(one: MeasurementCluster, frame: str) -> Iterator[str]:
    yield from _head(one.code)
    yield _element("ReferenceFrame", frame)
    yield _element("Epoch", EPOCH)
    for scale in ("Vscale", "Pscale", "Lscale", "Hscale"):
        yield _element(scale, "1.000")
    if one.code == "Y":
        yield _element("Coords", one.form)
    if one.code != "G":
        yield _element("Total", str(len(one.names)))
    member, block = ("Clusterpoint", "PointCovariance") if one.code == "Y" else ("GPSBaseline", "GPSCovariance")
    upper = (("XX", 0, 0), ("XY", 0, 1), ("XZ", 0, 2), ("YY", 1, 1), ("YZ", 1, 2), ("ZZ", 2, 2))
    for k, (names, values) in enumerate(zip(one.names, one.values, strict=True)):
        for tag, name in zip(("First", "Second"), names, strict=False):
            yield _element(tag, name)
        yield f"<{member}>"
        yield from (f"  {_element(axis, value)}" for axis, value in zip("XYZ", values, strict=True))
        own = one.Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        yield from (f"  {_element(f'Sigma{pair}', f'{own[i, j]:.15e}')}" for pair, i, j in upper)
        for other in range(k + 1, len(one.names)):
            yield from (f"  {line}" for line in _block(block, one.Q[3 * k : 3 * k + 3, 3 * other : 3 * other + 3]))
        yield f"</{member}>"


def _block(name: str, Q: FloatArray) -> Iterator[str]:
    yield f"<{name}>"
    for i in range(3):
        yield "  " + "".join(_element(f"m{i + 1}{j + 1}", f"{Q[i, j]:.15e}") for j in range(3))
    yield f"</{name}>"
