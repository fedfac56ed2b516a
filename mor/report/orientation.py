"""Reports of oriented images."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message, nearest
from mor.input_files import read_bytes
from mor.model.rotations import angles_by_tangent, angles_from_rotation
from mor.report.estimates import ANGLES
from mor.report.language import Words
from mor.report.layout import cells, fixed, heading, short, table
from mor.report.units import number_or_none
from mor.start.bundle import Bundle, image_bundle
from mor.start.image_pair import RobustOrientation, robust_relative_orientation
from mor.start.plane_object import (
    Length,
    PlacedPlane,
    PlaneShape,
    corners,
    derived,
    on_level_plane,
    on_wall,
    placed_covariance,
    scale_from_length,
    shape_of_plane,
)
from mor.start.relative_orientation import OrientationCandidate, RelativeOrientation
from mor.start.stereo_model import CONDITIONS, Auxiliary, Chain, Joined, StereoModel, auxiliary_of, joined
from mor.types import BoolArray, FloatArray
from mor.units import ANGLE_UNITS

# ---- Tables of homologous image points, read and turned into bundles.


class HomologousPoints(NamedTuple):
    """Homologous image points: identifiers and coordinates (n, images, 2), NaN if not measured."""

    ids: tuple[str, ...]
    coordinates: FloatArray
    file: str = ""


def read_homologous(path: Path) -> HomologousPoints:
    """Table with the columns id, x1, y1, x2, y2, … Raises :class:`InputError` with every mistake found."""
    try:
        frame = pl.read_csv(read_bytes(path), infer_schema=False)
    except pl.exceptions.PolarsError as error:
        raise InputError([Message(f"not a table: {str(error).splitlines()[0]}", str(path))]) from None
    found = frame.columns
    images = 0
    while {f"x{images + 1}", f"y{images + 1}"} <= set(found):
        images += 1
    names = [f"{axis}{image}" for image in range(1, images + 1) for axis in "xy"]
    halves = [name for name in found if re.fullmatch(r"[xyXY]\d+", name) and name not in names]
    if "id" not in found or images < 2 or halves:
        said = f"expected the columns id, x1, y1, x2, y2 …, x and y of every image, found {', '.join(found)}"
        raise InputError([Message(said, str(path), 1)])
    ids = frame["id"].to_list()
    numbers, wrong = _numbers(frame, names, path)
    problems = [*_checked_names(ids, path), *wrong]
    if problems:
        raise InputError(sorted(problems, key=lambda problem: problem.line))
    return HomologousPoints(tuple(ids), numbers.reshape(frame.height, -1, 2), str(path))


def _checked_names(ids: list[str | None], path: Path) -> list[Message]:
    """Every row has a name of its own."""
    first: dict[str, int] = {}
    problems = []
    for line, name in enumerate(ids, start=2):
        if name is None or not name.strip():
            problems.append(Message("id is empty", str(path), line))
        elif name in first:
            problems.append(Message(f"id {name!r} is given twice (first in line {first[name]})", str(path), line))
        else:
            first[name] = line
    return problems


def _numbers(frame: pl.DataFrame, names: list[str], path: Path) -> tuple[FloatArray, list[Message]]:
    """Coordinates (n, k), not a number where a cell is empty; and what is no number, or stands without its mate."""
    problems = []
    result = np.full((frame.height, len(names)), np.nan)
    given = np.zeros(result.shape, dtype=bool)
    for k, name in enumerate(names):
        for i, cell in enumerate(frame[name].to_list()):
            if cell is None or not cell.strip():
                continue
            given[i, k] = True
            try:
                result[i, k] = float(cell)
            except ValueError:
                result[i, k] = np.nan
            if not np.isfinite(result[i, k]):
                problems.append(Message(f"{name}: found {cell!r}, expected a number", str(path), i + 2))
    for i, k in np.argwhere(given[:, ::2] != given[:, 1::2]):
        empty, other = (names[2 * k + 1], names[2 * k])[:: 1 if given[i, 2 * k] else -1]
        problems.append(Message(f"{empty} is empty, and {other} is not", str(path), int(i) + 2))
    return result, problems


def check_names(measured: HomologousPoints, names: tuple[str, ...]) -> None:
    """Raise :class:`InputError` for names of points that the table does not have."""
    problems = [
        Message(f"point {name!r} does not exist{nearest(name, measured.ids)}", measured.file)
        for name in names
        if name not in measured.ids
    ]
    if problems:
        raise InputError(problems)


def bundles(measured: HomologousPoints, constants: FloatArray, sigma: float) -> list[Bundle]:
    """One bundle for each image, with its camera constant; image coordinates relative to the principal point."""
    rays = np.concatenate(
        [measured.coordinates, np.broadcast_to(-constants[None, :, None], (*measured.coordinates.shape[:2], 1))], axis=2
    )
    rays[np.isnan(measured.coordinates).any(axis=2)] = np.nan
    return [image_bundle(rays[:, image], sigma) for image in range(rays.shape[1])]


# ---- Arrays as plain data, and small tables of what has a σ.


def numbers(array: FloatArray) -> Any:
    """Nested lists of an array."""
    return [numbers(row) for row in array] if np.ndim(array) > 1 else [number_or_none(value) for value in array]


def with_sigma(names: tuple[str, ...], values: FloatArray, sigmas: FloatArray) -> dict[str, float | None]:
    """``x: 1.0, sx: 0.1`` …"""
    return {
        **{name: number_or_none(value) for name, value in zip(names, values, strict=True)},
        **{f"s{name}": number_or_none(sigma) for name, sigma in zip(names, sigmas, strict=True)},
    }


def sigmas(covariance: FloatArray) -> FloatArray:
    """Standard deviations (…, k) of covariances (…, k, k)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("...ii->...i", covariance), 0.0)))


