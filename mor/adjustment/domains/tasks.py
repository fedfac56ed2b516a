"""What is done in one domain at a time: each task loads what it needs, saves what it finds, and may be done again.

Arguments and results are of the size of the outer unknowns; everything longer stays in the store. ``stage`` names an
iteration; ``d`` is the number of the domain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mor.adjustment.convergence import round_off
from mor.adjustment.datum.defect import network_components, similarities
from mor.adjustment.datum.s_transformation import constraint, corrections, datum_mask
from mor.adjustment.domains.domain import (
    Domain,
    Key,
    Stage,
    directions_of,
    eliminate,
    reduce_side,
    solve_side,
    step_of,
    turned,
)
from mor.adjustment.domains.store import Store
from mor.adjustment.normals import image_of, normal_product
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.index import Values, move
from mor.sparse.joining import Share, join


class Handed(NamedTuple):
    """What a domain, or several together, hand up."""

    share: Share
    objective: float
    vanished: tuple[Key, ...] = ()
    """Unknowns inside that nothing determines."""


class Role(NamedTuple):
    """A domain among the others."""

    domain: Domain
    numbers: IntArray
    """(s,) numbers of its outer unknowns."""
    owned: BoolArray
    """(u,) unknowns that it counts: of those several have, the first one's."""


def role(store: Store, d: int) -> Role:
    """A domain and what it is among the others."""
    domain: Domain = store.load(f"domain/{d}")
    numbers, first = store.load(f"numbers/{d}")
    owned = np.ones(domain.problem.index.count, dtype=bool)
    owned[domain.outer] = first
    return Role(domain, numbers, owned)


def linearise(store: Store, d: int, stage: str, damping: float = 0.0, to: str = "") -> Handed:
    """Linearise and eliminate at the values of a stage; the result is kept as stage ``to``, or the same."""
    values = store.load(f"values/{stage}/{d}")
    if to:
        store.save(f"values/{to}/{d}", values)
    return _eliminated(store, d, role(store, d), values, damping, to or stage)


def _eliminated(store: Store, d: int, mine: Role, values: Values, damping: float, stage: str) -> Handed:
    found, share = eliminate(mine.domain, values, mine.numbers, damping)
    store.save(f"stage/{stage}/{d}", found)
    return Handed(share, found.normals.objective, tuple(found.vanished(mine.domain)))


def join_handed(store: Store, name: str, handed: list[Handed], complete: BoolArray) -> Handed:
    """Join what was handed up; the node is kept under its name."""
    node, share = join([one.share for one in handed], complete)
    store.save(f"node/{name}", node)
    nameless = tuple(("", str(number), 0) for number in node.vanished.tolist())
    vanished = tuple(key for one in handed for key in one.vanished)
    return Handed(share, sum(one.objective for one in handed), vanished + nameless)


class Followed(NamedTuple):
    """What the step of a domain adds to the sums of all."""

    gain: float
    """bᵀδ."""
    across: FloatArray
    """(d, d) BᵀG."""
    missing: FloatArray
    """(d,) Bᵀ of the total corrections after the step."""
    moving: float
    """Largest part of the step that the datum binds."""
    largest: float
    """Largest coordinate."""


def follow(store: Store, d: int, stage: str, outer: FloatArray, null: FloatArray) -> Followed:
    """The step from that of the outer unknowns (s,), and the null vectors from theirs (s, d); both are kept."""
    mine = role(store, d)
    domain, own = mine.domain, mine.owned
    problem, at = domain.problem, store.load(f"stage/{stage}/{d}")
    step = step_of(domain, at, outer)
    directions = directions_of(domain, at, null)
    store.save(f"step/{stage}/{d}", (step, directions))
    B = constraint(directions, problem, at.values)
    total = corrections(problem.datum, problem.index, at.values) + np.where(B.mask, step, 0.0)
    points = at.values.get("point", np.zeros((1, 3)))
    return Followed(
        float(step @ at.normals.rhs),
        B.normals[own].T @ directions[own],
        B.normals[own].T @ total[own],
        float(np.abs(step[B.mask]).max(initial=0.0)),
        float(np.abs(points).max(initial=0.0)),
    )


