"""A domain: a problem of which some unknowns are *outer*, for other domains have them, too.

Its points are eliminated on the fly, its other inner unknowns in fronts; what is left are normal equations in the outer
ones. Given the solution there, its own follows.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mor.adjustment.inverse import Inverse
from mor.adjustment.normals import Normals, build_normals
from mor.adjustment.plan import Plan, make_plan
from mor.adjustment.problem import Problem
from mor.adjustment.rays.eliminable import eliminable_rays
from mor.adjustment.rays.plan import plan_rays
from mor.adjustment.rays.point_solutions import full_directions, full_step, reduce_right_hand_side
from mor.arrays import BoolArray, FloatArray, IntArray
from mor.parameters.index import Values
from mor.sparse.block_matrix import BlockMatrix
from mor.sparse.cholesky import Factor, completed, eliminate_inner
from mor.sparse.joining import Share
from mor.sparse.selected_inverse import selected_inverse
from mor.sparse.symbolic_factorisation import analyse_inner

Key = tuple[str, str, int]
"""Kind, name of the block and component of an unknown: what it is called in every domain."""


class Domain(NamedTuple):
    """A planned domain."""

    plan: Plan
    outer: IntArray
    """(s,) outer unknowns, in the order of the last front."""

    @property
    def problem(self) -> Problem:
        """What it adjusts."""
        return self.plan.problem

    def keys(self) -> list[Key]:
        """(s,) what the outer unknowns are called."""
        index = self.problem.index
        kinds, blocks, components = (
            array[self.outer] for array in (index.kind_of, index.block_of, index.component_of)
        )
        keys = [index.unknown_kind[kind] for kind in kinds.tolist()]
        return [
            (kind, index.blocks[kind].ids[block], component)
            for kind, block, component in zip(keys, blocks.tolist(), components.tolist(), strict=True)
        ]


def plan_domain(problem: Problem, start: Values, common: BoolArray) -> Domain:
    """Plan a domain whose unknowns ``common`` (u,) other domains have, too.

    Outer are all unknowns of the blocks in which there is one of them; where there is none, those of one block are.
    """
    rays = eliminable_rays(problem, start)
    if len(rays.columns) and (own := ~common[rays.columns].any(axis=1)).any() and not own.all():
        rays = plan_rays(problem, rays.points[own])
    elif len(rays.columns) and not own.any():
        rays = plan_rays(problem, rays.points[:0])
    plan = make_plan(problem, rays)
    structure = plan.target.structure
    outer = np.zeros(structure.blocks, dtype=bool)
    outer[plan.target.block_of[np.flatnonzero(common[plan.kept])]] = True
    if not outer.any():
        outer[-1:] = True
    plan = replace(plan, elimination=analyse_inner(structure, outer))
    elimination = plan.elimination
    return Domain(plan, plan.kept[elimination.permutation[elimination.pivot_pointers[-2] :]])


class Stage(NamedTuple):
    """A domain whose inner unknowns are eliminated at some values."""

    values: Values
    normals: Normals
    """Without its matrix."""
    damping: float
    factor: Factor
    """Without its last front, which is handed up."""
    scale: FloatArray
    """(n,) of the reduced unknowns; 1 of outer ones."""
    y: FloatArray
    """(n, 1) half of the solution: L⁻¹ of the right-hand side."""

    def vanished(self, domain: Domain) -> list[Key]:
        """Inner unknowns that nothing determines, even where all outer ones are known."""
        columns = domain.plan.kept[self.factor.set_aside]
        return Domain(domain.plan, columns).keys()


def eliminate(domain: Domain, values: Values, numbers: IntArray, damping: float = 0.0) -> tuple[Stage, Share]:
    """Linearise a domain and eliminate what is inside it; with it what it hands up.

    ``numbers`` (s,) are those of its outer unknowns.
    """
    plan = domain.plan
    normals = build_normals(plan, values, damping)
    last = plan.elimination.permutation[plan.elimination.pivot_pointers[-2] :]
    scale = 1.0 / np.sqrt(np.where(normals.diagonal > 0.0, normals.diagonal, 1.0))
    scale[last] = 1.0
    factor = eliminate_inner(normals.matrix.scaled(scale), plan.elimination)
    y, left = factor.reduce((scale * normals.reduced_rhs)[:, None])
    share = Share(numbers, factor.pivots[-1], left, normals.diagonal[last])
    nothing = BlockMatrix(plan.target.structure, np.zeros(0))
    inner = replace(factor, pivots=factor.pivots[:-1])
    return Stage(values, normals._replace(matrix=nothing), damping, inner, scale, y), share


def turned(domain: Domain, stage: Stage, values: Values) -> tuple[Stage, FloatArray]:
    """A stage at other values with the factor of this one, and its right-hand side left for outer unknowns (s, 1)."""
    normals = build_normals(domain.plan, values)
    y, left = stage.factor.reduce((stage.scale * normals.reduced_rhs)[:, None])
    kept = normals._replace(matrix=stage.normals.matrix)
    return stage._replace(values=values, normals=kept, y=y), left


def step_of(domain: Domain, stage: Stage, outer: FloatArray) -> FloatArray:
    """Step (u,) of all unknowns from that of the outer ones (s,)."""
    reduced = stage.scale * stage.factor.follow(stage.y, outer[:, None])[:, 0]
    return full_step(domain.plan, stage.values, reduced, stage.damping)


def directions_of(domain: Domain, stage: Stage, outer: FloatArray) -> FloatArray:
    """Directions (u, k) that follow those of the outer unknowns (s, k)."""
    none = np.zeros((len(stage.y), outer.shape[1]))
    reduced = stage.scale[:, None] * stage.factor.follow(none, outer)
    return full_directions(domain.plan, stage.values, reduced)


class Half(NamedTuple):
    """Further right-hand sides, half solved."""

    y: FloatArray
    alone: FloatArray
    """(p, 3, k) of the eliminated points, all else held."""


def reduce_side(domain: Domain, stage: Stage, rhs: FloatArray) -> tuple[Half, FloatArray]:
    """Half a solution of N x = rhs (u, k), and what is left for the outer unknowns (s, k)."""
    reduced, alone = reduce_right_hand_side(domain.plan, stage.values, rhs)
    y, left = stage.factor.reduce(stage.scale[:, None] * reduced)
    return Half(y, alone), left


def solve_side(domain: Domain, stage: Stage, half: Half, outer: FloatArray) -> FloatArray:
    """The whole solution (u, k), that of the outer unknowns (s, k) given."""
    reduced = stage.scale[:, None] * stage.factor.follow(half.y, outer)
    x = full_directions(domain.plan, stage.values, reduced)
    x[domain.plan.rays.columns] += half.alone
    return x


def inverse_of(domain: Domain, stage: Stage, null: FloatArray, outer: FloatArray) -> Inverse:
    """The solved system of the whole, seen from a domain: cofactors of its outer unknowns (s, s) given.

    It solves for right-hand sides that have nothing outside of the domain, such as those of its observations.
    """
    none = np.zeros((domain.problem.index.count, 0))
    return Inverse(domain.plan, stage.values, completed(stage.factor, outer), stage.scale, null, none)


def cofactors_of(stage: Stage, outer: FloatArray) -> BlockMatrix:
    """Cofactors of the reduced unknowns at the stored pattern, those of the outer unknowns (s, s) given."""
    return selected_inverse(stage.factor, last=outer).scaled(stage.scale)
