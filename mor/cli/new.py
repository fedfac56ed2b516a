"""``mor new``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mor.cli.console import tell, tell_note
from mor.cli.options import InputPath, OutputPath, force_option
from mor.errors import InputError, Message, counted, nearest

if TYPE_CHECKING:
    from mor.project.recognition import Found


@click.command(name="new")
@click.argument("project", type=OutputPath())
@click.argument("tables", nargs=-1, type=InputPath())
@click.option(
    "-t", "--title", default="", metavar="TEXT", show_default="name of the file", help="Title of the project."
)
@click.option("--length", metavar="UNIT", default="m", show_default=True, help="Unit of lengths: m, mm, ft and more.")
@click.option(
    "--angle",
    metavar="UNIT",
    default="",
    show_default="as the angles tell, else gon",
    help="Unit of angles: gon, deg, rad and more.",
)
@click.option("--camera", metavar="NAME", default="camera", show_default=True, help="Name of the camera.")
@click.option("-c", "--constant", metavar="NUMBER", type=float, help="Camera constant, mm.")
@click.option("--size", metavar="WIDTH HEIGHT", type=(int, int), help="Image format, px.")
@click.option("--pixel", metavar="SIZE", default="0.004 mm", show_default=True, help="Pixel size with its unit.")
@click.option(
    "--datum",
    type=click.Choice(["fixed", "free"]),
    default="fixed",
    show_default=True,
    help="fixed: by control points; free: inner constraints over all points.",
)
@click.option(
    "--protocol",
    type=click.Choice(["iso17123-3", "iso17123-4", "iso17123-5", "iso17123-8", "vdi2634-1"]),
    help="Begin the test of an instrument (ISO 17123, VDI/VDE 2634) instead.",
)
@click.option(
    "--columns",
    metavar="TABLE NAMES",
    type=(str, str),
    multiple=True,
    help="Names of the columns of a table, instead of its header if it has one: a,b,c; - for one not used. "
    "Again for rows of another length.",
)
@force_option
def command(
    project: Path,
    tables: tuple[Path, ...],
    title: str,
    length: str,
    angle: str,
    camera: str,
    constant: float | None,
    size: tuple[int, int] | None,
    pixel: str,
    datum: str,
    protocol: str | None,
    columns: tuple[tuple[str, str], ...],
    force: bool,
) -> None:
    """Create PROJECT, a commented project file, from TABLES (CSV, spreadsheets) or from photographs.

    \b
    Examples:
      mor new project.yaml
      mor new project.yaml image_points.csv control.csv -c 28 --size 6000 4000 --pixel "0.006 mm"
      mor new net.yaml directions.csv distances.csv points.csv --angle gon
      mor new field.yaml image_points.csv scale_bars.csv --length mm -c 35 --datum free
      mor new line.yaml distances.csv heights.csv --columns distances.csv from,to,distance
      mor new wall.yaml photos/*.jpg
      mor new line.yaml --protocol iso17123-4

    mor recognises a table by its column names, including German and other usual ones: image points (image, point, x,
    y), distances (from, to, distance), directions (station, to, horizontal, zenith), points (id, x, y, z), images (id,
    x, y, z, omega, phi, kappa) and more. If the names of a list id, x, y, z are those of images, it contains their
    projection centres. Points and images that only observations name are listed; no start values are needed. The schema
    of this version, mor.schema.json, is written beside it. Photographs contain their camera, size, focal length
    and GNSS position (EXIF; extra formats).

    \b
    Exit codes: 0 done; 2 input.
    """
    from mor.formats.exif import SUFFIXES
    from mor.output_files import write_files
    from mor.project.column_names import SIGMAS
    from mor.project.level_books import levelled
    from mor.project.new_project import CameraSettings, begin, begin_test
    from mor.project.recognition import told_apart
    from mor.project.schema import project_schema
    from mor.project.tables import read_sheets
    from mor.units import ANGLE_UNITS, LENGTH_UNITS

    if protocol is not None:
        if tables:
            raise InputError([Message("a protocol takes no tables", "--protocol")])
        texts = begin_test(project, title or project.stem, protocol)
        write_files(texts, force, makes_folders=True)
        tell(f"fill in {list(texts)[1]}, then mor adjust {project}")
        return
    for unit, known in ((length, LENGTH_UNITS), (angle, ANGLE_UNITS)):
        if unit and unit not in known:
            raise InputError([Message(f"unknown unit {unit!r}{nearest(unit, known)} (known: {', '.join(known)})")])
    if tables and all(path.suffix.lower() in SUFFIXES for path in tables):
        _begin_from_photographs(project, tables, force)
        return
    named = dict[Path, list[tuple[str, ...]]]()
    for given, names in columns:
        meant = [path for path in tables if path == Path(given)] or [path for path in tables if path.name == given]
        if len(meant) != 1:
            raise InputError([Message("this is none of the tables that are given, or several", f"--columns {given}")])
        named.setdefault(meant[0], []).append(tuple(name.strip() for name in names.split(",")))
    found = told_apart(levelled(_read(tables, named)), is_free=datum == "free")
    settings = CameraSettings(camera, constant, size, pixel)
    texts = begin(project, found, title or project.stem, (length, angle), settings, datum)
    schema = project.with_name("mor.schema.json")
    if not _has_content(schema, project_schema()):
        texts[schema] = project_schema()
    write_files(texts, force, makes_folders=True)
    for table in found:
        tell(f"{table.path}: {table.kind}, {counted(len(table.rows), 'row')}")
    for path, unused in {
        (table.path, table.sheet): (table.path, table.unused) for table in found if table.unused
    }.values():
        tell(f"note: {path}: columns not used: {', '.join(unused)}")
    notes = [Message(words, str(table.path)) for table in found for words in table.notes]
    with_sigma = [table.path for table in found if table.kind == "points" and table.has_sigma]
    notes += [Message("coordinates with a σ are taken as control, with that σ", str(own)) for own in with_sigma]
    for note in dict.fromkeys(notes):
        tell_note(note)
    for path, copy in dict.fromkeys((table.path, table.copy(project)) for table in found if table.tidied):
        tell(
            f"note: {path}: written to {copy} in UTF-8 with one header, without units and with the station in every row"
        )
    for path in dict.fromkeys(table.path for table in found if table.sheet):
        used = {table.sheet for table in found if table.path == path}
        rest = [name for name, rows in read_sheets(path).items() if rows and name not in used]
        if rest:
            tell(f"note: {path}: sheets not used: {', '.join(rest)}")
    if tables and not any(table.kind in SIGMAS for table in found):
        tell("note: no table has measurements: give one, or add them under observations:")
    tell(f"{project} is written: look at the lines marked CHECK, then run mor check {project}")


def _read(paths: Sequence[Path], named: Mapping[Path, Sequence[Sequence[str]]]) -> list[Found]:
    """Tables of all files. Coordinates may tell the columns of those without a header."""
    from mor.project.headerless import HeaderlessError, listed_places, names_by_coordinates, names_of_lists

    found: dict[Path, list[Found]] = {}
    bare: dict[Path, HeaderlessError] = {}
    for path in paths:
        try:
            found[path] = _recognised(path, *named.get(path, ()))
        except HeaderlessError as error:
            found[path], bare[path] = [], error
    listed = {path: listed_places(mistake.rows) for path, mistake in bare.items()}
    places = {name: place for own in listed.values() for name, place in own.items()}
    read = [table.places() for tables in found.values() for table in tables]
    places |= {name: place for own in read for name, place in own.items()}
    told = {path: names_by_coordinates(mistake.rows, places) for path, mistake in bare.items()}
    used = {cell for path, names in told.items() if names for row in bare[path].rows for cell in row}
    by_names = names_of_lists(listed, read)
    for path, mistake in bare.items():
        if not used.isdisjoint(listed[path]):
            told[path] = ["id", "x", "y", "z"][: len(mistake.rows[0])]
        if not (names := told[path] or by_names.get(path, [])):
            raise mistake
        words = f"no header: read as {', '.join(names)}, as coordinates and distances agree"
        if not told[path]:
            words = f"no header: read as {', '.join(names)}, as names of points agree"
        found[path] = [t._replace(notes=(*t.notes, words)) for t in _recognised(path, names)]
    return [table for tables in found.values() for table in tables]


def _recognised(table: Path, *names: Sequence[str]) -> list[Found]:
    from mor.formats import FORMATS, format_of
    from mor.formats.recognition import explain_unknown
    from mor.input_files import read_bytes
    from mor.project.recognition import read_tables

    # No table begins as XML or JSON does.
    is_table = not read_bytes(table)[:100].removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"<", b"{", b"[{"))
    try:
        if is_table:
            found = read_tables(table, *names)
            if not any(own.rows for own in found):
                kinds = ", ".join(dict.fromkeys(own.kind for own in found))
                words = f"there are no rows below the header of this table ({kinds})"
                raise InputError([Message(words, str(table))])
            return found
    except InputError:
        if (key := format_of(table)) is None:
            raise
    else:
        key = format_of(table)
    words = explain_unknown(table)
    if key is not None:
        words = f"this is no table but a file of {FORMATS[key].title}; mor convert or mor adjust reads it"
    raise InputError([Message(words, str(table))]) from None


def _has_content(path: Path, text: str) -> bool:
    try:
        return path.is_file() and path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


def _begin_from_photographs(project: Path, photographs: tuple[Path, ...], force: bool) -> None:
    from mor.formats.exif import read_photographs
    from mor.output_files import write_files
    from mor.project.document import project_files

    document = read_photographs(photographs, project)
    write_files(project_files(document.data, project.parent, project), force, makes_folders=True)
    for note in document.notes:
        tell(f"note: {note.message}")
    tell(f"{project} is written: add observations, then run mor check {project}")
