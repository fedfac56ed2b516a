"""Visibility of planned observations: surfaces, viewpoints, targets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted, nearest
from mor.model.cameras import CAMERA_MODELS, CameraModel
from mor.model.contract import ObservationType
from mor.model.images import IMAGE_TYPES
from mor.model.parameters import INTERIORS
from mor.model.polygons import Triangles, face_normals, faces_of, hidden, triangles, triangulated
from mor.model.rotations import rotation_from_angles
from mor.plan.mesh_files import Mesh, read_mesh
from mor.plan.requirements import REASONS, Sighted, chosen_names
from mor.project.axes import ImageScale, UnitError, split
from mor.project.document import Document
from mor.project.entities import Reading
from mor.project.network import read_things
from mor.project.planned_network import with_poses_of
from mor.project.rows import group_name
from mor.project.schema import Normals, Observations, Surface, validate
from mor.project.tables import Column, TableLocation, read_table
from mor.types import BoolArray, FloatArray, IntArray
from mor.units import ANGLE, IMAGE, LENGTH, Quantity

# ---- Which way is up, and where coordinates lie: everywhere the same, or on the earth that of the place.


def local_axes(reading: Reading, positions: FloatArray) -> FloatArray:
    """(n, 3, 3) rows x, y, up at places (n, 3), internal axes; on the earth east, north, up."""
    if reading.world is None:
        return np.broadcast_to(reading.edge.matrix.T, (len(positions), 3, 3))
    return reading.world.horizon.local_axes(positions)


def upwards(reading: Reading, positions: FloatArray) -> FloatArray:
    """(n, 3) upward directions at places (n, 3), internal axes."""
    if reading.world is None:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), positions.shape)
    return reading.world.horizon.local_axes(positions)[:, 2]


def placed(reading: Reading, coordinates: FloatArray) -> FloatArray:
    """Coordinates (n, 3) as a project gives them, in its axes; on the earth from those of its reference system.

    Raises ``ValueError`` where these say no place.
    """
    world = reading.world
    if world is None:
        return coordinates
    geographic = "on the earth a surface has its corners in a projection or geocentric, or by names of points"
    if world.system.kind == "geographic":
        raise ValueError(geographic)
    N = np.zeros(len(coordinates))
    if world.orthometric:
        N = world.geoid_at(np.full(len(coordinates), -1), world.to_object(coordinates, N))
        if np.isnan(N).any():
            raise ValueError("corners above the geoid need its grid (world: {geoid: FILE}), or names of points")
    return np.asarray(world.to_object(coordinates, N) @ reading.edge.matrix)


# ---- Names of a plan: which targets, images, stations and points patterns stand for, and where these are.


class Targets(NamedTuple):
    """The points of a project."""

    names: tuple[str, ...]
    numbers: Mapping[str, int]
    blocks: IntArray
    """(n,) their blocks."""
    positions: FloatArray
    """(n, 3) where they are, internal axes; NaN if they are nowhere yet."""
    groups: Mapping[str, list[int]]
    """Blocks of the groups of points."""


def targets_named(
    patterns: Sequence[str], targets: Targets, place: TableLocation, key: str, problems: list[Message]
) -> IntArray:
    """Numbers of the points that names, groups and patterns stand for, each once."""
    grouped = [p for p in patterns if p in targets.groups and p not in targets.numbers]
    plain = [p for p in patterns if p not in grouped]
    found = set(named(plain, targets.names, "point", place, key, problems))
    blocks = [block for name in grouped for block in targets.groups[name]]
    found.update(np.flatnonzero(np.isin(targets.blocks, blocks)).tolist())
    return np.array(sorted(found), dtype=np.int64)


def named(
    patterns: Sequence[str], names: Sequence[str], what: str, place: TableLocation, key: str, problems: list[Message]
) -> list[int]:
    """Numbers of the names that patterns stand for; one that stands for nothing is a mistake at its place."""
    wrong: list[Message] = []
    found = chosen_names(patterns, names, what, "", wrong)
    problems += [place.problem(f"{key}: {one.message}") for one in wrong]
    return found


# ---- What stands in the way of sights, and where targets look, as a project says it: internal axes, its length unit.


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
        place.tell(f"clearance: {error}", "clearance")
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


def _corners(reading: Reading, surface: Surface, place: TableLocation, targets: Targets) -> FloatArray:
    """(m, 3, 3) corners of the triangles of a surface, axes of the project."""
    try:
        if surface.file is not None:
            mesh = read_mesh(reading.place.folder / Path(surface.file))
            factor = reading.edge.factor(LENGTH, surface.unit or "")
            return _triangles_of(Mesh(placed(reading, mesh.vertices * factor), mesh.faces))
        corners = np.array([_corner(reading, at, targets) for at in surface.polygon or []])
        return np.asarray(corners[triangulated(corners)])
    except InputError as error:
        reading.problems.extend(one if one.line else place.problem(one.message) for one in error.problems)
    except ValueError as error:  # of units, too
        place.tell(f"this surface: {error}")
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
    place: TableLocation,
    targets: Targets,
    by_name: dict[str, FloatArray],
    clearance: float,
    normals: FloatArray,
) -> None:
    if given.direction is not None:
        direction = np.array(given.direction)
        chosen = targets_named(given.points, targets, place, "points", reading.problems)
        _put(normals, chosen, np.broadcast_to(direction, (len(chosen), 3)), reading, place, targets)
    elif given.surface is not None:
        if given.surface not in by_name:
            place.tell(f"there is no surface {given.surface!r}{nearest(given.surface, by_name)}", "surface")
            return
        chosen = targets_named(given.points, targets, place, "points", reading.problems)
        some = _inside(reading, by_name[given.surface])
        faces = faces_of(targets.positions[chosen], some, clearance)
        for k in chosen[faces < 0].tolist():
            place.tell(f"point {targets.names[k]!r} is not on surface {given.surface!r}, within the clearance")
        normals[chosen[faces >= 0]] = some.normals[faces[faces >= 0]]
    else:
        _read_normals(reading, given, place, targets, normals)


def _read_normals(
    reading: Reading, given: Normals, place: TableLocation, targets: Targets, normals: FloatArray
) -> None:
    columns = [
        Column("id", required=True),
        *(
            Column(name, parse=lambda text, unit: float(text), factor=lambda unit: 1.0, required=True)
            for name in ("nx", "ny", "nz")
        ),
    ]
    rows = read_table(given, columns, place)
    if rows is None:
        return
    names = rows.text("id")
    for name, line in zip(names, rows.lines.tolist(), strict=True):
        if name not in targets.numbers:
            words = f"point {name!r} does not exist{nearest(name, targets.names)}"
            reading.problems.append(Message(words, rows.file, line))
    there = np.array([name in targets.numbers for name in names], dtype=bool)
    chosen = np.array([targets.numbers[name] for name in names if name in targets.numbers], dtype=np.int64)
    values = np.stack([rows.number(name) for name in ("nx", "ny", "nz")], axis=1)[there]
    _put(normals, chosen, values, reading, place, targets)


def _put(
    normals: FloatArray, chosen: IntArray, values: FloatArray, reading: Reading, place: TableLocation, targets: Targets
) -> None:
    """Write normals (k, 3) of any length, axes of the project; on the earth east, north, up of their points."""
    length = np.linalg.norm(values, axis=1)
    if not ((length > 0.0) & np.isfinite(length)).all():
        place.tell("a normal is 0 or not a number, expected a direction")
        return
    axes = local_axes(reading, targets.positions[chosen])
    normals[chosen] = np.einsum("nij,ni->nj", axes, values / length[:, None])


# ---- Which targets are seen from where, and why others are not.


class Limits(NamedTuple):
    """Limits of sights, internal units."""

    nearest: float = 0.0
    farthest: float = np.inf
    incidence: float = 0.5 * np.pi
    steepest: float = 0.5 * np.pi


def outcomes(
    origin: FloatArray,
    up: FloatArray,
    targets: FloatArray,
    normals: FloatArray,
    limits: Limits,
    around: Surroundings,
    shows: Callable[[FloatArray], BoolArray] | None,
) -> IntArray:
    """(n,) what becomes of the sights from one place (3,) to targets (n, 3), as a number of ``REASONS``.

    ``up`` (3,) is upwards there. ``normals`` (n, 3) are NaN if a target has none; ``shows`` says what is on the
    format of an image.
    """
    step = targets - origin
    length = np.linalg.norm(step, axis=1)
    found = np.zeros(len(targets), dtype=np.int64)
    found[~((length > 0.0) & (length >= limits.nearest) & (length <= limits.farthest))] = 1
    left = np.flatnonzero(found == 0)
    direction = step[left] / length[left, None]
    framed = shows(targets[left]) if shows else np.abs(direction @ up) <= np.sin(limits.steepest)
    slant = -np.einsum("ki,ki->k", direction, normals[left])
    away = np.isfinite(slant) & ((slant < np.cos(limits.incidence)) | (slant <= 0.0))
    found[left[away]] = 3
    found[left[~framed]] = 2
    left = np.flatnonzero(found == 0)
    origins = np.broadcast_to(origin, (len(left), 3))
    found[left[hidden(origins, targets[left], around.obstacles, around.clearance)]] = 4
    return found


# ---- Where sights begin, and what an image has on its format.


class Start:
    """Start values of a project that is being read: what is where, internal axes."""

    def __init__(self, reading: Reading) -> None:
        given: dict[str, FloatArray] = {}
        for kind, store in reading.shop.stores.items():
            found = store.start_values(store.all_values())
            given[kind] = rotation_from_angles(found) if store.kind.is_rotation else found
        self.values = with_poses_of(reading.shop.things["image"], reading, given)

    def of(self, kind: str, block: int) -> FloatArray:
        """Values of one block."""
        return np.asarray(self.values[kind][block], dtype=np.float64)


class PlannedImage(NamedTuple):
    """An image: X* = D (X − X0) + r, followed by X* → D* (X* − b*) in a follower."""

    centre: FloatArray
    """(3,) projection centre."""
    D: FloatArray
    """(3, 3) rotation into the axes of the image."""
    model: CameraModel
    interior: FloatArray
    """(k,) interior orientation."""
    constants: FloatArray
    """(q,) constants of the model."""
    low: FloatArray
    """(2,) lower left corner of the format, camera unit."""
    high: FloatArray

    def shows(self, X: FloatArray, border: float) -> BoolArray:
        """(n,) true where points (n, 3) are on the format, ``border`` from its edges.

        Distortion can bring back what is far outside: between the axis and the point the image has to move outwards
        all the way.
        """
        star = (X - self.centre) @ self.D.T
        front = np.full(len(X), self.model.sees_behind) | (star[:, 2] < 0.0)
        seen = np.zeros(len(X), dtype=bool)
        k = np.flatnonzero(front)
        with np.errstate(all="ignore"):
            xy = self._image(star[k])
            inside = np.all((xy >= self.low + border) & (xy <= self.high - border), axis=1)
            k = k[np.asarray(inside)]
            seen[k] = self._outwards(star[k])
        return seen

    def _image(self, star: FloatArray) -> FloatArray:
        """(n, 2) image coordinates of points in the axes of the image; NaN if there are none."""
        interior = np.broadcast_to(self.interior, (len(star), len(self.interior)))
        constants = np.broadcast_to(self.constants, (len(star), len(self.constants)))
        measured = np.zeros((len(star), 2))
        found = self.model.project(star, interior, constants, measured).xy
        if not self.model.corrects_measured:
            return found
        # Steps in which the measured coordinates of models that correct these come to rest.
        for _ in range(60):
            measured, found = found, self.model.project(star, interior, constants, found).xy
            moved = np.abs(found - measured)
            if not (moved > 0.0).any():
                break
        # Part of the format by which they may still move then.
        settled = np.all(moved <= 1e-9 * (self.high - self.low), axis=1)
        return np.where(np.asarray(settled)[:, None], found, np.nan)

    def _outwards(self, star: FloatArray) -> BoolArray:
        aside = np.linalg.norm(star[:, :2], axis=1)
        across = star[:, :2] / np.maximum(aside, 1e-300)[:, None]
        whole = np.arctan2(aside, -star[:, 2])
        good = np.ones(len(star), dtype=bool)
        far = np.linalg.norm(star, axis=1)[:, None]
        middle = self._image(far * np.array([0.0, 0.0, -1.0]))
        before = np.zeros(len(star))
        # Directions between the axis of a camera and a sight at which the image has to move outwards.
        on_the_way = 16
        for step in range(1, on_the_way + 1):
            angle = whole * step / on_the_way
            direction = np.concatenate([np.sin(angle)[:, None] * across, -np.cos(angle)[:, None]], axis=1)
            radius = np.linalg.norm(self._image(far * direction) - middle, axis=1)
            good &= (radius > before) | (aside == 0.0)
            before = radius
        return good


def image(reading: Reading, start: Start, number: int) -> PlannedImage:
    """An image of the project; NaN if it has no place."""
    part = {name: int(blocks[number]) for name, blocks in reading.shop.things["image"].parts.items()}
    name = reading.shop.things["camera"].ids[part["camera"]]
    camera, scale = reading.project.cameras[name], reading.scales[name]
    model = CAMERA_MODELS[camera.model]
    D = start.of("rotation", part["rotation"])
    r = start.of("eccentricity", part["eccentricity"])
    centre = start.of("point", part["position"]).copy()
    centre[2] += start.of("height", part["height"])[0]
    if part["relative rotation"] >= 0:
        centre += D.T @ (start.of("base", part["base"]) - r)
        D = start.of("rotation", part["relative rotation"]) @ D
    else:
        centre -= D.T @ r
    r0 = reading.edge.number(camera.r0 or "0", IMAGE, "", scale)
    no_format = np.full(2, np.nan), np.full(2, np.nan)
    low, high = image_format(scale, camera.image.width, camera.image.height) if camera.image else no_format
    interior = start.of(INTERIORS[camera.model].key, part["interior"])
    return PlannedImage(centre, D, model, interior, np.full(len(model.constants), r0), low, high)


def image_format(scale: ImageScale, width: str, height: str) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner (2,) of a format in the coordinates inside, camera unit."""
    pixel = scale.pixel if np.isfinite(scale.pixel) else 1.0
    size = np.array([split(width)[0], split(height)[0]]) * pixel
    if scale.corner and scale.centre == (0.0, 0.0):  # origin inside: the upper left corner itself
        return np.array([0.0, -size[1]]), np.array([size[0], 0.0])
    return -0.5 * size, 0.5 * size


