"""Where rays meet, point after point: the same steps as ``meet_plainly`` of ``forward_intersection``."""

from __future__ import annotations

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.compilation import compile_kernel

PAIRED = 16
"""Rays of a point that are put together in pairs."""


@compile_kernel
def meet(
    points: IntArray,
    pointers: IntArray,
    frame: IntArray,
    rays: FloatArray,
    sigma: FloatArray,
    height: FloatArray,
    centres: FloatArray,
    turns: FloatArray,
    slack: float,
    smallest: float,
    rounds: int,
) -> tuple[FloatArray, BoolArray]:
    """Places (m, 3) of m ``points`` and which of them are good; frames without a pose have no finite centre."""
    X = np.full((len(points), 3), np.nan)
    good = np.zeros(len(points), dtype=np.bool_)
    most = 1
    for p in points:
        most = max(most, pointers[p + 1] - pointers[p])
    centre, direction = np.empty((most, 3)), np.empty((most, 3))
    limit, use = np.empty(most), np.empty(most, dtype=np.bool_)
    for m in range(len(points)):
        p = points[m]
        count = 0
        for ray in range(pointers[p], pointers[p + 1]):
            f = frame[ray]
            if not np.isfinite(centres[f, 0]):
                continue
            for j in range(3):
                centre[count, j] = centres[f, j]
                direction[count, j] = (
                    rays[ray, 0] * turns[f, 0, j]
                    + rays[ray, 1] * turns[f, 1, j]
                    + rays[ray, 2] * turns[f, 2, j]
                )
            centre[count, 2] -= height[ray]
            limit[count] = 3.0 * np.sqrt(sigma[ray] ** 2 + slack**2)
            use[count] = True
            count += 1
        good[m] = _meet_in_rounds(centre, direction, limit, use, count, smallest, rounds, X[m])
    return X, good


@compile_kernel
def _meet_in_rounds(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    use: BoolArray,
    count: int,
    smallest: float,
    rounds: int,
    X: FloatArray,
) -> bool:
    """Place of one point; true where two or more rays agree.

    It begins with all of them and, where less than half of them agree, with the two on whose meeting more of them do.
    """
    good = _in_rounds(centre, direction, limit, use, count, smallest, rounds, X)
    agreeing = int(np.sum(use[:count])) if good else 0
    if rounds > 1 and count > 2 and 2 * agreeing < count:
        tried, place = np.empty(count, dtype=np.bool_), np.empty(3)
        first, second = _likeliest_pair(centre, direction, limit, count, smallest, agreeing, tried, place)
        if first >= 0:
            for n in range(count):
                use[n] = n == first or n == second
            good = _in_rounds(centre, direction, limit, use, count, smallest, rounds, X)
    return good and bool(np.sum(use[:count]) >= 2)


@compile_kernel
def _in_rounds(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    use: BoolArray,
    count: int,
    smallest: float,
    rounds: int,
    X: FloatArray,
) -> bool:
    """Place nearest to the rays in use, those that pass by taken out and back in for some rounds."""
    good = False
    for _ in range(rounds):
        good = _nearest(centre, direction, use, count, smallest, X)
        changed = False
        for n in range(count):
            agrees = good and _passes(centre[n], direction[n], X) < limit[n]
            changed = changed or agrees != use[n]
            use[n] = agrees
        if not (good and changed):
            break
    return good


@compile_kernel
def _likeliest_pair(
    centre: FloatArray,
    direction: FloatArray,
    limit: FloatArray,
    count: int,
    smallest: float,
    least: int,
    pair: BoolArray,
    place: FloatArray,
) -> tuple[int, int]:
    """The two rays on whose meeting most rays agree, more than ``least``; −1 where there are none.

    Two with which no third one agrees must be the only ones that meet.
    """
    first, second, most, alike = -1, -1, max(least, 1), 0
    sampled = min(count, PAIRED)
    for i in range(sampled):
        for j in range(i + 1, sampled):
            for n in range(count):
                pair[n] = n == i or n == j
            if not _nearest(centre, direction, pair, count, smallest, place):
                continue
            agreeing = 0
            for n in range(count):
                agreeing += _passes(centre[n], direction[n], place) < limit[n]
            if agreeing > most:
                first, second, most, alike = i, j, agreeing, 1
            elif agreeing == most:
                alike += 1
    if most == 2 and alike > 1:
        return -1, -1
    return first, second


@compile_kernel
def _passes(centre: FloatArray, direction: FloatArray, X: FloatArray) -> float:
    """Length of the difference between the ray and the direction to X."""
    x, y, z = X[0] - centre[0], X[1] - centre[1], X[2] - centre[2]
    length = np.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return np.inf
    x, y, z = x / length - direction[0], y / length - direction[1], z / length - direction[2]
    return float(np.sqrt(x * x + y * y + z * z))


@compile_kernel
def _nearest(
    centre: FloatArray, direction: FloatArray, use: BoolArray, count: int, smallest: float, X: FloatArray
) -> bool:
    """Point nearest to the used rays, into ``X``; false where they meet at too small an angle, or behind."""
    X[:] = np.nan
    rays = 0
    a = b = c = d = e = f = 0.0
    u = v = w = 0.0
    first = -1
    for n in range(count):
        if not use[n]:
            continue
        if first < 0:
            first = n
        rays += 1
        x, y, z = direction[n]
        p, q, r = (
            centre[n, 0] - centre[first, 0],
            centre[n, 1] - centre[first, 1],
            centre[n, 2] - centre[first, 2],
        )
        along = x * p + y * q + z * r
        a += 1.0 - x * x
        b -= x * y
        c -= x * z
        d += 1.0 - y * y
        e -= y * z
        f += 1.0 - z * z
        u += p - along * x
        v += q - along * y
        w += r - along * z
    # The smallest eigenvalue of Σ (I − ddᵀ) is about the sum of squared angles between the rays and their mean;
    # all eigenvalues exceed t where the pivots of the matrix less t are positive.
    t = 0.5 * smallest**2
    if rays < 2 or not _positive(a - t, b, c, d - t, e, f - t):
        return False
    k, o, m = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * k + b * o + c * m
    X[0] = centre[first, 0] + (k * u + o * v + m * w) / determinant
    X[1] = centre[first, 1] + (o * u + (a * f - c * c) * v + (b * c - a * e) * w) / determinant
    X[2] = centre[first, 2] + (m * u + (b * c - a * e) * v + (a * d - b * b) * w) / determinant
    behind = 0
    for n in range(count):
        if use[n]:
            depth = 0.0
            for j in range(3):
                depth += (X[j] - centre[n, j]) * direction[n, j]
            behind += not depth > 0.0
    return behind < 0.5 * rays


@compile_kernel
def _positive(a: float, b: float, c: float, d: float, e: float, f: float) -> bool:
    """True where the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]] is positive definite."""
    if not a > 0.0:
        return False
    second = d - b * b / a
    mixed = e - b * c / a
    if not second > 0.0:
        return False
    return f - c * c / a - mixed * mixed / second > 0.0
