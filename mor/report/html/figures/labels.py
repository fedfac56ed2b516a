"""Place labels in a figure without overlap."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray

_MARK = 3.0
"""Half the width of a mark."""
NO_MARKS = np.zeros((0, 2))


def placed(
    marks: FloatArray, size: FloatArray, edge: FloatArray, others: FloatArray = NO_MARKS
) -> list[tuple[int, tuple[float, float]]]:
    """Number of those names that have room, the first ones first, and of each the offset of its middle from its mark.

    ``marks`` (n, 2) are the places of what is named, ``others`` (m, 2) those of further marks, ``size`` (n, 2) width
    and height of the names, ``edge`` the least and the largest x and y of the picture (x, y, x, y).
    """
    every = np.concatenate([marks, others])
    taken = np.concatenate([every - _MARK, every + _MARK], axis=1)
    found = []
    for k, (mark, (width, height)) in enumerate(zip(marks, size, strict=True)):
        side, above = 0.5 * width + 1.4 * _MARK, 0.5 * height + 1.2 * _MARK
        for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1)):
            offset = np.array([x * side, y * (above if x == 0 else 0.5 * height)])
            half = 0.5 * np.array([width, height])
            box = np.concatenate([mark + offset - half, mark + offset + half])
            if (box[:2] < edge[:2]).any() or (box[2:] > edge[2:]).any():
                continue
            if ((box[:2] < taken[:, 2:]) & (taken[:, :2] < box[2:])).all(axis=1).any():
                continue
            taken = np.concatenate([taken, box[None]])
            found.append((k, (float(offset[0]), float(offset[1]))))
            break
    return found
