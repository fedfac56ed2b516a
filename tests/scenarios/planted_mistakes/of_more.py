"""Mistakes with whole set-ups and images, single control points, units and standard deviations of tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.scenarios.planted_mistakes.of_instruments import _distances, _label, _metres
from tests.scenarios.planted_mistakes.of_names import control
from tests.scenarios.planted_mistakes.survey import Row, Survey, exchanged, scaled
from tests.scenarios.planted_mistakes.truth import NotHereError, Planted, one_of

Random = np.random.Generator


def set_ups_exchanged(survey: Survey, random: Random) -> Planted:
    """Two stations stand over each other's points."""
    rows = [row for entry in survey.entries("stations") for row in survey.rows(entry) if row.get("point")]
    if len(rows) < 2:
        raise NotHereError
    one, other = random.choice(rows, 2, replace=False)
    exchanged(one, other, ("point",))
    return Planted(("set-ups exchanged",), {one["id"], other["id"]})


def station_exchanged_in_directions(survey: Survey, random: Random) -> Planted:
    """All directions of two stations are booked under each other's name."""
    rows = survey.rows(one_of(random, survey.entries("observations", "zenith_directions")))
    names = sorted({row["station"] for row in rows})
    if len(names) < 2:
        raise NotHereError
    one, other = (str(name) for name in random.choice(names, 2, replace=False))
    for row in rows:
        row["station"] = {one: other, other: one}.get(row["station"], row["station"])
    return Planted(("set-ups exchanged",), {one, other})


def images_exchanged(survey: Survey, random: Random) -> Planted:
    """The coordinates of two images are in the file under each other's name; their poses are given."""
    entry = one_of(random, survey.entries("observations", "image"))
    images = {row["id"]: row for table in survey.entries("images") for row in survey.rows(table)}
    known = [name for name, row in images.items() if row.get("x")]
    names = sorted({row["image"] for row in survey.rows(entry)} & set(known))
    if len(names) < 3:
        raise NotHereError
    one, other = (str(name) for name in random.choice(names, 2, replace=False))
    for row in survey.rows(entry):
        row["image"] = {one: other, other: one}.get(row["image"], row["image"])
    return Planted(("images exchanged",), {one, other})


def other_camera(survey: Survey, random: Random) -> Planted:
    """An image was taken by another camera of the project."""
    cameras = sorted(survey.project.get("cameras", {}))
    rows = [row for entry in survey.entries("images") for row in survey.rows(entry) if row.get("camera")]
    if len(cameras) < 2 or not rows:
        raise NotHereError
    row = one_of(random, rows)
    row["camera"] = one_of(random, [name for name in cameras if name != row["camera"]])
    return Planted(("camera of images",), {row["id"]})


def control_moved(survey: Survey, random: Random) -> Planted:
    """A control point has a wrong coordinate."""
    row = one_of(random, survey.rows(one_of(random, control(survey))))
    axis = str(random.choice(["x", "y", "z"]))
    places = [float(row[a]) for entry in control(survey) for row in survey.rows(entry) for a in "xyz"]
    amount = random.choice([-1.0, 1.0]) * random.uniform(0.02, 0.1) * float(np.ptp(places))
    row[axis] = f"{float(row[axis]) + amount:.6f}"
    return Planted(("control moved",), {row["id"]})


def distance_unit(survey: Survey, random: Random) -> Planted:
    """Distances in feet or centimetres."""
    entry = _distances(survey, random)
    factor = float(random.choice([0.3048, 0.01]))
    scaled(survey.rows(entry), ("distance",), 1.0 / factor)
    return Planted(("table unit",), {_label(entry)})


def levelling_unit(survey: Survey, random: Random) -> Planted:
    """Height differences in feet or millimetres."""
    entry = one_of(random, survey.entries("observations", "height_difference"))
    factor = float(random.choice([0.3048, 0.001]))
    scaled(survey.rows(entry), ("dz",), 1.0 / factor)
    return Planted(("table unit",), {_label(entry)})


