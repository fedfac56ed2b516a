"""What a found defect means: movements of the whole network, or something that is not determined inside it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.adjustment.datum.undetermined import Undetermined, loose_directions
from mor.adjustment.problem import Problem
from mor.arrays import BoolArray, FloatArray
from mor.parameters.index import Index, Values

MOVEMENTS = (
    "translation X",
    "translation Y",
    "translation Z",
    "rotation X",
    "rotation Y",
    "rotation Z",
    "scale",
)
BY_CURVATURE = "movement that the curvature of vTPv determines"
"""A movement that no observation notices to first order."""
_SMALL = 1e-6


@dataclass(frozen=True)
class Defect:
    """Null space of the system, split."""

    movements: tuple[str, ...]
    """Names of the free movements of the network; combinations where fewer are free than are named."""
    datum: FloatArray
    """(u, d) null vectors that are movements of the network."""
    inside: Inside | None = None
    """What else there is."""
    beyond_use: tuple[Undetermined, ...] = ()
    """What is determined so badly that it is as good as not."""
    to_second_order: int = 0
    """Movements that change no observation to first order, and that the curvature of vᵀPv determines."""

    @property
    def dimension(self) -> int:
        """Unknowns less the rank of the normal matrix, apart from what is not determined inside the network."""
        return int(self.datum.shape[1]) + self.to_second_order

    @cached_property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """What is not determined inside the network, each as short to tell as it can be.

        Worked out when it is asked for: of a large null space that takes much longer than an adjustment, and of most
        networks that are only tried nobody asks.
        """
        inside = self.inside
        return self.beyond_use or (loose_directions(*inside) if inside else ())


class Inside(NamedTuple):
    """A null space that is more than movements of the network."""

    basis: FloatArray
    """(u, k) orthonormal if lengths are counted in units of ``lengths``, the movements among it."""
    datum: FloatArray
    """(u, d) the movements, in these units, too."""
    unknowns: Index
    lengths: FloatArray
    """(u,) units of the unknowns."""


def explain_defect(null: FloatArray, problem: Problem, values: Values) -> Defect:
    """Split null vectors (u, k) into movements of the whole network and configuration defects.

    A movement of the network is a similarity of all its points at once. Where the free points are so few that any
    movement of theirs would pass for one, those held fixed have a say: a single new point that nothing determines
    does not move the control points, and so is no movement of the network.
    """
    if null.shape[1] == 0:
        return Defect((), null)
    lengths = units_of_length(problem.index, values)
    basis, _ = np.linalg.qr(null / lengths[:, None])
    columns = problem.index.columns["point"]
    used = _telling_components(problem, values, null.shape[1])
    free = (columns[used] >= 0)[:, None]
    generators = similarity_generators(values["point"], used)
    on_points = np.where(free, basis[columns[used]], 0.0)
    span, sizes, _ = np.linalg.svd(generators, full_matrices=False)
    span = span[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]
    deformation = on_points - span @ (span.T @ on_points)
    stretches, right = _stretches(deformation)
    rigid = right[stretches <= _SMALL].T
    motion, inner = _stretches(on_points @ rigid)
    datum = basis @ rigid @ inner[motion > _SMALL].T
    inside = Inside(basis, datum, problem.index, lengths) if datum.shape[1] < basis.shape[1] else None
    names = _name(np.where(free, datum[columns[used]], 0.0), generators)
    return Defect(names, lengths[:, None] * datum, inside)


def units_of_length(index: Index, values: Values) -> FloatArray:
    """Return the unit of every unknown (u,) in which lengths are parts of the size of the network.

    Null vectors have components of lengths and of angles. If lengths are counted in metres, the angles of a block of
    micrometre size outweigh its coordinates a million times.
    """
    units = np.ones(index.count)
    points = values.get("point", np.zeros((0, 3)))
    if len(points) == 0:
        return units
    size = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    if not 0.0 < size < np.inf:
        return units
    for kind, columns in index.columns.items():
        powers = [float(component.quantity.length) for component in index.blocks[kind].kind.components]
        for column, power in zip(columns.T, powers, strict=True):
            units[column[column >= 0]] = size**power
    return units


def _stretches(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Singular values (k,) and all right singular vectors (k, k), row by row, of a matrix (n, k) that may be long."""
    short = np.linalg.qr(matrix, mode="r")
    _, sizes, right = np.linalg.svd(short, full_matrices=True)
    return np.concatenate([sizes, np.zeros(len(right) - len(sizes))]), right


