"""Files on the way out: what may be written, and how.

Every file that mor writes for its user goes through this module (folders of results through
:mod:`mor.report.output_folder`, which asks it). The rules:

1. Nothing is written over, and nothing is deleted that is, an input of this run, under whatever name it is reached.
2. An existing file is replaced only with ``--force``.
3. In a folder of results, a file is replaced or deleted only if the manifest of that folder lists it, also with
   ``--force``. The manifest is the key ``files`` of ``results.json``, or ``files.json`` in folders without results.
4. A file is written under another name in the same folder and renamed when it is complete.
5. An error of the disk names the file.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from stat import S_ISCHR, S_ISDIR, S_ISFIFO, S_ISREG, S_ISSOCK
from typing import TextIO

from mor import __version__
from mor.errors import InputError, Message
from mor.input_files import is_input

Writer = Callable[[Path], None]
"""Writes a file under the name that it is given."""
Content = str | bytes | Writer

MANIFEST = "files.json"
MANIFESTS = {"results.json": "mor-results", MANIFEST: "mor-files"}
"""Files that list what mor has written into their folder, and the schema that each of them names."""
_OVER_INPUT = "this file is an input of the same command, and nothing is written over it; choose another file"


def check_file(path: Path, force: bool, makes_folders: bool = False) -> None:
    """Raise :class:`InputError` unless a file may be written at ``path``.

    ``makes_folders`` is True if missing folders above it are made.
    """
    with named(path):
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            real = Path(os.path.realpath(path))  # of a link to nothing, what it points to
            if not makes_folders and not real.parent.is_dir():
                raise InputError(
                    [Message("the folder of this file does not exist; make it first", str(path))]
                ) from None
            return
        if S_ISDIR(mode):
            raise InputError([Message("this is a folder, expected a file to write", str(path))])
        if is_input(path):
            raise InputError([Message(_OVER_INPUT, str(path))])
        if S_ISCHR(mode) or S_ISFIFO(mode) or S_ISSOCK(mode):
            return
        if not S_ISREG(mode):
            raise InputError([Message("this is a device, expected a file to write", str(path))])
        if not force:
            raise InputError([Message("this file exists; --force replaces it", str(path))])


def write_file(path: Path, content: Content, force: bool) -> None:
    """Write one file. Raises :class:`InputError`; see :func:`write_files`."""
    write_files({path: content}, force)


def write_files(files: Mapping[Path, Content], force: bool, makes_folders: bool = False) -> None:
    """Write files: all of them, or none if one may not be written or an error comes in between.

    Raises :class:`InputError` with the name of the file, before anything is replaced.
    """
    problems: list[Message] = []
    for path in files:
        try:
            check_file(path, force, makes_folders)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    complete: dict[Path, Path] = {}
    try:
        for path, content in files.items():
            with named(path):
                real = Path(os.path.realpath(path))
                if makes_folders:
                    real.parent.mkdir(parents=True, exist_ok=True)
                if real.exists() and not real.is_file():
                    _write_stream(real, content, path.suffix)
                    continue
                complete[real] = real.with_name(f".mor-{secrets.token_hex(6)}{path.suffix}")
                write_content(complete[real], content)
                if real.exists():
                    shutil.copymode(real, complete[real])
        for real, beside in complete.items():
            with named(real):
                check_file(real, force)
                beside.replace(real)
    finally:
        for beside in complete.values():
            with suppress(OSError):
                beside.unlink()


def write_content(path: Path, content: Content) -> None:
    """Write a text, bytes, or what a writer writes, under this name."""
    if callable(content):
        content(path)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Turn every error of the disk inside into an :class:`InputError` that names ``path``."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        words = error.strerror or str(error).partition(" (os")[0]  # "(os error 28)" is what polars adds
        raise InputError([Message(f"this file cannot be written: {words}", str(path))]) from None
    except ValueError as error:
        if "null" not in str(error):  # "embedded null byte"
            raise
        raise InputError([Message("this is not a file name", str(path))]) from None


def _write_stream(path: Path, content: Content, suffix: str) -> None:
    """Write into a pipe or a device what is complete. Raises ``OSError`` for a pipe that nobody reads."""
    import tempfile

    if callable(content):
        with tempfile.TemporaryDirectory(prefix="mor") as folder:
            whole = Path(folder) / f"whole{suffix}"
            content(whole)
            content = whole.read_bytes()
    with open_stream(path) as stream:
        stream.buffer.write(content if isinstance(content, bytes) else content.encode("utf-8"))


def open_stream(path: Path) -> TextIO:
    """Open a pipe or device to write into. A pipe that nobody reads raises ``OSError`` and is not waited for."""
    descriptor = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))
    os.set_blocking(descriptor, True)
    return open(descriptor, "w", encoding="utf-8", newline="\n")


class EventFile:
    """A file of lines that another program reads while they are written, as of ``mor adjust --events``.

    A new file, a pipe, or standard output (``-``) gets every line at once. With ``force`` an existing file is replaced
    as soon as :meth:`inputs_are_known` says that all inputs have been read and it is none of them.
    """

    def __init__(self, path: Path, force: bool):
        self._path, self._force = path, force
        self._waiting: list[str] = []
        self._file: TextIO | None = None
        if str(path) == "-":
            self._file = sys.stdout
            return
        check_file(path, force)
        if not path.is_file():
            self._open()

    def write(self, line: str) -> None:
        """Write a line, or keep it until the file may be replaced."""
        if self._file is None:
            self._waiting.append(line)
            return
        with named(self._path):
            self._file.write(line)
            self._file.flush()

    def inputs_are_known(self) -> None:
        """Replace an existing file from here on. Raises :class:`InputError` if it is one of the inputs."""
        if self._file is None:
            check_file(self._path, self._force)
            self._open()

    def close(self) -> None:
        """Write what was kept and close the file."""
        self.inputs_are_known()
        if self._file is not None and self._file is not sys.stdout:
            with named(self._path):
                self._file.close()

    def _open(self) -> None:
        with named(self._path):
            if self._path.exists() and not self._path.is_file():
                self._file = open_stream(self._path)
            else:
                self._file = self._path.open("w", encoding="utf-8", newline="\n")
        for line in self._waiting:
            self.write(line)
        self._waiting = []


@contextmanager
def lines_into(path: Path | None, force: bool) -> Iterator[EventFile | None]:
    """Open a file of lines, or nothing if no file is asked for. Raises :class:`InputError`."""
    if path is None:
        yield None
        return
    lines = EventFile(path, force)
    try:
        yield lines
    except BaseException:
        with suppress(InputError):  # the first error is the one to tell
            lines.close()
        raise
    lines.close()


# ---- folders of results


def check_folder(folder: Path, force: bool, names: Iterable[str] = ()) -> None:
    """Raise :class:`InputError` unless results may be written into a folder.

    ``names`` are files that will be written, as far as they are known before anything is computed.
    """
    with named(folder):
        try:
            mode = folder.stat().st_mode
        except FileNotFoundError:
            return
        if not S_ISDIR(mode):
            raise InputError([Message("this is a file, expected a folder for the results", str(folder))])
        if any(folder.iterdir()) and not force:
            words = "the folder exists and is not empty; --force replaces results in it"
            raise InputError([Message(words, str(folder))])
        check_names(folder, names)


def check_names(folder: Path, names: Iterable[str]) -> None:
    """Raise :class:`InputError` if writing these files into a folder would touch a file that mor may not touch.

    Files that earlier results list and that are not written again are deleted; they must be no inputs either.
    """
    listed, names = listed_files(folder), set(names)
    problems = []
    results_over_input = "results would overwrite this file, from which the project is read; choose another folder"
    not_listed = (
        "this file exists, and no earlier results in this folder list it, so not even --force replaces it; "
        "choose another folder"
    )
    for name in sorted(names | listed):
        path = folder / name
        if is_input(path):
            problems.append(Message(results_over_input, str(path)))
        elif name in names - listed and os.path.lexists(path):
            problems.append(Message(not_listed, str(path)))
        else:
            problems += [
                Message(not_listed, str(folder / above))
                for above in PurePosixPath(name).parents
                if (folder / above).exists() and not (folder / above).is_dir()
            ]
    if problems:
        raise InputError(dict.fromkeys(problems))


def listed_files(folder: Path) -> frozenset[str]:
    """Names of the files that mor has written into a folder, as its manifests list them."""
    found: set[str] = set()
    for name, schema in MANIFESTS.items():
        try:
            data = json.loads((folder / name).read_bytes())
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(data, dict) and data.get("schema") == schema and isinstance(data.get("files"), list):
            found |= {name, *(one for one in data["files"] if isinstance(one, str) and _is_inside(one))}
    return frozenset(found)


def _is_inside(name: str) -> bool:
    """True for the name of a file below a folder; a manifest with any other one was not written by mor."""
    path = PurePosixPath(name)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and "\0" not in name


def manifest(names: Collection[str]) -> str:
    """Text of ``files.json``, which lists the files of a folder without ``results.json``."""
    data = {
        "schema": MANIFESTS[MANIFEST],
        "program": f"mor {__version__}",
        "files": sorted({*names, MANIFEST}),
    }
    return json.dumps(data, ensure_ascii=False, indent=1) + "\n"


def write_among(folder: Path, files: Mapping[str, Content], more: Collection[str] = ()) -> None:
    """Write files into a folder beside others, which stay. Raises :class:`InputError`; see :func:`check_names`.

    ``more`` are files that are written there by other means, and listed as well. The manifest is written first, so
    that a run that is ended in between leaves no file that mor does not know as its own.
    """
    names = {*files, *more, MANIFEST}
    with named(folder):
        check_names(folder, names)
        folder.mkdir(parents=True, exist_ok=True)
    write_file(folder / MANIFEST, manifest(listed_files(folder) | names), True)
    write_files({folder / name: content for name, content in files.items()}, True)
