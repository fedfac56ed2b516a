"""Bundler (``bundle.out``, version 0.3) and BAL (bundle adjustment in the large): blocks in text files.

Both have P = R X + t, p = −P/P_z, x = f (1 + k1 |p|² + k2 |p|⁴) p in px from the image centre, x right, y up: model
``mor`` with D = R, X0 = −Rᵀ t, c = f, A1 = k1/f², A2 = k2/f⁴. Every image has a camera of its own.
Sources: Snavely, *Bundler User's Manual*; Agarwal et al., *Bundle Adjustment in the Large*, ECCV 2010.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl

from mor.errors import InputError, Message
from mor.formats.content import (
    Content,
    block,
    content_of,
    frames,
    interior_values,
    not_carried,
    placed_points,
    rays_of_points,
)
from mor.formats.draft import LARGEST, Draft, Row, Written, usable
from mor.input_files import TABLE, decoded, read_bytes
from mor.model.rotations import angles_from_rotation, exponential, rotation_from_angles
from mor.project.axes import image_scale, split
from mor.project.document import Document
from mor.project.schema import Camera
from mor.types import FloatArray, IntArray


class BalBlock(NamedTuple):
    """A block: rotations (n, 3, 3), translations (n, 3), f k1 k2 (n, 3), points (m, 3), image points."""

    R: FloatArray
    t: FloatArray
    interior: FloatArray
    points: FloatArray
    image: IntArray
    point: IntArray
    xy: FloatArray


class _Numbers:
    """The numbers of a text, taken from its beginning to its end; mistakes have the line of the number."""

    def __init__(self, path: Path, comment: bool):
        self.file, self.text = str(path), decoded(read_bytes(path, TABLE))[0]
        if comment:
            self.text = "\n" + self.text.partition("\n")[2]
        words = self.text.split()
        try:
            self.values = np.array(words).astype(float) if words else np.zeros(0)
        except ValueError:
            self.values = np.zeros(0)
        if len(self.values) != len(words) or not usable(self.values):
            raise self.refuse(next(k for k, word in enumerate(words) if not _is_number(word)), "expected a number")
        self.at = 0

    def refuse(self, number: int, words: str) -> InputError:
        """Return the error for the number at this place."""
        seen = 0
        for line, text in enumerate(self.text.split("\n"), start=1):
            found = text.split()
            if seen + len(found) > number:
                return InputError([Message(f"found {found[number - seen]!r}, {words}", self.file, line)])
            seen += len(found)
        line = self.text.rstrip("\n").count("\n") + 1
        return InputError([Message(f"found the end of the file, {words}", self.file, line)])

    def take(self, count: int, what: str) -> FloatArray:
        if count > len(self.values) - self.at:
            raise self.refuse(len(self.values), f"expected {count} numbers: {what}")
        self.at += count
        return self.values[self.at - count : self.at]

    def count(self, what: str, least: int = 0) -> int:
        value = float(self.take(1, what)[0])
        if value != int(value) or not least <= value <= len(self.values):
            raise self.refuse(self.at - 1, f"expected the number of {what}")
        return int(value)


def _is_number(word: str) -> bool:
    try:
        return abs(float(word)) <= LARGEST and "_" not in word
    except ValueError:
        return False


def read_bal(path: Path) -> Document:
    """The project of a BAL file. Raises :class:`InputError` with the first mistake found."""
    numbers = _Numbers(path, comment=False)
    cameras, count, rays = (numbers.count(what, 1) for what in ("cameras", "points", "observations"))
    seen = numbers.take(4 * rays, "camera, point, x, y of each observation").reshape(-1, 4)
    per_camera = 9
    given = numbers.take(per_camera * cameras, "nine of each camera").reshape(-1, per_camera)
    xyz = numbers.take(3 * count, "three of each point").reshape(-1, 3)
    _check_end(numbers)
    indices = seen[:, :2]
    wrong = np.flatnonzero(((indices < 0) | (indices >= [cameras, count]) | (indices != np.floor(indices))).any(axis=1))
    if len(wrong):
        raise numbers.refuse(3 + 4 * int(wrong[0]), f"expected a camera below {cameras} and a point below {count}")
    block = BalBlock(
        exponential(given[:, :3]),
        given[:, 3:6],
        given[:, 6:],
        xyz,
        indices[:, 0].astype(np.int64),
        indices[:, 1].astype(np.int64),
        seen[:, 2:],
    )
    return _document(block, path)


def read_bundler(path: Path) -> Document:
    """The project of a Bundler file. Raises :class:`InputError` with the first mistake found.

    Images whose focal length is 0 were not oriented by Bundler: they are left out.
    """
    numbers = _Numbers(path, comment=True)
    cameras, count = (numbers.count(what, 1) for what in ("cameras", "points"))
    given = numbers.take(15 * cameras, "f k1 k2, rotation and translation of each camera").reshape(-1, 15)
    xyz = np.empty((count, 3))
    image, point, xy = [], [], []
    for k in range(count):
        xyz[k] = numbers.take(6, "place and colour of a point")[:3]
        views = numbers.take(4 * numbers.count("views"), "camera, key, x, y of each view").reshape(-1, 4)
        if len(views) and not ((views[:, 0] >= 0) & (views[:, 0] < cameras)).all():
            raise numbers.refuse(numbers.at - 1, f"expected views of cameras below {cameras}")
        image.append(views[:, 0].astype(np.int64))
        point.append(np.full(len(views), k))
        xy.append(views[:, 2:])
    _check_end(numbers)
    R = given[:, 3:12].reshape(-1, 3, 3)
    return _document(
        BalBlock(R, given[:, 12:], given[:, :3], xyz, np.concatenate(image), np.concatenate(point), np.concatenate(xy)),
        path,
    )


def _check_end(numbers: _Numbers) -> None:
    if numbers.at < len(numbers.values):
        raise numbers.refuse(numbers.at, "expected the end of the file")


def _document(block: BalBlock, path: Path) -> Document:
    draft = Draft(str(path))
    oriented = block.interior[:, 0] > 1.0 / LARGEST
    if not oriented.all():
        draft.note(f"{int((~oriented).sum())} images have no focal length above 0 and are left out")
    chosen = np.flatnonzero(oriented)
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    draft.put("cameras", {str(k): _camera(*block.interior[k]) for k in chosen.tolist()})
    centre = -np.einsum("nji,nj->ni", block.R, block.t)
    pose = np.concatenate([centre, angles_from_rotation(block.R)], axis=1)
    rows = [Row([str(k), str(k), *(repr(float(v)) for v in pose[k])], 1) for k in chosen.tolist()]
    if not rows:
        draft.problem("there is no image with a focal length above 0")
        return draft.finish()
    draft.table("images", ("id", "camera", "x", "y", "z", "omega", "phi", "kappa"), rows)
    names = pl.Series("id", np.arange(len(block.points))).cast(pl.String)
    draft.frame("points", "points", pl.DataFrame({"id": names, **dict(zip("xyz", block.points.T, strict=True))}))
    used = oriented[block.image]
    columns = {
        "image": pl.Series(block.image[used]).cast(pl.String),
        "point": pl.Series(block.point[used]).cast(pl.String),
        "x": block.xy[used, 0],
        "y": block.xy[used, 1],
    }
    draft.frame("observations", "image points", pl.DataFrame(columns), type="image", values={"sigma": "1"})
    draft.put("datum", "free")
    draft.note("σ = 1 px for all image points; f, k1, k2 of every image are free; lengths are called m")
    return draft.finish()


def _camera(f: float, k1: float, k2: float) -> dict[str, object]:
    interior = {"c": f, "A1": k1 / (f * f), "A2": k2 / (f * f) ** 2}
    return {"model": "mor", "unit": "px", "interior": {name: {"free": repr(float(v))} for name, v in interior.items()}}


def write_bal(document: Document, folder: Path, target: Path) -> Written:
    """A BAL file. Raises :class:`InputError` for cameras of other models, and images without a pose."""
    content = content_of(document, folder)
    found = frames(content, "BAL")
    problems: list[Message] = []
    interior = {name: _interior(content, name, camera, problems) for name, camera in content.project.cameras.items()}
    if np.isnan(found.values).any():
        words = "there are images without a pose of their own; convert an adjusted project (adjusted.yaml)"
        problems.append(Message(words, document.file))
    if problems:
        raise InputError(problems)
    whole = block(content, "BAL", found, corner=False)
    places, without = placed_points(content, whole.points, "BAL")
    rays, lost = rays_of_points(content, whole.rays, places, "BAL")
    image, point = ({name: k for k, name in enumerate(things.ids)} for things in (found, places))
    R = rotation_from_angles(found.values[:, 3:])
    t = -np.einsum("nij,nj->ni", R, found.values[:, :3])
    given = np.array([interior[name] for name in found.texts["camera"]]).reshape(-1, 3)
    # Rodrigues vectors (n, 3) of rotations (n, 3, 3), by way of quaternions.
    from mor.model.rotations import quaternions

    q = quaternions(R)
    sine = np.linalg.norm(q[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(sine, q[:, 0])
    factor = np.where(sine > 1e-12, angle / np.where(sine > 0.0, sine, 1.0), 2.0)
    vectors: FloatArray = q[:, 1:] * factor[:, None]
    numbers = np.concatenate([vectors, t, given], axis=1)
    lines = [f"{len(found)} {len(places)} {len(rays.images)}"]
    for a, b, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        lines.append(f"{image[a]} {point[b]} {x!r} {y!r}")
    lines += [repr(v) for v in numbers.ravel().tolist()]
    lines += [repr(v) for v in places.values.ravel().tolist()]
    notes = [*without, *lost, *not_carried(content, ("image",), (), "BAL")]
    notes.append(
        Message("BAL has no names, no σ, no fixed or observed points: images and points are numbered", str(target))
    )
    return Written({target: ("\n".join(lines) + "\n").encode()}, notes)


def _interior(content: Content, name: str, camera: Camera, problems: list[Message]) -> tuple[float, float, float]:
    """f, k1, k2 in px."""
    scale = image_scale(camera)
    try:
        values = interior_values(camera, content.edge, scale)
    except ValueError as error:
        problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
        return 1.0, 0.0, 0.0
    others = [key for key, value in values.items() if key not in ("c", "A1", "A2") and value]
    plain = camera.unit == "px" or not np.isnan(scale.pixel)
    if camera.model != "mor" or others or "c" not in values or not plain or split(camera.r0 or "0")[0]:
        words = f"camera {name}: BAL has c, A1 and A2 of model mor in px, and nothing else"
        problems.append(content.place("cameras", name).problem(words))
        return 1.0, 0.0, 0.0
    c, square = values["c"], values["c"] ** 2
    pixel = 1.0 if camera.unit == "px" else scale.pixel
    return c / pixel, values.get("A1", 0.0) * square, values.get("A2", 0.0) * square * square
