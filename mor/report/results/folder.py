"""Results on disk: which files they are, written together, never over a file that the project is read from."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Collection, Iterable, Mapping
from fnmatch import fnmatch
from pathlib import Path

from mor.errors import InputError, Problem
from mor.report.results.reservation import Reservation, check_free, put_in_place

Writer = Callable[[Path], None]

RESULT_FILES = (
    "results.json",
    "report.txt",
    "report.html",
    "movements.html",
    *(
        f"{name}.{kind}"
        for name in (
            "residuals",
            "residuals_worst",
            "points",
            "images",
            "motions",
            "movements",
            "trajectories",
            "places",
        )
        for kind in ("csv", "parquet")
    ),
    "domains.json",
    "points",
    "images",
    "residuals",
    "undetermined.csv",
    "reference.csv",
    "external_reliability.csv",
    "adjusted.yaml",
    "start_*.csv",
    "given_*.csv",
)
"""Names (patterns) of all files an adjustment may write."""


def folder_beside(project: Path, suffix: str) -> Path:
    """Folder that is called as the project, with another suffix; inside of what has no name, as ``.`` has none."""
    return project.with_suffix(suffix) if project.name else project / f"project{suffix}"


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


def write_folder(place: Reservation, writers: Mapping[str, Writer]) -> None:
    """Write all files into a folder; results of an earlier run that are not written again go, other files stay.

    Everything is written into a folder beside it first. Interrupted, it leaves the old results untouched.
    """
    shutil.rmtree(place.new, ignore_errors=True)
    place.new.mkdir()
    for name, write in writers.items():
        write(place.new / name)
    check_free(place.folder, place.force)
    if place.folder.is_dir():
        for path in place.folder.iterdir():
            if path.name not in writers and not _is_result(path.name):
                _keep(path, place.new / path.name)
    put_in_place(place)


def _keep(path: Path, beside: Path) -> None:
    """Let a file, or all files of a folder, stand in a second place, too."""
    if path.is_dir() and not path.is_symlink():
        shutil.copytree(path, beside, symlinks=True, copy_function=_link)
    else:
        _link(str(path), str(beside))


def _link(path: str, beside: str) -> None:
    try:
        os.link(path, beside, follow_symlinks=False)
    except OSError:  # a file system without links
        shutil.copy2(path, beside, follow_symlinks=False)


def _is_result(name: str) -> bool:
    return any(fnmatch(name, pattern) for pattern in RESULT_FILES)
