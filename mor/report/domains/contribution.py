"""What a domain adds to ``results.json``: rows of its own, and sums over what it has in common with others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from mor.adjustment.datum.defect import network_components
from mor.quality.assess import Quality
from mor.quality.reliability.reliability_map import Controlled, uncontrolled_count
from mor.quality.solved import Solved
from mor.quality.tests.fixed_coordinates import fixed_point_tests
from mor.quality.tests.group_tests import Summed, exact_moments, summed_groups, undecided
from mor.quality.tests.levels import sidak
from mor.quality.tests.quadratic_form import Moments
from mor.report.parameters import other_rows
from mor.report.results.json import image_interiors
from mor.report.results.summary import statistics
from mor.report.tables.checks import check_rows
from mor.report.tables.estimates import (
    group_table,
    interior_rows,
    station_table,
    system_table,
    variance_components,
)
from mor.report.tables.features import feature_table
from mor.report.tables.reliability import fixed_point_rows, gross_errors, robust_shift, taken_out_rows
from mor.report.verdict.reliability_map import (
    KINDS,
    MOST,
    barely_determined,
    reliability_rows,
    thing_rows,
    unknown_coordinates,
)

Key = tuple[str, str, str]
"""What is tested, its name and, of a table, the type of its observations."""


class Shared(NamedTuple):
    """A thing that several domains have observations of."""

    row: dict[str, Any]
    unknown: int
    """Its unknown coordinates; −1 of images."""


class Test(NamedTuple):
    """The part of a domain in the test of a group."""

    key: Key
    summed: Summed
    moments: Moments | None
    """Where sums do not decide; they hold where no other domain has observations of the group."""


class Shift(NamedTuple):
    """Movements of points: how many coordinates, the sum of their squares, and the largest."""

    coordinates: int = 0
    squares: float = 0.0
    largest: float = 0.0


class Contribution(NamedTuple):
    """Rows as they stand in ``results.json``, of the observations of a domain."""

    statistics: dict[str, Any]
    groups: list[dict[str, Any]]
    variance_components: dict[str, Any] | None
    cameras: list[dict[str, Any]]
    stations: list[dict[str, Any]]
    systems: list[dict[str, Any]]
    features: list[dict[str, Any]]
    others: list[dict[str, Any]]
    checks: list[dict[str, Any]]
    interiors: dict[str, dict[str, Any]]
    """Of images that have one of their own."""
    gross_errors: dict[str, Any]
    taken_out: list[tuple[str, dict[str, Any]]]
    """By data snooping: everything that it took an observation of, and what others have, too."""
    reliability: dict[str, Any] | None
    shared: dict[str, list[Shared]]
    """By ``points``, ``images``."""
    fixed_points: list[dict[str, Any]]
    fixed: int
    """Fixed coordinates that the domain counts."""
    tests_of_fixed: int
    """Degrees of freedom of the tests of those that no other domain observes."""
    fixed_in_several: int
    """Fixed points that other domains have, too: no single domain can test them."""
    tests: list[Test]
    shift: Shift
    """Of its points, from least squares to the robust solution."""
    steps: tuple[int, ...] = ()
    """Numbers of its steps of data snooping among those of all domains."""


def contribution(
    solved: Solved, shared: dict[str, frozenset[str]], foreign: frozenset[str], domain: int, images: int
) -> Contribution:
    """What a domain adds. ``shared`` names its points and images that others have, too, by ``point``, ``image``.

    ``foreign`` are points that another domain counts; ``images`` is the number of all images, which says about how many
    groups will be tested.
    """
    quality = solved.quality
    assert quality is not None
    fixed = _fixed(solved)
    counted = {name: count for name, count in fixed.items() if name not in foreign}
    ids = solved.network.blocks["point"].ids
    tests = [test for test in fixed_point_tests(quality) if ids[test.point] not in shared["point"]]
    return Contribution(
        statistics={**statistics(solved), "uncontrolled": uncontrolled_count(quality)},
        groups=group_table(solved).to_dicts(),
        variance_components=variance_components(solved),
        cameras=interior_rows(solved),
        stations=station_table(solved).to_dicts(),
        systems=system_table(solved).to_dicts(),
        features=feature_table(solved).to_dicts(),
        others=[row for row in other_rows(solved) if not row["kind"].startswith("interior/")],
        checks=check_rows(solved),
        interiors=image_interiors(solved),
        gross_errors=gross_errors(solved),
        taken_out=taken_out_rows(solved, _blocks_of_several(shared)),
        **_reliability(solved, shared),
        fixed_points=[row for row in fixed_point_rows(solved) if row["id"] not in shared["point"]],
        fixed=sum(counted.values()),
        tests_of_fixed=sum(test.freedom for test in tests),
        fixed_in_several=sum(name in shared["point"] for name in counted),
        tests=_tests(solved, quality, domain, images),
        shift=_shift(solved, foreign),
    )


def _blocks_of_several(shared: dict[str, frozenset[str]]) -> set[tuple[str, str]]:
    """Kind and name of the blocks that are counted as points and images that others have, too."""
    points = {("point", name) for name in shared["point"]}
    return points | {("rotation", f"image {name}") for name in shared["image"]}


def _shift(solved: Solved, foreign: frozenset[str]) -> Shift:
    shift = robust_shift(solved)
    if not shift.size:
        return Shift()
    own = shift[[name not in foreign for name in solved.network.things["point"].ids]]
    return Shift(own.size, float(np.sum(own**2)), float(np.abs(own).max(initial=0.0)))


def _fixed(solved: Solved) -> dict[str, int]:
    """Points with fixed coordinates, and how many."""
    _, fixed = network_components(solved.adjustment.problem, solved.adjustment.values)
    ids = solved.network.blocks["point"].ids
    return {ids[k]: int(fixed[k].sum()) for k in np.flatnonzero(fixed.any(axis=1))}


def _tests(solved: Solved, quality: Quality, domain: int, images: int) -> list[Test]:
    """Sums over what is tested; moments where they do not decide at the level the tests will about have."""
    summed = summed_groups(quality, solved.network, domain)
    open_ = undecided(summed, quality.redundancy, sidak(quality.levels.overall, max(images, 1)))
    groups = solved.adjustment.problem.groups
    return [
        Test(
            (one.of, one.name, groups[one.number].type.name if one.of == "group" else ""),
            one,
            exact_moments(quality, solved.network, one) if open_[k] and one.of != "group" else None,
        )
        for k, one in enumerate(summed)
    ]


def _reliability(solved: Solved, shared: dict[str, frozenset[str]]) -> dict[str, Any]:
    """The map of what this domain alone observes, and the rows of what others observe, too."""
    rows = reliability_rows(solved)
    if rows is None:
        return {"reliability": None, "shared": {}}
    found = {one.of: one for one in solved.reliability_map}
    both: dict[str, list[Shared]] = {}
    rows = dict(rows)
    for of, names in shared.items():
        if of in found:
            both[KINDS[of]] = _of_shared(solved, found[of], names)
            rows[KINDS[of]] = [row for row in _weakest(solved, found[of]) if row["id"] not in names]
    points = found["point"]
    own = np.array([name not in shared["point"] for name in points.names], dtype=bool)
    barely = barely_determined(unknown_coordinates(solved), points.observations)
    rows["points_barely_determined"] = int(np.count_nonzero(barely & own))
    return {"reliability": rows, "shared": both}


def _weakest(solved: Solved, one: Controlled) -> Iterable[dict[str, Any]]:
    return thing_rows(solved, one, one.worst(MOST))


def _of_shared(solved: Solved, one: Controlled, names: frozenset[str]) -> list[Shared]:
    number = {name: k for k, name in enumerate(one.names)}
    chosen = [number[name] for name in sorted(names) if name in number]
    seen = np.array([k for k in chosen if np.isfinite(one.smallest_r[k])], dtype=np.int64)
    unknown = unknown_coordinates(solved) if one.of == "point" else np.full(len(one.names), -1)
    return [
        Shared(row, int(unknown[k]))
        for k, row in zip(seen.tolist(), thing_rows(solved, one, seen), strict=True)
    ]
