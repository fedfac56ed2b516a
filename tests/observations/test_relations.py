"""Relations between features, exactly and as observations, against a least-squares fit written without mor.

The independent model substitutes the exact relation: the axis of the second shape is made of that of the first one and
the unknowns that remain. It has one residual more for every observed relation. Derivatives are differences.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mor
from tests.selection import slow_after

SIGMA, OBSERVED = 0.02, 0.004
"""σ of distances (mm), and of observed relations (mm, rad)."""


class Pair:
    """A cylinder A and a circle B that nearly have a relation; ``axis`` and ``centre`` of B by the unknowns."""

    def __init__(self, relation: str, seed: int, exact: bool) -> None:
        random = np.random.default_rng([seed, *relation.encode()])
        self.relation, self.exact = relation, exact
        self.axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        self.axes[2] *= np.linalg.det(self.axes)
        self.origin = random.uniform(-100.0, 100.0, 3)
        angle = random.uniform(0.0, 2.0 * np.pi)
        x, y, z = self.axes
        self.first = {"perpendicular": np.cos(angle) * x + np.sin(angle) * y}.get(relation, z)
        away = random.uniform(20.0, 40.0, 3)
        keeps = {"coaxial": [0.0, 0.0, 1.0], "coplanar": [1.0, 1.0, 0.0]}.get(relation, [1.0, 1.0, 1.0])
        self.centre = self.origin + (away * keeps) @ self.axes
        self.sides = np.linalg.svd(self.first[None])[2][1:]
        kind = "circle" if relation == "coplanar" else "cylinder"
        self.kinds = (kind, "circle")
        self.points = []
        for axis, place, radius, depth in (
            (z, self.origin, 30.0, 60.0 * (kind == "cylinder")),
            (self.first, self.centre, 20.0, 0.0),
        ):
            sides = np.linalg.svd(axis[None])[2][1:]
            u, v = random.uniform(0.0, 5.0, 25), random.uniform(-0.5, 0.5, 25)
            ring = radius * np.stack([np.cos(u), np.sin(u)], axis=1) @ sides
            self.points.append(place + ring + depth * v[:, None] * axis + random.normal(0.0, SIGMA, (25, 3)))

    def project(self) -> dict:
        names = [[f"{shape}{k}" for k in range(25)] for shape in "AB"]
        rows = [
            [name, *point]
            for own, points in zip(names, self.points, strict=True)
            for name, point in zip(own, points.tolist(), strict=True)
        ]
        features = [
            {"type": kind, "id": shape, "points": own, "sigma": SIGMA}
            for kind, shape, own in zip(self.kinds, "AB", names, strict=True)
        ]
        observations = []
        if self.exact:
            features[1][self.relation] = "A"
        else:
            said = {"perpendicular": ["tilt_z"]}.get(self.relation, ["tilt_x", "tilt_y"])
            columns = ["from", "to", *said, "sigma"]
            axis = {"type": "axis", "columns": columns, "units": {"sigma": "rad"}}
            observations.append(axis | {"rows": [["A", "B", *(0 for _ in said), OBSERVED]]})
            said = {"coaxial": ["x", "y"], "coplanar": ["z"]}.get(self.relation, [])
            if said:
                row = ["A", "B", *(0 for _ in said), OBSERVED]
                observations.append({"type": "axis_offset", "columns": ["from", "to", *said, "sigma"], "rows": [row]})
        return {
            "mor": 1,
            "units": {"length": "mm", "angle": "deg"},
            "points": [{"columns": ["id", "x", "y", "z"], "rows": rows, "fixed": ["x", "y", "z"]}],
            "features": features,
            "observations": observations,
            "settings": {"sigma": "apriori"},
        }

    def regression(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Axis, centre and radius of B, with σ, by unknowns of A (axis 2, place 2 or 3, radius) and those left of B."""
        flat, exact = self.kinds[0] == "circle", self.exact
        held = {"parallel": 0, "coaxial": 0, "coplanar": 0, "perpendicular": 1}[self.relation] if exact else 2
        free = {"coaxial": 1, "coplanar": 2}.get(self.relation, 3) if exact else 3
        x, y, z = self.axes

        def split(some: np.ndarray):
            axis = z + some[0] * x + some[1] * y
            axis = axis / np.linalg.norm(axis)
            place = self.origin + some[2] * x + some[3] * y + (some[4] * z if flat else 0.0)
            turns, offset = some[6 : 6 + held], some[6 + held : 6 + held + free]
            if held == 2:
                other = self.first + turns @ self.sides
            elif held == 1:
                one = self.first - axis * (axis @ self.first)
                one = one / np.linalg.norm(one)
                other = np.cos(turns[0]) * one + np.sin(turns[0]) * np.cross(axis, one)
            else:
                other = axis
            other = other / np.linalg.norm(other)
            if free == 3:
                centre = self.centre + offset
            elif free == 1:
                centre = place + axis * (axis @ (self.centre - place) + offset[0])
            else:
                away = self.centre - place + offset[0] * x + offset[1] * y
                centre = place + away - axis * (axis @ away)
            return axis, place, some[5], other, centre, some[-1]

        def result(some: np.ndarray) -> np.ndarray:
            *_, other, centre, radius = split(some)
            return np.concatenate([other, centre, [radius]])

        def residuals(some: np.ndarray) -> np.ndarray:
            axis, place, radius, other, centre, small = split(some)
            found = []
            for points, direction, at, size, circle in (
                (self.points[0], axis, place, radius, flat),
                (self.points[1], other, centre, small, True),
            ):
                off = points - at
                found.append((np.linalg.norm(np.cross(off, direction), axis=1) - size) / SIGMA)
                if circle:
                    found.append(off @ direction / SIGMA)
            if not exact:
                side = np.cross(y, axis) / np.linalg.norm(np.cross(y, axis))  # does not turn about the axis with it
                sides = np.stack([side, np.cross(axis, side)])
                found.append([axis @ other] if self.relation == "perpendicular" else sides @ other)
                found[-1] = np.array(found[-1]) / OBSERVED
                if self.relation == "coaxial":
                    found.append(sides @ (centre - place) / OBSERVED)
                if self.relation == "coplanar":
                    found.append(np.array([axis @ (centre - place) / OBSERVED]))
            return np.concatenate(found)

        start = np.zeros(6 + held + free + 1)
        start[5], start[-1] = 30.0, 20.0
        used = np.ones(len(start), dtype=bool)
        used[4] = flat

        def whole(some: np.ndarray) -> np.ndarray:
            every = start.copy()
            every[used] = some
            return every

        # Steps that suit the size of each unknown; a last Gauss-Newton step with central differences.
        best = least_squares(lambda s: residuals(whole(s)), start[used], x_scale="jac", jac="3-point", xtol=1e-15)
        some = best.x
        for _ in range(4):
            J = self._by(lambda s: residuals(whole(s)), some)
            some = some - np.linalg.lstsq(J, residuals(whole(some)), rcond=None)[0]
        J, by = self._by(lambda s: residuals(whole(s)), some), self._by(lambda s: result(whole(s)), some)
        Q = by @ np.linalg.inv(J.T @ J) @ by.T
        return result(whole(some)), np.sqrt(np.diag(Q)), J.shape[0] - J.shape[1]

    @staticmethod
    def _by(function, some: np.ndarray) -> np.ndarray:
        step = 1e-4 * np.eye(len(some))
        return np.stack([(function(some + h) - function(some - h)) / 2e-4 for h in step], axis=1)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("relation", ["parallel", "perpendicular", "coaxial", "coplanar"])
