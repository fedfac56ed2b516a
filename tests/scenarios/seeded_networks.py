"""Well-determined networks of all kinds from a seed, as projects, at any scale of coordinates and of σ.

The observations are computed here, with formulas of their own, so that nothing is shared with the program.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mor.types import FloatArray

KINDS = (
    "levelling",
    "plane distances",
    "plane directions",
    "plane directions and distances",
    "distances",
    "polar",
    "vectors",
    "images",
    "images and distances",
)
RELATIVE = 2e-5
"""σ of the observations: of lengths as a part of the size of the network, of angles in radians."""
FOCAL = 20.0
"""Camera constant (mm)."""
_FIXED = {
    "levelling": ["x", "y"],
    **{key: ["z"] for key in ("plane distances", "plane directions", "plane directions and distances")},
}
OPEN = {
    "levelling": ("Z",),
    "plane distances": ("X", "Y", "RZ"),
    "plane directions": ("X", "Y", "RZ", "S"),
    "plane directions and distances": ("X", "Y", "RZ"),
    "distances": ("X", "Y", "Z", "RX", "RY", "RZ"),
    "polar": ("X", "Y", "Z", "RZ"),
    "vectors": ("X", "Y", "Z"),
    "images": ("X", "Y", "Z", "RX", "RY", "RZ", "S"),
    "images and distances": ("X", "Y", "Z", "RX", "RY", "RZ"),
}
"""Movements that the observations of a kind leave free."""


@dataclass(frozen=True)
class Drawn:
    """A network drawn from a seed."""

    kind: str
    names: tuple[str, ...]
    truth: FloatArray
    """(n, 3) true coordinates of the points."""
    given: FloatArray
    """(n, 3) coordinates that the project gives."""
    free: tuple[int, ...]
    """Components that are unknown."""
    size: float
    """Extent of the network, length unit."""
    rows: dict[str, list[list[Any]]]
    """Rows of observations without σ, by type."""
    images: list[list[Any]]
    """Rows of images."""
    sigma_scale: float

    def project(self, fixed: tuple[str, ...] = (), without: tuple[str, ...] = ()) -> dict[str, Any]:
        """Return the project: free over all points, or with some ``fixed``; those ``without`` have no coordinates."""
        held = _FIXED.get(self.kind, [])
        tables = []
        for name, xyz in zip(self.names, self.given.tolist(), strict=True):
            row = [name, *xyz]
            if name in without:
                row[1:] = [x if axis in held else None for axis, x in zip("xyz", xyz, strict=True)]
            tables.append((row, ["x", "y", "z"] if name in fixed else held))
        points = [
            {"columns": ["id", "x", "y", "z"], "rows": [row], **({"fixed": axes} if axes else {})}
            for row, axes in tables
        ]
        data: dict[str, Any] = {
            "mor": 1,
            "units": {"length": "m", "angle": "rad"},
            "points": points,
            "observations": [self._group(kind, rows) for kind, rows in self.rows.items()],
            "datum": "fixed" if fixed else "free",
        }
        if self.images:
            data["cameras"] = {"K": {"interior": {"c": FOCAL}}}
            data["images"] = [
                {"columns": ["id", "camera", "x", "y", "z", "omega", "phi", "kappa"], "rows": self.images}
            ]
        return data

    def sigmas(self) -> dict[str, float]:
        """Return the stated σ of every type, in the units of the project."""
        length, angle = RELATIVE * self.size, RELATIVE
        return {
            key: self.sigma_scale
            * (
                FOCAL * angle
                if key == "image"
                else angle
                if key == "zenith_directions" or key == "directions"
                else length
            )
            for key in self.rows
        }

    def _group(self, kind: str, rows: list[list[Any]]) -> dict[str, Any]:
        return {
            "type": kind,
            "columns": _COLUMNS[kind],
            "rows": rows,
            "values": {"sigma": repr(float(self.sigmas()[kind]))},
        }

    def movements(self, coordinates: FloatArray) -> FloatArray:
        """Return the free movements at some coordinates, shape (3n, d), about their centre."""
        x, y, z = (coordinates - coordinates.mean(axis=0)).T
        o, i = np.zeros_like(x), np.ones_like(x)
        every = {
            "X": (i, o, o),
            "Y": (o, i, o),
            "Z": (o, o, i),
            "RX": (o, -z, y),
            "RY": (z, o, -x),
            "RZ": (-y, x, o),
            "S": (x, y, z),
        }
        found = np.stack([np.stack(every[key], axis=1) for key in OPEN[self.kind]], axis=2)
        mask = np.isin(np.arange(3), self.free)
        moved: FloatArray = (found * mask[None, :, None]).reshape(-1, len(OPEN[self.kind]))
        return moved / np.linalg.norm(moved, axis=0)


_COLUMNS = {
    "height_difference": ["from", "to", "dz"],
    "distance": ["from", "to", "distance"],
    "horizontal_distance": ["from", "to", "distance"],
    "directions": ["station", "to", "horizontal"],
    "zenith_directions": ["station", "to", "horizontal", "zenith"],
    "vector": ["from", "to", "dx", "dy", "dz"],
    "image": ["image", "point", "x", "y"],
}


def drawn(
    kind: str,
    seed: int,
    size: float = 100.0,
    sigma_scale: float = 1.0,
    rough: float = 0.0,
    gross: float = 0.0,
    noise: float = 1.0,
) -> Drawn:
    """Return a network of a kind.

    Args:
        kind: one of ``KINDS``.
        seed: of everything that is random.
        size: extent of the network, m.
        sigma_scale: stated σ over true σ.
        rough: σ of the given coordinates as a part of the size.
        gross: size of one gross error in units of the true σ.
        noise: random errors in units of the true σ.
    """
    random = np.random.default_rng([seed, KINDS.index(kind)])
    plane = kind.startswith("plane") or kind == "levelling"
    n = int(random.integers(6, 10))
    truth = random.uniform(-0.5, 0.5, (n, 3)) * (1.0, 1.0, 0.4)
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False) + 0.3 * random.uniform(-1.0, 1.0, n)
    truth[:, 0] = 0.5 * np.cos(angle) * random.uniform(0.7, 1.0, n)
    truth[:, 1] = 0.5 * np.sin(angle) * random.uniform(0.7, 1.0, n)
    if kind.startswith("plane"):
        truth[:, 2] = 0.0
    truth *= size
    free = (2,) if kind == "levelling" else (0, 1) if plane else (0, 1, 2)
    names = tuple(f"P{k}" for k in range(n))
    given = truth.copy()
    given[:, free] += rough * size * random.standard_normal((n, len(free)))
    pairs = [(a, b) for a in range(n) for b in range(a + 1, n)]
    rows: dict[str, list[list[Any]]] = {}
    images: list[list[Any]] = []
    if kind == "levelling":
        rows["height_difference"] = [[names[a], names[b], truth[b, 2] - truth[a, 2]] for a, b in pairs]
    if kind == "vectors":
        rows["vector"] = [[names[a], names[b], *(truth[b] - truth[a])] for a, b in pairs]
    if kind in ("plane distances", "plane directions and distances"):
        rows["horizontal_distance"] = [
            [names[a], names[b], float(np.hypot(*(truth[b] - truth[a])[:2]))] for a, b in pairs
        ]
    if kind in ("distances", "images and distances"):
        rows["distance"] = [[names[a], names[b], float(np.linalg.norm(truth[b] - truth[a]))] for a, b in pairs]
    if kind.startswith("plane directions"):
        turn = random.uniform(0.0, 2.0 * np.pi, n)
        rows["directions"] = [
            [names[a], names[b], _bearing(truth[b] - truth[a]) - turn[a]] for a in range(n) for b in range(n) if a != b
        ]
    if kind == "polar":
        turn = random.uniform(0.0, 2.0 * np.pi, n)
        sights = [(a, b) for a in range(0, n, 2) for b in range(n) if a != b]
        rows["zenith_directions"] = [
            [names[a], names[b], _bearing(d) - turn[a], float(np.arccos(d[2] / np.linalg.norm(d)))]
            for a, b in sights
            for d in [truth[b] - truth[a]]
        ]
        rows["distance"] = [[names[a], names[b], float(np.linalg.norm(truth[b] - truth[a]))] for a, b in sights]
    if kind.startswith("images"):
        rows["image"] = []
        for k in range(4):
            around = 0.5 * np.pi * k + 0.2 * random.standard_normal()
            centre = size * np.array([1.6 * np.cos(around), 1.6 * np.sin(around), 0.4 + 0.2 * k])
            D, angles = _pose(centre, 0.7 * k)
            start = np.array([*centre, *angles])
            start[:3] += rough * size * random.standard_normal(3)
            images.append([f"I{k}", "K", *start.tolist()])
            star = (truth - centre) @ D.T
            xy = -FOCAL * star[:, :2] / star[:, 2:]
            rows["image"] += [[f"I{k}", name, *values] for name, values in zip(names, xy.tolist(), strict=True)]
    plan = Drawn(kind, names, truth, given, free, size, rows, images, 1.0)
    for key, sigma in plan.sigmas().items():
        first = 2
        for row in rows[key]:
            row[first:] = [float(x + noise * sigma * random.standard_normal()) for x in row[first:]]
    if gross:
        key = list(rows)[-1]
        row = rows[key][int(random.integers(len(rows[key])))]
        row[2] = float(row[2] + gross * plan.sigmas()[key])
    return Drawn(kind, names, truth, given, free, size, rows, images, sigma_scale)


def _bearing(d: FloatArray) -> float:
    return float(np.arctan2(d[0], d[1]))


def _pose(centre: FloatArray, roll: float) -> tuple[FloatArray, list[float]]:
    """D of a camera at ``centre`` that looks at the origin, and its ω, φ, κ (rad), D = (Rx Ry Rz)ᵀ."""
    backwards = centre / np.linalg.norm(centre)
    right = np.cross([0.0, 0.0, 1.0], backwards)
    right /= np.linalg.norm(right)
    D = np.stack([right, np.cross(backwards, right), backwards])
    c, s = np.cos(roll), np.sin(roll)
    D = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ D
    R = D.T
    return D, [
        float(np.arctan2(-R[1, 2], R[2, 2])),
        float(np.arcsin(R[0, 2])),
        float(np.arctan2(-R[0, 1], R[0, 0])),
    ]
