"""What stands in the way of sights, and where targets look, as a project says it: internal axes, its length unit."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import InputError, Problem, nearest
from mor.geometry.polygons import triangulated
from mor.geometry.triangles import Triangles, face_normals, faces_of, triangles
from mor.planning.visibility.local_axes import local_axes, placed
from mor.planning.visibility.mesh_files import Mesh, read_mesh
from mor.planning.visibility.targets import Targets, targets_named
from mor.project.edge import UnitError
from mor.project.file.visibility import Normals, Surface
from mor.project.network.reading import Reading
from mor.project.tables.columns import Column
from mor.project.tables.tables import Place, read_table
from mor.units import LENGTH


class Surroundings(NamedTuple):
    """Everything that no sight goes through, and the normals of targets."""

    obstacles: Triangles
    clearance: float
    """Distance of a surface from either end of a sight up to which it is not in the way."""
    normals: FloatArray
    """(points, 3) unit normals, internal axes; NaN if a target has none."""


def surroundings(reading: Reading, targets: Targets) -> Surroundings:
    """The surroundings of a project. Mistakes are added to those of the reading."""
    given = reading.project.visibility
    place = reading.at("visibility")
    try:
        clearance = reading.edge.number(given.clearance, LENGTH)
        if clearance < 0.0:
            raise UnitError(f"found {given.clearance}, expected a length")
    except UnitError as error:
        reading.problems.append(place.problem(f"clearance: {error}", "clearance"))
        clearance = 0.0
    found: list[FloatArray] = []
    by_name: dict[str, FloatArray] = {}
    for number, surface in enumerate(given.surfaces):
        corners = _corners(reading, surface, reading.at("visibility", "surfaces", number), targets)
        found.append(corners)
        if surface.name is not None:
            by_name[surface.name] = np.concatenate([by_name.get(surface.name, np.zeros((0, 3, 3))), corners])
    everything = np.concatenate([np.zeros((0, 3, 3)), *found])
    normals = np.full((len(targets.names), 3), np.nan)
    for number, one in enumerate(given.normals):
        at = reading.at("visibility", "normals", number)
        _put_normals(reading, one, at, targets, by_name, clearance, normals)
    return Surroundings(_inside(reading, everything), clearance, normals)


def _inside(reading: Reading, corners: FloatArray) -> Triangles:
    """Triangles in internal axes; their corners turn to the left in the axes of the project."""
    M = reading.edge.matrix
    return triangles(corners @ M.T, face_normals(corners) @ M.T)


def _corners(reading: Reading, surface: Surface, place: Place, targets: Targets) -> FloatArray:
    """(m, 3, 3) corners of the triangles of a surface, axes of the project."""
    try:
        if surface.file is not None:
            mesh = read_mesh(reading.place.folder / Path(surface.file))
            factor = reading.edge.factor(LENGTH, surface.unit or "")
            return _triangles_of(Mesh(placed(reading, mesh.vertices * factor), mesh.faces))
        corners = np.array([_corner(reading, at, targets) for at in surface.polygon or []])
        return np.asarray(corners[triangulated(corners)])
    except InputError as error:
        reading.problems += [one if one.line else place.problem(one.message) for one in error.problems]
    except ValueError as error:  # of units, too
        reading.problems.append(place.problem(f"this surface: {error}"))
    return np.zeros((0, 3, 3))


def _corner(reading: Reading, at: str | list[str], targets: Targets) -> FloatArray:
    """(3,) a corner of a polygon, axes of the project. Raises ``ValueError``."""
    if not isinstance(at, str):
        given = np.array([[reading.edge.number(text, LENGTH) for text in at]])
        return np.asarray(placed(reading, given)[0])
    if at not in targets.numbers:
        raise ValueError(f"point {at!r} does not exist{nearest(at, targets.names)}")
    found = targets.positions[targets.numbers[at]] @ reading.edge.matrix
    if not np.isfinite(found).all():
        raise ValueError(f"point {at!r} has no coordinates")
    return np.asarray(found)


def _triangles_of(mesh: Mesh) -> FloatArray:
    """(m, 3, 3) corners of the triangles that the faces of a mesh consist of; faces without area are nothing."""
    V = mesh.vertices
    sizes = np.array([len(face) for face in mesh.faces])
    three = [mesh.faces[k] for k in np.flatnonzero(sizes == 3)]
    four = [mesh.faces[k] for k in np.flatnonzero(sizes == 4)]
    found = [
        V[np.array(three, dtype=np.int64).reshape(-1, 3)],
        _halves(V[np.array(four, dtype=np.int64).reshape(-1, 4)]),
    ]
    for k in np.flatnonzero(sizes > 4).tolist():
        corners = V[mesh.faces[k]]
        try:
            found.append(corners[triangulated(corners)])
        except ValueError as error:
            raise ValueError(f"face {k + 1}: {error}") from None
    corners = np.concatenate(found)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.asarray(corners[area > 0.0])


def _halves(corners: FloatArray) -> FloatArray:
    """(2 n, 3, 3) halves of quadrangles (n, 4, 3), cut along the diagonal that is inside."""
    a, b = corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]
    with np.errstate(invalid="ignore"):
        same = np.einsum("ki,ki->k", face_normals(a), face_normals(b)) >= 0.0
    first = np.where(same[:, None, None], a, corners[:, [0, 1, 3]])
    second = np.where(same[:, None, None], b, corners[:, [1, 2, 3]])
    return np.concatenate([first, second])


def _put_normals(
    reading: Reading,
    given: Normals,
    place: Place,
    targets: Targets,
    by_name: dict[str, FloatArray],
    clearance: float,
    normals: FloatArray,
) -> None:
    """Write the normals that an entry gives, internal axes."""
    if given.direction is not None:
        direction = np.array(given.direction)
        chosen = targets_named(given.points, targets, place, "points", reading.problems)
        _put(normals, chosen, np.broadcast_to(direction, (len(chosen), 3)), reading, place, targets)
    elif given.surface is not None:
        if given.surface not in by_name:
            words = f"no surface is called {given.surface!r}{nearest(given.surface, by_name)}"
            reading.problems.append(place.problem(words, "surface"))
            return
        chosen = targets_named(given.points, targets, place, "points", reading.problems)
        some = _inside(reading, by_name[given.surface])
        faces = faces_of(targets.positions[chosen], some, clearance)
        for k in chosen[faces < 0].tolist():
            words = f"point {targets.names[k]!r} is not on surface {given.surface!r}, within the clearance"
            reading.problems.append(place.problem(words))
        normals[chosen[faces >= 0]] = some.normals[faces[faces >= 0]]
    else:
        _read_normals(reading, given, place, targets, normals)


def _read_normals(
    reading: Reading, given: Normals, place: Place, targets: Targets, normals: FloatArray
) -> None:
    columns = [Column("id", required=True), *(_number(name) for name in ("nx", "ny", "nz"))]
    rows = read_table(given, columns, place, reading.problems)
    if rows is None:
        return
    names = rows.text("id")
    for name, line in zip(names, rows.lines.tolist(), strict=True):
        if name not in targets.numbers:
            words = f"point {name!r} does not exist{nearest(name, targets.names)}"
            reading.problems.append(Problem(words, rows.file, line))
    there = np.array([name in targets.numbers for name in names], dtype=bool)
    chosen = np.array([targets.numbers[name] for name in names if name in targets.numbers], dtype=np.int64)
    values = np.stack([rows.number(name) for name in ("nx", "ny", "nz")], axis=1)[there]
    _put(normals, chosen, values, reading, place, targets)


def _number(name: str) -> Column:
    return Column(name, parse=lambda text, unit: float(text), factor=lambda unit: 1.0, required=True)


def _put(
    normals: FloatArray,
    chosen: IntArray,
    values: FloatArray,
    reading: Reading,
    place: Place,
    targets: Targets,
) -> None:
    """Write normals (k, 3) of any length, axes of the project; on the earth east, north, up of their points."""
    length = np.linalg.norm(values, axis=1)
    if not ((length > 0.0) & np.isfinite(length)).all():
        reading.problems.append(place.problem("a normal is 0 or no number, expected a direction"))
        return
    axes = local_axes(reading, targets.positions[chosen])
    normals[chosen] = np.einsum("nij,ni->nj", axes, values / length[:, None])
