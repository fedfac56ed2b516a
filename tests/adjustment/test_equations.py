"""Equations of small projects: rows of a type together, evaluated once at the same values, as they are one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mor.linalg import compilation
from mor.model.contract import some_rows
from mor.model.parameters import move
from mor.solve.normals import build_normals, eliminable_rays, make_plan
from mor.solve.problem import Equations, evaluated
from tests.scenarios.path_scenes import path_scene
from tests.scenarios.scenes import mixed_network

SMALL, LARGE = compilation.WORTH_COMPILING - 1, compilation.WORTH_COMPILING


def counted(groups):
    """The groups with equations that note how many rows they are asked for, and the notes."""
    asked = []

    def of(type_):
        def equation(blocks, constants):
            asked.append((type_.key, len(constants)))
            return type_.equation(blocks, constants)

        return type_._replace(equation=equation)

    types = {id(group.type): of(group.type) for group in groups}
    return tuple(replace(group, type=types[id(group.type)]) for group in groups), asked


def halves(group):
    """A group in two, row about row."""
    return [some_rows(group, np.arange(k, group.count, 2)) for k in range(2)]


@pytest.mark.parametrize("scene", [path_scene("cubic paths, all free"), mixed_network()[0]], ids=["paths", "mixed"])
def test_rows_of_a_type_together_are_what_they_are_group_by_group(scene):
    groups = [half for group in scene.problem().groups for half in halves(group)]
    groups, asked = counted(groups)
    values, equations = scene.start(0.02), Equations(groups)
    with compilation.chosen_by_size(SMALL):
        for number, group in enumerate(groups):
            rows = np.flatnonzero(group.mask.any(axis=1))[::-2]
            found, alone = equations.computed(number, values, rows), evaluated(group, values, rows)
            for one, other in zip((found.values, *found.jacobians), (alone.values, *alone.jacobians), strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(other).max(initial=0.0))
            np.testing.assert_array_equal(equations.computed_values(number, values, rows), found.values)
    for key in {group.type.key for group in groups}:  # once for all, and then group by group
        alike = [group for group in groups if group.type.key == key]
        rows = [number for other, number in asked if other == key]
        assert rows[0] == sum(np.count_nonzero(group.mask.any(axis=1)) for group in alike)
        assert len(rows) == 1 + len(alike)


def test_derivatives_are_worked_out_once_at_the_same_values_and_anew_at_others():
    scene = path_scene("lines of a scanner")
    groups, asked = counted(scene.problem().groups)
    problem, values = replace(scene.problem(), groups=groups), scene.start(0.02)
    with compilation.chosen_by_size(SMALL):
        plan = make_plan(problem, eliminable_rays(problem, values))
        first = build_normals(plan, values)
        again = build_normals(plan, {**values})
        types = len({group.type.key for group in groups})
        assert len(asked) == types
        elsewhere = move(problem.index, values, np.full(problem.index.count, 1e-4))
        moved = build_normals(plan, elsewhere)
        build_normals(plan, {**elsewhere, "point": values["point"]})
        assert len(asked) == 3 * types
    np.testing.assert_array_equal(again.rhs, first.rhs)
    anew = make_plan(replace(problem, groups=scene.problem().groups), plan.rays)
    with compilation.chosen_by_size(SMALL):
        np.testing.assert_array_equal(moved.rhs, build_normals(anew, elsewhere).rhs)


def test_what_observes_nothing_is_evaluated_where_it_is_asked_for():
    scene = path_scene("lines of a scanner")
    group = next(group for group in scene.problem().groups if group.count > 3)
    observed = group.observed.copy()
    observed[1] = np.nan
    (one,), asked = counted([replace(group, observed=observed)])
    values, equations = scene.start(0.0), Equations((one,))
    with compilation.chosen_by_size(SMALL):
        equations.computed(0, values, np.array([0, 2]))
        assert asked == [(group.type.key, group.count - 1)]
        found = equations.computed_values(0, values, np.array([0, 1]))
    np.testing.assert_array_equal(found, evaluated(group, values, np.array([0, 1])).values)


def test_a_large_project_evaluates_what_it_is_asked_for():
    scene = path_scene("lines of a scanner")
    groups, asked = counted(scene.problem().groups)
    with compilation.chosen_by_size(LARGE):
        Equations(groups).computed(0, scene.start(0.0), np.array([2, 0]))
    assert [rows for _, rows in asked] == [2]


@pytest.mark.parametrize("size", [SMALL, LARGE])
def test_rows_of_several_groups_are_those_of_each(size):
    scene = mixed_network()[0]
    groups = [half for group in scene.problem().groups for half in halves(group)]
    counted_groups, asked = counted(groups)
    values, numbers = scene.start(0.02), list(range(len(groups)))[::-1]
    rows = [np.flatnonzero(groups[number].mask.any(axis=1))[number % 2 :: 2] for number in numbers]
    with compilation.chosen_by_size(size):
        found = Equations(counted_groups).of_several(numbers, values, rows)
        without = Equations(groups).of_several(numbers, values, rows, derivatives=False)
    assert len(asked) == len({group.type.key for group in groups})
    for number, own, several, bare in zip(numbers, rows, found, without, strict=True):
        alone = evaluated(groups[number], values, own)
        for one, other in zip((several.values, *several.jacobians), (alone.values, *alone.jacobians), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * np.abs(other).max(initial=0.0))
        np.testing.assert_array_equal(bare.values, several.values)
