"""Mutations of a file as bytes and as lines, whatever it holds."""

from __future__ import annotations

import gzip

import numpy as np

from .values import NUMBER, changed_number, chosen, hostile

_SIGNS = b",;\t \"'#\\/:|-=+*.<>[]{}()&%@!?\n\r\x00\x1b\xff0159eEaZ\xc3\xa4"


def mutated_bytes(rng: np.random.Generator, content: bytes) -> bytes:
    """A few bytes or all of them changed."""
    return bytes(_BYTES[int(rng.integers(len(_BYTES)))](rng, content))


def mutated_lines(rng: np.random.Generator, content: bytes) -> bytes:
    """Lines taken out, doubled, moved, cut, or with another number or word."""
    lines = content.split(b"\n")
    return b"\n".join(_LINES[int(rng.integers(len(_LINES)))](rng, lines))


def _flipped(rng: np.random.Generator, content: bytes) -> bytes:
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if data:
            data[int(rng.integers(len(data)))] = _SIGNS[int(rng.integers(len(_SIGNS)))]
    return data


def _inserted(rng: np.random.Generator, content: bytes) -> bytes:
    at = int(rng.integers(len(content) + 1))
    sign = _SIGNS[int(rng.integers(len(_SIGNS)))]
    return content[:at] + bytes([sign]) * int(chosen(rng, (1, 1, 1, 2, 100, 5000))) + content[at:]  # type: ignore[call-overload]


def _cut(rng: np.random.Generator, content: bytes) -> bytes:
    start, end = sorted(int(x) for x in rng.integers(len(content) + 1, size=2))
    return bytes(chosen(rng, (content[:start], content[end:], content[:start] + content[end:])))  # type: ignore[call-overload]


def _recoded(rng: np.random.Generator, content: bytes) -> bytes:
    """Another encoding, other line ends, compressed, or as programs of Windows leave files."""
    text = content.decode("utf-8", "replace")
    return bytes(
        chosen(  # type: ignore[call-overload]
            rng,
            (
                *(
                    b"\xef\xbb\xbf" + content,
                    text.encode("utf-16"),
                    text.encode("utf-16-be"),
                    text.encode("utf-32"),
                ),
                *(
                    text.encode("latin-1", "replace"),
                    text.encode("cp1252", "replace"),
                    gzip.compress(content, mtime=0),
                ),
                *(
                    content.replace(b"\n", b"\r\n"),
                    content.replace(b"\n", b"\r"),
                    content + b"\x1a",
                    b"",
                    b"\n",
                ),
                *(
                    content.replace(b".", b","),
                    content.replace(b" ", b"\xc2\xa0"),
                    content.replace(b"\n", b"\n\n"),
                ),
            ),
        )
    )


def _deleted(rng: np.random.Generator, lines: list[bytes]) -> list[bytes]:
    kept = rng.random(len(lines)) >= float(chosen(rng, (0.02, 0.1, 0.5)))  # type: ignore[arg-type]
    if kept.all() and lines:
        kept[int(rng.integers(len(lines)))] = False
    return [line for line, keep in zip(lines, kept, strict=True) if keep]


def _doubled(rng: np.random.Generator, lines: list[bytes]) -> list[bytes]:
    at = int(rng.integers(len(lines)))
    return lines[:at] + [lines[at]] * int(chosen(rng, (2, 2, 3, 50))) + lines[at + 1 :]  # type: ignore[call-overload]


def _moved(rng: np.random.Generator, lines: list[bytes]) -> list[bytes]:
    result = list(lines)
    a, b = (int(x) for x in rng.integers(len(lines), size=2))
    result[a], result[b] = result[b], result[a]
    return result


def _renumbered(rng: np.random.Generator, lines: list[bytes]) -> list[bytes]:
    """One number of one line changed."""
    at = int(rng.integers(len(lines)))
    text = lines[at].decode("utf-8", "surrogateescape")
    found = list(NUMBER.finditer(text))
    if not found:
        return lines
    match = found[int(rng.integers(len(found)))]
    new = hostile(rng) if rng.random() < 0.3 else changed_number(rng, match[0])
    line = (text[: match.start()] + new + text[match.end() :]).encode("utf-8", "surrogateescape")
    return [*lines[:at], line, *lines[at + 1 :]]


def _reworded(rng: np.random.Generator, lines: list[bytes]) -> list[bytes]:
    """One word of one line taken out, replaced by another word of the file, or by something hostile."""
    at = int(rng.integers(len(lines)))
    words = lines[at].split(b" ")
    k = int(rng.integers(len(words)))
    others = lines[int(rng.integers(len(lines)))].split(b" ")
    words[k : k + 1] = chosen(rng, ([], [others[int(rng.integers(len(others)))]], [hostile(rng).encode()]))  # type: ignore[call-overload]
    return [*lines[:at], b" ".join(words), *lines[at + 1 :]]


_BYTES = (_flipped, _flipped, _inserted, _cut, _recoded)
_LINES = (_deleted, _doubled, _moved, _renumbered, _renumbered, _renumbered, _reworded, _reworded)
