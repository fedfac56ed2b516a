"""Local networks on a sphere (`curvature`): exact geometry, bias, Jacobians, what is said without it, refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mor
from mor.api.pipeline import determinable_start, levels, make_problem
from mor.errors import InputError
from mor.model.contract import wrap
from mor.model.curvature import on_sphere
from mor.model.earth import LocalSphere, gaussian_radius
from mor.model.images import IMAGE_TYPES
from mor.model.observation_types import PLAIN_TYPES
from mor.model.parameters import KINDS
from mor.model.rotations import rotate, rotation_from_angles
from mor.quality.assessment import assess, standard_deviations
from mor.solve.iterate import SolverSettings, adjust
from tests.scenarios.small_projects import mor as command
from tests.scenarios.small_projects import write
from tests.scenarios.sphere_scenes import RADIUS, Place, network, sight

CASE = Path(__file__).parents[1] / "cases" / "curvature"
SPHERE = LocalSphere(RADIUS, (200.0, -300.0, 50.0))
CHANGED = [t for t in (*PLAIN_TYPES.values(), IMAGE_TYPES["brown"]) if on_sphere(t, SPHERE) is not t]


def blocks_of(type_: Any, random: np.random.Generator) -> list[np.ndarray]:
    """Blocks of one observation over some hundred metres; cameras look down."""
    blocks = []
    for slot in type_.slots:
        size = KINDS[slot.kind].size
        if slot.kind == "point":
            here = random.uniform(-600.0, 600.0, (1, 3)) * [1.0, 1.0, 0.1]
            if type_.key.startswith("image/") and slot.of == "image":
                here[:, 2] += 2000.0
            blocks.append(here)
        elif slot.kind == "rotation":
            blocks.append(rotation_from_angles(random.uniform(-0.01, 0.01, (1, 3)) * [1.0, 1.0, 100.0]))
        elif slot.kind in ("scale", "distance meter"):
            blocks.append(np.array([[1.0, 0.0]])[:, :size])
        elif slot.kind.startswith("interior/"):
            blocks.append(np.array([[10.0, *([1e-6] * (size - 1))]]))
        else:
            blocks.append(random.uniform(0.0, 2.0, (1, size)))
    return blocks


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("type_", CHANGED, ids=lambda type_: type_.key)
def test_jacobians_differ_from_differences_by_the_sight_over_the_radius(type_: Any, seed: int) -> None:
    """The derivatives are those of parallel verticals; what they leave out is at most some d/R of the largest."""
    random = np.random.default_rng(seed)
    curved = on_sphere(type_, SPHERE)
    blocks = blocks_of(type_, random)
    known = {"earth radius": RADIUS, "face": 1.0}
    constants = np.array([[known.get(c.name, 0.1) for c in type_.constants]])
    jacobians = curved.equation(blocks, constants).jacobians
    lengths = [np.abs(j).max() for slot, j in zip(type_.slots, jacobians, strict=True) if slot.kind == "point"]
    for k, slot in enumerate(type_.slots):
        differences = np.zeros_like(jacobians[k])
        for c in range(KINDS[slot.kind].size):
            step = 1e-3 if slot.kind == "point" else 1e-5
            ends = []
            for sign in (1.0, -1.0):
                moved = list(blocks)
                by = sign * step * np.eye(KINDS[slot.kind].size)[c][None]
                moved[k] = rotate(blocks[k], by) if slot.kind == "rotation" else blocks[k] + by
                ends.append(curved.equation(moved, constants).values)
            change = ends[0] - ends[1]
            change[:, type_.wraps] = wrap(change[:, type_.wraps])
            differences[:, :, c] = change / (2.0 * step)
        largest = max(lengths) if slot.kind in ("point", "height") else np.abs(jacobians[k]).max()
        assert np.abs(jacobians[k] - differences).max() < 1e-3 * largest + 1e-9, slot


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_a_network_without_noise_comes_out_exactly(seed: int, free: bool) -> None:
    """One-way and reciprocal networks of 100 m to 10 km; free ones have shifts and the turn as their datum."""
    project, where, _ = network(seed, free=free, noise=0.0)
    result = mor.adjust(project)
    for row in result.points.frame.iter_rows(named=True):
        assert [row[axis] for axis in "xyz"] == pytest.approx(where[row["id"]], abs=1e-6)
    assert result.to_dict()["defect"] == (4 if free else 0)


def errors(seed: int, free: bool, curved: bool = True) -> tuple[float, float, float, float]:
    """Error over σ in x, y and z of the last point, and vᵀPv over the redundancy, of a network with noise."""
    project, where, _ = network(seed, free=free)
    if not curved:
        project.pop("curvature")
    built, start = determinable_start(mor.read(project).network)
    solved = adjust(make_problem(built, start, start), start, SolverSettings(50))
    assert solved.outcome.is_solution
    quality = assess(solved, levels(built.project.settings), False)
    name = list(where)[-1]
    block = built.things["point"].part(name, "position")
    error = solved.values["point"][block] - np.array(where[name])
    return (*(error / standard_deviations(quality, "point")[block]), quality.omega / quality.redundancy)


def bias(seeds: range, free: bool, curved: bool = True) -> tuple[np.ndarray, float]:
    """Mean error over σ in x, y and z, and the mean of vᵀPv over the redundancy."""
    found = np.array([errors(seed, free, curved) for seed in seeds])
    return found[:, :3].mean(axis=0), float(found[:, 3].mean())


@pytest.mark.parametrize("free", [False, True])
def test_results_are_unbiased(free: bool) -> None:
    """The mean of n errors of σ 1 lies within 3/√n of 0."""
    mean, factor = bias(range(16), free)
    assert np.abs(mean).max() < 3.0 / np.sqrt(16)
    assert 0.75 < factor < 1.25


@pytest.mark.slow
@pytest.mark.parametrize("free", [False, True])
def test_results_of_many_networks_are_unbiased(free: bool) -> None:
    """200 networks; without the curvature heights of the same ones are off by many σ."""
    mean, factor = bias(range(200), free)
    assert np.abs(mean).max() < 3.0 / np.sqrt(200)
    assert 0.95 < factor < 1.05
    if not free:
        assert abs(bias(range(200), free, False)[0][2]) > 1.0


def test_a_horizontal_distance_is_at_the_height_of_the_instrument() -> None:
    """As total stations compute it from slope distance s and zenith angle z: Y − X Y/R, X = s cos z, Y = s sin z."""
    a, b = Place("A", 0.0, 0.0, 20.0, 0.0), Place("B", 300.0, 400.0, 90.0, 0.0)
    _, zenith, slope = sight(a, b, 1.5, 1.7, 0.0, 0.0)
    expected = slope * np.sin(zenith) * (1.0 - slope * np.cos(zenith) / RADIUS)
    type_ = on_sphere(PLAIN_TYPES["horizontal_distance"], LocalSphere(RADIUS, (0.0, 0.0, 0.0)))
    blocks = [np.array([block]) for block in ([0.0, 0.0, 20.0], [1.5], [300.0, 400.0, 90.0], [1.7], [1.0, 0.0])]
    found = type_.equation(blocks, np.zeros((1, 0))).values[0, 0]
    assert found == pytest.approx(expected, abs=1e-5)
    assert found == pytest.approx(500.0 * (1.0 + 21.5 / RADIUS), abs=1e-9)  # the arc, at the height of the instrument
    assert abs(found - slope * np.sin(zenith)) > 0.005  # in the horizon of the instrument it is longer


def test_image_rays_are_straight() -> None:
    """Three cameras over 3 km: points on the sphere, computed in space, come out as plan coordinates and heights."""
    random = np.random.default_rng(5)
    points = [Place(f"P{k}", *random.uniform(-1500.0, 1500.0, 2), random.uniform(0.0, 80.0), 0.0) for k in range(12)]
    cameras = {"I1": (-900.0, 0.0, 2500.0), "I2": (100.0, 700.0, 2600.0), "I3": (800.0, -600.0, 2550.0)}
    rows = []
    for name, (x, y, z) in cameras.items():
        centre = Place(name, x, y, z, 0.0).position
        rows += [[name, p.name, *(-10.0 * (v := p.position - centre)[:2] / v[2])] for p in points]
    project: dict[str, Any] = {
        "mor": 1,
        "curvature": {"origin": {"x": 0, "y": 0, "z": 0}},
        "cameras": {"C": {"interior": {"c": 10.0}}},
        "images": [{"columns": ["id", "camera"], "rows": [[name, "C"] for name in cameras]}],
        "points": [
            {
                "columns": ["id", "x", "y", "z"],
                "fixed": ["x", "y", "z"],
                "rows": [[p.name, p.x, p.y, p.height] for p in points[:5]],
            },
            {"columns": ["id"], "rows": [[p.name] for p in points[5:]]},
        ],
        "observations": [
            {
                "type": "image",
                "columns": ["image", "point", "x", "y"],
                "rows": rows,
                "values": {"sigma": "1 um"},
            }
        ],
    }
    result = mor.adjust(project)
    for row in result.points.frame.iter_rows(named=True):
        place = points[int(row["id"][1:])]
        assert [row["x"], row["y"], row["z"]] == pytest.approx([place.x, place.y, place.height], abs=1e-5)
    for row in result.images.frame.iter_rows(named=True):
        assert [row["x"], row["y"], row["z"]] == pytest.approx(cameras[row["id"]], abs=1e-4)


def test_project_axes_do_not_matter() -> None:
    """With x north and y east the origin, the coordinates and the results change places."""
    project, where, _ = network(2, noise=0.0)
    turned = json.loads(json.dumps(project, default=float))
    turned["axes"] = {"xy": "ne"}
    origin = turned["curvature"]["origin"]
    origin["x"], origin["y"] = origin["y"], origin["x"]
    table = turned["points"][0]
    table["rows"] = [[name, y, x, z] for name, x, y, z in table["rows"]]
    for row in mor.adjust(turned).points.frame.iter_rows(named=True):
        assert [row["y"], row["x"], row["z"]] == pytest.approx(where[row["id"]], abs=1e-6)


def test_the_adjusted_project_keeps_the_origin(tmp_path: Path) -> None:
    """By itself the origin is the median of the given coordinates, which adjusted.yaml has more of."""
    text = (CASE / "net2.yaml").read_text(encoding="utf-8").replace("datum: fixed", "curvature: true\ndatum: fixed")
    folder = tmp_path / "case"
    project = write(folder, text, **{n: (CASE / f"{n}.csv").read_text(encoding="utf-8") for n in ("fb2", "kn")})
    ran = command("adjust", project, "-o", folder / "first")
    assert ran.code == 0
    assert "at height 309 m at x = 5003, y = 2390" in ran.out + ran.err
    again = command("adjust", folder / "first" / "adjusted.yaml", "-o", folder / "second")
    assert "at height 309 m at x = 5003, y = 2390" in again.out + again.err
    one, two = (json.loads((folder / f / "results.json").read_text(encoding="utf-8")) for f in ("first", "second"))
    assert one["sigma0"] == pytest.approx(two["sigma0"], rel=1e-6)
    assert one["flagged"] == 0
    assert one["global_test"]["accepted"]


def test_a_project_without_it_hears_of_the_curvature(tmp_path: Path) -> None:
    """Clean zenith angles over up to 560 m: the curvature is named, with its size, and an index error is not."""
    ran = command("adjust", CASE / "net2.yaml", "-o", tmp_path / "out")
    said = ran.out + ran.err
    assert "station B, to D over 545.7 m is off by 23 mm (3.4 sigma)" in said
    assert "curvature: true models it" in said
    assert "Possible cause, not verified (run mor diagnose): the curvature of the earth is not modelled." in said
    assert "A common offset" not in said


def line(distance: float, curvature: bool = False) -> list[str]:
    """Notes of a project with one zenith angle over a distance, σ 1 mgon."""
    project: dict[str, Any] = {
        "mor": 1,
        "units": {"length": "m", "angle": "gon"},
        "points": [
            {"columns": ["id", "x", "y", "z"], "rows": [["A", 0, 0, 0]], "fixed": ["x", "y", "z"]},
            {"columns": ["id", "x", "y", "z"], "rows": [["B", distance, 0, None]], "fixed": ["x", "y"]},
        ],
        "observations": [
            {
                "type": "zenith_angle",
                "columns": ["from", "to", "zenith_angle"],
                "rows": [["A", "B", 100.0]],
                "values": {"sigma": "1 mgon"},
            }
        ],
    }
    if curvature:
        project["curvature"] = True
    return [note["message"] for note in mor.adjust(project).to_dict()["notes"]]


def test_the_note_begins_at_a_third_of_a_sigma() -> None:
    """s/2R is 0.3 mgon at 60.05 m: 0.28 mm; over 400 m it is 13 mm."""
    assert not any("curvature" in note for note in line(59.0))
    assert any("over 62 m is off by 0.3 mm (0.31 sigma)" in note for note in line(62.0))
    assert any("over 400 m is off by 13 mm (2 sigma)" in note for note in line(400.0))
    assert not any("is off by" in note for note in line(400.0, curvature=True))


def test_distances_alone_say_nothing_of_the_curvature() -> None:
    """They are straight lines, and fit any coordinates; so do levelled heights alone."""
    rows = [["A", "B", 5000.0], ["B", "C", 4000.0], ["A", "C", 3000.0]]
    flat = {
        "mor": 1,
        "settings": {"dimensions": "xy"},
        "points": [
            {"columns": ["id", "x", "y"], "rows": [["A", 0, 0], ["B", 5000, 0]], "fixed": ["x", "y"]},
            {"columns": ["id", "x", "y"], "rows": [["C", 1800, 2400]]},
        ],
        "observations": [
            {
                "type": "distance",
                "columns": ["from", "to", "distance"],
                "rows": rows,
                "values": {"sigma": 0.001},
            }
        ],
    }
    assert not any("curvature" in note["message"] for note in mor.adjust(flat).to_dict()["notes"])


def test_the_radius_of_a_latitude() -> None:
    """√(M N) = a √(1 − e²)/(1 − e² sin²φ)."""
    e2 = 0.00669438002290
    for latitude in np.radians([0.0, 48.0, 90.0]):
        expected = 6_378_137.0 * np.sqrt(1.0 - e2) / (1.0 - e2 * np.sin(latitude) ** 2)
        assert gaussian_radius(float(latitude)) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"radius": 6371}, "found 6.371 km, expected that of the earth"),
        ({"radius": "6371 km", "latitude": "48 deg"}, "two ways to say the same"),
        ({"latitude": "98 deg"}, "between -90° and 90°"),
        ({"origin": {"x": 0, "y": 0}}, "z"),
        ({"radius": "48 gon"}, "does not fit a length"),
    ],
)
def test_what_is_refused(section: dict[str, Any], words: str) -> None:
    """A mistake in the section is told in words."""
    project, _, _ = network(1)
    project["curvature"] = section
    with pytest.raises(InputError, match=words):
        mor.read(project)


def test_a_network_on_the_ellipsoid_has_it_already() -> None:
    """With `world` the key is refused."""
    project = {
        "mor": 1,
        "world": {"crs": "EPSG:4936"},
        "curvature": True,
        "points": [{"columns": ["id", "x", "y", "z"], "rows": [["A", 4e6, 1e6, 4.8e6]]}],
    }
    with pytest.raises(InputError, match="has it already"):
        mor.read(project)
