"""Datum defect, free networks, and S-transformations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mor.model import rotations
from mor.model.parameters import Index, Values, move
from mor.solve.problem import DatumDefinition, Problem, linearise, rotation_tangents
from mor.types import BoolArray, FloatArray, IntArray, pieces

# ---- Null directions inside a network, made as short to tell as they can be: which unknowns nothing determines.
#
# A null space comes as any basis of it, in which everything moves. What a user needs is the sparsest one: first the
# directions that move a single parameter block, then for each that is left the combination that moves the fewest
# blocks, which leaves the larger part of the network where it is.

_TOLD = 1e-3
"""Movements below this part of the largest are not told."""
_SPARSEST = 60
"""Directions up to which the sparsest are looked for; of more, in a time that grows with the cube of their number only,
those of an echelon form are told: each moves an unknown of its own that no other one moves."""


class Undetermined(NamedTuple):
    """A null direction that is no movement of the whole network: the unknowns it moves, the strongest first."""

    unknowns: tuple[tuple[str, str, str], ...]
    """(kind, block, component) of the moved unknowns."""
    amounts: tuple[float, ...]


def loose_directions(basis: FloatArray, datum: FloatArray, index: Index, units: FloatArray) -> tuple[Undetermined, ...]:
    """Directions of a null space (u, k), orthonormal, beside the movements of the network (u, d) in it.

    Both are in ``units`` (u,) of the unknowns.
    """
    found = basis.T @ datum
    loose = []
    # Combinations (k,) of the basis that move one parameter block and nothing else, component by component.
    starts = np.flatnonzero((np.diff(index.kind_of, prepend=-1) != 0) | (np.diff(index.block_of, prepend=-1) != 0))
    # Largest 1 − s² of a direction that moves one block only, s its length on that block.
    elsewhere = 1e-8
    heavy = np.add.reduceat(np.sum(basis**2, axis=1), starts) > 1.0 - 2.0 * elsewhere
    ends = np.append(starts[1:], len(basis))
    directions: list[FloatArray] = []
    for start, end in zip(starts[heavy], ends[heavy], strict=True):
        _, lengths, right = np.linalg.svd(basis[start:end], full_matrices=False)
        alone = right[1.0 - lengths**2 < elsewhere].T
        directions.extend((alone @ _echelon(basis[start:end] @ alone)).T)
    for direction in directions:
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
            functional = np.linalg.qr(found, mode="complete")[0][:, found.shape[1]] if found.size else _unit(basis)
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
    changes = (np.diff(index.kind_of, prepend=-1) != 0) | (np.diff(index.block_of, prepend=-1) != 0)
    return np.flatnonzero(changes).astype(np.int64)


def _describe(movement: FloatArray, index: Index, units: FloatArray) -> Undetermined:
    size = np.abs(movement)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] > _TOLD * size.max()][:12]  # at most
    movement = units * movement
    largest = movement[order[0]]
    return Undetermined(
        tuple(index.label(int(column)) for column in order),
        tuple(float(movement[column] / largest) for column in order),
    )


# ---- What a found defect means: movements of the whole network, or something that is not determined inside it.

MOVEMENTS = ("translation X", "translation Y", "translation Z", "rotation X", "rotation Y", "rotation Z", "scale")
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

    @property
    def is_of_cameras(self) -> bool:
        """True where camera constants are beyond use: then no other start values help."""
        return any(kind.startswith("interior/") for one in self.beyond_use[:1] for kind, _, _ in one.unknowns)

    @cached_property
    def undetermined(self) -> tuple[Undetermined, ...]:
        """Return the undetermined directions inside the network, each with as few unknowns as possible.

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
    columns = problem.index.columns["point"]
    far = _distances(values["point"])
    lengths[columns[columns >= 0]] *= np.broadcast_to(far, columns.shape)[columns >= 0]
    basis, _ = np.linalg.qr(null / lengths[:, None])
    used = _telling_components(problem, values, null.shape[1])
    free = (columns[used] >= 0)[:, None]
    generators = similarity_generators(values["point"], used)
    units = np.broadcast_to(far, used.shape)[used][:, None]
    on_points = np.where(free, basis[columns[used]], 0.0)
    span, sizes, _ = np.linalg.svd(generators / units, full_matrices=False)
    span = span[:, sizes > 1e-9 * max(sizes.max(initial=0.0), 1e-300)]
    deformation = on_points - span @ (span.T @ on_points)
    stretches, right = _stretches(deformation)
    rigid = right[stretches <= _SMALL].T
    motion, inner = _stretches(on_points @ rigid)
    datum = basis @ rigid @ inner[motion > _SMALL].T
    inside = Inside(basis, datum, problem.index, lengths) if datum.shape[1] < basis.shape[1] else None
    names = _name(np.where(free, units * datum[columns[used]], 0.0), generators)
    return Defect(names, lengths[:, None] * datum, inside)


