"""The text report: one file for each section, put together in one order."""

from __future__ import annotations

from mor.escapes import escaped
from mor.quality.solved import Solved
from mor.report.hypotheses.text import section as section_of_hypotheses
from mor.report.text import (
    cameras,
    checks,
    features,
    groups,
    head,
    images,
    others,
    points,
    reliability,
    residuals,
    stations,
    suspects,
    undetermined,
    unsettled,
)
from mor.report.verdict import sentences, words_of_reliability
from mor.report.words.language import ENGLISH, Words


def text_report(solved: Solved, words: Words = ENGLISH) -> str:
    """The whole report in a language. Sections without content are left out."""
    sections = [
        head.section(solved, words),
        undetermined.section(solved, words),
        undetermined.listed(solved, words),
        unsettled.section(solved, words),
        suspects.section(solved, words),
        section_of_hypotheses(solved, words),
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
    ]
    return escaped("\n\n".join(section for section in sections if section)) + "\n"
