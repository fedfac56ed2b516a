"""Geometry of the pages of all samples, or of given results: ``python -m tools.every_page [RESULTS ...]``.

Each page in English and German, 400, 800 and 1400 px wide and on paper, light and dark by turns. A line for each page
says what sticks out, overlaps or scrolls sideways; exit code 1 where anything does.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.page_geometry import problems
from tests.scenarios.small_projects import mor

SAMPLES = Path(__file__).parents[1] / "sample_projects"
PAPER = 703
LOOKS = ((400, "dark"), (800, "light"), (1400, "dark"), (PAPER, "printed"))
LANGUAGES = ("en", "de")


def main(results: list[str]) -> int:
    """Check the pages and say what was found; returns the exit code."""
    wrong = 0
    with tempfile.TemporaryDirectory() as place:
        folders = [Path(one) for one in results] or _samples(Path(place))
        for folder in folders:
            for language in LANGUAGES:
                written = Path(place) / "written.html"
                done = mor("report", folder, "--lang", language, "-o", written, "--force")
                assert done.code == 0, done.err
                page = written.read_text(encoding="utf-8")
                wrong += sum(_said(folder, language, page, width, theme, Path(place)) for width, theme in LOOKS)
    return int(wrong > 0)


def _samples(place: Path) -> list[Path]:
    """Results of every sample."""
    folders = []
    for project in sorted(SAMPLES.glob("*/project.yaml")):
        folder = place / project.parent.name
        done = mor("adjust", project, "-o", folder, "--no-html", "--quiet")
        assert done.code in (0, 1, 3), done.err
        folders.append(folder)
    return folders


def _said(folder: Path, language: str, page: str, width: int, theme: str, place: Path) -> int:
    found = problems(page, width, place, theme)
    words = found["found"]
    assert isinstance(words, list)
    state = "; ".join(words) if words else "nothing"
    drawn = "" if found["ready"] == "all" else f" (drawn: {found['ready']})"
    print(f"{folder.name} {language} {width} {theme}: {state}{drawn}", flush=True)
    return len(words)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
