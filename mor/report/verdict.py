"""The verdict in words: group tests, reliability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from mor.quality.assessment import Quality
from mor.quality.external_reliability import (
    HARDLY_CONTROLLED,
    ObservationComponent,
    carried_points,
    most_at_a_time,
    point_movements,
)
from mor.quality.global_tests import GroupEffect
from mor.quality.reliability_map import (
    CandidateObservation,
    Controlled,
    best_further,
    detectable,
    uncontrolled,
    uncontrolled_count,
)
from mor.quality.singularity import enumerated
from mor.quality.solution import LARGEST_SIGMA, Determination, Solved
from mor.report.language import ENGLISH, Words
from mor.report.layout import cells, heading, in_words, short, table
from mor.report.observations import place
from mor.report.units import ends_of_group, once, picked, reported_component, said_differences, said_one, said_sizes

# ---- External reliability as vectors: where an error that stays unseen moves each point.
#
# Of all observations of a point the one with the smallest redundancy number has the largest external
# reliability (W. Baarda, 1968): a gross error in it of the size ∇, which the tests find with the power asked
# for and no better, moves the point by the vector, in the datum of the adjustment.

FILE = "external_reliability.csv"
PARTS = ("dx", "dy", "dz")
SCHEMA: dict[str, type[pl.DataType]] = {
    "point": pl.String,
    **dict.fromkeys(PARTS, pl.Float64),
    "r": pl.Float64,
    **dict.fromkeys(("type", "group", "at", "from", "to", "component"), pl.String),
}


@once
def external_reliability(solved: Solved) -> pl.DataFrame:
    """One row for each point: its movement in project axes and units of length, by the observation that follows.

    Points that next to nothing controls are not among them: an error there has no bound.
    """
    quality = solved.quality
    seen = next((one for one in solved.reliability_map if one.of == "point"), None)
    if quality is None or quality.redundancy == 0 or seen is None:
        return pl.DataFrame(schema=SCHEMA)
    blocks = solved.network.things["point"].parts["position"]
    free = np.asarray((quality.adjustment.problem.index.columns["point"][blocks] >= 0).any(axis=1))
    # Points that have a vector; of more, those with the smallest redundancy numbers.
    # Numbers of the reduced system that are worked out: in large networks fewer points have a vector.
    most = min(500, max(1, 300_000 // max(1, len(quality.adjustment.plan.kept))))
    order = seen.worst(len(seen.names))
    chosen = order[free[order] & (seen.smallest_r[order] >= HARDLY_CONTROLLED)][:most].tolist()
    nabla = detectable(quality, seen.weakest[chosen])
    bounded = np.isfinite(nabla)  # of correlated observations r alone does not tell
    chosen, nabla = [k for k, known in zip(chosen, bounded, strict=True) if known], nabla[bounded]
    entries = [seen.entry(k) for k in chosen]
    moved = point_movements(quality, entries, nabla, [[int(blocks[k])] for k in chosen])
    rows = []
    for k, entry, (movement,) in zip(chosen, entries, moved, strict=True):
        group = quality.adjustment.problem.groups[entry.group]
        vector = (movement @ solved.network.edge.matrix).tolist()
        row: dict[str, Any] = {**place(group, entry.row, entry.component), "r": float(seen.smallest_r[k])}
        row |= {"point": seen.names[k], **dict(zip(PARTS, vector, strict=True))}
        rows.append({name: row.get(name, "") for name in SCHEMA})
    return pl.DataFrame(rows, schema=SCHEMA)


# ---- The verdict as plain data: tests of groups, what would explain those that reject, what is chosen and not
# measured.

NAMED = 5
"""Ill-determined points that are named."""


@once
def verdict_rows(solved: Solved) -> dict[str, Any] | None:
    """Accepted or not, tests of groups, explanations; nothing without a solution."""
    judged = solved.verdict
    if solved.quality is None or judged is None:
        return None
    accepted = solved.accepted if solved.quality.redundancy > 0 else None
    explanations: list[dict[str, Any]] = [
        {
            "of": one.test.of,
            "name": one.test.name,
            "sigma_factor": one.test.factor,
            "flagged": one.flagged,
            "share_of_flagged": one.share_of_flagged,
            "effect": _effect(solved, one.effect, one.suffices) if one.effect is not None else None,
        }
        for one in judged.explained
    ]
    if solved.possible_causes and solved.possible_causes[0].cause == "curvature":
        explanations = [one for one in explanations if not _is_like_curvature(one["effect"])]
    tests, found = judged.tests, judged.determined
    # Tests that are listed; of more only those that reject.
    listed = tests.tests if len(tests.tests) <= 10_000 else tuple(tests.rejected)
    uncontrolled, movements = uncontrolled_count(solved.quality), solved.adjustment.defect.movements
    return {
        "accepted": accepted,
        "says": _says(accepted, uncontrolled, found),
        "uncontrolled": uncontrolled,
        "level_of_groups": tests.level,
        "level_of_each_group": tests.level_of_each,
        "tests": len(tests.tests),
        "rejected": len(tests.rejected),
        "all_alike": judged.all_alike,
        "groups": [
            {
                "of": test.of,
                "name": test.name,
                "also": [{"of": of, "name": name} for of, name in test.also],
                "observations": test.count,
                "redundancy": test.redundancy,
                "vtpv": test.omega,
                "sigma_factor": test.factor,
                "freedom": test.freedom,
                "p": float(np.exp(test.log_p)),
                "rejected": test.rejected,
            }
            for test in listed
        ],
        "explanations": explanations,
        "conventions": {
            "movements": list(movements),
            "scale": "scale" in movements,
            "fixed_coordinates_uncontrolled": judged.chosen_only,
        },
        "determined": _determined(found) if found is not None else None,
    }


def _is_like_curvature(effect: dict[str, Any] | None) -> bool:
    """True for an offset of vertical angles, which the curvature of the earth looks like over similar distances."""
    vertical = ("zenith", "zenith_angle", "vertical", "vertical_direction")
    return effect is not None and effect["kind"] == "offset" and effect["component"] in vertical


def _determined(found: Determination) -> dict[str, Any]:
    return {
        **picked(found, "as_a_whole", "everywhere", "size"),
        "limit": LARGEST_SIGMA,
        "points": found.points,
        "largest_sigma": found.largest,
        "median_sigma": found.median,
        "beyond": len(found.beyond),
        "worst": [{"kind": kind, "id": name, "sigma": sigma} for kind, name, sigma in found.beyond[:NAMED]],
        "directions": found.directions,
    }


def _says(accepted: bool | None, uncontrolled: int, found: Determination | None) -> str:
    if found is not None and not found.as_a_whole:
        return "not determined"
    if accepted is None:
        return "not tested"
    if not accepted:
        return "not accepted"
    if found is not None and not found.everywhere:
        return "accepted, partly ill-determined"
    return "accepted, observations uncontrolled" if uncontrolled else "accepted"


def _effect(solved: Solved, effect: GroupEffect, suffices: bool) -> dict[str, Any]:
    group = solved.adjustment.problem.groups[effect.group]
    outside = reported_component(group, effect.component)
    size, sigma, unit = effect.size, effect.sigma, "1"
    if effect.kind == "offset":
        unit = ends_of_group(group).external.units[outside]
        in_unit = said_one(said_differences, group, effect.component, 1.0)
        size, sigma = size * in_unit, sigma * abs(in_unit)
    return {
        "kind": effect.kind,
        "group": group.name,
        "type": group.type.name,
        "component": group.type.components[outside].name,
        "size": float(size),
        "sigma": float(sigma),
        "unit": unit,
        "w": float(abs(effect.test)),
        "vtpv_falls_by": float(effect.test**2),
        "sigma_factor_left": effect.factor if np.isfinite(effect.factor) else None,
        "suffices": suffices,
    }


# ---- The reliability map as plain data: what is weakest, what it carries, what would cure it.

KINDS = {"point": "points", "image": "images", "station": "stations", "set": "sets"}


@once
def reliability_rows(solved: Solved) -> dict[str, Any] | None:
    """Uncontrolled observations, and the map; nothing without redundancy."""
    quality = solved.quality
    if quality is None or quality.redundancy == 0:
        return None
    count, entries = _uncontrolled(quality)
    rows: dict[str, Any] = {
        "least_redundancy": quality.levels.least_redundancy,
        "uncontrolled": count,
        "observations": _observations(solved, quality, entries),
    }
    found = {one.of: one for one in solved.reliability_map}
    # (p,) number of unknown coordinates of each point.
    blocks = solved.network.things["point"].parts["position"]
    unknown = np.asarray(np.count_nonzero(solved.adjustment.problem.index.columns["point"][blocks] >= 0, axis=1))
    named = found["point"].observations
    barely = (named > 0) & (unknown > 0) & (named <= unknown + 1)  # at most one observation more than unknowns
    rows["points_barely_determined"] = int(np.count_nonzero(barely))
    for kind, key in KINDS.items():
        rows[key] = _things(solved, found[kind]) if kind in found else []
    return rows


def _uncontrolled(quality: Quality) -> tuple[int, list[ObservationComponent]]:
    found = []
    for number, one in enumerate(quality.groups):
        rows, components = np.nonzero(uncontrolled(quality, number))
        if len(rows):
            used, inverse = np.unique(rows, return_inverse=True)
            r = np.round(one.at(used).r[inverse, components], 7)
            found.append(np.stack([r, np.full(len(rows), number), rows, components]))
    if not found:
        return 0, []
    r, *entries = np.concatenate(found, axis=1)
    # Uncontrolled observations that are listed with what they carry.
    first = np.lexsort((*reversed(entries), r))[:200]
    named = np.stack(entries, axis=1)[first].astype(np.int64).tolist()
    return len(r), [ObservationComponent(*entry) for entry in named]


def _observations(solved: Solved, quality: Quality, entries: list[ObservationComponent]) -> list[dict[str, Any]]:
    told = entries[: most_at_a_time(quality)]
    carried = carried_points(quality, told)
    # Weak spots for which a further observation is looked for.
    most = 12
    cures = best_further(quality, [(entry, _targets(solved, entry)) for entry in entries[:most]])
    names = solved.network.blocks["point"].ids
    nabla = detectable(quality, np.array(entries, dtype=np.int64).reshape(-1, 3)).tolist()
    rows = []
    for k, entry in enumerate(entries):
        group = quality.adjustment.problem.groups[entry.group]
        r = float(quality.groups[entry.group].at(np.array([entry.row])).r[0, entry.component])
        rows.append(
            {
                **place(group, entry.row, entry.component),
                "r": r,
                "nabla": said_one(said_sizes, group, entry.component, nabla[k]) if np.isfinite(nabla[k]) else None,
                "carries": [names[block] for block in carried[k]] if k < len(told) else None,
                "cure": _cure(solved, cures[k]) if k < most else None,
            }
        )
    return rows


def _targets(solved: Solved, entry: ObservationComponent) -> list[int]:
    problem = solved.adjustment.problem
    group, columns = problem.groups[entry.group], problem.index.columns["point"]
    blocks = [
        int(own[entry.row])
        for slot, own in group.blocks_by_slot
        if slot.kind == "point" and slot.of not in ("image", "station", "system")
    ]
    return [block for block in dict.fromkeys(blocks) if (columns[block] >= 0).any()]


def _cure(solved: Solved, further: CandidateObservation) -> dict[str, Any]:
    group = solved.adjustment.problem.groups[further.group]
    again = further.target < 0
    names = group.names_of(further.row)
    if not again:
        last = group.type.references[-1].name
        names[last] = solved.network.blocks["point"].ids[further.target]
    return {"again": again, "type": group.type.name, "group": group.name, "names": names, "r": further.r}


def _things(solved: Solved, one: Controlled) -> list[dict[str, Any]]:
    # Points, images, stations or sets that are listed; of more the weakest.
    most = 1_000
    few = len(one.names) <= most
    # Some things (k,) of one kind.
    numbers = np.flatnonzero(np.isfinite(one.smallest_r)) if few else one.worst(most)
    assert solved.quality is not None
    nabla = detectable(solved.quality, one.weakest[numbers])
    groups = solved.adjustment.problem.groups
    rows = []
    for k, size in zip(numbers.tolist(), nabla.tolist(), strict=True):
        entry = one.entry(k)
        group = groups[entry.group]
        rows.append(
            {
                "id": one.names[k],
                "observations": int(one.observations[k]),
                "smallest_r": float(one.smallest_r[k]),
                "weakest": place(group, entry.row, entry.component),
                "nabla": said_one(said_sizes, group, entry.component, size) if np.isfinite(size) else None,
                "shift": float(one.shift[k]) if np.isfinite(one.shift[k]) else None,
            }
        )
    return rows


# ---- Tests of groups in words: which groups contradict, what would explain them, what is chosen and not measured.


def section(solved: Solved, words: Words = ENGLISH, shown: int = 40) -> str:
    """All that rejects, and the tests of tables: ``shown`` of them."""
    return section_of(verdict_rows(solved), words, shown)


def section_of(data: dict[str, Any] | None, words: Words, shown: int) -> str:
    """The same of a verdict as :func:`mor.report.verdict.verdict_rows` has it."""
    if data is None or not (data["tests"] or said_conventions(data, words)):
        return ""
    lines = [heading(words("Tests of groups"))]
    lines += [tests_in_words(data, words)] if data["tests"] else []
    lines += said_conventions(data, words)
    rejected = [row for row in data["groups"] if row["rejected"]]
    rows = rejected + [row for row in data["groups"] if not row["rejected"] and row["of"] == "group"]
    if rows:
        headers = ["tested", "name", "status", "n", "sum r", "vTPv", "factor of sigma [1]", "p"]
        numbers = "observations redundancy:.2f vtpv:.2f sigma_factor:.3f p:.2g"
        lines_of = [
            [words(row["of"]), row["name"], "rejected" if row["rejected"] else "accepted", *cells(row, numbers)]
            for row in rows[:shown]
        ]
        lines.append(table(headers, lines_of, 3, words))
    if len(rows) > shown:
        lines.append(words("and {count} more in results.json", count=len(rows) - shown))
    return "\n".join(lines)


def tests_in_words(data: dict[str, Any], words: Words) -> str:
    """State how many groups are tested, and at which levels."""
    said = "{count:test|tests} of groups; all together reject by mistake with {level}, each with {each} (Sidak)."
    each = f"{data['level_of_each_group']:.2g}"
    return words(said, count=data["tests"], level=f"{data['level_of_groups']:g}", each=each)


def contradictions(data: dict[str, Any] | None, words: Words) -> list[str]:
    """Name the groups that are rejected, and possible explanations of the worst; empty if there are none."""
    if data is None or not data["rejected"]:
        return []
    if data["all_alike"]:
        return [
            words(
                "{rejected} of {count:test|tests} of groups reject, none of them beside the others: all sigmas seem "
                "wrong by one factor.",
                rejected=data["rejected"],
                count=data["tests"],
            )
        ]
    explained = data["explanations"][:1]
    rejected = sorted((row for row in data["groups"] if row["rejected"]), key=lambda row: row["p"])
    worst = (data["explanations"] or rejected)[:NAMED]
    names = ", ".join(
        words("{thing} (sigma times {factor})", thing=_thing(row, words), factor=short(row["sigma_factor"], 3))
        for row in worst
    )
    left = data["rejected"] - len(worst)
    if left > 0:
        names = words("{names} and {count} more", names=names, count=left)
    lines = [
        words(
            "NOT ACCEPTED: {rejected} of {count:test|tests} of groups reject, at the level {level} of all together: "
            "{names}.",
            rejected=data["rejected"],
            count=data["tests"],
            level=f"{data['level_of_groups']:g}",
            names=names,
        )
    ]
    return lines + [_explained(row, words) for row in explained]


def in_common(rows: Sequence[dict[str, Any]], words: Words) -> list[str]:
    """Return a sentence that names what flagged observations have in common; nothing if they have nothing."""
    if not rows:
        return []
    one = "{thing} ({flagged} of its {count:row|rows})"
    names = ", ".join(words(one, thing=_thing(row, words), flagged=row["flagged"], count=row["rows"]) for row in rows)
    said = "The flagged observations ({count:row|rows}) have in common: {names}."
    return [words(said, count=rows[0]["all_flagged"], names=names)]


def ill_determined(data: dict[str, Any] | None, unit: str, words: Words) -> list[str]:
    """Return a sentence that names what is ill-determined and says what to do; nothing if all is determined."""
    found = data["determined"] if data is not None else None
    if found is None or found["everywhere"]:
        return []
    if not found["beyond"]:
        return [
            words(
                "ILL-DETERMINED: {count:direction is|directions are} poorly determined; the report lists what moves "
                "together, and what would help.",
                count=found["directions"],
            )
        ]
    numbers = {
        "count": found["beyond"],
        "all": found["points"],
        "percent": f"{100.0 * found['limit']:g}",
        "size": short(found["size"], 3),
        "unit": unit,
        "sigma": short(found["largest_sigma"], 3),
        "names": ", ".join(
            row["id"] if row["kind"] == "point" else f"{words(row['kind'])} {row['id']}" for row in found["worst"]
        ),
    }
    said = (
        "ILL-DETERMINED: {count} of {all:point|points} with a standard deviation of more than {percent} % of "
        "the size of the network ({size} {unit}), the largest {sigma} {unit}: {names}. Observe them from "
        "more stations, or fix or observe their coordinates."
        if found["as_a_whole"]
        else "NOT DETERMINED: {count} of {all:point|points} with a standard deviation of more than {percent} % of the "
        "size of the network ({size} {unit}), the largest {sigma} {unit}: {names}. Fix or observe coordinates, or "
        "measure what ties the points to known ones."
    )
    return [words(said, **numbers)]


def _thing(row: dict[str, Any], words: Words) -> str:
    return row["name"] if row["of"] == "group" else f"{words(row['of'])} {row['name']}"


def _explained(row: dict[str, Any], words: Words) -> str:
    thing, effect = _thing(row, words), row["effect"]
    if effect is None and row["sigma_factor"] < 1.0:
        return words("{thing}: residuals are smaller than its sigma says.", thing=thing)
    if effect is None and row["flagged"]:
        said = (
            "{thing}: no common offset or scale explains it; {count:flagged observation makes|flagged observations "
            "make} {share} % of its vTPv."
        )
        return words(said, thing=thing, count=row["flagged"], share=f"{100.0 * min(row['share_of_flagged'], 1.0):.0f}")
    if effect is None:
        said = (
            "{thing}: no single observation and no common offset or scale explains it; its sigma would have to be "
            "{factor} times as large."
        )
        return words(said, thing=thing, factor=short(row["sigma_factor"], 3))
    factor, unit = (1e6, "ppm") if effect["kind"] == "scale" else (1.0, effect["unit"])
    sentence = (
        "A common {kind} of {size} +- {sigma} {unit} in {component} of {group} would explain it: vTPv falls by {gain}, "
        "the factor of its sigma to {left}. Nothing was changed."
        if effect["suffices"]
        else "A common {kind} of {size} +- {sigma} {unit} in {component} of {group} would explain a part of it: vTPv "
        "falls by {gain}, the factor of its sigma to {left}. Nothing was changed."
    )
    return words(
        sentence,
        kind=words(effect["kind"]),
        size=short(factor * effect["size"], 4),
        sigma=short(factor * effect["sigma"], 2),
        unit=unit,
        component=effect["component"],
        group=effect["group"],
        gain=short(effect["vtpv_falls_by"], 4),
        left=short(effect["sigma_factor_left"], 3),
    )


def said_conventions(data: dict[str, Any], words: Words) -> list[str]:
    """Return the values that no observation determines."""
    found, lines = data["conventions"], []
    if found["movements"]:
        said = (
            "Chosen by the datum and not measured: {movements}. Standard deviations of coordinates refer to this "
            "choice."
        )
        lines.append(words(said, movements=", ".join(words.listed(name) for name in found["movements"])))
    if found["scale"]:
        lines.append(words("The scale is arbitrary: no observation contains a length."))
    if found["fixed_coordinates_uncontrolled"]:
        lines.append(words("The fixed coordinates only define the datum: nothing would show an error in them."))
    return lines


# ---- The reliability map in words: uncontrolled observations, the weakest points, images, stations and sets.

WORDS_OF_RELIABILITY_NAMED = 10
"""Uncontrolled observations that are spoken of one by one."""


def section_of_reliability(
    solved: Solved, words: Words = ENGLISH, weakest: int = 4, named: int = WORDS_OF_RELIABILITY_NAMED
) -> str:
    """So many uncontrolled observations, then so many weakest of each kind."""
    unit = solved.network.project.units.length
    data = reliability_rows(solved)
    if data is None:
        return ""
    lines = [heading(words("Reliability")), *uncontrolled_in_words(data, words, named)]
    rows = []
    for kind, key in KINDS.items():
        for row in sorted(data[key], key=lambda row: round(float(row["smallest_r"]), 9))[:weakest]:
            spot = {**row, "smallest_r": round(row["smallest_r"], 7), "unit": row["weakest"]["unit"]}
            numbers = cells(spot, "observations smallest_r:.2g nabla:.3g unit shift:.3g")
            rows.append([words(kind), row["id"], in_words(row["weakest"], words), *numbers])
    if rows:
        headers = ["weakest", "id", "observation", "n", "smallest r [1]", "nabla", "unit", f"shift at most [{unit}]"]
        lines.append(table(headers, rows, 3, words, margin=2))
    return "\n".join(lines)


def uncontrolled_in_words(data: dict[str, Any], words: Words, named: int = WORDS_OF_RELIABILITY_NAMED) -> list[str]:
    """One line on each of the first uncontrolled observations, and how many there are."""
    if not data["uncontrolled"]:
        return [words("No observation is uncontrolled (r < {limit}).", limit=f"{data['least_redundancy']:g}")]
    lines = [
        words(
            "{count:observation is|observations are} uncontrolled (r < {limit}): an error there would hardly show.",
            count=data["uncontrolled"],
            limit=f"{data['least_redundancy']:g}",
        )
    ]
    lines += [f"  {uncontrolled_sentence(row, words)}" for row in data["observations"][:named]]
    left = data["uncontrolled"] - len(data["observations"][:named])
    if left > 0:
        lines.append(words("  and {count} more", count=left))
    return lines


def uncontrolled_sentence(row: dict[str, Any], words: Words) -> str:
    """An uncontrolled observation: what rests on it, and what would control it."""
    said = words("{place}: r = {r}", place=in_words(row, words), r=short(round(row["r"], 7), 2))
    if row["carries"]:
        said += words("; supports {names}", names=enumerated(row["carries"], 4, words))
    cure = row["cure"]
    if cure is None:
        return said
    if cure["again"]:
        return said + words("; measured twice it would have r = {r}", r=short(cure["r"], 2))
    place = in_words({**cure, "component": cure["type"]}, words)
    return said + words(
        "; with one more observation, {place}, it would have r = {r}", place=place, r=short(cure["r"], 2)
    )
