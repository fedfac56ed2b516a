"""``README.txt`` of a folder of results: what each file is, for whoever gets the folder."""

from __future__ import annotations

import textwrap
from collections.abc import Collection
from fnmatch import fnmatch
from pathlib import Path

from mor.report.words.language import ENGLISH, Words

FILE = "README.txt"
MEANINGS = {
    "report.html": "the report to look at and to print, in a browser: verdict, pictures, tables; needs no network",
    "report.txt": "the report as text, for the file: verdict first; last what it was read from, and who signs",
    "results.json": "all results for programs; mor schema results describes every key",
    "points.*": "coordinates of the points with sigma, correlations and error ellipsoids",
    "places.*": "the points in their reference system, above ellipsoid and geoid, and geocentric",
    "motions.*": "velocities, oscillations and steps of points, each with its test",
    "movements.*": "movements of points between epochs with sigma and test; as a page, also against time",
    "trajectories.*": "knots of the trajectories: time, place and rotation angles with sigma",
    "images.*": "places and rotation angles of the images with sigma",
    "residuals.*": "every observation: observed, adjusted, residual v, redundancy number r, test w, reliability",
    "residuals_worst.*": "the observations with the largest test values",
    "undetermined.csv": "what nothing determines, and why",
    "external_reliability.csv": "where an error that stays unseen moves each point, of many those controlled least",
    "adjusted.yaml": "the project with the adjusted values as start values: mor adjust, datum, covariance and "
    "compare read it",
    "reference.csv": "the coordinates that the datum refers to",
    "start_*.csv": "tables of adjusted.yaml",
    "given_*.csv": "tables of adjusted.yaml",
}
"""What each file is, by its name or a pattern of names, in the order they are listed."""
_FIRST = "What is in this folder"
_WIDTH = 100


def readme(names: Collection[str], words: Words = ENGLISH) -> str:
    """The text, about the files that are there."""
    title = words(_FIRST)
    lines = [title, "=" * len(title), "", words("Results of an adjustment by mor."), ""]
    width = max(map(len, names), default=0) + 2
    for pattern, meaning in MEANINGS.items():
        for name in sorted(name for name in names if fnmatch(name, pattern)):
            told = textwrap.wrap(words(meaning), _WIDTH - width)
            lines += [name.ljust(width) + told[0], *(" " * width + line for line in told[1:])]
    lines += [
        "",
        *textwrap.wrap(
            words(
                "The same command with the same input makes these files anew, to the byte. Where input or options have "
                "changed, mor adjust asks for --force before it replaces them. Other files in this folder stay."
            ),
            _WIDTH,
        ),
    ]
    return "\n".join(lines) + "\n"


def may_write(folder: Path, languages: Collection[Words]) -> bool:
    """False if a file of that name stands in the folder that is not a readme of mor."""
    path = folder / FILE
    if not path.is_file():
        return not path.exists()
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.readline().strip() in {words(_FIRST) for words in languages}