def correlation(covariance: FloatArray) -> FloatArray:
    """Correlations (k, k); not a number for what is held."""
    sigma = sigmas(covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(covariance / np.outer(sigma, sigma))


def by_turn(angles: FloatArray) -> FloatArray:
    """d(ω, φ, κ)/dδ (3, 3); not a number where φ = ±100 gon and ω and κ are one angle."""
    rows = angles_by_tangent(angles)
    return rows if np.all(np.isfinite(rows)) else np.full((3, 3), np.nan)


# ---- A plane object from two or more images as plain data.


class ObjectSystem(NamedTuple):
    """Scale, system and unit of angles in which the user wants the object."""

    length: tuple[str, str, float] | None
    length_sigma: float
    wall: bool
    unit: str


def planar(measured: HomologousPoints, constants: FloatArray, sigma: float, off: tuple[str, ...] = ()) -> PlaneShape:
    """Shape of the plane object from all images; ``off`` names points beside the plane, else they are looked for.

    Raises :class:`InputError` for names that are not there.
    """
    check_names(measured, off)
    beside = np.isin(np.array(measured.ids, dtype=object), off) if off else None
    return shape_of_plane(bundles(measured, constants, sigma), beside)


def planar_data(
    measured: HomologousPoints, shape: PlaneShape, constants: FloatArray, wanted: ObjectSystem
) -> dict[str, Any]:
    """Plane object and cameras; lengths in the unit of the given length, else the first two points are one apart."""
    check_names(measured, () if wanted.length is None else wanted.length[:2])
    shapes = (shape, *shape.alternatives) if shape.outcome.usable else ()
    return {
        "outcome": shape.outcome.name.lower(),
        "words": shape.outcome.value,
        "usable": shape.outcome.usable,
        "sigma0": number_or_none(shape.sigma0),
        "redundancy": shape.redundancy,
        "scaled": wanted.length is not None,
        "system": "wall Y = 0, Z up" if wanted.wall else "level plane Z = 0",
        "solutions": [_solution(measured, one, constants, wanted) for one in shapes],
    }


def _tie(measured: HomologousPoints, shape: PlaneShape, wanted: ObjectSystem) -> Length:
    known = np.isfinite(shape.points[:, 0])
    if wanted.length is None:
        first, second = (int(k) for k in np.flatnonzero(shape.in_plane & known)[:2])
        return Length(first, second, 1.0, 0.0)
    first, second = (measured.ids.index(name) for name in wanted.length[:2])
    apart = np.linalg.norm(shape.points[second] - shape.points[first])
    if not known[first] or not known[second] or not apart > 0.0:
        raise InputError([Message("the points of the length have no coordinates in the plane, or coincide in it")])
    return Length(first, second, wanted.length[2], wanted.length_sigma)


def _solution(
    measured: HomologousPoints, shape: PlaneShape, constants: FloatArray, wanted: ObjectSystem
) -> dict[str, Any]:
    tie = _tie(measured, shape, wanted)
    scale = scale_from_length(shape, tie.first, tie.second, tie.length)
    placed = (on_wall if wanted.wall else on_level_plane)(shape, tie.first, tie.second, scale)
    covariance = placed_covariance(shape, placed, tie)
    per_unit = ANGLE_UNITS[wanted.unit]
    rows = []
    for k, angles in enumerate(angles_from_rotation(placed.rotations)):
        carried = np.eye(6)
        carried[3:, 3:] = by_turn(angles)
        block = carried @ covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] @ carried.T
        rows.append(
            {
                **with_sigma(("x", "y", "z"), placed.positions[k], sigmas(block)[:3]),
                **with_sigma(ANGLES, angles / per_unit, sigmas(block)[3:] / per_unit),
                "rotation": numbers(placed.rotations[k]),
                "correlation": numbers(correlation(block)),
            }
        )
    return {
        "points": _points(measured, shape, placed, covariance),
        "images": rows,
        **_derived(measured, shape, placed, covariance, constants, per_unit),
        "angle_unit": wanted.unit,
    }


