"""One image, two images: what is counted agrees with its number, in every language and on the page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mor.errors import counted
from mor.quality.singularity import english
from mor.report.language import words_of
from tests.scenarios.small_projects import LEVELLING, mor, write

ONE_OF_MANY = re.compile(
    r"\b1 (?:\w+ )?(?:iterations|observations|points|images|cameras|rays|rows|unknowns|Iterationen|Punkte\b|Bilder)"
)


def test_counted() -> None:
    assert [counted(n, "ray") for n in (0, 1, 2, 11, 21)] == [
        "0 rays",
        "1 ray",
        "2 rays",
        "11 rays",
        "21 rays",
    ]
    assert counted(2, "point does", "points do") == "2 points do"


@pytest.mark.parametrize(("count", "said"), [(1, "1 observation is flagged."), (12, "12 observations are flagged.")])
def test_places_of_sentences(count: int, said: str) -> None:
    key = "{count:observation is|observations are} flagged."
    assert english(key, count=count) == words_of("en")(key, count=count) == said
    german = "1 Beobachtung ist auffällig." if count == 1 else f"{count} Beobachtungen sind auffällig."
    assert words_of("de", "page")(key, count=count) == german


@pytest.mark.parametrize("language", ["en", "de"])
def test_one_unknown_and_one_iteration(tmp_path: Path, language: str) -> None:
    """A levelling line of one point, adjusted from its result: everything there is stands there once."""
    text = LEVELLING.replace(", [C, 0, 0, 12]", "").replace(", [B, C, 1.002, 0.001], [C, A, -2.001, 0.001]", "")
    first = mor("adjust", write(tmp_path, text), "--lang", language)
    assert first.code == 0, first.err
    folder = tmp_path / "project.results"
    assert mor("adjust", folder / "adjusted.yaml", "--lang", language, "-o", tmp_path / "again").code == 0
    folder = tmp_path / "again"
    said = [first.err, (folder / "report.txt").read_text(encoding="utf-8")]
    assert "1 Iteration" in said[1].title()
    said.append(re.sub(r"<[^>]*>", "", (folder / "report.html").read_text(encoding="utf-8")))
    assert [found for words in said for found in ONE_OF_MANY.findall(words)] == []


def test_contents(tmp_path: Path) -> None:
    text = LEVELLING.replace(", [C, 0, 0, 12]", "").replace(", [B, C, 1.002, 0.001], [C, A, -2.001, 0.001]", "")
    checked = mor("check", write(tmp_path, text)).out
    assert "       2 points" in checked
    assert "       1 observation, 1 unknown, datum: fixed" in checked
