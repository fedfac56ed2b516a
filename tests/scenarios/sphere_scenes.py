"""Networks measured on a sphere: exact geometry in three dimensions, without code of mor.

A point is the place that one reaches from the origin along a great circle, in a given direction and over a given arc,
raised by its height along its own vertical. Instruments stand above it along the same vertical. Zenith angles are
angles against that vertical, with the bending of a circular ray; directions are read in the plane across it.
"""

from __future__ import annotations

import numpy as np

RADIUS = 6_371_000.0
SIGMA_DIRECTION, SIGMA_ZENITH, SIGMA_DISTANCE, SIGMA_LEVEL = 3e-4, 3e-4, 0.001, 0.0005
"""gon, gon, m + 1 ppm, m for each √km."""
GON = 200.0 / np.pi


class Place:
    """A mark on the sphere: plan coordinates, height, position in space and vertical."""

    def __init__(self, name, x, y, height, base):
        self.name, self.x, self.y, self.height = name, x, y, height
        angle, azimuth = np.hypot(x, y) / RADIUS, np.arctan2(x, y)
        self.up = np.array([np.sin(angle) * np.sin(azimuth), np.sin(angle) * np.cos(azimuth), np.cos(angle)])
        self.position = (RADIUS + height - base) * self.up

    def above(self, height):
        return self.position + height * self.up


def sight(station, target, instrument, reflector, turn, k):
    """Direction, zenith angle (radians) and slope distance; ``turn`` is that of the circle."""
    vector = target.above(reflector) - station.above(instrument)
    length = np.linalg.norm(vector)
    first = np.cross([0.3, 0.8, 0.1], station.up)  # a zero of the circle that nobody knows
    first /= np.linalg.norm(first)
    right = np.cross(first, station.up)
    across = np.hypot(vector @ first, vector @ right)
    zenith = np.arctan2(across, vector @ station.up) - k * across / (2.0 * RADIUS)
    return (np.arctan2(vector @ right, vector @ first) + turn) % (2.0 * np.pi), zenith, length


def network(seed, k=0.13, free=False, reciprocal=None, noise=1.0):
    """Points, stations and rows of a network of 100 m to 10 km; all rows in gon and metres."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(2.0, 4.0)
    base = float(np.round(rng.uniform(0.0, 2500.0)))
    count = int(rng.integers(5, 8))
    shift = np.round(rng.uniform(-1e4, 1e4, 2))
    spread = rng.uniform(-0.5, 0.5, (count, 2)) * size
    heights = base + rng.uniform(-0.05, 0.05, count) * size
    points = [Place(f"P{i}", *spread[i], heights[i], base) for i in range(count)]
    reciprocal = bool(rng.integers(2)) if reciprocal is None else reciprocal
    directions, zeniths, distances, levels = [], [], [], []
    up, over, turns = rng.uniform(1.4, 1.7, count), rng.uniform(1.3, 2.0, count), rng.uniform(0, 6, count)
    for i, station in enumerate(points):
        for j, target in enumerate(points):
            if i == j or (not reciprocal and i > j):
                continue
            direction, zenith, length = sight(station, target, up[i], over[j], turns[i], k)
            e = rng.normal(size=3) * noise
            sigma = np.hypot(SIGMA_DISTANCE, 1e-6 * length)
            names = [station.name, target.name]
            directions.append([*names, direction * GON + e[0] * SIGMA_DIRECTION, over[j]])
            zeniths.append([*names, zenith * GON + e[1] * SIGMA_ZENITH, up[i], over[j]])
            distances.append([*names, length + e[2] * sigma, sigma, up[i], over[j]])
    for i in range(count - 2):
        a, b = points[i], points[i + 2]
        sigma = SIGMA_LEVEL * np.sqrt(max(np.linalg.norm(a.position - b.position), 10.0) / 1000.0)
        levels.append([a.name, b.name, b.height - a.height + rng.normal() * noise * sigma, sigma])
    with_levels = bool(rng.integers(2))
    held = count if free else 2
    where = {p.name: (p.x + shift[0], p.y + shift[1], p.height) for p in points}
    origin = {"x": shift[0], "y": shift[1], "z": base}
    tables = [{"columns": ["id", "x", "y", "z"], "rows": [[n, *where[n]] for n in list(where)[:held]]}]
    if not free:
        tables[0]["fixed"] = ["x", "y", "z"]
        tables.append({"columns": ["id"], "rows": [[n] for n in list(where)[held:]]})
    seen = sorted({row[0] for row in directions})
    project = {
        "mor": 1,
        "units": {"length": "m", "angle": "gon"},
        "curvature": {"origin": origin},
        "points": tables,
        "stations": [
            {
                "columns": ["id", "point", "height"],
                "rows": [[f"S{n}", n, up[int(n[1:])]] for n in seen],
            }
        ],
        "instruments": {"ts": {"refraction": k}},
        "datum": "free" if free else "fixed",
        "observations": [
            {
                "type": "directions",
                "columns": ["station", "to", "horizontal", "to_height"],
                "rows": [[f"S{row[0]}", *row[1:]] for row in directions],
                "values": {"sigma": f"{SIGMA_DIRECTION} gon"},
            },
            {
                "type": "zenith_angle",
                "columns": ["from", "to", "zenith_angle", "from_height", "to_height"],
                "rows": zeniths,
                "values": {"sigma": f"{SIGMA_ZENITH} gon"},
                "instrument": "ts",
            },
            {
                "type": "distance",
                "columns": ["from", "to", "distance", "sigma", "from_height", "to_height"],
                "rows": distances,
            },
        ],
        "settings": {"sigma": "apriori"},
    }
    if with_levels:
        project["observations"].append(
            {"type": "height_difference", "columns": ["from", "to", "dz", "sigma"], "rows": levels}
        )
    return project, where, size
