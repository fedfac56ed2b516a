"""A SNAP adjustment: its command file, or its coordinate file with the data file of the same name."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from mor.errors import InputError, Message
from mor.formats.draft import Draft, Row
from mor.formats.snap.delimited import Definition, definition_of
from mor.formats.snap.observations import (
    DEFAULT,
    Data,
    Recode,
    StationFile,
    WordReader,
    lines_of,
    merge_stations,
    period_of,
    put_observations,
    read_data,
    read_delimited,
    read_stations,
    recodes_of,
    selection_of,
    station_list,
    tie_recoded,
)
from mor.project.document import Document

BOMFORD = 2.0
"""mor's coefficient of refraction per one of Bomford's, which SNAP has."""
_OUTPUT = (
    *("list", "output_csv", "add_residual_column", "summarize_errors_by", "summarise_errors_by"),
    *("summarize_residuals_by", "summarise_residuals_by", "error_type", "output_coordinate_file", "residual_format"),
    *("define_residual_format", "output_precision", "number_of_worst_residuals", "max_iterations", "min_iterations"),
    *("convergence_tolerance", "max_adjustment", "plot", "flag_significance", "redundancy_flag_level"),
    *("file_location_frequency", "sort_observations", "sort_stations", "output", "coordinate_precision"),
    *("spec_confidence", "specification", "test_specification", "reorder_stations", "use_zero_inverse"),
    *("station_code_width", "mde_power", "magic_number"),
)
"""Commands that say what SNAP writes, how it solves and when it stops."""
_OBSERVATION_COMMANDS = (
    "ignore_observations",
    "reject_observations",
    "reweight_observations",
    "classification",
    "set_observation_option",
)


class _Command(NamedTuple):
    """A command that needs the stations, with the errors of float that hold for it."""

    name: str
    words: list[str]
    line: int
    file: str
    float_errors: tuple[float, float]


class _DataFile(NamedTuple):
    """A data file with the factor of its σ and its file of recodes."""

    path: Path
    scale: float = 1.0
    recodes: Path | None = None
    form: Definition | None = None
    """Of a delimited file."""


@dataclass
class _Commands:
    title: str = ""
    stations: Path = Path()
    form: Definition | None = None
    """Of these stations, if their file is delimited."""
    added: list[tuple[Path, set[str], Definition | None, int, str]] = field(default_factory=list)
    """More coordinate files, what is taken from them, and the line and file of their commands."""
    data: list[_DataFile] = field(default_factory=list)
    mode: str = "adjustment"
    dimensions: str = "3d"
    """Heights are held in 2d, plan coordinates in 1d."""
    later: list[_Command] = field(default_factory=list)
    """Commands about stations and observations, in their order."""
    float_errors: tuple[float, float] = (1.0, 1.0)
    refraction: dict[str, tuple[float, bool]] = field(default_factory=dict)
    """Coefficients by code, and whether they are unknowns."""
    usual: float = 0.075
    sigmas: dict[str, tuple[float | None, float | None]] = field(default_factory=dict)
    """σ (m) of stations, horizontal and vertical: 0 where they are fixed, nothing where they are free."""


def read_snap(path: Path) -> Document:
    """The project of a command file ``.snp``, or of a pair ``.crd`` and ``.dat`` by one of them, all stations free.

    Raises :class:`InputError`.
    """
    draft = Draft(str(path))
    pair = path.suffix.lower() in (".crd", ".dat")
    commands = _pair(path, draft) if pair else _commands(path, draft)
    stations = read_stations(commands.stations, draft, commands.form)
    for file_path, parts, form, line, command_file in commands.added:
        with draft.at(line, command_file):
            merge_stations(stations, file_path, parts, draft, form)
    draft.put("title", commands.title or stations.title)
    draft.put("units", {"length": "m", "angle": "deg"})
    heights = "orthometric" if stations.orthometric and stations.geoid else "ellipsoidal"
    draft.put("world", {"crs": stations.crs, "heights": heights}, 1)
    data = Data(draft, stations)
    for command in commands.later:
        with draft.at(command.line, command.file):
            # Follow a command about stations or observations. Raises ``ValueError``.
            words, name = WordReader(command.words), command.name
            if name == "recode":
                _recode(data, words)
            elif name == "ignore_missing_stations":
                codes = {word.upper() for word in command.words if word.lower()[:7] != "report_"}
                if not codes or "YES" in codes:
                    codes |= {"*"}
                data.missing = set() if codes == {"NO"} else data.missing | codes
            elif name in _OBSERVATION_COMMANDS:
                _select(data, name, words)
            elif name in ("reject", "ignore", "accept"):
                chosen = station_list(words, data.stations)
                codes = {one.upper() for one in data.stations.by_name if chosen(one)}
                data.excluded = data.excluded - codes if name == "accept" else data.excluded | codes
            else:
                _fix(commands, data, command)
    for file in commands.data:
        if file.form is None:
            read_data(file.path, data, file.scale, file.recodes)
        else:
            read_delimited(file.path, data, file.form, file.scale, file.recodes)
    _put_instruments(data, commands)
    if commands.mode.startswith("adjust"):  # SNAP rejects stations without enough data
        draft.put("settings", {"undetermined": "leave_out"})
    tie_recoded(data)
    put_observations(data)
    if not draft.data.get("observations") and not draft.problems:
        draft.problem("there are no supported observations")
    _put_stations(data, commands)
    for what, (count, line, file_name) in data.left_out.items():
        draft.note(f"not read: {what} ({count})", line, file_name)
    return draft.finish()


def _pair(path: Path, draft: Draft) -> _Commands:
    ends = {end: [path.with_suffix(end), path.with_suffix(end.upper())] for end in (".crd", ".dat")}
    found = {end: next((p for p in places if p.is_file()), places[0]) for end, places in ends.items()}
    draft.note("without a command file (.snp) all stations are free", 1)
    return _Commands(stations=found[".crd"], data=[_DataFile(found[".dat"])], mode="free_net")


def _commands(path: Path, draft: Draft) -> _Commands:
    found = _Commands()
    ignored: dict[str, tuple[int, str]] = {}
    _read_commands(found, path, draft, ignored, [])
    # Hints for commands that are known but not supported.
    reasons = {
        "geoid": "the grid is not part of mor; write its heights into the coordinate file (geoid_heights)",
        "deformation": "stations that move are not read; give data of one time",
        "reference_frame": "its parameters are not read; add a frame to the project",
        "gps_antenna_height": "write heights of antennas into the data file",
        "configuration": "write its commands into this file",
        "station_offset_file": "give data of the mark itself",
    }
    for name, (first, file) in ignored.items():
        reason = f": {reasons[name]}" if name in reasons else ""
        draft.problem(f"command {name!r} is not supported{reason}", first, file)
    if found.stations == Path() or not found.data:
        words_ = "expected the commands coordinate_file and data_file"
        raise InputError(draft.problems or [Message(words_, str(path), 1)])
    return found


def _read_commands(
    found: _Commands, path: Path, draft: Draft, ignored: dict[str, tuple[int, str]], above: list[Path]
) -> None:
    """Commands of a file and of those that it includes."""
    if path in above:
        raise InputError([Message("this file includes itself", str(path))])
    places = [file.parent for file in (path, *reversed(above))]
    for line in lines_of(path, draft, quoted=True):
        if not line.words:
            continue
        words = WordReader(line.words)
        name = words.take("a command").lower()
        with draft.at(line.number, str(path)):
            if name == "include":
                file = _file_of(words, path)
                _read_commands(found, file, draft, ignored, [*above, path])
            elif name in (
                *("fix", "free", "float", "reject", "ignore", "accept"),
                *_OBSERVATION_COMMANDS,
                "recode",
                "ignore_missing_stations",
            ):
                found.later.append(_Command(name, line.words[1:], line.number, str(path), found.float_errors))
            elif name == "add_coordinate_file" or (name == "coordinate_file" and found.stations != Path()):
                if found.stations == Path() and not draft.problems:
                    raise ValueError("expected the command coordinate_file before add_coordinate_file")
                file, parts = _added(path, name, words)
                form = _form(words, places, "stn", draft)
                _end(words)
                found.added.append((file, parts, form, line.number, str(path)))
            elif not _command(found, path, name, words, places, draft) and name not in _OUTPUT:
                ignored.setdefault(name, (line.number, str(path)))


def _file_of(words: WordReader, path: Path) -> Path:
    return path.parent / words.take("the name of a file").strip("\"'")


def _added(path: Path, name: str, words: WordReader) -> tuple[Path, set[str]]:
    """Another coordinate file, and what is taken from it: of another coordinate_file its new stations."""
    parts = {"stations"} if name == "coordinate_file" else set()
    kinds_of_parts = ("coordinates", "classes", "existing_classes", "stations")
    while name == "add_coordinate_file" and not words.skip("from"):
        part = words.take("from").lower()
        if part == "epoch":
            words.take("a date")
        elif part in kinds_of_parts:
            parts.add(part)
        else:
            raise ValueError(f"found {part!r}, expected {', '.join(kinds_of_parts)} or from")
    if not parts:
        raise ValueError(f"found no option before from, expected {', '.join(kinds_of_parts)}")
    return _file_of(words, path), parts


def _form(words: WordReader, places: list[Path], usual: str, draft: Draft) -> Definition | None:
    """The definition behind the word csv; it stands beside the command file, or one that includes it."""
    if not words.skip("csv"):
        return None
    options = {}
    while "=" in words.peek():
        key, _, value = words.take("an option").partition("=")
        options[key.lower()] = value.strip("\"'")
    name = f"{options.pop('format', usual)}.dtf"
    files = [place / name for place in places]
    return definition_of(next((file for file in files if file.is_file()), files[0]), options, draft)


def _end(words: WordReader) -> None:
    if words:
        raise ValueError(f"found {words.rest()!r} behind the name of the file: only SNAP's own form and csv are read")


def _factor(words: WordReader) -> float:
    factor = words.number("a factor")
    if not factor > 0.0:
        raise ValueError(f"found the factor {factor:g}, expected one above 0")
    return factor


def _command(found: _Commands, path: Path, name: str, words: WordReader, places: list[Path], draft: Draft) -> bool:
    if name == "title":
        found.title = words.rest()
    elif name in ("coordinate_file", "data_file"):
        file = _file_of(words, path)
        form = _form(words, places, "stn" if name[0] == "c" else "obs", draft)
        data_file = _DataFile(file, form=form)
        while name == "data_file" and words.peek().lower() in ("error_factor", "recode"):
            if words.skip("error_factor"):
                data_file = data_file._replace(scale=_factor(words))
            elif words.skip("recode"):
                data_file = data_file._replace(recodes=_file_of(words, path))
        _end(words)
        if name == "data_file":
            found.data.append(data_file)
        else:
            found.stations, found.form = file, form
    elif name == "mode":
        while words:
            word = words.take("a mode").lower()
            if word in ("adjustment", "adjust", "data_check", "free_net", "free_net_adjustment"):
                found.mode = word
            elif word in ("1d", "2d", "3d"):
                found.dimensions = word
            else:
                raise ValueError(
                    f"mode {word} is not supported, expected 1d, 2d or 3d with adjustment, data_check or free_net"
                )
    elif name in ("horizontal_float_error", "vertical_float_error"):
        value, (horizontal, vertical) = words.number("an error"), found.float_errors
        if not value > 0.0:
            raise ValueError(f"found {value:g}, expected an error above 0")
        found.float_errors = (value, vertical) if name[0] == "h" else (horizontal, value)
    elif name == "deformation":
        return words.peek().lower() == "none"
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


def _recode(data: Data, words: WordReader) -> None:
    code = words.take("the code of a station").upper()
    if code == "FILE":
        data.recodes += recodes_of(_file_of(words, data.stations.path))
        return
    suffix = words.take("a suffix") if code == "SUFFIX" else ""
    if not suffix and not words.skip("to"):
        raise ValueError(f"found {words.peek()!r}, expected to")
    new = suffix or words.take("the new code")
    sigma = None
    if words.skip("hv_error"):
        sigma = _errors(words)
        if not min(sigma) > 0.0:
            raise ValueError("expected one or two errors above 0 and m behind hv_error")
    words.skip("disconnected")
    period = period_of(words)
    codes = [code]
    if suffix and words.skip("for"):
        chosen = station_list(words, data.stations)
        codes = [name for name in data.stations.by_name if chosen(name)]
    if words:
        raise ValueError(f"found {words.peek()!r}, expected before, after or between and dates")
    for one in codes:
        renamed = f"{one}{suffix}" if suffix else new
        data.stations.recoded.add(renamed.upper())
        data.recodes.append(Recode(one.upper(), renamed, period, sigma))


def _select(data: Data, name: str, words: WordReader) -> None:
    if name == "classification":
        key, factor = words.take("a classification"), 1.0
        if words.skip("ignore") or words.skip("reject"):
            factor = 0.0
        criterion = WordReader([f"{key}={words.take('a value')}"])
        if words.skip("error_factor"):
            factor *= words.number("a factor")
        data.selections.append(selection_of(criterion, factor, data.stations))
        return
    factor, errors, kind = 0.0, (0.0, 0.0), ""
    if name == "set_observation_option":
        kind, option = "translation", words.take("an option").lower()
        if option.removeprefix("no_") != "calculate_gx_translation":
            raise ValueError(f"found the option {option!r}, expected calculate_gx_translation")
        factor = float(option[:3] != "no_")
    elif name == "reweight_observations":
        if words.peek().lower() in ("by_set", "offset_error", "centroid_error"):
            kind = words.take("a criterion").lower()
        if kind[-6:] == "_error":
            errors = _errors(words)
        else:
            factor = _factor(words)
    if not words and kind != "translation":
        raise ValueError("the line ends where a criterion is expected, e.g. data_type=SD")
    found = selection_of(words, factor, data.stations)
    data.selections.append(found._replace(kind=kind, errors=errors))


def _errors(words: WordReader) -> tuple[float, float]:
    """One or two errors in metres, horizontal and vertical."""
    horizontal = words.number("an error")
    vertical = horizontal if words.peek().lower() == "m" else words.number("an error")
    if not words.skip("m") or min(horizontal, vertical) < 0.0:
        raise ValueError("expected one or two errors of 0 or more and m")
    return horizontal, vertical


def _fix(commands: _Commands, data: Data, command: _Command) -> None:
    """``fix``, ``float`` and ``free``: σ of stations, horizontal and vertical."""
    words = WordReader(command.words)
    if words.skip("automatically"):
        raise ValueError(f"{command.name} automatically is not supported, expected stations or all")
    kept, parts = [], (True, True)
    while words:
        word = words.take("a station")
        if word.lower() in ("horizontal", "vertical", "3d"):
            parts = (word.lower() != "vertical", word.lower() != "horizontal")
        else:
            kept.append(word)
    chosen = station_list(WordReader(kept), data.stations)
    sigma: tuple[float | None, float | None] = (None, None)
    if command.name != "free":
        sigma = (0.0, 0.0) if command.name == "fix" else command.float_errors
    for name in data.stations.by_name:
        if chosen(name):
            old = commands.sigmas.get(name, (None, None))
            commands.sigmas[name] = (sigma[0] if parts[0] else old[0], sigma[1] if parts[1] else old[1])


def _put_instruments(data: Data, commands: _Commands) -> None:
    instruments: dict[str, object] = {}
    for code in sorted(data.refractions):
        usual = 0.0 if code == "ZERO" else commands.refraction.get(DEFAULT, (commands.usual, False))[0]
        value, free = commands.refraction.get(code, (usual, False))
        said = repr(BOMFORD * value)
        instruments[f"refraction {code}"] = {"refraction": {"free": said} if free else said}
    for code, name, _ in data.tables:
        if code == "DR":
            instruments[name] = {"scale": {"free": "1"}}
    for number in range(1, len(data.translated) + 1):
        shift = {f"shift_{axis}": {"free": "0"} for axis in "xyz"}
        instruments[f"translation {number}"] = {"frame": shift}
    if instruments:
        data.draft.put("instruments", instruments)


def _put_stations(data: Data, commands: _Commands) -> None:
    """Stations that are observed: held, or free."""
    stations, draft = data.stations, data.draft
    tables: dict[tuple[tuple[float | None, float | None], Path], list[Row]] = {}
    for name, station in stations.by_name.items():
        if name in data.names:
            tables.setdefault((_sigma(commands, name), station.path), []).append(_row(stations, name))
    own = stations.system.coordinates
    columns = ["id", *own, "geoid", "deflection_north", "deflection_east"]
    units = {name: "deg" for name in own if name in ("latitude", "longitude")}
    units |= dict.fromkeys(columns[-2:], "arcsec") if stations.deflections else {}
    in_part = False
    # σ (m) of what is held in part.
    exact = 1e-6
    for ((horizontal, vertical), path), rows in tables.items():
        held = horizontal == 0.0 and vertical == 0.0
        observed = [] if held else [("sigma_east", horizontal), ("sigma_north", horizontal), ("sigma_up", vertical)]
        in_part |= 0.0 in (value for _, value in observed)
        given = [(column, repr(value or exact)) for column, value in observed if value is not None]
        cells = [Row([*row.cells, *(value for _, value in given)], row.line) for row in rows]
        names = [*columns, *(column for column, _ in given)]
        fixed = ["x", "y", "z"] if held else []
        draft.table("points", names, cells, str(path), units=units or None, fixed=fixed)
    if in_part:
        draft.note(f"coordinates that are fixed in part are observed with σ = {exact} m", 1, str(stations.path))


def _sigma(commands: _Commands, name: str) -> tuple[float | None, float | None]:
    if commands.mode == "data_check":
        return 0.0, 0.0
    given = commands.sigmas.get(name, (None, None))
    horizontal, vertical = (None, None) if commands.mode.startswith("free_net") else given
    if commands.dimensions == "2d":
        vertical = 0.0
    return 0.0 if commands.dimensions == "1d" else horizontal, vertical


def _row(stations: StationFile, name: str) -> Row:
    given = stations.by_name[name]
    deflection = map(repr, given.deflection) if stations.deflections else [None, None]
    return Row([name, *map(repr, given.place), repr(given.N), *deflection], given.line)
