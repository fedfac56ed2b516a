"""A STAR*NET input file (``.dat``) as a project: plane or local spatial networks.

Codes C E B A D V DV M BM L SS, sets DB DN DM DE, traverses TB T TE; GNSS vectors and positions on the ellipsoid are
left out and told. σ that a line does not give are those of STAR*NET's own project options, which stand in another file.
Source: MicroSurvey, *STAR*NET Reference Manual*, chapter 5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from mor.counting import counted
from mor.formats.draft import Draft, Row
from mor.formats.starnet import measurements, sets
from mor.formats.starnet.lines import STATUSES, Line, read_lines
from mor.formats.starnet.measurements import need
from mor.formats.starnet.network import COLUMNS, Network
from mor.formats.text import read_lines as text_lines
from mor.project.file.nodes import Document


def read_starnet(path: Path) -> Document:
    """The project of a STAR*NET input file. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    lines = list(read_lines(text_lines(path, draft)))
    network = Network(draft, plane=_is_plane(lines))
    for line in lines:
        try:
            _read(line, network)
        except ValueError as error:
            draft.problem(f"{line.code}: {error}", line.number)
    _finish(network, path.stem)
    return draft.finish()


def _is_plane(lines: Sequence[Line]) -> bool:
    """True for a plane network: as .2D or .3D say, or where no line has a zenith angle or a height.

    A name with two coordinates has at most two σ behind them; more words, or a third number alone, are a height.
    """
    for line in lines:
        if line.code in (".2D", ".3D"):
            return line.code == ".2D"
    return not any(
        line.code in ("V", "DV", "E", "L")
        or (line.code == "M" and _count(line) > 3)
        or (line.code == "C" and (len(line.words) > 5 or len(line.words) == _count(line) == 4))
        for line in lines
    )


def _count(line: Line) -> int:
    return len([word for word in line.words if word not in STATUSES])


def _read(line: Line, network: Network) -> None:
    code = line.code
    if code.startswith("."):
        _option(code[1:], [word.upper() for word in line.words], line.number, network)
    elif code in _CODES:
        _CODES[code](line, network)
    elif code in ("G0", "G1", "G2", "G3", "G4", "P", "PH", "EH", "CH"):
        network.skip("GNSS vectors and positions on the ellipsoid", line.number)
    else:
        raise ValueError(f"unknown code, expected one of {', '.join(_CODES)}")


def _option(name: str, words: list[str], line: int, network: Network) -> None:
    if name == "UNITS":
        for word in words:
            if word in ("METERS", "METRES", "FEET", "USFEET", "FEETUS"):
                network.metres = {"F": 0.3048, "U": 1200.0 / 3937.0, "M": 1.0}[word[0]]
                network.metres = 1200.0 / 3937.0 if word == "FEETUS" else network.metres
            elif word in ("GONS", "DMS"):
                network.gon = word == "GONS"
            else:
                raise ValueError(f"found the unit {word}, expected METERS, FEET, USFEET, DMS or GONS")
    elif name == "ORDER":
        for word in words:
            if word in ("EN", "NE"):
                network.east_first = word == "EN"
            elif word in ("ATFROMTO", "FROMATTO"):
                network.from_first = word == "FROMATTO"
            else:
                raise ValueError(f"found {word}, expected NE, EN, ATFROMTO or FROMATTO")
    elif name == "DELTA":
        network.delta = words[:1] == ["ON"]
    elif name == "DATA":
        network.skip("lines after .DATA OFF are read all the same", line)
    elif name in ("SEP", "SEPARATOR") and words:
        network.separator = words[0][:1]
    elif name not in ("1D", "2D", "3D"):
        network.skip(f".{name}", line)


def _coordinates(line: Line, network: Network) -> None:
    need(line, 3, "name, north, east, elevation, and their σ")
    name, *rest = line.words
    values: list[float] = []
    while rest and rest[0] not in STATUSES and len(values) < (2 if network.plane else 3):
        values.append(network.length(rest.pop(0)))
    if len(values) < 2:
        raise ValueError("found no north and east")
    marks = [_status(word, network) for word in rest[: len(values)]]
    marks += [None] * (3 - len(marks))
    first, second = (0, 1) if network.east_first else (1, 0)
    texts = [repr(values[first]), repr(values[second]), repr(values[2]) if len(values) > 2 else None]
    network.points[name] = (texts, [marks[first], marks[second], marks[2]], line.number)


def _status(word: str, network: Network) -> str | None:
    if word == "!":
        return "0"
    if word in ("*", "&"):
        return None
    value = network.length(word)
    if value < 0.0:
        raise ValueError(f"found the σ {word}, expected 0 or more, ! or *")
    return repr(value)


def _elevation(line: Line, network: Network) -> None:
    need(line, 2, "name, elevation and its σ")
    texts, sigma, _ = network.points.get(line.words[0], ([None] * 3, [None] * 3, 0))
    mark = _status(line.words[2], network) if len(line.words) > 2 else None
    place = [*texts[:2], repr(network.length(line.words[1]))]
    network.points[line.words[0]] = (place, [*sigma[:2], mark], line.number)


_CODES: dict[str, Callable[[Line, Network], None]] = {
    "C": _coordinates,
    "E": _elevation,
    "B": measurements.bearing,
    "A": measurements.angle,
    "D": measurements.distance,
    "V": measurements.vertical,
    "DV": measurements.distance_and_vertical,
    "M": measurements.measured,
    "SS": measurements.measured,
    "BM": measurements.bearing_measured,
    "L": measurements.levelled,
    "DB": sets.begin_set,
    "DN": sets.direction,
    "DM": sets.direction,
    "DE": sets.end_set,
    **dict.fromkeys(("TB", "T", "TE"), sets.traverse),
}
"""What reads the lines of each code."""


def _finish(network: Network, title: str) -> None:
    draft = network.draft
    heights = {"height_difference", "zenith_angle", "distance"} & set(network.tables)
    flat = {"angle", "bearing", "directions", "horizontal_distance"} & set(network.tables)
    dimensions = "xyz" if heights and (flat or "distance" in network.tables) else "z" if heights else "xy"
    dimensions = dimensions if network.tables or network.plane else "xyz"
    draft.put("title", title)
    draft.put("units", {"length": "m", "angle": "deg"})
    draft.put("axes", {"xy": "en", "angles": "clockwise", "bearings_from": "north"})
    rows = [
        Row([name, *texts, *(s if t is not None else None for s, t in zip(sigma, texts, strict=True))], line)
        for name, (texts, sigma, line) in network.points.items()
    ]
    if rows:
        columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
        draft.table("points", columns, rows)
    for type_, found in network.tables.items():
        draft.table("observations", COLUMNS[type_], found, type=type_)
    if not network.tables and not rows:
        draft.problem("there are no points and no observations")
    draft.put("settings", {"dimensions": dimensions})
    for what, lines in network.skipped.items():
        draft.note(f"not read: {what} ({counted(len(lines), 'line')})", lines[0])
    if network.defaults:
        words = f"{counted(network.defaults, 'observation')} without σ: 4″ for angles, 10″ for zenith angles, 2 mm"
        draft.note(f"{words} for distances; the project options of STAR*NET stand in another file")
