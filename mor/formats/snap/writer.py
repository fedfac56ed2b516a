"""Write SNAP files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import InputError, Message
from mor.formats.content import Content, content_of, not_carried
from mor.formats.draft import Written
from mor.formats.networks import (
    EarthPoints,
    ObservationTable,
    SetUps,
    circle_in_face_one,
    clockwise_from_north,
    clusters,
    earth_points,
    groups,
    heights_of,
    raised,
    tilted_stations,
    world_of,
)
from mor.formats.snap.observations import KINDS, PROJECTIONS, SYSTEMS, DataKind
from mor.formats.snap.reader import BOMFORD
from mor.model.geodetic import earth_types
from mor.model.observation_types import PLAIN_TYPES
from mor.project.document import Document
from mor.project.network import build_network
from mor.project.reference_system import EarthModel, ReferenceSystem, reference_system
from mor.project.schema import Instrument, Value
from mor.types import FloatArray, pieces
from mor.units import ANGLE_UNITS, Quantity

# ---- Observations of a project as lines of a SNAP data file: angles and their σ in decimal degrees, lengths in metres.

VECTORS = ("gnss_vector", "gnss_position")
TYPES = tuple(dict.fromkeys(kind.type for kind in KINDS.values()))


class Writing(NamedTuple):
    """Settings that the lines of all tables share."""

    content: Content
    set_ups: SetUps
    projection: str
    """Name of the projection of the project, or nothing."""


def data_lines(content: Content, found: list[ObservationTable], points: list[str], projection: str) -> list[str]:
    """All observations. Raises :class:`InputError` for what SNAP cannot say."""
    writing = Writing(content, SetUps(content, points), projection)
    lines = ["#deg_angles", "#gps_error_type full"]
    for group in found:
        lines += _of_group(writing, group)
    return lines


def _of_group(writing: Writing, group: ObservationTable) -> Iterator[str]:
    type_ = group.entry.type
    if type_ in VECTORS:
        yield from _gnss(writing, group)
    elif type_ == "geodetic_position":
        yield from _positions(writing, group)
    elif type_ == "directions":
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
    elif type_ == "distance" and group.entry.instrument:
        yield from _ratios(writing, group)
    else:
        yield from _scalars(writing, group)


def _degrees(angle: float) -> str:
    return repr(float(np.degrees(angle)))


def _texts(group: ObservationTable, kind: DataKind, row: int, metres: float) -> str:
    """Value and σ."""
    value, sigma = float(group.values[row, 0]), float(group.sigma[row, 0])
    if kind.angular:
        return f"{_degrees(value)} {_degrees(sigma)}"
    return f"{value * metres!r} {sigma * metres!r}"


def _heights(writing: Writing, group: ObservationTable, references: dict[str, str], row: int) -> tuple[float, float]:
    if group.entry.type not in ("distance", "zenith_angle", "height_difference"):
        return 0.0, 0.0
    return heights_of(group, references, row, {}, writing.content.edge.metres)


def _scalars(writing: Writing, group: ObservationTable) -> Iterator[str]:
    codes = {kind.type: code for code, kind in KINDS.items() if code != "DR"}
    code = codes[group.entry.type]
    kind = KINDS[code]
    ends = ("point",) if kind.point else ("from", "to")
    names = [group.rows.text(name) for name in ends]
    rows = np.flatnonzero(np.isfinite(group.values[:, 0])).tolist()
    heights = {
        row: _heights(writing, group, {end: column[row] for end, column in zip(ends, names, strict=True)}, row)
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
    return instrument.removeprefix("refraction ").replace(" ", "_").upper() if instrument else "NONE"


def _projection(writing: Writing, group: ObservationTable) -> str:
    given = (group.entry.projection or "").upper()
    name = next((name for name, code in PROJECTIONS.items() if code == given), "")
    if not name and not given:
        name = writing.projection
    if not name:
        words = f"SNAP's projections are those of New Zealand, found {group.entry.projection or 'that of the world'}"
        raise InputError([writing.content.place("observations").problem(words)])
    return name


def _ratios(writing: Writing, group: ObservationTable) -> Iterator[str]:
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


def _positions(writing: Writing, group: ObservationTable) -> Iterator[str]:
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


def _gnss(writing: Writing, group: ObservationTable) -> Iterator[str]:
    """Vectors and positions: alone with their covariances, clusters as sets with their matrix."""
    code = "GB" if group.entry.type == "gnss_vector" else "GX"
    alone = group.entry.covariance is None
    for number, (rows, Q) in enumerate(clusters(writing.content, group, "SNAP")):
        heights = [
            heights_of(group, {}, row, {}, writing.content.edge.metres) if code == "GB" else (0.0, 0.0) for row in rows
        ]
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


def _ends(writing: Writing, group: ObservationTable, row: int) -> list[str]:
    names = ("from", "to") if group.entry.type == "gnss_vector" else ("point",)
    return [group.rows.text(name)[row] for name in names]


def _three(writing: Writing, group: ObservationTable, row: int) -> str:
    return " ".join(repr(float(value) * writing.content.edge.metres) for value in group.values[row])


def _set(
    writing: Writing, group: ObservationTable, rows: list[int], heights: list[tuple[float, float]]
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
    for i in range(len(Q)):
        row = [repr(float(value)) for value in Q[i, : i + 1]]
        for piece in pieces(len(row), 6):
            yield " ".join(row[piece])


# ---- A network on the earth as SNAP's command file, coordinate file and data file.


def write_snap(document: Document, folder: Path, target: Path) -> Written:
    """``.snp``, ``.crd`` and ``.dat``. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    world_of(content, "SNAP")
    clockwise_from_north(content, "SNAP")
    project, problems = content.project, tilted_stations(content, "SNAP")
    uses = Counter(entry.instrument for entry in project.observations if entry.instrument)
    for number, entry in enumerate(project.observations):
        place = content.place("observations", number)
        if entry.type not in TYPES:
            continue
        if entry.cluster:
            problems.append(place.problem("SNAP has covariances of one set of vectors or positions at a time"))
        elif entry.covariance is not None and entry.type not in VECTORS:
            problems.append(place.problem(f"SNAP has no covariances of {entry.type}"))
        if entry.centring or (entry.ppm and "distance" not in entry.type):
            problems.append(place.problem("SNAP's files are written with the σ of each value, without centring"))
        instrument = project.instruments.get(entry.instrument) if entry.instrument else None
        if instrument is not None and not _known(instrument, entry.type, uses[str(entry.instrument)]):
            words = "of instruments SNAP has refraction of zenith angles, and a free scale of one table of distances"
            problems.append(place.problem(f"instrument {entry.instrument!r}: {words}"))
    if problems:
        raise InputError(problems)
    network = build_network(content.project, document, folder)
    world = network.world
    assert world is not None
    system = _system(content, world)
    points = earth_points(content, network, "SNAP")
    _check_points(points, document.file)
    found = groups(content, TYPES, {**PLAIN_TYPES, **earth_types(world.horizon)})
    projection = system if world.system.kind == "projected" else ""
    title = " ".join((content.project.title or "network").replace("!", ".").split())
    stem = target.with_suffix("") if target.suffix.lower() in (".snp", ".crd", ".dat") else target
    files = {
        ".snp": [f"title {title}", *_commands(content, points, stem.name)],
        ".crd": [title, system, *_coordinates(points, world)],
        ".dat": [title, *data_lines(content, found, points.ids, projection)],
    }
    texts = {stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()}
    return Written(texts, _notes(content, found, target))


