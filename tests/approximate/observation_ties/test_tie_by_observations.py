"""The movement between two parts by nothing but observations between them, against a movement that is known."""

from dataclasses import replace

import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document, read_network
from mor.model.contract import some_rows
from mor.model.rotations import exponential
from mor.start import join_by_observations
from mor.start.bundle import Similarity, SimilarityOutcome
from mor.start.join_by_observations import SEARCHED, tie_by_observations
from mor.start.part import empty_part
from mor.start.scene import scene_of

LEFT = [f"L{k}" for k in range(6)]
RIGHT = [f"R{k}" for k in range(6)]
SCALE, SHIFT = 0.2, np.array([3.0, -1.0, 2.0])
TURN = exponential(np.array([[0.4, -0.9, 1.7]]))[0]


def places(draw):
    """Points of two parts, and two stations that neither knows."""
    left = draw.uniform(-5.0, 5.0, (6, 3))
    right = draw.uniform(-5.0, 5.0, (6, 3)) + np.array([14.0, 2.0, 1.0])
    return dict(zip([*LEFT, *RIGHT], np.concatenate([left, right]), strict=True)) | {
        "N": np.array([6.0, -9.0, 0.5]),
        "M": np.array([1.0, 11.0, -2.0]),
    }


def pairs(draw, count):
    return [(str(draw.choice(LEFT)), str(draw.choice(RIGHT))) for _ in range(count)]


def distances(at, draw):
    rows = [[a, b, float(np.linalg.norm(at[b] - at[a]))] for a, b in pairs(draw, 14)]
    return [{"type": "distance", "values": {"sigma": 1e-3}, "columns": ["from", "to", "distance"], "rows": rows}]


def spatial_angles(at, draw):
    rows = []
    for a, b in pairs(draw, 24):
        fixed, far, near = (a, b, LEFT) if draw.random() < 0.5 else (b, a, RIGHT)
        other = next(p for p in draw.permutation(near) if p != fixed)
        u, v = at[far] - at[fixed], at[other] - at[fixed]
        angle = float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))
        rows.append([fixed, far, str(other), angle])
    columns = ["at", "from", "to", "angle"]
    return [{"type": "spatial_angle", "values": {"sigma": 1e-5}, "columns": columns, "rows": rows}]


def zenith_angles_and_distances(at, draw):
    """From stations that neither knows; from one alone a part would be free to turn about it."""
    away = [(n, p, at[p] - at[n]) for n in "NM" for p in [*LEFT, *RIGHT]]
    lengths = [[n, p, float(np.linalg.norm(d))] for n, p, d in away]
    zeniths = [[n, p, float(np.arctan2(np.hypot(d[0], d[1]), d[2]))] for n, p, d in away]
    ends = ["from", "to"]
    return [
        {"type": "distance", "values": {"sigma": 1e-3}, "columns": [*ends, "distance"], "rows": lengths},
        {
            "type": "zenith_angle",
            "values": {"sigma": 1e-5},
            "columns": [*ends, "zenith_angle"],
            "rows": zeniths,
        },
    ]


def two_parts(observations, at, folder):
    """The network, its scene, and the parts: the left points as they are, the right ones moved."""
    import json

    text = {
        "mor": "1",
        "units": {"length": "m", "angle": "rad"},
        "points": [{"columns": ["id"], "rows": [[p] for p in at]}],
        "datum": "free",
        "observations": observations,
    }
    (folder / "project.yaml").write_text(json.dumps(text), encoding="utf-8")
    network = read_network(read_document(folder / "project.yaml"), folder)
    ids = list(network.blocks["point"].ids)
    target, source = empty_part(len(ids)), empty_part(len(ids))
    target.levelled = target.scaled = True
    for p in LEFT:
        target.points[ids.index(p)] = at[p]
    for p in RIGHT:
        source.points[ids.index(p)] = at[p]
    there = Similarity(SimilarityOutcome.DETERMINED, SCALE, TURN, SHIFT, np.zeros((0, 3)), 0.0)
    source.transform(there)
    source.number = 1
    return network, scene_of(network), target, source


@pytest.mark.parametrize("observed", [distances, spatial_angles, zenith_angles_and_distances])
def test_observations_of_one_sort_tie_two_parts(observed, tmp_path):
    draw = np.random.default_rng(5)
    at = places(draw)
    network, scene, target, source = two_parts(observed(at, draw), at, tmp_path)
    found = tie_by_observations(network, target, source, scene)
    assert found is not None
    assert found.open == 0
    np.testing.assert_allclose(found.scale, 1.0 / SCALE, rtol=1e-6)
    np.testing.assert_allclose(found.rotation, TURN.T, atol=1e-6)
    np.testing.assert_allclose(found.shift, -TURN.T @ SHIFT / SCALE, atol=1e-4)


def test_the_number_of_searches_in_a_network_is_limited(tmp_path):
    draw = np.random.default_rng(5)
    at = places(draw)
    network, scene, target, source = two_parts(distances(at, draw), at, tmp_path)
    searched = {k.to_bytes(2): None for k in range(SEARCHED)}
    assert tie_by_observations(network, target, source, replace(scene, tied=searched)) is None
    source.asked_for_ties.clear()
    assert tie_by_observations(network, target, source, scene) is not None


TILTED = Similarity(
    SimilarityOutcome.DETERMINED,
    7.0,
    exponential(np.array([[-0.8, 0.5, 0.3]]))[0],
    np.array([20.0, 5.0, -9.0]),
    np.zeros((0, 3)),
    0.0,
)
"""How a target stands that knows neither the vertical nor the length unit."""