def instruments(reading: Reading, start: Start, space: str, numbers: IntArray, height: float) -> FloatArray:
    """(k, 3) where sights of stations begin, or those of systems, or of points at a ``height`` above them."""
    parts = reading.shop.things[space].parts
    found = start.values["point"][parts["position"][numbers]].copy()
    if space == "station":
        return np.asarray(found + start.values["height"][parts["height"][numbers]] * upwards(reading, found))
    return np.asarray(found + height * upwards(reading, found)) if space == "point" else found


# ---- A project whose planned observations say what is visible, with the rows of all that is.


def sights(reading: Reading) -> dict[str, ObservationType]:
    """Types of observations that are made along a line of sight between two places."""
    # Types of the earth that somebody has reduced: no sight leads along them.
    between_feet = ("ellipsoid_arc", "ellipsoid_chord", "mean_sea_level_distance")
    return {
        key: type_
        for key, type_ in {**reading.types, "image": IMAGE_TYPES["mor"]}.items()
        if len(type_.references) == 2 and not type_.between_marks and key not in between_feet
    }


def with_visible(document: Document, folder: Path) -> tuple[Document, tuple[Sighted, ...]]:
    """Replace every ``visible`` of the document by rows, and return what each sees. Raises :class:`InputError`.

    Where the things of the project cannot be read it comes back as it is: whoever reads it tells all mistakes.
    """
    project = validate(document)
    sections = ("observations", "candidates")
    wanted = [
        (section, number, entry)
        for section in sections
        for number, entry in enumerate(getattr(project, section))
        if entry.visible is not None
    ]
    if not wanted:
        return document, ()
    reading = read_things(project, document, folder, planned=True)
    if reading.problems:
        return document, ()
    start = Start(reading)
    # The points of a project, of which all blocks are at ``positions`` (blocks, 3).
    positions = start.values["point"]
    points = reading.shop.things["point"]
    blocks = points.parts["position"]
    targets = Targets(tuple(points.ids), points.numbers, blocks, positions[blocks], reading.groups)
    around = surroundings(reading, targets)
    data: dict[str, Any] = {**document.data, **{s: list(document.data.get(s) or []) for s in sections}}
    frames, sighted = dict(document.frames), []
    for section, number, entry in wanted:
        scene = VisibilityScene(reading, start, targets, around, reading.at(section, number))
        found = _seen(scene, entry, section, number)
        if found is None:
            continue
        frame, told = found
        sighted.append(told)
        label = f"what is visible ({section} {number + 1})"
        frames[label] = frame
        given = {key: value for key, value in data[section][number].items() if key != "visible"}
        data[section][number] = {**given, "name": told.name, "file": label}
    if reading.problems:
        raise InputError(reading.problems)
    return replace(document, data=data, frames=frames), tuple(sighted)


