"""A free network on the earth without instruments or systems, whose turn is hardly determined."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from pyproj import Transformer
from small_projects import mor, write

GEOCENTRIC = Transformer.from_crs("EPSG:4937", "EPSG:4936", always_xy=True)
UTM = Transformer.from_crs("EPSG:4258", "EPSG:25832", always_xy=True)
SIZE, COUNT = 1e4, 6


def test_slopes_and_levelled_heights_are_no_crash(tmp_path: Path) -> None:
    """How such a network is turned is known badly, or not, and said."""
    random = np.random.default_rng(1)
    latitude = 49.0 + random.uniform(-0.5, 0.5, COUNT) * SIZE / 111e3
    longitude = 10.0 + random.uniform(-0.5, 0.5, COUNT) * SIZE / 73e3
    height = random.uniform(300.0, 600.0, COUNT)
    X = np.stack(GEOCENTRIC.transform(longitude, latitude, height), axis=1)
    pairs = [(i, j) for i in range(COUNT) for j in range(i)]
    slopes = [np.linalg.norm(X[j] - X[i]) + random.normal(0.0, 0.002) for i, j in pairs]
    rises = [height[j] - height[i] + random.normal(0.0, 0.001) for i, j in pairs]
    places = np.stack([*UTM.transform(longitude, latitude), height], axis=1).tolist()
    project = {
        "mor": 1,
        "units": {"length": "m"},
        "world": {"crs": "EPSG:25832", "heights": "ellipsoidal"},
        "points": [
            {
                "columns": ["id", "east", "north", "height"],
                "rows": [[f"P{k}", *place] for k, place in enumerate(places)],
            }
        ],
        "observations": [
            {
                "type": type_,
                "columns": ["from", "to", column, "sigma"],
                "rows": [[f"P{i}", f"P{j}", v, s] for (i, j), v in zip(pairs, values, strict=True)],
            }
            for type_, column, values, s in (
                ("distance", "distance", slopes, 0.002),
                ("ellipsoidal_height_difference", "dz", rises, 0.001),
            )
        ],
        "datum": "free",
    }
    told = mor("adjust", write(tmp_path, json.dumps(project)), "-o", tmp_path / "out", "--no-html")
    assert told.code in (0, 4)
    assert "internal error" not in told.err + told.out
    assert "turn of the whole network" in told.err + told.out