def _points(
    measured: HomologousPoints, shape: PlaneShape, placed: PlacedPlane, covariance: FloatArray
) -> list[dict[str, Any]]:
    frames, rows = 6 * len(placed.positions), []
    for k, name in enumerate(measured.ids):
        block = covariance[frames + 3 * k : frames + 3 * k + 3, frames + 3 * k : frames + 3 * k + 3]
        known = bool(np.isfinite(placed.points[k, 0]))
        sigma = sigmas(block) if known else np.full(3, np.nan)
        rows.append(
            {
                "id": name,
                **with_sigma(("x", "y", "z"), placed.points[k], sigma),
                "correlation": numbers(correlation(block)),
                "place": "plane" if shape.in_plane[k] else "off the plane" if known else "left out",
            }
        )
    return rows


def _derived(
    measured: HomologousPoints,
    shape: PlaneShape,
    placed: PlacedPlane,
    covariance: FloatArray,
    constants: FloatArray,
    per_unit: float,
) -> dict[str, Any]:
    """Sides, angles, heights, flying heights and scales with σ, and their correlation in one matrix."""
    round_it = corners(shape)
    found = derived(shape, placed, covariance, round_it, constants)
    names = [measured.ids[k] for k in round_it]
    count, images = len(names), range(1, len(constants) + 1)
    off = [measured.ids[k] for k in np.flatnonzero(~shape.in_plane & ~shape.left_out)]
    told = [("side", f"{a}-{b}") for a, b in zip(names, [*names[1:], names[0]], strict=True)]
    told += [("angle", name) for name in names] + [("height", name) for name in off]
    told += [(kind, str(k)) for kind in ("flying height", "flying height / c") for k in images]
    unit = np.ones(len(told))
    unit[count : 2 * count] = per_unit
    values, sigma = found.values / unit, sigmas(found.covariance) / unit
    return {
        "corners": names,
        "sides": numbers(values[:count]),
        "angles": numbers(values[count : 2 * count]),
        "results": [
            {"kind": kind, "of": of, "value": number_or_none(value), "sigma": number_or_none(one)}
            for (kind, of), value, one in zip(told, values, sigma, strict=True)
        ],
        "correlation": numbers(correlation(found.covariance)),
    }


# ---- Relative orientation of a chain of images as plain data.


class Oriented(NamedTuple):
    """Pairs of neighbouring images, and the model of all of them."""

    pairs: list[RobustOrientation]
    auxiliary: list[Auxiliary | None]
    common: list[BoolArray]
    """(n,) the points that both images of a pair show."""
    used: BoolArray
    """(m, n) rays that count: those of wrong pairs do not."""
    chain: Chain | None
    model: StereoModel | None
    """Nothing where a pair is not oriented, or no scale passes from one pair to the next."""
    rivals: int
    """Other combinations of the orientations of ambiguous pairs with which all images fit together as well."""


def relative(measured: HomologousPoints, constants: FloatArray, sigma: float) -> Oriented:
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
    known = [pair.orientation.outcome.usable for pair in pairs]
    hang_together = any(known) and all(
        one or bool(np.all(np.isfinite(pair.orientation.rotation)) and np.isnan(pair.orientation.base[0]))
        for one, pair in zip(known, pairs, strict=True)
    )
    all_of_them = joined(pairs, images, used) if hang_together else Joined(pairs, None, None, 0)
    auxiliary: list[Auxiliary | None] = [None] * len(pairs)
    for k, (pair, both) in enumerate(zip(all_of_them.pairs, common, strict=True)):
        if pair.orientation.outcome.usable:
            a, b = (image.take(both).take(pair.agreeing) for image in images[k : k + 2])
            auxiliary[k] = auxiliary_of(a, b, pair.orientation)
    return Oriented(
        all_of_them.pairs, auxiliary, common, used, all_of_them.chain, all_of_them.model, all_of_them.rivals
    )


