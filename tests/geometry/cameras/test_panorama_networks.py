"""Panoramas in adjustments: a theodolite in their place gives the same, and one station calibrates the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.api.pipeline import read_network, solve_network
from mor.model.fisheye import PANORAMA
from mor.model.rotations import rotation_from_angles
from mor.project.document import read_yaml
from mor.quality.assessment import standard_deviations

GON = np.pi / 200.0
POINTS = np.random.default_rng(4).uniform([-9, -7, 0], [9, 7, 8], (14, 3))
PLACES = np.array([[1.0, 2.0, 1.6], [-4.0, -1.0, 1.5]])
NAMES = [component.name for component in PANORAMA.components]


def rows(table: list[list[object]]) -> str:
    cells = [", ".join(repr(float(c)) if isinstance(c, float) else str(c) for c in row) for row in table]
    return "[" + ", ".join(f"[{row}]" for row in cells) + "]"


def points() -> str:
    known = rows([[f"C{k}", *map(float, p)] for k, p in enumerate(POINTS[:5])])
    new = rows([[f"P{k}", *map(float, p.round(1))] for k, p in enumerate(POINTS[5:], 5)])
    return (
        f"mor: 1\npoints:\n  - {{columns: [id, x, y, z], fixed: [x, y, z], rows: {known}}}\n"
        f"  - {{columns: [id, x, y, z], rows: {new}}}\n"
    )


def solve(text: str):
    return solve_network(read_network(read_yaml(text, "project.yaml"), Path(".")))


def image(place: np.ndarray, angles: np.ndarray, **values: float) -> np.ndarray:
    """Image coordinates of all points without errors."""
    star = (POINTS - place) @ rotation_from_angles(angles[None])[0].T
    interior = np.tile([values.get(name, 0.0) for name in NAMES], (len(star), 1))
    near = np.zeros((len(star), 2))
    return PANORAMA.project(star, interior, np.zeros((len(star), 0)), near).xy


def test_an_ideal_panorama_adjusts_as_a_theodolite_does() -> None:
    sigma, seen, read = 1e-5, [], []
    for k, place in enumerate(PLACES):
        angles = np.array([100.5, 30.0 + 50.0 * k, -0.4]) * GON
        xy = image(place, angles, c=1.0)
        for n, (x, y) in enumerate(xy.tolist()):
            name, elevation = f"{'C' if n < 5 else 'P'}{n}", float(np.arctan(y))
            seen.append([f"I{k}", name, x, y, sigma, float(sigma / np.cos(elevation) ** 2)])
            read.append([f"S{k}", name, float((x % (2 * np.pi)) / GON), float(100.0 - elevation / GON)])
    panoramas = (
        points()
        + "cameras: {K: {model: panorama, unit: m, interior: {c: 1}}}\n"
        + f"images: [{{columns: [id, camera], rows: {rows([['I0', 'K'], ['I1', 'K']])}}}]\n"
        + "observations:\n  - {type: image, columns: [image, point, x, y, sigma_x, sigma_y],"
        + f" rows: {rows(seen)}}}\n"
    )
    theodolites = (
        points()
        + "stations: [{columns: [id, x, y, z], level: free, rows: [[S0, 1, 2, 1.5], [S1, -4, -1, 1.5]]}]\n"
        + "observations:\n  - {type: zenith_directions, columns: [station, to, horizontal, zenith],"
        + f" values: {{sigma: {float(sigma / GON)!r}}}, rows: {rows(read)}}}\n"
    )
    one, other = solve(panoramas), solve(theodolites)
    assert one.quality.redundancy == other.quality.redundancy
    blocks = [solved.network.things["point"].parts["position"] for solved in (one, other)]
    found = [solved.adjustment.values["point"][b] for solved, b in zip((one, other), blocks, strict=True)]
    sigmas = [
        standard_deviations(s.quality, "point")[b] / s.quality.sigma_factor
        for s, b in zip((one, other), blocks, strict=True)
    ]
    assert np.abs(found[0] - found[1]).max() < 1e-9
    assert np.abs(sigmas[0] - sigmas[1]).max() < 1e-9 * sigmas[1].max()


def test_one_station_calibrates_a_panorama() -> None:
    """Three turns from one tripod: where it stands, the attitudes and the camera are free, the object is known."""
    truth = {
        "c": 3500.0,
        "yh": 12.0,
        "rate": 3e-4,
        "ahead": 0.02,
        "aside": -0.01,
        "lean": 5e-4,
        "pitch": 2e-3,
    }
    random, seen = np.random.default_rng(6), []
    turns = [[100.3, 20.0, -0.2], [99.0, 120.0, 4.0], [104.0, -70.0, 1.0]]
    for k, angles in enumerate(turns):
        xy = image(PLACES[0], np.array(angles) * GON, **truth) + 0.2 * random.standard_normal((len(POINTS), 2))
        seen += [[f"I{k}", f"C{n}", float(x), float(y)] for n, (x, y) in enumerate(xy)]
    known = rows([[f"C{k}", *map(float, p)] for k, p in enumerate(POINTS)])
    free = ", ".join(f"{name}: {{free: {3480 if name == 'c' else 0}}}" for name in truth)
    text = (
        f"mor: 1\npoints: [{{columns: [id, x, y, z], fixed: [x, y, z], rows: {known}}}]\n"
        f"cameras: {{K: {{model: panorama, unit: px, interior: {{{free}}}}}}}\n"
        "images: [{columns: [id, camera], values: {position: tripod}, rows: [[I0, K], [I1, K], [I2, K]]}]\n"
        f"observations: [{{type: image, columns: [image, point, x, y], values: {{sigma: 0.2}}, rows: {rows(seen)}}}]\n"
    )
    solved = solve(text)
    assert solved.adjustment.outcome.value == "converged"
    found = solved.adjustment.values["interior/panorama"][0]
    sigma = standard_deviations(solved.quality, "interior/panorama")[0]
    for name, value in truth.items():
        k = NAMES.index(name)
        assert 0.0 < abs(found[k] - value) < 4.5 * sigma[k], name
    assert np.sqrt(solved.quality.omega / solved.quality.redundancy) < 1.5
