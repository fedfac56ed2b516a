"""What a found defect means: movements of the whole network, or something that is not determined inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mor.geometry.arrays import FloatArray
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
_SMALL = 1e-6


@dataclass(frozen=True)
class Undetermined:
    """A null direction that is no movement of the whole network: the unknowns it moves, the strongest first."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component) of the moved unknowns."""
    amounts: tuple[float, ...]


@dataclass(frozen=True)
class Defect:
    """Null space of the system, split."""

    movements: tuple[str, ...]
    """Names of the free movements of the network; combinations where fewer are free than are named."""
    datum: FloatArray
    """(u, d) null vectors that are movements of the network."""
    undetermined: tuple[Undetermined, ...]


def explain_defect(null: FloatArray, index: Index, values: Values) -> Defect:
    """Split null vectors (u, k) into movements of the whole network and configuration defects."""
    if null.shape[1] == 0:
        return Defect((), null, ())
    basis, _ = np.linalg.qr(null)
    points, generators = similarity_generators(index, values)
    on_points = basis[points]
    span, sizes, _ = np.linalg.svd(generators, full_matrices=False)
    span = span[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]
    deformation = on_points - span @ (span.T @ on_points)
    _, stretches, right = np.linalg.svd(deformation, full_matrices=True)
    stretches = np.concatenate([stretches, np.zeros(len(right) - len(stretches))])
    rigid = right[stretches <= _SMALL].T
    _, motion, inner = np.linalg.svd(on_points @ rigid, full_matrices=True)
    motion = np.concatenate([motion, np.zeros(len(inner) - len(motion))])
    moving = inner[motion > _SMALL].T
    datum = basis @ rigid @ moving
    loose = np.concatenate([right[stretches > _SMALL].T, rigid @ inner[motion <= _SMALL].T], axis=1)
    undetermined = tuple(_describe(basis @ direction, index) for direction in loose.T)
    return Defect(_name(datum[points], generators), datum, undetermined)


def similarity_generators(index: Index, values: Values) -> tuple[FloatArray, FloatArray]:
    """Unknowns that are point coordinates, and the seven generators of similarity on them (k, 7), columns scaled."""
    columns = index.columns["point"]
    coordinates = values["point"]
    used = columns >= 0
    centre = np.where(used.any(axis=1)[:, None], coordinates, np.nan)
    centre = np.nanmean(centre, axis=0) if used.any() else np.zeros(3)
    x, y, z = (coordinates - centre).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    generators = np.stack(
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
    )[used]
    lengths = np.linalg.norm(generators, axis=0)
    return columns[used], generators / np.where(lengths > 0.0, lengths, 1.0)


def _name(datum: FloatArray, generators: FloatArray) -> tuple[str, ...]:
    """Movements that lie in the null space; where they do not account for all of it, "combination"."""
    if datum.shape[1] == 0:
        return ()
    basis, _ = np.linalg.qr(datum)
    present = np.linalg.norm(generators, axis=0) > 0.0
    within = np.linalg.norm(basis.T @ generators, axis=0) > 1.0 - _SMALL
    names = [name for name, inside in zip(MOVEMENTS, within & present, strict=True) if inside]
    missing = datum.shape[1] - len(names)
    return (*names, *(["combination of translation, rotation and scale"] * missing))


def _describe(direction: FloatArray, index: Index) -> Undetermined:
    size = np.abs(direction)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] > 1e-3 * size.max()][:12]
    largest = direction[order[0]]
    return Undetermined(
        tuple(index.label(int(column)) for column in order),
        tuple(float(direction[column] / largest) for column in order),
    )
