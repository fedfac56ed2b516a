"""GNSS vectors and positions with their covariances: alone, or in sets with one matrix."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Draft, Row
from mor.formats.snap.errors import VectorError
from mor.formats.snap.stations import Stations

NUMBERS = {"full": (6, 0, 1), "correlation": (6, 3, 1), "diagonal": (3, 3, 0), "enu": (3, 3, 0)}
"""Types of errors: how many numbers follow a vector alone, one in a set; whether a matrix follows the set."""
_LOWER = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


class Member(NamedTuple):
    """A vector or a position."""

    names: list[str]
    heights: list[float]
    value: list[float]
    sigma: list[float] | None
    """As its line has them; with a fourth one, −1, where they are east, north, up in place of what a command says."""
    rejected: bool
    line: int


class Set(NamedTuple):
    """Rows of vectors or positions, and their covariance matrix."""

    rows: list[Row]
    Q: FloatArray


def set_of(
    stations: Stations,
    members: list[Member],
    form: str,
    error: VectorError | None,
    numbers: list[float] | None,
) -> Set | None:
    """The members that are not rejected with their covariance matrix. Raises ``ValueError``."""
    Q = _covariance(stations, members, form, error, numbers)
    kept = np.flatnonzero([not member.rejected for member in members])
    if not len(kept):
        return None
    places = (3 * kept[:, None] + np.arange(3)).ravel()
    Q = Q[np.ix_(places, places)]
    if not np.isfinite(Q).all() or np.linalg.eigvalsh(Q)[0] <= 0.0:
        raise ValueError("the covariance matrix is not positive definite")
    vector = len(members[0].names) == 2
    if not vector and any(member.heights[0] for member in members):
        raise ValueError("heights of antennas above observed positions (GX) are not followed")
    rows = [
        Row([*m.names, *map(repr, m.value), *(map(repr, m.heights) if vector else [])], m.line)
        for m in (members[k] for k in kept)
    ]
    return Set(rows, Q)


def put_singles(draft: Draft, singles: list[Set], file: str) -> None:
    """Vectors or positions that are in no set, with their covariances in columns."""
    names = _columns(len(singles[0].rows[0].cells))
    values = [name for name in names if name in ("x", "y", "z", "dx", "dy", "dz")]
    pairs = [f"cov_{values[i]}_{values[j]}" for i in range(3) for j in range(i, 3)]
    rows = [
        Row(
            [*one.rows[0].cells, *(repr(float(one.Q[i, j])) for i in range(3) for j in range(i, 3))],
            one.rows[0].line,
        )
        for one in singles
    ]
    draft.table("observations", [*names, *pairs], rows, file, type=_type(names))


def put_sets(draft: Draft, sets: list[Set], file: str) -> None:
    """Sets of vectors or positions with their matrices."""
    names = _columns(len(sets[0].rows[0].cells))
    draft.correlated(names, sets, _type(names), file)


def _columns(count: int) -> list[str]:
    vector = ["from", "to", "dx", "dy", "dz", "from_height", "to_height"]
    return vector if count == len(vector) else ["point", "x", "y", "z"]


def _type(columns: list[str]) -> str:
    return "gnss_vector" if columns[0] == "from" else "gnss_position"


def _covariance(
    stations: Stations,
    members: list[Member],
    form: str,
    error: VectorError | None,
    numbers: list[float] | None,
) -> FloatArray:
    if not form:
        return _of_command(stations, members, error)
    if numbers is not None and NUMBERS[form][2]:
        return _of_set(members, form, numbers)
    Q = np.zeros((3 * len(members), 3 * len(members)))
    for k, member in enumerate(members):
        given = member.sigma or []
        if form == "full":
            block = _symmetric(given)
        else:
            C = np.eye(3)
            if form == "correlation":
                C[[1, 2, 2], [0, 0, 1]] = C[[0, 0, 1], [1, 2, 2]] = given[3:]
            block = C * np.outer(given[:3], given[:3])
        if form == "enu" or given[3:] == [-1.0]:
            axes = stations.axes(member.names)
            block = axes.T @ np.diag(np.square(given[:3])) @ axes
        Q[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    return Q


def _symmetric(lower: list[float]) -> FloatArray:
    block = np.zeros((3, 3))
    for (i, j), value in zip(_LOWER, lower, strict=False):
        block[i, j] = block[j, i] = value
    return block


def _of_set(members: list[Member], form: str, numbers: list[float]) -> FloatArray:
    """The matrix behind a set: its lower triangle, of correlations without the diagonal."""
    size = 3 * len(members)
    below = 0 if form == "full" else -1
    rows, columns = np.tril_indices(size, below)
    if len(numbers) != len(rows):
        raise ValueError(f"found {len(numbers)} numbers behind #end_set, expected {len(rows)}")
    Q = np.zeros((size, size))
    Q[rows, columns] = Q[columns, rows] = numbers
    if form == "full":
        return Q
    np.fill_diagonal(Q, 1.0)
    sigma = np.concatenate([member.sigma or [0.0] * 3 for member in members])
    scaled: FloatArray = Q * np.outer(sigma, sigma)
    return scaled


def _of_command(stations: Stations, members: list[Member], error: VectorError | None) -> FloatArray:
    """Covariances of ``#gps_enu_error``: of members of a set such that vectors between them have its errors, too."""
    vectors = len(members[0].names) == 2
    if error is None:
        if all(member.sigma for member in members):
            error = VectorError()
        else:
            command = "#gps_enu_error" if vectors else "#gx_enu_error"
            raise ValueError(f"nothing says the errors: {command}, or error in #data")
    if error.relative and sum(not member.rejected for member in members) > 1:
        raise ValueError("errors of members relative to each other (mmr, ppmr) are not followed")
    names = sorted({name for member in members for name in member.names})
    axes = stations.axes(names)
    values = np.array([member.value for member in members])
    size = len(members)
    Q = np.zeros((3 * size, 3 * size))
    own = [
        np.square(member.sigma[:3])
        if member.sigma
        else error.variances(float(np.linalg.norm(value)) * vectors)
        for member, value in zip(members, values, strict=True)
    ]
    for i in range(size):
        for j in range(size):
            if i == j:
                variances = own[i]
            elif vectors:
                between = error.variances(float(np.linalg.norm(values[i] - values[j])))
                variances = 0.5 * (own[i] + own[j] - between)
            else:
                continue
            Q[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = axes.T @ np.diag(variances) @ axes
    return Q
