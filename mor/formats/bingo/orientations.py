"""Start values of ``itera.dat``: orientations of images and coordinates of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray
from mor.counting import counted
from mor.formats.bingo.files import rotation_from_bingo
from mor.formats.draft import Draft, Row, number
from mor.formats.text import read_lines
from mor.geometry.rotations import angles_from_rotation, rotation_from_angles

_WIDEST = 0.1
"""Largest median angle (rad) between rays and what they see; beyond it orientations are in other axes or angles."""


@dataclass
class Orientations:
    """Poses (x, y, z in m, ω, φ, κ in gon) of images and places of points, as texts, by name."""

    poses: dict[str, list[str | None]] = field(default_factory=dict)
    points: dict[str, list[str | None]] = field(default_factory=dict)
    file: str = ""


def read_orientations(path: Path, draft: Draft) -> Orientations:
    """``ORIA image X Y Z φ ω κ camera`` (gon, φ primary) and ``CORD point X Y Z``; other records are counted."""
    known = Orientations(file=str(path))
    other: dict[str, list[int]] = {}
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or text.startswith(("*", "#")):
            continue
        kind = words[0].upper()
        count = {"ORIA": 6, "CORD": 3}.get(kind)
        if count is None:
            other.setdefault(kind[:8], []).append(line)
            continue
        try:
            if len(words) < 2 + count:
                raise ValueError(f"found {len(words)} words, expected {kind}, a name and {count} numbers")
            values = [number(word) for word in words[2 : 2 + count]]
        except ValueError as error:
            draft.problem(str(error), line, str(path))
            continue
        if kind == "ORIA":
            known.poses[words[1]] = _pose(values)
        else:
            known.points[words[1]] = [repr(value) for value in values]
    for kind, lines in other.items():
        draft.note(f"{counted(len(lines), 'record')} {kind} not read", lines[0], str(path))
    return known


def _pose(values: Sequence[float]) -> list[str | None]:
    D = rotation_from_bingo(np.array([values[3:]]) * np.pi / 200.0)
    angles = angles_from_rotation(D)[0] * 200.0 / np.pi
    return [*(repr(value) for value in values[:3]), *(repr(value) for value in angles.tolist())]


def agreeing(
    known: Orientations,
    images: Mapping[str, Row],
    rays: Sequence[Row],
    cameras: Mapping[str, Sequence[float]],
    control: Mapping[str, Sequence[float]],
    draft: Draft,
) -> Orientations:
    """The start values where rays see their points, else nothing and a note that says so."""
    places = {**{n: [float(str(v)) for v in p] for n, p in known.points.items()}, **control}
    angles = _angles(known, images, rays, cameras, places)
    if not len(angles):
        return known
    if float(np.median(angles)) < _WIDEST:
        return known
    words = "orientations and image points contradict each other: orientations and points are worked out anew"
    draft.note(words, file=known.file)
    return Orientations(file=known.file)


def _angles(
    known: Orientations,
    images: Mapping[str, Row],
    rays: Sequence[Row],
    cameras: Mapping[str, Sequence[float]],
    places: Mapping[str, Sequence[float]],
) -> FloatArray:
    """Angles (n,), rad, between rays and directions to their points, where both are known."""
    seen: list[list[float]] = []
    for row in rays:
        image, point, x, y = (str(cell) for cell in row.cells)
        pose, camera = known.poses.get(image), cameras.get(str(images[image].cells[1]))
        if pose is not None and camera is not None and point in places:
            c, xh, yh = camera
            seen.append([float(x) - xh, float(y) - yh, -c, *places[point], *map(float, map(str, pose))])
    if not seen:
        return np.zeros(0)
    table = np.array(seen)
    angles = table[:, 9:] * np.pi / 200.0
    star = np.einsum("nij,nj->ni", rotation_from_angles(angles), table[:, 3:6] - table[:, 6:9])
    sine = np.linalg.norm(np.cross(table[:, :3], star), axis=1)
    between: FloatArray = np.arctan2(sine, np.einsum("ni,ni->n", table[:, :3], star))
    return between