def _notes(content: Content, found: list[ObservationTable], target: Path) -> list[Message]:
    notes = not_carried(content, TYPES, ("stations", "instruments"), "SNAP")
    words = []
    if raised(content, found):
        words.append("directions are written without heights of instrument and target")
    if any(group.entry.ppm for group in found):
        words.append("σ that grow with the distance are written as they are at the observed one")
    if content.project.datum != "fixed":
        words.append("SNAP's files cannot store the datum of a free network")
    return [*notes, *(Message(text, str(target)) for text in words)]


def _known(instrument: Instrument, type_: str, uses: int) -> bool:
    """True for what SNAP can say of an instrument."""
    given = {name for name in instrument.model_fields_set if getattr(instrument, name)}
    if type_ == "zenith_angle":
        value = instrument.refraction
        return given <= {"refraction"} and not (isinstance(value, Value) and value.observed is not None)
    scale = instrument.scale
    free = given == {"scale"} and isinstance(scale, Value) and scale.free is not None
    return type_ == "distance" and uses == 1 and free


def _system(content: Content, world: EarthModel) -> str:
    for code, epsg in SYSTEMS.items():
        if _name(reference_system(epsg)) == _name(world.system):
            return code
    words = f"SNAP's coordinates are written in {', '.join(SYSTEMS)}, found {world.system.name}"
    raise InputError([content.place("world").problem(words)])


