"""Long arrays: in memory, or in files of a scratch folder when the user limits the memory (``mor adjust --memory``).

The files are mapped into memory (``mmap``), so the same code works on both. A thread watches the resident memory of the
process, and gives the pages of the files back to the system while it is near its limit. Passes over image rays work
chunk by chunk, in their order, so only the pages of a few chunks have to be resident at a time.

The files have no names. The system removes them with the arrays, and also when the process is killed.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any, TypeVar, cast
from weakref import WeakSet

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mor.errors import InputError, Message
from mor.input_files import is_folder
from mor.machine import memory_allowed, pages_of_files, resident

Kept = TypeVar("Kept", bound=NDArray[Any])

LONG = 1 << 20
"""Bytes from which on an array goes into a file."""
_SHARE = 0.8
"""Share of the allowed memory above which pages of files are given back."""
_WORTH = 16e6
"""Bytes of pages that are worth giving back."""
_PAUSE = 0.02
"""Seconds between two looks at the resident memory: some 20 MB can be read or written meanwhile."""


@dataclass
class _Scratch:
    folder: Path
    maps: WeakSet[mmap.mmap] = field(default_factory=WeakSet)
    lock: Lock = field(default_factory=Lock)
    size: int = 0
    """Bytes of all files that were made."""

    def mapped(self, size: int) -> mmap.mmap:
        """A file of ``size`` bytes of zeros, mapped. Raises :class:`InputError` if the disk has no room for it."""
        try:
            with tempfile.TemporaryFile(prefix="mor-", dir=self.folder) as file:
                _allocate(file.fileno(), size)
                found = mmap.mmap(file.fileno(), size)
        except OSError as error:
            words = f"long arrays cannot be kept in this folder: {error.strerror}; --scratch names another one"
            raise InputError([Message(words, str(self.folder))]) from None
        with self.lock:
            self.maps.add(found)
            self.size += size
        return found

    def give_back(self) -> None:
        """Let the system take back the pages of all files; what they hold stays in the files."""
        with self.lock:
            maps = list(self.maps)
        for one in maps if hasattr(mmap, "MADV_DONTNEED") else ():
            one.madvise(mmap.MADV_DONTNEED)


_SCRATCH: list[_Scratch] = []
"""The folder in use: at most one."""


def _allocate(descriptor: int, size: int) -> None:
    """Reserve the room of a file now: a full disk found later, while pages are written, would end the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(descriptor, 0, size)
        return
    zeros = bytes(LONG)
    for first in range(0, size, LONG):
        os.write(descriptor, zeros[: size - first])


@contextmanager
def limited_memory(size: float | None, folder: Path) -> Iterator[None]:
    """Keep long arrays in files of a folder, and the process below ``size`` bytes; nothing of it if that is None.

    Raises :class:`InputError` if there is no such folder.
    """
    if size is None:
        yield
        return
    if not is_folder(folder):
        raise InputError([Message("this is not a folder; expected a folder for the files of long arrays", str(folder))])
    scratch, over = _Scratch(folder), Event()

    def watch() -> None:
        stays = 0.0  # pages of files that are resident after all were given back: those of libraries
        while not over.wait(_PAUSE):
            if resident() > _SHARE * size and pages_of_files() > stays + _WORTH:
                scratch.give_back()
                stays = pages_of_files()

    _SCRATCH.append(scratch)
    watching = Thread(target=watch, daemon=True)
    watching.start()
    try:
        with memory_allowed(size, scratch.give_back):
            yield
    finally:
        _SCRATCH.remove(scratch)
        over.set()
        watching.join()


def is_limited() -> bool:
    """Return True while long arrays go into files."""
    return bool(_SCRATCH)


def empty(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return an array of any content, in a file if it is long and the memory is limited."""
    shape = (shape,) if isinstance(shape, int) else shape
    size = prod(shape) * np.dtype(dtype).itemsize
    if not _SCRATCH or size < LONG or size == 0:
        return np.empty(shape, dtype=dtype)
    return np.ndarray(shape, dtype, buffer=_SCRATCH[-1].mapped(size))


def zeros(size: int) -> NDArray[np.float64]:
    """Return zeros (size,), in a file if they are many and the memory is limited."""
    in_file = bool(_SCRATCH) and 8 * size >= LONG
    return empty(size) if in_file else np.zeros(size)  # a new file is full of zeros


def full(shape: int | tuple[int, ...], value: float, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return an array of one value, in a file if it is long and the memory is limited."""
    result = empty(shape, dtype)
    result.fill(value)
    return result


def kept(array: Kept) -> Kept:
    """Return an array, or its copy in a file if it is long and the memory is limited; broadcast ones stay."""
    if not _SCRATCH or array.nbytes < LONG or isinstance(array.base, mmap.mmap) or 0 in array.strides:
        return array
    result = cast("Kept", empty(array.shape, array.dtype))
    result[...] = array
    return result
