"""Mistakes with instruments: constants, heights, circles, lines of levels."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.scenarios.planted_mistakes.survey import Row, Survey, scaled
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted, one_of

Random = np.random.Generator


def _distances(survey: Survey, random: Random) -> dict[str, Any]:
    entries = [e for e in survey.entries("observations", "distance") if "instrument" not in e]
    return one_of(random, [e for e in entries if len(survey.rows(e)) >= 3])


def _metres(survey: Survey) -> float:
    return {"m": 1.0, "mm": 1000.0}[survey.project["units"]["length"]]


def offset(survey: Survey, random: Random) -> Planted:
    """The prism constant forgotten: the same in all distances of an instrument."""
    entry = _distances(survey, random)
    amount = random.choice([-1.0, 1.0]) * random.uniform(0.015, 0.04) * _metres(survey)
    for row in survey.rows(entry):
        row["distance"] = f"{float(row['distance']) + amount:.6f}"
    return Planted(("distance offset",), {_label(entry)})


def scale(survey: Survey, random: Random) -> Planted:
    """The scale of all distances of an instrument wrong: weather, or feet of another kind."""
    entry = _distances(survey, random)
    scaled(survey.rows(entry), ("distance",), 1.0 + random.choice([-1.0, 1.0]) * random.uniform(5e-4, 3e-3))
    return Planted(("distance scale",), {_label(entry)})


def _label(entry: dict[str, Any]) -> str:
    return str(entry.get("name", entry["file"]))


def instrument_height(survey: Survey, random: Random) -> Planted:
    """The height of an instrument forgotten."""
    stations = [row for entry in survey.entries("stations") for row in survey.rows(entry)]
    cells = [row for row in stations if row.get("height")]
    if cells:
        row = one_of(random, cells)
        name, row["height"] = row["id"], ""
        return Planted(("instrument height",), {name})
    for entry in survey.project.get("stations", []):
        columns = entry.get("columns", [])
        if "height" in columns:
            row = one_of(random, [r for r in entry["rows"] if r[columns.index("height")]])
            row[columns.index("height")] = ""
            return Planted(("instrument height",), {row[0]})
    raise NotHereError


def target_height(survey: Survey, random: Random) -> Planted:
    """The height of a target forgotten, wherever it was sighted from one station, or from all."""
    entries = [e for e in survey.entries("observations") if "to_height" in survey.rows(e)[0]]
    target = one_of(random, sorted({row["to"] for e in entries for row in survey.rows(e)}))
    rows = [row for e in entries for row in survey.rows(e) if row["to"] == target]
    if random.random() < 0.5:
        station = one_of(random, sorted({_at(row) for row in rows}))
        rows = [row for row in rows if _at(row) == station]
    for row in rows:
        row["to_height"] = ""
    return Planted(("target height",), {target})


def _at(row: Row) -> str:
    return row["station"] if "station" in row else row["from"]


def _circle(survey: Survey, random: Random) -> tuple[list[Row], set[str]]:
    """Rows of a table of directions, all or those of one station, and what they are called."""
    entry = one_of(random, survey.entries("observations", "zenith_directions"))
    rows = survey.rows(entry)
    if random.random() < 0.5:
        station = one_of(random, sorted({row["station"] for row in rows}))
        return [row for row in rows if row["station"] == station], {station}
    return rows, {_label(entry)}


def circle_in_degrees(survey: Survey, random: Random) -> Planted:
    """Both circles read in degrees, where the project says gon."""
    rows, things = _circle(survey, random)
    scaled(rows, ("horizontal", "zenith"), 0.9)
    return Planted(("circle unit",), things)


def counterclockwise(survey: Survey, random: Random) -> Planted:
    """Horizontal circle that counts the other way."""
    rows, things = _circle(survey, random)
    for row in rows:
        row["horizontal"] = f"{(400.0 - float(row['horizontal'])) % 400.0:.4f}"
    return Planted(("circle sense",), things)


def elevation(survey: Survey, random: Random) -> Planted:
    """Elevations given as zenith angles; those of the second face, too."""
    rows, things = _circle(survey, random)
    for row in rows:
        row["zenith"] = f"{(100.0 - float(row['zenith'])) % 400.0:.4f}"
    return Planted(("elevation for zenith",), things)


def other_face(survey: Survey, random: Random) -> Planted:
    """Some rows of a station in which the horizontal circle is that of the other face, and the vertical one is not."""
    entry = one_of(random, survey.entries("observations", "zenith_directions"))
    rows = survey.rows(entry)
    counts = {row["station"]: 0 for row in rows}
    for row in rows:
        counts[row["station"]] += 1
    station = one_of(random, sorted(name for name, count in counts.items() if count >= 5))
    here = [row for row in rows if row["station"] == station]
    for k in random.choice(len(here), int(random.integers(1, len(here) // 2)), replace=False):
        here[k]["horizontal"] = f"{(float(here[k]['horizontal']) + 200.0) % 400.0:.4f}"
    return Planted(("face",), {station})


def slope_for_horizontal(survey: Survey, random: Random) -> Planted:
    """Slope distances in a table that says they are horizontal."""
    entry = _distances(survey, random)
    if not survey.entries("observations", "zenith_directions"):
        raise NotHereError
    entry["type"] = "horizontal_distance"
    return Planted(("slope distance",), {_label(entry)})


def levelling_sign(survey: Survey, random: Random) -> Planted:
    """A line of levels with the wrong sign."""
    row = one_of(random, survey.rows(one_of(random, survey.entries("observations", "height_difference"))))
    row["dz"] = f"{-float(row['dz']):.4f}"
    return Planted(("levelling sign",), {row["from"], row["to"]})