def _name(system: ReferenceSystem) -> tuple[str, str]:
    geodetic = system.crs.geodetic_crs
    plane = system.kind == "projected" or geodetic is None
    return system.kind, str(system.crs.name if plane or geodetic is None else geodetic.name)


def _check_points(points: EarthPoints, file: str) -> None:
    problems = []
    # Letters of a station's code (help of SNAP, *Station codes*).
    longest = 15
    for name, held in zip(points.ids, points.held.tolist(), strict=True):
        if not name or len(name) > longest or set(name) & set(" \t!-") or name[0] in "#*&":
            words = f"SNAP's codes have up to {longest} letters, no blanks, ! and -, and do not begin with #, * or &"
            problems.append(Message(f"{name!r}: {words}", file))
        if any(held) and not all(held):
            words = f"point {name!r} is held in some components only: SNAP's files are written with all or none"
            problems.append(Message(words, file))
    twice = [name for name, count in Counter(name.upper() for name in points.ids).items() if count > 1]
    problems += [Message(f"{name!r}: SNAP's codes are the same in large and small letters", file) for name in twice]
    if problems:
        raise InputError(problems)


def _coordinates(points: EarthPoints, world: EarthModel) -> list[str]:
    """Options and stations; angles of coordinates in decimal degrees."""
    geographic = world.system.kind == "geographic"
    geoid, deflected = bool(np.isfinite(points.geoid).any()), bool(points.deflections.any())
    options = ["orthometric_heights" if world.orthometric else "ellipsoidal_heights"]
    options += ["geoid_heights"] if geoid else []
    options += ["deflections"] if deflected else []
    options += ["degrees"] if geographic else []
    lines = [f"options {' '.join(options)}"]
    units = np.array([np.degrees(1.0)] * 2 + [1.0]) if geographic else np.ones(3)
    # Decimals of coordinates, and what the way through the network takes of them.
    degrees, metres = (12, 3e-14), (9, 1e-9)
    digits = [degrees, degrees, metres] if geographic else [metres] * 3
    seconds = (points.deflections / ANGLE_UNITS["arcsec"]).tolist()
    for name, given, two, N in zip(
        points.ids, (points.given * units).tolist(), seconds, np.nan_to_num(points.geoid).tolist(), strict=True
    ):
        place = [_plain(value, *own) for value, own in zip(given, digits, strict=True)]
        numbers = [*place, *(two if deflected else []), *([N] if geoid else [])]
        lines.append(f"{name} {' '.join(map(repr, numbers))}")
    return lines


def _plain(value: float, decimals: int, lost: float) -> float:
    """A number of so many decimals where it is one but for what it lost on the way through the network."""
    rounded = round(value, decimals)
    return rounded if abs(rounded - value) < lost else value


def _commands(content: Content, points: EarthPoints, stem: str) -> list[str]:
    held = [name for name, three in zip(points.ids, points.held.tolist(), strict=True) if all(three)]
    lines = [f"coordinate_file {stem}.crd", f"data_file {stem}.dat"]
    lines.append(f"mode 3d {'adjustment' if held else 'free_net'}")
    lines += [f"fix {' '.join(held[piece])}" for piece in pieces(len(held), 10)]
    used = {entry.instrument for entry in content.project.observations if entry.type == "zenith_angle"}
    for name in sorted(used, key=str):
        instrument = content.project.instruments.get(name) if name else None
        # A coefficient of Bomford's, which is half of ours; known, or an unknown.
        setting = instrument.refraction if instrument is not None else None
        free = isinstance(setting, Value) and setting.free is not None
        text = (setting.free or setting.fixed) if isinstance(setting, Value) else setting
        value = content.edge.number(str(text or "0"), Quantity()) / BOMFORD
        lines.append(f"refraction_coefficient {refraction_code(name)} {value!r}{' calculate' if free else ''}")
    return lines
