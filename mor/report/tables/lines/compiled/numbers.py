"""Numbers as text, as polars writes them into CSV files: the shortest digits, plain or with an exponent.

A text goes into bytes from a place on, and up to :data:`BEYOND` bytes from there on are overwritten. Eight digits are
one word, the first of them in its lowest byte; a number has one digit and two words behind it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mor.compilation import compile_kernel
from mor.report.tables.lines.compiled.shortest import shortest_double, shortest_single

BEYOND = 32
"""The longest number has 24 signs."""
_ONE, _TWO, _THREE, _NINE = (np.uint64(k) for k in (1, 2, 3, 9))
_HUNDRED, _THOUSANDS, _HALF_WORD, _WORDS = (np.uint64(k) for k in (100, 10**4, 10**8, 10**16))
_BYTE, _SIX_BYTES = np.uint64(8), np.uint64(56)
_MINUS, _PLUS, _POINT, _E = (np.uint8(ord(sign)) for sign in "-+.e")
_DIGIT, _DOT = np.uint64(ord("0")), np.uint64(ord("."))
_ZEROS, _NOUGHT, _NOUGHT_POINT, _INFINITE = (
    np.uint64(int.from_bytes(text, "little")) for text in (b"00000000", b"0.0", b"0.000000", b"inf")
)
_TENS = np.array([10**k for k in range(18)], dtype=np.uint64)
_INFINITY = np.uint64(0x7FF) << np.uint64(52)
_INFINITY_OF_SINGLE = np.uint64(0xFF) << np.uint64(23)


@compile_kernel
def write_double(text: NDArray[np.uint8], at: np.uint64, bits: np.uint64) -> np.uint64:
    """Write the number that has these bits, nothing for NaN; returns the place behind it."""
    size = bits & ((_ONE << np.uint64(63)) - _ONE)
    if size > _INFINITY:
        return at
    text[at] = _MINUS
    at += bits >> np.uint64(63)
    if size == np.uint64(0) or size == _INFINITY:
        return _write_name(text, at, size)
    digits, exponent = shortest_double(size)
    count = 15 + int(digits >= _TENS[15]) + int(digits >= _TENS[16])
    while digits < _TENS[count - 1]:
        count -= 1
    digits *= _TENS[17 - count]
    first, rest = digits // _WORDS, digits % _WORDS
    upper, lower = _eight(rest // _HALF_WORD), _eight(rest % _HALF_WORD)
    return _write(text, at, first, upper, lower, count + exponent, -5, 16)


@compile_kernel
def write_single(text: NDArray[np.uint8], at: np.uint64, bits: np.uint64) -> np.uint64:
    """The same of a number of single precision."""
    size = bits & ((_ONE << np.uint64(31)) - _ONE)
    if size > _INFINITY_OF_SINGLE:
        return at
    text[at] = _MINUS
    at += bits >> np.uint64(31)
    if size == np.uint64(0) or size == _INFINITY_OF_SINGLE:
        return _write_name(text, at, size)
    digits, exponent = shortest_single(size)
    count = 7 + int(digits >= _TENS[7]) + int(digits >= _TENS[8])
    while digits < _TENS[count - 1]:
        count -= 1
    digits *= _TENS[9 - count]
    first, upper = digits // _HALF_WORD, _eight(digits % _HALF_WORD)
    return _write(text, at, first, upper, np.uint64(0), count + exponent, -6, 13)


@compile_kernel
def _write_name(text: NDArray[np.uint8], at: np.uint64, size: np.uint64) -> np.uint64:
    _put(text, at, _NOUGHT if size == np.uint64(0) else _INFINITE)
    return at + _THREE


@compile_kernel
def _write(
    text: NDArray[np.uint8],
    at: np.uint64,
    first: np.uint64,
    upper: np.uint64,
    lower: np.uint64,
    point: np.int64,
    least: int,
    most: int,
) -> np.uint64:
    """Write digits whose point stands behind so many; with an exponent unless that is within the bounds."""
    count = _significant(upper, lower)
    upper, lower = upper | _ZEROS, lower | _ZEROS
    if least < point <= 0:
        _put(text, at, _NOUGHT_POINT)
        at += np.uint64(2 - point)
        _put_digits(text, at, first, upper, lower)
        return at + count
    _put_digits(text, at, first, upper, lower)
    if 0 < point <= most:
        if point <= 8:
            _put(text, at + _ONE, _with_point(upper, point - 1))
            _put(text, at + _NINE, lower << _BYTE | upper >> _SIX_BYTES)
        else:
            _put(text, at + _NINE, _with_point(lower, point - 9))
        text[at + _NINE + _BYTE] = np.uint8(lower >> _SIX_BYTES)
        return at + max(count, np.uint64(point + 1)) + _ONE
    if count > _ONE:
        text[at + _ONE] = _POINT
        _put(text, at + _TWO, upper)
        _put(text, at + _TWO + _BYTE, lower)
        at += _ONE
    return _write_exponent(text, at + count, point - 1)


@compile_kernel
def _write_exponent(text: NDArray[np.uint8], at: np.uint64, exponent: np.int64) -> np.uint64:
    text[at] = _E
    text[at + _ONE] = _MINUS if exponent < 0 else _PLUS
    at += _TWO
    size = np.uint64(abs(exponent))
    if size >= _HUNDRED:
        text[at] = np.uint8(_DIGIT + size // _HUNDRED)
        at += _ONE
    if size >= _TENS[1]:
        text[at] = np.uint8(_DIGIT + size // _TENS[1] % _TENS[1])
        at += _ONE
    text[at] = np.uint8(_DIGIT + size % _TENS[1])
    return at + _ONE


@compile_kernel
def _significant(upper: np.uint64, lower: np.uint64) -> np.uint64:
    """Digits without the zeros at the end, the first one included."""
    count = _ONE
    word = upper
    if lower != np.uint64(0):
        count += _BYTE
        word = lower
    if word != np.uint64(0):
        count += _BYTE
        while word >> _SIX_BYTES == np.uint64(0):
            word <<= _BYTE
            count -= _ONE
    return count


@compile_kernel
def _eight(number: np.uint64) -> np.uint64:
    """The digits of a number below 10⁸: halves, pairs, then digits divided side by side."""
    halves = number // _THOUSANDS | number % _THOUSANDS << np.uint64(32)
    pairs = (halves * np.uint64(10486)) >> np.uint64(20) & np.uint64(0x0000007F0000007F)
    pairs |= (halves - pairs * _HUNDRED) << np.uint64(16)
    tens = (pairs * np.uint64(103)) >> np.uint64(10) & np.uint64(0x000F000F000F000F)
    return tens | (pairs - tens * np.uint64(10)) << _BYTE


@compile_kernel
def _with_point(word: np.uint64, digits: np.int64) -> np.uint64:
    """Eight signs with a point behind so many of them; the last sign falls off."""
    shift = _BYTE * np.uint64(digits)
    before = (_ONE << shift) - _ONE
    return word & before | _DOT << shift | (word & ~before) << _BYTE


@compile_kernel
def _put_digits(
    text: NDArray[np.uint8], at: np.uint64, first: np.uint64, upper: np.uint64, lower: np.uint64
) -> None:
    text[at] = np.uint8(_DIGIT + first)
    _put(text, at + _ONE, upper)
    _put(text, at + _NINE, lower)


@compile_kernel
def _put(text: NDArray[np.uint8], at: np.uint64, word: np.uint64) -> None:
    """Write eight signs; the compiler makes one step of it."""
    for k in range(8):
        text[at + np.uint64(k)] = np.uint8(word >> _BYTE * np.uint64(k))
