"""A folder of results on disk: all its files complete, or none of them; never over a file that mor may not touch."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from mor.input_files import holds_input
from mor.output_files import (
    MANIFEST,
    MANIFESTS,
    Content,
    Writer,
    check_folder,
    check_names,
    listed_files,
    manifest,
    named,
    write_content,
)
from mor.report.results.reservation import Reservation, move_into_place, put_in_place

__all__ = ["Writer", "folder_beside", "write_folder"]


def folder_beside(project: Path, suffix: str) -> Path:
    """Folder that is called as the project, with another suffix; inside of what has no name, as ``.`` has none."""
    return project.with_suffix(suffix) if project.name else project / f"project{suffix}"


def write_folder(place: Reservation, writers: Mapping[str, Content]) -> None:
    """Write all files into a folder. Files of an earlier run that are not written again are deleted; all others stay.

    Everything is written into a folder beside it first. Interrupted, it leaves the old results untouched. Without a
    ``results.json`` among the files, ``files.json`` lists them. Raises :class:`InputError` for a file in the way that
    no earlier results list, and for errors of the disk.
    """
    with named(place.folder):
        shutil.rmtree(place.new, ignore_errors=True)
        place.new.mkdir()
    if not MANIFESTS.keys() & writers.keys():
        writers = {**writers, MANIFEST: manifest(writers)}
    for name, content in writers.items():
        with named(place.folder / name):
            (place.new / name).parent.mkdir(parents=True, exist_ok=True)
            write_content(place.new / name, content)
    check_folder(place.folder, place.force)
    new = [path.relative_to(place.new).as_posix() for path in place.new.rglob("*") if not path.is_dir()]
    check_names(place.folder, new)
    with named(place.folder):
        old = listed_files(place.folder)
        if not place.folder.exists() or (old and not _is_of_user(place.folder)):
            if place.folder.exists():
                _keep(place.folder, place.new, old)
            put_in_place(place)
        else:
            move_into_place(place, new, old - set(new))


def _is_of_user(folder: Path) -> bool:
    """True for a folder that is not made for results: the inputs stand in it, or the command runs in it."""
    here = Path.cwd().resolve()
    return holds_input(folder) or folder == here or folder in here.parents


def _keep(folder: Path, beside: Path, listed: frozenset[str]) -> None:
    """Let every file of a folder that is not ``listed`` stand in the folder beside it as well."""
    for above, folders, files in os.walk(folder):
        there = beside / os.path.relpath(above, folder)
        links = [name for name in folders if os.path.islink(os.path.join(above, name))]
        for name in folders:
            path, new = Path(above, name), there / name
            if name not in links and not _is_emptied(path, folder, listed):
                new.mkdir(exist_ok=True)
                shutil.copystat(path, new)
        for name in (*files, *links):
            if Path(above, name).relative_to(folder).as_posix() not in listed:
                _link(os.path.join(above, name), str(there / name))


def _is_emptied(path: Path, folder: Path, listed: frozenset[str]) -> bool:
    """True for a folder below that holds nothing but files that earlier results list."""
    files = [file for file in path.rglob("*") if file.is_symlink() or not file.is_dir()]
    return bool(files) and all(file.relative_to(folder).as_posix() in listed for file in files)


def _link(path: str, beside: str) -> None:
    try:
        os.link(path, beside, follow_symlinks=False)
    except OSError:  # a file system without links
        shutil.copy2(path, beside, follow_symlinks=False)
