"""Points of a network on the earth: coordinates in its reference system, heights, σ east, north, up."""

from __future__ import annotations

import numpy as np

from mor.quality.solved import Solved
from mor.report.edge import angle_unit
from mor.report.layout import DIGITS, fixed, heading, table
from mor.report.places.table import ANGULAR, place_table
from mor.report.words.datum import datum_name
from mor.report.words.language import ENGLISH, Words

SHOWN = 2000
"""Points a text report lists; the full table stands beside it."""
_ANGULAR_DIGITS = {"gon": 9, "deg": 9, "rad": 11, "mrad": 8, "mgon": 6}
"""Decimals of latitudes and longitudes: a tenth of a millimetre."""


def section(solved: Solved, words: Words = ENGLISH, shown: int = SHOWN) -> str:
    """One line for each point, and what the coordinates refer to; nothing if the network is nowhere on the earth."""
    world, frame = solved.network.world, place_table(solved)
    if world is None or frame.height == 0:
        return ""
    unit, angle = solved.network.project.units.length, angle_unit(solved)
    d = DIGITS[unit]
    own = list(world.system.coordinates)
    heights = [name for name in ("ellipsoidal_height", "orthometric_height") if frame[name].count()]
    columns = [name for name in own if name != "height"] + heights + ["seast", "snorth", "sup"]
    headers = ["point", *(f"{_said(name)} [{angle if name in ANGULAR else unit}]" for name in columns)]
    digits = [_ANGULAR_DIGITS[angle] if name in ANGULAR else d for name in columns]
    rows = [
        [row["id"], *(fixed(row[name], k) for name, k in zip(columns, digits, strict=True))]
        for row in frame.head(shown).to_dicts()
    ]
    datum = datum_name(solved.adjustment.problem.datum.name, words)
    title = words("Points in {system} (datum: {datum})", system=world.system.name, datum=datum)
    lines = [heading(title), table(headers, rows, words=words)]
    if frame.height > shown:
        more = words(
            "{count:more point is|more points are} in the table of places.", count=frame.height - shown
        )
        lines.append(more)
    latitude, longitude = np.degrees([world.horizon.latitude, world.horizon.longitude])
    lines.append(
        words(
            "sigma: east, north, up in the horizon of each point. X, Y, Z elsewhere in this report are east, north, up "
            "in the horizon of the middle of the network, latitude {latitude}°, longitude {longitude}°, height 0.",
            latitude=words.number(f"{latitude:.4f}"),
            longitude=words.number(f"{longitude:.4f}"),
        )
    )
    return "\n".join(lines)


def _said(name: str) -> str:
    return {
        "ellipsoidal_height": "h",
        "orthometric_height": "H",
        "seast": "sE",
        "snorth": "sN",
        "sup": "sU",
    }.get(name, name)