def relative_data(
    measured: HomologousPoints, found: Oriented, unit: str, attitude: FloatArray | None
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
    # Covariance (6, 6) of b and ω* φ* κ*.
    rows = np.eye(6)
    rows[3:, 3:] = by_turn(o.angles)
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
        "correlation": {
            "of": ["bx", "by", "bz", *ANGLES],
            "matrix": numbers(correlation(np.asarray(rows @ o.covariance @ rows.T))),
        },
        "sigma0": number_or_none(o.sigma0),
        "auxiliary_unknowns": numbers(o.unknowns),
        "rinner": None if auxiliary is None else _rinner(auxiliary),
        "candidates": [_candidate(c, o) for c in o.candidates],
        "alternatives": [_candidate(c, o) for c in o.alternatives],
        "plane_orientations": [_candidate(c, o) for c in o.plane_orientations],
        "residuals": [
            {"id": name, "coplanarity": number_or_none(v), "used": bool(used)}
            for name, v, used in zip(ids, found.residuals, found.agreeing, strict=True)
        ],
    }


def _rinner(auxiliary: Auxiliary) -> dict[str, Any]:
    parts = (auxiliary.linear, auxiliary.corrections, auxiliary.compatible, auxiliary.adjusted, auxiliary.sigma)
    names = ("linear", "correction", "compatible", "adjusted", "sigma")
    columns = [part.ravel() for part in parts]
    indices = tuple(f"{i}{k}" for i in (1, 2, 3) for k in (1, 2, 3))
    return {
        "ik": [
            {"ik": ik, **{name: number_or_none(value) for name, value in zip(names, row, strict=True)}}
            for ik, row in zip(indices, zip(*columns, strict=True), strict=True)
        ],
        "conditions": [
            {"condition": name, "linear": number_or_none(before), "adjusted": number_or_none(after)}
            for name, before, after in zip(CONDITIONS, auxiliary.misclosures, auxiliary.remaining, strict=True)
        ],
    }


def _candidate(candidate: OrientationCandidate, o: RelativeOrientation) -> dict[str, Any]:
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
        "sigma0": number_or_none(model.sigma0),
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
    for both, pair in zip(found.common, found.pairs, strict=True):
        if both[point] and not pair.agreeing[int(np.sum(both[:point]))]:
            return "wrong pair"
    return "" if found.model is None else found.model.reasons[point].value


# ---- Relative orientation of a chain of images for reading.

SHOWN = 6
"""Decimals of angles; of the ik and the base one more."""


def relative_text(data: dict[str, Any], words: Words) -> str:
    """Every pair, then the model of all images."""
    parts = [_text_of_pair(pair, len(data["pairs"]) > 1, words) for pair in data["pairs"]]
    parts.append(_text_of_model(data, words))
    return "\n\n".join(part for part in parts if part) + "\n"


def _text_of_pair(pair: dict[str, Any], many: bool, words: Words) -> str:
    first, second = pair["images"]
    title = [heading(words("Images {first} and {second}", first=first, second=second))] if many else []
    lines = [*title, words("Relative orientation: {words}", words=_outcome(pair, words))]
    lines.append(words("object: {geometry}", geometry=words.listed(pair["geometry"])))
    said = "{used} of {points} points used, sigma0 {sigma0} [1]"
    lines.append(words(said, used=pair["used"], points=pair["points"], sigma0=short(pair["sigma0"], 4)))
    if 10 * pair["used"] < 9 * pair["points"] and pair["usable"]:
        said = (
            "{count:point does|points do} not agree: many wrong pairs may be caused by a wrong camera constant, image "
            "coordinates that do not refer to the principal point, or mismatched identities."
        )
        lines.append(words(said, count=pair["points"] - pair["used"]))
    lines += _planes(pair, words)
    if pair["usable"]:
        lines += [
            "",
            _parameters(pair, words),
            words("X_B* = D* (X_A* - b*), |b*| = 1, D* = (Rx(omega*) Ry(phi*) Rz(kappa*))^T"),
            "",
            (
                correlation_table(
                    ["bX*", "bY*", "bZ*", "omega*", "phi*", "kappa*"], pair["correlation"]["matrix"], words
                )
            ),
        ]
        rows = [
            [row["id"], fixed(row["coplanarity"], 3), "" if row["used"] else words.listed("not used")]
            for row in pair["residuals"]
        ]
        lines += [
            "",
            *_text_of_rinner(pair, words),
            "",
            table(["point", "coplanarity [sigma]", "remark"], rows, words=words),
        ]
    elif pair["angles"]["omega"] is not None:
        lines += ["", _parameters(pair, words)]
    if pair["alternatives"]:
        said = (
            "{count:other orientation fits|other orientations fit} about as well; another image decides between them."
        )
        lines.append(words(said, count=len(pair["alternatives"])))
    return "\n".join(lines)


