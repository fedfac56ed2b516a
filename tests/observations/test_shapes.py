"""Planes, lines and shapes against two regressions without mor, and planes and lines against closed forms.

The independent model has the axis by two angles about an arbitrary axis, and distances by the distance ρ from the axis
and the height h along it. ``scipy.optimize.least_squares`` minimises the distances. ODRPACK (``scipy.odr``) moves the
points onto the shape. The best plane and line follow from the principal axes of the points.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares

import mor
from tests.selection import slow_after

SIGMA = 0.02
SEEDS = [range(5), *(range(k, k + 29) for k in range(5, 150, 29))]
"""150 sets of each shape, 1 050 in all; the first five in the default run."""
SIZES = {
    "plane": (),
    "line": (),
    "circle": ("radius",),
    "sphere": ("radius",),
    "cylinder": ("radius",),
    "cone": ("semi_angle",),
    "torus": ("radius", "minor_radius"),
}
PLACE = {"plane": (False, False, True), "line": (True, True, False), "cylinder": (True, True, False)}
"""Components of the place along the axes of the shape that are determined; all three for other shapes."""


class Scene:
    """Points near a shape, with the frame (rows x, y, z of the axes) and the origin they were made in."""

    def __init__(self, shape: str, seed: int) -> None:
        random = np.random.default_rng([list(SIZES).index(shape), seed])
        count = int(random.integers(12, 60))
        arc = random.uniform(0.35, 1.0) * 2.0 * np.pi
        u, v = random.uniform(0.0, arc, count), random.uniform(0.0, 1.0, count)
        radius, self.tube, self.angle = (
            random.uniform(20, 80),
            random.uniform(5, 15),
            random.uniform(0.15, 0.9),
        )
        x, y, one = np.cos(u), np.sin(u), np.ones(count)
        if shape == "plane":
            local = radius * np.stack([2.0 * u, v, 0 * one], axis=1)
        elif shape == "line":
            local = radius * np.stack([0 * one, 0 * one, 2.0 * u], axis=1)
        elif shape == "circle":
            local = radius * np.stack([x, y, 0 * one], axis=1)
        elif shape == "sphere":
            polar = np.arccos(1.0 - v * (1.0 - np.cos(0.5 * arc)))
            local = radius * np.stack([np.sin(polar) * x, np.sin(polar) * y, np.cos(polar)], axis=1)
        elif shape == "cylinder":
            local = np.stack([radius * x, radius * y, 2.0 * radius * v], axis=1)
        elif shape == "cone":
            z = radius * (0.5 + v)
            local = np.stack([z * np.tan(self.angle) * x, z * np.tan(self.angle) * y, z], axis=1)
        else:
            w = random.uniform(0.0, 2.0 * np.pi, count)
            away = radius + self.tube * np.cos(w)
            local = np.stack([away * x, away * y, self.tube * np.sin(w)], axis=1)
        self.shape, self.radius = shape, radius
        self.axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        self.origin = random.uniform(-300.0, 300.0, 3)
        self.points = local @ self.axes + self.origin + random.normal(0.0, SIGMA, (count, 3))

    def project(self) -> dict:
        """The points as constants, so that the distances are all that is adjusted."""
        names = [f"P{k}" for k in range(len(self.points))]
        rows = [[name, *point] for name, point in zip(names, self.points.tolist(), strict=True)]
        return {
            "mor": 1,
            "units": {"length": "mm", "angle": "deg"},
            "points": [{"columns": ["id", "x", "y", "z"], "rows": rows, "fixed": ["x", "y", "z"]}],
            "features": [{"type": self.shape, "id": "F", "points": names, "sigma": SIGMA}],
            "settings": {"sigma": "apriori"},
        }

    def computed(self, unknowns: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances (m, n) of points from a shape, and derivatives by unknowns (m, n, u) and by points (m, n, 3).

        The unknowns are the place in the axes of the scene, two turns of the axis, and sizes.
        """
        place, (p, q), sizes = unknowns[:3], unknowns[3:5], unknowns[5:]
        x, y, z = self.axes
        w, second = np.sin(q) * y + np.cos(q) * z, np.cos(q) * y - np.sin(q) * z
        axis, first = np.sin(p) * x + np.cos(p) * w, np.cos(p) * x - np.sin(p) * w
        away = points - self.origin - place @ self.axes
        h = away @ axis
        radial = away - h[:, None] * axis
        rho = np.linalg.norm(radial, axis=1)
        zero, one = np.zeros_like(h), np.ones_like(h)
        if self.shape == "line":
            values = np.stack([away @ first, away @ second])
            normals = np.stack([one[:, None] * first, one[:, None] * second])
            by_turns = np.array([[-h, -np.sin(p) * values[1]], [zero, -away @ w]]).transpose(0, 2, 1)
            return values, np.concatenate([-normals @ self.axes.T, by_turns], axis=2), normals
        if self.shape == "torus":
            s = np.hypot(rho - sizes[0], h)
            rows = [(s - sizes[1], (rho - sizes[0]) / s, h / s, [-(rho - sizes[0]) / s, -one])]
        elif self.shape == "cone":
            c, t = np.cos(sizes[0]), np.sin(sizes[0])
            rows = [(rho * c - h * t, c * one, -t * one, [-rho * t - h * c])]
        elif self.shape == "sphere":
            s = np.hypot(rho, h)
            rows = [(s - sizes[0], rho / s, h / s, [-one])]
        elif self.shape == "plane":
            rows = [(h, zero, one, [])]
        else:
            rows = [(rho - sizes[0], one, zero, [-one]), (h, zero, one, [zero])]
            rows = rows[: 1 + (self.shape == "circle")]
        found = []
        for values, by_rho, by_h, by_sizes in rows:
            normals = (by_rho / rho)[:, None] * radial + by_h[:, None] * axis
            turned = (by_h - by_rho * h / rho)[:, None] * (away @ np.stack([first, np.cos(p) * second], axis=1))
            by = [-normals @ self.axes.T, turned, *(one[:, None] for one in by_sizes)]
            found.append((values, np.concatenate(by, axis=1), normals))
        values, by, normals = zip(*found, strict=True)
        return np.stack(values), np.stack(by), np.stack(normals)

    def axis(self, p: float, q: float) -> np.ndarray:
        """The unit vector of the axis turned by p and q."""
        x, y, z = self.axes
        return np.sin(p) * x + np.cos(p) * (np.sin(q) * y + np.cos(q) * z)

    def unknowns(self) -> tuple[np.ndarray, np.ndarray]:
        """Start values, and which of them are free."""
        sizes = {"cone": [self.angle], "torus": [self.radius, self.tube], "plane": [], "line": []}
        start = np.array([*np.zeros(5), *sizes.get(self.shape, [self.radius])])
        free = np.ones(len(start), dtype=bool)
        free[:3] = PLACE.get(self.shape, True)
        free[3:5] = self.shape != "sphere"
        return start, free

    def regression(self) -> tuple[dict, dict]:
        """Sizes, axis and place by name, and σ of sizes and place, by least squares of the distances."""
        start, free = self.unknowns()

        def values(some: np.ndarray) -> np.ndarray:
            return self.computed(whole(some, start, free), self.points)[0].ravel() / SIGMA

        def derivatives(some: np.ndarray) -> np.ndarray:
            by = self.computed(whole(some, start, free), self.points)[1][:, :, free]
            return by.reshape(-1, by.shape[2]) / SIGMA

        some = least_squares(values, start[free], derivatives, x_scale="jac", xtol=1e-15, ftol=1e-15).x
        for _ in range(3):  # the sum of squares is flat where these Gauss-Newton steps still move
            by = derivatives(some)
            some = some - np.linalg.lstsq(by, values(some))[0]
        return self.named(some, np.linalg.inv(by.T @ by))

    def odr(self) -> tuple[dict, dict]:
        """The same by orthogonal distance regression: corrections of points that lie on the shape (to 1e-8)."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            odr = pytest.importorskip("scipy.odr")
        start, free = self.unknowns()

        def part(number: int):
            def function(some: np.ndarray, points: np.ndarray) -> np.ndarray:
                found = self.computed(whole(some, start, free), points.T)[number]
                found = found if number != 1 else found[:, :, free]
                found = found if number == 0 else found.transpose(0, 2, 1)
                return found[0] if len(found) == 1 else np.ascontiguousarray(found)

            return function

        model = odr.Model(part(0), fjacb=part(1), fjacd=part(2))
        y = part(0)(start[free], self.points.T)
        weight = 1e8 * np.eye(2) if y.ndim == 2 else 1e8
        data = odr.Data(self.points.T, 0.0 * y, we=weight, wd=1.0)

        def run(some: np.ndarray, moved: np.ndarray | None):
            fit = odr.ODR(data, model, some, moved, sstol=0.0, partol=1e-16, maxit=200)
            fit.set_job(fit_type=0, deriv=3)
            return fit.run()

        first = run(start[free], None)  # a second run goes on from where the first one stopped
        return self.named(run(first.beta, first.delta).beta, first.cov_beta * SIGMA**2)

    def named(self, some: np.ndarray, inverse: np.ndarray) -> tuple[dict, dict]:
        """Values and σ by name, of free unknowns and their covariance matrix."""
        start, free = self.unknowns()
        covariance = np.zeros((len(start), len(start)))
        covariance[np.ix_(free, free)] = inverse
        every, sigma = whole(some, start, free), np.sqrt(np.diag(covariance))
        place = np.sqrt(np.diag(self.axes.T @ covariance[:3, :3] @ self.axes))
        names = SIZES[self.shape]
        values = {"axis": self.axis(*every[3:5]), "place": self.origin + every[:3] @ self.axes}
        return (
            values | dict(zip(names, every[5:], strict=True)),
            {"place": place} | dict(zip(names, sigma[5:], strict=True)),
        )


def whole(some: np.ndarray, start: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Start values with other values of those that are free."""
    every = start.copy()
    every[free] = some
    return every


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("seeds", slow_after(1, SEEDS))
def test_parameters_and_sigma_are_those_of_independent_regressions(shape: str, seeds: range) -> None:
    """σ of the place of a circle agree to σ / radius: ODRPACK linearises at points on the circle."""
    for seed in seeds:
        scene = Scene(shape, seed)
        feature = mor.adjust(scene.project()).features.frame.row(0, named=True)
        extent = float(np.ptp(scene.points, axis=0).max())
        place, direction = (np.array([feature[f"{name}{axis}"] for axis in "xyz"]) for name in ("", "d"))
        for (values, sigma), of_circle in ((scene.regression(), 1e-6), (scene.odr(), 1e-3)):
            for name in SIZES[shape]:
                unit, size = (np.pi / 180.0, 1.0) if name == "semi_angle" else (1.0, extent)
                assert abs(feature[name] * unit - values[name]) < 1e-9 * size, (shape, seed, name)
                assert abs(feature[f"s{name}"] * unit / sigma[name] - 1.0) < 1e-6, (shape, seed, name)
            if shape != "sphere":
                assert np.linalg.norm(np.cross(direction, values["axis"])) < 1e-9, (shape, seed)
            away = place - values["place"]
            along = values["axis"] * (away @ values["axis"])
            if shape in PLACE:
                away = along if shape == "plane" else away - along
            assert np.abs(away).max() < 1e-9 * extent, (shape, seed)
            if shape not in PLACE:
                found = np.array([feature[f"s{axis}"] for axis in "xyz"])
                limit = of_circle if shape == "circle" else 1e-6
                assert np.abs(found / sigma["place"] - 1.0).max() < limit, (shape, seed)


