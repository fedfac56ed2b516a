"""Networks whose datum is open in more than one way: theodolites, local systems, everything together."""

from __future__ import annotations

import numpy as np

from tests.scenarios.scenes import Scene, add_object_points, mixed_network, photo_block


def theodolites(level: str) -> tuple[Scene, list[str]]:
    """Two theodolites in a free network of points, no distance; their level "fixed", observed in their own axes
    ("axes"), observed as ω = φ = 0 ("angles"), or unknown ("free")."""
    scene = Scene()
    points = add_object_points(scene)
    for number, xyz in enumerate([[-5.0, -6.0, 0.3], [9.0, -5.0, 0.8], [2.0, 11.0, 1.0]]):
        station = scene.add("point", f"S{number}", xyz)
        free = (False, False, True) if level == "fixed" else True
        scene.add("rotation", station, [0.0, 0.0, 0.3 + number], free=free)
        if level == "axes":
            scene.observe("level", station, sigma=1e-4)
        if level == "angles":
            scene.observe("observed/rotation", station, sigma=1e-4, only=(0, 1))
        for point in points:
            scene.observe("directions", station, station, None, point, sigma=1e-6)
    return scene, points


def local_system(**how) -> tuple[Scene, list[str]]:
    """A photo block with a local system in which five of its points were measured."""
    scene, points = photo_block()
    free = {"origin": True, "rotation": True, "scale": True, "offset": False, **how}
    scene.add("point", "origin", [1.0, 0.5, -0.3], free=free["origin"])
    scene.add("rotation", "system", [0.0, 0.0, 0.7] if "level" in how else [0.2, -0.3, 0.7], free=free["rotation"])
    scene.add("scale", "system", [1.1], free=free["scale"])
    scene.add("eccentricity", "system", [0.0, 0.0, 0.0], free=free["offset"])
    for point in points[:5]:
        scene.observe("local", "origin", "system", "system", "system", point, sigma=1e-3, only=how.get("only"))
    return scene, points


def free_mixed_network() -> tuple[Scene, list[str]]:
    """Images, levelled theodolites, distances, levelling and a vector, nothing fixed."""
    scene, points = mixed_network()
    for name in ("P0", "P9"):
        scene.free["point"][name] = np.ones(3, dtype=bool)
    return scene, points
