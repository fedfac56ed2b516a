"""Compiled kernels: when they are used, where their machine code is kept, and what runs where there is none.

A kernel is a Python function over arrays that Numba compiles. A network is adjusted with kernels or in plain NumPy,
as a whole: :func:`chosen_by_size` decides, :func:`wanted` tells the steps. The numbers agree to 1e-9 σ.

Nobody waits for the compiler where NumPy is sooner done. Machine code comes from the cache, a folder that
:func:`compile_all` fills in a process of its own (``mor compile``) and seals with checksums. A network takes all of
its kernels from a sealed cache before it begins, so that whatever fails (no Numba, a Numba that does not compile, a
cache that cannot be read or written) fails there: then NumPy does the work, and one note says why.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from functools import cache, cached_property, update_wrapper
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from threading import RLock, Thread
from types import CodeType, FunctionType
from typing import Any, Generic, ParamSpec, Protocol, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

WORTH_COMPILING = 20_000
"""Observations of a network below which kernels are never used: NumPy takes some seconds at most."""
ASKED = "MOR_KERNELS"
"""Environment variable that is auto, numpy or numba; processes that help with the work inherit it."""

MISSING = "the Python package numba is missing: same results, but much slower (pip install 'mor-adjustment[large]')"
COMPILING = "compiling the kernels, which takes some minutes, once only"
FAILED = "the compiled kernels cannot be used; NumPy gives the same results but is slower: {reason}"

# Sums may be reordered and multiply-adds fused, so that inner products use vector registers; infinities and
# not-a-numbers keep their meaning, unlike under numba's unrestricted ``fastmath=True``.
_FAST_SUMS = {"reassoc", "contract", "nsz"}

_installed = find_spec("numba") is not None
available = _installed and os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
"""True if there is a compiler."""
elsewhere = False
"""Whether kernels are used outside of networks that :func:`chosen_by_size` decides about; True in the tests."""


class Notify(Protocol):
    """Tells the user something, with values for the places in braces."""

    def __call__(self, words: str, /, **values: object) -> None:
        """Say it."""


_lock = RLock()
_used: ContextVar[bool | None] = ContextVar("used", default=None)
_small: ContextVar[bool] = ContextVar("small", default=False)
_say: ContextVar[Notify] = ContextVar("say", default=lambda words, /, **values: None)


def wanted() -> bool:
    """Return True if kernels are to be taken, not the plain NumPy form of the same step."""
    used = _used.get()
    return available and (elsewhere if used is None else used)


def is_small() -> bool:
    """True within a network that is too small for kernels, whose passes are many and short."""
    return _small.get()


@contextmanager
def chosen_by_size(observations: int, times: int = 1) -> Iterator[None]:
    """Within, kernels are used if that is worth it for so many observations, adjusted so many times."""
    small = observations < WORTH_COMPILING
    with kernels_used(bool(_compiling) or _decided(observations, times), small):
        yield


@contextmanager
def kernels_used(used: bool, small: bool = False) -> Iterator[None]:
    """Within, kernels are used, or plain NumPy."""
    before = _used.set(used), _small.set(small and not used)
    try:
        yield
    finally:
        _used.reset(before[0])
        _small.reset(before[1])


@contextmanager
def notes_told_by(say: Notify) -> Iterator[None]:
    """Within, ``say`` tells that kernels are compiled, or why they cannot be used: once each."""
    told: set[str] = set()

    def once(words: str, /, **values: object) -> None:
        if words not in told:
            told.add(words)
            say(words, **values)

    before = _say.set(once)
    try:
        yield
    finally:
        _say.reset(before)


def as_here(work: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Return ``work`` for another thread, with the same choice of kernels or NumPy as in this thread."""
    context = copy_context()

    def carried(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        return context.run(work, *args, **kwargs)

    return carried


def _decided(observations: int, times: int) -> bool:
    asked = os.environ.get(ASKED, "auto")
    if observations < WORTH_COMPILING or asked == "numpy":
        return False
    if not available:
        if not _installed:
            _say.get()(MISSING)
        return False
    with _lock:
        if not _state:
            try:
                if not _is_sealed():
                    if asked != "numba" and not _compiling_is_sooner(observations * times):
                        return False
                    _say.get()(COMPILING)
                    _compile_apart()
                _load()
            except Exception as error:  # noqa: BLE001 - whatever Numba or its cache raises: NumPy does the same
                _state.append(reason_of(error))
    if _state[0]:
        _say.get()(FAILED, reason=_state[0])
    return not _state[0]


def _load() -> None:
    """Take all kernels from the cache; raises where it is not whole."""
    folder = _folder()
    damaged = "the cache of kernels is damaged, mor compile renews it: {file}"
    for name, checksum in json.loads((folder / _SEAL).read_text()).items():
        if _checksum(folder / name) != checksum:
            raise _UnusableError(damaged.format(file=folder / name))
    with tempfile.TemporaryFile(dir=folder):  # where Numba cannot write, it does not read either
        os.utime(folder)
    for module, name, signatures in pickle.loads((folder / _SIGNATURES).read_bytes()):
        kernel = getattr(import_module(module), name)
        for signature in signatures:
            kernel.in_numba.compile(signature)
    _state.append("")


_state: list[str] = []
"""Why kernels cannot be used in this process; an empty text where they are loaded, nothing before that is tried."""


def reason_of(error: Exception) -> str:
    """Why kernels cannot be used, in a line: the first of what was raised."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    line = next((line.strip() for line in str(error).splitlines() if line.strip()), "")
    return line if isinstance(error, _UnusableError) else f"{type(error).__name__}: {line}"


class _UnusableError(Exception):
    """Kernels cannot be used, for a reason that is the message."""


class Kernel(Generic[Parameters, Result]):
    """A function that Numba compiles, or takes from its cache, when it is first called where kernels are wanted."""

    def __init__(self, function: Callable[Parameters, Result], **options: Any) -> None:
        self.py_func = function
        self.called = False
        """True once Python, not another kernel, has called the machine code."""
        # A division by zero is no error: what is not finite is seen in the sums, as in NumPy.
        self._options = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": _FAST_SUMS, **options}
        update_wrapper(self, function)
        _kernels.append(self)

    def __call__(self, *args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        """Call the machine code where kernels are wanted, the Python function elsewhere."""
        if not wanted():
            return self.py_func(*args, **kwargs)
        self.called = True
        called: Result = self.in_numba(*args, **kwargs)
        return called

    @cached_property
    def in_numba(self) -> Any:
        """Return the function compiled by Numba, with the kernels that it calls compiled likewise."""
        with _lock:
            numba, function = _numba(), self.py_func
            assert isinstance(function, FunctionType)
            seen = {name: function.__globals__.get(name) for name in _names(function.__code__)}
            replaced = {name: getattr(value, "in_numba", value) for name, value in seen.items()}
            known = {**function.__globals__, **{k: v for k, v in replaced.items() if v is not seen[k]}}
            same = FunctionType(
                function.__code__, known, function.__name__, function.__defaults__, function.__closure__
            )
            same.__qualname__ = function.__qualname__
            before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(_folder())
            try:
                return numba.njit(**self._options)(same)
            finally:
                numba.config.CACHE_DIR = before


_kernels: list[Kernel[..., Any]] = []


def _names(code: CodeType) -> set[str]:
    inner = (one for one in code.co_consts if isinstance(one, CodeType))
    return set(code.co_names).union(*map(_names, inner))


def compile_kernel(function: Callable[Parameters, Result]) -> Kernel[Parameters, Result]:
    """A function to be compiled, and kept in the cache.

    What a kernel calls becomes part of its own machine code. Else the system linker of the process decides which of two
    copies of it is called, the one that stands in the caller or that of another kernel: one in the run that compiles,
    the other in those that read the machine code from disk, and the two differ in the last digit.
    """
    return Kernel(function, forceinline=True)


def compile_inline(function: Callable[Parameters, Result]) -> Kernel[Parameters, Result]:
    """A small function to be compiled into the kernels that call it.

    A call that passes arrays costs some 50 nanoseconds, for they are counted in and out.
    """
    return Kernel(function, inline="always")


def load_ahead() -> None:
    """Load kernels in a thread of its own, for a project that looks as if it were worth it.

    That takes a second, in which the caller reads tables: most of it is done outside of the interpreter.
    """
    if available and os.environ.get(ASKED) != "numpy" and _is_there():
        Thread(target=_loaded_or_not, name="kernels").start()


def _loaded_or_not() -> None:
    with suppress(Exception), _lock:  # who needs them is told
        if not _state and _is_sealed():
            _load()


def _numba() -> Any:
    """The compiler, imported and set up when it is asked for first; who asks meanwhile waits."""
    with _lock:
        return _imported()


@cache
def _imported() -> Any:
    import numba

    if "NUMBA_SLP_VECTORIZE" not in os.environ:
        # Blocks of six by six are written out entry by entry. Packed into vector registers that takes half the time.
        numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]
    return numba


# The cache: a folder for each state of the sources, of Numba and of the processor.

_SEAL, _SIGNATURES = "seal.json", "signatures"
_compiling: list[Path] = []
"""The folder that this process fills."""


def cache_root() -> Path:
    """The folder of all caches: ``mor`` in the one that ``NUMBA_CACHE_DIR`` names, or where the system has caches."""
    home = Path.home()
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(given) / "mor"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "mor" / "Cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "mor"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "mor"


def _folder() -> Path:
    return _compiling[0] if _compiling else cache_root() / f"kernels-{_state_of_code()}"


@cache
def _state_of_code() -> str:
    """Digest of all code that kernels call, with the paths and times of its files.

    Numba takes a kernel from the cache only if the path and the time of its file are the same. Otherwise it compiles
    the kernel and says nothing. It does not look at the files of what a kernel calls.
    """
    import llvmlite.binding as llvm
    import numpy as np

    files = [
        file
        for file in Path(__file__).parents[1].rglob("*.py")
        if b"compile_kernel" in (code := file.read_bytes()) or b"registers" in code
    ]
    digest = hashlib.sha256()
    for file in sorted({*files, Path(__file__)}):
        digest.update(file.read_bytes() + repr((str(file), file.stat().st_mtime_ns)).encode())
    settings = {k: v for k, v in os.environ.items() if k.startswith("NUMBA_") and k != "NUMBA_CACHE_DIR"}
    versions = platform.python_version(), _numba().__version__, llvm.llvm_version_info, np.__version__
    processor = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    digest.update(repr((versions, processor, sorted(settings.items()))).encode())
    return digest.hexdigest()[:32]


def _is_sealed() -> bool:
    return _is_there() and (_folder() / _SEAL).is_file()


def _is_there() -> bool:
    """True if any sealed cache exists; found out without importing Numba."""
    return any(cache_root().glob(f"kernels-*/{_SEAL}"))


def compile_all(steps: Iterable[Callable[[], object]], done: Callable[[], None]) -> Path:
    """Fill an empty cache by doing ``steps`` with kernels, and return its folder; ``done`` is called after each.

    Nobody sees the folder before it is whole. Raises what the steps raise, ``OSError`` where nothing can be written.
    """
    final = _folder()
    final.parent.mkdir(parents=True, exist_ok=True)
    _remove_unused(final.parent)
    filled = Path(tempfile.mkdtemp(prefix=f"{final.name}.", dir=final.parent))
    _compiling.append(filled)
    try:
        with kernels_used(True):
            for step in steps:
                step()
                done()
        signatures = [(one.__module__, one.py_func.__name__, one.in_numba.signatures) for one in _kernels if one.called]
        (filled / _SIGNATURES).write_bytes(pickle.dumps(signatures))
        sums = {path.relative_to(filled).as_posix(): _checksum(path) for path in _sealed_files(filled)}
        (filled / _SEAL).write_text(json.dumps(sums, indent=0))
        if final.exists():
            final.rename(filled.with_suffix(".old"))
        filled.rename(final)
    finally:
        _compiling.clear()
        for folder in (filled, filled.with_suffix(".old")):
            shutil.rmtree(folder, ignore_errors=True)
    return final


def _sealed_files(folder: Path) -> Iterator[Path]:
    """All files but the indices, which Numba rewrites when it compiles a kernel for further types of arguments."""
    yield from (folder / _SIGNATURES, *folder.rglob("*.nbc"))


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _compile_apart() -> None:
    """Fill the cache in another process, which leaves nothing of what it compiles with in this one."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "MOR_LANG": "en"}
    process = subprocess.Popen(
        [sys.executable, "-m", "mor", "compile", "--quiet"],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        _, said = process.communicate()
    except BaseException:
        process.terminate()  # it removes what it has begun
        process.wait()
        raise
    if process.returncode:
        raise _UnusableError((said.splitlines() or [f"mor compile ended with {process.returncode}"])[-1])


def _remove_unused(root: Path) -> None:
    """Remove caches that nobody has used for long, and what runs that were killed have left."""
    # Age (s) of a folder that is being filled, and that nobody fills any more; of one that nobody has used for long.
    abandoned, old = 86_400.0, 90 * 86_400.0
    for folder in root.glob("kernels-*"):
        with suppress(OSError):
            age = time.time() - folder.stat().st_mtime
            if age > (abandoned if folder.suffix else old):
                shutil.rmtree(folder)


# Which is sooner done: by the speed of this machine, measured once.


def _compiling_is_sooner(observations: int) -> bool:
    numpy, python = _speed()
    # Rounds of :func:`_measured`: in NumPy those an observation takes (0.1 ms), in Python those of compiling (180 s).
    numpy_rounds, python_rounds = 0.36, 300_000.0
    return observations * numpy_rounds / numpy > python_rounds / python


def _speed() -> tuple[float, float]:
    """Rounds a second of NumPy and of Python, measured once and kept beside the cache."""
    path = cache_root() / "speed.json"
    with suppress(OSError, ValueError, TypeError, KeyError):
        known = json.loads(path.read_text())
        return float(known["numpy"]), float(known["python"])
    import numpy as np

    blocks = np.ones((2_000, 6, 6))
    numpy, python = (_rounds(lambda: blocks @ blocks), _rounds(lambda: [{"a": n, "b": str(n)} for n in range(2_000)]))
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"numpy": numpy, "python": python}))
    return numpy, python


def _rounds(work: Callable[[], object]) -> float:
    begun, count = time.process_time(), 0
    while (passed := time.process_time() - begun) < 0.05:
        work()
        count += 1
    return count / passed
