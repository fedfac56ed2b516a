"""``python -m tests.memory.measure project.yaml [options of mor adjust]``: memory as estimated, and as it was.

To be run in a process of its own: the largest resident size is that of the process.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import mor.machine
import mor.solve.iterate
from mor.cli import run

MB = 1e6


def measure(arguments: list[str]) -> dict[str, float]:
    """Run ``mor adjust``; the estimate is what was there when the adjustment began and all that was said to follow."""
    asked: dict[str, float] = {}
    begun: list[float] = []

    def told(further: float, phase: str, advice: str) -> None:
        if phase == "the adjustment" and not begun:
            begun.append(mor.machine.resident())
        asked[phase] = max(further, asked.get(phase, 0.0))

    replaced: Any = told
    mor.machine.check_room = replaced
    mor.solve.iterate.check_room = replaced
    code = run(["adjust", *arguments, "-q", "--force"])
    # Not ru_maxrss: that begins with the size of the process this one was forked from.
    peak = mor.machine._field(Path("/proc/self/status"), "VmHWM") or 0.0
    estimate = begun[0] + asked["the adjustment"] + asked["writing the reports"]
    return {"code": float(code), "estimated": estimate / MB, "measured": peak / MB}


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1:])))
