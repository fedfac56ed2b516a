"""From blocks to columns and back: numbering, shared and fixed components, and how a step moves values."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.parameters import (
    HEIGHT,
    INTERIORS,
    KINDS,
    POINT,
    ROTATION,
    Blocks,
    index_unknowns,
    move,
    moves_by_angles,
    tangents,
)
from mor.model.rotations import angles_from_rotation, rotate, rotation_from_angles, tangent_of_angles

ANGLES = np.array([[0.1, 0.2, 0.3], [0.4, -0.5, 0.6], [0.0, 0.0, 1.0], [-0.3, 0.2, 2.0]])


def _own(n, size):
    return np.repeat(np.arange(n)[:, None], size, axis=1)


def _blocks():
    points = Blocks(POINT, ("a", "b"), np.array([[1, 1, 0], [1, 1, 1]], dtype=bool), _own(2, 3))
    free = np.array([[1, 1, 1], [0, 0, 0], [0, 0, 1], [1, 0, 1]], dtype=bool)
    axes = np.array([False, False, False, True])
    rotations = Blocks(ROTATION, ("r", "s", "t", "u"), free, _own(4, 3), axes)
    heights = Blocks(HEIGHT, ("h",), np.zeros((1, 1), dtype=bool), _own(1, 1))
    return {"point": points, "rotation": rotations, "height": heights}


def _values():
    return {
        "point": np.arange(6.0).reshape(2, 3),
        "rotation": rotation_from_angles(ANGLES),
        "height": np.array([[1.5]]),
    }


def test_free_components_are_numbered_without_gaps_kind_by_kind():
    index = index_unknowns(_blocks())
    assert index.count == 5 + 3 + 1 + 2
    together = np.concatenate([columns.ravel() for columns in index.columns.values()])
    assert sorted(together[together >= 0]) == list(range(index.count))
    np.testing.assert_array_equal(index.columns["height"], [[-1]])
    np.testing.assert_array_equal(index.columns["rotation"], [[0, 1, 2], [-1, -1, -1], [-1, -1, 3], [4, -1, 5]])
    np.testing.assert_array_equal(index.columns["point"], [[6, 7, -1], [8, 9, 10]])


def test_labels_lead_back_from_a_column_to_its_component():
    blocks = _blocks()
    index = index_unknowns(blocks)
    for key, columns in index.columns.items():
        for block, component in zip(*np.nonzero(columns >= 0), strict=True):
            label = index.label(int(columns[block, component]))
            assert label == (key, blocks[key].ids[block], KINDS[key].names[component])


def test_shared_components_are_one_unknown():
    kind = INTERIORS["mor"]
    owner = _own(3, kind.size)
    owner[1, 1:] = 0  # the second camera has a camera constant of its own, all else is the first one's
    owner[2] = 0
    free = np.zeros((3, kind.size), dtype=bool)
    free[:, :4] = True
    index = index_unknowns({kind.key: Blocks(kind, ("1", "2", "3"), free, owner)})
    assert index.count == 5
    np.testing.assert_array_equal(index.columns[kind.key][:, :4], [[0, 1, 2, 3], [4, 1, 2, 3], [0, 1, 2, 3]])
    start = {kind.key: np.tile(np.arange(10.0), (3, 1))}
    moved = move(index, start, np.array([1.0, 2.0, 3.0, 4.0, 5.0]))[kind.key] - start[kind.key]
    np.testing.assert_array_equal(moved[:, :4], [[1, 2, 3, 4], [5, 2, 3, 4], [1, 2, 3, 4]])
    assert index.label(4) == (kind.key, "2", "c")


def test_a_component_shared_with_a_fixed_one_is_fixed():
    owner = _own(2, 3)
    owner[1] = 0
    free = np.array([[False] * 3, [True] * 3])
    index = index_unknowns({"point": Blocks(POINT, ("a", "b"), free, owner)})
    assert index.count == 0
    assert (index.columns["point"] == -1).all()


def test_no_unknowns_at_all():
    index = index_unknowns({})
    assert index.count == 0
    assert move(index, {}, np.zeros(0)) == {}


def test_partly_free_rotations_move_by_angles_unless_about_their_axes():
    np.testing.assert_array_equal(moves_by_angles(_blocks()["rotation"]), [False, False, True, False])


def test_a_step_moves_each_kind_in_its_own_way():
    index, values = index_unknowns(_blocks()), _values()
    step = np.linspace(0.01, 0.11, 11)
    moved = move(index, values, step)
    np.testing.assert_allclose(moved["point"] - values["point"], [[0.07, 0.08, 0.0], [0.09, 0.1, 0.11]], rtol=1e-12)
    np.testing.assert_array_equal(moved["height"], values["height"])
    D = values["rotation"]
    np.testing.assert_allclose(moved["rotation"][0], rotate(D[:1], step[None, :3])[0], atol=1e-16)
    np.testing.assert_array_equal(moved["rotation"][1], D[1])
    # levelled: only κ changes, ω and φ stay exactly zero
    np.testing.assert_allclose(angles_from_rotation(moved["rotation"][2]), [0.0, 0.0, 1.04], atol=1e-15)
    turned = rotate(D[3:], np.array([[step[4], 0.0, step[5]]]))[0]
    np.testing.assert_allclose(moved["rotation"][3], turned, atol=1e-16)


def test_moving_leaves_the_old_values_alone():
    index, values = index_unknowns(_blocks()), _values()
    before = {key: array.copy() for key, array in values.items()}
    move(index, values, np.full(index.count, 0.1))
    for key, array in before.items():
        np.testing.assert_array_equal(values[key], array)


def test_tangents_are_those_of_the_moves():
    blocks, D = _blocks()["rotation"], _values()["rotation"]
    result = tangents(blocks, D)
    assert result is not None
    np.testing.assert_array_equal(result[[0, 1, 3]], np.broadcast_to(np.eye(3), (3, 3, 3)))
    np.testing.assert_allclose(result[2], tangent_of_angles(ANGLES[2]), atol=1e-15)
    whole = Blocks(ROTATION, ("r",), np.ones((1, 3), dtype=bool), _own(1, 3))
    assert tangents(whole, D[:1]) is None


@pytest.mark.parametrize("key", KINDS)
def test_every_kind_is_filed_under_its_own_key(key):
    assert KINDS[key].key == key
    assert len(set(KINDS[key].names)) == KINDS[key].size
    assert KINDS[key].is_rotation == (key == "rotation")
