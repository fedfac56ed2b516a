"""``results.json`` of an adjustment in domains: the keys it has on one machine, from what the domains add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import polars as pl

from mor.compilation import are_loaded
from mor.errors import Problem
from mor.project.domains.parts import group_names
from mor.project.file.model import Project
from mor.project.network.build import datum_name
from mor.quality.assess import Whole
from mor.quality.tests.group_tests import TestedWhole
from mor.quality.tests.test_statistics import global_test
from mor.quality.verdict import Verdict, only_chosen_of
from mor.report.domains.contribution import Contribution
from mor.report.domains.joined_rows import (
    check_rows,
    distinct,
    gross_errors,
    group_rows,
    points_in_several,
    reliability,
    tests_of_groups,
)
from mor.report.results.json import with_interiors
from mor.report.results.summary import NO_STATISTICS, Ended, summary_of
from mor.report.verdict.group_tests import rows_of_verdict


class Inlined(NamedTuple):
    """Tables that are short enough to stand in ``results.json``; ``None`` where they are not."""

    points: pl.DataFrame | None = None
    images: pl.DataFrame | None = None
    residuals: pl.DataFrame | None = None


def results_of_domains(
    project: Project,
    ended: Ended,
    whole: Whole | None,
    parts: Sequence[Contribution],
    inlined: Inlined,
    tables: Mapping[str, str],
    said: Mapping[str, Any],
    order: Sequence[str],
    loose: Sequence[str] = (),
    fixed: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Content of ``results.json``; ``said`` are identity and notes, ``loose`` unknowns that nothing determines.

    ``fixed`` are the tests of fixed points that several domains observe.

    ``order`` are the names of the images as the project has them.
    """
    undetermined = [{"unknowns": [name], "amounts": [1.0]} for name in loose]
    if whole is None:
        head = summary_of(project, ended, undetermined, [], NO_STATISTICS)
        return _ordered({**head, **said, **_NOTHING, "tables": dict(tables), "files": []})
    flagged, uncontrolled = (
        sum(part.statistics[key] for part in parts) for key in ("flagged", "uncontrolled")
    )
    numbers = {
        **parts[0].statistics,
        "redundancy_sum": sum(part.statistics["redundancy_sum"] for part in parts),
        "flagged": flagged,
        "uncontrolled": uncontrolled,
    }
    components = parts[0].variance_components
    in_weights = components is not None and components["iterated"]
    groups = group_rows([part.groups for part in parts], group_names(project), in_weights)
    places = {"group": [row["name"] for row in groups], "image": order}
    judged, remarks = _verdict(parts, ended, whole, uncontrolled, places, fixed)
    notes = [*said["notes"], *({"message": str(one), "file": "", "line": 0} for one in remarks)]
    names = {"images": order, "points": _ids(inlined.points), "groups": places["group"]}
    interiors = {name: one for part in parts for name, one in part.interiors.items()}
    images = inlined.images.to_dicts() if inlined.images is not None else None
    found = {
        **summary_of(project, ended, [], [], numbers),
        **said,
        "notes": notes,
        "verdict": judged,
        "reliability": reliability(parts, names),
        **_NOTHING_MORE,
        "points": inlined.points.to_dicts() if inlined.points is not None else None,
        "images": with_interiors(images, interiors) if images is not None else None,
        "cameras": distinct((row for part in parts for row in part.cameras), "id"),
        "stations": distinct((row for part in parts for row in part.stations), "id"),
        "systems": distinct((row for part in parts for row in part.systems), "id"),
        "features": [row for part in parts for row in part.features],
        "others": distinct((row for part in parts for row in part.others), "kind", "id"),
        "groups": groups,
        "variance_components": components,
        "gross_errors": gross_errors(parts, flagged, names),
        "fixed_points": [*(row for part in parts for row in part.fixed_points), *fixed],
        "checks": check_rows(parts),
        "tables": dict(tables),
        "files": [],
        "residuals": inlined.residuals.to_dicts() if inlined.residuals is not None else None,
    }
    return _ordered(found)


def _ordered(found: dict[str, Any]) -> dict[str, Any]:
    """The same with its keys in the order they have on one machine."""
    return {
        **{key: value for key, value in found.items() if key not in _KEYS},
        **{key: found[key] for key in _KEYS},
    }


_KEYS = (
    *("identity", "notes", "verdict", "reliability", "points", "images", "motions", "epochs", "trajectories"),
    *("boresights", "cameras", "stations", "systems", "pairs", "features", "others", "groups"),
    *(
        "variance_components",
        "gross_errors",
        "suspects",
        "possible_causes",
        "fixed_points",
        "relative",
        "checks",
    ),
    *("failure", "tables", "files", "residuals"),
)


def ended_of(
    project: Project,
    outcome: str,
    reason: str,
    solution: bool,
    sizes: tuple[int, int],
    movements: Sequence[str],
    iterations: Sequence[Any],
) -> Ended:
    """How it ended, with the numbers of observations and unknowns."""
    return Ended(
        outcome, reason, solution, *sizes, movements, datum_name(project.datum), iterations, are_loaded()
    )


def _ids(frame: pl.DataFrame | None) -> list[str]:
    return frame["id"].to_list() if frame is not None else []


def _verdict(
    parts: Sequence[Contribution],
    ended: Ended,
    whole: Whole,
    uncontrolled: int,
    places: Mapping[str, Sequence[str]],
    fixed: Sequence[dict[str, Any]],
) -> tuple[dict[str, Any], list[Problem]]:
    """The verdict, and what domains cannot say of it."""
    overall = whole.levels.overall
    tested = TestedWhole(ended.observations, whole.redundancy, whole.omega, overall)
    tests, open_ = tests_of_groups(parts, tested, places)
    freedom = sum(part.tests_of_fixed for part in parts) + sum(row["freedom"] for row in fixed)
    only = only_chosen_of(sum(part.fixed for part in parts), freedom)
    judged = Verdict(tests, (), tests.all_alike, only)
    test = global_test(whole.omega, whole.redundancy, overall)
    accepted = test.accepted and not judged.contradicted if whole.redundancy > 0 else None
    rows = rows_of_verdict(judged, accepted, uncontrolled, [], ended.movements)
    remarks = []
    if open_:
        words = f"{open_} of the tests of groups over several domains are not decided by sums"
        remarks.append(Problem(f"domains: {words}: p is an upper bound there"))
    if tests.rejected:
        remarks.append(Problem("domains: what would explain the groups that reject is not looked for"))
    if unlooked := points_in_several(parts):
        remarks.append(
            Problem(
                f"domains: points that are not intersected anew, as several domains observe them: {unlooked}"
            )
        )
    return rows, remarks


_NOTHING_MORE: dict[str, Any] = {
    "motions": [],
    "epochs": [],
    "trajectories": [],
    "boresights": [],
    "pairs": [],
    "suspects": None,
    "possible_causes": [],
    "relative": [],
    "failure": None,
}
"""What domains refuse, or do not look for."""
_NOTHING: dict[str, Any] = {
    **_NOTHING_MORE,
    "verdict": None,
    "reliability": None,
    "points": None,
    "images": None,
    **{key: [] for key in ("cameras", "stations", "systems", "features", "others", "groups")},
    "variance_components": None,
    "gross_errors": {},
    "fixed_points": [],
    "checks": [],
    "residuals": None,
}
