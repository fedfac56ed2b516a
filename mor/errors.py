"""Texts of the user as they are shown: what would move the cursor, hide letters or break a line is spelled out."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from typing import Literal, NamedTuple

# ---- Texts of the user as they are shown: what would move the cursor, hide letters or break a line is spelled out.

_UNSEEN = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff\ufff9-\ufffb]"
)
"""Control characters but the line feed, marks of the direction of writing, line separators, halves of surrogates."""
LONGEST = 500
"""Letters of a line that a terminal is given."""


def escaped(text: str) -> str:
    """The text with ``\\x1b`` and the like in the place of characters that are no letters; lines stay lines."""
    return _UNSEEN.sub(_spelled, text) if not text.isascii() or not text.isprintable() else text


def shortened(line: str, longest: int = LONGEST) -> str:
    """A line that fits the terminal, or another width; what is left out of its middle is marked."""
    tail = longest // 5
    return line if len(line) <= longest else f"{line[: longest - tail]} … {line[3 - tail :]}"


def _spelled(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


# ---- Errors as data: every message has a location, and every failure an exit code.


class ExitCode(IntEnum):
    """Exit codes of the command line, as documented in ``docs/exit-codes.md``."""

    DONE = 0
    REJECTED = 1
    INPUT = 2
    NOT_CONVERGED = 3
    SINGULAR = 4
    MEMORY = 5
    INTERNAL = 70


class Message(NamedTuple):
    """One mistake in the input: where it stands, what was found, what was expected.

    ``file`` and ``line`` may be empty (``""``, 0) where a problem belongs to no single place.
    """

    message: str
    file: str = ""
    line: int = 0

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}: " if self.line else f"{self.file}: " if self.file else ""
        return escaped(f"{place}{self.message}")


MOST_TOLD = 20
"""Mistakes or notes that fill a screen."""


def screenful(notes: Sequence[Message], told_by: str) -> Sequence[Message]:
    """Notes that a terminal is given: all, or the first ones, how many more there are, and what lists all of them."""
    more = len(notes) - MOST_TOLD
    if more <= 0:
        return notes
    return [*notes[:MOST_TOLD], Message(f"… and {more} more notes; {told_by} lists all of them")]


class UndeterminedObject(NamedTuple):
    """A thing of the network that nothing determines: what it is, why, and what was done about it."""

    kind: str
    """point, image, station, system …"""
    name: str
    reason: str
    treatment: Literal["", "left out", "at infinity"] = ""
    observations: int = 0
    """Rows of observations that refer to it."""

    def __str__(self) -> str:
        return f"{self.kind} {self.name}: {self.reason}"


CONTRADICTED = "its observations contradict the known coordinates of its points, or do not determine it"
"""Why a thing stays without start values where the places of its points are known."""


class MorError(Exception):
    """Base of every failure that is the user's to mend; never shown with a traceback."""

    exit_code = ExitCode.INTERNAL


class InputError(MorError):
    """The input is wrong. Carries *all* problems found, not only the first one."""

    exit_code = ExitCode.INPUT
    told_by = "mor check --all"
    """The command that tells all problems, where they are more than a screen holds."""

    def __init__(self, problems: Iterable[Message]):
        self.problems = tuple(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


class NoSolutionError(MorError):
    """The adjustment has no solution, which the requested result needs."""

    exit_code = ExitCode.NOT_CONVERGED


class OutOfMemoryError(MorError):
    """There is not enough memory for what was asked for; it says how much is, and what helps."""

    exit_code = ExitCode.MEMORY


@contextmanager
def mistakes_in(file: str) -> Iterator[None]:
    """Mistakes that belong to no single place get the file of the project they are found in."""
    try:
        yield
    except InputError as error:
        error.problems = tuple(p._replace(file=p.file or file) for p in error.problems)
        raise


class NoStartValuesError(InputError):
    """Start values are missing.

    Each of ``things`` says why, ``remarks`` what else was found in trying, ``said`` is a hint.
    """

    told_by = "mor approximate"

    def __init__(self, things: Iterable[UndeterminedObject], remarks: Iterable[str], said: Iterable[str] = ()):
        self.things = tuple(things)
        self.remarks = tuple(remarks)
        count = f"{len(self.things)} objects have" if len(self.things) != 1 else "one object has"
        advice = (
            f"{count} no start values; settings: {{undetermined: leave_out}} adjusts the rest without them"
            if not self.things or any(thing.treatment != "left out" for thing in self.things)
            else f"{count} too few observations"
        )
        contradicted = bool(self.remarks) or any(thing.reason == CONTRADICTED for thing in self.things)
        hint = ("mor diagnose searches for mistakes that may be the cause",) if contradicted else ()
        super().__init__([Message(words) for words in (advice, *said, *hint, *map(str, self.things), *self.remarks)])


def nearest(name: str, known: Iterable[str]) -> str:
    """Suggestion clause for an unknown ``name``: ``"; did you mean 'camera'?"`` or the empty string."""
    # Letters up to which a name may be a mistyped one; comparing takes the square of them.
    if len(name) > 200:
        return ""
    names = list(known)
    if len(names) > MANY_NAMES:
        # The hundred names that have the most letters in the same place as ``name``, counted from either end.
        import numpy as np

        width = len(name) + 1
        score = np.zeros(len(names), dtype=np.int64)
        for wanted, found in ((name, names), (name[::-1], [other[::-1] for other in names])):
            letters = np.array(found, dtype=f"U{width}").view(np.uint32).reshape(len(names), width)
            own = np.array([wanted], dtype=f"U{width}").view(np.uint32)
            score = np.maximum(score, np.count_nonzero(letters == own, axis=1))
        names = [names[k] for k in np.argsort(-score, kind="stable")[:100].tolist()]
    matches = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    return f"; did you mean {matches[0]!r}?" if matches else ""


MANY_NAMES = 20_000
"""Names up to which each is compared with care."""


# ---- Counted things in words: 1 image, 2 images.


class Placeholder(str):
    """A placeholder in a sentence; ``{count:image|images}`` chooses the singular or plural noun."""

    __slots__ = ()

    def __format__(self, words: str) -> str:
        one, bar, many = words.partition("|")
        return f"{self!s} {one if self == '1' else many}" if bar else format(str(self), words)


def counted(count: int, one: str, many: str = "") -> str:
    """A count with its word: ``counted(1, "ray")`` is "1 ray", ``counted(2, "ray")`` "2 rays"."""
    return f"{count} {one if count == 1 else many or one + 's'}"