@pytest.mark.parametrize("shape", ["plane", "line"])
@pytest.mark.parametrize("seeds", slow_after(1, SEEDS))
def test_planes_and_lines_are_those_of_closed_forms(shape: str, seeds: range) -> None:
    """Both pass through the mean; normal and direction are principal axes, whose scatter gives σ of the turns."""
    for seed in seeds:
        scene = Scene(shape, seed)
        feature = mor.adjust(scene.project()).features.frame.row(0, named=True)
        mean, count = scene.points.mean(axis=0), len(scene.points)
        _, scatter, axes = np.linalg.svd(scene.points - mean)
        axis = axes[2 if shape == "plane" else 0]
        place, direction, sigma = (np.array([feature[f"{n}{a}"] for a in "xyz"]) for n in ("", "d", "s"))
        extent = float(np.ptp(scene.points, axis=0).max())
        assert np.abs(place - mean).max() < 1e-9 * extent, (shape, seed)
        assert np.linalg.norm(np.cross(direction, axis)) < 1e-9, (shape, seed)
        turn = np.degrees(SIGMA / scatter[1 if shape == "plane" else 0])
        assert feature["sd"] == pytest.approx(turn, rel=1e-6), (shape, seed)
        across = np.abs(axis) if shape == "plane" else np.sqrt(1.0 - axis**2)
        assert np.abs(sigma / (SIGMA / np.sqrt(count) * across) - 1.0).max() < 1e-6, (shape, seed)
        if shape == "plane":
            assert abs(feature["distance"]) == pytest.approx(abs(mean @ axis), abs=1e-9 * extent)


