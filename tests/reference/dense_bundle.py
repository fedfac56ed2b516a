"""A dense bundle adjustment that shares no code with mor: it computes the expected values of the reduced blocks.

    python tests/reference/dense_bundle.py tests/reference/networks/calibration/*.yaml

reads the projects and writes the numbers into the ``.expected.json`` beside each of them; source and tolerances there
are kept. It understands only what these projects contain: one camera with pixel coordinates, images without
observed orientation, points that are fixed, free, or observed, and a free datum over all points.

Equations (distances in mm on the sensor, y up, R from camera to world):

    R = Rx(ω) Ry(φ) Rz(κ),  q = R' (X − X0),  p = −c (q_x, q_y) / q_z
    m = measured coordinates, reduced by the principal point (xh, yh)
    D(x, y) = (x, y) (K1 r² + K2 r⁴ + K3 r⁶) + (P1 (r² + 2x²) + 2 P2 x y,  P2 (r² + 2y²) + 2 P1 x y)
    brown           v = p − (a + D(a))  with  a = ((1 + b1) m_x + b2 m_y, m_y)
    brown-forward   v = p − D(p) − m

Derivatives come from complex steps (Squire and Trapp 1998), the solution and its cofactors from a QR decomposition of
the whitened, scaled design matrix. Inner constraints G'(X − X0) = 0 hold at the approximate coordinates X0: every step
stays in the null space of G'.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import yaml

_INTERIOR = ("c", "xh", "yh", "K1", "K2", "K3", "P1", "P2", "b1", "b2")
_STEP = 1e-200
_ITERATIONS = 50
_SMALL = 1e-11
"""Length of the last step in units of standard deviations, relative to the norm of the residuals."""


def rotation(omega, phi, kappa):
    """Rx(ω) Ry(φ) Rz(κ), shape (n, 3, 3)."""
    zero, one = np.zeros_like(omega), np.ones_like(omega)
    (co, so), (cp, sp), (ck, sk) = ((np.cos(a), np.sin(a)) for a in (omega, phi, kappa))
    x = [[one, zero, zero], [zero, co, -so], [zero, so, co]]
    y = [[cp, zero, sp], [zero, one, zero], [-sp, zero, cp]]
    z = [[ck, -sk, zero], [sk, ck, zero], [zero, zero, one]]
    x, y, z = (np.moveaxis(np.array(m), -1, 0) for m in (x, y, z))
    return x @ y @ z


def distortion(x, y, camera):
    """The correction D of Brown's model."""
    r2 = x * x + y * y
    radial = r2 * (camera["K1"] + r2 * (camera["K2"] + r2 * camera["K3"]))
    dx = x * radial + camera["P1"] * (r2 + 2 * x * x) + 2 * camera["P2"] * x * y
    dy = y * radial + camera["P2"] * (r2 + 2 * y * y) + 2 * camera["P1"] * x * y
    return dx, dy


def residuals(camera, poses, points, image, forward):
    """v = computed − observed of every ray in pixels, y down; poses and points of each ray, shapes (n, 6), (n, 3)."""
    q = np.einsum("nji,nj->ni", rotation(*poses.T[3:]), points - poses[:, :3])
    px, py = (-camera["c"] * q[:, k] / q[:, 2] for k in (0, 1))
    mx = image["pixel"] * (image["x"] - image["width"] / 2) - camera["xh"]
    my = -image["pixel"] * (image["y"] - image["height"] / 2) - camera["yh"]
    if forward:
        dx, dy = distortion(px, py, camera)
        vx, vy = px - dx - mx, py - dy - my
    else:
        ax = (1 + camera["b1"]) * mx + camera["b2"] * my
        dx, dy = distortion(ax, my, camera)
        vx, vy = px - ax - dx, py - my - dy
    return np.stack([vx, -vy], axis=1) / image["pixel"]


def movements(points):
    """Three translations, three rotations and the scale of points, shape (3 n, 7)."""
    x, y, z = (points - points.mean(axis=0)).T
    zero = np.zeros_like(x)
    turns = [[zero, -z, y], [z, zero, -x], [-y, x, zero], [x, y, z]]
    shifts = [[np.full_like(x, float(i == k)) for i in range(3)] for k in range(3)]
    return np.array([np.stack(m, axis=1).ravel() for m in (*shifts, *turns)]).T


