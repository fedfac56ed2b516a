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
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.environment import Environment, _rebuild_env, lookup_environment
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

_DIGEST = hashlib.sha256().digest_size
_ABANDONED = 86_400.0
"""Age (s) of a file that is still being written, and that nobody writes any more."""
_FORMAT = 2
"""What is in a file."""
_NO_MATTER = ("NUMBA_CACHE_DIR", "NUMBA_DEBUG_CACHE")

not_kept: list[str] = []
"""Why machine code could not be kept, the first reason first; empty where all could."""


class KernelCache(NullCache):
    """What numba asks for the machine code of one kernel, and gives it to keep."""

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any]) -> None:
        self._function = function
        self._options = [(k, sorted(v) if isinstance(v, set) else v) for k, v in sorted(options.items())]

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled kernel for a signature, or None where there is no whole file of it.

        What numba compiles with is not loaded for that, which would take longer than all kernels do: only what machine
        code calls. The compiler loads the rest by itself.
        """
        rtsys.initialize(target)
        try:
            content = self._path(signature, target).read_bytes()
        except OSError:
            return None
        digest, payload = content[:_DIGEST], content[_DIGEST:]
        if hashlib.sha256(payload).digest() != digest:
            return None
        symbols, kept = _Reader(BytesIO(payload)).load()
        generator = target.codegen()
        generator._engine._defined_symbols |= symbols
        generator.unserialize_library = partial(_library, generator)
        return CompileResult._rebuild(target, *kept)

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep a compiled kernel; where that fails, say why in ``not_kept``."""
        payload = dumps((_symbols(result.library), result._reduce()))
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


def _symbols(library: Any) -> set[str]:
    """What is defined in the code of a kernel."""
    module = library._get_module_for_linking()
    both = module.functions, module.global_variables
    return {one.name for some in both for one in some if not one.is_declaration}


def _library(generator: Any, kept: tuple[str, str, tuple[bytes, bytes]]) -> Any:
    """Code as numba reads it, but for the form that other kernels are compiled with: that is read if one is."""
    name, _, (machine_code, source) = kept
    library = generator.create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(machine_code)
    library._get_module_for_linking = cache(partial(binding.parse_bitcode, source))
    library._finalize_final_module()
    return library


class _Reader(pickle.Unpickler):
    """Reads kernels without the modules of numba that parts of them were compiled from."""

    def find_class(self, module: str, name: str) -> Any:
        """What a name in the file stands for."""
        found = super().find_class(module, name)
        return _environment if found is _rebuild_env else found


def _environment(module: str, constants: list[Any], name: str) -> Environment:
    """As numba makes it, but for the variables of the module, which only what is not machine code looks at."""
    known: Environment | None = lookup_environment(name)
    if known is not None:
        return known
    environment = Environment({"__name__": module})
    environment.consts[:] = constants
    environment.env_name = name
    Environment._memo[name] = environment
    return environment


@cache
def _folder() -> Path:
    return Path(os.environ.get("NUMBA_CACHE_DIR") or AppDirs("mor", appauthor=False).user_cache_dir)


@cache
def _versions() -> tuple[object, ...]:
    """What else machine code depends on: versions, the settings of numba, and what it makes of registers."""
    settings = {k: v for k, v in os.environ.items() if k.startswith("NUMBA_") and k not in _NO_MATTER}
    versions = platform.python_version(), numba.__version__, llvmlite.__version__, np.__version__
    registers = _digest(str(Path(__file__).with_name("registers_in_numba.py")))
    return _FORMAT, *versions, numba.config.SLP_VECTORIZE, sorted(settings.items()), registers  # type: ignore[attr-defined]


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