def directions_of_one_station(at, draw):
    rows = []
    for p in [*LEFT, *RIGHT]:
        d = at[p] - at["N"]
        horizontal = float(np.arctan2(d[0], d[1])) + 0.7
        rows.append(["N", p, horizontal, float(np.arctan2(np.hypot(d[0], d[1]), d[2]))])
    columns = ["station", "to", "horizontal", "zenith"]
    return [
        {"type": "zenith_directions", "values": {"sigma": 1e-5}, "columns": columns, "rows": rows},
        *distances(at, draw),
    ]


@pytest.mark.parametrize("observed", [distances, directions_of_one_station])
def test_a_target_that_knows_neither_vertical_nor_unit_is_tied(observed, tmp_path):
    """The search also finds the vertical and the unit; it does not take the axes of the target for them."""
    draw = np.random.default_rng(5)
    at = places(draw)
    network, scene, target, source = two_parts(observed(at, draw), at, tmp_path)
    target.transform(TILTED)
    target.levelled = target.scaled = False
    found = tie_by_observations(network, target, source, scene)
    assert found is not None
    assert found.open == 0
    np.testing.assert_allclose(found.scale, TILTED.scale / SCALE, rtol=1e-6)
    np.testing.assert_allclose(found.rotation, TILTED.rotation @ TURN.T, atol=1e-6)


def test_one_gross_error_does_not_move_it(tmp_path):
    draw = np.random.default_rng(5)
    at = places(draw)
    observations = distances(at, draw)
    observations[0]["rows"][3][2] += 2.0
    network, scene, target, source = two_parts(observations, at, tmp_path)
    found = tie_by_observations(network, target, source, scene)
    np.testing.assert_allclose(found.rotation, TURN.T, atol=1e-3)


def test_what_is_not_observed_stays_open(tmp_path):
    """Horizontal distances alone between a levelled part and one that is not scaled: nothing tells the height."""
    draw = np.random.default_rng(5)
    at = places(draw)
    rows = [[a, b, float(np.hypot(*(at[b] - at[a])[:2]))] for a, b in pairs(draw, 20)]
    observations = [
        {
            "type": "horizontal_distance",
            "values": {"sigma": 1e-3},
            "columns": ["from", "to", "distance"],
            "rows": rows,
        }
    ]
    network, scene, target, source = two_parts(observations, at, tmp_path)
    source.transform(Similarity(SimilarityOutcome.DETERMINED, 1.0 / SCALE, TURN.T, np.zeros(3), np.zeros((0, 3)), 0.0))
    source.levelled = True
    found = tie_by_observations(network, target, source, scene, 0)
    assert found.open == 1
    np.testing.assert_allclose(found.scale, 1.0, rtol=1e-4)


def test_too_few_observations_tie_nothing(tmp_path):
    draw = np.random.default_rng(5)
    at = places(draw)
    observations = distances(at, draw)
    observations[0]["rows"] = observations[0]["rows"][:8]
    network, scene, target, source = two_parts(observations, at, tmp_path)
    found = tie_by_observations(network, target, source, scene)
    assert found is None or found.open > 0


@pytest.mark.slow
def test_no_observation_that_agrees_ties_nothing(tmp_path):
    """Directions of 1e16 as possible causes change them: at no place is there one that fits."""
    (tmp_path / "project.yaml").write_text("""
mor: 1
settings: {dimensions: xy}
points:
  - {columns: [id, x, y], rows: [[A, 0, 0], [B, 100, 0]], fixed: [x, y]}
  - {columns: [id], rows: [[S], [N]]}
observations:
  - type: directions
    columns: [station, to, horizontal]
    rows: [[S, A, 1e16], [S, A, 1e16], [S, A, 1e16], [S, N, 1e16], [N, S, 1e16], [N, B, 1e16]]
    values: {sigma: 1 mgon}
  - type: horizontal_distance
    columns: [from, to, distance]
    rows: [[A, S, 50], [S, N, 40], [N, B, 60]]
    values: {sigma: 2 mm}
""")
    assert not mor.adjust(tmp_path / "project.yaml").accepted


def test_a_table_of_which_no_row_is_left_ties_nothing(tmp_path):
    draw = np.random.default_rng(5)
    at = places(draw)
    network, scene, target, source = two_parts(distances(at, draw), at, tmp_path)
    empty = replace(network, groups=(*network.groups, some_rows(network.groups[0], np.zeros(0, dtype=np.int64))))
    assert tie_by_observations(empty, target, source, scene) is not None


@pytest.mark.parametrize(
    "observed", [distances, spatial_angles, zenith_angles_and_distances, directions_of_one_station]
)
def test_derivatives_of_a_search_are_those_of_its_residuals(observed, tmp_path, monkeypatch):
    draw = np.random.default_rng(8)
    at = places(draw)
    network, scene, target, source = two_parts(observed(at, draw), at, tmp_path)
    searches = []
    monkeypatch.setattr(join_by_observations, "minima", lambda search, _: searches.append(search) or None)
    monkeypatch.setattr(join_by_observations, "_judged", lambda *_: None)
    tie_by_observations(network, target, source, scene)
    (search,) = searches
    states = join_by_observations.some(join_by_observations.starts(search), np.arange(3))
    analytic = search.derivatives(states)
    for unknown, step in enumerate(1e-6 * np.eye(search.unknowns)):
        there, back = (search.residuals(search.moved(states, np.tile(sign * step, (3, 1)))) for sign in (1.0, -1.0))
        differences = (there - back) / 2e-6
        np.testing.assert_allclose(analytic[:, :, unknown], differences, rtol=1e-4, atol=1e-4 * np.abs(analytic).max())
