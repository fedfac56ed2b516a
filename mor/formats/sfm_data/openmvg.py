"""openMVG's ``sfm_data.json``, version 0.3: views, intrinsics, extrinsics, structure.

Rotations stand row by row and take object to camera axes; principal points count from the upper left corner, px.
Source: openMVG, ``sfm/sfm_data_io_cereal.cpp`` and ``cameras/Camera_*_io.hpp``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mor.formats.draft import Draft
from mor.formats.json_text import JsonFile, Wrong, mapping
from mor.formats.sfm_data.block import DISTORTIONS, Block, entries, plain, plain_list
from mor.project.file.nodes import Document

_KINDS = {
    "pinhole": ("", ""),
    "pinhole_radial_k1": ("radial1", "disto_k1"),
    "pinhole_radial_k3": ("radial3", "disto_k3"),
    "pinhole_brown_t2": ("brown", "disto_t2"),
    "fisheye": ("fisheye4", "fisheye"),
}
"""Kind of distortion, and the key of its parameters, by the name of a model."""
_NEW = 1 << 31
"""Added to the number of a model where its name is said for the first time."""


def read_openmvg(path: Path) -> Document:
    """The project of a file. Raises :class:`InputError` with every mistake found."""
    file = JsonFile(path)
    draft = Draft(file.file)
    block = Block(file, draft)
    whole: dict[str, Any] = file.data if isinstance(file.data, dict) else {}
    models: dict[int, str] = {}
    for entry in entries(whole.get("intrinsics")):
        _tried(block, entry, lambda block, entry: _camera(block, entry, models))
    poses = {str(entry.get("key")): entry.get("value") for entry in entries(whole.get("extrinsics"))}
    for entry in entries(whole.get("views")):
        _tried(block, entry, lambda block, entry: _image(block, entry, poses))
    for entry in entries(whole.get("structure")):
        _tried(block, entry, _point)
    block.left_out["control points"] += len(list(entries(whole.get("control_points"))))
    block.finish(path.resolve().parent.name if path.stem == "sfm_data" else path.stem)
    return draft.finish()


def _tried(block: Block, entry: dict[str, Any], read: Any) -> None:
    try:
        read(block, entry)
    except Wrong as error:
        name = str(error).split("'")[1] if "'" in str(error) else ""
        block.draft.problem(str(error), block.file.line(name))


def _data(entry: dict[str, Any], what: str) -> dict[str, Any]:
    """Content of an entry. Raises :class:`Wrong`."""
    wrapper = mapping(mapping(entry.get("value"), what).get("ptr_wrapper"), f"{what}: ptr_wrapper")
    return mapping(wrapper.get("data"), f"{what}: data")


def _camera(block: Block, entry: dict[str, Any], models: dict[int, str]) -> None:
    name = str(entry.get("key"))
    what = f"intrinsic {name}"
    value = mapping(entry.get("value"), what)
    number = int(plain(value.get("polymorphic_id", 0), f"{what}: polymorphic_id"))
    if "polymorphic_name" in value:
        models[number % _NEW] = str(value["polymorphic_name"])
    model = models.get(number % _NEW, "")
    if model not in _KINDS:
        words = f"{what}: model {model!r} has no counterpart in mor that says exactly the same"
        raise Wrong(f"{words} (known: {', '.join(_KINDS)})")
    data = _data(entry, what)
    size = [plain(data.get(key), f"{what}: {key}") for key in ("width", "height")]
    kind, key = _KINDS[model]
    names = DISTORTIONS[kind]
    values = plain_list(data.get(key), len(names), f"{what}: {key}") if names else []
    focal = plain(data.get("focal_length"), f"{what}: focal_length")
    centre = plain_list(data.get("principal_point"), 2, f"{what}: principal_point")
    block.add_camera(name, size, focal, centre, dict(zip(names, values, strict=True)), False)


def _image(block: Block, entry: dict[str, Any], poses: dict[str, Any]) -> None:
    data = _data(entry, f"view {entry.get('key')}")
    view = str(data.get("id_view", entry.get("key")))
    name = str(data.get("filename", "")).strip() or view
    if data.get("use_pose_center_prior") or data.get("use_pose_rotation_prior"):
        block.left_out["prior positions of images"] += 1
    pose = poses.get(str(data.get("id_pose")))
    if pose is None:
        block.left_out["images without a pose"] += 1
        return
    given = mapping(pose, f"pose of {name!r}")
    rows = given.get("rotation")
    rotation = [
        plain_list(row, 3, f"pose of {name!r}: rotation") for row in (rows if isinstance(rows, list) else [])
    ]
    if len(rotation) != 3:
        raise Wrong(f"pose of {name!r}: rotation: expected three rows of three numbers")
    centre = plain_list(given.get("center"), 3, f"pose of {name!r}: center")
    block.add_image(view, name, str(data.get("id_intrinsic")), np.array(rotation), centre)


def _point(block: Block, entry: dict[str, Any]) -> None:
    name = str(entry.get("key"))
    if name in block.points:
        raise Wrong(f"point {name!r} is there twice")
    value = mapping(entry.get("value"), f"point {name!r}")
    block.points[name] = plain_list(value.get("X"), 3, f"point {name!r}: X")
    for seen in entries(value.get("observations")):
        what = f"point {name!r}: observations"
        block.add_ray(
            str(seen.get("key")), name, plain_list(mapping(seen.get("value"), what).get("x"), 2, what)
        )