def _distances(points: FloatArray) -> FloatArray:
    """(n, 1) distances from the middle of a network in units of the median distance, at least 1.

    A movement changes far points most, and these are where its null vector has the largest errors.
    """
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    size = float(np.median(distance))
    return np.maximum(distance / size, 1.0)[:, None] if size > 0.0 else np.ones((len(points), 1))


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
            values[slot.kind][number[touched]] for slot, number in zip(group.type.slots, group.blocks, strict=True)
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


# ---- Bodies that the observations leave loose even where all else is known: found without solving anything.
#
# The normal matrix of one body (a point, an image with its pose) with all others held is a block on the
# diagonal of the whole one. Where it is singular, so is the whole: a null vector of it is one of the system.


def beside(problem: Problem, values: Values) -> Values:
    """Values a little beside others (seeded): what is singular at both is so in general, not by chance of its place."""
    random = np.random.default_rng(1763)
    points = values["point"] if "point" in values and len(values["point"]) else np.zeros((1, 3))
    # Half of evenly spread points lie within a quarter of the extent from their median; one far away counts little.
    extent = 4.0 * float(np.median(np.abs(points - np.median(points, axis=0)), axis=0).max()) or 1.0
    scale = np.zeros(problem.index.count)
    small = 1e-3  # radians, and part of the extent of the network
    for number, kind in enumerate(problem.index.unknown_kind):
        size = small * extent if kind in ("point", "base") else small if kind == "rotation" else 0.0
        scale[problem.index.kind_of == number] = size
    return move(problem.index, values, scale * random.standard_normal(problem.index.count))


class LocalDefects(NamedTuple):
    """Bodies (n,) that are loose, and how many rows refer to each."""

    loose: BoolArray
    rows: IntArray
    too_few: BoolArray
    """Loose ones with fewer observations than unknowns."""


class _Bodies(NamedTuple):
    """Bodies of the unknowns (u,), −1 for none, and the number of each within its body."""

    body: IntArray
    place: IntArray
    sizes: IntArray


def local_defects(problem: Problem, values: Values, bodies: Mapping[str, IntArray], count: int) -> LocalDefects:
    """Loose ones among ``count`` bodies; ``bodies[kind]`` (n,) are those of the blocks, −1 for none."""
    bodies = {kind: body for kind, body in bodies.items() if (body >= 0).any()}
    of = _bodies(problem, bodies, count)
    rows, entries = _counts(problem, bodies, count)
    too_few = (of.sizes > 0) & (entries < of.sizes)
    # With more than four observations for each unknown of a body, its normal matrix is not worked out.
    doubtful = (of.sizes > 0) & ~too_few & (entries <= 4 * of.sizes) & ~_by_rays_only(problem, bodies, count)
    loose = too_few.copy()
    # (n,) true where a matrix of that size, scaled to unit diagonal, is singular to round-off.
    normals = _normals(problem, values, bodies, of, doubtful)
    sizes = of.sizes[doubtful]
    width = normals.shape[1]
    diagonal = np.diagonal(normals, axis1=1, axis2=2)
    inside = np.arange(width) < sizes[:, None]
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    scaled = normals * scale[:, :, None] * scale[:, None, :]
    scaled[:, np.arange(width), np.arange(width)] = np.where(inside, (diagonal > 0.0).astype(float), 1.0)
    smallest = np.linalg.eigvalsh(scaled)[:, 0] if width else np.ones(len(sizes))
    loose[doubtful] = np.asarray(smallest < 1e-14 * max(width, 1))
    return LocalDefects(loose, rows, too_few)


