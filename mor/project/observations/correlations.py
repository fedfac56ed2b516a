"""Correlated observations: covariances by row, by clusters of rows, by group, or over groups of one cluster."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import LARGEST, FloatArray, IntArray, SmallIntArray
from mor.errors import InputError, Problem
from mor.input_files import read_text
from mor.project.edge import SMALLEST_SIGMA
from mor.project.file.model import Observations
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import Group
from mor.project.tables.tables import Place


class Correlation(NamedTuple):
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
        elif group.clusters is not None:
            result += _by_cluster(reading, groups, number)
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
    observed = [np.flatnonzero(row) for row in group.group.mask]
    turned = [
        (group.transform @ given @ group.transform.T)[np.ix_(components, components)]
        for components, given in zip(observed, covariances, strict=True)
    ]
    flawless, result = _are_positive_definite(turned), []
    for i, (components, covariance) in enumerate(zip(observed, turned, strict=True)):
        words = "" if flawless else _not_positive_definite(covariance)
        if words:
            reading.problems.append(Problem(words, group.group.file, int(group.group.lines[i])))
            continue
        size = len(components)
        result.append(Correlation(np.full(size, number), np.full(size, i), components, covariance))
    return result


def _by_cluster(reading: Reading, groups: list[Group], number: int) -> list[Correlation]:
    """A matrix for the rows of each cluster: the rows of a covariance are those of its own cluster alone."""
    found = groups[number]
    place = reading.at("observations", found.entry)
    given = rows_of_covariance(reading.project.observations[found.entry], place, reading.problems)
    assert found.clusters is not None
    if given is None:
        return []
    where, rows, components = _entries(groups, number)
    members = members_of(found.clusters.numbers[rows])
    names = [found.clusters[int(rows[own[0]])] for own in members]
    wrong = wrong_rows(given, members, names)
    if wrong:
        reading.problems.append(place.problem(wrong, "covariance"))
        return []
    turned = [
        _inside(groups, where[own], rows[own], components[own]).carried(
            np.array([given[k] for k in own.tolist()], dtype=float)
        )
        for own in members
    ]
    flawless, result = _are_positive_definite(turned), []
    for name, own, covariance in zip(names, members, turned, strict=True):
        words = "" if flawless else _not_positive_definite(covariance)
        if words:
            reading.problems.append(place.problem(f"cluster {name!r}: {words}", "covariance"))
        result.append(Correlation(where[own], rows[own], components[own], covariance))
    return result


def members_of(clusters: IntArray | SmallIntArray) -> list[IntArray]:
    """Entries of each cluster, in their order, by the number of the cluster that each (n,) belongs to."""
    order = np.argsort(clusters, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(clusters[order])) + 1)


def wrong_rows(given: Sequence[Sequence[float]], members: list[IntArray], names: Sequence[str]) -> str:
    """What is wrong with the lengths of the rows of the matrices of clusters, in words; empty if nothing is."""
    count = sum(map(len, members))
    if len(given) != count:
        return f"covariance: found {len(given)} rows, expected {count}, one for each observation"
    for name, own in zip(names, members, strict=True):
        for k in own.tolist():
            if len(given[k]) != len(own):
                found, expected = len(given[k]), len(own)
                return (
                    f"covariance: found {found} values in row {k + 1}, expected {expected}, as many as cluster "
                    f"{name!r} has observations"
                )
    return ""


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
    covariance = _inside(groups, where, rows, components).carried(given)
    words = _not_positive_definite(covariance)
    if words:
        reading.problems.append(place.problem(words, "covariance"))
        return []
    return [Correlation(where, rows, components, covariance)]


def _entries(groups: list[Group], number: int) -> tuple[IntArray, IntArray, IntArray]:
    rows, components = np.nonzero(groups[number].group.mask)
    return np.full(len(rows), number), rows.astype(np.int64), components.astype(np.int64)


class _Inside(NamedTuple):
    """How entries as given (same rows, project axes and units) become internal ones."""

    order: IntArray
    """(n,) place of each entry among those given."""
    factor: FloatArray
    """(n,)."""

    def carried(self, given: FloatArray) -> FloatArray:
        """Covariances (n, n) in internal units and axes."""
        carried: FloatArray = given[np.ix_(self.order, self.order)] * np.outer(self.factor, self.factor)
        return carried


def _inside(groups: list[Group], where: IntArray, rows: IntArray, components: IntArray) -> _Inside:
    """What takes entries, in the order of their groups and rows, to internal ones.

    Where only some components of a row are observed, turned axes put them elsewhere: they keep their order as given.
    """
    source, factor = np.zeros(len(rows), dtype=np.int64), np.zeros(len(rows))
    for number in np.unique(where).tolist():
        own, group = where == number, groups[number]
        from_given = np.argmax(np.abs(group.transform), axis=1)[components[own]]
        source[own] = from_given
        factor[own] = group.transform[components[own], from_given] * group.factors[from_given]
    order = np.zeros(len(rows), dtype=np.int64)
    order[np.lexsort((source, rows, where))] = np.arange(len(rows))
    return _Inside(order, factor)


def _matrix(reading: Reading, entry: Observations, place: Place) -> FloatArray | None:
    rows = rows_of_covariance(entry, place, reading.problems)
    if rows is None:
        return None
    if len({len(row) for row in rows}) > 1:
        reading.problems.append(place.problem("covariance: rows of different length", "covariance"))
        return None
    return np.array(rows, dtype=float)


def rows_of_covariance(
    entry: Observations, place: Place, problems: list[Problem]
) -> Sequence[Sequence[float]] | None:
    """Rows of the matrix of a table, from the project or a file; ``None`` if ``problems`` were added instead."""
    if not isinstance(entry.covariance, str):
        return entry.covariance or []
    path = place.folder / entry.covariance
    if not path.is_file():
        problems.append(place.problem(f"covariance: file {entry.covariance!r} does not exist", "covariance"))
        return None
    try:
        return _rows_of_file(path)
    except InputError as error:
        problems.extend(error.problems)
        return None


def _rows_of_file(path: Path) -> list[list[float]]:
    """Numbers of a CSV file without header. Raises :class:`InputError`."""
    rows, problems = [], []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        cells = [cell.strip() for cell in line.split(",")]
        if not line.strip():
            continue
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError:
            bad = next(cell for cell in cells if not _is_number(cell))
            problems.append(Problem(f"found {bad!r}, expected a number", str(path), number))
    if problems:
        raise InputError(problems)
    return rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _are_positive_definite(matrices: Sequence[FloatArray]) -> bool:
    """Return True if nothing is wrong with any covariance matrix; those of one size are looked at together."""
    sizes = np.array([len(matrix) for matrix in matrices], dtype=np.int64)
    return all(
        not _not_positive_definite(np.stack([matrices[int(k)] for k in np.flatnonzero(sizes == size)]))
        for size in np.unique(sizes)
    )


def _not_positive_definite(matrix: FloatArray) -> str:
    """What is wrong with a covariance matrix (…, n, n), or with one of several, in words; empty if nothing is."""
    variances = np.diagonal(matrix, axis1=-2, axis2=-1)
    if not np.isfinite(matrix).all():
        return "the covariance matrix is not complete: found NaN"
    if (np.abs(matrix - matrix.swapaxes(-2, -1)) > 1e-9 * np.abs(matrix)).any():
        return "the covariance matrix is not symmetric"
    if (variances <= 0.0).any():
        words = "a variance, or the σ instead of it, is zero, negative or missing"
        return f"the covariance matrix is not positive definite: {words}"
    if not ((variances >= SMALLEST_SIGMA**2) & (variances <= LARGEST**2)).all():
        return f"the covariance matrix has a σ outside of {SMALLEST_SIGMA:g} to {LARGEST:g}"
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return "the covariance matrix is not positive definite: its correlations contradict each other"
    return ""
