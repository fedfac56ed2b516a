"""Time of one adjustment of many epochs, from the file to tables and pages.

    python benchmarks/epochs.py
    python benchmarks/epochs.py velocity --points 1000 --epochs 50

Every point has GNSS coordinates in every epoch, and a height difference to the next one: 199 950 observations. Some
points stand still, the others move by the model.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
import polars as pl
from measure import run

_ROOT = Path(__file__).resolve().parent.parent
_MODELS = {
    "velocity": ["velocity"],
    "seasonal": ["velocity", "seasonal"],
    "epochs": ["epochs"],
}
_STILL = 50
"""Points without a motion, which tie the epochs."""
_SIGMA = {"position": 0.003, "height": 0.001}


def write(folder: Path, models: list[str], points: int, epochs: int) -> Path:
    """A project of such epochs; returns its file."""
    random = np.random.default_rng(5)
    names = np.array([f"P{k}" for k in range(points)])
    place = np.column_stack([random.uniform(0, 2000, (points, 2)), random.uniform(0, 100, points)])
    velocity = np.where(np.arange(points)[:, None] < _STILL, 0.0, random.normal(0, 0.004, (points, 3)))
    month = np.arange(epochs) * 2
    times = np.array([f"{2012 + m // 12}-{m % 12 + 1:02d}" for m in month])
    at = place[None] + (month / 12.0)[:, None, None] * velocity[None]
    seen = at + random.normal(0, _SIGMA["position"], at.shape)
    rise = np.diff(at[:, :, 2], axis=1)
    rise = rise + random.normal(0, _SIGMA["height"], rise.shape)
    pl.DataFrame({"id": names, **dict(zip("xyz", seen[0].T, strict=True))}).write_csv(folder / "points.csv")
    pl.DataFrame(
        {"epoch": np.repeat(times, points), "point": np.tile(names, epochs)}
        | {axis: seen[:, :, k].ravel() for k, axis in enumerate("xyz")}
    ).write_csv(folder / "positions.csv")
    pl.DataFrame(
        {
            "epoch": np.repeat(times, points - 1),
            "from": np.tile(names[:-1], epochs),
            "to": np.tile(names[1:], epochs),
            "dz": rise.ravel(),
        }
    ).write_csv(folder / "levelling.csv")
    moved = ", ".join(names[_STILL:].tolist())
    motions = "".join(f"  - {{model: {model}, points: [{moved}]}}\n" for model in models)
    path = folder / "project.yaml"
    path.write_text(
        f"mor: 1\nunits: {{length: m}}\nmotions:\n{motions}points: [{{file: points.csv}}]\nobservations:\n"
        f"  - {{type: coordinates, file: positions.csv, values: {{sigma: {_SIGMA['position']} m}}}}\n"
        f"  - {{type: height_difference, file: levelling.csv, values: {{sigma: {_SIGMA['height']} m}}}}\n",
        encoding="utf-8",
    )
    return path


def main() -> None:
    """Write, adjust, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", choices=[*_MODELS, []])
    parser.add_argument("--points", type=int, default=1_000)
    parser.add_argument("--epochs", type=int, default=50)
    given = parser.parse_args()
    for name in given.models or _MODELS:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            path = write(folder, _MODELS[name], given.points, given.epochs)
            command = [sys.executable, "-m", "mor", "adjust", path, "-o", folder / "out", "--quiet"]
            begin = perf_counter()
            done = run(command, folder, {"PYTHONPATH": str(_ROOT)})
            wall = perf_counter() - begin
            if done.code:
                raise SystemExit(done.errors)
            results = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
            told = {key: results[key] for key in ("observations", "unknowns")}
            print(f"{name}: {wall:.1f} s, CPU {done.seconds.cpu:.1f} s, {done.peak / 2**20:.0f} MB, {told}")


if __name__ == "__main__":
    main()
