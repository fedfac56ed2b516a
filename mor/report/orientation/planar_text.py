"""A plane object for reading, every admissible solution."""

from __future__ import annotations

from typing import Any

from mor.report.orientation.relative_text import correlation_table
from mor.report.text.layout import fixed, short, table
from mor.report.words.language import ENGLISH, Words

OVER_CONSTANT = "flying height / c"
"""Correlated as the flying height itself."""
MOST = 14
"""Results whose correlations are shown; of more they are in the JSON."""


def planar_text(data: dict[str, Any], words: Words = ENGLISH) -> str:
    """The outcome, and each solution with σ."""
    lines = [words("Plane object: {words}", words=words.listed(data["words"]))]
    if data["outcome"] == "not_plane":
        lines.append(
            words(
                "Points off the plane are found where five or more, and half of all, lie in it; else name them: --off."
            )
        )
    if not data["solutions"]:
        return "\n".join(lines) + "\n"
    lines.append(
        words(
            "sigma0 {sigma0} [1], redundancy {redundancy}, system: {system}",
            sigma0=short(data["sigma0"], 4),
            redundancy=data["redundancy"],
            system=words.listed(data["system"]),
        )
    )
    if not data["scaled"]:
        lines.append(words("No length is given: the first two points are one unit of length apart."))
    if data["outcome"] == "base_along_normal":
        lines.append(
            words("No standard deviations: to first order they mean nothing on the dangerous locus.")
        )
    count = len(data["solutions"])
    for number, solution in enumerate(data["solutions"], start=1):
        if count > 1:
            lines += ["", words("Solution {number} of {count}", number=number, count=count)]
        lines += ["", *_solution(solution, words)]
    return "\n".join(lines) + "\n"


def _solution(solution: dict[str, Any], words: Words) -> list[str]:
    unit = solution["angle_unit"]
    points = [
        [p["id"], *_valued(p, ("x", "y", "z"), 5), "" if p["place"] == "plane" else words.listed(p["place"])]
        for p in solution["points"]
    ]
    images = [
        [str(k), *_valued(i, ("x", "y", "z", "omega", "phi", "kappa"), 5)]
        for k, i in enumerate(solution["images"], start=1)
    ]
    length = words.listed("length")
    lengths = [cell for name in ("X", "Y", "Z") for cell in (f"{name} [{length}]", "sigma")]
    centres = [cell for name in ("X0", "Y0", "Z0") for cell in (f"{name} [{length}]", "sigma")]
    turns = [cell for name in ("omega", "phi", "kappa") for cell in (f"{name} [{unit}]", "sigma")]
    results = [
        [words.listed(r["kind"]), r["of"], said, fixed(r["value"], 5), fixed(r["sigma"], 5)]
        for r in solution["results"]
        for said in [words.listed(_unit(r["kind"], unit))]
    ]
    lines = [table(["point", *lengths, "remark"], points, words=words), ""]
    lines += [table(["image", *centres, *turns], images, words=words), ""]
    lines.append(table(["result", "of", "unit", "value", "sigma"], results, left=3, words=words))
    shown = [k for k, r in enumerate(solution["results"]) if r["kind"] != OVER_CONSTANT]
    matrix = [[solution["correlation"][i][j] for j in shown] for i in shown]
    if len(shown) <= MOST and any(value is not None for row in matrix for value in row):
        names = [
            f"{words.listed(solution['results'][k]['kind'])} {solution['results'][k]['of']}" for k in shown
        ]
        lines += ["", correlation_table(names, matrix, words)]
    return lines


def _unit(kind: str, angle: str) -> str:
    return {"angle": angle, OVER_CONSTANT: "length / c"}.get(kind, "length")


def _valued(row: dict[str, Any], keys: tuple[str, ...], digits: int) -> list[str]:
    return [cell for key in keys for cell in (fixed(row[key], digits), fixed(row[f"s{key}"], digits))]
