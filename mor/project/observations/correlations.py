"""Correlated observations: covariances by row, by group, or over several groups of one cluster."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mor.arrays import LARGEST, FloatArray, IntArray
from mor.errors import InputError, Problem
from mor.input_files import read_text
from mor.project.edge import SMALLEST_SIGMA
from mor.project.file.model import Observations
from mor.project.network.reading import Reading
from mor.project.observations.observation_rows import Group
from mor.project.tables.tables import Place


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
        words = _not_positive_definite(covariance)
        if words:
            reading.problems.append(Problem(words, group.group.file, int(group.group.lines[i])))
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
    words = _not_positive_definite(covariance)
    if words:
        reading.problems.append(place.problem(words, "covariance"))
        return []
    return [Correlation(where, rows, components, covariance)]


def _entries(groups: list[Group], number: int) -> tuple[IntArray, IntArray, IntArray]:
    rows, components = np.nonzero(groups[number].group.mask)
    return np.full(len(rows), number), rows.astype(np.int64), components.astype(np.int64)


def _turn(groups: list[Group], where: IntArray, rows: IntArray, components: IntArray) -> FloatArray:
    """Matrix that takes the entries as given (same rows, project axes and units) to internal ones.

    Where only some components of a row are observed, turned axes put them elsewhere: they keep their order as given.
    """
    turn = np.zeros((len(rows), len(rows)))
    blocks: dict[tuple[int, int], list[int]] = {}
    for k, (g, r) in enumerate(zip(where, rows, strict=True)):
        blocks.setdefault((int(g), int(r)), []).append(k)
    for (g, _), entries in blocks.items():
        group = groups[g]
        given = [int(np.argmax(np.abs(group.transform[components[k]]))) for k in entries]
        place = dict(zip(sorted(given), entries, strict=True))
        for k, source in zip(entries, given, strict=True):
            turn[k, place[source]] = group.transform[components[k], source] * group.factors[source]
    return turn


def _matrix(reading: Reading, entry: Observations, place: Place) -> FloatArray | None:
    if not isinstance(entry.covariance, str):
        return _rectangle(reading, entry.covariance or [], place)
    path = place.folder / entry.covariance
    if not path.is_file():
        reading.problems.append(
            place.problem(f"covariance: file {entry.covariance!r} does not exist", "covariance")
        )
        return None
    try:
        rows = _rows_of_file(path)
    except InputError as error:
        reading.problems.extend(error.problems)
        return None
    return _rectangle(reading, rows, place)


def _rectangle(reading: Reading, rows: list[list[float]], place: Place) -> FloatArray | None:
    if len({len(row) for row in rows}) > 1:
        reading.problems.append(place.problem("covariance: rows of different length", "covariance"))
        return None
    return np.array(rows, dtype=float)


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


def _not_positive_definite(matrix: FloatArray) -> str:
    """What is wrong with a covariance matrix, in words; empty where nothing is."""
    if not np.isfinite(matrix).all():
        return "the covariance matrix is not complete: found NaN"
    if (np.abs(matrix - matrix.T) > 1e-9 * np.abs(matrix)).any():
        return "the covariance matrix is not symmetric"
    if (np.diagonal(matrix) <= 0.0).any():
        words = "a variance, or the σ instead of it, is zero, negative or missing"
        return f"the covariance matrix is not positive definite: {words}"
    if not ((np.diagonal(matrix) >= SMALLEST_SIGMA**2) & (np.diagonal(matrix) <= LARGEST**2)).all():
        return f"the covariance matrix has a σ outside of {SMALLEST_SIGMA:g} to {LARGEST:g}"
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return "the covariance matrix is not positive definite: its correlations contradict each other"
    return ""
