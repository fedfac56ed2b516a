"""Small projects of every kind, each a function that writes it into a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.scenarios.small_projects import BLOCK, LEVELLING, block, table, write, write_block

SAMPLES = sorted((Path(__file__).parents[2] / "sample_projects").glob("*/project.yaml"))
TOTAL_STATION = """\
mor: 1
units: {length: ft, angle: dms}
axes: {xy: ne}
instruments:
  edm: {scale: {observed: 1, sigma: 5 ppm}, offset: {free: 0}, refraction: {observed: 0.13, sigma: 0.05}}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z], group: control}
  - {columns: [id, x, y, z, sigma], rows: [[B, 300, 40, 14, 0.01]], group: control}
  - {columns: [id, x, y, z], rows: [[C, 151, 260, 31], [D, -120, 190, 22]]}
stations:
  - {columns: [id, point, height], rows: [[SA, A, 5.1]]}
  - {columns: [id, x, y, z, height, sigma_height], rows: [[S, 50, 80, 11, 5.2, 0.01]], level: 0-0-5}
observations:
  - type: zenith_directions
    columns: [station, set, to, horizontal, zenith]
    rows: %s
    values: {sigma: 0-0-3}
    instrument: edm
    centring: {instrument: 0.7 mm, target: 1 mm}
  - type: distance
    columns: [from, to, distance]
    rows: %s
    values: {sigma: 2 mm}
    ppm: 2
    instrument: edm
  - type: parameter
    columns: [of, component, value, sigma]
    rows: [[point C, x, 151.01, 1 in], [station SA, height, 5.1, 0]]
"""


def dms(degrees: float) -> str:
    seconds = round(degrees % 360.0 * 3600.0, 2)
    return f"{int(seconds // 3600)}-{int(seconds % 3600 // 60):02d}-{seconds % 60:05.2f}"


def total_station() -> str:
    """Two stations in feet, degrees and north-east axes, one of them levelled with a σ and with two sets."""
    truth = {
        "A": (0, 0, 10),
        "B": (300, 40, 14),
        "C": (151, 260, 31),
        "D": (-120, 190, 22),
        "S": (50.4, 80.7, 10.8),
    }
    rows, distances = [], []
    for name, at, height, sets, targets in (
        ("SA", "A", 5.1, ("",), "BCD"),
        ("S", "S", 5.2, ("1", "2"), "ABCD"),
    ):
        for number, set_ in enumerate(sets):
            for target in targets:
                north, east, up = np.subtract(truth[target], truth[at]) - (0, 0, height)
                bearing = np.degrees(np.arctan2(east, north)) - 30.0 - 15.0 * number
                zenith = np.degrees(np.arctan2(np.hypot(north, east), up))
                shake = 0.0006 * np.sin(len(rows) * 2.0)
                rows.append([name, set_, target, dms(bearing + shake), dms(zenith - shake)])
        for target in targets:
            length = np.linalg.norm(np.subtract(truth[target], truth[at]) - (0, 0, height))
            distances.append([name, target, round(float(length) + 0.11 + 0.004 * np.cos(len(distances)), 4)])
    return TOTAL_STATION % (json.dumps(rows), json.dumps(distances))


def pixels(model: str, interior: str) -> str:
    """The block with coordinates from the upper left corner of a 3000 × 2000 image with pixels of 12 µm."""
    image = "{width: 3000, height: 2000, pixel: 0.012 mm}"
    camera = f"{{model: {model}, image: {image}, coordinates: corner, interior: {interior}}}"
    return BLOCK.replace("{interior: {c: 20}}", camera).replace("2 um", "0.2 px")


def write_pixels(folder: Path, model: str, interior: str) -> Path:
    rows = block(noise=0.002)
    rays = [[i, p, 1500.0 + x / 0.012, 1000.0 - y / 0.012] for i, p, x, y in rows.rays]
    return write_block(folder, pixels(model, interior), rows._replace(rays=rays))


def stereo(folder: Path) -> Path:
    """Image 1e3 follows image 010."""
    rows = block(noise=0.002)
    images = [[*row, "", ""] for row in rows.images]
    images[2] = ["1e3", "K", *[""] * 6, "010", "rig"]
    relative = "pairs:\n  - {columns: [id, bx, by, bz, omega, phi, kappa], rows: [[rig, %s]]}\nimages:"
    pose = ", ".join(str(round(x, 3)) for x in relative_pose(rows.images[0], rows.images[2]))
    text = BLOCK.replace("images:", relative % pose)
    return write_block(folder, text, rows, images=table("id,camera,x,y,z,omega,phi,kappa,leader,pair", images))


def relative_pose(first: list[Any], second: list[Any]) -> list[float]:
    """Base and ω φ κ of the second image in the system of the first."""
    D1, D2 = (matrix(row[5:]) for row in (first, second))
    R = (D2 @ D1.T).T
    angles = (np.arctan2(-R[1, 2], R[2, 2]), np.arcsin(R[0, 2]), np.arctan2(-R[0, 1], R[0, 0]))
    base = D1 @ np.subtract(second[2:5], first[2:5])
    return [*map(float, base), *(float(angle) * 200.0 / np.pi for angle in angles)]


def matrix(angles: list[float]) -> np.ndarray:
    o, p, k = np.array(angles) * np.pi / 200.0
    rx = np.array([[1, 0, 0], [0, np.cos(o), -np.sin(o)], [0, np.sin(o), np.cos(o)]])
    ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    rz = np.array([[np.cos(k), -np.sin(k), 0], [np.sin(k), np.cos(k), 0], [0, 0, 1]])
    return (rx @ ry @ rz).T


def local_system(folder: Path) -> Path:
    """Points measured with a tape in a system of their own, larger by 1/1000, beside the images."""
    rows = block(noise=0.002)
    local = [[name, *(float(1.001 * x + 0.0005 * np.sin(7 * x)) for x in xyz)] for name, *xyz in rows.points[:6]]
    entry = """\
