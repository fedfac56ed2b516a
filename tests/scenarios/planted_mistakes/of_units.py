"""Mistakes with control and standard deviations: units, axes."""

from __future__ import annotations

import numpy as np

from tests.scenarios.planted_mistakes.of_names import control
from tests.scenarios.planted_mistakes.survey import Survey, scaled
from tests.scenarios.planted_mistakes.truth import Planted, one_of

Random = np.random.Generator


def control_unit(survey: Survey, random: Random) -> Planted:
    """Control in another unit: millimetres for metres, feet."""
    entry = one_of(random, control(survey))
    factor = random.choice([1000.0, 0.001, 0.3048, 1.0 / 0.3048])
    scaled(survey.rows(entry), ("x", "y", "z"), factor)
    return Planted(("control unit",), {entry.get("group", entry["file"])})


def axes_exchanged(survey: Survey, random: Random) -> Planted:
    """Northing and easting of the control exchanged."""
    entry = one_of(random, control(survey))
    for row in survey.rows(entry):
        row["x"], row["y"] = row["y"], row["x"]
    return Planted(("axes exchanged",), {entry.get("group", entry["file"])})


def sigma_unit(survey: Survey, random: Random) -> Planted:
    """Standard deviations of a table in another unit."""
    entries = [e for e in survey.entries("observations") if len(survey.rows(e)) >= 5]
    entry = one_of(random, entries)
    factor = float(random.choice([1000.0, 0.001]))
    if "sigma" in survey.rows(entry)[0]:
        scaled(survey.rows(entry), ("sigma",), factor)
    for key, text in entry.get("values", {}).items():
        if key.startswith("sigma"):
            number, _, unit = text.partition(" ")
            entry["values"][key] = f"{float(number) * factor:.6g} {unit}".strip()
    return Planted(("sigma unit",), {str(entry.get("name", entry["file"]))})
