"""Control of an image block as OpenDroneMap's ``gcp_list.txt``, with its image points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.content import content_of, frames, image_points, not_carried, points
from mor.formats.written import Written
from mor.project.file.nodes import Document

_SYSTEM = "EPSG:?"
"""First line of the file, which OpenDroneMap refuses as it is: a project does not know its coordinate system."""


def write_gcp_list(document: Document, folder: Path, target: Path) -> Written:
    """x y z u v image name a line, px from the centre of the upper left pixel, for fixed and observed points.

    Raises :class:`InputError` for names with blanks, and where there is no control in an image.
    """
    content = content_of(document, folder)
    found, places = frames(content, "a gcp_list.txt"), points(content)
    rays = image_points(content, dict(zip(found.ids, found.texts["camera"], strict=True)))
    known = places.fixed | np.isfinite(places.statuses.sigma)
    flip, metres = content.edge.matrix, content.edge.metres
    control = {}
    for k, name in enumerate(places.ids):
        xyz = flip @ np.where(known[k], places.statuses.values[k], np.nan_to_num(places.values[k])) * metres
        there = np.abs(flip) @ known[k] > 0.0
        if there[:2].all():
            control[name] = " ".join(
                [repr(float(xyz[0])), repr(float(xyz[1])), repr(float(xyz[2])) if there[2] else "nan"]
            )
    lines, lost = [_SYSTEM], 0
    for image, point, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        lost += point not in control
        if point in control:
            lines.append(f"{control[point]} {x - 0.5!r} {y - 0.5!r} {image} {point}")
    odd = [name for name in (*control, *found.ids) if any(sign.isspace() for sign in name)]
    if odd or len(lines) == 1:
        words = (
            f"{odd[0]!r}: names in a gcp_list.txt have no blanks" if odd else "no image shows a control point"
        )
        raise InputError([Problem(words, document.file)])
    notes = not_carried(content, ("image",), (), "gcp_list.txt")
    words = f"line 1 says {_SYSTEM}: put the coordinate system of the control there, as EPSG:25832 or WGS84 UTM 32N"
    notes.append(Problem(words, str(target), 1))
    if lost:
        words = f"{counted(lost, 'image point')} of points without control in plan, σ, cameras, poses: not written"
        notes.append(Problem(words, str(target)))
    return Written({target: ("\n".join(lines) + "\n").encode()}, notes)
