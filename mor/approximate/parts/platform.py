"""A part of cameras on a platform whose poses are known: boresight and lever arm come out with the movement.

Leader D_l, O_l are known in the target, followers D_f, O_f in the source, and one turn T and base b for all:

    D_f = T D_l R,    s R O_f + t = O_l + D_lᵀ b    for the movement X = s R x + t

The relative turns D_f,i D_f,jᵀ = T D_l,i D_l,jᵀ Tᵀ have parallel axes under T (Kabsch), where the attitudes turn about
more than one axis; a base that is short beside the network leaves T to the positions as well. Both are tried.
"""

from __future__ import annotations

import numpy as np

from mor.approximate.parts.movement import OPEN, Movement
from mor.approximate.parts.part import Part
from mor.approximate.parts.scene import Scene, StereoPair
from mor.approximate.similarity import SimilarityOutcome, similarity
from mor.arrays import FloatArray
from mor.geometry import tolerant
from mor.geometry.rotations import nearest_rotation

FEWEST = 3
"""Followers whose leaders are known."""
LONGEST = 3.0
"""Base, in parts of the extent of the leaders, beyond which it is none of a platform."""


def tie_by_platform(target: Part, source: Part, scene: Scene) -> Movement | None:
    """The movement that a pair tells whose followers only the source knows, and whose leaders are given."""
    for pair in scene.pairs if target.given else ():
        followers = [n for n in pair.known if n in source.poses and n not in target.poses]
        if len(followers) < FEWEST:
            continue
        found = _tie(pair, followers, source)
        if found is not None:
            return found
    return None


def _tie(pair: StereoPair, followers: list[int], source: Part) -> Movement | None:
    O_l, D_l = (np.array([pair.known[n][k] for n in followers]) for k in (0, 1))
    O_f, D_f = (np.array([source.poses[n][k] for n in followers]) for k in (0, 1))
    poses = O_l, D_l, O_f, D_f
    found = [_with_turn(T, *poses, source.scaled, pair.base) for T in _turns(*poses, pair.turn)]
    return min((one for one in found if one is not None), key=lambda one: one.misfit, default=None)


def _turns(
    O_l: FloatArray, D_l: FloatArray, O_f: FloatArray, D_f: FloatArray, given: FloatArray
) -> list[FloatArray]:
    """Candidates of the turn from leader to follower."""
    if np.isfinite(given).all():
        return [given]
    from scipy.spatial.transform import Rotation  # no network without such pairs waits for it

    i, j = np.triu_indices(len(D_l), 1)
    relative = (Rotation.from_matrix(D[i] @ np.swapaxes(D[j], 1, 2)) for D in (D_l, D_f))
    here, there = (one.as_rotvec() for one in relative)
    turns = [nearest_rotation(there.T @ here)]
    by_places = similarity(O_f, O_l)
    if by_places.outcome is SimilarityOutcome.DETERMINED:
        turns.append(nearest_rotation((D_f @ by_places.rotation.T @ np.swapaxes(D_l, 1, 2)).sum(axis=0)))
    return turns


def _with_turn(
    T: FloatArray,
    O_l: FloatArray,
    D_l: FloatArray,
    O_f: FloatArray,
    D_f: FloatArray,
    scaled: bool,
    base: FloatArray,
) -> Movement | None:
    """Rotation, scale, shift and base that go with a turn; the shortest base where several do."""
    R = nearest_rotation((np.swapaxes(D_l, 1, 2) @ T.T @ D_f).sum(axis=0))
    size = float(np.sqrt(np.mean(np.sum((O_l - O_l.mean(axis=0)) ** 2, axis=1))))
    spread = float(np.sqrt(np.mean(np.sum((O_f - O_f.mean(axis=0)) ** 2, axis=1))))
    if not (size > 0.0 and spread > 0.0):
        return None
    turned, places = (O_f - O_f.mean(axis=0)) @ R.T / spread, (O_l - O_l.mean(axis=0)) / size
    n, arm = len(places), np.nan_to_num(base) / size
    columns = [turned.reshape(-1, 1), np.tile(np.eye(3), (n, 1)), -np.swapaxes(D_l, 1, 2).reshape(-1, 3)]
    A, right = np.concatenate(columns, axis=1), places.ravel()
    if scaled:
        right, A = right - A[:, 0] * spread / size, np.delete(A, 0, axis=1)
    known = bool(np.isfinite(base).all())
    if known:
        right, A = right - A[:, -3:] @ arm, A[:, :-3]
    unknowns = tolerant.lstsq(A, right, rcond=1e-6)
    factor = spread / size if scaled else float(unknowns[0])
    shift, b = unknowns[int(not scaled) :][:3], arm if known else unknowns[-3:]
    if factor <= 0.0 or np.linalg.norm(b) > LONGEST:
        return None
    off = np.concatenate([(A @ unknowns - right), (T @ D_l @ R - D_f).ravel()])
    values = tolerant.singular_values(A[:, : 4 - int(scaled)])
    scale = factor * size / spread
    moved = O_l.mean(axis=0) + size * shift - scale * R @ O_f.mean(axis=0)
    misfit = float(np.sqrt(np.mean(off**2)))
    redundancy = len(off) - 6 - A.shape[1]
    return Movement(scale, R, moved, int(np.count_nonzero(values * OPEN < misfit)), misfit, redundancy)