class Block:
    """A project as arrays. The unknowns: interior orientation, six per image, three per point that is not fixed."""

    def __init__(self, project):
        ((name, camera),) = project["cameras"].items()
        self.camera_name = str(name)
        self.forward = camera.get("model") == "brown-forward"
        self.camera = dict.fromkeys(_INTERIOR, 0.0)
        self.interior = []
        for name, value in camera["interior"].items():
            free = isinstance(value, dict)
            self.camera[name] = float(value["free"] if free else value)
            self.interior += [name] if free else []
        (images,) = project["images"]
        self.images = [str(row[0]) for row in images["rows"]]
        columns = [images["columns"].index(c) for c in ("x", "y", "z", "omega", "phi", "kappa")]
        self.poses = np.array([[row[k] for k in columns] for row in images["rows"]], float)
        self.poses[:, 3:] = np.radians(self.poses[:, 3:])
        self.points, coordinates, self.free, self.control = [], [], [], []
        for table in project["points"]:
            for row in table["rows"]:
                values = dict(zip(table["columns"], row, strict=True))
                coordinates.append([values[c] for c in "xyz"])
                if "sigma_x" in values:
                    self.control.append((len(self.points), [values[f"sigma_{c}"] for c in "xyz"]))
                if "fixed" not in table:
                    self.free.append(len(self.points))
                self.points.append(str(values["id"]))
        self.coordinates = np.array(coordinates, float)
        self.given = self.coordinates.copy()
        (rays,) = project["observations"]
        self.image = [self.images.index(str(row[0])) for row in rays["rows"]]
        self.point = [self.points.index(str(row[1])) for row in rays["rows"]]
        size = camera["image"]
        x, y = np.array([row[2:4] for row in rays["rows"]], float).T
        pixel = float(str(size["pixel"]).removesuffix(" mm"))
        self.measured = {"x": x, "y": y, "pixel": pixel, "width": size["width"], "height": size["height"]}
        self.sigma = float(rays["values"]["sigma"])
        self.free_datum = project.get("datum", "fixed") != "fixed"

    def equations(self):
        """Whitened residuals and design matrix: control coordinates first, then rays."""
        poses, points = self.poses[self.image].astype(complex), self.coordinates[self.point].astype(complex)
        n, first = len(poses), len(self.interior) + 6 * len(self.images)
        A = np.zeros((n, 2, first + 3 * len(self.free)))
        ray = np.arange(n)

        def derivative(camera, poses, points):
            return residuals(camera, poses, points, self.measured, self.forward).imag / _STEP

        for k, name in enumerate(self.interior):
            A[:, :, k] = derivative({**self.camera, name: self.camera[name] + 1j * _STEP}, poses, points)
        for k in range(6):
            shift = 1j * _STEP * np.eye(6)[k]
            column = len(self.interior) + 6 * np.array(self.image) + k
            A[ray, :, column] = derivative(self.camera, poses + shift, points)
        place = {point: i for i, point in enumerate(self.free)}
        moved = np.array([i for i, point in enumerate(self.point) if point in place])
        for k in range(3):
            column = np.array([first + 3 * place[self.point[i]] + k for i in moved])
            A[moved, :, column] = derivative(self.camera, poses, points + 1j * _STEP * np.eye(3)[k])[moved]
        v = residuals(self.camera, poses, points, self.measured, self.forward).real
        rows, values = [A.reshape(2 * n, -1) / self.sigma], [v.ravel() / self.sigma]
        for point, sigma in self.control:
            row = np.zeros((3, A.shape[2]))
            row[:, first + 3 * place[point] : first + 3 * place[point] + 3] = np.diag(1 / np.array(sigma))
            rows.insert(len(rows) - 1, row)
            values.insert(len(values) - 1, (self.coordinates[point] - self.given[point]) / sigma)
        return np.concatenate(values), np.concatenate(rows)

    def move(self, step):
        """Add a step to all unknowns."""
        first, second = len(self.interior), len(self.interior) + 6 * len(self.images)
        for name, change in zip(self.interior, step[:first], strict=True):
            self.camera[name] += change
        self.poses += step[first:second].reshape(-1, 6)
        self.coordinates[self.free] += step[second:].reshape(-1, 3)

    def admissible(self):
        """Basis of the steps that keep the inner constraints, and the datum defect."""
        size = len(self.interior) + 6 * len(self.images) + 3 * len(self.free)
        if not self.free_datum:
            return np.eye(size), 0
        G = np.zeros((size, 7))
        G[size - 3 * len(self.free) :] = movements(self.given[self.free])
        return np.linalg.qr(G, mode="complete")[0][:, 7:], 7


