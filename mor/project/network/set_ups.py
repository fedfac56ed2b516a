"""Constants of a set-up: heights, eccentricities, offsets, motions. Fixed if nothing else is said; shared by name."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.kinds import ECCENTRICITY, HEIGHT, IMAGE_VELOCITY, ROTATION_RATE, BlockKind
from mor.project.network.entities import entities
from mor.project.network.reading import Reading, SetUp
from mor.project.tables.columns import tell_rows
from mor.project.tables.statuses import Statuses, component_columns
from mor.project.tables.tables import Column, Rows


def set_up_columns(reading: Reading, kind: BlockKind, shared: bool = True) -> list[Column]:
    """Columns of a constant of a set-up: its components with σ and start, and the name it is shared by."""
    columns = component_columns(kind.components, reading.edge)
    return [*columns, Column(shared_column(kind))] if shared else columns


def shared_column(kind: BlockKind) -> str:
    """Column that names a constant several frames share."""
    return f"shared_{kind.key.replace(' ', '_')}"


def heights(
    reading: Reading, rows: Rows, labels: list[str], fixed: Collection[str], free: Collection[str]
) -> IntArray:
    """Height block of every row: none, its own, or one that it shares."""
    return _set_ups(reading, HEIGHT, rows, labels, fixed, free, np.zeros(rows.count, dtype=np.int64))


def eccentricities(
    reading: Reading,
    rows: Rows,
    labels: list[str],
    fixed: Collection[str],
    free: Collection[str],
    otherwise: IntArray,
) -> IntArray:
    """Block of eccentricity or local offset of every row: its own, one that it shares, or another (n,)."""
    return _set_ups(reading, ECCENTRICITY, rows, labels, fixed, free, otherwise)


def motions(
    reading: Reading,
    rows: Rows,
    labels: list[str],
    fixed: Collection[str],
    free: Collection[str],
    moving: BoolArray,
) -> tuple[IntArray, IntArray]:
    """Blocks of velocity and rate of rotation of every row, −1 where it does not count: not ``moving`` (n,)."""
    found = []
    for kind in (IMAGE_VELOCITY, ROTATION_RATE):
        result = np.full(rows.count, -1, dtype=np.int64)
        here = np.flatnonzero(moving)
        if len(here):
            own = rows.take(here)
            still = np.full(len(here), reading.shop.neutral(kind.key), dtype=np.int64)
            names = [labels[i] for i in here]
            result[here] = _set_ups(reading, kind, own, names, fixed, free, still)
        found.append(result)
    return found[0], found[1]


def _set_ups(
    reading: Reading,
    kind: BlockKind,
    rows: Rows,
    labels: list[str],
    fixed: Collection[str],
    free: Collection[str],
    otherwise: IntArray,
) -> IntArray:
    said = _said(reading, kind, rows, fixed, free)
    result, store = otherwise.copy(), reading.shop.store(kind.key)
    named = rows.text(shared_column(kind))
    unnamed = np.array([not name for name in named], dtype=bool)
    own = np.flatnonzero(unnamed & said.anything())
    result[own] = store.add([labels[i] for i in own], *said.rows(own).statuses())
    shared = reading.shop.things.get(shared_column(kind))
    known = {name: shared.part(name, kind.key) for name in shared.ids} if shared else {}
    together = reading.shared_set_ups.setdefault(kind.key, {})
    for i in np.flatnonzero(~unnamed).tolist():
        together[named[i]] = _with_row(reading, kind, rows, i, said, together.get(named[i]))
    for name in dict.fromkeys(name for name in named if name):
        statuses = _Said(*together[name]).statuses()
        if name in known:
            store.put(known[name], statuses)
        else:
            known[name] = int(store.add([f"{kind.key} {name}"], *statuses)[0])
    for i in np.flatnonzero(~unnamed).tolist():
        result[i] = known[named[i]]
    numbers = {kind.key: np.array(list(known.values()), dtype=np.int64)}
    reading.shop.things[shared_column(kind)] = entities(known, numbers)
    return result


class _Said(NamedTuple):
    """What n rows say of the components of a constant, (n, size) each; NaN if they say nothing."""

    given: FloatArray
    sigma: FloatArray
    start: FloatArray
    free: FloatArray
    """1 where the component is an unknown without a σ."""

    def rows(self, chosen: IntArray) -> _Said:
        """Some of the rows."""
        return _Said(*(column[chosen] for column in self))

    def anything(self) -> BoolArray:
        """(n,) rows that say anything."""
        return np.asarray((np.isfinite(self.given) | np.isfinite(self.free)).any(axis=1))

    def statuses(self) -> Statuses:
        """Observed with a σ, free where the table says so, else fixed."""
        observed = self.sigma > 0.0
        unknown = observed | np.isfinite(self.free)
        return Statuses(
            np.nan_to_num(self.given),
            unknown,
            np.where(observed, self.sigma, np.nan),
            np.where(unknown, self.start, np.nan),
        )


def _with_row(
    reading: Reading, kind: BlockKind, rows: Rows, row: int, said: _Said, before: SetUp | None
) -> SetUp:
    """What all rows so far say of one shared constant: each component once, or several times the same."""
    here = said.rows(np.array([row]))
    if before is None:
        return tuple(here)
    column = shared_column(kind)
    name, at = rows.text(column)[row], np.arange(rows.count) == row
    contradictions = (
        f"{column}: {name!r} has another value in a row above",
        f"{column}: {name!r} has another σ in a row above",
        f"{column}: {name!r} has another start value in a row above",
    )
    for words, one, other in zip(contradictions, before, here, strict=False):
        if (np.isfinite(one) & np.isfinite(other) & (one != other)).any():
            tell_rows(reading.problems, at, rows, words)
    merged = _Said(*(np.where(np.isnan(one), other, one) for one, other in zip(before, here, strict=True)))
    if (np.isfinite(merged.sigma) & np.isfinite(merged.free)).any():
        words = f"{column}: {name!r} is free in one row and has a σ in another; expected one of them"
        tell_rows(reading.problems, at, rows, words)
    return tuple(merged)


def _said(
    reading: Reading, kind: BlockKind, rows: Rows, fixed: Collection[str], free: Collection[str]
) -> _Said:
    """What the rows say; σ = 0 is fixed, in a table of free ones, too."""
    names, problems = kind.names, reading.problems
    given = np.stack([rows.number(name) for name in names], axis=1)
    sigma = np.stack([rows.number(f"sigma_{name}") for name in names], axis=1)
    start = np.stack([rows.number(f"start_{name}") for name in names], axis=1)
    loose = np.full(given.shape, np.nan)
    for k, name in enumerate(names):
        own = f"sigma_{name}"
        tell_rows(problems, sigma[:, k] < 0.0, rows, f"{own}: found a negative σ, expected a σ ≥ 0")
        missing = np.isfinite(sigma[:, k]) & np.isnan(given[:, k])
        tell_rows(problems, missing, rows, f"{name} has a σ but no value")
        if name in free:
            wrong = sigma[:, k] > 0.0
            tell_rows(
                problems, wrong, rows, f"{name} is free in this table, and has a σ; expected one of them"
            )
            held = np.full(rows.count, name in fixed)
            tell_rows(problems, held, rows, f"{name} is free and fixed in this table; expected one of them")
            loose[sigma[:, k] != 0.0, k] = 1.0
        elif name in fixed:
            sigma[np.isfinite(given[:, k]), k] = 0.0
    return _Said(given, sigma, start, loose)
