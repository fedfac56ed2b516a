"""A COLMAP model as a project: an image block with the datum of its points, σ = 1 px."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import polars as pl

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.colmap import binary, text_files
from mor.formats.colmap.cameras import LOST, MODELS, camera_of, has_one_unknown_more
from mor.formats.colmap.model import NO_POINT, ColmapImage, ColmapModel
from mor.formats.colmap.poses import ours
from mor.formats.colmap.rigs import Follower, followers
from mor.formats.draft import Draft, Row, usable
from mor.geometry.rotations import angles_from_rotation
from mor.project.file.nodes import Document

_PARTS = ("cameras", "images", "points3D")


def read_colmap(path: Path) -> Document:
    """The project of a folder with a model, or of one of its files. Raises :class:`InputError` with every mistake."""
    draft = Draft(str(path))
    folder = path if path.is_dir() else path.parent
    model = read_model(folder, draft)
    _check(model, draft)
    if draft.problems:
        return draft.finish()
    draft.put("title", folder.resolve().name)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    draft.put("cameras", {str(camera.id): camera_of(camera) for camera in model.cameras})
    _put_images(model, draft)
    _put_points(model, draft)
    _put_image_points(model, draft)
    draft.put("datum", "free")
    looser = [str(camera.id) for camera in model.cameras if has_one_unknown_more(camera.model)]
    if looser:
        words = "fx and fy are two unknowns, one focal length in COLMAP"
        draft.note(f"cameras {', '.join(looser[:10])}: {words}")
    draft.note(
        "σ = 1 px for all image points, principal points fixed, all else free; lengths are called m, "
        "whatever the model's unit is; colours, errors and tracks of the points are not read"
    )
    return draft.finish()


def read_model(folder: Path, draft: Draft) -> ColmapModel:
    """The files of a folder; binary ones where both are there. Raises :class:`InputError` if one is missing."""
    end = ".bin" if (folder / "cameras.bin").is_file() else ".txt"
    missing = [f"{name}{end}" for name in _PARTS if not (folder / f"{name}{end}").is_file()]
    if missing:
        words = (
            f"this folder has no {', '.join(missing)}; a COLMAP model has {', '.join(_PARTS)} as .bin or .txt"
        )
        raise InputError([Problem(words, str(folder))])
    paths = {name: folder / f"{name}{end}" for name in (*_PARTS, "rigs", "frames")}
    has_rigs = paths["rigs"].is_file() and paths["frames"].is_file()
    if end == ".bin":
        return ColmapModel(
            binary.read_cameras(paths["cameras"]),
            binary.read_images(paths["images"]),
            *binary.read_points(paths["points3D"]),
            binary.read_rigs(paths["rigs"]) if has_rigs else [],
            binary.read_frames(paths["frames"]) if has_rigs else [],
        )
    return ColmapModel(
        text_files.read_cameras(paths["cameras"], draft),
        text_files.read_images(paths["images"], draft),
        *text_files.read_points(paths["points3D"], draft),
        text_files.read_rigs(paths["rigs"], draft) if has_rigs else [],
        text_files.read_frames(paths["frames"], draft) if has_rigs else [],
    )


def _check(model: ColmapModel, draft: Draft) -> None:
    """Everything that is referred to is there once, and every number is one."""
    for what, found in (
        ("camera", [camera.id for camera in model.cameras]),
        ("image", [image.name for image in model.images]),
        ("point", model.point_ids.tolist()),
    ):
        for name in [name for name, times in Counter(found).items() if times > 1][:10]:
            draft.problem(f"{what} {name!r} is there twice")
    cameras = {camera.id for camera in model.cameras}
    for camera in model.cameras:
        if not MODELS[camera.model].ours:
            words = (
                f"camera {camera.id}: model {camera.model} has no counterpart in mor: {LOST[camera.model]}"
            )
            draft.problem(words, camera.line)
        if not usable(camera.parameters) or not 0 < min(camera.width, camera.height) < 1 << 31:
            draft.problem(f"camera {camera.id}: its size or a parameter is no usable number", camera.line)
        elif abs(camera.parameters[0]) < 1e-9 or abs(camera.parameters[0]) > 1e12:
            words = f"camera {camera.id}: found the focal length {camera.parameters[0]:g}, expected px"
            draft.problem(words, camera.line)
    if not usable(model.point_xyz):
        draft.problem("a coordinate of a point is no number up to 1e30")
    for image in model.images:
        words = _wrong(image, cameras)
        if words:
            draft.problem(f"image {image.name!r}: {words}", image.line)
    _check_rays(model, draft)


def _wrong(image: ColmapImage, cameras: set[int]) -> str:
    if not image.name.strip():
        return f"image {image.id} has no name"
    if image.camera not in cameras:
        return f"camera {image.camera} is not among the cameras"
    numbers = [*image.pose.quaternion, *image.pose.translation]
    if not usable(numbers) or np.linalg.norm(image.pose.quaternion) < 1e-6:
        return "its pose is no pose: found a number beyond 1e30, or no rotation"
    if not usable(image.xy):
        return "an image coordinate is no number up to 1e30"
    return ""


def _check_rays(model: ColmapModel, draft: Draft) -> None:
    """All image points at once: looking the points up image by image sorts them as often as there are images."""
    counts = np.array([len(image.points) for image in model.images], dtype=np.int64)
    points = np.concatenate([np.empty(0, dtype=np.int64), *(image.points for image in model.images)])
    lost = np.flatnonzero((points != NO_POINT) & ~np.isin(points, model.point_ids))
    owners = np.repeat(np.arange(len(counts)), counts)[lost]
    for owner, first in list(zip(*np.unique(owners, return_index=True), strict=True))[:10]:
        name = model.images[owner].name
        draft.problem(f"image {name!r}: point {points[lost[first]]} is not among the points")


def _put_images(model: ColmapModel, draft: Draft) -> None:
    pairs, follows = followers(model, draft)
    rows = [_image_row(image, follows.get(image.id)) for image in model.images]
    columns = ("id", "camera", "x", "y", "z", "omega", "phi", "kappa", "leader", "pair")
    if pairs:
        draft.table("pairs", ("id", "bx", "by", "bz", "omega", "phi", "kappa"), pairs)
    if rows:
        draft.table("images", columns, rows)


def _image_row(image: ColmapImage, follower: Follower | None) -> Row:
    if follower is not None:
        return Row([image.name, str(image.camera), *[None] * 6, follower.leader, follower.pair], image.line)
    D, centre = ours(image.pose)
    numbers = [*centre, *angles_from_rotation(D)]
    return Row([image.name, str(image.camera), *(repr(float(v)) for v in numbers), None, None], image.line)


def _put_points(model: ColmapModel, draft: Draft) -> None:
    if len(model.point_ids):
        ids = pl.Series("id", model.point_ids).cast(pl.String)
        frame = pl.DataFrame({"id": ids, **dict(zip("xyz", model.point_xyz.T, strict=True))})
        draft.frame("points", "points3D", frame)


def _put_image_points(model: ColmapModel, draft: Draft) -> None:
    kept = [image.points != NO_POINT for image in model.images]
    free = sum(int((~mask).sum()) for mask in kept)
    if free:
        draft.note(f"{counted(free, 'image point')} of no object point not read")
    if not sum(int(mask.sum()) for mask in kept):
        draft.problem("there are no image points that belong to an object point")
        return
    names = pl.Series([image.name for image in model.images], dtype=pl.String)
    counts = [int(mask.sum()) for mask in kept]
    rays = zip(model.images, kept, strict=True)
    xy, points = (
        np.concatenate(parts)
        for parts in zip(*((image.xy[mask], image.points[mask]) for image, mask in rays), strict=True)
    )
    frame = pl.DataFrame(
        {
            "image": names.gather(np.repeat(np.arange(len(counts)), counts)),
            "point": pl.Series(points).cast(pl.String),
            "x": xy[:, 0],
            "y": xy[:, 1],
        }
    )
    draft.frame("observations", "images", frame, type="image", units="px", values={"sigma": "1"})
