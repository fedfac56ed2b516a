"""Memory and processors that this process may use, and messages if they do not suffice.

Memory is the least of: what the machine has available, what the control group of the process leaves, and the limit of
its address space (``ulimit -v``). Where the system tells none of them, nothing is refused.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from mor.errors import OutOfMemoryError

ENVIRONMENT = "MOR_MEMORY_MB"
"""Environment variable that says how much the process may take in all, in place of what the system says."""
_MB = 1e6
Thing = TypeVar("Thing")
Made = TypeVar("Made")


def processors() -> int:
    """Return the number of processors that this process may run on, or that it was told to use."""
    if _USED:
        return _USED[-1]
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


_USED: list[int] = []


@contextmanager
def processors_used(count: int) -> Iterator[None]:
    """Use so many threads, however many processors there are."""
    _USED.append(count)
    try:
        yield
    finally:
        _USED.pop()


def worked_ahead(things: Iterable[Thing], work: Callable[[Thing], Made]) -> Iterator[Made]:
    """Yield the result of the work for each thing, in order, with a thread for each processor."""
    workers = processors()
    waiting: deque[Future[Made]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        for thing in things:
            waiting.append(pool.submit(work, thing))
            if len(waiting) > workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def check_room(further: float, phase: str, advice: str) -> None:
    """Raise :class:`OutOfMemoryError` where ``further`` bytes are more than there are left."""
    left = available()
    if left is None or further <= left:
        return
    if _ALLOWED:
        most = _said(_ALLOWED[-1][0])
        words = f"{phase} needs about {_said(further)} of memory more, and {_said(left)} of {most} are left (--memory)"
        raise OutOfMemoryError(f"{words}. What helps: a larger limit; {advice}.")
    words = f"{phase} needs about {_said(further)} of memory more, and {_said(left)} are left"
    raise OutOfMemoryError(f"{words}. What helps: {advice}; a machine with more of it ({ENVIRONMENT}=… overrules).")


_ALLOWED: list[tuple[float, Callable[[], None]]] = []
"""Bytes that the process may take, as the user has asked, and what gives back memory that is not needed now."""


@contextmanager
def memory_allowed(size: float, give_back: Callable[[], None]) -> Iterator[None]:
    """Allow this process ``size`` bytes in all; ``give_back`` is called before it is asked how much is left."""
    _ALLOWED.append((size, give_back))
    try:
        yield
    finally:
        _ALLOWED.pop()


def check_address_space() -> None:
    """Raise :class:`OutOfMemoryError` where the libraries do not go into what ``ulimit -v`` leaves."""
    left = _of_address_space()
    # Bytes of address space in which libraries are loaded: in less, OpenBLAS ends the process, or waits for ever.
    libraries = 1.6e9
    if left is not None and left < libraries:
        raise OutOfMemoryError(
            f"loading of the libraries needs {_said(libraries)} of address space, "
            f"and {_said(left)} are left (ulimit -v)"
        )


def _said(size: float) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / _MB:.0f} MB"


def available() -> float | None:
    """Bytes that this process may still take; ``None`` if nobody knows."""
    most = None
    if _ALLOWED:
        most, give_back = _ALLOWED[-1]
        give_back()
    given = os.environ.get(ENVIRONMENT, "")
    if most is None and given.isascii() and given.isdigit():
        most = float(given) * _MB
    if most is not None:
        return max(most - resident(), 0.0)
    found = [size for size in (_of_machine(), _of_group(), _of_address_space()) if size is not None]
    return max(min(found), 0.0) if found else None


def resident() -> float:
    """Bytes of memory the process takes now; 0 where nobody knows."""
    return _field(Path("/proc/self/status"), "VmRSS") or 0.0


def pages_of_files() -> float:
    """Bytes of files that are mapped and resident now; 0 where nobody knows."""
    return _field(Path("/proc/self/status"), "RssFile") or 0.0


def _of_machine() -> float | None:
    return _field(Path("/proc/meminfo"), "MemAvailable")


def _of_group() -> float | None:
    """Return what the control groups leave (version 2, or 1); files in their caches give way."""
    found = [
        most - now + (_field(folder / "memory.stat", cache, 1.0) or 0.0)
        for folder, limit, used, cache in _groups()
        if (most := _number(folder / limit)) is not None and (now := _number(folder / used)) is not None
    ]
    return min(found, default=None)


def _groups() -> list[tuple[Path, str, str, str]]:
    """Folders of the groups of this process with the names of their limit, of what is used, and of cached files."""
    try:
        own = Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        own = []
    group = next((line[3:] for line in own if line.startswith("0::")), "/")
    groups_root = Path("/sys/fs/cgroup")
    inner = groups_root / group.lstrip("/")
    chain = [inner, *(folder for folder in inner.parents if folder.is_relative_to(groups_root))]
    second = [(folder, "memory.max", "memory.current", "inactive_file") for folder in chain]
    first = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    return [*second, (groups_root / "memory", *first)]


def _of_address_space() -> float | None:
    try:
        import resource
    except ImportError:  # not on this system
        return None
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    used = _field(Path("/proc/self/status"), "VmSize")
    return None if most == resource.RLIM_INFINITY or used is None else max(most - used, 0.0)


def _number(path: Path) -> float | None:
    try:
        text = path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None
    return float(text) if text.isdigit() else None


def _field(path: Path, name: str, unit: float = 1024.0) -> float | None:
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        return None
    match = re.search(rf"^{name}:?\s+(\d+)", text, re.MULTILINE)
    return unit * float(match[1]) if match else None
