"""What every observation type keeps to, so that everything above it can be written once."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.contract import wrap
from mor.model.observation_types import ALL_TYPES
from mor.model.parameters import KINDS
from mor.units import ANGLE

TYPES = pytest.mark.parametrize("kind", ALL_TYPES.values(), ids=ALL_TYPES.keys())
NAMESPACES = {"point", "station", "image", "system", "feature", *KINDS}


def _blocks(kind, n, seed=0):
    random = np.random.default_rng(seed)
    blocks = []
    for slot in kind.slots:
        size = KINDS[slot.kind].size
        if slot.kind == "rotation":
            blocks.append(np.broadcast_to(np.eye(3), (n, 3, 3)).copy())
        else:
            blocks.append(random.uniform(0.1, 1.0, (n, size)))
    positions = [block for slot, block in zip(kind.slots, blocks, strict=True) if slot.part == "position"]
    if len(positions) > 1:
        positions[-1][:, 2] -= 30.0  # in front of a camera
    constants = np.tile([component.default for component in kind.constants], (n, 1))
    return blocks, constants


@TYPES
def test_slots_and_references_fit_together(kind):
    names = {reference.name for reference in kind.references}
    assert {slot.of for slot in kind.slots} - {"instrument"} <= names
    assert all(slot.kind in KINDS for slot in kind.slots)
    assert all(set(reference.among) <= NAMESPACES for reference in kind.references)
    assert len({(slot.of, slot.kind, slot.part) for slot in kind.slots}) == len(kind.slots)
    assert kind.distances is None or set(kind.distances) <= names


@TYPES
def test_column_names_of_a_row_are_unique(kind):
    names = [reference.name for reference in kind.references]
    names += [component.name for component in (*kind.components, *kind.constants)]
    assert len(set(names)) == len(names)


@TYPES
def test_rows_do_not_depend_on_each_other_and_arguments_stay_as_they_were(kind):
    blocks, constants = _blocks(kind, 4)
    for array in (*blocks, constants):
        array.setflags(write=False)
    together = kind.equation(blocks, constants)
    for i in range(4):
        alone = kind.equation([block[i : i + 1] for block in blocks], constants[i : i + 1])
        np.testing.assert_allclose(alone.values, together.values[i : i + 1], rtol=1e-13)
        for one, all_rows in zip(alone.jacobians, together.jacobians, strict=True):
            np.testing.assert_allclose(one, all_rows[i : i + 1], rtol=1e-12, atol=1e-15)


@TYPES
def test_no_rows_at_all_are_served(kind):
    blocks, constants = _blocks(kind, 0)
    computed = kind.equation(blocks, constants)
    assert computed.values.shape == (0, len(kind.components))
    for slot, jacobian in zip(kind.slots, computed.jacobians, strict=True):
        assert jacobian.shape == (0, len(kind.components), KINDS[slot.kind].size)


@TYPES
def test_angles_wrap_and_nothing_else(kind):
    assert kind.wraps.tolist() == [component.quantity == ANGLE for component in kind.components]


def test_wrap_folds_into_half_a_circle_either_way():
    angles = np.array([0.0, 1.0, -1.0, 3.2, -3.2, 2 * np.pi, 4 * np.pi + 0.1, 400.0 * np.pi - 1e-9])
    folded = wrap(angles)
    assert (np.abs(folded) <= np.pi).all()
    np.testing.assert_allclose(np.exp(1j * folded), np.exp(1j * angles), atol=1e-13)
    np.testing.assert_allclose(folded[-1], -1e-9, atol=1e-12)
