"""The folder of results: what is reserved, replaced and written."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import hashlib
import json
import os
import shutil
import signal
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from mor import __version__
from mor.errors import InputError, Message
from mor.input_files import holds_input, standard_input
from mor.output_files import (
    MANIFEST,
    MANIFESTS,
    Content,
    check_folder,
    check_names,
    listed_files,
    manifest,
    named,
    write_content,
)

# ---- Plain data as JSON.


def to_json(data: dict[str, Any]) -> str:
    """JSON text: same data, same bytes."""
    return json.dumps(data, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


# ---- A folder for results, reserved for one run and exchanged as a whole: there always is a complete result, old
# or new.
#
# Beside a folder ``NAME`` there is, while a run has it reserved, a folder ``.NAME.mor``: in it ``lock``,
# which the system locks for as long as the process lives, and ``new``, where results grow. The complete new
# folder and the old one change places in one step. What a killed run leaves in ``.NAME.mor`` is taken away by
# the next run that reserves the folder.

try:
    import fcntl
except ImportError:  # not on Windows: there two runs at once are not told of each other
    fcntl = None  # type: ignore[assignment]


class Reservation(NamedTuple):
    """A folder that nobody else writes results into."""

    folder: Path
    force: bool
    """True if results in it may be replaced."""
    work: Path
    """Folder beside it, on the same file system."""

    @property
    def new(self) -> Path:
        """Path of the new folder while it is written."""
        return self.work / "new"

    @property
    def old(self) -> Path:
        """Path of the old folder while folders are exchanged in two steps."""
        return self.work / "old"


@contextmanager
def reserve(folder: Path, force: bool, names: Iterable[str] = ()) -> Iterator[Reservation]:
    """Reserve a folder for results; folders above it are made, and go again where nothing was written.

    ``names`` are files that will be written into it, as far as they are known. Raises :class:`InputError` if another
    run has it reserved, or where :func:`mor.output_files.check_folder` does.
    """
    check_folder(folder, force, names)
    with named(folder):
        target = folder.resolve()
        if not target.name:
            raise InputError([Message("results need a folder of their own", str(folder))])
        missing = [path for path in target.parents if not path.exists()]
        target.parent.mkdir(parents=True, exist_ok=True)
    place = Reservation(target, force, target.with_name(f".{target.name}.mor"))
    try:
        with _uninterrupted() as interruptions:
            lock = _locked(place, folder)
            try:
                _tidy(place)
                check_folder(folder, force, names)
                with interruptions.heeded():
                    yield place
            finally:
                _tidy(place)
                with suppress(OSError):
                    (place.work / "lock").unlink()
                os.close(lock)
                with suppress(OSError):  # not empty: the next run has come in
                    place.work.rmdir()
    finally:
        with suppress(OSError):  # not empty: there are results in them
            for path in missing:
                path.rmdir()


class _Interruptions:
    """Signals that came while nothing may be left half done; they are heeded afterwards, or where it says so."""

    def __init__(self) -> None:
        self._came: list[int] = []
        self._before: dict[int, Any] = {}

    def put_off(self) -> None:
        """Only note from now on what comes. Python gives signals to the main thread, and lets no other ask for them."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number in [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]:
            before = signal.getsignal(number)
            if before is not None and before != signal.SIG_IGN:  # what other code heeds, or nobody, stays so
                self._before[number] = before
                signal.signal(number, lambda came, _: self._came.append(came))

    def heed(self) -> None:
        before, self._before = self._before, {}
        for number, handler in before.items():
            signal.signal(number, handler)
        if self._came:
            number, self._came = self._came[0], []
            signal.raise_signal(number)

    @contextmanager
    def heeded(self) -> Iterator[None]:
        try:
            self.heed()
            yield
        finally:
            self.put_off()


@contextmanager
def _uninterrupted() -> Iterator[_Interruptions]:
    interruptions = _Interruptions()
    interruptions.put_off()
    try:
        yield interruptions
    finally:
        interruptions.heed()