def similarities(coordinates: FloatArray, centre: FloatArray) -> FloatArray:
    """Displacements (n, 3, 7) of points (n, 3) under the movements of MOVEMENTS, about a centre (3,)."""
    x, y, z = (coordinates - centre).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    return np.stack(
        [
            np.stack([one, zero, zero], axis=1),
            np.stack([zero, one, zero], axis=1),
            np.stack([zero, zero, one], axis=1),
            np.stack([zero, -z, y], axis=1),
            np.stack([z, zero, -x], axis=1),
            np.stack([-y, x, zero], axis=1),
            np.stack([x, y, z], axis=1),
        ],
        axis=2,
    )


def similarity_generators(coordinates: FloatArray, used: BoolArray) -> FloatArray:
    """The seven movements on the used components of points (k, 7), about their centre, columns scaled to length 1."""
    anywhere = used.any(axis=1)
    centre = coordinates[anywhere].mean(axis=0) if anywhere.any() else np.zeros(3)
    # In parts of the extent, whose square may be no number.
    _, power = np.frexp(np.abs(coordinates[anywhere] - centre).max(initial=0.0))
    generators = similarities(np.ldexp(coordinates - centre, -power), np.zeros(3))[used]
    lengths = np.linalg.norm(generators, axis=0)
    return generators / np.where(lengths > 0.0, lengths, 1.0)


def _telling_components(problem: Problem, values: Values, dimension: int) -> BoolArray:
    """(n, 3) point components that tell whether null vectors are movements of the network.

    The free ones f. A null space of dimension k and the similarities of dimension s meet in k + s − f dimensions by
    mere chance; where that is positive, the fixed components that observations look at are taken in as well.
    """
    free, fixed = network_components(problem, values)
    generators = similarity_generators(values["point"], free)
    similar = int(np.linalg.matrix_rank(generators, tol=1e-9)) if len(generators) else 0
    return free if np.count_nonzero(free) >= dimension + similar else free | fixed


def network_components(problem: Problem, values: Values) -> tuple[BoolArray, BoolArray]:
    """(n, 3) free point components that observations name, and fixed ones that they look at.

    Origins of local systems are no points of the network: where a system has fixed components, its origin need not
    follow. (A plane through a fixed origin follows by its attitude and its offset.)
    """
    fixed = problem.index.columns["point"] < 0
    held: BoolArray = np.asarray(fixed.any(axis=1))
    used = np.zeros_like(fixed)
    for group in problem.groups:
        positions = [
            (k, number)
            for k, (slot, number) in enumerate(zip(group.type.slots, group.blocks, strict=True))
            if slot.kind == "point" and slot.of != "system"
        ]
        for _, number in positions:
            named = np.zeros(len(fixed), dtype=bool)
            named[number] = True
            used |= named[:, None] & ~fixed
        touched = np.any([held[number] for _, number in positions], axis=0)
        if not np.any(touched):
            continue
        blocks = [
            values[slot.kind][number[touched]]
            for slot, number in zip(group.type.slots, group.blocks, strict=True)
        ]
        jacobians = group.type.equation(blocks, group.constants[touched]).jacobians
        seen = group.mask[touched][:, :, None]
        for k, number in positions:
            np.logical_or.at(used, number[touched], ((jacobians[k] != 0.0) & seen).any(axis=1))
    return used & ~fixed, used & fixed


def _name(datum: FloatArray, generators: FloatArray) -> tuple[str, ...]:
    """Movements among null vectors on points (k, d); where they do not account for all of them, "combination"."""
    if datum.shape[1] == 0:
        return ()
    basis, _ = np.linalg.qr(datum)
    present = np.linalg.norm(generators, axis=0) > 0.0
    within = np.linalg.norm(basis.T @ generators, axis=0) > 1.0 - _SMALL
    names = [name for name, inside in zip(MOVEMENTS, within & present, strict=True) if inside]
    missing = datum.shape[1] - len(names)
    return (*names, *(["combination of translation, rotation and scale"] * missing))