def round_off_of(store: Store, d: int, stage: str) -> float:
    """τ² of a domain, see :mod:`mor.adjustment.convergence`."""
    domain: Domain = store.load(f"domain/{d}")
    at: Stage = store.load(f"stage/{stage}/{d}")
    return round_off(domain.plan, at.values, at.normals, np.zeros((domain.problem.index.count, 0))) ** 2


def shifted(store: Store, d: int, stage: str, movement: FloatArray) -> tuple[float, int]:
    """Largest shift into the datum among the components that carry it, and its unknown."""
    mine = role(store, d)
    _, null = store.load(f"step/{stage}/{d}")
    mask = datum_mask(mine.domain.problem.datum, mine.domain.problem.index)
    size = np.where(mask & mine.owned, np.abs(null @ movement), 0.0)
    return float(size.max(initial=0.0)), int(np.argmax(size)) if len(size) else 0


def move_on(store: Store, d: int, stage: str, movement: FloatArray, to: str) -> None:
    """Values after the step and the movement into the datum (d,), kept as those of stage ``to``."""
    _moved(store, d, store.load(f"domain/{d}"), stage, movement, to)


def _moved(store: Store, d: int, domain: Domain, stage: str, movement: FloatArray, to: str) -> Values:
    step, null = store.load(f"step/{stage}/{d}")
    values = move(domain.problem.index, store.load(f"values/{stage}/{d}"), step - null @ movement)
    store.save(f"values/{to}/{d}", values)
    return values


def advance(store: Store, d: int, stage: str, movement: FloatArray, to: str) -> Handed:
    """Move on to the next stage and linearise there."""
    mine = role(store, d)
    return _eliminated(store, d, mine, _moved(store, d, mine.domain, stage, movement, to), 0.0, to)


class Turned(NamedTuple):
    """A new right-hand side of a domain."""

    objective: float
    left: FloatArray
    """(s, 1) for its outer unknowns."""


def turn(store: Store, d: int, stage: str, movement: FloatArray, to: str) -> Turned:
    """Move on to the next stage and work out its right-hand side alone: the factor stays that of the stage before."""
    domain: Domain = store.load(f"domain/{d}")
    values = _moved(store, d, domain, stage, movement, to)
    found, left = turned(domain, store.load(f"stage/{stage}/{d}"), values)
    store.save(f"stage/{to}/{d}", found)
    return Turned(found.normals.objective, left)


def null_image(store: Store, d: int, stage: str, outer: FloatArray, vectors: FloatArray) -> FloatArray:
    """GᵀNG (k, k) of the directions that follow those of the outer unknowns (s, k), combined by ``vectors`` (k, k)."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    directions = directions_of(mine.domain, at, outer) @ vectors
    return image_of(mine.domain.plan, at.values, directions)


class Triangles(NamedTuple):
    """R factors of what the directions do in a domain: scalar products of all are those of these, put together."""

    whole: FloatArray
    """Of all unknowns of the domain, (·, k)."""
    points: FloatArray
    """Of the components of points that observations name: directions and the seven similarities, (·, k + 7)."""
    free: int
    """Number of these components."""


def triangles(
    store: Store, d: int, stage: str, outer: FloatArray, centre: FloatArray, size: float
) -> Triangles:
    """What null directions do in a domain; similarities are taken about the centre, in units of the size."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    problem = mine.domain.problem
    directions = directions_of(mine.domain, at, outer)
    used, _ = network_components(problem, at.values)
    columns = problem.index.columns["point"]
    used &= np.where(columns >= 0, mine.owned[columns], False)
    moved = similarities((at.values["point"] - centre) / size, np.zeros(3))[used]
    both = np.concatenate([directions[columns[used]], moved], axis=1)
    return Triangles(
        np.asarray(np.linalg.qr(directions[mine.owned], mode="r")),
        np.asarray(np.linalg.qr(both, mode="r")),
        int(np.count_nonzero(used)),
    )


def extent(store: Store, d: int, stage: str) -> FloatArray:
    """(2, 3) least and largest coordinates of the points of a domain."""
    points = store.load(f"values/{stage}/{d}").get("point", np.zeros((0, 3)))
    return np.stack([points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)])


