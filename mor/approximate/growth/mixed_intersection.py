"""Points by whatever passes through them in a levelled part: rays, bearings, coordinates that are known in part."""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.part import Part
from mor.approximate.parts.rule import rule
from mor.approximate.parts.scene import Scene
from mor.arrays import FloatArray
from mor.geometry import tolerant

SMALLEST_ANGLE = 0.02
"""Radians at which lines and planes must meet at least."""
FITS = 0.05
"""Radians by which a line or plane may pass by."""


def grow_mixed(part: Part, scene: Scene, contradicting: bool = False) -> bool:
    """Add points that rays alone do not determine; true where anything was added.

    ``contradicting``: also where lines and planes pass by each other, or hardly meet. The adjustment will tell
    which of them is wrong. Where there are rays alone, these have been asked whether they meet.
    """
    if not part.levelled:
        return False
    planes = _planes(part, scene)
    smallest = 0.05 * SMALLEST_ANGLE if contradicting else SMALLEST_ANGLE
    added = False
    for point in sorted(planes):
        bare = np.isnan(part.points[point]).all()
        if contradicting and bare and _only_rays(planes[point]):
            continue
        X, fits = _meeting(part.points[point], planes[point], smallest)
        if fits or (contradicting and np.isfinite(X).all()):
            part.points[point] = X
            part.how[f"point {point}"] = rule(
                "intersection of {count} lines and planes", count=len(planes[point])
            )
            added = True
    return added


def _only_rays(planes: list[tuple[FloatArray, FloatArray, FloatArray]]) -> bool:
    return all(len(across) == 2 for across, *_ in planes)


def _planes(part: Part, scene: Scene) -> dict[int, list[tuple[FloatArray, FloatArray, FloatArray]]]:
    """Unknown point → normals (k, 3) of the planes through it, a place on them and the direction in which it lies."""
    missing = np.asarray(np.isnan(part.points).any(axis=1))
    found: dict[int, list[tuple[FloatArray, FloatArray, FloatArray]]] = {}
    seen = scene.rays_for(part)[1]
    posed = np.zeros(seen.frames, dtype=bool)
    posed[list(part.poses)] = True
    rays = seen.of_points(np.flatnonzero(missing))
    for ray in rays[posed[seen.frame[rays]]].tolist():
        place, turn = part.poses[int(seen.frame[ray])]
        towards = turn.T @ seen.rays[ray]
        lowered = place - [0.0, 0.0, seen.height[ray]]
        across = tolerant.svd(towards[None])[2][1:]
        found.setdefault(int(seen.point[ray]), []).append((across, lowered, towards))
    for number, kappa in part.kappas.items():
        sight = scene.terrestrial.sights[number]
        place = np.append(part.points[sight.position, :2], 0.0)
        bare = missing[sight.points] & np.isfinite(sight.directions) & np.isnan(sight.verticals)
        for k in np.flatnonzero(bare) if np.isfinite(place).all() else ():
            t = sight.directions[k] - kappa
            towards = np.array([np.sin(t), np.cos(t), 0.0])
            across = np.array([[np.cos(t), -np.sin(t), 0.0]])
            found.setdefault(int(sight.points[k]), []).append((across, place, towards))
    return found


def _meeting(
    known: FloatArray, planes: list[tuple[FloatArray, FloatArray, FloatArray]], smallest: float
) -> tuple[FloatArray, bool]:
    """The point nearest to all planes with the coordinates that are known, NaN where there is none; whether it fits."""
    here = np.isfinite(known)
    if sum(len(across) for across, *_ in planes) + here.sum() < 3:
        return np.full(3, np.nan), False
    X, reach = np.where(here, known, 0.0), np.ones(len(planes))
    for _ in range(3):
        rows = np.concatenate([across / r for (across, _, _), r in zip(planes, reach, strict=True)])
        goal = np.concatenate(
            [across @ (at - X) / r for (across, at, _), r in zip(planes, reach, strict=True)]
        )
        values = tolerant.singular_values(rows[:, ~here])
        # Beside the rows themselves: a vertical plane says nothing of a height that alone is not known.
        largest = max(float(np.linalg.norm(rows, axis=1).max()), float(values[0]))
        if len(values) < np.count_nonzero(~here) or values[-1] < smallest * largest:
            return np.full(3, np.nan), False
        X[~here] += tolerant.lstsq(rows[:, ~here], goal, rcond=None)
        reach = np.array(
            [max(float(np.linalg.norm((X - at) * _measured(across))), 1e-9) for across, at, _ in planes]
        )
    for (across, at, towards), r in zip(planes, reach, strict=True):
        if np.abs(across @ (X - at)).max() > FITS * r or (X - at) @ towards < 0.0:
            return X, False
    return X, True


def _measured(across: FloatArray) -> FloatArray:
    """Axes along which a distance counts: a vertical plane says nothing of heights."""
    return np.array([1.0, 1.0, 1.0 if len(across) == 2 else 0.0])