def _outcome(pair: dict[str, Any], words: Words) -> str:
    said = words.listed(pair["words"].split(" (")[0])
    return f"{said} ({words.listed(pair['geometry'])})" if " (" in pair["words"] else said


def _planes(pair: dict[str, Any], words: Words) -> list[str]:
    lines = []
    for number, one in enumerate(pair["plane_orientations"], start=1):
        lines.append(
            words(
                "orientation {number} of the plane: base {base}; points behind a camera: {behind} of {points}",
                number=number,
                base=" ".join(words.number(fixed(value, 4)) for value in one["base"]),
                behind=one["behind"],
                points=one["behind"] + one["in_front_of_both"],
            )
        )
    return lines


def _parameters(pair: dict[str, Any], words: Words) -> str:
    angles = pair["angles"]
    rows = [
        [name, "1", fixed(value, SHOWN + 1), fixed(sigma, SHOWN + 1)]
        for name, value, sigma in zip(("bX*", "bY*", "bZ*"), pair["base"], pair["sigma_base"], strict=True)
    ]
    rows += [
        [f"{name}*", angles["unit"], fixed(angles[name], SHOWN), fixed(angles[f"s{name}"], SHOWN)]
        for name in ("omega", "phi", "kappa")
    ]
    return table(["parameter", "unit", "value", "sigma"], rows, left=2, words=words)


def correlation_table(names: list[str], matrix: list[list[float | None]], words: Words) -> str:
    """Lower triangle of correlations."""
    rows = [
        [name, *(fixed(value, 2) if column <= k else "" for column, value in enumerate(row))]
        for k, (name, row) in enumerate(zip(names, matrix, strict=True))
    ]
    return table(["correlation", *names], rows, words=words)


def _text_of_rinner(pair: dict[str, Any], words: Words) -> list[str]:
    found = pair["rinner"]
    lines = [words("Auxiliary unknowns ik (Rinner): from the linear system, made compatible, adjusted")]
    if found["ik"][0]["linear"] is None:
        lines.append(words("The linear system has no solution of its own for points in a plane."))
    names = ("linear", "correction", "compatible", "adjusted", "sigma")
    rows = [[row["ik"], *(fixed(row[name], SHOWN + 1) for name in names)] for row in found["ik"]]
    lines.append(table(["ik", *names], rows, words=words))
    rows = [
        [row["condition"], *("-" if row[name] is None else f"{row[name]:.1e}" for name in ("linear", "adjusted"))]
        for row in found["conditions"]
    ]
    return [*lines, table(["condition", "misclosure, linear", "misclosure, adjusted"], rows, words=words)]


def _text_of_model(data: dict[str, Any], words: Words) -> str:
    model = data["model"]
    if model is None:
        known = all(pair["usable"] for pair in data["pairs"])
        no_scale = words("No model of all images: two neighbouring pairs have no points in common that give the scale.")
        apart = words("No model of all images: not every pair of neighbouring images is oriented.")
        return no_scale if known else apart if len(data["pairs"]) > 1 else ""
    unit = data["angles"]["unit"]
    system = "object system" if model["system"] == "object" else "axes of the first image"
    lines = [heading(words("Model")), words("{system}, unit of length: the first base", system=words.listed(system))]
    counts = [str(count) for count in model["scale_points"] if count is not None]
    if counts:
        said = "points that carried the scale from pair to pair: {counts}; all images adjusted together"
        lines.append(words(said, counts=", ".join(counts)))
    said = "sigma0 {sigma0} [1], redundancy {redundancy}"
    lines.append(words(said, sigma0=short(model["sigma0"], 4), redundancy=model["redundancy"]))
    if len(data["pairs"]) > 1 and any(pair["alternatives"] for pair in data["pairs"]):
        lines.append(_decided(model["rivals"], words))
    headers = ["image", *_headed(("X0", "Y0", "Z0"), "1"), *_headed(("omega", "phi", "kappa"), unit)]
    keys = ("x", "y", "z", "omega", "phi", "kappa")
    rows = [[str(one["image"]), *_valued(one, keys, SHOWN)] for one in model["images"]]
    lines += ["", table(headers, rows, words=words), ""]
    rows = [
        [one["id"], *_valued(one, keys[:3], SHOWN), ("" if one["remark"] is None else words.listed(one["remark"]))]
        for one in model["points"]
    ]
    lines.append(table(["point", *_headed(("X", "Y", "Z"), "1"), "remark"], rows, words=words))
    return "\n".join(lines)