def keep_null(store: Store, d: int, stage: str, outer: FloatArray, combined: FloatArray) -> None:
    """Keep the null vectors that follow those of the outer unknowns (s, k), combined by (k, d)."""
    domain = store.load(f"domain/{d}")
    store.save(f"null/{d}", directions_of(domain, store.load(f"stage/{stage}/{d}"), outer) @ combined)


def reduce_product(store: Store, d: int, stage: str) -> FloatArray:
    """Half a solution of N x = N G for the null vectors that are kept; what is left for the outer unknowns (s, k)."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    product = normal_product(mine.domain.plan, at.values, store.load(f"null/{d}"))
    half, left = reduce_side(mine.domain, at, product)
    store.save(f"half/{d}", half)
    return left


class Bound(NamedTuple):
    """What a domain adds to the sums of the datum."""

    across: FloatArray
    """(d, d) BᵀG."""
    left: FloatArray
    """(s, d) of N x = B, for the outer unknowns."""


def refine_and_bind(store: Store, d: int, stage: str, outer: FloatArray) -> Bound:
    """Take the round-off out of the null vectors, what it is given at the outer unknowns (s, d); begin Q B."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    problem, own = mine.domain.problem, mine.owned
    null = store.load(f"null/{d}") - solve_side(mine.domain, at, store.load(f"half/{d}"), outer)
    B = constraint(null, problem, at.values)
    half, left = reduce_side(mine.domain, at, np.where(own[:, None], B.normals, 0.0))
    store.save(f"half of B/{d}", half)
    store.save(f"datum/{d}", (null, B))
    return Bound(B.normals[own].T @ null[own], left)


def carrying(store: Store, d: int) -> int:
    """Number of unknowns of a domain that carry the datum."""
    mine = role(store, d)
    problem = mine.domain.problem
    return int(np.count_nonzero(datum_mask(problem.datum, problem.index) & mine.owned))


def settled(store: Store, d: int, stage: str) -> None:
    """Keep that there is no null vector: the observations settle the datum."""
    domain: Domain = store.load(f"domain/{d}")
    none = np.zeros((domain.problem.index.count, 0))
    store.save(
        f"datum/{d}", (none, constraint(none, domain.problem, store.load(f"stage/{stage}/{d}").values))
    )
    store.save(f"through/{d}", none)


def through(store: Store, d: int, stage: str, outer: FloatArray) -> FloatArray:
    """BᵀQB (d, d) of a domain, Q B at the outer unknowns (s, d) given; Q B is kept."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    found = solve_side(mine.domain, at, store.load(f"half of B/{d}"), outer)
    _, B = store.load(f"datum/{d}")
    store.save(f"through/{d}", found)
    return np.asarray(B.normals[mine.owned].T @ found[mine.owned])


def rows_of_datum(
    store: Store, d: int, stage: str, unknown: int, null: FloatArray, across: FloatArray
) -> FloatArray:
    """Begin N x = (row of S, unit vector) of an unknown of this domain or, where it is −1, of another one."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    _, directions = store.load(f"step/{stage}/{d}")
    B = constraint(directions, mine.domain.problem, at.values)
    unit = np.zeros(len(directions))
    if unknown >= 0:
        unit[unknown] = 1.0
    row = unit - np.where(mine.owned, B.normals @ np.linalg.solve(across, null), 0.0)
    rhs = np.stack([row, unit], axis=1)
    half, left = reduce_side(mine.domain, at, rhs)
    store.save(f"half of rows/{d}", (half, rhs))
    return left


def variances_of_datum(store: Store, d: int, stage: str, outer: FloatArray) -> FloatArray:
    """(2,) parts of sᵀQs and Q_ii, the solution at the outer unknowns (s, 2) given."""
    mine = role(store, d)
    at: Stage = store.load(f"stage/{stage}/{d}")
    half, rhs = store.load(f"half of rows/{d}")
    return np.asarray(np.einsum("uk,uk->k", rhs, solve_side(mine.domain, at, half, outer)))


def null_of(store: Store, d: int, stage: str, unknown: int) -> FloatArray:
    """(d,) the null vectors at an unknown."""
    return np.asarray(store.load(f"step/{stage}/{d}")[1][unknown])
