"""CPU time of a large network of GNSS vectors, from the file to the tables of results.

python benchmarks/gnss.py                            20 000 vectors between 5 000 points, in both forms
python benchmarks/gnss.py sessions --session 10

``columns`` is one table with the covariance matrix of each vector in its row; ``sessions`` are clusters (X) of
DynAdjust's measurement file, all vectors of a session, from one point to those nearest to it, with one matrix.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
from measure import run
from pyproj import Transformer
from scipy.spatial import cKDTree

from mor.types import FloatArray, IntArray

_ROOT = Path(__file__).resolve().parent.parent
_WIDTH = 3.0
"""Extent of the network in degrees."""


def network(points: int, vectors: int, each: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """Latitudes, longitudes, heights (n, 3), geocentric coordinates (n, 3), and ends (m, 2) of vectors.

    ``each``: vectors that begin in one point.
    """
    random = np.random.default_rng(1)
    geodetic = np.column_stack(
        [
            -36.0 + random.uniform(0, _WIDTH, points),
            146.0 + random.uniform(0, _WIDTH, points),
            random.uniform(0, 900, points),
        ]
    )
    places = Transformer.from_crs("EPSG:7843", "EPSG:7842", always_xy=True)
    geocentric = np.stack(places.transform(geodetic[:, 1], geodetic[:, 0], geodetic[:, 2]), axis=1)
    from_ = np.arange(vectors // each) * (points * each) // vectors
    near = cKDTree(geocentric).query(geocentric[from_], each + 1)[1][:, 1:]
    ends = np.stack([np.repeat(from_, each), near.ravel()], axis=1)
    return geodetic, geocentric, ends


def factors(count: int, size: int) -> FloatArray:
    """(count, size, size) factors of covariance matrices, σ some 3 mm, all correlated."""
    random = np.random.default_rng(2)
    return 0.003 * (np.eye(size) + 0.3 * np.tril(random.normal(0.0, 1.0 / np.sqrt(size), (count, size, size))))


def write_columns(folder: Path, points: int, vectors: int) -> Path:
    """A project with one table of vectors; returns its file."""
    geodetic, geocentric, ends = network(points, vectors, vectors // points)
    factor = factors(len(ends), 3)
    errors = np.einsum("nij,nj->ni", factor, np.random.default_rng(3).standard_normal((len(ends), 3)))
    values = geocentric[ends[:, 1]] - geocentric[ends[:, 0]] + errors
    C = factor @ factor.transpose(0, 2, 1)
    names = np.array([f"S{k}" for k in range(points)])
    axes = ["dx", "dy", "dz"]
    table = {"from": names[ends[:, 0]], "to": names[ends[:, 1]]} | {a: values[:, k] for k, a in enumerate(axes)}
    for i in range(3):
        table |= {f"cov_{axes[i]}_{axes[j]}": C[:, i, j] for j in range(i, 3)}
    pl.DataFrame(table).write_csv(folder / "vectors.csv")
    at = pl.DataFrame(
        {"id": names, **{name: geodetic[:, k] for k, name in enumerate(("latitude", "longitude", "height"))}}
    )
    at[:1].write_csv(folder / "held.csv")
    at[1:].write_csv(folder / "points.csv")
    path = folder / "project.yaml"
    path.write_text(
        "mor: 1\nunits: {length: m, angle: deg}\nworld: {crs: EPSG:7843}\n"
        "points: [{file: held.csv, fixed: [x, y, z]}, {file: points.csv}]\n"
        "observations: [{type: gnss_vector, file: vectors.csv}]\n",
        encoding="utf-8",
    )
    return path


def write_sessions(folder: Path, points: int, vectors: int, session: int) -> Path:
    """DynAdjust's files with clusters of so many vectors; returns the measurement file."""
    _, geocentric, ends = network(points, vectors, session)
    lines = [f"!#=DNA 3.01 MSR    13.12.2018       GDA2020    01.01.2020  {len(ends) // session:8d}"]
    random = np.random.default_rng(3)
    for first, L in zip(range(0, len(ends), session), factors(len(ends) // session, 3 * session), strict=False):
        C, error = L @ L.T, (L @ random.standard_normal(3 * session)).reshape(-1, 3)
        for k, (a, b) in enumerate(ends[first : first + session].tolist()):
            lines.append(
                f"X S{a:<18d} S{b:<18d} {f'{session:d}' if k == 0 else '':<19} 1.00      1.00      1.00      1.00"
                "            GDA2020          01.01.2020"
            )
            d = geocentric[b] - geocentric[a] + error[k]
            for i in range(3):
                row = "".join(f"{C[3 * k + i, 3 * k + j]:20.13e}" for j in range(i + 1))
                lines.append(f"{'':62}{d[i]:20.4f}{row}")
            for other in range(k + 1, session):
                for i in range(3):
                    row = "".join(f"{C[3 * k + i, 3 * other + j]:20.13e}" for j in range(3))
                    lines.append(f"{'':82}{row}")
    path = folder / "network.msr"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    stations = [f"!#=DNA 3.01 STN    13.12.2018       GDA2020    01.01.2020  {points:8d}"]
    for k, place in enumerate(geocentric):
        held = "CCC" if k == 0 else "FFF"
        stations.append(f"{f'S{k}':<20}{held} XYZ " + "".join(f"{c:20.4f}" for c in place))
    (folder / "network.stn").write_text("\n".join(stations) + "\n", encoding="utf-8")
    return path


def main() -> None:
    """Write, adjust, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("form", nargs="*", choices=["columns", "sessions", []])
    parser.add_argument("--points", type=int, default=5_000)
    parser.add_argument("--vectors", type=int, default=20_000)
    parser.add_argument("--session", type=int, default=5)
    given = parser.parse_args()
    for form in given.form or ["columns", "sessions"]:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            if form == "columns":
                path = write_columns(folder, given.points, given.vectors)
            else:
                path = write_sessions(folder, given.points, given.vectors, given.session)
            command = [
                sys.executable,
                "-m",
                "mor",
                "adjust",
                path,
                "-o",
                folder / "out",
                "--no-html",
                "--quiet",
            ]
            done = run(command, folder, {"PYTHONPATH": str(_ROOT)})
            if done.code:
                raise SystemExit(done.errors)
            results = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
            told = {key: results[key] for key in ("observations", "unknowns", "sigma0") if key in results}
            print(f"{form}: CPU {done.seconds.cpu:.2f} s, {done.peak / 2**20:.0f} MB, {told or list(results)}")


if __name__ == "__main__":
    main()
