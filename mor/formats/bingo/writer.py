"""An image block as BINGO's files: metres, gon, image coordinates in mm without distortion."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.arrays import BoolArray
from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.bingo.files import GROUND, IMAGES, ORIENTATIONS, bingo_angles
from mor.formats.content import Content, Things, content_of, frames, not_carried, points, with_undeclared
from mor.formats.refined import RefinedCamera, RefinedPoints, refined
from mor.formats.written import Written
from mor.geometry.rotations import rotation_from_angles
from mor.project.file.nodes import Document


def write_bingo(document: Document, folder: Path, target: Path) -> Written:
    """``image.dat``, ``geoin.dat``, ``itera.dat`` in a folder. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    found, places = frames(content, "BINGO"), points(content)
    _refuse(content, found, places)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    cameras, rays = refined(content, used, "BINGO")
    places = with_undeclared(content, places, rays.points)
    known = known_points(places)
    metres = content.edge.metres
    files = {
        IMAGES: image_lines(found, rays),
        GROUND: [*_cameras(cameras), *_control(places, known, metres)],
        ORIENTATIONS: [*_orientations(found, metres), *_starts(places, known, metres)],
    }
    notes = not_carried(content, ("image",), (), "BINGO")
    notes += [Problem(words, str(target)) for words in told(content, places, cameras, "BINGO")]
    texts = {target / name: "\n".join([*lines, ""]).encode() for name, lines in files.items()}
    return Written(texts, notes)


def _refuse(content: Content, found: Things, places: Things) -> None:
    file = content.document.file
    names = (*content.project.cameras, *found.ids, *places.ids)
    problems = [
        Problem(f"{name!r}: names in BINGO's files have no blanks, and do not begin with #, * or -99", file)
        for name in names
        if not name or set(name) & set(" \t") or name[0] in "#*" or name == "-99"
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(Problem("BINGO's files have no stereo rigs, heights and eccentricities", file))
    if not content.edge.right_handed:
        problems.append(content.place("axes").problem("BINGO's files have right-handed axes"))
    if problems:
        raise InputError(problems)


def told(content: Content, places: Things, cameras: dict[str, RefinedCamera], what: str) -> list[str]:
    """Notes about information that the files cannot hold."""
    some = places.fixed | np.isfinite(places.statuses.sigma)
    partly = int((some.any(axis=1) & ~some.all(axis=1)).sum())
    words = [f"{what}'s files have no σ and do not say which interior parameters are free"]
    if partly:
        words.append(
            f"{counted(partly, 'point')} with control in some components only: as if there were none"
        )
    corrected = [name for name, camera in cameras.items() if camera.corrected]
    if corrected:
        words.append(
            f"image points of {', '.join(corrected)} are written without their distortion as it starts"
        )
    return words


def known_points(places: Things) -> BoolArray:
    """(n,) true where all coordinates are fixed or observed."""
    return np.asarray((places.fixed | np.isfinite(places.statuses.sigma)).all(axis=1))


def image_lines(found: Things, rays: RefinedPoints) -> list[str]:
    """A block of each image: its name and camera, image points, −99."""
    by_image: dict[str, list[str]] = {name: [] for name in found.ids}
    for image, point, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        by_image[image].append(f"{point} {x!r} {y!r}")
    lines = []
    for name, camera in zip(found.ids, found.texts["camera"], strict=True):
        lines += [f"{name} {camera}", *by_image[name], "-99"]
    return lines


def _cameras(cameras: dict[str, RefinedCamera]) -> list[str]:
    return [f"CAPA {name} 0 {float(k.c)!r} {float(k.xh)!r} {float(k.yh)!r}" for name, k in cameras.items()]


def _control(places: Things, known: BoolArray, metres: float) -> list[str]:
    values = (places.statuses.values * metres).tolist()
    return [
        f"CONT {name} {x!r} {y!r} {z!r}"
        for name, (x, y, z), held in zip(places.ids, values, known, strict=True)
        if held
    ]


def _orientations(found: Things, metres: float) -> list[str]:
    lines = []
    angles = bingo_angles(rotation_from_angles(np.nan_to_num(found.values[:, 3:]))) * 200.0 / np.pi
    for name, camera, pose, three in zip(
        found.ids, found.texts["camera"], found.values, angles.tolist(), strict=True
    ):
        if np.isfinite(pose).all():
            numbers = [*(pose[:3] * metres).tolist(), *three]
            lines.append(f"ORIA {name} {' '.join(map(repr, numbers))} {camera}")
    return lines


def _starts(places: Things, known: BoolArray, metres: float) -> list[str]:
    return [
        f"CORD {name} {' '.join(map(repr, place))}"
        for name, place, held in zip(places.ids, (places.values * metres).tolist(), known, strict=True)
        if not held and bool(np.isfinite(place).all())
    ]
