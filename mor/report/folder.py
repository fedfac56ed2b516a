"""Results on disk: written beside, moved into place when complete, nothing overwritten unasked."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from mor.errors import InputError, Problem

Writer = Callable[[Path], None]


def check_free(folder: Path, force: bool) -> None:
    """Raise :class:`InputError` where results would overwrite something and ``force`` was not asked for."""
    if folder.exists() and not folder.is_dir():
        raise InputError([Problem("this is a file, expected a folder for the results", str(folder))])
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise InputError(
            [Problem("the folder exists and is not empty; --force replaces results in it", str(folder))]
        )


def write_folder(folder: Path, writers: Mapping[str, Writer], force: bool) -> None:
    """Write all files into a folder; other files in it are left alone.

    Everything is written into a folder beside it first. Interrupted, it leaves the old results untouched.
    """
    check_free(folder, force)
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        for name, write in writers.items():
            write(beside / name)
        beside.chmod(0o755)
        if not folder.exists():
            beside.rename(folder)
            return
        for name in writers:
            os.replace(beside / name, folder / name)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
