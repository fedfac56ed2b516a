"""What is not determined, in words, with what would help."""

from __future__ import annotations

from mor.adjustment.state import Outcome
from mor.quality.diagnosis.singularities import explain_singularity, turned_about, weakness
from mor.quality.solved import Solved
from mor.report.text.layout import heading
from mor.report.words.language import ENGLISH, Words


def section(solved: Solved, words: Words = ENGLISH) -> str:
    """Explanation of a singular system, or of directions that are hardly determined; nothing otherwise."""
    weak = weakness(solved, words)
    if weak:
        return "\n".join([heading(words("What is hardly determined")), *weak])
    if solved.adjustment.outcome is not Outcome.SINGULAR:
        turned = [] if solved.quality is not None else turned_about(solved, words)
        return "\n".join([heading(words("What is hardly determined")), *turned]) if turned else ""
    return "\n".join([heading(words("What is not determined")), *explain_singularity(solved, words)])
