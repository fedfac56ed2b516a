"""Results on disk: written beside, moved into place when complete, nothing overwritten unasked."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path

from mor.errors import InputError, Problem

Writer = Callable[[Path], None]

RESULT_FILES = (
    "results.json",
    "report.txt",
    "report.html",
    *(
        f"{name}.{kind}"
        for name in ("residuals", "residuals_worst", "points", "images")
        for kind in ("csv", "parquet")
    ),
    "reference.csv",
    "adjusted.yaml",
    "start_*.csv",
    "given_*.csv",
)
"""Names (patterns) of all files an adjustment may write."""


def check_free(folder: Path, force: bool) -> None:
    """Raise :class:`InputError` where results would overwrite something and ``force`` was not asked for."""
    if folder.exists() and not folder.is_dir():
        raise InputError([Problem("this is a file, expected a folder for the results", str(folder))])
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise InputError(
            [Problem("the folder exists and is not empty; --force replaces results in it", str(folder))]
        )


def check_inputs(folder: Path, inputs: Iterable[Path], names: Collection[str] = ()) -> None:
    """Raise :class:`InputError` where results would overwrite a file that the project is read from, forced or not.

    ``names`` are written besides the results of an adjustment.
    """
    problems = [
        Problem(
            "results would overwrite this file, which the project is read from; choose another folder",
            str(path),
        )
        for path in dict.fromkeys(inputs)
        if path.resolve().parent == folder.resolve() and (_is_result(path.name) or path.name in names)
    ]
    if problems:
        raise InputError(problems)


def write_folder(folder: Path, writers: Mapping[str, Writer], force: bool) -> None:
    """Write all files into a folder; results of an earlier run that are not written again go, other files stay.

    Everything is written into a folder beside it first. Interrupted, it leaves the old results untouched.
    """
    check_free(folder, force)
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        try:
            _write_beside(folder, beside, writers)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    except KeyboardInterrupt:
        # polars raises an interruption by itself, and Python once more: it may have hit the clearing away
        shutil.rmtree(beside, ignore_errors=True)
        raise


def _write_beside(folder: Path, beside: Path, writers: Mapping[str, Writer]) -> None:
    for name, write in writers.items():
        write(beside / name)
    beside.chmod(0o755)
    if not folder.exists():
        beside.rename(folder)
        return
    for name in writers:
        os.replace(beside / name, folder / name)
    for path in folder.iterdir():
        if path.name not in writers and _is_result(path.name):
            path.unlink()


def _is_result(name: str) -> bool:
    return any(fnmatch(name, pattern) for pattern in RESULT_FILES)
