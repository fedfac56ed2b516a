"""Relative orientation of a chain of images as plain data."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mor.approximate.bundle import Bundle
from mor.approximate.relative_orientation.auxiliary import CONDITIONS, Auxiliary, auxiliary_of
from mor.approximate.relative_orientation.deciding import Joined, joined
from mor.approximate.relative_orientation.model import Chain, Model
from mor.approximate.relative_orientation.outcome import Candidate, RelativeOrientation
from mor.approximate.relative_orientation.robust import RobustOrientation, robust_relative_orientation
from mor.arrays import BoolArray, FloatArray
from mor.geometry.rotations import angles_from_rotation
from mor.report.orientation.measured import Measured, bundles
from mor.report.orientation.numbers import ANGLES, by_turn, correlation, number, numbers, sigmas, with_sigma
from mor.units import ANGLE_UNITS

BASE = ("bx", "by", "bz")
IK = tuple(f"{i}{k}" for i in (1, 2, 3) for k in (1, 2, 3))


class Oriented(NamedTuple):
    """Pairs of neighbouring images, and the model of all of them."""

    pairs: list[RobustOrientation]
    auxiliary: list[Auxiliary | None]
    common: list[BoolArray]
    """(n,) the points that both images of a pair show."""
    used: BoolArray
    """(m, n) rays that count: those of wrong pairs do not."""
    chain: Chain | None
    model: Model | None
    """Nothing where a pair is not oriented, or no scale passes from one pair to the next."""
    rivals: int
    """Other combinations of the orientations of ambiguous pairs with which all images fit together as well."""


def relative(measured: Measured, constants: FloatArray, sigma: float) -> Oriented:
    """Orient every pair of neighbouring images, chain the models and adjust them."""
    images = bundles(measured, constants, sigma)
    seen: BoolArray = np.asarray(np.isfinite(measured.coordinates).all(axis=2)).T
    used, pairs, common = seen.copy(), [], []
    for k in range(len(images) - 1):
        both = seen[k] & seen[k + 1]
        a, b = images[k].take(both), images[k + 1].take(both)
        found = robust_relative_orientation(a, b)
        pairs.append(found)
        common.append(both)
        used[:, np.flatnonzero(both)[~found.agreeing]] = False
    known = [is_known(pair) for pair in pairs]
    hang_together = any(known) and all(
        one or _is_turned(pair) for one, pair in zip(known, pairs, strict=True)
    )
    all_of_them = joined(pairs, images, used) if hang_together else Joined(pairs, None, None, 0)
    auxiliary = [
        _auxiliary(pair, images[k].take(both), images[k + 1].take(both))
        for k, (pair, both) in enumerate(zip(all_of_them.pairs, common, strict=True))
    ]
    return Oriented(
        all_of_them.pairs, auxiliary, common, used, all_of_them.chain, all_of_them.model, all_of_them.rivals
    )


def _auxiliary(pair: RobustOrientation, a: Bundle, b: Bundle) -> Auxiliary | None:
    if not is_known(pair):
        return None
    return auxiliary_of(a.take(pair.agreeing), b.take(pair.agreeing), pair.orientation)


def is_known(pair: RobustOrientation) -> bool:
    """Return True if the outcome names a solution, unambiguous or not."""
    return pair.orientation.outcome.usable


def _is_turned(pair: RobustOrientation) -> bool:
    """Return True if both images are from one centre, and it is known how the second one is turned."""
    return bool(np.all(np.isfinite(pair.orientation.rotation)) and np.isnan(pair.orientation.base[0]))


def solved(found: Oriented) -> bool:
    """Return True if all images hang together."""
    return found.model is not None


def relative_data(
    measured: Measured, found: Oriented, unit: str, attitude: FloatArray | None = None
) -> dict[str, Any]:
    """All of it, angles in ``unit``; the keys of the first pair stand on their own as well.

    ``attitude`` (3,): ω′ φ′ κ′ of the first image in radians; with it the model stands in the object system.
    """
    ids = np.array(measured.ids, dtype=object)
    pairs = [
        _pair(k, ids[both], pair, auxiliary, ANGLE_UNITS[unit], unit)
        for k, (pair, auxiliary, both) in enumerate(
            zip(found.pairs, found.auxiliary, found.common, strict=True), start=1
        )
    ]
    return {**pairs[0], "pairs": pairs, "model": _model(ids, found, unit, attitude)}


def _pair(
    k: int, ids: Any, found: RobustOrientation, auxiliary: Auxiliary | None, per_unit: float, unit: str
) -> dict[str, Any]:
    o = found.orientation
    return {
        "images": [k, k + 1],
        "outcome": o.outcome.name.lower(),
        "words": o.words,
        "usable": o.outcome.usable,
        "geometry": o.geometry.value,
        "geometry_key": o.geometry.name.lower(),
        "points": len(ids),
        "used": int(np.count_nonzero(found.agreeing)),
        "base": numbers(o.base),
        "sigma_base": numbers(o.sigma_base),
        "rotation": numbers(o.rotation),
        "angles": {"unit": unit, **with_sigma(ANGLES, o.angles / per_unit, o.sigma_angles / per_unit)},
        "correlation": {"of": [*BASE, *ANGLES], "matrix": numbers(correlation(_of_angles(o)))},
        "sigma0": number(o.sigma0),
        "auxiliary_unknowns": numbers(o.unknowns),
        "rinner": None if auxiliary is None else _rinner(auxiliary),
        "candidates": [_candidate(c, o) for c in o.candidates],
        "alternatives": [_candidate(c, o) for c in o.alternatives],
        "plane_orientations": [_candidate(c, o) for c in o.plane_orientations],
        "residuals": [
            {"id": name, "coplanarity": number(v), "used": bool(used)}
            for name, v, used in zip(ids, found.residuals, found.agreeing, strict=True)
        ],
    }


def _of_angles(o: RelativeOrientation) -> FloatArray:
    """Covariance (6, 6) of b and ω* φ* κ*."""
    rows = np.eye(6)
    rows[3:, 3:] = by_turn(o.angles)
    return np.asarray(rows @ o.covariance @ rows.T)


def _rinner(auxiliary: Auxiliary) -> dict[str, Any]:
    parts = (
        auxiliary.linear,
        auxiliary.corrections,
        auxiliary.compatible,
        auxiliary.adjusted,
        auxiliary.sigma,
    )
    names = ("linear", "correction", "compatible", "adjusted", "sigma")
    columns = [part.ravel() for part in parts]
    return {
        "ik": [
            {"ik": ik, **{name: number(value) for name, value in zip(names, row, strict=True)}}
            for ik, row in zip(IK, zip(*columns, strict=True), strict=True)
        ],
        "conditions": [
            {"condition": name, "linear": number(before), "adjusted": number(after)}
            for name, before, after in zip(
                CONDITIONS, auxiliary.misclosures, auxiliary.remaining, strict=True
            )
        ],
    }


def _candidate(candidate: Candidate, o: RelativeOrientation) -> dict[str, Any]:
    return {
        "base": numbers(candidate.base),
        "rotation": numbers(candidate.rotation),
        "in_front_of_both": int(candidate.in_front_of_both),
        "behind": int(o.points - candidate.in_front_of_both),
    }


def _model(ids: Any, found: Oriented, unit: str, attitude: FloatArray | None) -> dict[str, Any] | None:
    model = found.model
    if model is None or found.chain is None:
        return None
    turn = np.eye(3) if attitude is None else attitude
    frames = np.zeros((len(model.positions), 6, 6))
    carried = np.eye(6)
    carried[:3, :3] = turn.T
    rotations = model.rotations @ turn
    angles = angles_from_rotation(rotations)
    for k, covariance in enumerate(model.frame_covariance):
        carried[3:, 3:] = by_turn(angles[k])
        frames[k] = carried @ covariance @ carried.T
    points, spread = model.points @ turn, turn.T @ model.point_covariance @ turn
    per_unit = ANGLE_UNITS[unit]
    return {
        "system": "image" if attitude is None else "object",
        "sigma0": number(model.sigma0),
        "redundancy": model.redundancy,
        "rivals": found.rivals,
        "scale_points": [None if count < 0 else count for count in found.chain.common.tolist()],
        "images": [
            {
                "image": k + 1,
                **with_sigma(("x", "y", "z"), model.positions[k] @ turn, sigmas(frames[k])[:3]),
                **with_sigma(ANGLES, angles[k] / per_unit, sigmas(frames[k])[3:] / per_unit),
                "rotation": numbers(rotations[k]),
                "correlation": numbers(correlation(frames[k])),
            }
            for k in range(len(angles))
        ],
        "points": [
            {
                "id": name,
                **with_sigma(("x", "y", "z"), points[k], sigmas(spread[k])),
                "correlation": numbers(correlation(spread[k])),
                "images": int(np.sum(found.used[:, k])),
                "remark": None if np.isfinite(points[k, 0]) else _why(found, k),
            }
            for k, name in enumerate(ids)
        ],
    }


def _why(found: Oriented, point: int) -> str:
    """Why a point has no place in the model."""
    for both, pair in zip(found.common, found.pairs, strict=True):
        if both[point] and not pair.agreeing[int(np.sum(both[:point]))]:
            return "wrong pair"
    return "" if found.model is None else found.model.reasons[point].value
