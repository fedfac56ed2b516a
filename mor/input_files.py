"""Files on the way in: only regular ones, unpacked where they are compressed, up to limits that can be raised."""

from __future__ import annotations

import codecs
import gzip
import hashlib
import os
import re
import sys
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import NamedTuple

from mor.errors import InputError, Message

LIMITS = {
    "MOR_MAX_FILE_MB": 2_000,
    "MOR_MAX_PROJECT_MB": 100,
    "MOR_MAX_VALUES": 1_000_000,
    "MOR_MAX_COLUMNS": 1_000,
}
"""Limits of what is read, by the environment variables that raise them; ``docs/limits.md`` says what each is for."""
TABLE, PROJECT = "MOR_MAX_FILE_MB", "MOR_MAX_PROJECT_MB"
"""Limits of the size of a table, and of what is not a table: project files and foreign ones."""
_MB = 1_000_000
_MARKS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
CODE_PAGES = {
    "gb18030": "Chinese",
    "cp1251": "Windows, Cyrillic",
    "cp1252": "Windows, Western European",
    "cp1254": "Windows, Turkish",
}


class ReadFile(NamedTuple):
    """A file as it was when it was read."""

    path: Path
    size: int
    """Bytes."""
    sha256: str
    modified: float
    """Seconds since 1970, UTC."""


_READ: ContextVar[dict[Path, ReadFile] | None] = ContextVar("files that were read", default=None)


@contextmanager
def files_read() -> Iterator[dict[Path, ReadFile]]:
    """Every file that is read inside, once, in the order of reading: whatever the format, nothing can be forgotten."""
    files: dict[Path, ReadFile] = {}
    token = _READ.set(files)
    try:
        yield files
    finally:
        _READ.reset(token)


_INPUTS: ContextVar[set[object] | None] = ContextVar("inputs", default=None)
STDIN = Path("stdin")
"""Name of standard input in messages and results, once :func:`keep_standard_input` has read it."""
_STDIN: ContextVar[bytes | None] = ContextVar("stdin", default=None)


@contextmanager
def inputs_of_run(paths: Iterable[Path] = ()) -> Iterator[None]:
    """Remember inputs for :func:`is_input`: ``paths``, all that is noted inside, and those of a run around it."""
    token, outer = _INPUTS.set(set(_INPUTS.get() or ())), _STDIN.set(_STDIN.get())
    try:
        for path in paths:
            note_input(path)
        yield
    finally:
        _INPUTS.reset(token)
        _STDIN.reset(outer)


def keep_standard_input() -> Path:
    """Read standard input to its end, and return the path under which this run finds it.

    Raises :class:`InputError` if it is larger than the limit of project files.
    """
    content = sys.stdin.buffer.read(limit(PROJECT) * _MB + 1)
    check_size(len(content), STDIN, PROJECT)
    _STDIN.set(content)
    return STDIN


def standard_input(path: Path) -> bytes | None:
    """Return what standard input held if the path stands for it, ``None`` for files."""
    return _STDIN.get() if path == STDIN else None


def note_input(path: Path) -> None:
    """Note that a file is an input of this run: nothing may be written over it, under whatever name it is reached."""
    inputs = _INPUTS.get()
    if inputs is not None:
        inputs.update(_identities(path))


def is_input(path: Path) -> bool:
    """Return True for an input of this run, also through a symbolic or hard link."""
    inputs = _INPUTS.get()
    return inputs is not None and not inputs.isdisjoint(_identities(path))


def holds_input(folder: Path) -> bool:
    """Return True for a folder with an input of this run anywhere in it."""
    above = os.path.join(os.path.realpath(folder), "")
    return any(isinstance(one, str) and one.startswith(above) for one in _INPUTS.get() or ())


def _identities(path: Path) -> set[object]:
    try:
        found: set[object] = {os.path.realpath(path)}
        status = os.stat(path)
    except (OSError, ValueError):
        return {os.path.abspath(path)} if "\0" not in str(path) else set()
    return found if S_ISDIR(status.st_mode) else {*found, (status.st_dev, status.st_ino)}


def note_file(path: Path, content: bytes | None = None) -> None:
    """Remember that a file was read, where somebody wants to know; ``content`` are its bytes, else they are read."""
    note_input(path)
    files, place = _READ.get(), path.resolve()
    if files is None or place in files:
        return
    if content is not None and standard_input(path) is content:
        files[place] = ReadFile(path, len(content), hashlib.sha256(content).hexdigest(), time.time())
        return
    status = path.stat()
    if content is not None:
        sha256 = hashlib.sha256(content).hexdigest()
    else:
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    files[place] = ReadFile(path, status.st_size, sha256, status.st_mtime)


def limit(name: str) -> int:
    """A limit, as the environment has it or by default. Raises :class:`InputError` if that is not a number."""
    given = os.environ.get(name, "")
    if not given:
        return LIMITS[name]
    if not given.isascii() or not given.isdigit() or int(given) == 0:
        raise InputError([Message(f"found {given!r} in the environment, expected a whole number above 0", name)])
    return int(given)


def raise_it(name: str) -> str:
    """Return the hint on how to raise a limit."""
    return f"a larger {name} in the environment allows more"


