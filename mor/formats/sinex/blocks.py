"""Blocks of a SINEX file: the estimated parameters, and the matrix of their covariances.

Source: *SINEX - Solution (Software/technique) Independent Exchange Format*, version 2.02 (IERS, 2006): blocks
SOLUTION/ESTIMATE and SOLUTION/MATRIX_ESTIMATE.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft, number

ESTIMATE, MATRIX, APRIORI = "SOLUTION/ESTIMATE", "SOLUTION/MATRIX_ESTIMATE", "SOLUTION/MATRIX_APRIORI"
MOST = 4_000
"""Most parameters of a file: its matrix is full."""


class Block(NamedTuple):
    """Lines of a block with their numbers, and what its first line says behind its name."""

    kind: list[str]
    line: int
    rows: list[tuple[int, list[str]]]


class Parameter(NamedTuple):
    """An estimated parameter."""

    type: str
    site: str
    """Code, point and solution of the station."""
    epoch: str
    value: float
    sigma: float
    line: int


def blocks_of(lines: list[str], draft: Draft) -> dict[str, Block]:
    """Blocks by their names; a block that does not end, or is there twice, is a mistake."""
    found: dict[str, Block] = {}
    name = ""
    for line, text in enumerate(lines[1:], start=2):
        words = text[1:].split()
        if text.startswith("+") and words:
            if name:
                draft.problem(f"block {name} does not end before the next begins", line)
            name = words[0].upper()
            if name in found:
                draft.problem(f"block {name} is there twice", line)
            found[name] = Block([word.upper() for word in words[1:]], line, [])
        elif text.startswith("-") and words:
            if words[0].upper() != name:
                draft.problem(f"found the end of {words[0]}, expected that of {name or 'no block'}", line)
            name = ""
        elif name and text.strip() and not text.startswith("*"):
            found[name].rows.append((line, text.split()))
    if name:
        draft.problem(f"block {name} does not end: the file is cut off", len(lines))
    return found


def parameters_of(block: Block, draft: Draft) -> dict[int, Parameter]:
    """Estimated parameters by their numbers."""
    found: dict[int, Parameter] = {}
    for line, words in block.rows:
        try:
            if len(words) != 10:
                raise ValueError(f"found {len(words)} words, expected the 10 of an estimate")
            index, type_, code, point, solution, epoch, unit, _, value, sigma = words
            if not index.isdecimal() or not index.isascii() or not 0 < int(index) <= MOST:
                raise ValueError(f"found the parameter {index!r}, expected a number from 1 to {MOST}")
            if int(index) in found:
                raise ValueError(f"parameter {index} is there twice")
            if type_.upper() in ("STAX", "STAY", "STAZ") and unit.lower() != "m":
                raise ValueError(f"found the unit {unit!r} of {type_}, expected m")
            site = " ".join((code, point, solution))
            values = number(value.replace("D", "E")), number(sigma.replace("D", "E"))
            found[int(index)] = Parameter(type_.upper(), site, epoch, *values, line)
        except ValueError as error:
            draft.problem(str(error), line)
    return found


def matrix_of(block: Block, parameters: dict[int, Parameter], draft: Draft) -> FloatArray | None:
    """Covariances (n, n) in the order of the numbers of the parameters; ``None`` if there is a mistake."""
    place = {index: k for k, index in enumerate(sorted(parameters))}
    kind = block.kind
    if len(kind) != 2 or kind[0] not in ("L", "U") or kind[1] not in ("CORR", "COVA", "INFO"):
        draft.problem(f"found {' '.join(kind)!r}, expected L or U, and CORR, COVA or INFO", block.line)
        return None
    M, good = np.zeros((len(place), len(place))), True
    for line, words in block.rows:
        try:
            if not 3 <= len(words) <= 5 or not all(word.isdecimal() and word.isascii() for word in words[:2]):
                raise ValueError("expected the numbers of two parameters and up to three values")
            row, first = int(words[0]), int(words[1])
            for column, word in enumerate(words[2:], start=first):
                if row not in place or column not in place:
                    raise ValueError(
                        f"parameter {column if row in place else row} is not among the estimates"
                    )
                if (column > row) if kind[0] == "L" else (column < row):
                    raise ValueError(
                        f"found row {row}, column {column}, expected the other triangle ({kind[0]})"
                    )
                M[place[row], place[column]] = M[place[column], place[row]] = number(word.replace("D", "E"))
        except ValueError as error:
            draft.problem(str(error), line)
            good = False
    return _covariances(M, kind[1], block, draft) if good else None


def _covariances(M: FloatArray, kind: str, block: Block, draft: Draft) -> FloatArray | None:
    if kind == "CORR":  # correlations, and σ on the diagonal
        sigma = np.diagonal(M).copy()
        np.fill_diagonal(M, 1.0)
        M = M * np.outer(sigma, sigma)
    scale = np.sqrt(np.abs(np.diagonal(M)))
    if not np.isfinite(M).all() or not (scale > 0.0).all():
        draft.problem("a parameter has no variance in the matrix", block.line)
        return None
    least = np.linalg.eigvalsh(M / np.outer(scale, scale))[0]
    if not least > 1e-13:
        words = "is not positive definite"
        if kind == "INFO":
            words = "is singular: the solution has no datum, and positions cannot be had of it"
        draft.problem(f"the matrix {words}", block.line)
        return None
    if kind != "INFO":
        return M
    inverse: FloatArray = np.linalg.inv(M / np.outer(scale, scale)) / np.outer(scale, scale)
    return inverse
