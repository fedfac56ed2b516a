"""Simulated scenes with known truth: cameras of c = 28.8 mm and 36 x 24 mm, turned every way."""

from types import SimpleNamespace

import numpy as np
import pytest

C, HALF_WIDTH, HALF_HEIGHT = 28.8, 18.0, 12.0


def unit(vector):
    return vector / np.linalg.norm(vector)


def random_rotation(rng):
    w, x, y, z = unit(rng.normal(size=4))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def looking(position, target, roll):
    """Rotation of a camera at ``position`` that looks along -z at ``target``."""
    z = unit(position - target)
    x = unit(np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0], z))
    turned = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]])
    return turned @ np.stack([x, np.cross(z, x), z])


def image(points, position, rotation, noise=0.0, rng=None):
    """Rays (x, y, -c) of object points."""
    q = (points - position) @ rotation.T
    xy = -C * q[:, :2] / q[:, 2:]
    if noise:
        xy = xy + noise * rng.normal(size=xy.shape)
    return np.column_stack([xy, np.full(len(points), -C)])


def camera(rng, points, direction=None):
    """A camera at a random place, or on the given side, that has all points in its format."""
    centre = points.mean(axis=0)
    direction = unit(rng.normal(size=3)) if direction is None else direction
    target, roll, distance = (
        centre + 0.1 * rng.normal(size=3),
        rng.uniform(-np.pi, np.pi),
        rng.uniform(1.2, 2.0),
    )
    while True:
        position = centre + direction * distance
        rotation = looking(position, target, roll)
        depths = (points - position) @ rotation[2]
        rays = image(points, position, rotation)
        if np.all(depths < -0.05) and np.all(np.abs(rays[:, :2]) <= [HALF_WIDTH, HALF_HEIGHT]):
            return position, rotation
        distance *= 1.1


def box(rng, n):
    """Points in a box of random proportions, turned at random."""
    return rng.uniform(-1, 1, (n, 3)) * rng.uniform(0.3, 1.0, 3) @ random_rotation(rng).T


def scene(seed, noise=0.0, n=None, images=2):
    """Points, cameras (X0, D) and rays of a general scene."""
    rng = np.random.default_rng(seed)
    points = box(rng, n or int(rng.integers(8, 51)))
    cameras = [camera(rng, points) for _ in range(images)]
    return SimpleNamespace(
        points=points,
        cameras=cameras,
        rays=[image(points, *each, noise, rng) for each in cameras],
        sigma=max(noise, 1e-5),
    )


def plane_scene(seed, noise=0.0, n=None, images=2, normal_free=0.25):
    """The same with all points in a plane that no camera sees at less than about 15 degrees."""
    rng = np.random.default_rng(seed)
    turn = random_rotation(rng)
    flat = rng.uniform(-1, 1, (n or int(rng.integers(8, 51)), 2)) * [1.0, rng.uniform(0.4, 1.0)]
    points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T
    cameras = []
    for _ in range(images):
        direction = unit(rng.normal(size=3))
        while abs(direction @ turn[:, 2]) < normal_free:
            direction = unit(rng.normal(size=3))
        cameras.append(camera(rng, points, direction * np.sign(direction @ turn[:, 2])))
    return SimpleNamespace(
        points=points,
        flat=flat,
        normal=turn[:, 2],
        cameras=cameras,
        rays=[image(points, *each, noise, rng) for each in cameras],
        sigma=max(noise, 1e-5),
    )


def relative_truth(cameras, first=0, second=1):
    """Unit base and D* of the second camera in the first one."""
    (x1, d1), (x2, d2) = cameras[first], cameras[second]
    return unit(d1 @ (x2 - x1)), d2 @ d1.T


@pytest.fixture
def scenes():
    """Return the simulators of this file."""
    return SimpleNamespace(
        scene=scene,
        plane_scene=plane_scene,
        relative_truth=relative_truth,
        random_rotation=random_rotation,
        looking=looking,
        image=image,
        camera=camera,
        box=box,
        c=C,
    )