def adjust(project):
    """The adjusted block as tables of neutral numbers; standard deviations a posteriori. Raises ValueError."""
    block = Block(project)
    Z, defect = block.admissible()
    for _ in range(_ITERATIONS):
        v, A = block.equations()
        reduced = A @ Z
        scale = np.linalg.norm(reduced, axis=0)
        Q, R = np.linalg.qr(reduced / scale)
        explained = Q.T @ v
        block.move(Z @ (-np.linalg.solve(R, explained) / scale))
        if np.linalg.norm(explained) < _SMALL * np.linalg.norm(v):
            break
    else:
        raise ValueError("the adjustment did not converge")
    v, A = block.equations()
    dof = len(v) - A.shape[1] + defect
    sigma0 = np.sqrt(v @ v / dof)
    half = Z @ (np.linalg.inv(R) / scale[:, None])
    sigma = sigma0 * np.linalg.norm(half, axis=1)
    r = 1 - np.sum(Q * Q, axis=1)
    return {
        "n": len(v),
        "u": A.shape[1],
        "defect": defect,
        "dof": dof,
        "sigma0": float(sigma0),
        **_tables(block, v, r, sigma),
    }


def _short(values):
    return [float(f"{value:.12g}") for value in values]


def _tables(block, v, r, sigma):
    first, second = len(block.interior), len(block.interior) + 6 * len(block.images)
    cameras = [
        [block.camera_name, name, block.camera[name], *_short([s])]
        for name, s in zip(block.interior, sigma[:first], strict=True)
    ]
    images = []
    for name, pose, s in zip(block.images, block.poses, sigma[first:second].reshape(-1, 6), strict=True):
        angles = np.degrees([pose[3:], s[3:]])
        images.append([name, *pose[:3].tolist(), *angles[0].tolist(), *_short([*s[:3], *angles[1]])])
    points, all_sigma = [], np.zeros_like(block.coordinates)
    all_sigma[block.free] = sigma[second:].reshape(-1, 3)
    for name, coordinates, s in zip(block.points, block.coordinates, all_sigma, strict=True):
        points += [[name, c, float(coordinates[k]), *_short([s[k]])] for k, c in enumerate("xyz")]
    rows, units = [], []
    for point, sigmas in block.control:
        rows += [["observed", c, f"point {block.points[point]}"] for c in "xyz"]
        units += sigmas
    for image, point in zip(block.image, block.point, strict=True):
        rows += [["image", c, f"{block.images[image]} {block.points[point]}"] for c in "xy"]
        units += [block.sigma * block.measured["pixel"]] * 2
    rows = [[*row, *_short([w * unit, q])] for row, w, unit, q in zip(rows, v, units, r, strict=True)]
    angles, sigmas = ("omega", "phi", "kappa"), ("sx", "sy", "sz", "somega", "sphi", "skappa")
    return {
        **({"cameras": _table(["camera", "component", "value", "sigma"], cameras)} if cameras else {}),
        "images": _table(["image", "x", "y", "z", *angles, *sigmas], images),
        "points": _table(["point", "component", "value", "sigma"], points),
        "observations": _table(["type", "component", "names", "v", "r"], rows),
    }


def _table(columns, rows):
    return {"columns": columns, "rows": rows}


def text_of(expected):
    """Expected values as JSON with one row of a table in a line."""
    parts = []
    for key, value in expected.items():
        text = json.dumps(value, ensure_ascii=False)
        if isinstance(value, dict) and "rows" in value:
            rest = {name: part for name, part in value.items() if name != "rows"}
            lines = [f"  {json.dumps(k)}: {json.dumps(part, ensure_ascii=False)}," for k, part in rest.items()]
            rows = ",\n".join(f"   {json.dumps(row, ensure_ascii=False)}" for row in value["rows"])
            text = "\n".join(["{", *lines, '  "rows": [', rows, "  ]", " }"])
        parts.append(f" {json.dumps(key)}: {text}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def main(names):
    """Compute the blocks in these project files and write their expected values."""
    for path in map(Path, names):
        beside = path.with_suffix(".expected.json")
        kept = json.loads(beside.read_text(encoding="utf-8"))
        expected = {**kept, **adjust(yaml.safe_load(path.read_text(encoding="utf-8")))}
        beside.write_text(text_of(expected), encoding="utf-8")
        print(f"{path}: {expected['n']} observations, sigma0 {expected['sigma0']:.9f}")


if __name__ == "__main__":
    main(sys.argv[1:])
