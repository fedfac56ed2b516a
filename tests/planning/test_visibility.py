"""Visibility, against a ray-casting that shares nothing with the program: volumes of tetrahedra, one by one."""

from __future__ import annotations

import json
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.model.polygons import face_normals, faces_of, hidden, triangles, triangulated
from tests.scenarios.small_projects import mor
from tests.selection import slow_after

GON = np.pi / 200.0


def volume(a, b, c, d):
    """Six times the signed volume of a tetrahedron."""
    return float(np.dot(np.cross(b - a, c - a), d - a))


def crosses(origin, target, corner, clearance=0.0):
    """A sight goes through a triangle where the ends are on either side, and the edges all pass it on one side."""
    a, b, c = corner
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal)
    before, behind = float((origin - a) @ normal), float((target - a) @ normal)
    if min(abs(before), abs(behind)) <= clearance or before * behind > 0.0:
        return False
    sides = [volume(origin, target, p, q) for p, q in ((a, b), (b, c), (c, a))]
    return all(s >= 0.0 for s in sides) or all(s <= 0.0 for s in sides)


@pytest.mark.parametrize("seed", range(12))
def test_sights_through_random_triangles(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 90))
    corners = rng.normal(size=(count, 1, 3)) * 3.0 + rng.normal(size=(count, 3, 3))
    if seed % 3 == 0:  # walls along the axes, sights in their planes' directions
        corners[:, :, seed % 2] = np.round(corners[:, :1, seed % 2])
    origins, targets = rng.normal(size=(2, 80, 3)) * 5.0
    if seed % 4 == 0:
        origins[:, 1] = targets[:, 1]
    found = hidden(origins, targets, triangles(corners), 0.01)
    expected = [any(crosses(o, t, c, 0.01) for c in corners) for o, t in zip(origins, targets, strict=True)]
    assert found.tolist() == expected
    assert sum(expected) > 0 or count < 20


def test_nothing_is_seen_through_the_joint_of_two_faces():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    corners = square[triangulated(square)]
    part = np.linspace(0.05, 0.95, 19)
    on_diagonals = np.concatenate([np.stack([part, part], axis=1), np.stack([part, 1 - part], axis=1)])
    targets = np.column_stack([on_diagonals, -np.ones(len(on_diagonals))])
    assert hidden(targets + np.array([0.0, 0, 2]), targets, triangles(corners), 1e-3).all()


@pytest.mark.parametrize("seed", range(8))
def test_a_polygon_of_any_shape_has_its_area(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 11))
    flat = (rng.uniform(0.2, 2.0, 11) * np.stack([np.cos(angle), np.sin(angle)])).T
    corners = np.column_stack([flat, flat @ rng.normal(size=2)])
    slope = np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
    slope /= abs(np.linalg.det([flat[1] - flat[0], flat[2] - flat[0]]))
    shoelace = 0.5 * sum(np.linalg.det([p, q]) for p, q in pairwise([*flat, flat[0]]))
    found = corners[triangulated(corners)]
    area = 0.5 * np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=1)
    assert float(area.sum()) == pytest.approx(abs(shoelace) * slope)


