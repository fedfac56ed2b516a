"""Machine code of kernels on disk: one file for each kernel, kind of arguments, processor and state of the sources.

In place of numba's own cache, which a full disk, a damaged file or a run that was killed while writing turns into
errors, or into code of an older source. Here a file that is not whole is no file, and what cannot be kept is compiled
again by the next run. The files are in the folder ``mor`` where the system keeps caches of the user, or in the one that
``NUMBA_CACHE_DIR`` names; they may be removed at any time.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

_DIGEST = hashlib.sha256().digest_size
_ABANDONED = 86_400.0
"""Age (s) of a file that is still being written, and that nobody writes any more."""
_NO_MATTER = ("NUMBA_CACHE_DIR", "NUMBA_DEBUG_CACHE")

not_kept: list[str] = []
"""Why machine code could not be kept, the first reason first; empty where all could."""


class KernelCache(NullCache):
    """What numba asks for the machine code of one kernel, and gives it to keep."""

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._function = function
        self._options = [(k, sorted(v) if isinstance(v, set) else v) for k, v in sorted(options.items())]

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled kernel for a signature, or None where there is no whole file of it."""
        target.refresh()
        try:
            content = self._path(signature, target).read_bytes()
        except OSError:
            return None
        digest, payload = content[:_DIGEST], content[_DIGEST:]
        if hashlib.sha256(payload).digest() != digest:
            return None
        return CompileResult._rebuild(target, *pickle.loads(payload))

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep a compiled kernel; where that fails, say why in ``not_kept``."""
        payload = dumps(result._reduce())
        path = self._path(signature, result.target_context)
        beside = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _remove_abandoned(path.parent)
            beside.write_bytes(hashlib.sha256(payload).digest() + payload)
            beside.replace(path)
        except OSError as error:
            not_kept.append(f"{path.parent}: {error.strerror}")
            with suppress(OSError):
                beside.unlink()

    def _path(self, signature: Any, target: Any) -> Path:
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        what = (
            signature,
            target.codegen().magic_tuple(),
            self._options,
            _sources(self._function),
            _versions(),
        )
        return _folder() / f"{name}-{hashlib.sha256(repr(what).encode()).hexdigest()[:32]}"


@cache
def _folder() -> Path:
    return Path(os.environ.get("NUMBA_CACHE_DIR") or AppDirs("mor", appauthor=False).user_cache_dir)


@cache
def _versions() -> tuple[object, ...]:
    """What else machine code depends on: versions, and the settings of numba."""
    settings = {k: v for k, v in os.environ.items() if k.startswith("NUMBA_") and k not in _NO_MATTER}
    versions = platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__
    return *versions, numba.config.SLP_VECTORIZE, sorted(settings.items())  # type: ignore[attr-defined]


def _sources(function: Callable[..., Any]) -> list[bytes]:
    """Digests of the files of a kernel and of all kernels it may call."""
    found: dict[str, bytes] = {}
    waiting = [function]
    while waiting:
        one = waiting.pop()
        file = one.__code__.co_filename
        if file not in found:
            found[file] = _digest(file)
            others = (getattr(value, "py_func", None) for value in one.__globals__.values())
            waiting += [other for other in others if other is not None]
    return sorted(found.values())


@cache
def _digest(file: str) -> bytes:
    return hashlib.sha256(Path(file).read_bytes()).digest()


def _remove_abandoned(folder: Path) -> None:
    """Remove what runs that were killed while they wrote have left."""
    for path in folder.glob("*.part"):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _ABANDONED:
                path.unlink()