def _bodies(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> _Bodies:
    index = problem.index
    body = np.full(index.count, -1, dtype=np.int64)
    for number, kind in enumerate(index.unknown_kind):
        mine = index.kind_of == number
        if kind in bodies:
            body[mine] = bodies[kind][index.block_of[mine]]
    sizes = np.bincount(body[body >= 0], minlength=count)
    place = np.zeros(index.count, dtype=np.int64)
    order = np.argsort(body, kind="stable")
    order = order[body[order] >= 0]
    starts = np.cumsum(sizes) - sizes
    place[order] = np.arange(len(order)) - starts[body[order]]
    return _Bodies(body, place, sizes)


def _counts(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> tuple[IntArray, IntArray]:
    """Rows and observed components (bodies,) that refer to each body."""
    rows, entries = np.zeros((2, count), dtype=np.int64)
    for group in problem.groups:
        used = group.used
        for some in pieces(group.count, 1_000_000):
            observed = np.count_nonzero(used[some], axis=1)
            earlier: list[IntArray] = []
            for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
                if slot.kind not in bodies:
                    continue
                mine = bodies[slot.kind][numbers[some]]
                fresh = mine >= 0
                for other in earlier:
                    fresh &= other != mine
                rows += np.bincount(mine[fresh], minlength=count)
                weighted = np.bincount(mine[fresh], weights=observed[fresh], minlength=count)
                entries += weighted.astype(np.int64)
                earlier.append(mine)
    return rows, entries


def _by_rays_only(problem: Problem, bodies: Mapping[str, IntArray], count: int) -> BoolArray:
    """(bodies,) true where nothing but rays to it refers to a body: two of them determine it, or are parallel."""
    other = np.zeros(count, dtype=bool)
    for group in problem.groups:
        ray = len(group.type.components) == 2 and group.type.slots[-1].of == "point"
        for k, (slot, numbers) in enumerate(zip(group.type.slots, group.blocks, strict=True)):
            if slot.kind in bodies and not (ray and k == len(group.type.slots) - 1 and slot.kind == "point"):
                mine = bodies[slot.kind][numbers]
                other[mine[mine >= 0]] = True
    return ~other


def _normals(
    problem: Problem, values: Values, bodies: Mapping[str, IntArray], of: _Bodies, wanted: BoolArray
) -> FloatArray:
    width, count = int(of.sizes[wanted].max(initial=0)), int(np.count_nonzero(wanted))
    flat = np.zeros(count * width * width)
    tangent = rotation_tangents(problem.index, values)
    number = np.where(wanted, np.cumsum(wanted) - 1, -1)
    body_of = np.append(np.where(of.body >= 0, number[of.body], -1), -1)
    place_of = np.append(of.place, 0)
    rows_at_a_time = 50_000
    for group in problem.groups if width else ():
        touched = np.zeros(group.count, dtype=bool)
        for slot, numbers in zip(group.type.slots, group.blocks, strict=True):
            if slot.kind in bodies:
                mine = bodies[slot.kind][numbers]
                touched |= (mine >= 0) & wanted[mine]
        rows = np.flatnonzero(touched)
        for start in range(0, len(rows), rows_at_a_time):
            part = rows[start : start + rows_at_a_time]
            found = linearise(group, problem.index, values, tangent, part)
            jacobian = found.jacobian / np.where(np.isfinite(group.observed[part]), group.sigma[part], 1.0)[:, :, None]
            # Add the products of columns (n, K) that belong to one body.
            body = body_of[found.columns]
            place = place_of[found.columns]
            for i in range(body.shape[1]):
                for k in range(body.shape[1]):
                    same = (body[:, i] >= 0) & (body[:, i] == body[:, k])
                    if same.any():
                        products = np.sum(jacobian[same, :, i] * jacobian[same, :, k], axis=1)
                        cells = (body[same, i] * width + place[same, i]) * width + place[same, k]
                        np.add.at(flat, cells, products)
    return np.nan_to_num(flat.reshape(count, width, width))


# ---- The datum: which null directions are free movements of the whole network, and how the datum binds them.
#
# The inner constraint binds the total correction of the masked components to their reference,
# Bᵀ(x − x₀) = 0 with B = M G, G the movements of the network at the adjusted coordinates (then the sum of squared
# corrections of the masked components is the smallest), or at coordinates the datum names, usually the reference. Any
# solution of a minimal datum is carried there by x ← x + G t (S-transformation), and its cofactors by Q ← S Q Sᵀ,
# S = I − G (BᵀG)⁻¹ Bᵀ. Shifts and rotations of whole points lead to the same coordinates either way, scale does not.


class Constraint(NamedTuple):
    """Inner constraints Bᵀ(x − x₀) = 0."""

    normals: FloatArray
    """(u, d) B."""
    mask: BoolArray
    """(u,) components that carry the datum."""


@dataclass(frozen=True)
class STransformation:
    """S = I − G H Bᵀ with H = (BᵀG)⁻¹, applied to a minimal-datum solution and to its cofactors."""

    null: FloatArray
    """(u, d) G."""
    binding: FloatArray
    """(d, d) H."""
    through: FloatArray
    """(u, d) U = Q B of the minimal datum."""
    core: FloatArray
    """(d, d) BᵀQB."""

    @cached_property
    def _bound(self) -> FloatArray:
        return self.null @ self.binding

    def correction(self, one: IntArray, other: IntArray) -> FloatArray:
        """Return the part that S Q Sᵀ adds to the cofactors Q of the unknowns one (…, k) and other (…, l): (…, k, l).

        Negative numbers stand for fixed components and yield zeros.
        """
        g, u = _rows(self._bound, one), _rows(self.through, one)
        h, w = _rows(self._bound, other), _rows(self.through, other)
        return _outer(g @ self.core, h) - _outer(g, w) - _outer(u, h)


def datum_mask(datum: DatumDefinition, index: Index) -> BoolArray:
    """(u,) the unknowns that carry the datum."""
    mask = np.zeros(index.count, dtype=bool)
    for kind, chosen in datum.mask.items():
        columns = index.columns[kind][chosen]
        mask[columns[columns >= 0]] = True
    return mask


def constraint(null: FloatArray, problem: Problem, values: Values) -> Constraint:
    """Inner constraints over the components that carry the datum, for movements (u, d) of the network at ``values``.

    Where the datum names coordinates to take the movements at, points are displaced by the same similarity there.
    """
    mask = datum_mask(problem.datum, problem.index)
    normals = np.where(mask[:, None], null, 0.0)
    chosen = problem.datum.mask.get("point")
    elsewhere = problem.datum.movements
    if chosen is None or elsewhere is None or null.shape[1] == 0:
        return Constraint(normals, mask)
    columns = problem.index.columns["point"]
    free = columns >= 0
    centre = values["point"][free.any(axis=1)].mean(axis=0)
    now = similarities(values["point"], centre)[free]
    movement = np.linalg.lstsq(now, null[columns[free]], rcond=1e-12)[0]
    used = free & chosen
    normals[columns[used]] = similarities(elsewhere["point"], centre)[used] @ movement
    return Constraint(normals, mask)


def corrections(datum: DatumDefinition, index: Index, values: Values) -> FloatArray:
    """(u,) total corrections x − x₀ of the masked unknowns, zero elsewhere."""
    total = np.zeros(index.count)
    for kind, chosen in datum.mask.items():
        columns = index.columns[kind]
        used = chosen & (columns >= 0)
        total[columns[used]] = (values[kind] - datum.reference[kind])[used]
    return total


def binds(null: FloatArray, constraint: Constraint, index: Index) -> bool:
    """Return True if the constraint determines every movement (u, d) of the network.

    The movements are made orthonormal on the points of the datum first. So the answer depends neither on the unit of
    length, nor on how the movements are combined, nor on how far away other points are.
    """
    if null.shape[1] == 0:
        return True
    columns = index.columns["point"]
    carries = ((columns >= 0) & constraint.mask[columns]).any(axis=1)
    own = columns[carries]
    triangle: FloatArray = np.asarray(np.linalg.qr(null[own[own >= 0]], mode="r"))
    spread = np.linalg.svd(triangle, compute_uv=False)
    # The smallest movement on the points of the datum is more than round-off of the largest one.
    if triangle.shape[0] < triangle.shape[1] or not spread[-1] > 1e-12 * spread[0]:
        return False
    normals, movements = (np.linalg.solve(triangle.T, matrix.T).T for matrix in (constraint.normals, null))
    size = float(np.linalg.norm(normals, axis=0).max())
    return bool(size > 0.0 and np.linalg.svd(normals.T @ movements, compute_uv=False)[-1] > 1e-9 * size)


def into_datum(
    step: FloatArray, null: FloatArray, constraint: Constraint, problem: Problem, values: Values
) -> tuple[FloatArray, float]:
    """Step (u,) from ``values`` moved along the null directions so that the total corrections satisfy the constraint.

    With it by how much more an error of the step moves it there than BᵀG says. B changes with the movements t: the
    derivative of Bᵀ(x − x₀) by them is BᵀG + K. Where x₀ is bad K is not small, and a network that is moved without it
    swings into its datum slowly, or for ever. The step is NaN if the constraint does not bind the movements here.
    """
    total = corrections(problem.datum, problem.index, values) + np.where(constraint.mask, step, 0.0)
    missing, across = constraint.normals.T @ total, constraint.normals.T @ null
    movement: FloatArray = rotations.solve(across, missing)
    gain = 1.0
    if not np.isfinite(movement).all():
        return np.full(len(step), np.nan), gain
    bent = _bent(null, problem, values, total)
    if bent is not None:
        relative = rotations.solve(across, bent.derivative) + np.eye(len(across))
        least = float(np.abs(rotations.eigvals(relative)).min())
        settles = least > np.finfo(float).eps * float(np.linalg.norm(relative))
        better = rotations.solve(relative, movement) if settles else movement
        # Up to 0.1 (radians, or part of the scale) a movement is told by its first two derivatives.
        if float(np.abs(bent.turns @ better).max(initial=0.0)) < 0.1:
            movement, gain = better, max(1.0, 1.0 / least) if settles else 1.0
    turned: FloatArray = step - null @ movement
    return turned, gain


class _MovementChange(NamedTuple):
    """Change of the movements with a step of the network."""

    derivative: FloatArray
    """(d, d) K."""
    turns: FloatArray
    """(4, d) turns and scale in each movement."""


def _bent(null: FloatArray, problem: Problem, values: Values, total: FloatArray) -> _MovementChange | None:
    """K of the movements at ``values``; ``None`` where it is nothing beside BᵀG or no number, or B stays as it is."""
    chosen = problem.datum.mask.get("point")
    if chosen is None or problem.datum.movements is not None or null.shape[1] == 0:
        return None
    columns, points = problem.index.columns["point"], values["point"]
    used = chosen & (columns >= 0)
    within = used.any(axis=1)
    if not within.any():
        return None
    centre = points[within].mean(axis=0)
    size = float(np.median(np.abs(points[within] - centre)))  # a far point says nothing of the size of the rest
    # Movements stay the same on the way into the datum while corrections are small beside the network.
    if float(np.abs(total).max(initial=0.0)) < 1e-2 * size:
        return None
    fields = similarities(points[within], centre)
    movements = np.asarray(np.linalg.lstsq(fields[used[within]], null[columns[used]], rcond=1e-12)[0], float)
    apart = np.zeros((len(fields), 3))
    apart[used[within]] = total[columns[used]]
    linear = similarities(np.eye(3), np.zeros(3))[:, :, 3:]
    with np.errstate(over="ignore", invalid="ignore"):
        by_field = np.einsum("na,nbg->abg", apart, fields) @ movements
        derivative = np.einsum("bag,abj,gk->kj", linear, by_field, movements[3:])
    return _MovementChange(derivative, movements[3:]) if np.isfinite(derivative).all() else None


def s_transformation(null: FloatArray, constraint: Constraint, through: FloatArray) -> STransformation:
    """S-transformation from the minimal datum with U = Q B (u, d) into the datum of the constraint."""
    binding = np.asarray(np.linalg.inv(constraint.normals.T @ null), dtype=np.float64)
    return STransformation(null, binding, through, constraint.normals.T @ through)


def _rows(matrix: FloatArray, columns: IntArray) -> FloatArray:
    return np.where((columns >= 0)[..., None], matrix[columns], 0.0)


def _outer(one: FloatArray, other: FloatArray) -> FloatArray:
    return one @ np.swapaxes(other, -1, -2)


# ---- Turns of the whole network that the observations determine, but hardly.
#
# Tilts observed as ω and φ are angles about axes of the object. Where a free network is turned about its
# plumb line by θ, they change by θ times themselves; tilts of the size of their σ so determine the turn with
# a σ of a radian. That is neither null nor an answer: coordinates turned by it stand as far from the
# reference as chance wants.

NOTHING_KNOWN = float(np.pi / np.sqrt(3.0))
"""σ (rad) of an angle of which nothing is known: of one evenly spread over the circle."""


class WeakTurn(NamedTuple):
    """A turn of the whole network."""

    axis: FloatArray
    """(3,) unit vector."""
    sigma: float
    """Standard deviation (rad, for σ0 = 1)."""


def weak_turns(weak: FloatArray, problem: Problem, values: Values) -> tuple[WeakTurn, ...]:
    """Weak directions (u, w), scaled to one σ, that turn the whole network, the weakest first."""
    if weak.shape[1] == 0:
        return ()
    used, _ = network_components(problem, values)
    if not used.any():
        return ()
    columns = problem.index.columns["point"][used]
    centre = values["point"][used.any(axis=1)].mean(axis=0)
    generators = similarities(values["point"], centre)[used]
    lengths = np.linalg.norm(generators, axis=0)
    lengths[lengths == 0.0] = 1.0
    turns, point = [], np.nonzero(used)[0]
    for direction in weak[columns].T:
        movement = np.linalg.lstsq(generators / lengths, direction, rcond=1e-9)[0] / lengths
        moved = generators @ movement
        rest, whole = (np.sqrt(np.bincount(point, one**2)) for one in (direction - moved, moved))
        # Of each point by itself: a far one that moves alone outweighs all others that do not. A hundredth of a
        # direction may be other than a movement of the whole network.
        rigid = float(np.mean((rest <= 1e-2 * whole)[np.unique(point)])) > 0.5
        size = float(np.linalg.norm(movement[3:6]))
        if size > 0.0 and rigid:
            turns.append(WeakTurn(movement[3:6] / size, size))
    return tuple(sorted(turns, key=lambda turn: -turn.sigma))
