"""Null directions inside a network, made as short to tell as they can be: which unknowns nothing determines.

A null space comes as any basis of it, in which everything moves. What a user needs is the sparsest one: first the
directions that move a single parameter block, then for each that is left the combination that moves the fewest
blocks, which leaves the larger part of the network where it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.parameters.index import Index

_ALONE = 1e-8
"""1 − s² of a direction that moves one block only, s its length on that block."""
_TOLD = 1e-3
"""Movements below this part of the largest are not told."""
_SPARSEST = 60
"""Directions up to which the sparsest are looked for; of more, in a time that grows with the cube of their number only,
those of an echelon form are told: each moves an unknown of its own that no other one moves."""
_MOST = 12
"""Unknowns told of one direction."""


class Undetermined(NamedTuple):
    """A null direction that is no movement of the whole network: the unknowns it moves, the strongest first."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component) of the moved unknowns."""
    amounts: tuple[float, ...]


def loose_directions(
    basis: FloatArray, datum: FloatArray, index: Index, units: FloatArray
) -> tuple[Undetermined, ...]:
    """Directions of a null space (u, k), orthonormal, beside the movements of the network (u, d) in it.

    Both are in ``units`` (u,) of the unknowns.
    """
    found = basis.T @ datum
    loose = []
    for direction in _of_single_blocks(basis, index):
        if _adds(found, direction):
            found = np.column_stack([found, direction])
            loose.append(direction)
    single = len(loose)
    if basis.shape[1] - found.shape[1] > _SPARSEST:
        others = np.linalg.qr(found, mode="complete")[0][:, found.shape[1] :]
        loose += list((others @ _echelon(basis @ others)).T)
        return tuple(_describe(basis @ direction, index, units) for direction in loose)
    while found.shape[1] < basis.shape[1]:
        others = np.linalg.qr(found, mode="complete")[0][:, found.shape[1] :]
        direction = _sparsest(basis, others[:, 0], _block_starts(index))
        found = np.column_stack([found, direction])
        loose.append(direction)
    movements = [basis @ direction for direction in loose]
    told = [*movements[:single], *_by_components(movements[single:], index)]
    return tuple(_describe(movement, index, units) for movement in told)


def _by_components(movements: list[FloatArray], index: Index) -> list[FloatArray]:
    """The same movements (u,), those of the same blocks combined such that each moves few components of them."""
    starts = _block_starts(index)
    alike: dict[tuple[bool, ...], list[FloatArray]] = {}
    for movement in movements:
        size = np.maximum.reduceat(np.abs(movement), starts)
        alike.setdefault(tuple(size > _TOLD * size.max()), []).append(movement)
    every = np.arange(len(index.kind_of), dtype=np.int64)
    result: list[FloatArray] = []
    for together in alike.values():
        if len(together) == 1:
            result += together
            continue
        basis, _ = np.linalg.qr(np.stack(together, axis=1))
        found = np.zeros((len(together), 0))
        while found.shape[1] < len(together):
            functional = (
                np.linalg.qr(found, mode="complete")[0][:, found.shape[1]] if found.size else _unit(basis)
            )
            found = np.column_stack([found, _sparsest(basis, functional, every)])
        result += list((basis @ found).T)
    return result


def _unit(basis: FloatArray) -> FloatArray:
    """(k,) the combination of a basis that moves its most moved component."""
    row: FloatArray = basis[int(np.argmax(np.linalg.norm(basis, axis=1)))]
    return row / np.linalg.norm(row)


def _adds(found: FloatArray, direction: FloatArray) -> bool:
    if found.shape[1] == 0:
        return True
    basis, _ = np.linalg.qr(found)
    return bool(np.linalg.norm(direction - basis @ (basis.T @ direction)) > 1e-6 * np.linalg.norm(direction))


def _of_single_blocks(basis: FloatArray, index: Index) -> list[FloatArray]:
    """Combinations (k,) of the basis that move one parameter block and nothing else, component by component."""
    starts = np.flatnonzero(
        (np.diff(index.kind_of, prepend=-1) != 0) | (np.diff(index.block_of, prepend=-1) != 0)
    )
    heavy = np.add.reduceat(np.sum(basis**2, axis=1), starts) > 1.0 - 2.0 * _ALONE
    ends = np.append(starts[1:], len(basis))
    directions: list[FloatArray] = []
    for start, end in zip(starts[heavy], ends[heavy], strict=True):
        _, lengths, right = np.linalg.svd(basis[start:end], full_matrices=False)
        alone = right[1.0 - lengths**2 < _ALONE].T
        directions.extend((alone @ _echelon(basis[start:end] @ alone)).T)
    return directions


def _echelon(movements: FloatArray) -> FloatArray:
    """Combinations (r, r) of movements (m, r) of which each alone moves one of r chosen components."""
    chosen: list[int] = []
    left: FloatArray = movements.copy()
    for _ in range(movements.shape[1]):
        row = int(np.argmax(np.linalg.norm(left, axis=1)))
        chosen.append(row)
        unit: FloatArray = left[row] / np.linalg.norm(left[row])
        left = left - np.outer(left @ unit, unit)
    return np.asarray(np.linalg.inv(movements[chosen]), dtype=np.float64)


def _sparsest(basis: FloatArray, functional: FloatArray, starts: IntArray) -> FloatArray:
    """Combination (k,) c of the basis with functional · c = 1 that moves few blocks, by reweighting.

    ``starts`` holds the first unknown of every block. Each block is weighted with the inverse square of its last
    movement, at first damped, then ever less: in the limit Σ |movement|²/|movement|² counts the blocks that move.
    """
    lengths = np.diff(np.append(starts, len(basis)))
    direction = functional
    for damping in np.geomspace(1.0, 1e-6, 30):
        squares = np.add.reduceat((basis @ direction) ** 2, starts)
        weights = np.repeat(1.0 / (squares + damping**2 * squares.max()), lengths)
        gram = basis.T @ (weights[:, None] * basis)
        answer = np.linalg.solve(gram, functional)
        direction = np.asarray(answer / (functional @ answer), dtype=np.float64)
    return direction


def _block_starts(index: Index) -> IntArray:
    """First unknown of every parameter block that has any."""
    changes = (np.diff(index.kind_of, prepend=-1) != 0) | (np.diff(index.block_of, prepend=-1) != 0)
    return np.flatnonzero(changes).astype(np.int64)


def _describe(movement: FloatArray, index: Index, units: FloatArray) -> Undetermined:
    size = np.abs(movement)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] > _TOLD * size.max()][:_MOST]
    movement = units * movement
    largest = movement[order[0]]
    return Undetermined(
        tuple(index.label(int(column)) for column in order),
        tuple(float(movement[column] / largest) for column in order),
    )