class VisibilityScene(NamedTuple):
    """Data from which the sights of an entry are computed."""

    reading: Reading
    start: Start
    targets: Targets
    around: Surroundings
    place: TableLocation

    def mistake(self, words: str) -> None:
        """Tell a mistake of the entry."""
        self.place.tell(f"visible: {words}", "visible")


class Viewpoint(NamedTuple):
    """Origin of sights."""

    name: str
    origin: FloatArray
    point: int
    """Block of the point it is on, which it does not sight; −1 for none."""
    up: FloatArray
    """(3,) upwards there."""
    image: PlannedImage | None = None
    border: float = 0.0
    """Margin of the format, unit of the camera."""


def _seen(
    scene: VisibilityScene, entry: Observations, section: str, number: int
) -> tuple[pl.DataFrame, Sighted] | None:
    """Rows of everything that an entry sees; ``None`` if there are mistakes."""
    known = sights(scene.reading)
    type_ = known.get(entry.type)
    wanted, before = entry.visible, len(scene.reading.problems)
    assert wanted is not None
    if type_ is None:
        scene.mistake(f"{entry.type} has no line of sight between two places (those that do: {', '.join(known)})")
        return None
    viewpoints = _viewpoints(scene, entry, type_)
    chosen = targets_named(wanted.to, scene.targets, scene.place, "visible: to", scene.reading.problems)
    limits = _limits(scene, entry, type_)
    height = _height(scene, entry, "to_height")
    nowhere = [scene.targets.names[k] for k in chosen if not np.isfinite(scene.targets.positions[k]).all()]
    nowhere += [one.name for one in viewpoints if not np.isfinite(one.origin).all()]
    no_place = "no coordinates; what is seen depends on where it is"
    for name in nowhere:
        scene.mistake(f"{name}: {no_place}")
    if len(scene.reading.problems) > before:
        return None
    from_, to, counts = _sights(scene, viewpoints, chosen, limits, height, _is_once(entry, type_))
    name = group_name(entry, number)
    if not len(from_):
        told = ", ".join(f"{c} {r}" for c, r in zip(counts, REASONS, strict=True) if c)
        scene.mistake(f"nothing is seen: of {counted(sum(counts), 'sight', 'sights')} {told or 'none'}")
        return None
    often = np.bincount(to, minlength=len(scene.targets.names))[chosen]
    names = [[scene.targets.names[k] for k in chosen[often == n]] for n in (0, 1)]
    frame = _frame(scene, type_, [one.name for one in viewpoints], from_, to)
    return frame, Sighted(name, section, counts, tuple(names[0]), tuple(names[1]))


