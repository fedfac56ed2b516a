"""Points that a wrong sight has drawn away, put back to where most of what tells of them has them."""

import numpy as np
import pytest

from mor.quality.outliers import Starts, by_sights_alone, reintersected
from mor.quality.robust_estimation import exclude
from tests.scenarios.scenes import Scene

TARGET = (3.0, 4.0, 1.0)
STATIONS = {"A": (0.0, 0.0, 0.0), "B": (10.0, 0.0, 0.5), "C": (2.0, 11.0, 0.0), "D": (-6.0, 7.0, 2.0)}
SIGHT, LENGTH = "zenith_directions", "distance"


def scene_of(told, observed=None):
    """One target and what is told of it: station, type, components; ``observed``: of the first one, in place of it."""
    scene = Scene()
    for name, place in STATIONS.items():
        scene.add("point", name, place, free=False)
        scene.add("rotation", name, [0.0, 0.0, 0.3], free=False)
    scene.add("point", "T", TARGET)
    for number, (station, type_key, only) in enumerate(told):
        sight = (station, station, None, "T") if type_key == SIGHT else (station, None, "T", None)
        sigma = 1e-5 if type_key == SIGHT else 1e-4
        given = observed if number == 0 else None
        scene.observe(type_key, *sight, sigma=sigma, only=only, observed=given)
    return scene


def moved(scene, place):
    """Problem, values with the target at another place, and |v|/σ there."""
    problem, values = scene.problem(), scene.values()
    points = values["point"].copy()
    target = problem.index.blocks["point"].ids.index("T")
    points[target] = place
    values = {**values, "point": points}
    return problem, values, sizes_at(problem, values), target


def sizes_at(problem, values):
    """|v|/σ (n, m) of all groups."""
    sizes = []
    for group in problem.groups:
        blocks = [values[slot.kind][b] for slot, b in zip(group.type.slots, group.blocks, strict=True)]
        off = (group.observed - group.type.equation(blocks, group.constants).values) / group.sigma
        sizes.append(np.where(group.mask, np.abs(np.nan_to_num(off)), 0.0))
    return tuple(sizes)


@pytest.mark.parametrize(
    "told",
    [
        pytest.param([("B", SIGHT, None), ("C", SIGHT, None)], id="sights"),
        pytest.param([("B", SIGHT, [0]), ("C", SIGHT, None), ("D", SIGHT, [1])], id="halves of sights"),
        pytest.param([("B", LENGTH, None), ("C", SIGHT, None), ("D", LENGTH, None)], id="with distances"),
        pytest.param([(station, LENGTH, None) for station in "ABCD"], id="distances"),
    ],
)
def test_of_a_wrong_sight_and_others_most_are_believed(told):
    scene = scene_of([("A", SIGHT, None), *told], observed=(0.9, 1.2))
    place = np.add(TARGET, [1.0, -2.0, 0.5])
    problem, values, sizes, target = moved(scene, place)
    found = reintersected(problem, values, sizes)["point"]
    np.testing.assert_allclose(found[target], TARGET, atol=1e-6)
    others = np.arange(len(found)) != target
    np.testing.assert_array_equal(found[others], values["point"][others])


def test_a_point_that_nothing_controls_stays():
    scene = scene_of([("A", SIGHT, None), ("B", LENGTH, None)], observed=(0.9, 1.2))
    problem, values, sizes, target = moved(scene, np.add(TARGET, 1.0))
    assert np.array_equal(reintersected(problem, values, sizes)["point"], values["point"])
    assert np.isfinite(by_sights_alone(problem, values, np.array([target]))).all(), "but has one place"


def test_what_is_kept_out_has_no_say():
    """Two wrong ones agree with each other, and outvote the only good one that is left."""
    told = [("A", SIGHT, None), ("B", SIGHT, None), ("C", SIGHT, None)]
    problem, values, sizes, target = moved(scene_of(told, observed=(0.9, 1.2)), np.add(TARGET, 1.0))
    out = np.zeros((3, 2), dtype=bool)
    out[2] = True
    found = reintersected(exclude(problem, [out]), values, sizes)["point"][target]
    assert np.linalg.norm(found - TARGET) > 0.1


def test_a_place_that_fits_nothing_is_none_where_sigmas_are_right():
    """Of four sights two agree; where all four miss by as much, their own median must not be taken for their σ."""
    told = [(station, SIGHT, None) for station in "ABCD"]
    scene = scene_of(told, observed=(0.9, 1.2))
    for number in range(20):
        scene.add("point", f"N{number}", np.add(TARGET, [number + 1.0, 0.3 * number, 0.0]))
        for station in "ABC":
            scene.observe(SIGHT, station, station, None, f"N{number}", sigma=1e-5)
    problem, values, _, target = moved(scene, TARGET)
    problem.groups[0].observed[1] += [0.7, -0.4]
    found = reintersected(problem, values, sizes_at(problem, values))["point"]
    np.testing.assert_allclose(found[target], TARGET, atol=1e-6)


def test_of_two_places_alike_the_one_where_the_point_was_thought_to_be_is_taken():
    """Two sights to the target, two to its neighbour under the same name: two against two."""
    other = np.add(TARGET, [1.0, -2.0, 0.5])
    sights = {"A": TARGET, "B": TARGET, "C": other, "D": other}
    scene = scene_of([(station, SIGHT, None) for station in "ABCD"])
    problem = scene.problem()
    values = scene.values()
    target = problem.index.blocks["point"].ids.index("T")
    group = problem.groups[0]
    for row, place in enumerate(sights.values()):
        points = values["point"].copy()
        points[target] = place
        blocks = [{**values, "point": points}[s.kind][b] for s, b in zip(group.type.slots, group.blocks, strict=True)]
        group.observed[row] = group.type.equation(blocks, group.constants).values[row]
    for here, there in ((TARGET, other), (other, TARGET)):
        points = values["point"].copy()
        points[target] = there
        at = {**values, "point": points}
        start = values["point"].copy()
        start[target] = np.add(here, 0.02)
        found = reintersected(problem, at, sizes_at(problem, at), Starts(start, 0.05))["point"]
        np.testing.assert_allclose(found[target], here, atol=1e-6)
