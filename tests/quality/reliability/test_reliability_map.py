"""The reliability map: bounds against brute force, further observations against adjusting with them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mor.model.contract import ObservationGroup
from mor.quality.assessment import Quality, assess
from mor.quality.external_reliability import ObservationComponent, carried_points, point_movements
from mor.quality.redundancy import OF_IMAGES
from mor.quality.reliability_map import (
    CandidateObservation,
    _table,
    aimed_at,
    best_further,
    detectable,
    uncontrolled,
)
from mor.quality.solution import Solved
from mor.solve.iterate import adjust
from mor.solve.problem import Problem, misclosures
from sample_projects.expected import solve_sample
from tests.dense_reference import dense_system
from tests.selection import slow_after

NAMES = ("bridge", "stereo_rig", "building")
each = pytest.mark.parametrize("name", NAMES)


@cache
def solved_sample(name: str) -> Solved:
    return solve_sample(name)


def quality_of(name: str) -> Quality:
    quality = solved_sample(name).quality
    assert quality is not None
    return quality


def entries_of(quality: Quality, limit: float) -> list[ObservationComponent]:
    """Observations with r below a limit."""
    return [
        ObservationComponent(number, int(row), int(component))
        for number, one in enumerate(quality.groups)
        for row, component in np.argwhere(np.nan_to_num(one.r, nan=1.0) < limit)
    ]


def targets(quality: Quality, entry: ObservationComponent) -> list[int]:
    group = quality.adjustment.problem.groups[entry.group]
    return [
        int(blocks[entry.row])
        for slot, blocks in zip(group.type.slots, group.blocks, strict=True)
        if slot.kind == "point" and slot.of not in ("image", "station", "system")
    ]


def with_row(problem: Problem, values: object, further: CandidateObservation) -> Problem:
    """The problem with the further observation, its value that of the solution: residuals change only through it."""
    group = problem.groups[further.group]
    rows = np.array([further.row])
    target = further.target
    if target < 0:
        more = replace(aimed_at(group, rows, 0), blocks=tuple(blocks[rows] for blocks in group.blocks))
    else:
        more = aimed_at(group, rows, target)
    more = replace(more, observed=-misclosures(more, values))  # type: ignore[arg-type]
    groups = list(problem.groups)
    groups[further.group] = joined(group, more)
    return replace(problem, groups=tuple(groups))


def joined(group: ObservationGroup, more: ObservationGroup) -> ObservationGroup:
    names = tuple(
        replace(own, numbers=np.concatenate([own.numbers, other.numbers]))
        for own, other in zip(group.references, more.references, strict=True)
    )
    return replace(
        group,
        blocks=tuple(np.concatenate(pair) for pair in zip(group.blocks, more.blocks, strict=True)),
        observed=np.concatenate([group.observed, more.observed]),
        sigma=np.concatenate([group.sigma, more.sigma]),
        constants=np.concatenate([group.constants, more.constants]),
        references=names,
        lines=np.concatenate([group.lines, more.lines]) if len(group.lines) else group.lines,
    )


@pytest.mark.parametrize("name", slow_after(2, NAMES))
def test_a_further_observation_controls_as_much_as_adjusting_with_it_says(name: str) -> None:
    quality = quality_of(name)
    adjustment = quality.adjustment
    entries = entries_of(quality, 0.05)[:4]
    wanted = [(entry, targets(quality, entry)) for entry in entries]
    for entry, found in zip(entries, best_further(quality, wanted), strict=True):
        again = adjust(with_row(adjustment.problem, adjustment.values, found), adjustment.values)
        r = assess(again).groups[entry.group].r[entry.row, entry.component]
        assert found.r == pytest.approx(r, rel=2e-3)
        assert found.r > quality.groups[entry.group].r[entry.row, entry.component]


def test_the_best_further_observation_is_the_best_of_all() -> None:
    quality = quality_of("bridge")
    adjustment, problem = quality.adjustment, quality.adjustment.problem
    entry = next(
        e for e in entries_of(quality, 0.01) if best_further(quality, [(e, targets(quality, e))])[0].target >= 0
    )
    (best,) = best_further(quality, [(entry, targets(quality, entry))])
    (target,) = targets(quality, entry)
    group = problem.groups[entry.group]
    stations = {group.references[0][row]: row for row in range(group.count)}
    sees = {group.references[0][row] for row in range(group.count) if group.blocks[3][row] == target}
    tried = []
    for station, row in stations.items():
        if station not in sees and group.blocks[0][row] != target:
            one = CandidateObservation(entry.group, row, target, 0.0)
            quality_then = assess(adjust(with_row(problem, adjustment.values, one), adjustment.values))
            tried.append(float(quality_then.groups[entry.group].r[entry.row, entry.component]))
    assert tried
    assert best.r >= max(tried) - 1e-4


@each
def test_no_undetected_error_moves_a_point_further_than_the_map_says(name: str) -> None:
    solved, quality = solved_sample(name), quality_of(name)
    points, *_ = solved.reliability_map
    blocks = solved.network.things["point"].parts["position"]
    place = {int(block): k for k, block in enumerate(blocks)}
    random, tight = np.random.default_rng(2), 0.0
    for number, group in enumerate(quality.adjustment.problem.groups):
        rows, components = np.nonzero(np.nan_to_num(quality.groups[number].r) > 1e-4)
        for k in random.permutation(len(rows))[:25]:
            entry = ObservationComponent(number, int(rows[k]), int(components[k]))
            seen = [b for b in targets(quality, entry) if b in place]
            if not seen:
                continue
            nabla = detectable(quality, np.array([entry]))
            moved = np.linalg.norm(point_movements(quality, [entry], nabla, [seen])[0], axis=1)
            bound = np.array([points.shift[place[b]] for b in seen])
            assert (moved <= bound * (1 + 1e-6) + 1e-12).all(), (group.name, entry)
            tight = max(tight, float(np.max(moved / np.maximum(bound, 1e-300))))
    assert tight > 0.5  # a bound that says something


@each
def test_the_map_has_the_smallest_redundancy_number_of_each_point(name: str) -> None:
    solved, quality = solved_sample(name), quality_of(name)
    points, *frames = solved.reliability_map
    assert {one.of for one in frames} <= {"image", "station", "set"}
    blocks = solved.network.things["point"].parts["position"]
    for k in range(0, len(blocks), 7):
        own = [
            quality.groups[number].r[row]
            for number, group in enumerate(quality.adjustment.problem.groups)
            for row in range(group.count)
            if blocks[k] in targets(quality, ObservationComponent(number, row, 0))
        ]
        if own:
            assert points.smallest_r[k] == pytest.approx(np.nanmin(np.concatenate(own)), abs=1e-12)
            assert points.observations[k] == np.isfinite(np.concatenate(own)).sum()


def test_points_are_carried_by_more_than_half_of_their_variance() -> None:
    quality = quality_of("building")
    adjustment = quality.adjustment
    entries = entries_of(quality, 0.01)
    assert len(entries) == sum(uncontrolled(quality, k).sum() for k in range(len(quality.groups)))
    dense = dense_system(adjustment.problem, adjustment.values)
    Q = np.linalg.inv(dense.normal)
    numbers = {int(number): k for k, number in enumerate(dense.entries)}
    columns = adjustment.problem.index.columns["point"]
    for entry, carried in zip(entries, carried_points(quality, entries), strict=True):
        group = adjustment.problem.groups[entry.group]
        place = adjustment.problem.offsets[entry.group] + entry.row * group.observed.shape[1]
        k = numbers[int(place + entry.component)]
        x = Q @ dense.A[k] / np.sqrt(dense.covariance[k, k])
        found = []
        for block, own in enumerate(columns):
            free = own[own >= 0]
            if len(free) and x[free] @ np.linalg.solve(Q[np.ix_(free, free)], x[free]) > 0.5:
                found.append(block)
        assert set(found) == set(carried.tolist())


def test_each_place_is_represented_by_its_most_complete_row() -> None:
    problem, random = solved_sample("stereo_rig").adjustment.problem, np.random.default_rng(7)
    checked = 0
    for number, group in enumerate(problem.groups):
        if group.type.key not in OF_IMAGES:
            continue
        observed = np.where(random.random(group.observed.shape) < 0.4, np.nan, group.observed)
        group = replace(group, observed=observed, excluded=random.random(observed.shape) < 0.2)
        table, place = _table(number, group), group.references[0].numbers
        for target in np.unique(group.blocks[-1])[:20].tolist():
            seen = set(place[(group.blocks[-1] == target) & group.used.any(axis=1)].tolist())
            best: dict[int, int] = {}
            for row in np.flatnonzero(group.used.any(axis=1)).tolist():
                own = int(place[row])
                if own not in best or group.mask[row].sum() > group.mask[best[own]].sum():
                    best[own] = row
            assert table.places_without(target).tolist() == sorted(best[own] for own in best.keys() - seen)
            checked += len(best.keys() - seen)
    assert checked
