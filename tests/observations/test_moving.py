"""Twins of types whose points move: derivatives by velocity and oscillation, and the plain type where nothing moves."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.images import IMAGE_TYPES
from mor.model.observation_types import PLAIN_TYPES, PROJECTION_CENTRE_TYPES
from mor.model.parameters import KINDS, MOTIONS
from mor.model.rotations import rotation_from_angles
from mor.model.trajectory import basis, moving

TYPES = {
    **PLAIN_TYPES,
    **PROJECTION_CENTRE_TYPES,
    "image": IMAGE_TYPES["mor"],
    "panorama": IMAGE_TYPES["panorama"],
}
ROWS = 5
TIMES = np.array([2015.0, 2015.3, 2016.77, 2018.5, 2014.1])


def scene(key: str) -> tuple[list[np.ndarray], np.ndarray]:
    """Blocks of the twin with movements of decimetres, and constants."""
    random, type_ = np.random.default_rng(12), moving(TYPES[key])
    blocks = []
    for slot in type_.slots:
        kind = KINDS[slot.kind]
        if kind.is_rotation:
            blocks.append(rotation_from_angles(random.uniform(-0.4, 0.4, (ROWS, 3))))
        elif kind in MOTIONS:
            blocks.append(random.uniform(-0.1, 0.1, (ROWS, 3)))
        elif kind.key == "point":
            at_target = slot.of in ("point", "to", "from") and len(blocks) > 1
            blocks.append(random.uniform(-1.0, 1.0, (ROWS, 3)) + ([1.0, 2.0, -9.0] if at_target else 0.0))
        elif kind.key.startswith("interior/"):
            blocks.append(np.tile([20.0, *[0.0] * (kind.size - 1)], (ROWS, 1)))
        else:
            blocks.append(np.tile([c.default for c in kind.components], (ROWS, 1)))
    own = np.ones((ROWS, len(TYPES[key].constants)))
    return blocks, np.concatenate([own, basis(TIMES, 2015.0)], axis=1)


@pytest.mark.parametrize("key", [key for key, type_ in TYPES.items() if any(s.kind == "point" for s in type_.slots)])
def test_derivatives_by_what_moves_the_points(key: str) -> None:
    type_, (blocks, constants) = moving(TYPES[key]), scene(key)
    found = type_.equation(blocks, constants)
    wraps = type_.wraps
    for number, slot in enumerate(type_.slots):
        if KINDS[slot.kind] not in MOTIONS:
            continue
        for component in range(3):
            ends = []
            for step in (-1e-4, 1e-4):
                moved = [block.copy() for block in blocks]
                moved[number][:, component] += step
                ends.append(type_.equation(moved, constants).values)
            apart = ends[1] - ends[0]
            apart[:, wraps] = np.remainder(apart[:, wraps] + np.pi, 2.0 * np.pi) - np.pi
            scale = max(float(np.abs(apart).max()) / 2e-4, 1e-3)
            np.testing.assert_allclose(found.jacobians[number][:, :, component], apart / 2e-4, atol=1e-5 * scale)


@pytest.mark.parametrize("key", TYPES)
def test_without_movement_it_is_the_plain_type(key: str) -> None:
    type_, (blocks, constants) = moving(TYPES[key]), scene(key)
    plain = TYPES[key]
    still = [0.0 * b if KINDS[s.kind] in MOTIONS else b for s, b in zip(type_.slots, blocks, strict=True)]
    given = constants[:, : len(plain.constants)]
    expected = plain.equation([block.copy() for block in blocks[: len(plain.slots)]], given).values
    np.testing.assert_array_equal(type_.equation(still, constants).values, expected)
    assert type_.still is plain