def _sights(
    scene: VisibilityScene, viewpoints: Sequence[Viewpoint], chosen: IntArray, limits: Limits, height: float, once: bool
) -> tuple[IntArray, IntArray, tuple[int, ...]]:
    """Numbers of the viewpoints and of the targets of all sights that are seen, and counts of all by their reason.

    With ``once`` two points sight each other one way: from the one that stands first.
    """
    blocks = scene.targets.blocks
    given = scene.targets.positions
    positions = given + height * upwards(scene.reading, given)
    counts = np.zeros(len(REASONS), dtype=np.int64)
    from_, to = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    sighted = set(blocks[chosen].tolist())
    done: list[int] = []
    for number, one in enumerate(viewpoints):
        left = chosen[(blocks[chosen] != one.point)]
        if once and one.point in sighted:
            left = left[~np.isin(blocks[left], done)]
        if once:
            done.append(one.point)
        found = outcomes(
            one.origin,
            one.up,
            positions[left],
            scene.around.normals[left],
            limits,
            scene.around,
            partial(one.image.shows, border=one.border) if one.image else None,
        )
        counts += np.bincount(found, minlength=len(REASONS))
        to.append(left[found == 0])
        from_.append(np.full(len(to[-1]), number))
    return np.concatenate(from_), np.concatenate(to), tuple(counts.tolist())