def camera(place: np.ndarray) -> np.ndarray:
    """Rotation of a camera at a place that looks at the origin."""
    z = place / np.linalg.norm(place)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def mixed_network() -> tuple[dict, np.ndarray]:
    """Points on a cylinder and a coaxial circle without coordinates: image rays, directions and distances only."""
    random = np.random.default_rng(5)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    u, z = random.uniform(0.0, 4.0, 20), np.append(random.uniform(-2.0, 2.0, 12), np.full(8, 2.5))
    radius = np.where(np.arange(20) < 12, 1.5, 0.8)
    points = np.stack([radius * np.cos(u), radius * np.sin(u), z], axis=1) @ axes
    names = [f"P{k}" for k in range(20)]
    images, rays = [], []
    for k, place in enumerate([[9.0, 0, 3], [0, 9, 4], [-7, 6, 3], [6, -8, 2]]):
        star = (points - place) @ camera(np.array(place)).T
        images.append([f"I{k}", "C"])
        rays += [[f"I{k}", n, *p] for n, p in zip(names, (-30.0 * star[:, :2] / star[:, 2:]).tolist(), strict=True)]
    station = np.array([8.0, 7.0, 0.5])
    away = points - station
    horizontal = np.degrees(np.arctan2(away[:, 0], away[:, 1])) % 360.0
    zenith = np.degrees(np.arccos(away[:, 2] / np.linalg.norm(away, axis=1)))
    sights = [["S", *row] for row in zip(names, horizontal.tolist(), zenith.tolist(), strict=True)]
    lengths = [["S", *row] for row in zip(names, np.linalg.norm(away, axis=1).tolist(), strict=True)]
    project = {
        "mor": 1,
        "units": {"length": "m", "angle": "deg"},
        "cameras": {"C": {"interior": {"c": 30}}},
        "images": [{"columns": ["id", "camera"], "rows": images}],
        "points": [
            {"columns": ["id", "x", "y", "z"], "rows": [["S", *station.tolist()]], "fixed": ["x", "y", "z"]},
            {"columns": ["id"], "rows": [[name] for name in names]},
        ],
        "stations": [{"columns": ["id", "orientation"], "rows": [["S", 0]], "fixed": ["kappa"]}],
        "features": [
            {"type": "cylinder", "id": "tube", "points": names[:12], "sigma": 1e-4},
            {"type": "circle", "id": "rim", "points": names[12:], "sigma": 1e-4, "coaxial": "tube"},
        ],
        "observations": [
            {
                "type": "image",
                "columns": ["image", "point", "x", "y"],
                "rows": rays,
                "values": {"sigma": 1e-3},
            },
            {
                "type": "zenith_directions",
                "columns": ["station", "to", "horizontal", "zenith"],
                "rows": sights,
                "values": {"sigma": 1e-3},
            },
            {
                "type": "distance",
                "columns": ["from", "to", "distance"],
                "rows": lengths[:6],
                "values": {"sigma": 1e-3},
            },
        ],
    }
    return project, axes


