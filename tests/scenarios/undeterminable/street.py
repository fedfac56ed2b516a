"""A street of images with thousands of points in two images only, and some of them at infinity."""

from __future__ import annotations

import numpy as np

from tests.scenarios.undeterminable.plantings import World, camera


def street(seed: int, images: int, pairs: int, far: int, free: bool) -> tuple[World, set[str]]:
    """Images 2 m apart that look across the street; ``pairs`` two-ray points, ``far`` of them at infinity.

    Three-ray points carry the scale from pair to pair. Returned are the names of the far points.
    """
    random = np.random.default_rng(seed)
    world = World(random, free=free, given=True)
    for k in range(images):
        centre = np.array([2.0 * k, 0.0, 1.6]) + 0.1 * random.standard_normal(3)
        target = centre + np.array([0.05 * random.standard_normal(), 10.0, 0.0])
        world.images[f"I{k}"] = (centre, camera(centre, target, 0.1 * random.standard_normal()))
    for k in range(images - 2):
        for n in range(12):
            name = f"T{k}_{n}"
            place = np.array([2.0 * k + 2.0, 0.0, 1.6]) + random.uniform([-3, 9, -3], [3, 15, 4])
            known = not free and (k in (0, images // 2, images - 3)) and n < 3
            (world.control if known else world.points)[name] = place
            for image in (k, k + 1, k + 2):
                world.ray(f"I{image}", name)
    names = set()
    for n in range(pairs):
        k, distant = int(random.integers(images - 1)), n < far
        name = f"{'FAR' if distant else 'D'}{n}"
        toward = random.uniform([-0.3, 1, -0.3], [0.3, 1, 0.3])
        reach = 1e7 if distant else random.uniform(9.0, 25.0)
        world.points[name] = np.array([2.0 * k + 1.0, 0.0, 1.6]) + reach * toward
        for image in (k, k + 1):
            world.ray(f"I{image}", name, toward if distant else None)
        names |= {name} if distant else set()
    return world, names
