"""Counted things in words: 1 image, 2 images."""

from __future__ import annotations


class Place(str):
    """A placeholder in a sentence; ``{count:image|images}`` chooses the singular or plural noun."""

    __slots__ = ()

    def __format__(self, words: str) -> str:
        one, bar, many = words.partition("|")
        return f"{self!s} {one if self == '1' else many}" if bar else format(str(self), words)


def counted(count: int, one: str, many: str = "") -> str:
    """A count with its word: ``counted(1, "ray")`` is "1 ray", ``counted(2, "ray")`` "2 rays"."""
    return f"{count} {one if count == 1 else many or one + 's'}"