def put_in_place(place: Reservation) -> None:
    """Let the complete new folder take the place of the old one, in one step where the system can do that.

    Elsewhere the old folder is aside for a moment; a run that is killed just then is made good by the next one.
    """
    if not place.folder.exists():
        place.new.rename(place.folder)
        return
    shutil.copymode(place.folder, place.new)
    if not _exchanged(place.new, place.folder):
        place.folder.rename(place.old)
        place.new.rename(place.folder)


def move_into_place(place: Reservation, names: Sequence[str], stale: Collection[str]) -> None:
    """Move the new files into a folder that belongs to the user, one after the other, and delete the stale ones.

    The manifest comes first: a run that is killed in between leaves no file that the next one does not know as its own.
    """
    with _uninterrupted():
        for name in sorted(stale):
            with suppress(FileNotFoundError):
                (place.folder / name).unlink()
            with suppress(OSError):  # not empty
                if (above := (place.folder / name).parent) != place.folder:
                    above.rmdir()
        for name in sorted(names, key=lambda name: (name not in MANIFESTS, name)):
            (place.folder / name).parent.mkdir(parents=True, exist_ok=True)
            (place.new / name).replace(place.folder / name)


def _exchanged(one: Path, other: Path) -> bool:
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if os.name == "posix" else None
    if rename is None:
        return False
    here = ctypes.c_int(-100)  # AT_FDCWD: relative paths begin in the working folder
    # Of the Linux call ``renameat2``.
    return bool(rename(here, os.fsencode(one), here, os.fsencode(other), ctypes.c_uint(2)) == 0)


def _tidy(place: Reservation) -> None:
    """Take away what is left of this run or of a killed one; an old folder that was aside comes back."""
    if place.old.is_dir() and not place.folder.exists():
        place.old.rename(place.folder)
    for path in (place.new, place.old, *place.work.glob("workers-*")):
        shutil.rmtree(path, ignore_errors=True)


def _locked(place: Reservation, said: Path) -> int:
    """Descriptor of the lock of a folder. Raises :class:`InputError` if another process holds it."""
    path = place.work / "lock"
    while True:
        with named(said), suppress(FileExistsError):
            place.work.mkdir()
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:  # the run before has just taken the folder away
            continue
        try:
            _lock(lock)
            if os.path.samestat(os.fstat(lock), path.stat()):
                os.ftruncate(lock, 0)
                os.write(lock, str(os.getpid()).encode())
                return lock
        except FileNotFoundError:  # another run has taken the file away before it was locked
            pass
        except BlockingIOError:
            process = os.read(lock, 20).decode() or "?"
            os.close(lock)
            words = f"another run of mor (process {process}) is writing results into this folder"
            raise InputError([Message(f"{words}; wait for its end, or choose another folder", str(said))]) from None
        os.close(lock)


def _lock(descriptor: int) -> None:
    """Lock a file, where its file system has locks."""
    if fcntl is None:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
            raise


# ---- A folder of results on disk: all its files complete, or none of them; never over a file that mor may not touch.


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


# ---- Compare earlier results with this command: results of the same command may be replaced.


def is_repeated(folder: Path, project: Path, options: Sequence[str]) -> bool:
    """Return True if a folder holds results of this project file, by this program, from input that has not changed.

    Every input file that ``results.json`` names must have the SHA-256 it had. What cannot be read is another result.
    """
    identity = _identity(folder / "results.json")
    files = identity.get("inputs") or []
    same = identity.get("program") == f"mor {__version__}" and identity.get("options") == list(options)
    try:
        return (
            bool(files)
            and same
            and (project.is_dir() or os.path.realpath(project.parent / files[0]["file"]) == os.path.realpath(project))
            and all(_unchanged(f, project) for f in files)
        )
    except (OSError, KeyError, TypeError, ValueError):
        return False


def _identity(path: Path) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    found = data.get("identity") if isinstance(data, dict) else None
    return found if isinstance(found, dict) else {}


def _unchanged(file: dict[str, Any], project: Path) -> bool:
    path = project.parent / file["file"]
    given = standard_input(path)
    if given is not None:
        return bool(hashlib.sha256(given).hexdigest() == file["sha256"])
    if not path.is_file() or path.stat().st_size != file["bytes"]:  # a pipe would be waited for
        return False
    with path.open("rb") as content:
        return bool(hashlib.file_digest(content, "sha256").hexdigest() == file["sha256"])
