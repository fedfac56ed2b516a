"""The identity of a run: version, files, notes."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Collection, Iterable
from datetime import UTC, datetime
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mor import __version__
from mor.errors import InputError, Message
from mor.input_files import ReadFile
from mor.report.language import Words

if TYPE_CHECKING:
    from mor.project.schema import ProjectFile

# ---- Identity of a report: program, project, input files, options, and date of the newest file.

EPOCH = "SOURCE_DATE_EPOCH"
"""Variable that sets the date of reports, in seconds since 1970 (reproducible-builds.org)."""


class RunIdentity(NamedTuple):
    """Files that an adjustment was read from, and the options it was asked for with."""

    files: tuple[ReadFile, ...] = ()
    folder: Path = Path()
    """Folder of the project, which the names of the files count from."""
    options: tuple[str, ...] = ()


PROGRAM = f"mor {__version__}"


def schema_of(name: str, version: int) -> dict[str, Any]:
    """First keys of a JSON file: what it is, the version of its keys, and the program."""
    return {"schema": name, "schema_version": version, "program": PROGRAM}


def identity_of(project: ProjectFile, identity: RunIdentity) -> dict[str, Any]:
    """The identity of a report as plain data. Raises :class:`InputError` for a date that is none."""
    report = project.report
    return {
        "program": PROGRAM,
        "project_version": project.mor,
        "measured": project.date,
        "operator": report.operator,
        "client": report.client,
        "remarks": report.remarks,
        "date": _date(identity.files),
        "options": list(identity.options),
        "inputs": [
            {"file": said_file(file.path, identity.folder), "bytes": file.size, "sha256": file.sha256}
            for file in identity.files
        ],
    }


def said_file(path: Path, folder: Path) -> str:
    """Name of a file, counted from the folder of the project: no report tells of the machine it was made on."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return path.name


def _date(files: Iterable[ReadFile]) -> str | None:
    """Day of the newest file, UTC, or the one that the environment sets: same input, same date."""
    given = os.environ.get(EPOCH, "")
    try:
        newest = float(given) if given else max((file.modified for file in files), default=None)
        return None if newest is None else datetime.fromtimestamp(newest, UTC).date().isoformat()
    except (ValueError, OverflowError, OSError):
        raise InputError([Message(f"found {given!r} in the environment, expected seconds since 1970", EPOCH)]) from None


# ---- Notes made while a project was read, as plain data.


def note_rows(notes: Iterable[Message], folder: Path) -> list[dict[str, Any]]:
    """The notes in their order: ``message``, ``file`` (counted from the folder of the project), ``line``; 0: none."""
    return [
        {"message": note.message, "file": said_file(Path(note.file), folder) if note.file else "", "line": note.line}
        for note in notes
    ]


# ---- ``README.txt`` of a folder of results: what each file is, for whoever gets the folder.

FILE = "README.txt"
MEANINGS = {
    "report.html": "the report for the browser, to read and print: verdict, pictures, tables; works offline",
    "report.txt": "the report as text, for your records: the verdict first; input files and signature last",
    "results.json": "all results for programs; mor schema results describes every key",
    "points.*": "coordinates of the points with sigma, correlations and error ellipsoids",
    "places.*": "the points in their reference system, above ellipsoid and geoid, and geocentric",
    "motions.*": "velocities, oscillations and steps of points, each with its test",
    "movements.*": "movements of points between epochs with sigma and test; as a page, also against time",
    "trajectories.*": "knots of the trajectories: time, place and rotation angles with sigma",
    "images.*": "places and rotation angles of the images with sigma",
    "residuals.*": "every observation: observed, adjusted, residual v, redundancy number r, test w, reliability",
    "residuals_worst.*": "the observations with the largest test values",
    "undetermined.csv": "undetermined objects, and why",
    "external_reliability.csv": "how far an undetected error moves each point; of many points the least controlled",
    "adjusted.yaml": "the project with the adjusted values as start values: mor adjust, datum, covariance and "
    "compare read it",
    "reference.csv": "the coordinates that the datum refers to",
    "start_*.csv": "tables of adjusted.yaml",
    "given_*.csv": "tables of adjusted.yaml",
}
"""What each file is, by its name or a pattern of names, in the order they are listed."""
_FIRST = "Contents of this folder"


def readme(names: Collection[str], words: Words) -> str:
    """The text, about the files that are there."""
    title = words(_FIRST)
    lines = [title, "=" * len(title), "", words("Results of an adjustment by mor."), ""]
    width = max(map(len, names), default=0) + 2
    columns = 100
    for pattern, meaning in MEANINGS.items():
        for name in sorted(name for name in names if fnmatch(name, pattern)):
            told = textwrap.wrap(words(meaning), columns - width)
            lines += [name.ljust(width) + told[0], *(" " * width + line for line in told[1:])]
    lines += [
        "",
        *textwrap.wrap(
            words(
                "The same command with the same input writes these files again, byte "
                "for byte. If input or options have "
                "changed, mor adjust asks for --force before it replaces them. Other files in this folder stay."
            ),
            columns,
        ),
    ]
    return "\n".join(lines) + "\n"


def may_write(folder: Path, languages: Collection[Words]) -> bool:
    """False if a file of that name stands in the folder that is not a readme of mor."""
    path = folder / FILE
    if not path.is_file():
        return not path.exists()
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline().strip() in {words(_FIRST) for words in languages}
