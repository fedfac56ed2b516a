"""A part finds the vertical and the length unit from what was measured inside it.

The vertical from posed frames that know it (levelled instruments, levels), else from height differences between its
points; the scale from distances, height differences, and bases of stereo pairs that are given.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mor.approximate.parts.frames import Frame
from mor.approximate.parts.part import Part
from mor.approximate.parts.relative_poses import known_bases
from mor.approximate.parts.scene import Scene
from mor.approximate.similarity import Similarity, SimilarityOutcome
from mor.approximate.terrestrial.clusters import Cluster
from mor.approximate.terrestrial.polar import bearing
from mor.approximate.terrestrial.sights import Lengths
from mor.approximate.vertical.finding import vertical_by_directions
from mor.arrays import FloatArray
from mor.geometry import tolerant

WEAKEST = 0.02
"""Extension of height differences across their main direction, relative to that along, from which they level a part."""
ALIKE = 3.0
"""Factor of the misfits up to which two verticals fit alike."""
CONTROLLED = 3
"""Horizontal directions beyond those that a vertical takes, from which on they tell it beyond doubt."""
DISAGREEMENT = 0.05
"""Relative misfit beyond which height differences and points do not belong together."""


def level_and_scale(part: Part, scene: Scene) -> bool:
    """Turn the part upright and bring it to the length unit, as far as it tells; true where it gained either."""
    # The scale first: with it the heights of points nearly in a plane tell the vertical, too.
    lifted = part.lifts
    gained = not part.scaled and _scale(part, scene)
    if not part.levelled:
        gained |= (
            _level_by_frames(part, scene.frames)
            or _level_by_heights(part, scene)
            or _level_by_directions(part, scene, CONTROLLED)
        )
    if not part.scaled:
        gained |= _scale(part, scene)
    if part.lifts and not lifted:
        part.lower_to_marks(scene.target_heights)
    return gained


def vertical_of(part: Part, frames: Sequence[Frame]) -> FloatArray:
    """(n, 3) the vertical in the axes of the part, of every posed frame that knows it."""
    found = [D.T @ frames[n].up for n, (_, D) in part.poses.items() if np.isfinite(frames[n].up).all()]
    return np.array(found).reshape(-1, 3)


def _level_by_frames(part: Part, frames: Sequence[Frame]) -> bool:
    verticals = vertical_of(part, frames)
    if len(verticals) == 0:
        return False
    # The vertical with which the others agree best: a wrong pose among several must not tilt the part.
    off = np.linalg.norm(verticals[:, None] - verticals[None], axis=2)
    centre = int(np.argmin(np.median(off, axis=1)))
    near = off[centre] <= max(3.0 * float(np.median(off[centre])), 1e-6)
    make_upright(part, verticals[near].mean(axis=0))
    return True


def make_upright(part: Part, vertical: FloatArray) -> None:
    """Turn a part so that a direction becomes its Z axis."""
    z = vertical / np.linalg.norm(vertical)
    x = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    part.transform(_movement(1.0, np.stack([x, np.cross(z, x), z])))
    part.levelled = True


def _level_by_heights(part: Part, scene: Scene) -> bool:
    """Three height differences and more: Δx · g = Δh; g is the vertical times the scale."""
    difference, dz = _between_known(part, scene.level_lines)
    if len(dz) < 3:
        return False
    values = tolerant.singular_values(difference)
    if values[2] < WEAKEST * values[0]:
        return False
    g = tolerant.lstsq(difference, dz, rcond=None)
    misfit = float(np.linalg.norm(difference @ g - dz))
    length = float(np.linalg.norm(g))
    if length == 0.0 or misfit > DISAGREEMENT * float(np.linalg.norm(dz)):
        return False
    if part.scaled:
        return _level_by_unit_vector(part, scene, difference, dz)
    part.transform(_movement(length, np.eye(3)))
    part.scaled = True
    make_upright(part, np.asarray(g, dtype=np.float64))
    return True


def _level_by_directions(part: Part, scene: Scene, redundant: int) -> bool:
    """Horizontal directions and vertical angles to points of the part, at least ``redundant`` more than it takes."""
    up = vertical_by_directions(part, scene, redundant)
    if up is None:
        return False
    make_upright(part, up)
    return True


def _level_by_unit_vector(part: Part, scene: Scene, difference: FloatArray, dz: FloatArray) -> bool:
    """The vertical of a part that has its scale: of unit length, so that points nearly in a plane leave two.

    Where both fit alike it is the one with the cameras above what they see.
    """
    axes = tolerant.svd(difference, full_matrices=False)[2]
    in_plane: FloatArray = tolerant.lstsq(difference @ axes[:2].T, dz, rcond=None) @ axes[:2]
    rest = float(np.sqrt(max(1.0 - float(in_plane @ in_plane), 0.0)))
    both = [in_plane + sign * rest * axes[2] for sign in (1.0, -1.0)]
    misfits = [float(np.linalg.norm(difference @ g - dz)) for g in both]
    best = int(np.argmin(misfits))
    if misfits[best] > DISAGREEMENT * float(np.linalg.norm(dz)):
        return False
    if part.poses and misfits[1 - best] < ALIKE * misfits[best]:
        order = np.argsort(-(np.array(both) @ _above(part)))
        best = int(order[scene.choices.take(2)])
    make_upright(part, both[best] / np.linalg.norm(both[best]))
    return True


def _above(part: Part) -> FloatArray:
    """(3,) from what is seen to those who see it: up, as far as nothing else tells."""
    seen = part.points[np.isfinite(part.points).all(axis=1)]
    centres = np.array([centre for centre, _ in part.poses.values()])
    above: FloatArray = centres.mean(axis=0) - (seen.mean(axis=0) if len(seen) else 0.0)
    return above


def level_roughly(part: Part, scene: Scene) -> bool:
    """Turn a part so that heights of instruments and height differences inside it fit as well as they can.

    True where it is upright after that.
    """
    lift = _lift(part, scene.frames)
    if not part.levelled and np.any(lift):
        make_upright(part, lift)
    if not part.levelled:
        _level_by_directions(part, scene, 0)
    difference, dz = _between_known(part, scene.level_lines)
    if part.levelled or len(dz) == 0:
        return part.levelled
    k = np.arange(400) + 0.5
    z, around = 1.0 - 2.0 * k / 400.0, np.pi * (1.0 + 5.0**0.5) * k
    up = np.stack([np.sqrt(1.0 - z**2) * np.cos(around), np.sqrt(1.0 - z**2) * np.sin(around), z], axis=1)
    rise = up @ difference.T
    factor = np.ones(len(up))
    if not part.scaled:
        factor = np.maximum(rise @ dz, 0.0) / np.maximum(np.sum(rise**2, axis=1), 1e-300)
    cost = np.sum((factor[:, None] * rise - dz) ** 2, axis=1)
    alike = up[cost <= max(ALIKE**2 * float(cost.min()), (DISAGREEMENT * float(np.linalg.norm(dz))) ** 2)]
    best = alike[int(np.argmax(alike @ _above(part)))] if part.poses else up[int(np.argmin(cost))]
    for _ in range(20 if part.scaled else 0):
        across = difference - np.outer(difference @ best, best)
        best = best - tolerant.lstsq(across, difference @ best - dz, rcond=1e-6)
        best = best / np.linalg.norm(best)
    make_upright(part, best)
    return True


def _lift(part: Part, frames: Sequence[Frame]) -> FloatArray:
    """(3,) sum of what leads up over one position: from its point to instrument, from instrument to instrument."""
    over: dict[int, list[tuple[float, FloatArray]]] = {}
    for number, (centre, _) in part.poses.items():
        frame = frames[number]
        if frame.stands:
            over.setdefault(frame.position, []).append((float(frame.offset[0]), centre))
    lift = np.zeros(3)
    for position, places in over.items():
        if np.isfinite(part.points[position]).all():
            places.append((0.0, part.points[position]))
        (low, below), (high, above) = min(places, key=lambda one: one[0]), max(places, key=lambda one: one[0])
        if high > low:
            lift += above - below
    return lift


def direct_roughly(part: Part, scene: Scene) -> None:
    """Turn a part about its Z axis so that the bearings between its points fit, whether or not it is upright."""
    known = np.asarray(np.isfinite(part.points[:, :2]).all(axis=1))
    turns = []
    for sight in scene.terrestrial.sights:
        if sight.oriented and known[sight.position] and known[sight.points].all():
            present = bearing(part.points[sight.position, :2], part.points[sight.points, :2])
            turns.append(np.exp(1j * (sight.directions - present)))
    if part.oriented or not turns:
        return
    turn = float(np.angle(np.mean(np.concatenate(turns))))
    c, s = np.cos(turn), np.sin(turn)
    part.transform(_movement(1.0, np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])))


def _between_known(part: Part, lines: Sequence[Cluster]) -> tuple[FloatArray, FloatArray]:
    """Differences (n, 3) of known points and of their heights (n,), along lines of levelling of any length."""
    known = np.asarray(np.isfinite(part.points).all(axis=1))
    start, end, dz = [], [], []
    for line in lines:
        points = line.points[known[line.points]]
        values = line.values[known[line.points], 0]
        start.append(points[:-1])
        end.append(points[1:])
        dz.append(np.diff(values))
    if not start:
        return np.zeros((0, 3)), np.zeros(0)
    return part.points[np.concatenate(end)] - part.points[np.concatenate(start)], np.concatenate(dz)


def _scale(part: Part, scene: Scene) -> bool:
    measured = scene.terrestrial
    bases = np.array(known_bases(part, scene.pairs)).reshape(-1, 2)
    spans = _spans(part, scene.frames, measured.slopes)
    ratios = [_ratios(spans, measured.slopes.value[:, 0]), _ratios(bases[:, 0], bases[:, 1])]
    if part.levelled:
        flat = part.points[:, :2][measured.horizontals.end] - part.points[:, :2][measured.horizontals.start]
        ratios.append(_ratios(np.linalg.norm(flat, axis=1), measured.horizontals.value[:, 0]))
    together = np.concatenate(ratios)
    if len(together) == 0 and part.levelled:
        difference, dz = _between_known(part, scene.level_lines)
        steep = np.abs(difference[:, 2]) > WEAKEST * np.linalg.norm(difference, axis=1)
        together = dz[steep] / difference[steep, 2]
        together = together[together > 0.0]
    if len(together) == 0:
        return False
    part.transform(_movement(float(np.median(together)), np.eye(3)))
    part.scaled = True
    forget_marks(part, scene)
    return True


def forget_marks(part: Part, scene: Scene) -> None:
    """Heights of marks below instruments, which without scale were those of the instruments, are not known any more."""
    places = [sight.position for sight in scene.terrestrial.sights if sight.height != 0.0]
    places += [frame.position for frame in scene.frames if frame.stands and frame.offset[0] != 0.0]
    marks = np.unique(np.array(places, dtype=np.int64))
    part.points[marks[~part.fixed[marks]], 2] = np.nan


def scale_roughly(part: Part, scene: Scene) -> None:
    """The scale from instruments of different height over one position, where nothing else tells it."""
    if part.scaled or not part.levelled:
        return
    over: dict[int, list[tuple[float, float]]] = {}
    for number, (centre, _) in part.poses.items():
        frame = scene.frames[number]
        if frame.stands:
            over.setdefault(frame.position, []).append((float(frame.offset[0]), float(centre[2])))
    spans = np.array([np.subtract(max(places), min(places)) for places in over.values()]).reshape(-1, 2)
    measured, present = spans[spans[:, 0] > 0.0].T
    if present.sum() > 0.0:
        part.transform(_movement(float(measured.sum() / present.sum()), np.eye(3)))
        part.scaled = True
        forget_marks(part, scene)


def _ratios(present: FloatArray, measured: FloatArray) -> FloatArray:
    usable = np.isfinite(present) & (present > 0.0)
    return np.asarray(measured[usable] / present[usable])


def _spans(part: Part, frames: Sequence[Frame], lengths: Lengths) -> FloatArray:
    """Present lengths (n,): from the centre of the instrument, where a frame at that height is posed, to the target."""
    start = part.points[lengths.start].copy()
    centres = {
        (frames[n].position, frames[n].height): centre
        for n, (centre, _) in part.poses.items()
        if frames[n].offset[0] != 0.0 and frames[n].stands
    }
    for i in np.flatnonzero(lengths.start_height != 0.0) if centres else ():
        key = int(lengths.start[i]), int(lengths.start_block[i])
        if key in centres:
            start[i] = centres[key]
    spans: FloatArray = np.linalg.norm(part.points[lengths.end] - start, axis=1)
    return spans


def _movement(scale: float, rotation: FloatArray) -> Similarity:
    return Similarity(SimilarityOutcome.DETERMINED, scale, rotation, np.zeros(3), np.zeros((0, 3)), 0.0)
