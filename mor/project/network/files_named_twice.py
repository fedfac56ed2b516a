"""One file of observations in two places of a project: its observations would count twice."""

from __future__ import annotations

from collections.abc import Mapping

from mor.project.file.model import Observations, Project
from mor.project.network.reading import Reading

_NOT_NAMING = {"epoch", "time"}
"""Common values that do not say between what was observed."""


def refuse_files_named_twice(reading: Reading) -> None:
    """Add a mistake for each entry of ``observations`` or ``checks`` that reads the same values of a file again.

    Links and other spellings of a path lead to the same file. Entries may read different columns of one file, as
    directions and distances of one table do.
    """
    seen: dict[tuple[object, ...], int] = {}
    for section, entries in _entries(reading.project).items():
        for number, entry in enumerate(entries):
            if entry.file is None or reading.document.frame(str(entry.file)) is not None:
                continue
            path = reading.place.folder / str(entry.file)
            try:
                status = path.stat()
            except OSError:
                continue  # it is refused where it is read
            identity = (status.st_dev, status.st_ino) if status.st_ino else (path.resolve(),)
            key = (*identity, entry.type, *_read(entry))
            place = reading.at(section, number)
            line = reading.document.line((section, number, "file"))
            if key in seen:
                words = (
                    f"file {entry.file!r} is read already in line {seen[key]}, as {entry.type}: its observations "
                    "would count twice; remove one of the two"
                )
                reading.problems.append(place.problem(words, "file"))
            else:
                seen[key] = line


def _entries(project: Project) -> dict[str, list[Observations]]:
    return {"observations": list(project.observations), "checks": list(project.checks)}


def _read(entry: Observations) -> tuple[object, ...]:
    """What an entry reads from its file: the renamed columns, and values that name what was observed."""
    columns = entry.columns
    if isinstance(columns, Mapping):
        renamed = {(theirs, ours) for theirs, ours in columns.items() if ours and ours != theirs}
    else:
        renamed = {(str(number), name) for number, name in enumerate(columns or ()) if name}
    common = {
        (name, value)
        for name, value in entry.values.items()
        if not name.startswith("sigma") and name not in _NOT_NAMING
    }
    return tuple(sorted(renamed)), tuple(sorted(common))
