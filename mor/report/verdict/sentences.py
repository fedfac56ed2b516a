"""Tests of groups in words: which groups contradict, what would explain them, what is chosen and not measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mor.quality.solved import Solved
from mor.report.layout import fixed, heading, short, table
from mor.report.verdict.group_tests import verdict_rows
from mor.report.words.language import ENGLISH, Words

NAMED = 5
"""Groups that one sentence names."""
SHOWN = 40
"""Tests that the report lists: those that reject, then those of tables."""


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """All that rejects, and the tests of tables."""
    return section_of(verdict_rows(solved), words, shown)


def section_of(data: dict[str, Any] | None, words: Words, shown: int = SHOWN) -> str:
    """The same of a verdict as :func:`mor.report.verdict.group_tests.verdict_rows` has it."""
    if data is None or not (data["tests"] or said_conventions(data, words)):
        return ""
    lines = [heading(words("Tests of groups"))]
    if data["tests"]:
        lines.append(
            words(
                "{count:test|tests} of groups; all together reject by mistake with {level}, each with {each} (Sidak).",
                count=data["tests"],
                level=f"{data['level_of_groups']:g}",
                each=f"{data['level_of_each_group']:.2g}",
            )
        )
    lines += said_conventions(data, words)
    rejected = [row for row in data["groups"] if row["rejected"]]
    rows = rejected + [row for row in data["groups"] if not row["rejected"] and row["of"] == "group"]
    if rows:
        lines.append(table(_HEADERS, [_cells(row, words) for row in rows[:shown]], 3, words))
    if len(rows) > shown:
        lines.append(words("and {count} more in results.json", count=len(rows) - shown))
    return "\n".join(lines)


_HEADERS = ("tested", "name", "status", "n", "sum r", "vTPv", "factor of sigma [1]", "p")


def _cells(row: dict[str, Any], words: Words) -> list[str]:
    said = "rejected" if row["rejected"] else "accepted"
    numbers = [str(row["observations"]), fixed(row["redundancy"], 2), fixed(row["vtpv"], 2)]
    factor = fixed(row["sigma_factor"], 3)
    return [words(row["of"]), row["name"], said, *numbers, factor, f"{row['p']:.2g}"]


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
        words(
            "{thing} (sigma times {factor})", thing=_thing(row, words), factor=short(row["sigma_factor"], 3)
        )
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
    said = [
        words(
            "{thing} ({flagged} of its {count:row|rows})",
            thing=_thing(row, words),
            flagged=row["flagged"],
            count=row["rows"],
        )
        for row in rows
    ]
    return [
        words(
            "The flagged observations ({count:row|rows}) have in common: {names}.",
            count=rows[0]["all_flagged"],
            names=", ".join(said),
        )
    ]


def ill_determined(data: dict[str, Any] | None, unit: str, words: Words) -> list[str]:
    """Return a sentence that names what is ill-determined and says what to do; nothing if all is determined."""
    found = data["determined"] if data is not None else None
    if found is None or found["everywhere"]:
        return []
    if not found["beyond"]:
        return [
            words(
                "ILL-DETERMINED: {count:direction is|directions are} hardly determined; the report lists what moves "
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
            row["id"] if row["kind"] == "point" else f"{words(row['kind'])} {row['id']}"
            for row in found["worst"]
        ),
    }
    if found["as_a_whole"]:
        return [
            words(
                "ILL-DETERMINED: {count} of {all:point|points} with a standard deviation of more than {percent} % of "
                "the size of the network ({size} {unit}), the largest {sigma} {unit}: {names}. Observe them from "
                "further places, or fix or observe their coordinates.",
                **numbers,
            )
        ]
    return [
        words(
            "NOT DETERMINED: {count} of {all:point|points} with a standard deviation of more than {percent} % of the "
            "size of the network ({size} {unit}), the largest {sigma} {unit}: {names}. Fix or observe coordinates, or "
            "measure what ties the points to known ones.",
            **numbers,
        )
    ]


def _thing(row: dict[str, Any], words: Words) -> str:
    """A group by the name of its table, all else by what it is and its name."""
    return row["name"] if row["of"] == "group" else f"{words(row['of'])} {row['name']}"


def _explained(row: dict[str, Any], words: Words) -> str:
    """Possible explanation of a rejected group."""
    thing, effect = _thing(row, words), row["effect"]
    if effect is None and row["sigma_factor"] < 1.0:
        return words("{thing}: residuals are smaller than its sigma says.", thing=thing)
    if effect is None and row["flagged"]:
        return words(
            "{thing}: no common offset or scale explains it; {count:flagged observation makes|flagged observations "
            "make} {share} % of its vTPv.",
            thing=thing,
            count=row["flagged"],
            share=f"{100.0 * min(row['share_of_flagged'], 1.0):.0f}",
        )
    if effect is None:
        return words(
            "{thing}: no single observation and no common offset or scale explains it; its sigma would have to be "
            "{factor} times as large.",
            thing=thing,
            factor=short(row["sigma_factor"], 3),
        )
    size, unit = _size(effect)
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
        size=size[0],
        sigma=size[1],
        unit=unit,
        component=effect["component"],
        group=effect["group"],
        gain=short(effect["vtpv_falls_by"], 4),
        left=short(effect["sigma_factor_left"], 3),
    )


def _size(effect: dict[str, Any]) -> tuple[tuple[str, str], str]:
    """Size and σ of an effect, and their unit: of a scale parts in a million."""
    per_million = effect["kind"] == "scale"
    factor, unit = (1e6, "ppm") if per_million else (1.0, effect["unit"])
    return (short(factor * effect["size"], 4), short(factor * effect["sigma"], 2)), unit


def said_conventions(data: dict[str, Any], words: Words) -> list[str]:
    """Return the values that no observation determines."""
    found, lines = data["conventions"], []
    if found["movements"]:
        lines.append(
            words(
                "Chosen by the datum and not measured: {movements}. Standard deviations of coordinates refer to this "
                "choice.",
                movements=", ".join(words.listed(name) for name in found["movements"]),
            )
        )
    if found["scale"]:
        lines.append(words("The scale is arbitrary: no observation contains a length."))
    if found["fixed_coordinates_uncontrolled"]:
        lines.append(
            words("The fixed coordinates only settle the datum: nothing would show an error in them.")
        )
    return lines
