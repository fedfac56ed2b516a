"""The text report: one file for each section, put together in one order."""

from __future__ import annotations

from mor.escapes import escaped
from mor.quality.solved import Solved
from mor.report.identity import Identity, identity_of
from mor.report.text import (
    cameras,
    checks,
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
from mor.report.verdict import sentences, words_of_reliability
from mor.report.words.language import ENGLISH, Words


def text_report(solved: Solved, words: Words = ENGLISH, of: Identity = Identity()) -> str:  # noqa: B008 - frozen
    """The whole report in a language, ``of`` what was read. Sections without content are left out."""
    about = identity_of(solved.network.project, of)
    sections = [
        head.section(solved, words, identity.persons(about, words)),
        undetermined.section(solved, words),
        undetermined.listed(solved, words),
        unsettled.section(solved, words),
        suspects.section(solved, words),
        hypotheses.section(solved, words),
        checks.section(solved, words),
        sentences.section(solved, words),
        words_of_reliability.section(solved, words),
        reliability.section(solved, words),
        groups.section(solved, words),
        cameras.section(solved, words),
        images.section(solved, words),
        stations.section(solved, words),
        features.section(solved, words),
        others.section(solved, words),
        points.section(solved, words),
        residuals.section(solved, words),
        identity.section(about, words),
    ]
    return escaped("\n\n".join(section for section in sections if section)) + "\n"
