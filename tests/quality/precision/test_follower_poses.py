"""Poses of stereo followers: their derivatives against differences. Their values and σ: tests/project."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mor.model.parameters import ROTATION, Blocks
from mor.model.rotations import rotate, rotation_from_angles
from mor.quality.precision import _derivatives, follower_poses

STEP = 1e-6
BLOCKS = np.array([[0, 0, 0, 0, 1, 0]])
UNKNOWNS = (("point", 0), ("rotation", 0), ("height", 0), ("eccentricity", 0), ("rotation", 1), ("base", 0))


def changed(values: dict[str, np.ndarray], kind: str, block: int, step: np.ndarray) -> dict[str, np.ndarray]:
    result = {key: array.copy() for key, array in values.items()}
    if kind == "rotation":
        result[kind][block] = rotate(result[kind][block][None], step[None])[0]
    else:
        result[kind][block] += step
    return result


def test_derivatives_are_those_of_differences() -> None:
    random = np.random.default_rng(4)
    values = {
        "point": random.normal(size=(1, 3)),
        "rotation": rotation_from_angles(random.normal(size=(2, 3))),
        "height": np.array([[1.6]]),
        "eccentricity": 0.1 * random.normal(size=(1, 3)),
        "base": random.normal(size=(1, 3)),
    }
    free, owner = np.ones((2, 3), dtype=bool), np.repeat(np.arange(2), 3).reshape(2, 3)
    blocks = {"rotation": Blocks(ROTATION, ("A", "AB"), free, owner)}
    adjustment = SimpleNamespace(values=values, problem=SimpleNamespace(index=SimpleNamespace(blocks=blocks)))
    _, D = follower_poses(values, BLOCKS)
    columns = []
    for kind, block in UNKNOWNS:
        for step in STEP * np.eye(values[kind].shape[-1]):
            further, turned = follower_poses(changed(values, kind, block, step), BLOCKS)
            back, _ = follower_poses(changed(values, kind, block, -step), BLOCKS)
            delta = turned[0] @ D[0].T  # exp(−[δ]×)
            small = np.array([delta[1, 2] - delta[2, 1], delta[2, 0] - delta[0, 2], delta[0, 1] - delta[1, 0]])
            columns.append(np.concatenate([(further - back)[0] / 2.0, small / 2.0]) / STEP)
    np.testing.assert_allclose(_derivatives(adjustment, BLOCKS)[0], np.array(columns).T, atol=1e-5)
