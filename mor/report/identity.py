"""Identity of a report: program, project, input files, options, and date of the newest file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from mor import __version__
from mor.errors import InputError, Problem
from mor.input_files import ReadFile
from mor.project.file.model import Project

EPOCH = "SOURCE_DATE_EPOCH"
"""Variable that sets the date of reports, in seconds since 1970 (reproducible-builds.org)."""


class Identity(NamedTuple):
    """Files that an adjustment was read from, and the options it was asked for with."""

    files: tuple[ReadFile, ...] = ()
    folder: Path = Path()
    """Folder of the project, which the names of the files count from."""
    options: tuple[str, ...] = ()


def identity_of(project: Project, identity: Identity) -> dict[str, Any]:
    """The identity of a report as plain data. Raises :class:`InputError` for a date that is none."""
    report = project.report
    return {
        "program": f"mor {__version__}",
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
        words = f"found {given!r} in the environment, expected seconds since 1970"
        raise InputError([Problem(words, EPOCH)]) from None
