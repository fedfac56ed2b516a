"""A world as a project on disk: with nothing given, or with the truth as start values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from mor.types import FloatArray
from tests.scenarios.mixtures.world import C, World, rotation

GON = 200.0 / np.pi


def write_project(world: World, folder: Path) -> tuple[Path, Path]:
    """The projects with nothing given and with the truth given; both share one table of image coordinates."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["image,point,x,y", *(f"{i},{p},{x:.7f},{y:.7f}" for i, p, x, y in world.rays)]
    (folder / "rays.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    paths = folder / "project.yaml", folder / "truth.yaml"
    for path, given in zip(paths, (False, True), strict=True):
        path.write_text(_document(world, given), encoding="utf-8")
    return paths


def _document(world: World, given: bool) -> str:
    sections = {
        "mor": "1",
        "title": f"mixture {world.seed}: {', '.join(sorted(world.tags))}",
        "cameras": {"c": {"interior": {"c": C}}},
        "images": [_images(world, given)] if world.images else [],
        "pairs": [_pair(world, given)] if world.base is not None else [],
        "points": [_points(world, given)],
        "stations": _stations(world, given),
        "systems": [_systems(world, given, free) for free in (True, False)],
        "features": [
            {"type": world.kind_of_feature, "id": name, "points": points, "sigma": _size(world.size)}
            for name, points in world.planes.items()
        ],
        "observations": [*_observations(world), *world.tables],
        "datum": "free" if world.free else "fixed",
    }
    used = {key: [t for t in value if t] if isinstance(value, list) else value for key, value in sections.items()}
    return "\n".join(f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in used.items() if value) + "\n"


def _size(size: float) -> str:
    return f"{0.1 * size:.3f}"


def _number(value: float | None, digits: int = 8) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def _angles(D: FloatArray) -> list[str]:
    """ω, φ, κ in gon of D = (Rx Ry Rz)ᵀ."""
    omega, phi, kappa = np.arctan2(-D[2, 1], D[2, 2]), np.arcsin(D[2, 0]), np.arctan2(-D[1, 0], D[0, 0])
    return [_number(GON * float(angle), 9) for angle in (omega, phi, kappa)]


def _table(columns: list[str], rows: list[list[str]], **more: Any) -> dict[str, Any]:
    return {"columns": columns, "rows": rows, **more} if rows else {}


def _points(world: World, given: bool) -> dict[str, Any]:
    rows = []
    for name, point in world.points.items():
        noise = np.random.default_rng(world.seed + 7 * len(rows)).standard_normal(3)
        start = point.xyz if given or point.rough is None else point.rough
        told = given or point.rough is not None
        values = [
            _number(float(true + sigma * shake) if sigma is not None else float(first))
            if told or sigma is not None
            else ""
            for true, first, sigma, shake in zip(point.xyz, start, point.sigma, noise, strict=True)
        ]
        rows.append([name, *values, *(_number(sigma) for sigma in point.sigma)])
    return _table(["id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"], rows)


def _images(world: World, given: bool) -> dict[str, Any]:
    columns = ["id", "camera", "position", "height", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"]
    turned = ["sigma_omega", "sigma_phi", "sigma_kappa"] if _any_turned(world) else []
    rows = []
    for name, image in world.images.items():
        own = not image.leader and not image.over
        noise = np.random.default_rng(world.seed + 11 * len(rows)).standard_normal(3) * (image.observed or 0.0)
        place = [_number(v) if own and (given or image.observed or image.held) else "" for v in image.centre + noise]
        sigma = ["0" if image.held else _number(image.observed) if own else ""] * 3
        shake = rotation((image.turned or 0.0) * np.random.default_rng(world.seed + 13 * len(rows)).standard_normal(3))
        told = (given or image.held or image.turned is not None) and not image.leader
        angles = _angles(shake @ image.D) if told else [""] * 3
        angles += ["0" if image.held else "" if image.turned is None else f"{GON * image.turned:.9f}"] * len(turned)
        height = _number(image.height) if image.over else ""
        pair = "rig" if image.leader else ""
        rows.append([name, "c", image.over, height, *place, *sigma, *angles, image.leader, pair])
    return _table([*columns, "omega", "phi", "kappa", *turned, "leader", "pair"], rows)


def _any_turned(world: World) -> bool:
    return any(image.held or image.turned is not None for image in world.images.values())


def _pair(world: World, given: bool) -> dict[str, Any]:
    assert world.base is not None
    assert world.turn is not None
    known = given or world.base_sigma is not None
    base = [_number(v) if known else "" for v in world.base]
    row = ["rig", *base, *[_number(world.base_sigma)] * 3, *(_angles(world.turn) if given else [""] * 3)]
    columns = ["id", "bx", "by", "bz", "sigma_bx", "sigma_by", "sigma_bz", "omega", "phi", "kappa"]
    return _table(columns, [row])


def _stations(world: World, given: bool) -> list[dict[str, Any]]:
    tables = []
    for level in sorted({station.level for station in world.stations.values()}):
        rows = [
            [name, station.over, _number(station.height), *(_angles(station.D) if given else [""] * 3)]
            for name, station in world.stations.items()
            if station.level == level
        ]
        if level == "fixed":
            rows = [[*row[:3], row[5]] for row in rows]
        angles = ["kappa"] if level == "fixed" else ["omega", "phi", "kappa"]
        tables.append(_table(["id", "point", "height", *angles], rows, level=level))
    return tables


def _systems(world: World, given: bool, free: bool) -> dict[str, Any]:
    columns = ["x", "y", "z", "omega", "phi", "kappa", "scale"]
    held = ("scale", *world.system_held) if not free else ()
    rows = []
    for name, (origin, D, scale, scale_free) in world.systems.items():
        if scale_free is free:
            values = [*map(_number, origin), *_angles(D), _number(scale)]
            told = [v if given or c in held else "" for c, v in zip(columns, values, strict=True)]
            rows.append([name, *told])
    return _table(["id", *columns], rows, **({} if free else {"fixed": list(held)}))


def _observations(world: World) -> list[dict[str, Any]]:
    length, angle = _number(world.sigma_length), "0.00063662"
    tables: list[dict[str, Any]] = []
    if world.rays:
        tables.append({"type": "image", "file": "rays.csv", "values": {"sigma": "0.002"}})
    rows = [[s, p, _number(GON * h, 9), _number(GON * z, 9), _number(above)] for s, p, h, z, above in world.directions]
    columns = ["station", "to", "horizontal", "zenith", "to_height"]
    tables.append(_table(columns, rows, type="zenith_directions", values={"sigma": angle}))
    rows = [[a, b, _number(d), _number(above)] for a, b, d, above in world.distances]
    tables.append(_table(["from", "to", "distance", "to_height"], rows, type="distance", values={"sigma": length}))
    rows = [[a, b, _number(dz)] for a, b, dz in world.level_lines]
    tables.append(_table(["from", "to", "dz"], rows, type="height_difference", values={"sigma": length}))
    rows = [[a, b, *map(_number, d)] for a, b, *d in world.vectors]
    tables.append(_table(["from", "to", "dx", "dy", "dz"], rows, type="vector", values={"sigma": length}))
    rows = [[system, p, *map(_number, xyz)] for system, p, *xyz in world.local]  # NaN is an empty cell
    tables.append(_table(["system", "point", "x", "y", "z"], rows, type="local", values={"sigma": length}))
    rows = [[a, b, _number(GON * t, 9)] for a, b, t in world.bearings]
    tables.append(_table(["from", "to", "bearing"], rows, type="bearing", values={"sigma": "6.4 mgon"}))
    return tables
