"""An image block as a COLMAP model: cameras, images and points3D, as text or binary."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted
from mor.formats.colmap.model import MODELS, ColmapCamera, camera_from, theirs
from mor.formats.content import Content, ContentTable, block, content_of, frames, not_carried, placed_points
from mor.formats.draft import Written
from mor.model.rotations import rotation_from_angles
from mor.project.document import Document
from mor.types import FloatArray


class SparseModel:
    """Cameras, images and points to be written, by their COLMAP numbers."""

    def __init__(self, content: Content):
        self.images = frames(content, "a COLMAP model")
        self.problems: list[Message] = []
        self.cameras = _cameras(content, self.problems)
        numbers = {name: camera.id for name, camera in self.cameras.items()}
        self.camera_of = [numbers.get(name, 0) for name in self.images.texts["camera"]]
        self.poses = _poses(content, self.images, self.problems)
        if self.problems:
            raise InputError(self.problems)
        found = block(content, "a COLMAP model", self.images)
        self.points, self.left_out = placed_points(content, found.points, "points3D")
        self.rays = found.rays
        self.point_numbers = numbered(self.points.ids)
        self.of_image = _grouped(self.rays.images, self.images.ids)
        self.point_of_ray = np.array([self.point_numbers.get(name, -1) for name in self.rays.points], dtype=np.int64)


def write_colmap(document: Document, folder: Path, target: Path) -> Written:
    """Text files in the folder ``target``. Raises :class:`InputError` for what COLMAP cannot say."""
    content = content_of(document, folder)
    model = SparseModel(content)
    lines = []
    for k, name in enumerate(model.images.ids):
        lines.append(f"{k + 1} {_words(model.poses[k])} {model.camera_of[k]} {name}\n")
        rays = (f"{_words(model.rays.xy[row])} {model.point_of_ray[row]}" for row in model.of_image[k])
        lines.append(" ".join(rays) + "\n")
    files = {
        "cameras.txt": "".join(camera_line(camera) for camera in model.cameras.values()),
        "images.txt": "".join(lines),
        "points3D.txt": "".join(_point_lines(model)),
    }
    return _written({target / name: text.encode() for name, text in files.items()}, content, model, target)


def write_colmap_binary(document: Document, folder: Path, target: Path) -> Written:
    """Binary files in the folder ``target``. Raises :class:`InputError` for what COLMAP cannot say."""
    content = content_of(document, folder)
    model = SparseModel(content)
    cameras = [_camera_bytes(camera) for camera in model.cameras.values()]
    form = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
    parts = []
    for k, name in enumerate(model.images.ids):
        rows = model.of_image[k]
        rays = np.empty(len(rows), dtype=form)
        rays["xy"], rays["point"] = model.rays.xy[rows], model.point_of_ray[rows]
        head = struct.pack("<I7dI", k + 1, *model.poses[k], model.camera_of[k])
        parts.append(head + name.encode() + b"\0" + struct.pack("<Q", len(rows)) + rays.tobytes())
    files = {"cameras.bin": cameras, "images.bin": parts, "points3D.bin": _point_bytes(model)}
    packed = {target / name: struct.pack("<Q", len(parts)) + b"".join(parts) for name, parts in files.items()}
    return _written(packed, content, model, target)


def _written(files: dict[Path, bytes], content: Content, model: SparseModel, target: Path) -> Written:
    notes = [*model.left_out, *not_carried(content, ("image",), ("pairs",), "a COLMAP model")]
    if content.project.pairs:
        notes.append(Message("stereo pairs are written as single images with their poses", str(target)))
    statuses = model.points.statuses
    if np.isfinite(statuses.sigma).any() or not statuses.free.all():
        notes.append(Message("COLMAP cannot store which points are fixed or observed, nor their σ", str(target)))
    alone = int(np.count_nonzero(model.point_of_ray < 0))
    if alone:
        words = f"{counted(alone, 'image point')} of points without coordinates: written without a point"
        notes.append(Message(words, content.document.file))
    if not np.all(model.rays.sigma == 1.0):
        notes.append(Message("COLMAP cannot store σ of image points", str(target)))
    if list(model.point_numbers) != [str(number) for number in model.point_numbers.values()]:
        names = pl.DataFrame({"point3D": list(model.point_numbers.values()), "name": list(model.point_numbers)})
        files[target / "point_names.csv"] = names.write_csv().encode()
        notes.append(Message("points are numbered; point_names.csv has their names", str(target)))
    return Written(files, notes)


def _cameras(content: Content, problems: list[Message]) -> dict[str, ColmapCamera]:
    numbers = numbered(list(content.project.cameras))
    result = {}
    for name, camera in content.project.cameras.items():
        try:
            result[name] = camera_from(numbers[name], camera, content.edge)
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
    return result


def numbered(names: Sequence[str]) -> dict[str, int]:
    """A number for each name: the name itself where all are different numbers from 1, or else from 1 on."""
    plain = [
        name for name in names if name.isascii() and name.isdecimal() and name == str(int(name)) and len(name) < 10
    ]
    if len(plain) == len(names) and "0" not in names:
        return {name: int(name) for name in names}
    return {name: k for k, name in enumerate(names, start=1)}


def _poses(content: Content, found: ContentTable, problems: list[Message]) -> FloatArray:
    """(n, 7) quaternion and translation of every image; followers get theirs from their leader."""
    values = found.values
    D = rotation_from_angles(values[:, 3:])
    centre = values[:, :3]
    for row in np.flatnonzero(np.isnan(values).any(axis=1)).tolist():
        name = found.ids[row]
        words = f"image {name!r} has no pose of its own; convert an adjusted project (adjusted.yaml)"
        problems.append(Message(words, content.document.file))
    return np.zeros((len(found), 7)) if problems else theirs(D, centre)


def _grouped(names: Sequence[str], of: Sequence[str]) -> list[list[int]]:
    """Rows of each of the things ``of``."""
    at = {name: k for k, name in enumerate(of)}
    result: list[list[int]] = [[] for _ in of]
    for row, name in enumerate(names):
        result[at[name]].append(row)
    return result


def _tracks(model: SparseModel) -> dict[int, list[tuple[int, int]]]:
    tracks: dict[int, list[tuple[int, int]]] = {number: [] for number in model.point_numbers.values()}
    for image, rows in enumerate(model.of_image, start=1):
        for place, row in enumerate(rows):
            number = int(model.point_of_ray[row])
            if number >= 0:
                tracks[number].append((image, place))
    return tracks


def _words(numbers: Sequence[float] | FloatArray) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def camera_line(camera: ColmapCamera) -> str:
    """A line of ``cameras.txt``."""
    return f"{camera.id} {camera.model} {camera.width} {camera.height} {_words(camera.parameters)}\n"


def _point_lines(model: SparseModel) -> list[str]:
    tracks = _tracks(model)
    return [
        f"{number} {_words(xyz)} 0 0 0 -1 {' '.join(f'{i} {p}' for i, p in tracks[number])}\n"
        for number, xyz in zip(model.point_numbers.values(), model.points.values, strict=True)
    ]


def _camera_bytes(camera: ColmapCamera) -> bytes:
    head = struct.pack("<IiQQ", camera.id, MODELS[camera.model].number, camera.width, camera.height)
    return head + struct.pack(f"<{len(camera.parameters)}d", *camera.parameters)


def _point_bytes(model: SparseModel) -> list[bytes]:
    tracks = _tracks(model)
    parts = []
    for number, xyz in zip(model.point_numbers.values(), model.points.values, strict=True):
        head = struct.pack("<Q3d3BdQ", number, *xyz, 0, 0, 0, -1.0, len(tracks[number]))
        parts.append(head + b"".join(struct.pack("<II", *element) for element in tracks[number]))
    return parts