@pytest.mark.parametrize("block", slow_after(1, range(10)))
def test_relations_are_those_of_an_independent_fit(relation: str, exact: bool, block: int) -> None:
    for seed in range(block * 10, block * 10 + (2 if block == 0 else 10)):
        pair = Pair(relation, seed, exact)
        values, sigma, redundancy = pair.regression()
        result = mor.adjust(pair.project())
        assert result.redundancy == redundancy
        assert sum(group["redundancy"] for group in result.to_dict()["groups"]) == pytest.approx(redundancy, abs=1e-6)
        row = result.features.row("B")
        direction = np.array([row[f"d{a}"] for a in "xyz"])
        direction *= np.sign(direction @ values[:3])
        found = np.concatenate([direction, [row[a] for a in "xyz"], [row["radius"]]])
        assert np.abs(found - values)[:3].max() < 1e-9, (relation, seed)
        assert np.abs(found - values)[3:].max() < 1e-9 * 100.0, (relation, seed)
        assert [row["sx"], row["sy"], row["sz"], row["sradius"]] == pytest.approx(sigma[3:], rel=1e-6)
        if exact:
            first = result.features.row("A")
            other = np.array([first[f"d{a}"] for a in "xyz"])
            wanted = 0.0 if relation == "perpendicular" else 1.0
            assert abs(other @ direction) == pytest.approx(wanted, abs=1e-14)


