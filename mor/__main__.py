"""``mor`` and ``python -m mor``: the process around the command line."""

from __future__ import annotations

import gc
import signal
import sys
import warnings
from types import FrameType


def main() -> None:
    """Run the command line and exit with the documented code.

    Asked to end (SIGTERM), or left by its terminal (SIGHUP), the program tidies up as after Ctrl-C.
    """
    heeded = [signal.SIGINT]
    try:
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                heeded.append(number)
                signal.signal(number, _interrupt)
        _heed_warnings()
        gc.set_threshold(_OBJECTS)
        from mor.cli import run

        code = run()
        for number in heeded:
            signal.signal(number, signal.SIG_DFL)  # all is done
    except KeyboardInterrupt as interruption:
        code = 128 + int(next(iter(interruption.args), signal.SIGINT))
    gc.freeze()  # all memory goes with the process: nothing is looked for in what is there
    sys.exit(code)


_OBJECTS = 50_000
"""New objects after which Python looks for circles of garbage, in place of 700: loading modules makes none.

With :func:`gc.freeze` at the end it saves a sixth of the time of the smallest network.
"""


def _interrupt(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)  # once is enough
    raise KeyboardInterrupt(number)


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
