"""Small scenes seen from trajectories: images at a time and lines of scanners, beside images of other kinds."""

from __future__ import annotations

import numpy as np

from mor.model.images import IMAGE_TYPES, line_scanner, shutter_on_trajectory
from mor.model.motion import cubic_weights, linear_weights
from mor.model.parameters import INTERIORS
from mor.model.trajectory import on_trajectory
from tests.scenarios.scenes import Scene, add_object_points

INTERIOR = [30.0, 0.1, -0.2, 1e-5, -2e-8, 1e-11, 2e-5, -1e-5, 3e-4, -2e-4]
PATHS = (
    "images on a line",
    "lines of a scanner",
    "cubic paths, all free",
    "paths, frames and shutters",
    "shutters on a line",
    "cubic shutters, all free",
)
TIMES = np.array([0.0, 1.1, 1.9, 3.2])
"""Of the knots."""
ROW, RATE = 0.7, -0.02


def path_scene(name: str) -> Scene:
    """Twelve points below two flights of four knots each."""
    scene = Scene()
    points = add_object_points(scene)
    everything = "all free" in name
    shutters = "shutters on" in name or "cubic shutters" in name
    mixed = name == "paths, frames and shutters"
    model = "brown" if name == "lines of a scanner" else "mor"
    _add_interior(scene, model, everything)
    scene.add("height", "H", [1.5], free=everything)
    if shutters or mixed:
        scene.add("readout", "T", [0.3], free=everything)
    scene.add("eccentricity", "E", [0.1, -0.2, 0.05], free=(everything, False, everything))
    for flight in range(2):
        knots = 4 if everything or (mixed and flight) else 2
        _add_knots(scene, flight, knots, mixed)
        for line in (3.0, -1.0, -4.0):
            scans = name != "images on a line" and not shutters and not (mixed and line < 0.0)
            for number, point in enumerate(points):
                if (number + flight) % 5 == 0:
                    continue
                gap = everything and (number + flight) % 7 == 1
                seen = _Seen(flight, knots, model, line if scans else None, 0.3 + 0.05 * number + 0.1 * line)
                seen = seen.read_out() if shutters or (mixed and number % 3 == 0 and not scans) else seen
                _observe(scene, seen, point, [number % 2] if gap else None)
    if mixed:
        _add_others(scene, points)
    return scene


class _Seen:
    """What says how a ray is observed."""

    def __init__(self, flight: int, knots: int, model: str, line: float | None, since: float) -> None:
        self.flight, self.knots, self.line = flight, knots, line
        self.since = since * (TIMES[2] - TIMES[1])
        own = [4.0] if model == "mor" else []
        if line is None:
            self.type = on_trajectory(IMAGE_TYPES[model], knots)
            self.constants = [0.4, -0.3, *own]
        else:
            self.type = line_scanner(model, knots)
            self.constants = [0.4, line, *own, ROW, RATE]
        self.interior = [f"I {model}"]

    def read_out(self) -> _Seen:
        """The same with a rolling shutter."""
        key = self.type.key.partition("/")[2]
        self.type = shutter_on_trajectory(key, self.knots)
        self.constants = [*self.constants, 0.01, -0.04, 0.02]
        self.interior = ["T", *self.interior]
        return self


def _observe(scene: Scene, seen: _Seen, point: str, only: list[int] | None) -> None:
    """A ray between the second and the third knot."""
    if seen.knots == 2:
        order, weights = [1, 2], linear_weights(np.array([TIMES[2] - TIMES[1]]))
    else:
        order = [1, 2, 3, 0]
        weights = cubic_weights(TIMES[None], np.array([1]))[:, order]
    knots = [f"{kind}{seen.flight}{k}" for kind in "CR" for k in order]
    constants = [*seen.constants, seen.since, *weights.ravel()]
    scene.observe(
        seen.type.key,
        *knots,
        "H",
        "E",
        *seen.interior,
        point,
        sigma=(0.002, 0.003),
        constants=constants,
        only=only,
    )


def _add_knots(scene: Scene, flight: int, knots: int, mixed: bool) -> None:
    """Northwards over the points and eastwards, not quite level; the first knots, and those not seen, are fixed."""
    for k, time in enumerate(TIMES):
        along, swing = 2.0 + 6.0 * (time - 1.5), 0.3 * np.sin(2.0 * k + flight)
        place = [2.0 + swing, along, 21.0 - swing] if flight == 0 else [along, 2.0 - swing, 19.0 + swing]
        free = 0 < k < max(knots, 3)
        scene.add("point", f"C{flight}{k}", place, free=free)
        turns = [0.04 * swing, -0.1 * swing, (0.0 if flight == 0 else -0.5 * np.pi) + 0.2 * swing]
        partly = mixed and k == 2
        scene.add("rotation", f"R{flight}{k}", turns, free=(True, False, True) if partly else free)


def _add_interior(scene: Scene, model: str, everything: bool) -> None:
    some = np.isin(np.arange(10), (0, 1, 2, 8, 9) if everything else (0, 2))
    scene.add(INTERIORS[model].key, f"I {model}", INTERIOR, free=some)


def _add_others(scene: Scene, points: list[str]) -> None:
    """A frame image, one with a rolling shutter, and one of a model that is left to numpy."""
    scene.add(INTERIORS["opencv"].key, "I opencv", [30.0, 30.1, 0.1, -0.2, 0.01, *np.zeros(7)], free=False)
    scene.add("image velocity", "V", [0.5, 2.0, -0.4])
    scene.add("rotation rate", "W", [0.1, -0.1, 0.2])
    for k, place in enumerate(([3.0, -2.0, 18.0], [-3.0, 2.0, 20.0], [1.0, 4.0, 22.0])):
        scene.add("point", f"C{k}", place)
        scene.add("rotation", f"R{k}", [0.05 * k, -0.1, 0.4 * k])
        for number, point in enumerate(points):
            xy, frame = [0.1 * number, -0.2], (f"C{k}", f"R{k}", "H", "E")
            if k == 0:
                scene.observe("image/mor", *frame, "I mor", point, sigma=0.002, constants=[*xy, 4.0])
            elif k == 1:
                constants = [*xy, 4.0, 0.01, -0.04, 0.02]
                slots = (*frame, "V", "W", "T", "I mor", point)
                scene.observe("moving/mor", *slots, sigma=0.002, constants=constants)
            else:
                scene.observe("image/opencv", *frame, "I opencv", point, sigma=0.002, constants=xy)
