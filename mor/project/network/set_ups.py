"""Constants of a set-up: heights, eccentricities, offsets, motions. Fixed if nothing else is said; shared by name."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.kinds import ECCENTRICITY, HEIGHT, IMAGE_VELOCITY, ROTATION_RATE, BlockKind
from mor.project.network.entities import entities
from mor.project.network.reading import Reading
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
    statuses, said = _statuses(reading, kind, rows, fixed, free)
    result, store = otherwise.copy(), reading.shop.store(kind.key)
    named = rows.text(shared_column(kind))
    own = np.flatnonzero(said & np.array([not name for name in named], dtype=bool))
    result[own] = store.add([labels[i] for i in own], *statuses.rows(own))
    shared = reading.shop.things.get(shared_column(kind))
    known = {name: shared.part(name, kind.key) for name in shared.ids} if shared else {}
    for i, name in enumerate(named):
        if not name:
            continue
        row = statuses.rows(np.array([i]))
        if name not in known:
            known[name] = int(store.add([f"{kind.key} {name}"], *row)[0])
        elif _differs(rows, i, kind, store.all_values()[known[name]]):
            words = f"{shared_column(kind)}: {name!r} has another value in a row above"
            tell_rows(reading.problems, np.arange(rows.count) == i, rows, words)
        result[i] = known[name]
    numbers = {kind.key: np.array(list(known.values()), dtype=np.int64)}
    reading.shop.things[shared_column(kind)] = entities(known, numbers)
    return result


def _differs(rows: Rows, row: int, kind: BlockKind, values: FloatArray) -> bool:
    """True where a row gives a component that is not the one of the shared block."""
    given = np.array([rows.number(component.name)[row] for component in kind.components])
    return bool((np.isfinite(given) & (given != values)).any())


def _statuses(
    reading: Reading, kind: BlockKind, rows: Rows, fixed: Collection[str], free: Collection[str]
) -> tuple[Statuses, BoolArray]:
    """Statuses of the rows: observed with a σ, free where the table says so, else fixed; and where anything is said."""
    names, problems = kind.names, reading.problems
    given = np.stack([rows.number(name) for name in names], axis=1)
    sigma = np.stack([rows.number(f"sigma_{name}") for name in names], axis=1)
    start = np.stack([rows.number(f"start_{name}") for name in names], axis=1)
    loose = np.array([name in free for name in names])
    for k, name in enumerate(names):
        own = f"sigma_{name}"
        tell_rows(problems, sigma[:, k] < 0.0, rows, f"{own}: found a negative σ, expected a σ ≥ 0")
        missing = np.isfinite(sigma[:, k]) & np.isnan(given[:, k])
        tell_rows(problems, missing, rows, f"{name} has a σ but no value")
        if loose[k]:
            wrong = np.isfinite(sigma[:, k])
            tell_rows(
                problems, wrong, rows, f"{name} is free in this table, and has a σ; expected one of them"
            )
            held = np.full(rows.count, name in fixed)
            tell_rows(problems, held, rows, f"{name} is free and fixed in this table; expected one of them")
    observed = (sigma > 0.0) & ~np.array([name in fixed for name in names])
    unknown = observed | loose
    statuses = Statuses(
        np.nan_to_num(given),
        unknown,
        np.where(observed, sigma, np.nan),
        np.where(unknown, start, np.nan),
    )
    return statuses, np.asarray(np.isfinite(given).any(axis=1) | loose.any())
