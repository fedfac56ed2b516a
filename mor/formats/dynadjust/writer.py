"""A network on the earth as DynAdjust's files: ``.stn``, ``.msr`` and, where heights are above a geoid, ``.geo``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mor.formats.dynadjust.outgoing import (
    EPOCH,
    Cluster,
    Directions,
    Line,
    Measurement,
    fixed,
    outgoing,
    parts_of,
    seconds_of,
    sexagesimal_text,
)
from mor.formats.dynadjust.terrestrial import KINDS
from mor.formats.networks.on_earth import EarthPoints
from mor.formats.written import Written
from mor.project.file.nodes import Document


def write_dynadjust(document: Document, folder: Path, target: Path) -> Written:
    """The files. Raises :class:`InputError` for networks that are not on GDA94 or GDA2020, and what DNA cannot say."""
    found = outgoing(document, folder, target)
    stem = target.with_suffix("") if target.suffix.lower() in (".stn", ".msr") else target
    head = f"!#=DNA 3.01 {{}}    {EPOCH}{found.frame:>14}    {EPOCH}{{:>10}}"
    measured = [line for one in found.measured for line in _measurement_lines(one, found.frame)]
    files = {
        ".stn": [head.format("STN", len(found.stations.ids)), *_station_lines(found.stations, found.above)],
        ".msr": [head.format("MSR", len(found.measured)), *measured],
    }
    if found.above:
        files[".geo"] = geoid_lines(found.stations)
    texts = {
        stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()
    }
    return Written(texts, found.notes)


def station_heights(stations: EarthPoints, above: bool) -> list[float]:
    """Heights of stations as the files have them, m."""
    heights = stations.geodetic[:, 2] - (np.nan_to_num(stations.geoid) if above else 0.0)
    return [float(height) for height in heights]


def constraints(held: list[bool]) -> str:
    """DynAdjust's letters (latitude, longitude, height) of what is held of east, north, up."""
    return "".join("FC"[int(held[k])] for k in (1, 0, 2))


def _station_lines(stations: EarthPoints, above: bool) -> Iterator[str]:
    heights = station_heights(stations, above)
    for name, place, height, held in zip(
        stations.ids, stations.geodetic, heights, stations.held.tolist(), strict=True
    ):
        latitude, longitude = (sexagesimal_text(value) for value in place[:2].tolist())
        yield f"{name:<20}{constraints(held)} LLH {latitude:>20}{longitude:>20}{height:>20.9f}"


def geoid_lines(stations: EarthPoints) -> list[str]:
    """The file of geoid heights (m) and deflections (arc seconds)."""
    lines = ["# DNA geoid file."]
    for name, N, (xi, eta) in zip(
        stations.ids, np.nan_to_num(stations.geoid).tolist(), stations.deflections.tolist(), strict=True
    ):
        angles = "".join(f"{fixed(seconds_of(angle), 3):>19}" for angle in (xi, eta))
        lines.append(f"{name:<20}{fixed(N, 3):>20}{angles}")
    return lines


def _measurement_lines(one: Measurement, frame: str) -> Iterator[str]:
    if isinstance(one, Cluster):
        yield from _cluster_lines(one, frame)
    elif isinstance(one, Directions):
        yield from _direction_lines(one)
    else:
        yield _plain_line(one)


def _plain_line(one: Line) -> str:
    head = f"{one.code} " + "".join(f"{name:<20}" for name in one.names)
    if KINDS[one.code].angle:
        text = _angle(one.value, one.sigma)
    else:
        text = f"{fixed(one.value, 4):>14} {fixed(one.sigma, 3):>22}"
    if one.heights is not None:
        text += "".join(f" {fixed(height, 3):>6}" for height in one.heights)
    return f"{head:<62}{text}"


def _angle(value: float, sigma: float) -> str:
    degrees, minutes, seconds, sign = parts_of(value, 8)
    return f"{f'{sign}{degrees}':>17} {minutes:02d} {fixed(seconds, 4):0>7} {fixed(seconds_of(sigma), 3):>8}"


def _direction_lines(one: Directions) -> Iterator[str]:
    """The station with its first target and the number of the others, then those."""
    angles = [_angle(value, sigma) for value, sigma in zip(one.values, one.sigmas, strict=True)]
    yield f"D {one.station:<20}{one.targets[0]:<20}{len(angles) - 1:<20}{angles[0]}"
    for target, angle in zip(one.targets[1:], angles[1:], strict=True):
        yield f"D {'':<40}{target:<20}{angle}"


def _cluster_lines(one: Cluster, frame: str) -> Iterator[str]:
    scales, count = "   1.00      1.00      1.00      1.00", len(one.names)
    for k, (names, values) in enumerate(zip(one.names, one.values, strict=True)):
        second = one.form if one.code == "Y" else names[1]
        head = f"{one.code} {names[0]:<20}{second:<20}" + (f"{count:<20}" if one.code != "G" else "")
        yield f"{head:<62}{scales}{frame:>20}{EPOCH:>20}" if k == 0 else f"{head[:42]:<62}"
        for i in range(3):
            covariances = "".join(f"{v:20.13e}" for v in one.Q[3 * k + i, 3 * k : 3 * k + i + 1])
            yield f"{'':<62}{values[i]:>20}{covariances}"
        for other in range(k + 1, count):
            for i in range(3):
                block = one.Q[3 * k + i, 3 * other : 3 * other + 3]
                yield f"{'':<82}" + "".join(f"{v:20.13e}" for v in block)
