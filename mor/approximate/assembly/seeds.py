"""What a part begins with, of what no part knows yet."""

from __future__ import annotations

import numpy as np

from mor.approximate.assembly.assembly import Assembly
from mor.approximate.assembly.growing import grow
from mor.approximate.choices import ROWS
from mor.approximate.growth.grow_bundles import FEWEST
from mor.approximate.growth.rigid_seeds import seed_polar
from mor.approximate.growth.seed_bundles import common_pairs, seed_bundles
from mor.approximate.growth.seed_doubtful import seed_doubtful
from mor.approximate.growth.seed_levelled import seed_levelled
from mor.approximate.growth.seed_plan import seed_plan
from mor.approximate.growth.trilateration import seed_distances
from mor.approximate.parts.part import Part
from mor.arrays import BoolArray

BEGINNINGS = 4
"""Pairs that a part may begin with, where what it leads to does not agree."""
DOUBTFUL = 4
"""Searches for a doubtful pair: each grows a part from every orientation of up to eight pairs."""


def next_seed(assembly: Assembly) -> Part | None:
    """A part of its own for something that no part knows yet."""
    scene, measured = assembly.scene, assembly.scene.terrestrial
    unknown, tried = _unknown_stations(assembly), assembly.tried_stations
    part = seed_levelled(measured, unknown, scene.points, tried, with_distances=True)
    if part is not None:
        return part
    free = _free_frames(assembly)
    for chained in (False, True):
        part = _seed_of_frames(assembly, free, chained)
        if part is not None:
            return part
    fresh = [n for n in range(scene.image_count, len(free)) if free[n]]
    part = seed_polar(scene, [n for n in fresh if frozenset([n]) not in assembly.tried_frames])
    assembly.tried_frames |= {frozenset(part.poses)} if part else set()
    part = part or seed_levelled(measured, unknown, scene.points, tried, with_distances=False)
    if part is None:
        part, reason = seed_plan(measured, unknown, scene.points, tried)
        assembly.reasons += [reason] if reason else []
    part = part or seed_distances(scene, assembly.parts[0], _known_points(assembly), assembly.tried_shapes)
    return part or _doubtful_seed(assembly, free)


def _doubtful_seed(assembly: Assembly, free: BoolArray) -> Part | None:
    """A part of two frames whose orientation is in doubt, where nothing else is left."""
    scene = assembly.scene
    open_ = free & ~assembly.given_up[2]
    if assembly.fewest > FEWEST or np.count_nonzero(open_) < 2 or assembly.doubtful == DOUBTFUL:
        return None
    assembly.doubtful += 1
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    among = np.flatnonzero(open_[pairs.first] & open_[pairs.second])
    part = seed_doubtful(scene, among, pairs, lambda part, most: grow(part, scene, FEWEST, most))
    assembly.given_up[2] |= open_ if part is None else np.isin(np.arange(len(open_)), list(part.poses))
    return part


def _seed_of_frames(assembly: Assembly, free: BoolArray, chained: bool) -> Part | None:
    """A part of two frames that no part has; or, ``chained``, of one and a neighbour that ties it to its part."""
    scene, given_up = assembly.scene, assembly.given_up[int(chained)]
    open_ = free & ~given_up
    if np.count_nonzero(open_) < (1 if chained else 2):
        return None
    assembly.pairs = pairs = common_pairs(scene.bare[1]) if assembly.pairs is None else assembly.pairs
    if chained:
        among = (open_[pairs.first] & ~free[pairs.second]) | (open_[pairs.second] & ~free[pairs.first])
    else:
        among = open_[pairs.first] & open_[pairs.second]
    bare, rows = scene.bare[0], np.flatnonzero(among)
    part, reason = seed_bundles(bare, rows, pairs, scene.points)
    asks = part is not None and assembly.network.observations <= ROWS
    passed = scene.choices.take(min(len(rows), BEGINNINGS), alike=False) if asks else 0
    if passed:
        part, reason = seed_bundles(bare, rows, pairs, scene.points, passed)
    given_up |= open_ if part is None else False
    assembly.reasons += [reason] if reason and not chained else []
    if part is not None:
        frames = frozenset(part.poses)
        if frames in assembly.tried_frames:
            given_up[list(frames)] = True
            return _seed_of_frames(assembly, free, chained)
        assembly.tried_frames.add(frames)
    return part


def _unknown_stations(assembly: Assembly) -> set[int]:
    """Positions of the sets that no part has oriented; a known position alone does not orient a set."""
    sights = assembly.scene.terrestrial.sights
    places = np.array([sight.position for sight in sights], dtype=np.int64)
    numbers = np.arange(len(sights))
    known = np.zeros(len(places), dtype=bool)
    for part in assembly.parts:
        oriented = np.isin(numbers, list(part.kappas)) | np.array([s.oriented for s in sights], dtype=bool)
        known |= np.isfinite(part.points[places, :2]).all(axis=1) & oriented
    return set(places[~known].tolist())


def _known_points(assembly: Assembly) -> BoolArray:
    """Points (n,) that some part knows, in plan at least."""
    known = np.zeros(assembly.scene.points, dtype=bool)
    for part in assembly.parts:
        known |= np.isfinite(part.points[:, :2]).all(axis=1)
    return known


def _free_frames(assembly: Assembly) -> BoolArray:
    """Frames (n,) that no part has a pose of."""
    free = np.ones(len(assembly.scene.frames), dtype=bool)
    for part in assembly.parts:
        free[list(part.poses)] = False
    return free
