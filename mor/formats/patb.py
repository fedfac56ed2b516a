"""PAT-B files: read and written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mor.errors import InputError, Message, counted
from mor.formats.bingo import RefinedCamera, RefinedPoints, known_points, refined, told
from mor.formats.content import Things, content_of, frames, not_carried, points, with_undeclared
from mor.formats.draft import Draft, Row, Written, parse_number, read_lines
from mor.project.document import Document

# ------------------------------------------------------------
# PAT-B: image coordinates, freed of distortion and reduced to the principal point, and a file of control points.
#
# Image file: photo and camera constant, lines of point, x, y, then −99. Control file: point, X, Y, Z, then
# −99. Written from what other programs say of their exports (CATALYST OrthoEngine, Vr Mapping): µm or mm,
# told by the constant.
# ------------------------------------------------------------

SIGMA_IMAGE, SIGMA_CONTROL = "0.003", "0.02"
"""σ of image coordinates (mm) and of control (m): PAT-B has them in its project."""
_MICROMETRES = 2000.0
"""Camera constants from here on are in µm: no camera of two metres takes photographs from the air."""
CONTROL = ".con"


@dataclass
class Photos:
    """Content of an image file."""

    images: dict[str, Row] = field(default_factory=dict)
    """Image and camera constant (mm)."""
    rays: list[Row] = field(default_factory=list)
    further: list[int] = field(default_factory=list)
    """Lines with further numbers."""


def read_patb(path: Path) -> Document:
    """The project of an image file, with the control file beside it. Raises :class:`InputError`."""
    draft = Draft(str(path))
    draft.put("title", path.stem)
    draft.put("units", {"length": "m", "angle": "gon"})
    photos = _read_photos(path, draft)
    file = control_beside(path)
    control = _read_control(file, draft) if file is not None else []
    if photos.rays and not draft.problems:
        _put(photos, draft)
    _put_points(photos, control, file, draft)
    return draft.finish()


def control_beside(path: Path) -> Path | None:
    """The control file of the same name, or the only one of the folder."""
    found = [file for file in sorted(path.parent.iterdir()) if file.suffix.lower() == CONTROL]
    named = [file for file in found if file.stem.lower() == path.stem.lower()]
    return named[0] if named else found[0] if len(found) == 1 else None


def _read_photos(path: Path, draft: Draft) -> Photos:
    photos = Photos()
    image, scale = "", 1.0
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0].startswith(("#", "*", "!")):
            continue
        try:
            if words[0] == "-99":
                image = ""
            elif not image:
                image, scale = _photo(words, line, photos)
            else:
                if len(words) < 3:
                    raise ValueError(f"found {len(words)} words, expected point x y")
                x, y = (parse_number(word) for word in words[1:3])
                photos.rays.append(Row([image, words[0], repr(x * scale), repr(y * scale)], line))
                if len(words) > 3:
                    photos.further.append(line)
        except ValueError as error:
            draft.problem(str(error), line)
    if not photos.rays and not draft.problems:
        draft.problem("found no image points", 1)
    return photos


def _photo(words: list[str], line: int, photos: Photos) -> tuple[str, float]:
    """Name of a photo, and mm of the unit of its coordinates. Raises ``ValueError``."""
    if len(words) < 2:
        raise ValueError(f"found {' '.join(words)!r}, expected a photo and its camera constant")
    c = parse_number(words[1])
    if c <= 0.0:
        raise ValueError(f"found the camera constant {words[1]}, expected a number above 0")
    if words[0] in photos.images:
        raise ValueError(f"image {words[0]!r} is there already")
    scale = 1e-3 if c >= _MICROMETRES else 1.0
    photos.images[words[0]] = Row([words[0], repr(c * scale)], line)
    if len(words) > 2:
        photos.further.append(line)
    return words[0], scale


def _put(photos: Photos, draft: Draft) -> None:
    """A camera for each camera constant, images, image points."""
    names: dict[str, str] = {}
    for row in photos.images.values():
        names.setdefault(str(row.cells[1]), f"camera {len(names) + 1}")
    cameras = {
        name: {"model": "mor", "unit": "mm", "interior": {"c": {"fixed": c}}} for c, name in names.items()
    }
    draft.put("cameras", cameras)
    for row in photos.images.values():
        draft.lines.setdefault(("cameras", names[str(row.cells[1])]), row.line)
    rows = [Row([row.cells[0], names[str(row.cells[1])]], row.line) for row in photos.images.values()]
    draft.table("images", ("id", "camera"), rows)
    columns = ("image", "point", "x", "y")
    draft.table("observations", columns, photos.rays, type="image", units="mm", values={"sigma": SIGMA_IMAGE})
    draft.note(
        "image coordinates are freed of distortion, in PAT-B: cameras have a fixed constant and nothing else"
    )
    draft.note(f"σ = {SIGMA_IMAGE} mm for all image coordinates")
    if photos.further:
        count = counted(len(photos.further), "line")
        draft.note(f"further numbers in {count} not read", photos.further[0])


def _read_control(path: Path, draft: Draft) -> list[Row]:
    rows: dict[str, Row] = {}
    further: list[int] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        words = text.split()
        if not words or words[0].startswith(("#", "*", "!")) or words[0] == "-99":
            continue
        try:
            if len(words) < 4:
                raise ValueError(f"found {len(words)} words, expected point X Y Z")
            values = [repr(parse_number(word)) for word in words[1:4]]
            if words[0] in rows:
                raise ValueError(f"point {words[0]!r} is there already")
        except ValueError as error:
            draft.problem(str(error), line, str(path))
            continue
        rows[words[0]] = Row([words[0], *values], line)
        further += [line] if len(words) > 4 else []
    if further:
        draft.note(f"further numbers in {counted(len(further), 'line')} not read", further[0], str(path))
    return list(rows.values())


def _put_points(photos: Photos, control: list[Row], file: Path | None, draft: Draft) -> None:
    if control:
        values = {"sigma": SIGMA_CONTROL}
        draft.table("points", ("id", "x", "y", "z"), control, str(file), values=values, group="control")
        draft.note(f"control points are observed with σ = {SIGMA_CONTROL} m", control[0].line, str(file))
    else:
        draft.put("datum", "free")
        draft.note(f"there is no {CONTROL} beside it: the block is a free network")
    known = {row.cells[0] for row in control}
    seen: dict[str, int] = {}
    for row in photos.rays:
        seen.setdefault(str(row.cells[1]), row.line)
    others = [Row([name], line) for name, line in seen.items() if name not in known]
    if others:
        draft.table("points", ("id",), others)


# ------------------------------------------------------------
# An image block as PAT-B's image and control files: µm reduced to the principal point, without distortion; metres.
# ------------------------------------------------------------

_LONGEST = 15
"""Letters of a name that PAT-B takes, as CATALYST's help says."""


def write_patb(document: Document, folder: Path, target: Path) -> Written:
    """``.im`` and ``.con``. Raises :class:`InputError` for what they cannot say."""
    content = content_of(document, folder)
    found, places = frames(content, "PAT-B"), points(content)
    problems = [
        Message(
            f"{name!r}: names in PAT-B's files have no blanks, and do not begin with #, *, ! or -99",
            document.file,
        )
        for name in (*found.ids, *places.ids)
        if not name or set(name) & set(" \t") or name[0] in "#*!" or name == "-99"
    ]
    if any("".join(found.texts[key]) for key in ("leader", "shared_height", "shared_eccentricity")):
        problems.append(
            Message("PAT-B's files have no stereo rigs, heights and eccentricities", document.file)
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
    notes += [Message(words, str(target)) for words in told(content, places, cameras, "PAT-B")]
    notes.append(Message("PAT-B's files have no names of cameras, no poses and no start values", str(target)))
    long = [name for name in (*found.ids, *places.ids) if len(name) > _LONGEST]
    if long:
        notes.append(Message(f"names of more than {_LONGEST} letters: {', '.join(long[:5])}", str(target)))
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
