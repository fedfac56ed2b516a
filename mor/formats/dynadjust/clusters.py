"""GNSS baselines and positions with their covariances: alone, or in clusters with one matrix."""

from __future__ import annotations

import numpy as np

from mor.arrays import FloatArray
from mor.formats.draft import Row, number
from mor.formats.dynadjust.lines import NAMES, NUMBER, OFF, VALUES, Collected, Measurements
from mor.formats.fieldbook.book import sexagesimal

COUNTED = 10_000
"""Most baselines or positions of one cluster: its covariance matrix is full."""
VECTOR = ("dx", "dy", "dz")
PAIRS = (("dx", "dx"), ("dx", "dy"), ("dx", "dz"), ("dy", "dy"), ("dy", "dz"), ("dz", "dz"))
GEODETIC = ("latitude", "longitude", "height")
VECTORS = "vectors"
"""Where the baselines that are in no cluster are collected."""


def read_cluster(found: Measurements, code: str) -> None:
    """A baseline, or a cluster of baselines or positions with one covariance matrix."""
    first, text = found.at + 1, found.lines[found.at]
    off = text[1:2] == "*"
    count = 1
    if code in "XY":
        word = text[NAMES[2]].strip()
        if not word.isdecimal() or not 0 < int(word) <= COUNTED:
            raise ValueError(f"found {word!r}, expected the number of members of the cluster")
        count = int(word)
    factor = _factor(text)
    form = text[NAMES[1]].strip().upper()
    if code == "Y" and form not in ("XYZ", "LLH"):
        raise ValueError(f"found positions in {form!r}, expected XYZ or LLH")
    rows: list[Row] = []
    Q = np.zeros((3 * count, 3 * count))
    for k in range(count):
        text = found.lines[found.at] if found.at < len(found.lines) else ""
        if text[:1] != code:
            raise ValueError(
                f"expected {count} members of the cluster that begins in line {first}, found {k}"
            )
        names, line = found.stations_of(text, 2 if code in "GX" else 1), found.at + 1
        found.at += 1
        rows.append(Row([*names, *_values(found, Q, k, count - k - 1)], line))
    if off:
        found.skip(OFF, found.at)
        return
    words = found.lines[first - 1][VALUES:].split()
    found.frames.setdefault(" ".join(words[4:6]), first)
    put_cluster(found, code, form, rows, Q * factor)


def put_cluster(found: Collected, code: str, form: str, rows: list[Row], Q: FloatArray) -> None:
    """Put a baseline (G), or a cluster of baselines (X) or positions (Y, in XYZ or LLH), into the draft.

    ``Q``: (3n, 3n), m², its lower triangle; of LLH in radians and metres.
    """
    whole = np.tril(Q) + np.tril(Q, -1).T
    if not np.isfinite(whole).all() or np.linalg.eigvalsh(whole)[0] <= 0.0:
        found.draft.problem("the covariance matrix is not positive definite", rows[0].line)
    elif code == "Y" and form == "LLH":
        _put_geodetic(found, rows, whole)
    else:
        _put_geocentric(found, code, rows, whole)


def _values(found: Measurements, Q: FloatArray, k: int, behind: int) -> list[str]:
    """Three values; their covariances, and those with the members behind, go into the lower triangle of a matrix."""
    values = []
    a = 3 * k
    for row in range(3):
        numbers = found.numbers()
        if len(numbers) != row + 2:
            found.at -= 1
            raise ValueError(f"found {len(numbers)} numbers, expected a value and {row + 1} covariances")
        values.append(repr(numbers[0]))
        Q[a + row, a : a + row + 1] = numbers[1:]
    for other in range(behind):
        b = 3 * (k + 1 + other)
        for row in range(3):
            numbers = found.numbers()
            if len(numbers) != 3:
                found.at -= 1
                raise ValueError(f"found {len(numbers)} numbers, expected 3 covariances")
            Q[b : b + 3, a + row] = numbers
    return values


def _factor(text: str) -> float:
    """Scale of a covariance matrix. Raises ``ValueError`` for scales in latitude, longitude, height."""
    return scale_of([number(word) for word in NUMBER.findall(text[VALUES : VALUES + 40])])


def scale_of(scales: list[float]) -> float:
    """Scale of a matrix, of its own and those in latitude, longitude, height, which are refused (``ValueError``)."""
    if len(scales) != 4 or min(scales) <= 0.0:
        said = " ".join(f"{scale:g}" for scale in scales)
        raise ValueError(f"found {said!r}, expected four scales above 0")
    if any(scale != 1.0 for scale in scales[1:]):
        raise ValueError("scales of the covariances in latitude, longitude and height are not followed")
    return scales[0]


def _put_geocentric(found: Collected, code: str, rows: list[Row], Q: FloatArray) -> None:
    if code == "G":
        covariances = [repr(float(Q[VECTOR.index(a), VECTOR.index(b)])) for a, b in PAIRS]
        found.tables.setdefault(VECTORS, []).append(Row([*rows[0].cells, *covariances], rows[0].line))
        return
    names = ("from", "to", *VECTOR) if code == "X" else ("point", "x", "y", "z")
    type_ = "gnss_vector" if code == "X" else "gnss_position"
    found.clusters.setdefault((type_, names), []).append((rows, Q))


def _put_geodetic(found: Collected, rows: list[Row], Q: FloatArray) -> None:
    """Positions in latitude, longitude, height above the geoid; covariances in radians and metres."""
    units = np.tile([np.degrees(1.0), np.degrees(1.0), 1.0], len(rows))
    turned = []
    for name, latitude, longitude, height in (row.cells for row in rows):
        N = found.geoid[str(name)][0] if str(name) in found.geoid else 0.0
        degrees = (repr(sexagesimal(str(word))) for word in (latitude, longitude))
        turned.append([name, *degrees, repr(float(str(height)) + N)])
    cells = [Row(list(row), given.line) for row, given in zip(turned, rows, strict=True)]
    found.clusters.setdefault(("geodetic_position", ("point", *GEODETIC)), []).append(
        (cells, Q * np.outer(units, units))
    )


def put_vectors(found: Collected) -> None:
    """Put clusters of one kind into a table, and the baselines that are in no cluster."""
    for (type_, columns), clusters in found.clusters.items():
        found.draft.correlated(columns, clusters, type_)
    rows = found.tables.pop(VECTORS, [])
    if rows:
        columns = ("from", "to", *VECTOR, *(f"cov_{a}_{b}" for a, b in PAIRS))
        found.draft.table("observations", columns, rows, type="gnss_vector")
