"""Rays to points at infinity: the limit of rays to ever farther points, with derivatives that differences confirm."""

from __future__ import annotations

import numpy as np
import pytest

from mor.model.contract import wrap
from mor.model.coordinates import at_infinity, can_be_at_infinity
from mor.model.observation_types import ALL_TYPES
from mor.model.parameters import KINDS
from mor.model.rotations import rotate, rotation_from_angles

TYPES = [type_ for type_ in ALL_TYPES.values() if can_be_at_infinity(type_)]
TYPES = [type_ for type_ in TYPES if "+" not in type_.key or "/mor+" in type_.key]
INDICES = {"n_air": 1.0, "n_glass": 1.5, "n_water": 1.33}


def _blocks(type_, random):
    """Frames that look about along the direction, in front of them."""
    frame = rotation_from_angles(random.uniform(-0.4, 0.4, (3, 3)))
    blocks = []
    for slot in type_.slots:
        kind = KINDS[slot.kind]
        if slot.part == "rotation":
            blocks.append(frame)
        elif slot.part == "direction":
            turned = rotation_from_angles(random.uniform(-0.2, 0.2, (3, 3))) @ frame
            blocks.append(turned * np.array([-1.0, 1.0, -1.0])[:, None])  # the third row looks along −Z*
        elif kind.is_rotation:
            blocks.append(rotation_from_angles(random.uniform(-0.1, 0.1, (3, 3))))
        else:
            names = [c.name for c in kind.components]
            row = [20.0 if name in ("c", "fx", "fy") else INDICES.get(name, 1e-6) for name in names]
            blocks.append(np.tile(row, (3, 1)))
    return blocks


@pytest.mark.parametrize("type_", TYPES, ids=lambda type_: type_.key)
def test_derivatives_are_those_of_differences(type_):
    far, random = at_infinity(type_), np.random.default_rng(8)
    blocks = _blocks(far, random)
    constants = np.ones((3, max(len(far.constants), 3)))
    computed = far.equation(blocks, constants)
    for k, slot in enumerate(far.slots):
        for c in range(computed.jacobians[k].shape[2]):
            step = np.zeros(computed.jacobians[k].shape[2])
            step[c] = 1e-6

            def moved(sign, k=k, slot=slot, step=step):
                turned = KINDS[slot.kind].is_rotation
                delta = np.tile(sign * step, (3, 1))
                block = rotate(blocks[k], delta) if turned else blocks[k] + delta
                return far.equation([*blocks[:k], block, *blocks[k + 1 :]], constants).values

            difference = moved(1.0) - moved(-1.0)
            difference[:, far.wraps] = wrap(difference[:, far.wraps])
            expected = computed.jacobians[k][:, :, c]
            scale = max(float(np.abs(expected).max()), 1.0)
            np.testing.assert_allclose(difference / 2e-6, expected, atol=1e-6 * scale)


@pytest.mark.parametrize("type_", TYPES, ids=lambda type_: type_.key)
def test_values_are_the_limit_of_far_points(type_):
    far, random = at_infinity(type_), np.random.default_rng(9)
    blocks = _blocks(far, random)
    constants = np.zeros((3, max(len(far.constants), 3)))
    constants[:, 0] = 6.4e6
    by_slot = dict(zip(far.slots[:-1], blocks[:-1], strict=True))
    target = max(k for k, slot in enumerate(type_.slots) if slot.kind == "point")
    place = {k: random.uniform(-3, 3, (3, 3)) for k, slot in enumerate(type_.slots) if slot.kind == "point"}
    whole = []
    for k, slot in enumerate(type_.slots):
        size = KINDS[slot.kind].size
        whole.append(by_slot.get(slot, place.get(k, np.full((3, size), 0.3))))
    refraction = [k for k, slot in enumerate(type_.slots) if slot.kind == "refraction"]
    for k in refraction:
        whole[k] = np.zeros((3, 1))
    blocks = [np.zeros((3, 1)) if slot.kind == "refraction" else b for slot, b in zip(far.slots, blocks, strict=True)]
    whole[target] = 1e12 * blocks[-1][:, 2, :]
    values = type_.equation(whole, constants).values
    scale = max(1.0, float(np.abs(values).max()))  # columns of a panorama count through whole turns
    np.testing.assert_allclose(far.equation(blocks, constants).values, values, rtol=0, atol=1e-9 * scale)
