"""AliceVision's and Meshroom's ``.sfm`` and ``.json``: versions 1.0 to 1.2, where every number is a text.

Rotations stand column by column and take object to camera axes. Before version 1.2.1 the principal point counts from
the upper left corner, since then from the image centre; focal lengths are px (``pxFocalLength``) or mm with the width
of the sensor. Source: AliceVision, ``sfmDataIO/jsonIO.cpp``.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from mor.formats.draft import Draft
from mor.formats.json_text import JsonFile, Wrong, mapping
from mor.formats.sfm_data.block import DISTORTIONS, Block, entries, plain, plain_list
from mor.project.file.nodes import Document

_FROM_THE_CENTRE = (1, 2, 1)
"""First version whose principal points count from the image centre."""
_NAMES = {"pinhole": "", "radialk1": "radial1", "radialk3": "radial3", "none": ""}


def read_alicevision(path: Path) -> Document:
    """The project of a file. Raises :class:`InputError` with every mistake found."""
    file = JsonFile(path)
    draft = Draft(file.file)
    block = Block(file, draft)
    whole: dict[str, Any] = file.data if isinstance(file.data, dict) else {}
    try:
        version = tuple(int(v) for v in plain_list(whole.get("version"), 3, "version"))
    except Wrong as error:
        draft.problem(str(error), max(file.line("version"), 1))
        return draft.finish()
    for what, read in (("intrinsics", _camera), ("views", _image), ("structure", _point)):
        context = version if what == "intrinsics" else _poses(whole, draft) if what == "views" else None
        for entry in entries(whole.get(what)):
            try:
                read(block, entry, context)
            except Wrong as error:
                draft.problem(str(error), file.line(_number_of(entry)))
    if entries(whole.get("controlPoints")):
        block.left_out["control points"] += len(list(entries(whole.get("controlPoints"))))
    block.finish(path.stem)
    return draft.finish()


def _number_of(entry: dict[str, Any]) -> str:
    return str(
        next((entry[key] for key in ("intrinsicId", "viewId", "poseId", "landmarkId") if key in entry), "")
    )


def _camera(block: Block, given: dict[str, Any], version: Any) -> None:
    name = str(given.get("intrinsicId", ""))
    what = f"intrinsic {name}"
    size = [plain(given.get(key), f"{what}: {key}") for key in ("width", "height")]
    kind = str(given.get("distortionType") or given.get("type"))
    kind = _NAMES.get(kind, kind)
    if kind not in DISTORTIONS or str(given.get("type")) == "equidistant":
        known = ", ".join(name for name in DISTORTIONS if name)
        raise Wrong(
            f"{what}: type {kind!r} has no counterpart in mor that says exactly the same (known: {known})"
        )
    focal = _focal_length(given, size, what)
    centre = plain_list(given.get("principalPoint"), 2, f"{what}: principalPoint")
    if version >= _FROM_THE_CENTRE:
        centre = [offset + length / 2.0 for offset, length in zip(centre, size, strict=True)]
    names = DISTORTIONS[kind]
    params = given.get("distortionParams") or []
    params = params if isinstance(params, list) else [params]
    values = [plain(value, f"{what}: distortionParams") for value in params]
    if len(values) != len(names):
        raise Wrong(
            f"{what}: found {len(values)} distortionParams, expected {len(names)} for {kind or 'pinhole'}"
        )
    locked = str(given.get("locked", "0")).lower() in ("1", "true")
    block.add_camera(name, size, focal, centre, dict(zip(names, values, strict=True)), locked)


def _focal_length(given: dict[str, Any], size: list[float], what: str) -> float:
    """px. Raises :class:`Wrong`."""
    if plain(given.get("pixelRatio", 1), f"{what}: pixelRatio") != 1.0:
        raise Wrong(f"{what}: found the pixelRatio {given['pixelRatio']}, expected pixels that are squares")
    if "pxFocalLength" in given:
        value = given["pxFocalLength"]
        both = value if isinstance(value, list) else [value, value]
        fx, fy = plain_list(both, 2, f"{what}: pxFocalLength")
        if fx != fy:
            raise Wrong(f"{what}: found two focal lengths, {fx:g} and {fy:g} px, expected one")
        return fx
    width = plain(given.get("sensorWidth"), f"{what}: sensorWidth")
    if width <= 0.0:
        raise Wrong(f"{what}: found the sensorWidth {width:g} mm, expected it above 0")
    return plain(given.get("focalLength"), f"{what}: focalLength") * size[0] / width


def _poses(whole: dict[str, Any], draft: Draft) -> dict[str, dict[str, Any]]:
    if list(entries(whole.get("rigs"))):
        draft.note("rigs are not read: images of rigs without a pose of their own are left out")
    return {str(one.get("poseId")): one for one in entries(whole.get("poses"))}


def _image(block: Block, view: dict[str, Any], poses: Any) -> None:
    number = str(view.get("viewId", ""))
    pose = poses.get(str(view.get("poseId", "")))
    if pose is None or "rigId" in view:
        block.left_out["images without a pose"] += 1
        return
    name = PurePosixPath(str(view.get("path", "")).replace("\\", "/")).name.strip() or number
    transform = mapping(mapping(pose.get("pose"), f"pose of {name!r}").get("transform"), f"pose of {name!r}")
    rotation = (
        np.array(plain_list(transform.get("rotation"), 9, f"pose of {name!r}: rotation")).reshape(3, 3).T
    )
    centre = plain_list(transform.get("center"), 3, f"pose of {name!r}: center")
    block.add_image(number, name, str(view.get("intrinsicId", "")), rotation, centre)


def _point(block: Block, landmark: dict[str, Any], _: Any) -> None:
    name = str(landmark.get("landmarkId", ""))
    if name in block.points:
        raise Wrong(f"landmark {name!r} is there twice")
    block.points[name] = plain_list(landmark.get("X"), 3, f"landmark {name!r}: X")
    for seen in entries(landmark.get("observations")):
        if "x" not in seen:
            block.left_out["image points without coordinates (saved without features)"] += 1
            continue
        xy = plain_list(seen["x"], 2, f"landmark {name!r}: x")
        block.add_ray(str(seen.get("observationId", "")), name, xy)
