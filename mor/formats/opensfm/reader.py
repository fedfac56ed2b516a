"""An OpenSfM block as a project: east, north, up in metres about its reference point, σ = 1 px."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.counting import counted
from mor.errors import InputError, Problem
from mor.formats.draft import Draft, Row
from mor.formats.json_text import JsonFile, Wrong, mapping, number, numbers
from mor.formats.opensfm.cameras import LOOSER, camera_of
from mor.formats.opensfm.ground_control import Control, read_control
from mor.formats.opensfm.priors import with_priors
from mor.formats.text import read_lines
from mor.geometry.rotations import angles_from_rotation, exponential
from mor.project.file.nodes import Document

_FLIP = np.diag([1.0, -1.0, -1.0])
"""OpenSfM's camera axes (right, down, forward) from mor's (right, up, backward)."""
_DOP = 1000.0
"""Accuracies of positions of images beyond this (m) stand for none: OpenSfM writes 999999."""
_VERSION = "OPENSFM_TRACKS_VERSION"


def read_opensfm(path: Path) -> Document:
    """The project of a folder (or the ``opensfm`` folder in it) with ``reconstruction.json`` and ``tracks.csv``.

    Raises :class:`InputError` with every mistake found.
    """
    folder = path if path.is_dir() else path.parent
    if not (folder / "reconstruction.json").is_file() and (folder / "opensfm").is_dir():
        folder = folder / "opensfm"
    file = JsonFile(path if path.is_file() and path.suffix == ".json" else folder / "reconstruction.json")
    draft = Draft(file.file)
    whole = _largest(file, draft)
    draft.put("title", folder.resolve().name)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    shots, points = _section(whole, "shots", draft), _section(whole, "points", draft)
    cameras = _put_cameras(_section(whole, "cameras", draft), file, folder, draft)
    control = read_control(folder, whole, shots, draft)
    weighted = _put_images(shots, cameras, file, control.own_system, draft)
    _put_points(points, file, control, draft)
    _put_tracks(folder / "tracks.csv", set(shots), set(points), cameras, shots, control, draft)
    if not weighted and not control.ids:
        draft.put("datum", "free")
    _note_reference(whole, draft)
    return draft.finish()


def _largest(file: JsonFile, draft: Draft) -> dict[str, Any]:
    found = file.data if isinstance(file.data, list) else [file.data]
    good = [one for one in found if isinstance(one, dict) and isinstance(one.get("shots"), dict)]
    if not good:
        raise InputError(
            [Problem("expected a list of reconstructions with shots, cameras, points", file.file, 1)]
        )
    good.sort(key=lambda one: -len(one["shots"]))
    if len(good) > 1:
        shots = sum(len(one["shots"]) for one in good[1:])
        words = (
            f"{len(good)} reconstructions that nothing ties: only the largest is read, without {shots} images"
        )
        draft.note(words, 1)
    return good[0]


def _section(whole: dict[str, Any], name: str, draft: Draft) -> dict[str, Any]:
    found = whole.get(name)
    if not isinstance(found, dict) or not found:
        draft.problem(f"found no {name}, expected a mapping of them")
        return {}
    return found


def _put_cameras(given: dict[str, Any], file: JsonFile, folder: Path, draft: Draft) -> dict[str, str]:
    """Names of the cameras that were read, by OpenSfM's."""
    cameras, names = {}, {}
    for name, content in given.items():
        try:
            camera = camera_of(name, mapping(content, f"camera {name!r}"))
        except Wrong as error:
            draft.problem(str(error), file.line(name))
            continue
        names[name] = name.strip() or "camera"
        cameras[name] = camera
        draft.lines["cameras", names[name]] = file.line(name)
        if str(content.get("projection_type")) in LOOSER:
            words = f"camera {name}: fx, fy, cx, cy are free; OpenSfM's fisheye has one focal length and its centre"
            draft.note(words, file.line(name))
    known = with_priors(cameras, folder, draft)
    draft.put("cameras", {names[name]: camera for name, camera in known.items()})
    return names


def _put_images(
    shots: dict[str, Any], cameras: dict[str, str], file: JsonFile, other_system: bool, draft: Draft
) -> bool:
    """Return True if positions of images are observed."""
    rows = []
    for name, content in shots.items():
        try:
            rows.append(_image(name, mapping(content, f"shot {name!r}"), cameras, file, other_system))
        except Wrong as error:
            draft.problem(str(error), file.line(name))
    axes = ("x", "y", "z")
    columns = (
        "id",
        "camera",
        *axes,
        "omega",
        "phi",
        "kappa",
        *(f"sigma_{a}" for a in axes),
        *(f"start_{a}" for a in axes),
    )
    if not rows:
        return False
    draft.table("images", columns, rows)
    observed = sum(row.cells[8] is not None for row in rows)
    if observed:
        draft.note(f"GNSS positions of {counted(observed, 'image')} are observed, σ = gps_dop")
    return observed > 0