def test_rays_directions_and_distances_refer_to_points_of_shapes() -> None:
    project, axes = mixed_network()
    result = mor.adjust(project)
    assert result.converged
    tube, rim = result.to_dict()["features"]
    assert tube["radius"] == pytest.approx(1.5, abs=1e-8)
    assert rim["radius"] == pytest.approx(0.8, abs=1e-8)
    assert result.features.units["radius"] == "m"
    for feature in (tube, rim):
        assert np.linalg.norm(np.cross([feature[f"d{a}"] for a in "xyz"], axes[2])) < 1e-8
    np.testing.assert_allclose([rim[a] for a in "xyz"], 2.5 * axes[2], atol=1e-8)
    assert tube["form"] < 1e-8
    without = mor.adjust(project | {"features": []})
    # twelve distances and eight pairs of them, less axis (4), two radii and the place of the circle
    assert result.redundancy - without.redundancy == 12 + 16 - 7
    del project["points"][0]["fixed"], project["stations"][0]["fixed"]
    free = mor.adjust(project | {"datum": "free"})
    assert free.features.row("tube")["sradius"] / free.sigma0 == pytest.approx(
        tube["sradius"] / result.sigma0, rel=1e-6
    )


def test_equal_and_observed_sizes() -> None:
    """σ = 0 makes one radius of two; one that is observed moves by its weight; one that is given stays."""
    scenes = [Scene("sphere", seed) for seed in (1, 2)]
    project, other = (scene.project() for scene in scenes)
    names = {f"P{k}": f"Q{k}" for k in range(len(scenes[1].points))}
    project["points"][0]["rows"] += [[names[row[0]], *row[1:]] for row in other["points"][0]["rows"]]
    project["features"].append({**other["features"][0], "id": "G", "points": list(names.values())})
    pairs = {"type": "difference", "columns": ["from", "to", "component", "value", "sigma"]}
    project["observations"] = [{**pairs, "rows": [["feature F", "feature G", "radius", 0, 0]]}]
    equal = [row["components"]["radius"] for row in mor.adjust(project).to_dict()["others"]]
    assert equal[0]["value"] == equal[1]["value"]
    project["observations"] = [{**pairs, "rows": [["feature F", "feature G", "radius", 0, 1e-6]]}]
    nearly = [row["components"]["radius"] for row in mor.adjust(project).to_dict()["others"]]
    assert nearly[0]["value"] == pytest.approx(equal[0]["value"], rel=1e-6)
    assert nearly[0]["sigma"] == pytest.approx(equal[0]["sigma"], rel=1e-4)

    single = scenes[0].project()
    free = mor.adjust(single).to_dict()["others"][0]["components"]["radius"]
    said, sigma = free["value"] + 0.01, free["sigma"]
    single["features"][0]["radius"] = {"observed": said, "sigma": sigma}
    observed = mor.adjust(single).to_dict()["others"][0]["components"]["radius"]
    assert observed["value"] == pytest.approx(free["value"] + 0.005, abs=1e-5)
    single["features"][0]["radius"] = said
    assert mor.adjust(single).to_dict()["others"] == []


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"type": "plane", "radius": 3}, "radius: a plane has none"),
        ({"type": "cone", "minor_radius": 3}, "minor_radius: a cone has none"),
        ({"type": "circle", "parallel": "G"}, "parallel: no feature 'G' stands above this one"),
        ({"type": "sphere", "parallel": "F"}, "parallel: a sphere cannot have it"),
        (
            {"type": "circle", "points": ["P0", "P1", "P2"]},
            "a circle observes nothing with 3 points; it needs 4 or more",
        ),
    ],
)
def test_mistakes(keys: dict, words: str) -> None:
    project = Scene("circle", 1).project()
    project["features"][0] |= keys
    with pytest.raises(mor.InputError, match=words):
        mor.adjust(project)


