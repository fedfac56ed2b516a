"""Circles, spheres, cylinders, cones and tori against an orthogonal distance regression that is written without mor.

The independent model has the axis by two angles about an arbitrary axis and a point on it, distances by cross products,
and is solved by ``scipy.optimize.least_squares`` with differences for derivatives.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mor
from tests.selection import slow_after

SIGMA = 0.02
SETS_OF_A_SHAPE = 200
"""1 000 sets in all; a few of them in the default run."""
SIZES = {
    "circle": ("radius",),
    "sphere": ("radius",),
    "cylinder": ("radius",),
    "cone": ("semi_angle",),
    "torus": ("radius", "minor_radius"),
}


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
        if shape == "circle":
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

    def distances(self, unknowns: np.ndarray) -> np.ndarray:
        """Distances over σ from the shape with a place (3), two turns of the axis, and sizes."""
        place, (p, q), sizes = unknowns[:3], unknowns[3:5], unknowns[5:]
        axis = self.axis(p, q)
        away = self.points - (self.origin + place)
        along = away @ axis
        rho = np.linalg.norm(np.cross(away, axis), axis=1)
        if self.shape == "circle":
            found = np.concatenate([rho - sizes[0], along])
        elif self.shape == "sphere":
            found = np.linalg.norm(away, axis=1) - sizes[0]
        elif self.shape == "cylinder":
            found = rho - sizes[0]
        elif self.shape == "cone":
            found = rho * np.cos(sizes[0]) - along * np.sin(sizes[0])
        else:
            found = np.sqrt((rho - sizes[0]) ** 2 + along**2) - sizes[1]
        return found / SIGMA

    def axis(self, p: float, q: float) -> np.ndarray:
        """The unit vector of the axis turned by p and q."""
        x, y, z = self.axes
        return np.sin(p) * x + np.cos(p) * (np.sin(q) * y + np.cos(q) * z)

    def regression(self) -> tuple[dict[str, float], dict[str, float]]:
        """Sizes, axis and place by name, and σ of sizes and place."""
        start = [
            *np.zeros(5),
            *{"cone": [self.angle], "torus": [self.radius, self.tube]}.get(self.shape, [self.radius]),
        ]
        free = np.ones(len(start), dtype=bool)
        free[2] = self.shape != "cylinder"  # the place along its axis; the other two are in its plane
        free[3:5] = self.shape != "sphere"
        turn = np.eye(len(start))
        turn[:3, :3] = self.axes.T if self.shape == "cylinder" else np.eye(3)

        def residuals(some: np.ndarray) -> np.ndarray:
            whole = np.array(start)
            whole[free] = some
            return self.distances(turn @ whole)

        found = least_squares(
            residuals, np.array(start)[free], jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        whole = np.array(start)
        whole[free] = found.x
        inverse = np.zeros((len(start), len(start)))
        inverse[np.ix_(free, free)] = np.linalg.inv(found.jac.T @ found.jac)
        whole, covariance = turn @ whole, turn @ inverse @ turn.T
        sigma = np.sqrt(np.diag(covariance))
        sizes = dict(zip(SIZES[self.shape], whole[5:], strict=True))
        values = {**sizes, "axis": self.axis(*whole[3:5]), "place": self.origin + whole[:3]}
        return values, {**dict(zip(SIZES[self.shape], sigma[5:], strict=True)), "place": sigma[:3]}


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("block", slow_after(1, range(10)))
def test_parameters_and_sigma_are_those_of_an_independent_regression(shape: str, block: int) -> None:
    first = 5 if block == 0 else SETS_OF_A_SHAPE // 10
    for seed in range(block * 20, block * 20 + first):
        scene = Scene(shape, seed)
        values, sigma = scene.regression()
        result = mor.adjust(scene.project())
        feature = result.features.frame.row(0, named=True)
        extent = float(np.ptp(scene.points, axis=0).max())
        for name in SIZES[shape]:
            unit, size = (np.pi / 180.0, 1.0) if name == "semi_angle" else (1.0, extent)
            assert abs(feature[name] * unit - values[name]) < 1e-9 * size, (shape, seed, name)
            assert abs(feature[f"s{name}"] * unit / sigma[name] - 1.0) < 1e-6, (shape, seed, name)
        place = np.array([feature[axis] for axis in "xyz"])
        if shape != "sphere":
            direction = np.array([feature[f"d{axis}"] for axis in "xyz"])
            assert np.linalg.norm(np.cross(direction, values["axis"])) < 1e-9, (shape, seed)
        if shape == "cylinder":
            assert np.linalg.norm(np.cross(place - values["place"], values["axis"])) < 1e-9 * extent, seed
        else:
            assert np.abs(place - values["place"]).max() < 1e-9 * extent, (shape, seed)
            found = np.array([feature[f"s{axis}"] for axis in "xyz"])
            assert np.abs(found / sigma["place"] - 1.0).max() < 1e-6, (shape, seed)


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
        rays += [
            [f"I{k}", n, *p] for n, p in zip(names, (-30.0 * star[:, :2] / star[:, 2:]).tolist(), strict=True)
        ]
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
        return some[:3] + some[6] * first.axis(*some[3:5])

    def residuals(some: np.ndarray) -> np.ndarray:
        away = points - first.origin - centre(some)
        along = away @ first.axis(*some[3:5])
        rho = np.linalg.norm(np.cross(away, first.axis(*some[3:5])), axis=1)
        return np.concatenate([first.distances(some[:6]), (rho - some[7]) / SIGMA, along / SIGMA])

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
