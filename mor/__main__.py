"""``mor`` and ``python -m mor``: the process around the command line."""

from __future__ import annotations

import gc
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import FrameType, ModuleType
from typing import TextIO


def main() -> None:
    """Run the command line and exit with the documented code.

    Asked to end (SIGTERM), or left by its terminal (SIGHUP), the program tidies up as after Ctrl-C. Where not even
    words can be written (standard error on a full disk) the code alone says so.
    """
    heeded = []
    _open_closed_streams()
    # Exit code where something cannot be written.
    not_written = 2
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                heeded.append(number)
                signal.signal(number, _interrupt)
        sys.unraisablehook = _unraisable
        _heed_warnings()
        # New objects after which Python looks for circles of garbage, in place of 700: loading modules makes none. With
        # :func:`gc.freeze` at the end it saves a sixth of the time of the smallest network.
        gc.set_threshold(200_000)
        for name, value in _ENVIRONMENT.items():
            os.environ.setdefault(name, value)
        sys.meta_path.insert(0, _WhenUsed)
        from mor.cli import run

        code = run(signals=_CAME)
        for number in heeded:
            signal.signal(number, signal.SIG_DFL)  # all is done
    except KeyboardInterrupt as interruption:
        code = 128 + int(next(iter(interruption.args), signal.SIGINT))
    except OSError:
        code = not_written
    if not _flushed():
        code = code or not_written
    gc.freeze()  # all memory goes with the process: nothing is looked for in what is there
    sys.exit(code)


def _flushed() -> bool:
    """Flush the standard streams. Lead one that fails to nowhere, or Python exits with a code of its own."""
    said = True
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:  # the reader has gone, which is no error
            _lead_nowhere(stream)
        except OSError:
            said = False
            _lead_nowhere(stream)
    return said


def _lead_nowhere(stream: TextIO) -> None:
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def _open_closed_streams() -> None:
    """Lead standard streams that the caller has closed to nowhere, so that no file of results gets their number."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - open to the end


_ENVIRONMENT = {
    # it looks for plugins through all that is installed
    "PYDANTIC_DISABLE_PLUGINS": "true",
    # OpenBLAS has a thread for every further core, and each of them waits for its first work with the core running: for
    # 2**26 cycles, a tenth of the time of the smallest network. 2**20 are 0.3 ms, longer than between two products.
    "OPENBLAS_THREAD_TIMEOUT": "20",
}


class _WhenUsed:
    """Finds what is to be loaded by its first use: SciPy's array interface asks for all that is in numpy.

    These packages are for developers or hardly ever used here, and they take an eighth of the time of the smallest
    network.
    """

    NAMES = ("numpy.f2py", "numpy.polynomial", "numpy.testing")

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return what the usual finder has, with a loader that waits; nothing for any other module."""
        spec = PathFinder.find_spec(name, path, target) if name in cls.NAMES else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise an interruption; a moment later where modules are being loaded.

    There a lock is held that other threads wait for, and what is raised between taking it and the ``try`` after it, or
    in a callback, leaves it taken for ever.
    """
    loading = "<frozen importlib._bootstrap>"
    if frame is not None and frame.f_code.co_filename == loading and hasattr(signal, "setitimer"):
        _interrupt_later(number)
        return
    if number != signal.SIGINT:  # Ctrl-C may be pressed again
        signal.signal(number, signal.SIG_IGN)
    _CAME.append(number)
    raise KeyboardInterrupt(number)


def _interrupt_later(number: int) -> None:
    signal.signal(signal.SIGALRM, lambda _, there: _interrupt(number, there))
    signal.setitimer(signal.ITIMER_REAL, 1e-3)  # seconds


def _unraisable(lost: sys.UnraisableHookArgs) -> None:
    """Interrupt again if Python has dropped an interruption.

    It drops what is raised in functions that C code calls, as LLVM does when a kernel is compiled, and in destructors.
    """
    if isinstance(lost.exc_value, KeyboardInterrupt) and hasattr(signal, "setitimer"):
        _interrupt_later(int(next(iter(lost.exc_value.args), signal.SIGINT)))
    elif not _CAME:  # what an interruption leaves half made, its destructors may complain of
        sys.__unraisablehook__(lost)


_CAME: list[int] = []
"""Signals that have interrupted this run."""


def _heed_warnings() -> None:
    """Let no warning of Python reach the user.

    Arithmetic that ends in NaN or infinity unasked is an error of the program: no number may come of it. What
    libraries say of their own future, or of speed, is for developers, and an error in the tests.
    """
    if not sys.warnoptions:  # nothing asked for by -W or PYTHONWARNINGS
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)


if __name__ == "__main__":
    main()
