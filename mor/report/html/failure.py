"""The page where there is no solution: the verdict, the iterations, what does not come to rest, what fits worst.

It shows no places and no cameras: what looks like a result would be taken for one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from mor.quality.solved import Solved
from mor.report.html.paper import running_heads
from mor.report.html.provenance import listed_notes
from mor.report.layout import fixed, short
from mor.report.results.failure import failure
from mor.report.results.summary import summary
from mor.report.text.head import verdict
from mor.report.text.identity import persons
from mor.report.text.undetermined import section
from mor.report.words.language import ENGLISH, Words

SHOWN = 1000
"""Things that nothing determines that are listed."""


def failure_page(
    solved: Solved, identity: dict[str, Any], notes: Sequence[Mapping[str, Any]], words: Words = ENGLISH
) -> str:
    """The page of an outcome that is no solution, in a language: HTML that needs nothing else.

    ``notes`` are those of :func:`mor.report.notes.note_rows`.
    """
    environment = Environment(
        loader=PackageLoader("mor.report.html"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"short": short, "fixed": fixed}
    data = summary(solved)
    content: dict[str, Any] = {
        "title": data["title"] or words("Adjustment"),
        "summary": data,
        "identity": identity,
        **listed_notes(notes, words),
        "persons": persons(identity, words),
        "verdict": verdict(solved, words),
        "explained": section(solved, words).splitlines()[2:],
        "things": data["undeterminable"][:SHOWN],
        "more": max(0, len(data["undeterminable"]) - SHOWN),
        "failure": failure(solved) or {},
        "say": words,
        "running": running_heads(data["title"] or words("Adjustment"), identity, words),
        "style": Markup(files("mor.report.html").joinpath("assets", "page.css").read_text(encoding="utf-8")),
    }
    return environment.get_template("failure.html.j2").render(**content)