def test_place_and_sigma_of_a_coaxial_circle() -> None:
    """A rotation axis: two circles about it, the second one far from the origin of the common system."""
    first = Scene("circle", 3)
    x, y, z = first.axes
    random = np.random.default_rng(8)
    u = random.uniform(0.0, 4.0, (15, 1))
    points = first.origin + 30.0 * (np.cos(u) * x + np.sin(u) * y) + 200.0 * z
    points += random.normal(0.0, SIGMA, points.shape)
    project = first.project()
    names = [f"Q{k}" for k in range(len(points))]
    project["points"][0]["rows"] += [[n, *p] for n, p in zip(names, points.tolist(), strict=True)]
    second = {"type": "circle", "id": "G", "points": names, "sigma": SIGMA, "coaxial": "F"}
    project["features"].append(second)
    found = mor.adjust(project).features.row("G")

    def centre(some: np.ndarray) -> np.ndarray:
        return some[:3] @ first.axes + some[6] * first.axis(*some[3:5])

    def residuals(some: np.ndarray) -> np.ndarray:
        away = points - first.origin - centre(some)
        along = away @ first.axis(*some[3:5])
        rho = np.linalg.norm(np.cross(away, first.axis(*some[3:5])), axis=1)
        off = first.computed(some[:6], first.points)[0].ravel() / SIGMA
        return np.concatenate([off, (rho - some[7]) / SIGMA, along / SIGMA])

    start = np.array([0.0, 0.0, 0.0, 0.0, 0.0, first.radius, 200.0, 30.0])
    best = least_squares(residuals, start, jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    step = 1e-5 * np.eye(8)
    by = np.stack([(centre(best.x + h) - centre(best.x - h)) / 2e-5 for h in step], axis=1)
    sigma = np.sqrt(np.diag(by @ np.linalg.inv(best.jac.T @ best.jac) @ by.T))
    np.testing.assert_allclose([found[a] for a in "xyz"], first.origin + centre(best.x), atol=1e-7)
    np.testing.assert_allclose([found[f"s{a}"] for a in "xyz"], sigma, rtol=1e-6)
    assert found["radius"] == pytest.approx(best.x[7], abs=1e-7)


def test_sigma_of_the_place_of_a_plane_is_along_its_normal() -> None:
    """At the mean of n points the normal moves by σ/√n, as the mean of n observations does; along the plane nothing."""
    random = np.random.default_rng(11)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    u, v, off = (
        random.uniform(10.0, 50.0, (2, 25)),
        random.uniform(0.0, 50.0, (2, 25)),
        random.normal(size=(2, 25)),
    )
    local = np.stack([[u[0], v[0], SIGMA * off[0]], [SIGMA * off[1], v[1], u[1]]]).transpose(0, 2, 1)
    points = local.reshape(-1, 3) @ axes + 200.0
    names = [f"P{k}" for k in range(50)]
    rows = [[name, *point] for name, point in zip(names, points.tolist(), strict=True)]
    feature = {"type": "right angle", "id": "F", "points": names[:25], "other": names[25:], "sigma": SIGMA}
    result = mor.adjust(
        {
            "mor": 1,
            "units": {"length": "mm", "angle": "deg"},
            "points": [{"columns": ["id", "x", "y", "z"], "rows": rows, "fixed": ["x", "y", "z"]}],
            "features": [feature],
            "settings": {"sigma": "apriori"},
        }
    )
    for plane in result.features.frame.to_dicts():
        sigma, direction = (np.array([plane[f"{s}{axis}"] for axis in "xyz"]) for s in ("s", "d"))
        assert sigma == pytest.approx(np.abs(direction) * SIGMA / 5.0, rel=1e-6)
