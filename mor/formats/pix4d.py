"""Calibrated cameras, poses, tie points and ground control of Pix4Dmapper as a project: metres, degrees, pixels.

The camera is Pix4D's own, f, cx, cy, R1, R2, R3, T1, T2, as model ``metashape``, which has one focal length, too.
Source: Pix4D support, *How are the internal and external camera parameters defined*, and files of the program.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mor.errors import counted
from mor.formats.draft import FLIP, Draft, Row
from mor.formats.recognition import (
    CAMERAS,
    CONTROL,
    EXTERNAL,
    MARKS,
    OFFSET,
    CalibratedImage,
    NamedValues,
    files_of,
    read_cameras,
    read_marks,
    read_named,
)
from mor.model.rotations import angles_from_rotation
from mor.project.document import Document
from mor.types import FloatArray

SIGMA_CONTROL, SIGMA_MARK = "0.02", "1"
"""σ of control (m; Pix4D's own default) and of image points (px): the files say none."""


def read_pix4d(path: Path) -> Document:
    """The project of the parameters of Pix4D. Raises :class:`InputError` with every mistake found."""
    draft = Draft(str(path))
    files = files_of(path)
    stem = next(iter(files.values())).name.removesuffix(next(iter(files))).rstrip("_")
    draft.put("title", stem or "Pix4D")
    draft.put("units", {"length": "m", "angle": "deg"})
    if CAMERAS not in files:
        draft.problem(f"found no …_{CAMERAS} beside it, which has the cameras and the size of the images")
        return draft.finish()
    photos = read_cameras(files[CAMERAS], draft)
    names = _put_cameras(photos, str(files[CAMERAS]), draft)
    poses = _poses(photos, files, draft)
    control = read_named(files[CONTROL], 3, "name X Y Z", draft) if CONTROL in files else []
    marks = read_marks(files[MARKS], draft) if MARKS in files else []
    if MARKS not in files:
        draft.note(f"no …_{MARKS}: images with their poses and cameras, no image points")
    if draft.problems:
        return draft.finish()
    rows = [
        Row([photo.name, names[photo.name], *map(repr, map(float, poses[photo.name]))], photo.line) for photo in photos
    ]
    pose = ("x", "y", "z", "omega", "phi", "kappa")
    draft.table("images", ("id", "camera", *pose), rows, str(files[CAMERAS]))
    used = _put_marks(marks, photos, str(files.get(MARKS, "")), draft)
    file = str(files.get(MARKS, ""))
    control_file = str(files.get(CONTROL, ""))
    if control:
        _put_control(control, control_file, draft)
    known = {row.name for row in control}
    first: dict[str, NamedValues] = {}
    for mark in used:
        if mark.name not in known:
            first.setdefault(mark.name, mark)
    if first:
        draft.table("points", ("id",), [Row([name], mark.line) for name, mark in first.items()], file)
    if sum(row.name in {mark.name for mark in used} for row in control) < 3:
        draft.put("datum", "free")
    draft.put("settings", {"undetermined": "leave_out"})
    return draft.finish()


def read_control(path: Path) -> Document:
    """Ground control as Pix4D imports it: name, X, Y, Z, then accuracies in plan and height where there are any.

    Raises :class:`InputError` with every mistake found.
    """
    draft = Draft(str(path))
    draft.put("units", {"length": "m", "angle": "deg"})
    control = read_named(path, 3, "name, X, Y, Z and perhaps accuracies in plan and height", draft, most=5)
    if not control and not draft.problems:
        draft.problem("found no control points, expected lines of name, X, Y, Z", 1)
    if control and not draft.problems:
        _put_control(control, "", draft)
    return draft.finish()


def _put_cameras(photos: Sequence[CalibratedImage], file: str, draft: Draft) -> dict[str, str]:
    cameras: dict[str, Any] = {}
    by_values: dict[tuple[object, ...], str] = {}
    names: dict[str, str] = {}
    for photo in photos:
        if photo.name in names:
            draft.problem(f"image {photo.name!r} is there already", photo.line, file)
        key = (photo.size, photo.camera)
        if key not in by_values:
            by_values[key] = str(len(cameras) + 1)
            cameras[by_values[key]] = _camera(photo)
            draft.lines["cameras", by_values[key]] = photo.line
            draft.files["cameras", by_values[key]] = file
        names[photo.name] = by_values[key]
    draft.put("cameras", cameras)
    if cameras:
        words = "the files do not say which camera parameters were estimated: all are free, as is Pix4D's default"
        draft.note(words, file=file)
    return names


def _camera(photo: CalibratedImage) -> dict[str, Any]:
    f, cx, cy, r1, r2, r3, t1, t2 = photo.camera
    width, height = photo.size
    values = {"f": f, "cx": cx - width / 2.0, "cy": cy - height / 2.0}
    values |= {"k1": r1, "k2": r2, "k3": r3, "p1": t2, "p2": t1}
    return {
        "model": "metashape",
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": f"{width:.0f}", "height": f"{height:.0f}"},
        "interior": {key: {"free": repr(value)} for key, value in values.items()},
    }


def _poses(photos: Sequence[CalibratedImage], files: dict[str, Path], draft: Draft) -> dict[str, FloatArray]:
    """Poses in the output system: of the external parameters where they are, else local ones with the offset."""
    offset = np.zeros(3)
    if OFFSET in files:
        offset = _offset(files[OFFSET], draft)
    poses = {
        photo.name: np.array([*(photo.position + offset), *np.degrees(angles_from_rotation(FLIP @ photo.rotation))])
        for photo in photos
    }
    if EXTERNAL not in files:
        if OFFSET not in files:
            draft.note(f"neither …_{EXTERNAL} nor …_{OFFSET}: poses are in Pix4D's local system")
        return poses
    known = read_named(files[EXTERNAL], 6, "name X Y Z Omega Phi Kappa", draft)
    found = {row.name: np.array(row.values) for row in known}
    lost = [photo for photo in photos if photo.name not in found]
    if lost:
        words = f"{counted(len(lost), 'image')} not in the external parameters: the first is {lost[0].name}"
        draft.problem(words, lost[0].line, str(files[CAMERAS]))
        return poses
    apart = [row for row in known if row.name in poses and _apart(poses[row.name], found[row.name], OFFSET in files)]
    if apart:
        words = f"{counted(len(apart), 'pose')} of the external parameters are not those of …_{CAMERAS}"
        draft.note(
            f"{words}: the first is {apart[0].name}; the external ones are taken", apart[0].line, str(files[EXTERNAL])
        )
    return {photo.name: found[photo.name] for photo in photos}


def _apart(own: FloatArray, external: FloatArray, placed: bool) -> bool:
    turned = (own[3:] - external[3:] + 180.0) % 360.0 - 180.0
    return bool(np.abs(turned).max() > 1e-4 or (placed and np.abs(own[:3] - external[:3]).max() > 1e-3))


def _offset(path: Path, draft: Draft) -> FloatArray:
    rows = read_named(path, 2, "three numbers", draft)
    try:
        return np.array([float(rows[0].name), *rows[0].values])
    except (ValueError, IndexError):
        draft.problem("expected three numbers", 1, str(path))
        return np.zeros(3)


def _put_marks(
    marks: list[tuple[str, NamedValues]], photos: Sequence[CalibratedImage], file: str, draft: Draft
) -> list[NamedValues]:
    """Image points; names of images may lack their suffix. Returns those that are used."""
    by_stem = {photo.name.rpartition(".")[0] or photo.name: photo.name for photo in photos}
    by_name = {**by_stem, **{photo.name: photo.name for photo in photos}}
    used = [(by_name[image], mark) for image, mark in marks if image in by_name]
    if len(used) < len(marks):
        image, first = next((image, mark) for image, mark in marks if image not in by_name)
        words = f"{counted(len(marks) - len(used), 'image point')} of no calibrated image not used"
        draft.note(f"{words}: the first is in {image}", first.line, file)
    if used:
        rows = [Row([image, mark.name, *map(repr, mark.values)], mark.line) for image, mark in used]
        draft.note(f"σ = {SIGMA_MARK} px for all image points: the files say none; their scale is not used", file=file)
        columns = ("image", "point", "x", "y")
        draft.table("observations", columns, rows, file, type="image", units="px", values={"sigma": SIGMA_MARK})
    return [mark for _, mark in used]


def _put_control(control: list[NamedValues], file: str, draft: Draft) -> None:
    """Control points observed with their accuracies, else with Pix4D's own default."""
    rows, seen, bare = [], set(), False
    for row in control:
        if row.name in seen:
            draft.problem(f"control point {row.name!r} is there already", row.line, file)
        seen.add(row.name)
        x, y, z, *given = row.values
        bare = bare or not given
        plan, height = (repr(given[0]), repr(given[-1])) if given else (SIGMA_CONTROL, SIGMA_CONTROL)
        if given and min(given) < 0.0:
            draft.problem(f"found the accuracy {min(given):g}, expected 0 or more", row.line, file)
        rows.append(Row([row.name, repr(x), repr(y), repr(z), plan, plan, height], row.line))
    if bare:
        draft.note(f"control points without an accuracy have σ = {SIGMA_CONTROL} m, Pix4D's default", file=file)
    columns = ("id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z")
    draft.table("points", columns, rows, file, group="control")