systems:
  - {columns: [id, x, y, z, omega, phi, kappa, scale], rows: [[T, 0.1, 0, 0, 0.2, 0, 0.1, 1]]}
observations:
  - {type: local, columns: [point, x, y, z], rows: %s, values: {system: T, sigma: 0.001}}
"""
    return write_block(folder, BLOCK.replace("observations:\n", entry % json.dumps(local)), rows)


def known_block(folder: Path, text: str) -> Path:
    """The block with a scale bar and everything known about it in ``text``."""
    bar = np.linalg.norm(np.subtract(block().points[0][1:], block().points[11][1:]))
    columns = "columns: [from, to, distance, sigma]"
    entry = f"observations:\n  - {{type: distance, {columns}, rows: [[P0, P11, {bar}, 0.0001]]}}"
    return write_block(folder, text.replace("observations:", entry))


INTERIOR = "{interior: {c: 20}}"
KINDS = {
    "levelling": lambda folder: write(folder, LEVELLING),
    "free block": write_block,
    "scaled block": lambda folder: known_block(folder, BLOCK),
    "datum over a group": lambda folder: known_block(
        folder,
        BLOCK.replace("points.csv", "points.csv\n    group: cube").replace(
            "free", "{free: [cube], components: [x, y, z]}"
        ),
    ),
    "partly known datum": lambda folder: known_block(
        folder, BLOCK.replace("free", "{free: {xyz: [P0, P5], z: [P3, P8]}}")
    ),
    "observed poses": lambda folder: known_block(
        folder,
        BLOCK.replace(
            "images.csv", "images.csv\n    values: {sigma_x: 0.01, sigma_omega: 5 mgon, sigma_kappa: 5 mgon}"
        ),
    ),
    "fixed angles": lambda folder: known_block(folder, BLOCK.replace("images.csv", "images.csv\n    fixed: [omega]")),
    "calibration": lambda folder: known_block(
        folder,
        BLOCK.replace(INTERIOR, "{r0: 5, interior: {c: {observed: 20, sigma: 0.01}, xh: {free: 0}, A1: {free: 0}}}"),
    ),
    "eccentricity": lambda folder: known_block(
        folder,
        BLOCK.replace(INTERIOR, "{interior: {c: 20}, eccentricity: {rz: {observed: 0.1, sigma: 0.001}, rx: 0.02}}"),
    ),
    "image variant": lambda folder: known_block(
        folder,
        BLOCK.replace(INTERIOR, "{interior: {c: {free: 20}, xh: {free: 0}}, image_variant: {c: 5 um, xh: 0.002}}"),
    ),
    "pixels": lambda folder: write_pixels(folder, "mor", "{c: {free: 20}, A1: {free: 0}}"),
    "opencv": lambda folder: write_pixels(
        folder, "opencv", "{fx: 20, fy: 20, cx: {free: 18}, cy: {observed: 1000 px, sigma: 1 px}}"
    ),
    "fisheye": lambda folder: write_pixels(
        folder, "fisheye", "{fx: 20, fy: 20, cx: 18, cy: {free: 12}, k1: {free: 0.33}, k2: {free: 0.1}}"
    ),
    "stereo": stereo,
    "local system": local_system,
    "total station": lambda folder: write(folder, total_station()),
    **{f"sample {path.parent.name}": (lambda folder, path=path: path) for path in SAMPLES},
}
