"""Correlated observations: covariances by row, by group, or over several groups of one cluster."""

from __future__ import annotations

import csv
from dataclasses import dataclass

import numpy as np

from mor.geometry.arrays import FloatArray, IntArray
from mor.project.model import Observations
from mor.project.observation_rows import Group
from mor.project.reading import Reading
from mor.project.tables import Place


@dataclass(frozen=True)
class Correlation:
    """Entries of observation groups and their covariance matrix, internal units and axes."""

    groups: IntArray
    rows: IntArray
    components: IntArray
    covariance: FloatArray


def correlations(reading: Reading, groups: list[Group]) -> tuple[Correlation, ...]:
    """All correlated clusters of the groups, checked to be positive definite."""
    result: list[Correlation] = []
    clusters: dict[str, list[int]] = {}
    for number, group in enumerate(groups):
        entry = reading.project.observations[group.entry]
        if group.covariances is not None:
            result += _by_row(reading, groups, number)
        elif entry.cluster is not None:
            clusters.setdefault(entry.cluster, []).append(number)
        elif entry.covariance is not None:
            clusters.setdefault(f"\0{number}", []).append(number)
    for members in clusters.values():
        result += _over_groups(reading, groups, members)
    return tuple(result)


def _by_row(reading: Reading, groups: list[Group], number: int) -> list[Correlation]:
    group = groups[number]
    covariances = group.covariances
    assert covariances is not None
    mask = group.group.mask
    result = []
    for i in range(group.group.count):
        components = np.flatnonzero(mask[i])
        covariance = group.transform @ covariances[i] @ group.transform.T
        covariance = covariance[np.ix_(components, components)]
        if not _positive_definite(covariance):
            place = reading.at("observations", group.entry)
            words = (
                f"{group.group.file}:{group.group.lines[i]}: the covariance matrix is not positive definite"
            )
            reading.problems.append(place.problem(words))
            continue
        size = len(components)
        result.append(Correlation(np.full(size, number), np.full(size, i), components, covariance))
    return result


def _over_groups(reading: Reading, groups: list[Group], members: list[int]) -> list[Correlation]:
    """One matrix over all entries of the member groups, in the order in which they are given."""
    parts = [_entries(groups, number) for number in members]
    where, rows, components = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    entries = [reading.project.observations[groups[number].entry] for number in members]
    with_matrix = [k for k, entry in enumerate(entries) if entry.covariance is not None]
    place = reading.at("observations", groups[members[0]].entry)
    if len(with_matrix) != 1:
        reading.problems.append(
            place.problem("exactly one group of a cluster must give its covariance matrix", "cluster")
        )
        return []
    place = reading.at("observations", groups[members[with_matrix[0]]].entry)
    given = _matrix(reading, entries[with_matrix[0]], place)
    if given is None:
        return []
    size = len(rows)
    if given.shape != (size, size):
        shape = " × ".join(map(str, given.shape))
        reading.problems.append(
            place.problem(f"covariance: found {shape}, expected {size} × {size}", "covariance")
        )
        return []
    turn = _turn(groups, where, rows, components)
    covariance = turn @ given @ turn.T
    if not _positive_definite(covariance):
        reading.problems.append(place.problem("the covariance matrix is not positive definite", "covariance"))
        return []
    return [Correlation(where, rows, components, covariance)]


def _entries(groups: list[Group], number: int) -> tuple[IntArray, IntArray, IntArray]:
    rows, components = np.nonzero(groups[number].group.mask)
    return np.full(len(rows), number), rows.astype(np.int64), components.astype(np.int64)


def _turn(groups: list[Group], where: IntArray, rows: IntArray, components: IntArray) -> FloatArray:
    """Matrix that takes the entries as given (same places, project axes and units) to internal ones."""
    size = len(rows)
    turn = np.zeros((size, size))
    place = {
        (int(g), int(r), int(c)): k for k, (g, r, c) in enumerate(zip(where, rows, components, strict=True))
    }
    for (g, r, c), k in place.items():
        group = groups[g]
        for given in np.flatnonzero(group.transform[c]):
            source = place.get((g, r, int(given)))
            if source is not None:
                turn[k, source] = group.transform[c, given] * group.factors[given]
    return turn


def _matrix(reading: Reading, entry: Observations, place: Place) -> FloatArray | None:
    if not isinstance(entry.covariance, str):
        rows: list[list[float]] = entry.covariance or []
        if len({len(row) for row in rows}) > 1:
            reading.problems.append(place.problem("covariance: rows of different length", "covariance"))
            return None
        return np.array(rows, dtype=float)
    path = place.folder / entry.covariance
    if not path.is_file():
        reading.problems.append(
            place.problem(f"covariance: file {entry.covariance!r} does not exist", "covariance")
        )
        return None
    try:
        with path.open(newline="") as file:
            return np.array([[float(cell) for cell in row] for row in csv.reader(file) if row], dtype=float)
    except ValueError as error:
        reading.problems.append(place.problem(f"covariance: {entry.covariance}: {error}", "covariance"))
        return None


def _positive_definite(matrix: FloatArray) -> bool:
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        return False
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
