"""Notes made while a project was read, as plain data."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mor.errors import Problem
from mor.report.identity import said_file


def note_rows(notes: Iterable[Problem], folder: Path) -> list[dict[str, Any]]:
    """The notes in their order: ``message``, ``file`` (counted from the folder of the project), ``line``; 0: none."""
    return [
        {
            "message": note.message,
            "file": said_file(Path(note.file), folder) if note.file else "",
            "line": note.line,
        }
        for note in notes
    ]
