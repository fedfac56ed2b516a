"""Text reports of two sample projects, in both languages, against the files they were read and approved as.

Layout and words must be the same, numbers up to one unit of their last digit (round-off
differs between machines), the number of iterations not at all.
``MOR_WRITE_GOLDEN=1 pytest tests/report/text`` writes the files anew: then read what changed.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from mor.api.pipeline import read_document, read_network, solve_network
from mor.quality.solution import Solved
from mor.report.language import LANGUAGES, words_of
from mor.report.text import text_report

GOLDEN = Path(__file__).parent / "golden"
SAMPLES = Path(__file__).parents[3] / "sample_projects"
NAMES = ("building", "machine_part")
NUMBER = re.compile(r"-?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?")


@pytest.fixture(scope="module", params=NAMES)
def solved(request: pytest.FixtureRequest) -> tuple[str, Solved]:
    folder = SAMPLES / request.param
    document = read_document(folder / "project.yaml")
    return request.param, solve_network(read_network(document, folder))


def last_digit(text: str) -> float:
    """Size of one unit of the last digit of a number."""
    mantissa, _, exponent = text.replace(",", ".").partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals)


def same_number(first: str, second: str) -> bool:
    a, b = (float(text.replace(",", ".")) for text in (first, second))
    return abs(a - b) <= 1.001 * max(last_digit(first), last_digit(second)) or abs(a) + abs(b) < 1e-9


def differences(found: str, expected: str) -> list[str]:
    """Lines that differ in words, columns or numbers."""
    result = []
    lines = found.splitlines(), expected.splitlines()
    if len(lines[0]) != len(lines[1]):
        result.append(f"{len(lines[0])} lines, expected {len(lines[1])}")
    for a, b in zip(*lines, strict=False):
        words = [re.sub(r"[\s-]+", " ", NUMBER.sub("#", line)) for line in (a, b)]
        numbers = ([], []) if "terat" in a else (NUMBER.findall(a), NUMBER.findall(b))
        if words[0] != words[1] or not all(map(same_number, *numbers)):
            result.append(f"found    {a}\nexpected {b}")
    return result


@pytest.mark.parametrize("language", LANGUAGES)
def test_report_is_the_approved_one(solved: tuple[str, Solved], language: str) -> None:
    name, outcome = solved
    text = text_report(outcome, words_of(language))
    path = GOLDEN / f"{name}.{language}.txt"
    if os.environ.get("MOR_WRITE_GOLDEN"):
        path.write_text(text, encoding="utf-8")
    assert differences(text, path.read_text(encoding="utf-8")) == []


def test_reports_in_both_languages_have_the_same_numbers(solved: tuple[str, Solved]) -> None:
    _, outcome = solved
    english, german = (text_report(outcome, words_of(name)) for name in LANGUAGES)
    assert sorted(NUMBER.findall(english)) == sorted(NUMBER.findall(german.replace(",", ".").replace(". ", ", ")))


def test_comparison_sees_a_word_a_number_and_a_line() -> None:
    text = "sigma0  1.0330\npoint A\n"
    assert differences("sigma0  1.0331\npoint A\n", text) == []
    assert len(differences("sigma0  1.0333\npoint A\n", text)) == 1
    assert len(differences("sigma0  1.0330\npoint B\n", text)) == 1
    assert differences("sigma0  1.0330\n", text) == ["1 lines, expected 2"]
