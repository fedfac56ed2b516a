"""Local systems over points of the network, levelled or not, without start values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mor


@pytest.mark.parametrize("seed", range(16))
def test_set_ups_over_points_need_no_start_values(seed: int) -> None:
    """Coordinates in systems that stand over points; a levelled one keeps its angles, and two sights place it."""
    random = np.random.default_rng(seed)
    count, levelled, scaled = int(random.integers(3, 7)), bool(seed & 1), bool(seed & 2)
    places = random.uniform(-50.0, 50.0, (count, 3)) * [1.0, 1.0, 0.2]
    systems, rows = [], []
    for k in range(int(random.integers(count, 2 * count))):
        origin = k % count
        turn = [0.0, 0.0, random.uniform(-3.0, 3.0)] if levelled else random.uniform(-2.0, 2.0, 3)
        seen = random.choice([p for p in range(count) if p != origin], max(2, count - 2), replace=False)
        away = (places[seen] - places[origin]) @ Rotation.from_rotvec(turn).as_matrix().T
        away *= 1.0 if scaled else random.uniform(0.5, 2.0)
        away += random.normal(0.0, 0.001, away.shape)
        rows += [[f"S{k}", f"P{p}", *row] for p, row in zip(seen, away.tolist(), strict=True)]
        systems.append([f"S{k}", f"P{origin}", *[0.0, 0.0] * levelled, *[1.0] * scaled])
    known = ["omega", "phi"] * levelled + ["scale"] * scaled
    project = {
        "mor": 1,
        "datum": "free",
        "points": [{"columns": ["id"], "rows": [[f"P{p}"] for p in range(count)]}],
        "systems": [{"columns": ["id", "point", *known], "rows": systems, "fixed": known}],
        "observations": [
            {
                "type": "local",
                "columns": ["system", "point", "x", "y", "z"],
                "rows": rows,
                "values": {"sigma": "1 mm"},
            }
        ],
    }
    result = mor.adjust(project)
    assert result.sigma0 is not None
    assert 0.3 < result.sigma0 < 1.9
    found = np.array([[result.points.row(f"P{p}")[c] for c in "xyz"] for p in range(count)])
    lengths, wanted = (np.linalg.norm(X[:, None] - X, axis=2) for X in (found, places))
    factor = 1.0 if scaled else float((lengths * wanted).sum() / (lengths**2).sum())
    assert np.abs(factor * lengths - wanted).max() < 0.01
