"""What is wrong with the end of a command, whatever its input was: codes, words, numbers, time and memory."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

SLOW, LARGE = 20.0, 2.0
"""Seconds of computing, and GB, that nothing may take."""
SCREEN = 60
"""Lines that the terminal may be given at most."""
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
_WARNING = re.compile(r"\b\w*Warning: |Traceback|pyo3_runtime|panicked")
_DOCUMENTED = {0, 1, 2, 3, 4}


@dataclass(frozen=True)
class Ended:
    """A command that has ended."""

    command: tuple[str, ...]
    code: int
    said: str
    """What it wrote on standard error."""
    seconds: float
    peak: float
    """GB of memory."""


def faults(ended: Ended, folder: Path, results: Path) -> list[str]:
    """Everything that is wrong, each opened by the kind of the fault; empty where all is well."""
    file = results / "results.json"
    found = list(_of_the_end(ended, folder, file))
    if file.is_file():
        found += _of_results(ended, file)
    if ended.code == 2 and results.exists() and {own.name for own in results.iterdir()} != {"undetermined.csv"}:
        found.append("left behind: results of a project that was refused")
    return found


def _of_the_end(ended: Ended, folder: Path, file: Path) -> Iterator[str]:
    last = ended.said.strip().splitlines()[-1:] or [""]
    if ended.code not in _DOCUMENTED or (ended.code == 1 and not _may_be_rejected(ended, file)):
        yield f"exit {ended.code}: {last[0]}"
    if _WARNING.search(ended.said):
        yield f"warning: {last[0]}"
    if _CONTROL.search(ended.said):
        yield f"control characters: {_CONTROL.search(ended.said)!r}"
    lines = ended.said.splitlines()
    if len(lines) > SCREEN:
        yield f"long: {len(lines)} lines on the terminal"
    if ended.code == 2 and not any(str(folder) in line for line in lines[:1]):
        yield f"no place: {lines[0] if lines else 'nothing was said'}"
    if ended.seconds > SLOW:
        yield f"slow: {ended.seconds:.0f} s"
    if ended.peak > LARGE:
        yield f"large: {ended.peak:.1f} GB"


def _may_be_rejected(ended: Ended, file: Path) -> bool:
    """True where code 1 was asked for, or suspects of gross errors had to be left out for an end to be reached."""
    return "--strict" in ended.command or (file.is_file() and _suspects(file))


def _suspects(file: Path) -> bool:
    try:
        return bool(json.loads(file.read_text(encoding="utf-8")).get("suspects"))
    except ValueError:
        return False


def _of_results(ended: Ended, file: Path) -> Iterator[str]:
    try:
        data = json.loads(file.read_text(encoding="utf-8"), parse_constant=_not_finite)
    except ValueError as error:
        yield f"not finite: {error}"
        return
    if ended.code not in (0, 1):
        if data["outcome"] == "converged" and ended.code != 2:
            yield f"outcome: converged with exit code {ended.code}"
        return
    if data["outcome"] != "converged":
        yield f"outcome: {data['outcome']} with exit code {ended.code}"
    expected, found = data["redundancy"], data["redundancy_sum"]
    if expected is None or found is None or abs(expected - found) > 1e-6 * max(data["observations"], 1):
        yield f"redundancy: sum {found}, expected {expected}"
    yield from _of_sigma(data)


def _not_finite(text: str) -> float:
    raise ValueError(f"{text} in results.json")


def _of_sigma(data: dict[str, Any]) -> Iterator[str]:
    """σ of 0 of what is free. A datum over as many coordinates as there are movements holds them."""
    if (data["sigma0"] or {}).get("used_for_sigma") == 0.0:
        return
    free = [point for point in data["points"] or [] if point["status"] == "free"]
    held = [point["id"] for point in free for key in ("sx", "sy", "sz") if point[key] == 0.0]
    if held and (data["datum"] == "free" or len(held) > data["defect"]):
        yield f"sigma: 0 of the free point {held[0]!r}"
        return
    for camera in data["cameras"]:
        for name, row in camera["components"].items():
            if row["status"] == "free" and row["sigma"] == 0.0:
                yield f"sigma: 0 of {name} of camera {camera['id']!r}"
                return