def _image(
    name: str, shot: dict[str, Any], cameras: dict[str, str], file: JsonFile, other_system: bool
) -> Row:
    camera = str(shot.get("camera"))
    if camera not in cameras:
        raise Wrong(f"shot {name!r}: camera {camera!r} is not among the cameras")
    R = exponential(np.array(numbers(shot.get("rotation"), 3, f"shot {name!r}: rotation")))
    centre = -(R.T @ np.array(numbers(shot.get("translation"), 3, f"shot {name!r}: translation")))
    angles = angles_from_rotation(_FLIP @ R)
    pose: list[str | None] = [repr(float(v)) for v in (*centre, *angles)]
    sigma = _accuracy(shot)
    if other_system:
        return Row([name, cameras[camera], *[None] * 12], file.line(name))
    if sigma is None:
        return Row([name, cameras[camera], *pose, *[None] * 6], file.line(name))
    position = numbers(shot.get("gps_position"), 3, f"shot {name!r}: gps_position")
    given = [repr(v) for v in position]
    return Row([name, cameras[camera], *given, *pose[3:], *[repr(sigma)] * 3, *pose[:3]], file.line(name))


def _accuracy(shot: dict[str, Any]) -> float | None:
    """σ of the position of a shot, where it has one."""
    if not isinstance(shot.get("gps_position"), list) or "gps_dop" not in shot:
        return None
    sigma = number(shot["gps_dop"], "gps_dop")
    return sigma if 0.0 < sigma < _DOP else None


def _put_points(points: dict[str, Any], file: JsonFile, control: Control, draft: Draft) -> None:
    names, xyz = [], []
    for name, content in points.items():
        try:
            found = mapping(content, f"point {name!r}").get("coordinates")
            xyz.append(numbers(found, 3, f"point {name!r}: coordinates"))
            names.append(name)
        except Wrong as error:
            draft.problem(str(error), file.line(name))
    values = np.array(xyz).reshape(-1, 3)
    columns = {} if control.own_system else dict(zip("xyz", values.T, strict=True))
    if names:
        frame = pl.DataFrame({"id": pl.Series(names, dtype=pl.String), **columns})
        draft.frame("points", "reconstruction points", frame)
    if control.ids:
        draft.data.setdefault("points", []).append(control.table)


def _put_tracks(
    path: Path,
    shots: set[str],
    points: set[str],
    cameras: dict[str, str],
    described: dict[str, Any],
    control: Control,
    draft: Draft,
) -> None:
    if not path.is_file():
        draft.problem("this file does not exist: the image points", file=str(path))
        return
    sizes = _sizes(described, cameras, draft)
    lost: Counter[str] = Counter()
    rows: list[tuple[str, str, float, float]] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        if not text.strip() or text.startswith(_VERSION):
            continue
        cells = text.split("\t")
        try:
            if len(cells) < 5:
                raise Wrong(f"found {len(cells)} columns, expected image, track, feature, x, y …, by tabs")
            x, y = (_coordinate(cell) for cell in cells[3:5])
        except Wrong as error:
            draft.problem(str(error), line, str(path))
            continue
        image, point = cells[0], cells[1].strip()
        if image not in shots or point not in points:
            lost["image" if image not in shots else "track"] += 1
        elif image in sizes:
            side, width, height = sizes[image]
            rows.append((image, point, x * side + width / 2.0, y * side + height / 2.0))
    for what, count in lost.items():
        draft.note(
            f"{counted(count, 'image point')} not read: their {what} is not reconstructed", file=str(path)
        )
    rows += [(image, point, u, v) for image, point, u, v in control.rays if image in sizes]
    if not rows:
        draft.problem("there are no image points of reconstructed images and points", file=str(path))
        return
    frame = pl.DataFrame(rows, schema=["image", "point", "x", "y"], orient="row")
    draft.frame("observations", "tracks", frame, type="image", units="px", values={"sigma": "1"})
    draft.note(
        "σ = 1 px for all image points; the scale of features, by which OpenSfM weighs, is not read",
        file=str(path),
    )


def _coordinate(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e9:
        raise Wrong(f"found {cell!r}, expected a number")
    return value


def _sizes(
    shots: dict[str, Any], cameras: dict[str, str], draft: Draft
) -> dict[str, tuple[float, float, float]]:
    """Longer side, width and height (px) of each image."""
    sizes = {}
    for name, shot in shots.items():
        camera = draft.data["cameras"].get(
            cameras.get(str(shot.get("camera")) if isinstance(shot, dict) else "", "")
        )
        if camera is not None:
            width, height = (float(camera["image"][key]) for key in ("width", "height"))
            sizes[name] = max(width, height), width, height
    return sizes


def _note_reference(whole: dict[str, Any], draft: Draft) -> None:
    reference = whole.get("reference_lla")
    if isinstance(reference, dict) and any(reference.values()):
        words = ", ".join(f"{key} {value}" for key, value in reference.items())
        draft.note(f"coordinates are east, north, up of the reference point: {words}")
    if whole.get("rig_instances") and len(whole.get("rig_cameras") or ()) > 1:
        draft.note("rigs are read as single images")
