"""A SNAP adjustment: its command file, or its coordinate file with the data file of the same name."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from mor.errors import InputError, Message, nearest
from mor.formats.draft import Draft, Row
from mor.formats.snap.observations import (
    DEFAULT,
    Data,
    Stations,
    Words,
    lines_of,
    put_observations,
    read_data,
    read_stations,
)
from mor.project.document import Document

BOMFORD = 2.0
"""mor's coefficient of refraction per one of Bomford's, which SNAP has."""
_USUAL = 0.075
_OUTPUT = (
    "list",
    "output_csv",
    "add_residual_column",
    "summarize_errors_by",
    "summarise_errors_by",
    "error_type",
    "output_coordinate_file",
    "residual_format",
    "define_residual_format",
    "output_precision",
    "number_of_worst_residuals",
    "max_iterations",
    "min_iterations",
    "convergence_tolerance",
    "max_adjustment",
    "plot",
    "flag_significance",
    "redundancy_flag_level",
    "file_location_frequency",
    "sort_observations",
    "sort_stations",
    "output",
    "coordinate_precision",
    "spec_confidence",
    "specification",
    "test_specification",
)
"""Commands that say what SNAP writes and when it stops."""


@dataclass
class _Commands:
    title: str = ""
    stations: Path = Path()
    data: list[Path] = field(default_factory=list)
    mode: str = "adjustment"
    fixed: dict[str, int] = field(default_factory=dict)
    free: dict[str, int] = field(default_factory=dict)
    refraction: dict[str, tuple[float, bool]] = field(default_factory=dict)
    """Coefficients by code, and whether they are unknowns."""
    usual: float = _USUAL


def read_snap(path: Path) -> Document:
    """The project of a command file ``.snp``, or of a pair ``.crd`` and ``.dat`` by one of them, all stations free.

    Raises :class:`InputError`.
    """
    draft = Draft(str(path))
    pair = path.suffix.lower() in (".crd", ".dat")
    commands = _pair(path, draft) if pair else _commands(path, draft)
    stations = read_stations(commands.stations, draft)
    draft.put("title", commands.title or stations.title)
    draft.put("units", {"length": "m", "angle": "deg"})
    heights = "orthometric" if stations.orthometric and stations.geoid else "ellipsoidal"
    draft.put("world", {"crs": stations.crs, "heights": heights}, 1)
    data = Data(draft, stations)
    for file in commands.data:
        read_data(file, data)
    _put_refraction(data, commands)
    put_observations(data)
    if not draft.data.get("observations") and not draft.problems:
        draft.problem("there are no observations that are followed")
    _put_stations(data, commands)
    for what, (count, line, file_name) in data.left_out.items():
        draft.note(f"not read: {what} ({count})", line, file_name)
    return draft.finish()


def _pair(path: Path, draft: Draft) -> _Commands:
    ends = {end: [path.with_suffix(end), path.with_suffix(end.upper())] for end in (".crd", ".dat")}
    found = {end: next((p for p in places if p.is_file()), places[0]) for end, places in ends.items()}
    draft.note("without a command file (.snp) all stations are free", 1)
    return _Commands(stations=found[".crd"], data=[found[".dat"]], mode="free_net")


def _commands(path: Path, draft: Draft) -> _Commands:
    found = _Commands()
    ignored: dict[str, int] = {}
    for line in lines_of(path, draft):
        if not line.words:
            continue
        words = Words(line.words)
        name = words.take("a command").lower()
        try:
            if not _command(found, path, name, words, line.number) and name not in _OUTPUT:
                ignored.setdefault(name, line.number)
        except ValueError as error:
            draft.problem(str(error), line.number)
    for name, first in ignored.items():
        draft.problem(f"command {name!r} is not followed", first)
    if found.stations == Path() or not found.data:
        words_ = "expected the commands coordinate_file and data_file"
        raise InputError([*draft.problems, Message(words_, str(path), 1)])
    return found


def _command(found: _Commands, path: Path, name: str, words: Words, line: int) -> bool:
    """Follow a command; False if it is not one of these."""
    if name == "title":
        while words:
            found.title = f"{found.title} {words.take('')}".strip()
    elif name in ("coordinate_file", "data_file"):
        file = path.parent / words.take("the name of a file")
        while words:
            raise ValueError(f"found {words.peek()!r} behind the name of the file, which is not followed")
        if name == "data_file":
            found.data.append(file)
        else:
            found.stations = file
    elif name == "mode":
        _mode(found, words)
    elif name in ("fix", "free"):
        _fix(found, name, words, line)
    elif name in ("refraction_coefficient", "default_refraction_coefficient"):
        code = words.take("a code").upper() if name[0] == "r" else ""
        if name[0] == "r" and words.skip("calculate"):
            found.refraction[code] = (found.refraction.get(code, (found.usual, False))[0], True)
            return True
        value = words.number("a coefficient")
        if code:
            found.refraction[code] = (value, words.skip("calculate"))
        else:
            found.usual = value
    else:
        return False
    return True


def _mode(found: _Commands, words: Words) -> None:
    while words:
        word = words.take("a mode").lower()
        if word in ("adjustment", "adjust", "data_check", "free_net", "free_net_adjustment"):
            found.mode = word
        elif word != "3d":
            raise ValueError(
                f"mode {word} is not followed, expected 3d with adjustment, data_check or free_net"
            )


def _fix(found: _Commands, name: str, words: Words, line: int) -> None:
    while words:
        word = words.take("a station")
        if word.lower() in ("automatically", "horizontal", "vertical") or "=" in word:
            raise ValueError(f"{name} {word} is not followed, expected stations or all")
        if word.lower() == "3d":
            continue
        chosen, other = (found.fixed, found.free) if name == "fix" else (found.free, found.fixed)
        chosen[word.upper()] = line
        other.pop(word.upper(), None)


def _put_refraction(data: Data, commands: _Commands) -> None:
    instruments: dict[str, object] = {}
    for code in sorted(data.refractions):
        usual = 0.0 if code == "ZERO" else commands.refraction.get(DEFAULT, (commands.usual, False))[0]
        value, free = commands.refraction.get(code, (usual, False))
        said = repr(BOMFORD * value)
        instruments[f"refraction {code}"] = {"refraction": {"free": said} if free else said}
    for code, name, _ in data.tables:
        if code == "DR":
            instruments[name] = {"scale": {"free": "1"}}
    if instruments:
        data.draft.put("instruments", instruments)


def _put_stations(data: Data, commands: _Commands) -> None:
    """Stations that are observed: held, or free."""
    stations, draft = data.stations, data.draft
    known = {name.upper() for name in stations.by_name}
    for name, line in [*commands.fixed.items(), *commands.free.items()]:
        if name != "ALL" and name not in known:
            draft.problem(f"station {name!r} is not in {stations.path.name}{nearest(name, known)}", line)
    tables: dict[bool, list[Row]] = {True: [], False: []}
    for name in stations.by_name:
        if name in data.names:
            tables[_held(commands, name)].append(_row(stations, name))
    own = stations.system.coordinates
    columns = ["id", *own, "geoid", "deflection_north", "deflection_east"]
    units = {name: "deg" for name in own if name in ("latitude", "longitude")}
    units |= dict.fromkeys(columns[-2:], "arcsec") if stations.deflections else {}
    for held, rows in tables.items():
        if rows:
            fixed = ["x", "y", "z"] if held else []
            draft.table("points", columns, rows, str(stations.path), units=units or None, fixed=fixed)


def _held(commands: _Commands, name: str) -> bool:
    if commands.mode == "data_check":
        return True
    if commands.mode.startswith("free_net"):
        return False
    key = name.upper()
    return key in commands.fixed or ("ALL" in commands.fixed and key not in commands.free)


def _row(stations: Stations, name: str) -> Row:
    given = stations.by_name[name]
    deflection = map(repr, given.deflection) if stations.deflections else [None, None]
    return Row([name, *map(repr, given.place), repr(given.N), *deflection], given.line)
