"""Rows of ``results.json`` that several domains have added something to, put together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.quality.gross_errors.rejected_as_a_whole import is_mostly_out
from mor.quality.reliability.effects import AT_LEAST
from mor.quality.reliability.effects import MOST as EXPLAINED
from mor.quality.tests.group_tests import GroupTests, Summed, TestedWhole, tests_of_sums
from mor.quality.tests.quadratic_form import Moments
from mor.quality.variance_components.simplified import components_of_sums
from mor.report.domains.contribution import Contribution, Key, Shared
from mor.report.parameters import number_or_none
from mor.report.verdict.reliability_map import KINDS, MOST, NAMED, barely_determined

Row = dict[str, Any]


def distinct(rows: Iterable[Row], *keys: str) -> list[Row]:
    """Rows that several domains have once, the first of them."""
    found: dict[tuple[Any, ...], Row] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), row)
    return list(found.values())


def group_rows(parts: Sequence[Sequence[Row]], order: Sequence[str], in_weights: bool = False) -> list[Row]:
    """Sums of the groups over all domains, in the ``order`` of their names.

    Variance components that are ``in_weights`` are those that every domain has been told.
    """
    sums = pl.DataFrame([{key: row[key] for key in _SUMMED} for part in parts for row in part])
    both = sums.group_by("name", "type", maintain_order=True).agg(
        pl.col("observations", "redundancy", "vtpv", "excluded", "flagged").sum(), pl.col("largest_w").max()
    )
    omega, redundancy = (both[name].to_numpy().astype(float) for name in ("vtpv", "redundancy"))
    factors = components_of_sums(omega, redundancy)
    place = {name: k for k, name in enumerate(order)}
    iterated = {(row["name"], row["type"]): row for part in parts for row in part} if in_weights else {}
    rows = []
    for k, row in enumerate(both.to_dicts()):
        r, count = row["redundancy"], row["observations"]
        known = bool(np.isfinite(factors.sigma[k]))
        rows.append(
            {
                **{key: row[key] for key in ("name", "type", "observations", "redundancy", "vtpv")},
                "sigma0": float(np.sqrt(row["vtpv"] / r)) if r > 1e-6 and row["vtpv"] >= 0.0 else None,
                "mean_r": r / count if count else None,
                **{key: row[key] for key in ("largest_w", "excluded", "flagged")},
                "sigma_factor": number_or_none(factors.factors[k]) if known else None,
                "sigma_of_factor": number_or_none(factors.sigma[k]),
                **{key: iterated[row["name"], row["type"]][key] for key in _FACTORS if in_weights},
            }
        )
    return sorted(rows, key=lambda row: place.get(row["name"], len(place)))


_FACTORS = ("sigma_factor", "sigma_of_factor")
_SUMMED = ("name", "type", "observations", "redundancy", "vtpv", "excluded", "flagged", "largest_w")


def check_rows(parts: Iterable[Contribution]) -> list[Row]:
    """Checks are in one domain only, the ground."""
    return [row for part in parts for row in part.checks]


def gross_errors(parts: Sequence[Contribution], flagged: int, order: Mapping[str, Sequence[str]]) -> Row:
    """Levels, the worst of the suspicious observations of all domains, what data snooping did.

    ``order`` has the names of groups, and of points and images as they are to be listed where there are few.
    """
    rows = [row for part in parts for row in part.gross_errors["suspicious"]]
    worst = sorted(rows, key=lambda row: -abs(row["w"]))[: min(flagged, EXPLAINED) or AT_LEAST]
    told = {
        "suspicious": worst,
        "in_common": [],
        "snooping": _snooping(parts, order),
        "robust": _robust(parts, order["groups"]),
    }
    return {**parts[0].gross_errors, **told}


def _robust(parts: Sequence[Contribution], groups: Sequence[str]) -> Row | None:
    """What the robust solution rejects in all domains, group by group, and how it moves their points."""
    told = parts[0].gross_errors["robust"]
    if told is None:
        return None
    place = {name: k for k, name in enumerate(groups)}
    rejected = [row for part in parts for row in part.gross_errors["robust"]["rejected"]]
    count = sum(part.shift.coordinates for part in parts)
    return {
        **told,
        "rejected": sorted(rejected, key=lambda row: place.get(row["group"], len(place))),
        "largest_shift": max(part.shift.largest for part in parts),
        "rms_shift": float(np.sqrt(sum(part.shift.squares for part in parts) / count)) if count else 0.0,
    }


def _snooping(parts: Sequence[Contribution], order: Mapping[str, Sequence[str]]) -> Row | None:
    """Steps of all domains in their order, and of what most observations are out in all of them together."""
    told = parts[0].gross_errors["snooping"]
    if told is None:
        return None
    steps = sorted(
        (
            pair
            for one in parts
            for pair in zip(one.steps, one.gross_errors["snooping"]["steps"], strict=True)
        ),
        key=lambda pair: pair[0],
    )
    sums: dict[tuple[str, str], Row] = {}
    for kind, row in (pair for one in parts for pair in one.taken_out):
        known = sums.setdefault((kind, row["id"]), {**row, "excluded": 0, "observations": 0})
        for key in ("excluded", "observations"):
            known[key] += row[key]
    mostly = [row for row in sums.values() if is_mostly_out(row["excluded"], row["observations"])]
    places = {of: {name: k for k, name in enumerate(order[f"{of}s"])} for of in ("image", "point")}
    mostly.sort(key=lambda row: (row["of"] == "point", places.get(row["of"], {}).get(row["id"], 0)))
    return {**told, "steps": [row for _, row in steps], "mostly_out": mostly}


def points_in_several(parts: Sequence[Contribution]) -> int:
    """Number of points of which data snooping took something out, and that several domains observe."""
    rows = [(row["id"], row["excluded"]) for one in parts for kind, row in one.taken_out if kind == "point"]
    observed = Counter(name for name, _ in rows)
    return len({name for name, excluded in rows if excluded and observed[name] > 1})


def reliability(parts: Sequence[Contribution], order: Mapping[str, Sequence[str]]) -> Row | None:
    """The map of all domains: what several observe is as good as the weakest of its observations in all of them.

    ``order`` has the names of points and images as they are to be listed where there are few.
    """
    maps = [part.reliability for part in parts if part.reliability is not None]
    if not maps:
        return None
    entries = sorted((row for one in maps for row in one["observations"]), key=lambda row: round(row["r"], 7))
    shared = {key: _shared([part.shared.get(key, []) for part in parts]) for key in KINDS.values()}
    barely = sum(one["points_barely_determined"] for one in maps)
    for one in shared["points"]:
        counts = np.array([one.unknown]), np.array([one.row["observations"]])
        barely += int(barely_determined(*counts)[0])
    found = {
        "least_redundancy": maps[0]["least_redundancy"],
        "uncontrolled": sum(one["uncontrolled"] for one in maps),
        "observations": entries[:NAMED],
        "points_barely_determined": barely,
    }
    for key in KINDS.values():
        rows = [*(row for one in maps for row in one[key]), *(one.row for one in shared[key])]
        many = len(rows) > MOST
        place = {name: float(k) for k, name in enumerate(order.get(key, []))}
        rows.sort(key=lambda row: row["smallest_r"] if many else place.get(row["id"], 0.0))
        found[key] = rows[:MOST]
    return found


def _shared(parts: Iterable[Iterable[Shared]]) -> list[Shared]:
    """What several domains observe: all its observations counted, the weakest of them."""
    found: dict[str, Shared] = {}
    for one in (one for part in parts for one in part):
        known = found.get(one.row["id"])
        found[one.row["id"]] = one if known is None else _both(known, one)
    return list(found.values())


def _both(one: Shared, other: Shared) -> Shared:
    weaker = min((one, other), key=lambda each: each.row["smallest_r"])
    shifts = [each.row["shift"] for each in (one, other)]
    row = {
        **weaker.row,
        "observations": one.row["observations"] + other.row["observations"],
        "shift": None if None in shifts else max(shifts),
    }
    return Shared(row, max(one.unknown, other.unknown))


def tests_of_groups(
    parts: Sequence[Contribution], whole: TestedWhole, order: Mapping[str, Sequence[str]]
) -> tuple[GroupTests, int]:
    """Tests of groups from the sums of all domains; with them the number of those that sums do not decide.

    Their moments are known where one domain has all observations of a group. ``order`` has the names of groups and
    images as they are to be listed.
    """
    sums: dict[Key, list[Summed]] = {}
    known: dict[tuple[str, str], Moments] = {}
    for test in (test for part in parts for test in part.tests):
        sums.setdefault(test.key, []).append(test.summed)
        if test.moments is not None:
            known[test.summed.of, test.summed.name] = test.moments
    summed = [one[0]._replace(sums=np.sum([part.sums for part in one], axis=0)) for one in sums.values()]
    several = {(of, name) for (of, name, _), one in sums.items() if len(one) > 1}
    missing: list[Summed] = []

    def exactly(one: Summed) -> Moments | None:
        moments = known.get((one.of, one.name)) if (one.of, one.name) not in several else None
        if moments is None:
            missing.append(one)
        return moments

    kinds = {of: k for k, of in enumerate(_ORDER)}
    places = {of: {name: k for k, name in enumerate(names)} for of, names in order.items()}
    ordered = sorted(summed, key=lambda one: (kinds[one.of], places.get(one.of, {}).get(one.name, 0)))
    return tests_of_sums(ordered, whole, exactly, ()), len(missing)


_ORDER = ("group", "image", "camera", "station", "set", "instrument", "system")
