"""Relative and planar orientation on their own: tables in, text and plain data out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.approximate.bundle import Bundle, image_bundle
from mor.approximate.planar.plane_object import on_level_plane, on_wall, scale_from_length, sides_and_angles
from mor.approximate.planar.plane_shape import PlaneShape, shape_of_plane
from mor.approximate.relative_orientation.outcome import RelativeOrientation
from mor.approximate.relative_orientation.robust import RobustOrientation, robust_relative_orientation
from mor.arrays import FloatArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.geometry.rotations import angles_from_rotation
from mor.input_files import read_bytes
from mor.report.text.layout import fixed, short, table
from mor.units import ANGLE_UNITS


@dataclass(frozen=True)
class Measured:
    """Homologous image points: identifiers and coordinates (n, images, 2), NaN where not measured."""

    ids: tuple[str, ...]
    coordinates: FloatArray


def read_homologous(path: Path) -> Measured:
    """Table with the columns id, x1, y1, x2, y2, … Raises :class:`InputError` with every mistake found."""
    try:
        frame = pl.read_csv(read_bytes(path), infer_schema=False)
    except pl.exceptions.PolarsError as error:
        raise InputError([Problem(f"not a table: {str(error).splitlines()[0]}", str(path))]) from None
    images = 0
    while {f"x{images + 1}", f"y{images + 1}"} <= set(frame.columns):
        images += 1
    if "id" not in frame.columns or images < 2:
        found = ", ".join(frame.columns)
        raise InputError([Problem(f"expected the columns id, x1, y1, x2, y2, found {found}", str(path), 1)])
    _check_names(frame["id"].to_list(), path)
    names = [f"{axis}{image}" for image in range(1, images + 1) for axis in "xy"]
    return Measured(
        tuple(frame["id"].to_list()), _numbers(frame, names, path).reshape(frame.height, images, 2)
    )


def _check_names(ids: list[str | None], path: Path) -> None:
    """Every row has a name of its own."""
    first: dict[str, int] = {}
    problems = []
    for line, name in enumerate(ids, start=2):
        if name is None or not name.strip():
            problems.append(Problem("id is empty", str(path), line))
        elif name in first:
            problems.append(
                Problem(f"id {name!r} is given twice (first in line {first[name]})", str(path), line)
            )
        else:
            first[name] = line
    if problems:
        raise InputError(problems)


def _numbers(frame: pl.DataFrame, names: list[str], path: Path) -> FloatArray:
    problems = []
    result = np.full((frame.height, len(names)), np.nan)
    for k, name in enumerate(names):
        for i, cell in enumerate(frame[name].to_list()):
            if cell is None or not cell.strip():
                continue
            try:
                result[i, k] = float(cell)
            except ValueError:
                result[i, k] = np.nan
            if not np.isfinite(result[i, k]):
                problems.append(Problem(f"{name}: found {cell!r}, expected a number", str(path), i + 2))
    if problems:
        raise InputError(problems)
    return result


def bundles(measured: Measured, constants: FloatArray, sigma: float) -> list[Bundle]:
    """One bundle for each image, with its camera constant; image coordinates relative to the principal point."""
    rays = np.concatenate(
        [
            measured.coordinates,
            np.broadcast_to(-constants[None, :, None], (*measured.coordinates.shape[:2], 1)),
        ],
        axis=2,
    )
    rays[np.isnan(measured.coordinates).any(axis=2)] = np.nan
    return [image_bundle(rays[:, image], sigma) for image in range(rays.shape[1])]


def relative(measured: Measured, constants: FloatArray, sigma: float) -> RobustOrientation:
    """Relative orientation of the first two images."""
    both = np.isfinite(measured.coordinates[:, :2]).all(axis=(1, 2))
    pair = Measured(tuple(np.array(measured.ids)[both]), measured.coordinates[both, :2])
    a, b = bundles(pair, constants[:2], sigma)
    return robust_relative_orientation(a, b)


def relative_data(measured: Measured, found: RobustOrientation, unit: str) -> dict[str, Any]:
    """Relative orientation as plain data; angles in ``unit``."""
    o, per_unit = found.orientation, ANGLE_UNITS[unit]
    both = np.isfinite(measured.coordinates[:, :2]).all(axis=(1, 2))
    ids = np.array(measured.ids, dtype=object)[both]
    return {
        "outcome": o.outcome.name.lower(),
        "words": o.outcome.value,
        "usable": o.outcome.usable,
        "geometry": o.geometry.value,
        "points": int(both.sum()),
        "used": int(np.count_nonzero(found.agreeing)),
        "base": _list(o.base),
        "sigma_base": _list(o.sigma_base),
        "rotation": _list(o.rotation),
        "angles": {"unit": unit, **_named(o.angles / per_unit, o.sigma_angles / per_unit)},
        "sigma0": _number(o.sigma0),
        "auxiliary_unknowns": _list(o.unknowns),
        "candidates": [_candidate(c) for c in o.candidates],
        "alternatives": [_candidate(c) for c in o.alternatives],
        "residuals": [
            {"id": name, "coplanarity": _number(v), "used": bool(used)}
            for name, v, used in zip(ids, found.residuals, found.agreeing, strict=True)
        ],
    }


def relative_text(data: dict[str, Any]) -> str:
    """Relative orientation for reading."""
    lines = [f"Relative orientation: {data['words']}", f"object: {data['geometry']}"]
    lines.append(f"{data['used']} of {data['points']} points used, sigma0 {short(data['sigma0'], 4)} [1]")
    if 10 * data["used"] < 9 * data["points"] and data["usable"]:
        apart = counted(data["points"] - data["used"], "point does", "points do")
        lines.append(
            f"{apart} not agree: more than a few wrong pairs can be a wrong camera "
            "constant, image coordinates not relative to the principal point, or mismatched identities."
        )
    if data["usable"]:
        unit = data["angles"]["unit"]
        rows = [
            [name, "1", fixed(value, 7), fixed(sigma, 7)]
            for name, value, sigma in zip(
                ("bX*", "bY*", "bZ*"), data["base"], data["sigma_base"], strict=True
            )
        ]
        for name in ("omega", "phi", "kappa"):
            rows.append(
                [f"{name}*", unit, fixed(data["angles"][name], 6), fixed(data["angles"][f"s{name}"], 6)]
            )
        lines += ["", table(["parameter", "unit", "value", "sigma"], rows, left=2)]
        lines.append("X_B* = D* (X_A* - b*), |b*| = 1, D* = (Rx(omega*) Ry(phi*) Rz(kappa*))^T")
        lines += ["", _residual_table(data)]
    if data["alternatives"]:
        lines.append(
            f"{counted(len(data['alternatives']), 'other orientation fits', 'other orientations fit')} about as well; "
            "a further image decides."
        )
    return "\n".join(lines) + "\n"


def _residual_table(data: dict[str, Any]) -> str:
    rows = [[r["id"], fixed(r["coplanarity"], 3), "" if r["used"] else "not used"] for r in data["residuals"]]
    return table(["point", "coplanarity [sigma]", "remark"], rows)


def planar(measured: Measured, constants: FloatArray, sigma: float) -> PlaneShape:
    """Shape of the plane object from all images."""
    return shape_of_plane(bundles(measured, constants, sigma))


def planar_data(
    measured: Measured, shape: PlaneShape, length: tuple[str, str, float] | None, wall: bool, unit: str
) -> dict[str, Any]:
    """Plane object and cameras as plain data; lengths in the unit of ``length``, else one base."""
    solutions = [_placed(measured, one, length, wall, unit) for one in (shape, *shape.alternatives)]
    return {
        "outcome": shape.outcome.name.lower(),
        "words": shape.outcome.value,
        "sigma0": _number(shape.sigma0),
        "redundancy": shape.redundancy,
        "scaled": length is not None,
        "system": "wall Y = 0, Z up" if wall else "level plane Z = 0",
        "solutions": solutions if shape.outcome.usable else [],
    }


def _placed(
    measured: Measured, shape: PlaneShape, length: tuple[str, str, float] | None, wall: bool, unit: str
) -> dict[str, Any]:
    if not np.isfinite(shape.points).any():
        return {}
    ids = list(measured.ids)
    if length is None:
        first, second, scale = 0, 1, 1.0
    else:
        for name in length[:2]:
            if name not in ids:
                raise InputError([Problem(f"point {name!r} of the length does not exist")])
        first, second = ids.index(length[0]), ids.index(length[1])
        scale = scale_from_length(shape, first, second, length[2])
    placed = (on_wall if wall else on_level_plane)(shape, first, second, scale)
    corners = sides_and_angles(shape.points[:4]) if len(ids) == 4 else None
    angles = angles_from_rotation(placed.rotations) / ANGLE_UNITS[unit]
    return {
        "points": [
            {"id": name, **dict(zip("xyz", map(_number, row), strict=True))}
            for name, row in zip(ids, placed.points, strict=True)
        ],
        "images": [
            {
                **dict(zip("xyz", map(_number, position), strict=True)),
                **dict(zip(("omega", "phi", "kappa"), map(_number, turn), strict=True)),
            }
            for position, turn in zip(placed.positions, angles, strict=True)
        ],
        "sides": None if corners is None else _list(scale * corners.sides),
        "angles": None if corners is None else _list(corners.angles / ANGLE_UNITS[unit]),
        "angle_unit": unit,
    }


def planar_text(data: dict[str, Any]) -> str:
    """Plane object for reading, every admissible solution."""
    lines = [f"Plane object: {data['words']}"]
    if not data["solutions"]:
        return lines[0] + "\n"
    lines.append(
        f"sigma0 {short(data['sigma0'], 4)} [1], redundancy {data['redundancy']}, system: {data['system']}"
    )
    if not data["scaled"]:
        lines.append("No length is given: the unit of length is arbitrary.")
    for number, solution in enumerate(data["solutions"], start=1):
        if len(data["solutions"]) > 1:
            lines += ["", f"Solution {number} of {len(data['solutions'])}"]
        unit = solution["angle_unit"]
        points = [[p["id"], *(fixed(p[c], 5) for c in "xyz")] for p in solution["points"]]
        lines += ["", table(["point", "X [length]", "Y [length]", "Z [length]"], points)]
        images = [
            [str(k), *(fixed(i[c], 5) for c in "xyz"), *(fixed(i[c], 5) for c in ("omega", "phi", "kappa"))]
            for k, i in enumerate(solution["images"], start=1)
        ]
        headers = ["image", "X0 [length]", "Y0 [length]", "Z0 [length]"]
        lines += ["", table([*headers, *(f"{n} [{unit}]" for n in ("omega", "phi", "kappa"))], images)]
        if solution["sides"] is not None:
            lines.append("sides [length]: " + ", ".join(fixed(s, 5) for s in solution["sides"]))
            lines.append(f"angles [{unit}]: " + ", ".join(fixed(a, 4) for a in solution["angles"]))
    return "\n".join(lines) + "\n"


def is_known(found: RelativeOrientation | PlaneShape) -> bool:
    """True where the outcome names a solution, unambiguous or not."""
    return found.outcome.usable


def _candidate(candidate: Any) -> dict[str, Any]:
    return {
        "base": _list(candidate.base),
        "rotation": _list(candidate.rotation),
        "in_front_of_both": int(candidate.in_front_of_both),
    }


def _named(values: FloatArray, sigmas: FloatArray) -> dict[str, Any]:
    names = ("omega", "phi", "kappa")
    return {
        **{n: _number(v) for n, v in zip(names, values, strict=True)},
        **{f"s{n}": _number(s) for n, s in zip(names, sigmas, strict=True)},
    }


def _list(array: FloatArray) -> Any:
    return [_list(row) for row in array] if np.ndim(array) > 1 else [_number(value) for value in array]


def _number(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