def test_points_have_the_normal_of_the_face_they_are_on():
    cube = triangles(_cube(np.zeros(3), 1.0))
    points = np.array([[0.5, 0.5, 1.0005], [1.0, 0.2, 0.3], [0.5, 0.5, 0.5]])
    faces = faces_of(points, cube, 1e-3)
    assert cube.normals[faces[:2]].tolist() == [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    assert faces[2] == -1


def _cube(low, size):
    """(12, 3, 3) faces that turn to the left seen from outside."""
    corner = low + size * np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [corner[list(f)] for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return np.array(faces)


def test_the_cube_of_these_tests_looks_outwards():
    corners = _cube(np.zeros(3), 2.0)
    assert (np.einsum("ki,ki->k", face_normals(corners), corners.mean(axis=1) - 1.0) > 0.0).all()


# A hall: targets on a block in the middle and on a wall, cameras around, a screen that hides some of them.

SCREEN = [
    [2.0, -4.0, 0.0],
    [2.0, -4.0, 3.0],
    [2.0, -1.0, 3.0],
    [2.0, -1.0, 1.0],
    [2.0, 1.0, 1.0],
    [2.0, 1.0, 0.0],
]
PROJECT = """mor: 1
cameras:
  K:
    unit: mm
    image: {width: 6000, height: 4000, pixel: 4 um}
    interior: {c: {free: 20}, xh: {free: 0.1}, yh: {free: -0.1}}
points:
  - {file: targets.csv, group: on the block}
  - {columns: [id, x, y, z], rows: [[W1, -6, -2, 1], [W2, -6, 0, 1.5], [W3, -6, 2, 2]]}
images:
  - file: images.csv
visibility:
  clearance: 2 mm
  surfaces:
    - {name: block, file: MESH, unit: UNIT}
    - {name: screen, polygon: SCREEN}
  normals:
    - {points: [on the block], surface: block}
    - {points: ["W*"], direction: [2, 0, 0]}
observations:
  - type: image
    visible: {nearest: 1 m, farthest: 9 m, incidence: 70 gon, border: 0.3 mm}
    values: {sigma: 0.5 um}
  - type: distance
    columns: [from, to]
    values: {sigma: 0.2 mm}
    rows: [[W1, W3]]
datum: free
settings: {undetermined: leave_out}
"""


def _hall(folder: Path, mesh: str = "block.ply", unit: str = "mm", project: str = PROJECT):
    """The project and what it is of: targets with normals, poses, triangles."""
    rng = np.random.default_rng(5)
    corners = _cube(np.array([-0.8, -0.7, 0.0]), 1.5)
    face = rng.integers(0, 12, 90)
    weight = rng.dirichlet(np.ones(3), 90)
    X = np.einsum("kc,kci->ki", weight, corners[face])
    rows = [f"T{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(X.tolist())]
    poses = []
    for k in range(24):
        azimuth, height = 2.0 * np.pi * k / 24, (0.5, 1.7, 2.9)[k % 3]
        at = np.array([5.0 * np.cos(azimuth), 5.0 * np.sin(azimuth), height])
        poses.append((at, _angles(at, np.array([0.0, 0.0, 0.7]), roll=100.0 * (k % 2))))
    (folder / "targets.csv").write_text("\n".join(["id,x,y,z", *rows]) + "\n")
    lines = [",".join([f"I{k}", "K", *map(repr, [*at.tolist(), *a.tolist()])]) for k, (at, a) in enumerate(poses)]
    (folder / "images.csv").write_text("\n".join(["id,camera,x,y,z,omega,phi,kappa", *lines]) + "\n")
    _write_mesh(folder / mesh, corners * 1000.0)
    text = project.replace("MESH", mesh).replace("UNIT", unit).replace("SCREEN", json.dumps(SCREEN))
    (folder / "project.yaml").write_text(text)
    normals = np.array([np.cross(c[1] - c[0], c[2] - c[0]) for c in corners[face]])
    walls = np.array([[-6.0, -2, 1], [-6, 0, 1.5], [-6, 2, 2]])
    names = [*(f"T{k}" for k in range(90)), "W1", "W2", "W3"]
    screen = np.array(SCREEN)
    cut = [screen[[0, 1, 2]], screen[[0, 2, 3]], screen[[0, 3, 4]], screen[[0, 4, 5]]]
    normals = np.concatenate([normals, np.tile([1.0, 0, 0], (3, 1))])
    return names, np.concatenate([X, walls]), normals, poses, np.concatenate([corners, cut])


def _angles(at, towards, roll):
    """ω, φ, κ in gon of a camera that looks along −z towards a place: D = Rκ Rφ Rω, written out from its rows."""
    z = (at - towards) / np.linalg.norm(at - towards)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    t = roll * GON
    x, y = np.cos(t) * x + np.sin(t) * y, -np.sin(t) * x + np.cos(t) * y
    phi = np.arcsin(z[0])
    omega = np.arctan2(-z[1], z[2])
    kappa = np.arctan2(-y[0], x[0])
    found = np.array([omega, phi, kappa])
    assert _rotation(found) == pytest.approx(np.array([x, y, z]))
    return found / GON


def _rotation(angles):
    """(3, 3) rows are the axes of the image in the object system, after elementary turns by −κ, −φ, −ω."""
    o, p, k = angles
    turn_x = np.array([[1, 0, 0], [0, np.cos(o), np.sin(o)], [0, -np.sin(o), np.cos(o)]])
    turn_y = np.array([[np.cos(p), 0, -np.sin(p)], [0, 1, 0], [np.sin(p), 0, np.cos(p)]])
    turn_z = np.array([[np.cos(k), np.sin(k), 0], [-np.sin(k), np.cos(k), 0], [0, 0, 1]])
    return turn_z @ turn_y @ turn_x


def _write_mesh(path, corners):
    vertices = corners.reshape(-1, 3)
    count = len(corners)
    if path.suffix == ".obj":
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        lines += [f"f {3 * k + 1}/1 {3 * k + 2}/1 {3 * k + 3}/1" for k in range(count)]
        path.write_text("# a block\n" + "\n".join(lines) + "\n")
        return
    form = {"block.ply": "binary_little_endian", "big.ply": "binary_big_endian", "text.ply": "ascii"}[path.name]
    head = [
        *("ply", f"format {form} 1.0", f"element vertex {3 * count}", "property double x"),
        *("property double y", "property uchar red", "property double z", f"element face {count}"),
        *("property list uchar int vertex_indices", "end_header", ""),
    ]
    order = ">" if "big" in form else "<"
    if form == "ascii":
        body = "".join(f"{x!r} {y!r} 7 {z!r}\n" for x, y, z in vertices.tolist())
        body += "".join(f"3 {3 * k} {3 * k + 1} {3 * k + 2}\n" for k in range(count))
        path.write_bytes("\n".join(head).encode() + body.encode())
        return
    parts = [struct.pack(f"{order}ddBd", x, y, 7, z) for x, y, z in vertices.tolist()]
    parts += [struct.pack(f"{order}Biii", 3, 3 * k, 3 * k + 1, 3 * k + 2) for k in range(count)]
    path.write_bytes("\n".join(head).encode() + b"".join(parts))


def _expected(names, X, normals, poses, corners):
    """Pairs that see each other, and how many fail first at range, format, incidence and the surfaces."""
    seen, counts = set(), [0] * 5
    for k, (at, angles) in enumerate(poses):
        D = _rotation(angles * GON)
        for name, point, normal in zip(names, X, normals, strict=True):
            u, v, w = D @ (point - at)
            x, y = 0.1 - 20.0 * u / w, -0.1 - 20.0 * v / w
            slant = (at - point) @ normal / np.linalg.norm(at - point) / np.linalg.norm(normal)
            if not 1.0 <= np.linalg.norm(point - at) <= 9.0:
                counts[1] += 1
            elif w >= 0.0 or abs(x) > 12.0 - 0.3 or abs(y) > 8.0 - 0.3:
                counts[2] += 1
            elif slant < np.cos(70.0 * GON):
                counts[3] += 1
            elif any(crosses(at, point, c, 0.002) for c in corners):
                counts[4] += 1
            else:
                counts[0] += 1
                seen.add((f"I{k}", name))
    return seen, counts


@pytest.mark.parametrize("mesh", slow_after(1, ["block.ply", "big.ply", "text.ply", "block.obj"]))
def test_a_hall_against_ray_casting(tmp_path, mesh):
    scene = _hall(tmp_path, mesh)
    seen, counts = _expected(*scene)
    assert min(counts) > 20  # every reason has its say
    run = mor("design", tmp_path / "project.yaml")
    assert run.code == 0, run.err
    data = json.loads((tmp_path / "project.design" / "design.json").read_text(encoding="utf-8"))
    assert [data["visible"][0][key] for key in ("seen", "range", "frame", "incidence", "hidden")] == counts
    run = mor("simulate", tmp_path / "project.yaml", "-o", tmp_path / "trial")
    assert run.code == 0, run.err
    rows = pl.read_csv(tmp_path / "trial" / "observations_1_image.csv")
    assert set(zip(rows["image"], rows["point"], strict=True)) == seen
    assert rows.height == len(seen)
    names, X, _, poses, _ = scene
    for image, point, x, y in rows.iter_rows():
        at, angles = poses[int(image[1:])]
        u, v, w = _rotation(angles * GON) @ (X[names.index(point)] - at)
        assert (x, y) == pytest.approx((0.1 - 20.0 * u / w, -0.1 - 20.0 * v / w), abs=0.005)
    run = mor("adjust", tmp_path / "trial" / "project.yaml")
    assert run.code == 0, run.err


def test_a_longer_lens_sees_less(tmp_path):
    text = PROJECT + "variants:\n  long: {cameras: {K: {interior: {c: 40}}}}\n"
    _hall(tmp_path, project=text)
    assert mor("design", tmp_path / "project.yaml", "--lang", "de").code == 0
    report = (tmp_path / "project.design" / "design.txt").read_text(encoding="utf-8")
    assert "Sichtbarkeit" in report
    data = json.loads((tmp_path / "project.design" / "design.json").read_text(encoding="utf-8"))
    plain, longer = data["variants"]
    assert longer["observations"] < plain["observations"]
    assert longer["outside_format"] == 0


STATIONS = """mor: 1
points:
  - columns: [id, x, y, z]
    rows: [[A, 0, 0, 0], [B, 40, 0, 0], [C, 20, 30, 0], [T1, 20, 10, 2], [T2, 21, 12, 25], [T3, 90, 90, 1]]
stations:
  - {columns: [id, point, height], rows: [[SA, A, 1.5], [SB, B, 1.6]]}
visibility:
  surfaces:
    - polygon: [[10, -5, 0], [10, 5, 0], [10, 5, 1.55], [10, -5, 1.55]]
candidates:
  - type: distance
    visible: {at: [A, B, C], to: ["*"], farthest: 60 m BOTH}
    values: {sigma: 1 mm, from_height: 1.5, to_height: 1.5}
observations:
  - type: zenith_directions
    visible: {at: [SA, SB, C], to: ["T*", A, B], steepest: 40 gon, farthest: 60 m}
    values: {sigma_horizontal: 0.3 mgon, sigma_zenith: 0.3 mgon, to_height: 0.02}
  - type: distance
    columns: [from, to]
    values: {sigma: 1 mm}
    rows: [[A, B], [A, C], [B, C], [A, T1], [B, T1], [C, T1], [A, T2], [B, T2], [C, T2], [A, T3], [B, T3], [C, T3]]
datum: free
"""


@pytest.mark.parametrize(("both", "pairs"), [("", 8), (", both_ways: true", 10)])
def test_stations_and_points(tmp_path, both, pairs):
    """A wall of 1.55 m between A and B; of the distances A-C, B-C, three to T1 and three to T2 are left."""
    (tmp_path / "project.yaml").write_text(STATIONS.replace(" BOTH", both))
    run = mor("design", tmp_path / "project.yaml", "--rank")
    assert run.code == 0, run.err
    planned = pl.read_csv(tmp_path / "project.design" / "planned.csv").filter(pl.col("type") == "zenith_directions")
    rows = set(planned.select("from", "to").iter_rows())
    # T2 is steeper than 40 gon from everywhere, T3 too far; the wall is between A and B, and T1 seen above it
    assert rows == {("SA", "T1"), ("SB", "T1"), ("C", "T1"), ("C", "A"), ("C", "B")}
    ranking = pl.read_csv(tmp_path / "project.design" / "ranking.csv").filter(pl.col("kind") == "add")
    assert ranking.height == pairs


def test_mistakes_are_told_with_their_place(tmp_path):
    wrong = (
        PROJECT.replace("nearest: 1 m", "nearest: 1 gon, at: [J*], steepest: 3 gon")
        .replace("surface: block}", "surface: blok}")
        .replace("direction: [2, 0, 0]", "direction: [0, 0, 0]")
        .replace("clearance: 2 mm", "clearance: -2 mm")
    )
    _hall(tmp_path, project=wrong)
    run = mor("design", tmp_path / "project.yaml")
    assert run.code == 2
    for words in (
        "clearance: found -2 mm, expected a length",
        "there is no surface 'blok'; did you mean 'block'?",
        "a normal is 0 or not a number, expected a direction",
        "visible: at: there is no image 'J*'",
        "visible: steepest is for instruments",
        "visible: nearest: unit 'gon' does not fit a length",
    ):
        assert words in run.err, run.err
    assert "project.yaml:13" in run.err
    assert not (tmp_path / "project.design").exists()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\n", "has no end"),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n",
            "a.ply:3: found 'element vertex x'",
        ),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\nzwei\n",
            "a.ply:6: found 'zwei', expected vertex 1",
        ),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n12",
            "ends amidst its 9 vertex elements",
        ),
        ("a.obj", b"v 1 2\n", "a.obj:1: found 'v 1 2', expected v x y z"),
        ("a.obj", b"v 1 2 3\nf 1 2 3\n", "face 1 has 3 corners of 1 vertices"),
        ("a.obj", b"v 1 2 3\n", "no faces"),
        ("a.stl", b"solid", "neither a PLY nor an OBJ"),
    ],
)
def test_broken_meshes(tmp_path, name, content, words):
    _hall(tmp_path, project=PROJECT.replace("MESH", name))
    (tmp_path / name).write_bytes(content)
    run = mor("design", tmp_path / "project.yaml")
    assert run.code == 2
    assert words in run.err


