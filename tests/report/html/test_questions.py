"""Ten questions of whoever signs: each is answered in the verdict, or among the judgements and what they link to."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import pytest

from mor.report.language import ENGLISH, words_of
from mor.report.page import next_steps, page
from mor.report.page_data import page_data
from mor.report.view import View

ANSWERS = {
    "accepted?": (None, r"(Accepted|Not accepted)"),
    "worst observation?": ("Single observations", r"The worst is .+: w = "),
    "how good is a point?": ("Points", r"the weakest point is \S+ \(longest semi-axis"),
    "the camera?": ("Camera D7", r"c = [\d.]+ ± "),
    "which datum?": ("Datum", r"Coordinates and σ refer to it"),
    "what is uncontrolled?": ("Reliability", r"observations have r < 0\.1"),
    "what would help?": (None, r"mor design adjusted\.yaml --rank"),
    "was everything used?": ("Input", r"\d+ observations adjusted, \d+ not used"),
    "from which files?": ("Input", r"\d+ files? read"),
    "may it be compared?": ("Another epoch", r"mor compare OTHER THIS --epochs"),
}
"""Statement that answers, and what it says; of None the verdict."""
BEHIND = {"Single observations": "table-residuals", "Points": "table-points", "Input": "signature"}
"""What stands in the section behind the link of a statement."""


def rejected(view: View) -> View:
    test = {**view.summary["global_test"], "statistic": 1e6, "accepted": False}
    return replace(view, summary={**view.summary, "global_test": test})


@pytest.mark.parametrize("clean", [True, False], ids=["clean", "rejected"])
def test_every_question_has_an_answer(facade_view: View, clean: bool) -> None:
    text = page(facade_view if clean else rejected(facade_view))
    headline = html.unescape(text[text.index('<section id="verdict">') : text.index("</section>")])
    judged = text[text.index('<section id="judgements">') :]
    first = judged[: judged.index("</section>")]
    found = re.findall(r"<dt>(?:<a href=\"#([\w-]+)\">)?([^<]+)(?:</a>)?</dt><dd>(.*?)</dd>", first, re.S)
    statements = {title: (link, html.unescape(words)) for link, title, words in found}
    for question, (title, said) in ANSWERS.items():
        words = statements[title][1] if title else headline
        assert re.search(said, words), question
    assert ("Not yet" in statements["Another epoch"][1]) is not clean
    for title, (link, _) in statements.items():
        assert not link or text.count(f'id="{link}"') == 1, f"{title} links to {link}"
        if title in BEHIND:
            section = text[text.index(f'id="{link}"') :]
            assert BEHIND[title] in section[: section.index("</section>")]


def test_sections_of_the_head_are_there(facade_view: View) -> None:
    text = page(facade_view)
    links = re.findall(r'<a href="#([\w-]+)">', text)
    assert len(links) > 15
    assert [link for link in links if text.count(f'id="{link}"') != 1] == []


def test_what_to_do_next_names_the_sigmas_of_a_rejected_test_and_each_row_once(building_view: View) -> None:
    assert not any("Check the σ" in step for step in next_steps(page_data(building_view, ENGLISH)))
    german = next_steps(page_data(rejected(building_view), words_of("de", "page")))
    assert german[0].startswith("Die σ der Beobachtungen prüfen: Die Verbesserungen sind 0.96-mal")
    assert "parameter von Punkt N1" in german[1]
    loose = {**building_view.reliability, "observations": 2 * building_view.reliability["observations"][:1]}
    twice = next_steps(page_data(replace(building_view, reliability=loose), ENGLISH))
    assert twice[0].count("N1") == 1