def read_bytes(path: Path, most: str = TABLE) -> bytes:
    """Content of a file, unpacked where its name ends in ``.gz``; ``most`` is the limit of its size.

    Raises :class:`InputError` if it does not exist, is no regular file (a pipe, a device), cannot be read or is
    larger than the limit.
    """
    given = standard_input(path)
    if given is not None:
        note_file(path, given)
        return given
    check_regular(path)
    try:
        packed = path.suffix.lower() == ".gz"
        size = path.stat().st_size
        check_size(_unpacked_size(path, limit(most) * _MB) if packed else size, path, most)
        content = path.read_bytes()
        note_file(path, content)
        if content.startswith(b"version https://git-lfs"):
            raise InputError(
                [Message("this is a pointer of Git LFS, not the file; git lfs pull fetches it", str(path))]
            )
        return gzip.decompress(content) if packed else content
    except (OSError, EOFError, zlib.error) as error:
        words = getattr(error, "strerror", None) or str(error)
        raise InputError([Message(f"this file cannot be read: {words}", str(path))]) from None


def read_text(path: Path, most: str = PROJECT, errors: str = "strict") -> str:
    """Return the text of a file in UTF-8, or in UTF-16 with a byte order mark. Raises :class:`InputError`."""
    content = as_utf8(read_bytes(path, most))
    try:
        return content.decode("utf-8", errors).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError([Message("this is not UTF-8 text", str(path), line)]) from None


def as_utf8(content: bytes) -> bytes:
    """Return text as UTF-8 without a byte order mark, also of UTF-16 with its mark and with the degree of Windows."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", "replace").encode()
    if b"\xb0" in content and set(re.findall(rb"[\x80-\xff]", content)) == {b"\xb0"}:
        return content.decode("cp1252").encode()
    return content.removeprefix(codecs.BOM_UTF8)


def decoded(content: bytes) -> tuple[str, str]:
    """Text of a file with lines that end in ``\\n``, and the name of its encoding."""
    encoding = _encoding(content)
    mark = next((mark for mark, name in _MARKS if content.startswith(mark)), b"")
    text = content[len(mark) :].decode(encoding, "replace")
    name = "utf-16" if encoding.startswith("utf-16") else encoding
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\x1a", ""), name


def _encoding(content: bytes) -> str:
    for mark, name in _MARKS:
        if content.startswith(mark):
            return name
    # Letters that cp1254 has in the places of Icelandic ones, and letters of Icelandic that Turkish does not have.
    turkish, accented = set(b"\xd0\xdd\xde\xf0\xfd\xfe"), set(b"\xc1\xc6\xe1\xe6\xed\xf3\xfa")
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        if _is_chinese(content):
            return "gb18030"
        if _is_cyrillic(content):
            return "cp1251"
        return "cp1254" if not turkish.isdisjoint(content) and accented.isdisjoint(content) else "cp1252"
    return "utf-8"


def _is_chinese(content: bytes) -> bool:
    """Return whether high bytes come in pairs that are common characters, some of them not inside words of letters."""
    try:
        text = content.decode("gb18030")
    except UnicodeDecodeError:
        return False
    letters = [letter.encode("gb18030") for letter in text if not letter.isascii()]
    letters = [letter for letter in letters if not b"\xa1\xa1" <= letter < b"\xaa"]  # signs and full-width letters
    # GB 2312 has its 3755 common characters from B0A1 to D7F9; lower-case Cyrillic and accented letters are above them.
    common = sum(b"\xb0\xa1" <= pair <= b"\xd7\xf9" and pair[1] > 0xA0 for pair in letters)
    # Capital Cyrillic letters are C0 to DF throughout; two thirds of the bytes of Chinese are not.
    others = sum(not 0xC0 <= byte <= 0xDF for pair in letters for byte in pair)
    is_word = re.search(r"(?<![A-Za-z])[\u4e00-\u9fff]|[\u4e00-\u9fff](?![A-Za-z])", text) is not None
    return is_word and 5 * common >= 4 * len(letters) and 5 * others > 2 * len(letters)


def _is_cyrillic(content: bytes) -> bool:
    """Words in Cyrillic are of high bytes throughout; in Western languages most of these stand alone."""
    high = [byte >= 0x80 for byte in content]
    pairs = sum(a and b for a, b in pairwise(high))
    return 2 * pairs > sum(high)


def not_utf8(encoding: str) -> str:
    """Words for a text that is read in the letters of Windows."""
    return f"this is not UTF-8 text; it is read as {encoding} ({CODE_PAGES[encoding]}): check the names"


def check_regular(path: Path) -> None:
    """Raise :class:`InputError` where a path is no regular file: reading a pipe or a device may never end."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        raise InputError([Message("this file does not exist", str(path))]) from None
    except PermissionError as error:
        raise InputError([Message(f"this file cannot be read: {error.strerror}", str(path))]) from None
    except (OSError, ValueError) as error:
        words = getattr(error, "strerror", None) or str(error)
        raise InputError([Message(f"this is not a file name: {words}", str(path))]) from None
    if S_ISREG(mode):
        return
    words = "folder" if S_ISDIR(mode) else "pipe or a device"
    raise InputError([Message(f"this is a {words}, expected a file", str(path))])


def is_folder(path: Path) -> bool:
    """True for a folder; False for what is none, and for what can be no name of one."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def check_size(size: int, path: Path, most: str) -> None:
    """Raise :class:`InputError` where ``size`` bytes are above the limit ``most``."""
    if size > limit(most) * _MB:
        raise InputError([Message(f"found more than {limit(most)} MB; {raise_it(most)}", str(path))])


def _unpacked_size(path: Path, most: int) -> int:
    """Bytes in a gzip file, counted up to just above ``most`` and without keeping them."""
    # Bytes that one byte of a gzip file may unpack to.
    if path.stat().st_size * 1032 <= most:
        return 0
    size = 0
    # Bytes that are unpacked together.
    at_a_time = 1 << 22
    with gzip.open(path) as file:
        while size <= most and (part := file.read(at_a_time)):
            size += len(part)
    return size
