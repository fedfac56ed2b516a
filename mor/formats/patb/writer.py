"""An image block as PAT-B's image and control files: µm reduced to the principal point, without distortion; metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.bingo.writer import known_points, told
from mor.formats.content import Things, content_of, frames, not_carried, points, with_undeclared
from mor.formats.patb.reader import CONTROL
from mor.formats.refined import RefinedCamera, RefinedPoints, refined
from mor.formats.written import Written
from mor.project.file.nodes import Document

_LONGEST = 15
"""Letters of a name that PAT-B takes, as CATALYST's help says."""


def write_patb(document: Document, folder: Path, target: Path) -> Written:
    """``.im`` and ``.con``. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    found, places = frames(content, "PAT-B"), points(content)
    problems = [
        Problem(
            f"{name!r}: names in PAT-B's files have no blanks, and do not begin with #, *, ! or -99",
            document.file,
        )
        for name in (*found.ids, *places.ids)
        if not name or set(name) & set(" \t") or name[0] in "#*!" or name == "-99"
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(
            Problem("PAT-B's files have no stereo rigs, heights and eccentricities", document.file)
        )
    if not content.edge.right_handed:
        problems.append(content.place("axes").problem("PAT-B's files have right-handed axes"))
    if problems:
        raise InputError(problems)
    used = dict(zip(found.ids, found.texts["camera"], strict=True))
    cameras, rays = refined(content, used, "PAT-B")
    places = with_undeclared(content, places, rays.points)
    stem = target.with_suffix("") if target.suffix.lower() in (".im", CONTROL) else target
    files = {".im": _photos(found, cameras, rays), CONTROL: _control(places, content.edge.metres)}
    notes = not_carried(content, ("image",), (), "PAT-B")
    notes += [Problem(words, str(target)) for words in told(content, places, cameras, "PAT-B")]
    notes.append(Problem("PAT-B's files have no names of cameras, no poses and no start values", str(target)))
    long = [name for name in (*found.ids, *places.ids) if len(name) > _LONGEST]
    if long:
        notes.append(Problem(f"names of more than {_LONGEST} letters: {', '.join(long[:5])}", str(target)))
    texts = {
        stem.with_name(f"{stem.name}{end}"): "\n".join([*lines, ""]).encode() for end, lines in files.items()
    }
    return Written(texts, notes)


def _photos(found: Things, cameras: dict[str, RefinedCamera], rays: RefinedPoints) -> list[str]:
    principal = np.array([[k.xh, k.yh] for k in (cameras[found_of] for found_of in found.texts["camera"])])
    by_image = dict(zip(found.ids, principal, strict=True))
    blocks: dict[str, list[str]] = {name: [] for name in found.ids}
    for image, point, xy in zip(rays.images, rays.points, rays.xy, strict=True):
        x, y = ((xy - by_image[image]) * 1e3).tolist()
        blocks[image].append(f"{point} {x!r} {y!r}")
    lines = []
    for name, camera in zip(found.ids, found.texts["camera"], strict=True):
        lines += [f"{name} {float(cameras[camera].c) * 1e3!r}", *blocks[name], "-99"]
    return lines


def _control(places: Things, metres: float) -> list[str]:
    values = (places.statuses.values * metres).tolist()
    known = known_points(places)
    return [
        *(
            f"{name} {x!r} {y!r} {z!r}"
            for name, (x, y, z), held in zip(places.ids, values, known, strict=True)
            if held
        ),
        "-99",
    ]
