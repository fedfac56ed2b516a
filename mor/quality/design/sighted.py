"""What planned observations see, where a project leaves that to be worked out."""

from __future__ import annotations

from typing import NamedTuple

REASONS = ("seen", "range", "frame", "incidence", "hidden")
"""What becomes of a sight: seen; out of range; off the format, or too steep; too slanting; hidden by a surface."""


class Sighted(NamedTuple):
    """What a group of planned observations sees."""

    name: str
    section: str
    """``observations`` or ``candidates``."""
    counts: tuple[int, ...]
    """Sights by what becomes of them, in the order of ``REASONS``: the first that keeps them from being seen."""
    unseen: tuple[str, ...]
    """Targets that nothing sees."""
    once: tuple[str, ...]
    """Targets that are seen from one place only."""