def orientation_changed(survey: Survey, random: Random) -> Planted:
    """The circle was turned in the middle of a set."""
    rows = survey.rows(one_of(random, survey.entries("observations", "zenith_directions")))
    counts: dict[str, int] = {}
    for row in rows:
        counts[row["station"]] = counts.get(row["station"], 0) + 1
    station = one_of(random, sorted(name for name, count in counts.items() if count >= 8))
    here = [row for row in rows if row["station"] == station]
    turn = random.choice([-1.0, 1.0]) * random.uniform(0.05, 20.0)
    for row in here[int(random.integers(3, len(here) - 3)) :]:
        row["horizontal"] = f"{(float(row['horizontal']) + turn) % 400.0:.4f}"
    return Planted(("orientation changed",), {station})


def sigma_factor(survey: Survey, random: Random) -> Planted:
    """Standard deviations of a table that are too small by a factor."""
    entries = [e for e in survey.entries("observations") if len(survey.rows(e)) >= 20]
    entry = one_of(random, entries)
    if len(survey.project["observations"]) < 2:
        raise NotHereError
    factor = float(random.uniform(3.0, 10.0))
    if "sigma" in survey.rows(entry)[0]:
        scaled(survey.rows(entry), ("sigma",), 1.0 / factor)
    for key, text in entry.get("values", {}).items():
        if key.startswith("sigma"):
            number, _, unit = text.partition(" ")
            entry["values"][key] = f"{float(number) / factor:.6g} {unit}".strip()
    return Planted(("sigma of a table",), {_label(entry)})


def pixel_origin(survey: Survey, random: Random) -> Planted:
    """The principal point is wrong, where it is fixed or observed."""
    camera = str(one_of(random, sorted(survey.project.get("cameras", {}))))
    interior = survey.project["cameras"][camera].get("interior", {})
    held = [key for key in ("xh", "yh") if key in interior and _held(interior[key])]
    key, amount = one_of(random, held), float(random.choice([-1.0, 1.0]) * random.uniform(0.3, 2.0))
    value = interior[key]
    if isinstance(value, dict):
        value["observed"] = f"{float(value['observed']) + amount:.5f}"
    else:
        interior[key] = f"{float(value) + amount:.5f}"
    return Planted(("pixel origin",), {camera})


def _held(value: Any) -> bool:
    return "observed" in value if isinstance(value, dict) else True


def two_levelling_signs(survey: Survey, random: Random) -> Planted:
    """Two lines of levels with the wrong sign."""
    rows = survey.rows(one_of(random, survey.entries("observations", "height_difference")))
    chosen: list[Row] = list(random.choice(rows, 2, replace=False))
    for row in chosen:
        row["dz"] = f"{-float(row['dz']):.4f}"
    return Planted(("levelling sign",), {row[end] for row in chosen for end in ("from", "to")})


def instrument_height_in_centimetres(survey: Survey, random: Random) -> Planted:
    """The height of an instrument in centimetres."""
    stations = [row for entry in survey.entries("stations") for row in survey.rows(entry)]
    row = one_of(random, [row for row in stations if row.get("height")])
    row["height"] = f"{100.0 * float(row['height']):.4f}"
    return Planted(("instrument height",), {row["id"]})


def target_height_sign(survey: Survey, random: Random) -> Planted:
    """The height of a target with the wrong sign, at one station."""
    entries = [e for e in survey.entries("observations") if "to_height" in survey.rows(e)[0]]
    rows = [
        r for e in entries for r in survey.rows(e) if r["to_height"] and float(r["to_height"]) > 0.05 * _metres(survey)
    ]
    chosen = one_of(random, rows)
    station = chosen.get("station", chosen.get("from"))
    for row in rows:
        if row["to"] == chosen["to"] and row.get("station", row.get("from")) == station:
            row["to_height"] = f"{-float(row['to_height']):.4f}"
    return Planted(("target height",), {chosen["to"]})
