"""An image block as AICON 3D Studio's flat files: millimetres, radians, image coordinates in mm."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mor.arrays import BoolArray, FloatArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.content import (
    Content,
    ImagePoints,
    Things,
    block,
    content_of,
    frames,
    interior_values,
    not_carried,
    placed_points,
    points,
    rays_of_points,
)
from mor.formats.networks.terrestrial import groups
from mor.formats.written import Written
from mor.project.edge import image_scale, split
from mor.project.file.model import Camera, Datum
from mor.project.file.nodes import Document
from mor.units import IMAGE

_TOLD = (
    "the files do not say which interior parameters are free, and no σ of image coordinates for the adjustment: "
    "those of the project stand in the columns of target measurement (.phc)"
)


def write_aicon(document: Document, folder: Path, target: Path) -> Written:
    """The five files. Raises :class:`InputError` for cameras, names and poses that they cannot say."""
    content = content_of(document, folder)
    found = frames(content, "AICON's files")
    problems: list[Problem] = []
    cameras, pixels = [], {}
    for name, camera in content.project.cameras.items():
        try:
            lines, pixels[name] = camera_lines(name, camera, content)
            cameras += lines
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
    names = (*content.project.cameras, *found.ids, *points(content).ids)
    problems += [
        Problem(f"{name!r}: names in AICON's files have no blanks, # or quotes", document.file)
        for name in names
        if set(name) & set(" \t#'\"")
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(
            Problem("AICON's files have no stereo rigs, heights and eccentricities", document.file)
        )
    if not content.edge.right_handed:
        problems.append(content.place("axes").problem("AICON's files have right-handed axes"))
    if problems:
        raise InputError(problems)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    whole = block(content, "AICON's files", found, corner=False)
    places, without = placed_points(content, whole.points, "AICON's files")
    rays, gone = rays_of_points(content, whole.rays, places, "AICON's files")
    lengths = content.edge.metres * 1e3
    scales, lost = _scales(content, set(places.ids), lengths)
    files = {
        ".ior": cameras,
        ".eor": _images(found, lengths),
        ".obc": _points(places, rays, content, lengths),
        ".phc": _rays(rays, np.array([pixels[used[name]] for name in rays.images])),
        ".scale": scales,
    }
    stem = target.with_suffix("") if target.suffix in files else target
    notes = [*without, *gone, *not_carried(content, ("image", "distance"), (), "AICON's files")]
    partly = int((_known(places).any(axis=1) & ~_known(places).all(axis=1)).sum())
    for count, what in (
        (partly, "point with control in some components only"),
        (lost, "distance with heights"),
    ):
        if count:
            notes.append(Problem(f"{counted(count, what)}: as if there were none", str(stem)))
    notes.append(Problem(_TOLD, str(stem)))
    texts = {
        stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()
    }
    return Written(texts, notes)


def camera_lines(name: str, camera: Camera, content: Content) -> tuple[list[str], float]:
    """Five lines, and the size of a pixel in mm. Raises ``ValueError``."""
    if camera.model != "mor" or camera.image_variant or camera.eccentricity:
        raise ValueError("AICON has model mor, without image-variant parameters and eccentricities")
    scale = image_scale(camera, content.project.units)
    if np.isnan(scale.size) or camera.image is None:
        raise ValueError("AICON's files need image: {width, height, pixel} with the size of a pixel in mm")
    per = scale.size / scale.pixel
    given = interior_values(camera, content.edge, scale)
    powers = {"A1": -2, "A2": -4, "A3": -6, "B1": -1, "B2": -1, "C1": 0, "C2": 0}
    value = {key: v * per ** powers.get(key, 1) for key, v in given.items()}
    r0 = content.edge.number(camera.r0 or "0", IMAGE, "", scale) * per
    size = [round(split(text)[0]) for text in (camera.image.width, camera.image.height)]

    def words(*keys: str) -> str:
        return " ".join(repr(value.get(key, 0.0)) for key in keys)

    first = f"{name} -999 {-value['c']!r} {words('xh', 'yh', 'A1', 'A2')} {r0!r}"
    sensor = " ".join(repr(scale.size * count) for count in size)
    last = f"{sensor} {size[0]} {size[1]}"
    return [first, words("A3"), words("B1", "B2"), words("C1", "C2"), last], scale.size


def _images(found: Things, lengths: float) -> list[str]:
    """Poses; state 1 is an image without one."""
    lines = []
    for name, camera, pose in zip(found.ids, found.texts["camera"], found.values, strict=True):
        oriented = bool(np.isfinite(pose).all())
        numbers = [*(pose[:3] * lengths), *pose[3:]] if oriented else [0.0] * 6
        lines.append(f"{name} {camera} {_words(numbers)} 0 307 {3 if oriented else 1}")
    return lines


def _points(places: Things, rays: ImagePoints, content: Content, lengths: float) -> list[str]:
    """Points: new ones, and known ones with their σ (0: fixed); flagged where they carry the datum."""
    count = Counter(rays.points)
    datum = content.project.datum
    chosen = (
        {str(name) for name in datum.free}
        if isinstance(datum, Datum) and isinstance(datum.free, list)
        else set()
    )
    lines = []
    for k, name in enumerate(places.ids):
        sigma, known = np.nan_to_num(places.statuses.sigma[k]), bool(_known(places)[k].all())
        numbers = places.statuses.values[k] if known else places.values[k]
        every = [*(np.nan_to_num(numbers) * lengths), *(sigma * lengths if known else np.zeros(3))]
        lines.append(f"{name} {_words(every)} {count[name]} 1 {int(not known)} {int(name in chosen)}")
    return lines


def _rays(rays: ImagePoints, pixel: FloatArray) -> list[str]:
    xy, sigma = rays.xy * pixel[:, None], np.nan_to_num(rays.sigma) * pixel[:, None]
    return [
        f"{image} {point} {_words([*xy[k], *sigma[k]])} 0 0 1 1 1"
        for k, (image, point) in enumerate(zip(rays.images, rays.points, strict=True))
    ]


def _scales(content: Content, points_: set[str], lengths: float) -> tuple[list[str], int]:
    """Distances between points as scale bars, and how many are not such."""
    lines: list[str] = []
    lost = 0
    for group in groups(content, ("distance",)):
        heights = sum(np.nan_to_num(group.rows.number(f"{end}_height")) != 0.0 for end in ("from", "to"))
        for row, (a, b) in enumerate(zip(group.rows.text("from"), group.rows.text("to"), strict=True)):
            if heights[row] or not {a, b} <= points_:
                lost += 1
                continue
            numbers = _words([group.values[row, 0] * lengths, group.sigma[row, 0] * lengths])
            lines.append(f'{len(lines)} "distance {len(lines) + 1}" {a} {b} {numbers} 1')
    return lines, lost


def _known(places: Things) -> BoolArray:
    """(n, 3) true where a coordinate is fixed or observed."""
    return places.fixed | np.isfinite(places.statuses.sigma)


def _words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in numbers)
