"""The shortest decimal number that is read as one binary number and as no other; of several the nearest.

Schubfach: R. Giulietti, *The Schubfach way to render doubles*, 2020. A number is c · 2^q; what is read as it lies
between the middles to its neighbours, (4c ± 2) · 2^(q − 2); below a power of two the neighbour is half as far. Times
10^−k, with which 2^q comes between 1 and 10, the number and its bounds are integers and fractions. Of a fraction it
matters only whether there is one: it becomes the last bit, "rounded to odd". Within the bounds is one decimal that has
one exponent more, or it is one of the two integers around the number.

``bits`` are those of a finite number that is not 0, without its sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mor.compilation import compile_kernel

_ONE, _TWO, _FOUR, _TEN, _FORTY = (np.uint64(k) for k in (1, 2, 4, 10, 40))
_HALF, _WORD = np.uint64(32), np.uint64(64)
_LOWER_HALF = np.uint64(0xFFFFFFFF)
_LEAST_OF_DOUBLE, _LEAST_OF_SINGLE = -292, -31
"""Exponents of the first powers of ten in the tables."""


def _powers_of_ten(first: int, last: int, bits: int) -> list[int]:
    """10^k, k from ``first`` to ``last``: the leading bits of each, rounded up."""
    powers = []
    for k in range(first, last + 1):
        shift = bits - 1 - ((k * 1741647) >> 19)
        numerator = 10 ** max(k, 0) << max(shift, 0)
        powers.append(-(-numerator // (10 ** max(-k, 0) << max(-shift, 0))))
    return powers


def _in_words(powers: list[int]) -> NDArray[np.uint64]:
    """(n, 2) upper and lower words of numbers of 128 bits."""
    return np.array([divmod(power, 1 << 64) for power in powers], dtype=np.uint64)


_FOR_DOUBLES = _in_words(_powers_of_ten(_LEAST_OF_DOUBLE, 324, 128))
_FOR_SINGLES = np.array(_powers_of_ten(_LEAST_OF_SINGLE, 45, 64), dtype=np.uint64)


@compile_kernel
def shortest_double(bits: np.uint64) -> tuple[np.uint64, np.int64]:
    """Digits d, at most 17, and exponent e of the shortest d · 10^e that is read as a double."""
    c, q, closer = _parts(bits, np.uint64(52), 1075)
    k = _power(q, closer)
    shift = _shift(q, k)
    upper, lower = _FOR_DOUBLES[-k - _LEAST_OF_DOUBLE, 0], _FOR_DOUBLES[-k - _LEAST_OF_DOUBLE, 1]
    factor = (c << _TWO) << shift
    first = lower * factor
    second, carry = _sum(upper * factor, _upper_word(lower, factor))
    third = _upper_word(upper, factor) + carry
    # the bounds: the power of ten times 2 · 2^shift more, and less
    wide, narrow = shift + _ONE, shift + np.uint64(not closer)
    more, carry = _sum(second, _middle_word(upper, lower, wide))
    more, further = _sum(more, _sum(first, lower << wide)[1])
    above = _odd(third + (upper >> (_WORD - wide)) + carry + further, more)
    less, borrow = _difference(second, _middle_word(upper, lower, narrow))
    less, further = _difference(less, _difference(first, lower << narrow)[1])
    below = _odd(third - (upper >> (_WORD - narrow)) - borrow - further, less)
    return _decided(below, _odd(third, second), above, c & _ONE, k)


@compile_kernel
def shortest_single(bits: np.uint64) -> tuple[np.uint64, np.int64]:
    """The same of a number of single precision, at most 9 digits."""
    c, q, closer = _parts(bits, np.uint64(23), 150)
    k = _power(q, closer)
    shift = _shift(q, k)
    power = _FOR_SINGLES[-k - _LEAST_OF_SINGLE]
    factor = c << _TWO
    below = _odd_product(power, (factor - _ONE - np.uint64(not closer)) << shift)
    above = _odd_product(power, (factor + _TWO) << shift)
    return _decided(below, _odd_product(power, factor << shift), above, c & _ONE, k)


@compile_kernel
def _parts(bits: np.uint64, width: np.uint64, bias: int) -> tuple[np.uint64, np.int64, bool]:
    """c and q of a number whose fraction has so many bits; whether its lower neighbour is closer than the upper one."""
    fraction = bits & ((_ONE << width) - _ONE)
    exponent = np.int64(bits >> width)
    subnormal = exponent == 0
    c = fraction | (np.uint64(not subnormal) << width)
    return c, exponent + np.int64(subnormal) - bias, bool(fraction == np.uint64(0) and exponent > 1)


@compile_kernel
def _power(q: np.int64, closer: bool) -> np.int64:
    """k: ⌊log₁₀ 2^q⌋, or of ¾ · 2^q."""
    return (q * 1262611 - (524031 if closer else 0)) >> 22


@compile_kernel
def _shift(q: np.int64, k: np.int64) -> np.uint64:
    """Bits by which 2^q and the table's 10^−k miss what the upper words of their product stand for."""
    return np.uint64(q + ((-k * 1741647) >> 19) + 1)


@compile_kernel
def _decided(
    below: np.uint64, number: np.uint64, above: np.uint64, odd: np.uint64, k: np.int64
) -> tuple[np.uint64, np.int64]:
    """Digits and exponent, of four times the number and its bounds; these belong to it where c is even."""
    below, above = below + odd, above - odd
    digits = number >> _TWO
    tens = digits // _TEN
    down, up = below <= tens * _FORTY, tens * _FORTY + _FORTY <= above
    if down != up and digits >= _TEN:
        return tens + np.uint64(up), k + 1
    down, up = below <= digits << _TWO, (digits << _TWO) + _FOUR <= above
    if down == up:  # both: the nearer one, or the even one
        up = number > (digits << _TWO | _TWO) - (digits & _ONE)
    return digits + np.uint64(up), k


@compile_kernel
def _odd(word: np.uint64, rest: np.uint64) -> np.uint64:
    """A word, its last bit set where there is a rest; the table's rounding is in the last bit of the rest."""
    return word | np.uint64(rest > _ONE)


@compile_kernel
def _odd_product(power: np.uint64, factor: np.uint64) -> np.uint64:
    """The third half of a product of two words and a half one, rounded to odd."""
    upper = (power >> _HALF) * factor + ((power & _LOWER_HALF) * factor >> _HALF)
    return _odd(upper >> _HALF, upper & _LOWER_HALF)


@compile_kernel
def _upper_word(a: np.uint64, b: np.uint64) -> np.uint64:
    """The upper one of the two words of a product."""
    crossing, other = (a >> _HALF) * (b & _LOWER_HALF), (a & _LOWER_HALF) * (b >> _HALF)
    lower = (a & _LOWER_HALF) * (b & _LOWER_HALF) >> _HALF
    middle = lower + (crossing & _LOWER_HALF) + (other & _LOWER_HALF)
    return (a >> _HALF) * (b >> _HALF) + (crossing >> _HALF) + (other >> _HALF) + (middle >> _HALF)


@compile_kernel
def _middle_word(upper: np.uint64, lower: np.uint64, shift: np.uint64) -> np.uint64:
    """The upper word of two that are moved to the left."""
    return upper << shift | lower >> (_WORD - shift)


@compile_kernel
def _sum(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """A sum and what is carried."""
    return a + b, np.uint64(a + b < a)


@compile_kernel
def _difference(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """A difference and what is borrowed."""
    return a - b, np.uint64(a < b)
