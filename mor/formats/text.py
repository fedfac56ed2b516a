"""Text of foreign files: in whatever encoding programs and instruments write, decoded in one place and said by name."""

from __future__ import annotations

import codecs
from itertools import pairwise
from pathlib import Path

from mor.formats.draft import Draft
from mor.input_files import PROJECT, read_bytes

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_HIGH = 0x80
_NAMES = {"cp1251": "Windows, Cyrillic", "cp1252": "Windows, Western European", "utf-16": "with a mark"}


def read_lines(path: Path, draft: Draft) -> list[str]:
    """Lines of a text file without their ends; what follows the last end is no line where it is empty.

    UTF-8 and UTF-16 by their mark, UTF-8 without one; else Windows' Western European or Cyrillic letters, which a
    note says. Raises :class:`InputError` if the file cannot be read.
    """
    text, encoding = decoded(read_bytes(path, PROJECT))
    if encoding in _NAMES and encoding != "utf-16":
        line = next(k for k, one in enumerate(text.split("\n"), start=1) if not one.isascii())
        words = f"this is not UTF-8 text; it is read as {encoding} ({_NAMES[encoding]}): check the names"
        draft.note(words, line, str(path))
    lines = text.split("\n")
    if lines and not lines[-1]:
        lines.pop()
    return lines


def decoded(content: bytes) -> tuple[str, str]:
    """Text of a file with lines that end in ``\\n``, and the name of its encoding."""
    encoding = _encoding(content)
    mark = next((mark for mark, name in _MARKS if content.startswith(mark)), b"")
    text = content[len(mark) :].decode(encoding, "replace")
    name = "utf-16" if encoding.startswith("utf-16") else encoding
    return text.replace("\r\n", "\n").replace("\r", "\n").replace("\x1a", ""), name


def _encoding(content: bytes) -> str:
    for mark, name in _MARKS:
        if content.startswith(mark):
            return name
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1251" if _is_cyrillic(content) else "cp1252"
    return "utf-8"


def _is_cyrillic(content: bytes) -> bool:
    """Words in Cyrillic are of high bytes throughout; in Western languages most of these stand alone."""
    high = [byte >= _HIGH for byte in content]
    pairs = sum(a and b for a, b in pairwise(high))
    return 2 * pairs > sum(high)
