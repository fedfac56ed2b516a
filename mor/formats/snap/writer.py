"""A network on the earth as SNAP's command file, coordinate file and data file."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.content import Content, content_of, not_carried
from mor.formats.networks.on_earth import EarthPoints, clockwise_from_north, earth_points, raised, world_of
from mor.formats.networks.terrestrial import Group, groups, tilted_stations
from mor.formats.snap.data_lines import TYPES, VECTORS, data_lines, refraction_code
from mor.formats.snap.reader import BOMFORD
from mor.formats.snap.stations import SYSTEMS
from mor.formats.written import Written
from mor.observations import PLAIN_TYPES
from mor.observations.earth import earth_types
from mor.project.file.model_instruments import Instrument, Value
from mor.project.file.nodes import Document
from mor.project.network.build import build_network
from mor.project.world.reference_system import ReferenceSystem, reference_system
from mor.project.world.world import World
from mor.units import ANGLE_UNITS, Quantity

_LONGEST = 15
"""Letters of a station's code (help of SNAP, *Station codes*)."""
_A_LINE = 10
_DEGREES, _METRES = (12, 3e-14), (9, 1e-9)
"""Decimals of coordinates, and what the way through the network takes of them."""


def write_snap(document: Document, folder: Path, target: Path) -> Written:
    """``.snp``, ``.crd`` and ``.dat``. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    world_of(content, "SNAP")
    clockwise_from_north(content, "SNAP")
    _refuse(content)
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
    texts = {
        stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()
    }
    return Written(texts, _notes(content, found, target))


def _notes(content: Content, found: list[Group], target: Path) -> list[Problem]:
    notes = not_carried(content, TYPES, ("stations", "instruments"), "SNAP")
    words = []
    if raised(content, found):
        words.append("directions are written without heights of instrument and target")
    if any(group.entry.ppm for group in found):
        words.append("σ that grow with the distance are written as they are at the observed one")
    if content.project.datum != "fixed":
        words.append("the datum of the free network has no place in SNAP's files")
    return [*notes, *(Problem(text, str(target)) for text in words)]


def _refuse(content: Content) -> None:
    project, problems = content.project, tilted_stations(content, "SNAP")
    uses = Counter(entry.instrument for entry in project.observations if entry.instrument)
    for number, entry in enumerate(project.observations):
        place = content.place("observations", number)
        if entry.type not in TYPES:
            continue
        if entry.cluster:
            problems.append(
                place.problem("SNAP has covariances of one set of vectors or positions at a time")
            )
        elif entry.covariance is not None and entry.type not in VECTORS:
            problems.append(place.problem(f"SNAP has no covariances of {entry.type}"))
        if entry.centring or (entry.ppm and "distance" not in entry.type):
            problems.append(
                place.problem("SNAP's files are written with the σ of each value, without centring")
            )
        instrument = project.instruments.get(entry.instrument) if entry.instrument else None
        if instrument is not None and not _known(instrument, entry.type, uses[str(entry.instrument)]):
            words = "of instruments SNAP has refraction of zenith angles, and a free scale of one table of distances"
            problems.append(place.problem(f"instrument {entry.instrument!r}: {words}"))
    if problems:
        raise InputError(problems)


def _known(instrument: Instrument, type_: str, uses: int) -> bool:
    """True for what SNAP can say of an instrument."""
    given = {name for name in instrument.model_fields_set if getattr(instrument, name)}
    if type_ == "zenith_angle":
        value = instrument.refraction
        return given <= {"refraction"} and not (isinstance(value, Value) and value.observed is not None)
    scale = instrument.scale
    free = given == {"scale"} and isinstance(scale, Value) and scale.free is not None
    return type_ == "distance" and uses == 1 and free


def _system(content: Content, world: World) -> str:
    """SNAP's code of the coordinate system."""
    for code, epsg in SYSTEMS.items():
        if _name(reference_system(epsg)) == _name(world.system):
            return code
    words = f"SNAP's coordinates are written in {', '.join(SYSTEMS)}, found {world.system.name}"
    raise InputError([content.place("world").problem(words)])


def _name(system: ReferenceSystem) -> tuple[str, str]:
    """Kind and name of a system, geographic ones of two and of three dimensions the same."""
    geodetic = system.crs.geodetic_crs
    plane = system.kind == "projected" or geodetic is None
    return system.kind, str(system.crs.name if plane or geodetic is None else geodetic.name)


def _check_points(points: EarthPoints, file: str) -> None:
    problems = []
    for name, held in zip(points.ids, points.held.tolist(), strict=True):
        if not name or len(name) > _LONGEST or set(name) & set(" \t!-") or name[0] in "#*&":
            words = f"SNAP's codes have up to {_LONGEST} letters, no blanks, ! and -, and do not begin with #, * or &"
            problems.append(Problem(f"{name!r}: {words}", file))
        if any(held) and not all(held):
            words = (
                f"point {name!r} is held in some components only: SNAP's files are written with all or none"
            )
            problems.append(Problem(words, file))
    twice = [name for name, count in Counter(name.upper() for name in points.ids).items() if count > 1]
    problems += [
        Problem(f"{name!r}: SNAP's codes are the same in large and small letters", file) for name in twice
    ]
    if problems:
        raise InputError(problems)


def _coordinates(points: EarthPoints, world: World) -> list[str]:
    """Options and stations; angles of coordinates in decimal degrees."""
    geographic = world.system.kind == "geographic"
    geoid, deflected = bool(np.isfinite(points.geoid).any()), bool(points.deflections.any())
    options = ["orthometric_heights" if world.orthometric else "ellipsoidal_heights"]
    options += ["geoid_heights"] if geoid else []
    options += ["deflections"] if deflected else []
    options += ["degrees"] if geographic else []
    lines = [f"options {' '.join(options)}"]
    units = np.array([np.degrees(1.0)] * 2 + [1.0]) if geographic else np.ones(3)
    digits = [_DEGREES, _DEGREES, _METRES] if geographic else [_METRES] * 3
    seconds = (points.deflections / ANGLE_UNITS["arcsec"]).tolist()
    for name, given, two, N in zip(
        points.ids,
        (points.given * units).tolist(),
        seconds,
        np.nan_to_num(points.geoid).tolist(),
        strict=True,
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
    lines += [f"fix {' '.join(held[k : k + _A_LINE])}" for k in range(0, len(held), _A_LINE)]
    used = {entry.instrument for entry in content.project.observations if entry.type == "zenith_angle"}
    for name in sorted(used, key=str):
        instrument = content.project.instruments.get(name) if name else None
        lines.append(_refraction(content, refraction_code(name), instrument))
    return lines


def _refraction(content: Content, code: str, instrument: Instrument | None) -> str:
    """A coefficient of Bomford's, which is half of ours; known, or an unknown."""
    setting = instrument.refraction if instrument is not None else None
    free = isinstance(setting, Value) and setting.free is not None
    text = (setting.free or setting.fixed) if isinstance(setting, Value) else setting
    value = content.edge.number(str(text or "0"), Quantity()) / BOMFORD
    return f"refraction_coefficient {code} {value!r}{' calculate' if free else ''}"