def test_start_values_without_coordinates() -> None:
    """Shapes whose points only rays, directions and distances see take their relations too."""
    random = np.random.default_rng(3)
    project = Pair("perpendicular", 1, True).project()
    rows = project["points"][0]["rows"]
    names, places = [row[0] for row in rows], np.array([row[1:] for row in rows])
    stations = {f"S{k}": places.mean(axis=0) + random.uniform(-400.0, 400.0, 3) for k in range(3)}
    sights = []
    for station, place in stations.items():
        away = places - place
        horizontal = np.degrees(np.arctan2(away[:, 0], away[:, 1])) % 360.0
        zenith = np.degrees(np.arccos(away[:, 2] / np.linalg.norm(away, axis=1)))
        sights += [[station, *row] for row in zip(names, horizontal.tolist(), zenith.tolist(), strict=True)]
    free = dict(project)
    held = [[station, *place.tolist()] for station, place in stations.items()]
    free["points"] = [
        {"columns": ["id", "x", "y", "z"], "rows": held, "fixed": ["x", "y", "z"]},
        {"columns": ["id"], "rows": [[name] for name in names]},
    ]
    oriented = [[station, station, 0] for station in stations]
    free["stations"] = [{"columns": ["id", "point", "orientation"], "rows": oriented, "fixed": ["kappa"]}]
    columns = ["station", "to", "horizontal", "zenith"]
    free["observations"] = [
        {"type": "zenith_directions", "columns": columns, "rows": sights, "values": {"sigma": 1e-6}}
    ]
    found, expected = (mor.adjust(one).features.row("B") for one in (free, project))
    for key in ("x", "y", "z", "radius", "dx", "dy", "dz"):
        assert found[key] == pytest.approx(expected[key], abs=1e-3)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"coaxial": "A"}, "give only one of parallel, perpendicular, coaxial and coplanar"),
        ({"perpendicular": None, "coplanar": "A"}, "coplanar: the cylinder 'A' has no plane"),
        ({"type": "sphere"}, "perpendicular: a sphere cannot have it"),
    ],
)
def test_mistakes(keys: dict, words: str) -> None:
    project = Pair("perpendicular", 1, True).project()
    project["features"][1] |= keys
    with pytest.raises(mor.InputError, match=words):
        mor.adjust(project)


def test_a_sphere_has_no_axis() -> None:
    project = Pair("perpendicular", 1, False).project()
    project["features"][1]["type"] = "sphere"
    with pytest.raises(mor.InputError, match="axis: the sphere 'B' has no axis"):
        mor.adjust(project)


@pytest.mark.parametrize("relation", ["parallel", "coaxial", "coplanar"])
def test_a_third_feature_takes_the_axis_of_a_perpendicular_one(relation: str) -> None:
    """Every point of the second shape is on a third one, too: with its axis the third one is the same shape."""
    project = Pair("perpendicular", 4, True).project()
    project["features"].append({**project["features"][1], "id": "C", relation: "B"})
    del project["features"][2]["perpendicular"]
    features = mor.adjust(project).features
    second, third = features.row("B"), features.row("C")
    for key in ("dx", "dy", "dz", "x", "y", "z", "radius", "sx", "sradius"):
        assert third[key] == pytest.approx(second[key], rel=1e-9)
    project["features"][2] |= {relation: None, "perpendicular": "B"}
    with pytest.raises(mor.InputError, match="'B' is itself perpendicular to another feature"):
        mor.adjust(project)