def test_an_adjustment_needs_measured_rows(tmp_path):
    _hall(tmp_path)
    run = mor("adjust", tmp_path / "project.yaml")
    assert run.code == 2
    assert "project.yaml:22: visible is for what is planned" in run.err


def test_what_comes_back_by_distortion_is_not_on_the_format(tmp_path):
    """r (1 + k1 r²) with k1 < 0 turns round at r² = −1/(3 k1): from there on what is outside comes back."""
    text = PROJECT.replace("    unit: mm\n", "    unit: mm\n    model: opencv\n").replace("9 m", "900 m")
    text = text.replace(
        "{c: {free: 20}, xh: {free: 0.1}, yh: {free: -0.1}}", "{fx: 20, fy: 20, cx: 0, cy: 0, k1: -0.5}"
    )
    names, X, _, poses, _ = _hall(tmp_path, project=text)
    assert mor("simulate", tmp_path / "project.yaml", "-o", tmp_path / "trial").code == 0
    rows = pl.read_csv(tmp_path / "trial" / "observations_1_image.csv")
    found = set(zip(rows["image"], rows["point"], strict=True))
    back = 0
    for k, (at, angles) in enumerate(poses):
        D = _rotation(angles * GON)
        for name, point in zip(names, X, strict=True):
            u, v, w = D @ (point - at)
            r = np.hypot(u, v) / -w
            x, y = np.abs([u, v]) / -w * (1.0 - 0.5 * r * r) * 20.0
            if w < 0.0 and r > np.sqrt(2.0 / 3.0):
                back += abs(x) < 11.7 and abs(y) < 7.7
                assert (f"I{k}", name) not in found
    assert back > 10
