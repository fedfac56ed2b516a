"""Instruments and stereo pairs of a project."""

from __future__ import annotations

from typing import Any

import numpy as np

from mor.arrays import IntArray
from mor.parameters.kinds import BASE, ECCENTRICITY, GNSS_FRAME, ROTATION, TIME_OFFSET
from mor.project.file.model_instruments import Instrument
from mor.project.file.nodes import Path
from mor.project.network.entities import entities
from mor.project.network.poses import Seen, check_unique
from mor.project.network.reading import Reading
from mor.project.tables.statuses import component_columns, component_rows, settings
from mor.project.tables.tables import Column, read_table


def read_instruments(reading: Reading) -> None:
    """Distance meters, refraction coefficients, frames of GNSS solutions; where antennas and inertial systems are."""
    ids, meters, refractions, frames = [], [], [], []
    along: dict[str, list[int]] = {part: [] for part in _ALONG}
    for name, instrument in reading.project.instruments.items():
        ids.append(name)
        reading.shop.begin(f"instrument {name}")
        meters.append(_instrument(reading, name, instrument, "distance meter", ("scale", "offset")))
        refractions.append(_instrument(reading, name, instrument, "refraction", ("refraction",)))
        frames.append(_frame(reading, name, instrument))
        for part, blocks in along.items():
            blocks.append(_along(reading, name, instrument, part))
    reading.shop.things["instrument"] = entities(
        ids,
        {
            "distance meter": np.array(meters, dtype=np.int64),
            "refraction": np.array(refractions, dtype=np.int64),
            GNSS_FRAME.key: np.array(frames, dtype=np.int64),
            **{part: np.array(blocks, dtype=np.int64) for part, blocks in along.items()},
        },
    )


_ALONG = {"lever arm": ECCENTRICITY, "boresight": ROTATION, TIME_OFFSET.key: TIME_OFFSET}
"""What instruments along a trajectory have, and the kinds of its blocks."""


def _along(reading: Reading, name: str, instrument: Instrument, part: str) -> int:
    """Block of one of these, -1 where nothing is said of it."""
    key, kind = part.replace(" ", "_"), _ALONG[part]
    said = getattr(instrument, key)
    if not said:
        return -1
    given = said if isinstance(said, dict) else {key: said}
    path: Path = ("instruments", name, key) if isinstance(said, dict) else ("instruments", name)
    row = settings(given, kind.components, reading.edge, reading.at(*path), path, reading.problems)
    own = name if kind is TIME_OFFSET else f"{part} of {name}"
    return int(reading.shop.store(kind.key).add([own], *row)[0])


def _instrument(
    reading: Reading, name: str, instrument: Instrument, kind: str, components: tuple[str, ...]
) -> int:
    given = {key: getattr(instrument, key) for key in components if getattr(instrument, key) is not None}
    if not given:
        return 0
    return _add(reading, name, kind, given, ("instruments", name))


def _frame(reading: Reading, name: str, instrument: Instrument) -> int:
    if not instrument.frame:
        return 0
    return _add(reading, name, GNSS_FRAME.key, dict(instrument.frame), ("instruments", name, "frame"))


def _add(reading: Reading, name: str, kind: str, given: dict[str, Any], path: Path) -> int:
    store = reading.shop.store(kind)
    row = settings(given, store.kind.components, reading.edge, reading.at(*path), path, reading.problems)
    scales = [
        values[0, store.kind.names.index("scale")] for values in (row.values, row.start) if "scale" in given
    ]
    if any(scale <= 0.0 for scale in scales):
        reading.problems.append(reading.at(*path).problem("scale: expected a number above 0", "scale"))
    return int(store.add([name], *row)[0])


def read_pairs(reading: Reading) -> None:
    """Relative orientations of stereo pairs: base in the leading image's system, and rotation."""
    ids: list[str] = []
    base: list[IntArray] = []
    rotation: list[IntArray] = []
    seen: list[Seen] = []
    for k, table in enumerate(reading.project.pairs):
        reading.begin("pairs", k, table)
        columns = [
            Column("id", required=True),
            *component_columns((*BASE.components, *ROTATION.components), reading.edge),
        ]
        rows = read_table(table, columns, reading.at("pairs", k), reading.problems)
        if rows is None:
            continue
        names = rows.text("id")
        check_unique("pair", names, rows, seen, reading.problems)
        labels = [f"pair {name}" for name in names]
        base.append(
            reading.shop.store("base").add(
                labels, *component_rows(rows, BASE.components, table.fixed, reading.problems)
            )
        )
        rotation.append(
            reading.shop.store("rotation").add(
                labels, *component_rows(rows, ROTATION.components, table.fixed, reading.problems)
            )
        )
        ids += names
        reading.end("pair", len(names))
    none = [np.zeros(0, dtype=np.int64)]
    reading.shop.things["pair"] = entities(
        ids, {"base": np.concatenate(base or none), "rotation": np.concatenate(rotation or none)}
    )
