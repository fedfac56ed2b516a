"""Mistakes in names: exchanged, mis-numbered, booked at another station."""

from __future__ import annotations

import numpy as np

from tests.scenarios.planted_mistakes.survey import Row, Survey, exchanged
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted, one_of

Random = np.random.Generator


def _image_rows(survey: Survey, random: Random, least: int = 6) -> tuple[str, list[Row]]:
    """An image and its rows, or those of a station where there are no images."""
    rows = survey.rows(one_of(random, survey.entries("observations", "image")))
    images = sorted({row["image"] for row in rows})
    chosen = one_of(random, [i for i in images if sum(row["image"] == i for row in rows) >= least])
    return chosen, [row for row in rows if row["image"] == chosen]


def _observed(survey: Survey, least: int) -> set[str]:
    """Points seen in so many images or more."""
    names = [row["point"] for entry in survey.entries("observations", "image") for row in survey.rows(entry)]
    return {name for name in names if names.count(name) >= least}


def exchanged_in_image(survey: Survey, random: Random) -> Planted:
    """Two names exchanged in one image."""
    image, rows = _image_rows(survey, random)
    known = _observed(survey, 3)
    one, other = random.choice([row for row in rows if row["point"] in known], 2, replace=False)
    exchanged(one, other, ("point",))
    return Planted(("names exchanged",), {image, one["point"], other["point"]})


def misnumbered_in_image(survey: Survey, random: Random) -> Planted:
    """A point of an image has the name of another one, which is not seen in it."""
    image, rows = _image_rows(survey, random)
    known = _observed(survey, 3)
    row = one_of(random, [row for row in rows if row["point"] in known])
    right = row["point"]
    row["point"] = one_of(random, sorted(known - {row["point"] for row in rows}))
    return Planted(("wrong name",), {image, right, row["point"]})


def exchanged_control(survey: Survey, random: Random) -> Planted:
    """The coordinates of two control points exchanged."""
    rows = survey.rows(one_of(random, control(survey)))
    one, other = random.choice(rows, 2, replace=False)
    exchanged(one, other, ("x", "y", "z"))
    return Planted(("control exchanged",), {one["id"], other["id"]})


def control(survey: Survey) -> list[dict]:
    """Tables of points whose coordinates are all observed."""
    keys = [{*entry.get("values", {})} for entry in survey.entries("points")]
    full = [{"sigma"} <= k or {"sigma_x", "sigma_y"} <= k for k in keys]
    found = [entry for entry, is_full in zip(survey.entries("points"), full, strict=True) if is_full]
    return [entry for entry in found if len(survey.rows(entry)) >= 3]


def misnumbered_at_station(survey: Survey, random: Random) -> Planted:
    """A target of a station has the name of another one, in one row of directions."""
    rows = survey.rows(one_of(random, survey.entries("observations", "zenith_directions")))
    row = one_of(random, rows)
    here = {other["to"] for other in rows if other["station"] == row["station"]}
    others = sorted({other["to"] for other in rows} - here - {row["station"]})
    right, row["to"] = row["to"], one_of(random, others)
    return Planted(("wrong name",), {row["station"], right, row["to"]})


def exchanged_at_station(survey: Survey, random: Random) -> Planted:
    """Two names exchanged at a station, in the directions."""
    rows = survey.rows(one_of(random, survey.entries("observations", "zenith_directions")))
    station = one_of(random, sorted({row["station"] for row in rows}))
    here = [row for row in rows if row["station"] == station]
    one, other = random.choice(here, 2, replace=False)
    if one["to"] == other["to"]:
        raise NotHereError
    columns = ("to", "to_height") if "to_height" in one else ("to",)
    exchanged(one, other, columns)
    return Planted(("names exchanged",), {station, one["to"], other["to"]})


def wrong_station(survey: Survey, random: Random) -> Planted:
    """A row of directions or distances booked at another station."""
    entries = survey.entries("observations", "zenith_directions") + survey.entries("observations", "distance")
    entry = one_of(random, [e for e in entries if len({row[_begin(row)] for row in survey.rows(e)}) > 1])
    rows = survey.rows(entry)
    row = one_of(random, rows)
    key = _begin(row)
    others = sorted({other[key] for other in rows} - {row[key], row["to"]})
    right, row[key] = row[key], one_of(random, others)
    return Planted(("wrong station", "wrong name"), {right, row[key], row["to"]})


def _begin(row: Row) -> str:
    return "station" if "station" in row else "from"