def _frame(
    scene: VisibilityScene, type_: ObservationType, viewpoints: Sequence[str], from_: IntArray, to: IntArray
) -> pl.DataFrame:
    """Rows of a table of the type, with the set of a station where its name has one."""
    sets = scene.reading.sets
    first, second = (reference.name for reference in type_.references)
    columns = {
        first: pl.Series([sets.get(name, (name, ""))[0] for name in viewpoints], dtype=pl.String).gather(from_),
        second: pl.Series(list(scene.targets.names), dtype=pl.String).gather(to),
    }
    if first == "station" and any(name in sets for name in viewpoints):
        of_set = pl.Series([sets.get(name, (name, None))[1] for name in viewpoints], dtype=pl.String)
        columns["set"] = of_set.gather(from_)
    return pl.DataFrame(columns)


def _is_once(entry: Observations, type_: ObservationType) -> bool:
    assert entry.visible is not None
    return "point" in type_.references[0].among and not entry.visible.both_ways


def _viewpoints(scene: VisibilityScene, entry: Observations, type_: ObservationType) -> list[Viewpoint]:
    """Images, stations, systems or points that the patterns ``at`` stand for; of stations points as well."""
    reading, wanted = scene.reading, entry.visible
    assert wanted is not None
    space = type_.references[0].among[0]
    if space == "point":
        chosen = targets_named(wanted.at, scene.targets, scene.place, "visible: at", reading.problems)
        return _at(scene, "point", chosen.tolist(), _height(scene, entry, "from_height"))
    if wanted.both_ways:
        scene.mistake("both_ways is for sights between points")
    names = reading.shop.things[space].ids
    mistakes: list[Message] = []
    found = named(wanted.at, names, space, scene.place, "visible: at", mistakes)
    if space == "station" and mistakes:  # directions are observed on points, too, that are declared as no station
        others = [p for p in wanted.at if not named([p], names, space, scene.place, "", [])]
        points = targets_named(others, scene.targets, scene.place, "visible: at", reading.problems)
        return [*_at(scene, space, found), *_at(scene, "point", points.tolist())]
    reading.problems.extend(mistakes)
    if space != "image":
        return _at(scene, space, found)
    without = {reading.shop.things["camera"].ids[int(c)] for c in reading.shop.things["image"].parts["camera"][found]}
    for camera in sorted(name for name in without if reading.project.cameras[name].image is None):
        scene.mistake(f"camera {camera!r} has no format (image: {{width, height, pixel}})")
    for camera in sorted(without & reading.scanners.keys()):
        scene.mistake(f"camera {camera!r} is a line scanner: list the points that its images have")
    return [_from_image(scene, wanted.border, k) for k in found]