def _decided(rivals: int, words: Words) -> str:
    if rivals:
        return words(
            "With other orientations of the ambiguous pairs all images fit together as well: "
            "{count:other model|other models}.",
            count=rivals,
        )
    return words("For ambiguous pairs, only the orientations listed first fit the other images.")


def _headed(names: tuple[str, ...], unit: str) -> list[str]:
    return [header for name in names for header in (f"{name} [{unit}]", "sigma")]


def _valued(row: dict[str, Any], keys: tuple[str, ...], digits: int) -> list[str]:
    return cells(row, " ".join(f"{name}:.{digits}f" for key in keys for name in (key, f"s{key}")))


# ---- A plane object for reading, every admissible solution.


def planar_text(data: dict[str, Any], words: Words) -> str:
    """The outcome, and each solution with σ."""
    lines = [words("Plane object: {words}", words=words.listed(data["words"]))]
    if data["outcome"] == "not_plane":
        lines.append(
            words(
                "Points off the plane are found if at least five points, and half of all, lie in "
                "the plane; otherwise name them with --off."
            )
        )
    if not data["solutions"]:
        return "\n".join(lines) + "\n"
    lines.append(
        words(
            "sigma0 {sigma0} [1], redundancy {redundancy}, system: {system}",
            sigma0=short(data["sigma0"], 4),
            redundancy=data["redundancy"],
            system=words.listed(data["system"]),
        )
    )
    if not data["scaled"]:
        lines.append(words("No length is given: the first two points are one unit of length apart."))
    if data["outcome"] == "base_along_normal":
        lines.append(
            words("No standard deviations: to first order they are meaningless at the critical configuration.")
        )
    count = len(data["solutions"])
    for number, solution in enumerate(data["solutions"], start=1):
        if count > 1:
            lines += ["", words("Solution {number} of {count}", number=number, count=count)]
        lines += ["", *_text_of_solution(solution, words)]
    return "\n".join(lines) + "\n"


def _text_of_solution(solution: dict[str, Any], words: Words) -> list[str]:
    unit = solution["angle_unit"]
    points = [
        [p["id"], *_valued(p, ("x", "y", "z"), 5), "" if p["place"] == "plane" else words.listed(p["place"])]
        for p in solution["points"]
    ]
    images = [
        [str(k), *_valued(i, ("x", "y", "z", "omega", "phi", "kappa"), 5)]
        for k, i in enumerate(solution["images"], start=1)
    ]
    length = words.listed("length")
    # Correlated as the flying height itself.
    over_constant = "flying height / c"
    results = [
        [words.listed(r["kind"]), r["of"], said, fixed(r["value"], 5), fixed(r["sigma"], 5)]
        for r in solution["results"]
        for said in [words.listed({"angle": unit, over_constant: "length / c"}.get(r["kind"], "length"))]
    ]
    lines = [table(["point", *_headed(("X", "Y", "Z"), length), "remark"], points, words=words), ""]
    headers = ["image", *_headed(("X0", "Y0", "Z0"), length), *_headed(("omega", "phi", "kappa"), unit)]
    lines += [table(headers, images, words=words), ""]
    lines.append(table(["result", "of", "unit", "value", "sigma"], results, left=3, words=words))
    shown = [k for k, r in enumerate(solution["results"]) if r["kind"] != over_constant]
    matrix = [[solution["correlation"][i][j] for j in shown] for i in shown]
    # Results whose correlations are shown; of more they are in the JSON.
    if len(shown) <= 14 and any(value is not None for row in matrix for value in row):
        names = [f"{words.listed(solution['results'][k]['kind'])} {solution['results'][k]['of']}" for k in shown]
        lines += ["", correlation_table(names, matrix, words)]
    return lines
