"""Compare earlier results with this command: results of the same command may be replaced."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mor import __version__


def is_repeated(folder: Path, project: Path, options: Sequence[str]) -> bool:
    """Return True if a folder holds results of this project file, by this program, from input that has not changed.

    Every input file that ``results.json`` names must have the SHA-256 it had. What cannot be read is another result.
    """
    identity = _identity(folder / "results.json")
    files = identity.get("inputs") or []
    same = identity.get("program") == f"mor {__version__}" and identity.get("options") == list(options)
    try:
        return bool(files) and same and _is_of(files, project) and all(_unchanged(f, project) for f in files)
    except (OSError, KeyError, TypeError, ValueError):
        return False


def _identity(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    found = data.get("identity") if isinstance(data, dict) else None
    return found if isinstance(found, dict) else {}


def _is_of(files: Sequence[dict[str, Any]], project: Path) -> bool:
    """Return True if the project, a file or a folder of a foreign format, is what was read."""
    return project.is_dir() or os.path.realpath(project.parent / files[0]["file"]) == os.path.realpath(
        project
    )


def _unchanged(file: dict[str, Any], project: Path) -> bool:
    path = project.parent / file["file"]
    if not path.is_file() or path.stat().st_size != file["bytes"]:  # a pipe would be waited for
        return False
    with path.open("rb") as content:
        return bool(hashlib.file_digest(content, "sha256").hexdigest() == file["sha256"])