def _from_image(scene: VisibilityScene, border: str | None, number: int) -> Viewpoint:
    images = scene.reading.shop.things["image"]
    camera = scene.reading.shop.things["camera"].ids[int(images.parts["camera"][number])]
    found = image(scene.reading, scene.start, number)
    margin = _length(scene, "border", border or "0", IMAGE, scene.reading.scales[camera])
    up = upwards(scene.reading, found.centre[None])[0]
    return Viewpoint(images.ids[number], found.centre, -1, up, found, margin)


def _at(scene: VisibilityScene, space: str, numbers: Sequence[int], height: float = 0.0) -> list[Viewpoint]:
    things = scene.reading.shop.things[space]
    chosen = np.array(numbers, dtype=np.int64)
    origins = instruments(scene.reading, scene.start, space, chosen, height)
    blocks = things.parts["position"][chosen]
    return [
        Viewpoint(things.ids[k], origin, int(block), up)
        for k, origin, block, up in zip(numbers, origins, blocks, upwards(scene.reading, origins), strict=True)
    ]


def _height(scene: VisibilityScene, entry: Observations, key: str) -> float:
    try:
        return scene.reading.edge.number(entry.values.get(key, "0"), LENGTH)
    except UnitError:
        return 0.0  # told when the rows are read


def _limits(scene: VisibilityScene, entry: Observations, type_: ObservationType) -> Limits:
    wanted = entry.visible
    assert wanted is not None
    of_images = type_.references[0].among == ("image",)
    if wanted.border is not None and not of_images:
        scene.mistake("border is for images")
    if wanted.steepest is not None and of_images:
        scene.mistake("steepest is for instruments; an image has its format")
    given = {
        "nearest": (wanted.nearest, LENGTH),
        "farthest": (wanted.farthest, LENGTH),
        "incidence": (wanted.incidence, ANGLE),
        "steepest": (wanted.steepest, ANGLE),
    }
    return Limits(**{key: _length(scene, key, text, of) for key, (text, of) in given.items() if text is not None})


def _length(scene: VisibilityScene, key: str, text: str, quantity: Quantity, scale: ImageScale | None = None) -> float:
    """A length or an angle, 0 or more; anything else is a mistake."""
    try:
        found = scene.reading.edge.number(text, quantity, "", scale)
        if found < 0.0:
            raise UnitError(f"found {text}, expected 0 or more")
    except UnitError as error:
        scene.mistake(f"{key}: {error}")
        return 0.0
    return found
