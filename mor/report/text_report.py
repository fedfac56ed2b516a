"""The text report: one file for each section, put together in one order."""

from __future__ import annotations

from mor.escapes import escaped
from mor.quality.solved import Solved
from mor.report.columns import paragraphs
from mor.report.identity import Identity, identity_of
from mor.report.layout import ALL
from mor.report.motions import text as motions
from mor.report.notes import note_rows
from mor.report.places import text as places
from mor.report.text import (
    cameras,
    checks,
    ellipses,
    features,
    groups,
    head,
    identity,
    images,
    others,
    points,
    reliability,
    residuals,
    stations,
    undetermined,
    unsettled,
)
from mor.report.text.gross_errors import hypotheses, suspects
from mor.report.trajectories import text as trajectories
from mor.report.verdict import sentences, words_of_reliability
from mor.report.words.language import ENGLISH, Words


def text_report(
    solved: Solved,
    words: Words = ENGLISH,
    of: Identity = Identity(),  # noqa: B008 - frozen
    full: bool = False,
) -> str:
    """The whole report in a language, ``of`` what was read; ``full`` with nothing left to the tables beside it.

    Sections without content are left out. No line is longer than :data:`mor.report.columns.WIDTH`, but for single
    words that are.
    """
    about = identity_of(solved.network.project, of)
    shown: dict[str, int] = {"shown": ALL} if full else {}
    sections = [
        head.section(solved, words, identity.persons(about, words)),
        undetermined.section(solved, words),
        undetermined.listed(solved, words, **shown),
        unsettled.section(solved, words, **shown),
        suspects.section(solved, words, **shown),
        hypotheses.section(solved, words),
        motions.section(solved, words, **shown),
        checks.section(solved, words),
        sentences.section(solved, words, **shown),
        words_of_reliability.section(solved, words, **({"weakest": ALL, "named": ALL} if full else {})),
        reliability.section(solved, words, **shown),
        groups.section(solved, words),
        cameras.section(solved, words),
        images.section(solved, words),
        trajectories.section(solved, words, **shown),
        stations.section(solved, words),
        features.section(solved, words),
        others.section(solved, words),
        places.section(solved, words, **shown),
        points.section(solved, words, **shown),
        ellipses.section(solved, words) if full else "",
        ellipses.relative(solved, words, neighbours=full),
        residuals.section(solved, words),
        residuals.listed(solved, words) if full else "",
        identity.section(about, words, note_rows(solved.network.notes, of.folder), **shown),
    ]
    return paragraphs(escaped("\n\n".join(section for section in sections if section))) + "\n"
