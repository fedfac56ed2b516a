"""Read AliceVision files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import polars as pl

from mor.errors import counted
from mor.formats.draft import FLIP, Draft, JsonFile, Row, Wrong, mapping
from mor.model.rotations import angles_from_rotation
from mor.project.document import Document
from mor.types import FloatArray

# ---- Build a project from cameras with one focal length, poses, and points with their image points.
#
# Camera axes are right, down, forward, x = R (X − C); image coordinates are px, y down, as the program's own
# centre of the image, width/2 and height/2, counts them. Distortion is that of OpenCV: at the ideal
# coordinates, added.


@dataclass
class BlockBuilder:
    """A block in the making."""

    file: JsonFile
    draft: Draft
    cameras: dict[str, dict[str, Any]] = field(default_factory=dict)
    images: dict[str, str] = field(default_factory=dict)
    """Names of images with a pose, by the numbers of their views."""
    rows: list[Row] = field(default_factory=list)
    points: dict[str, list[float]] = field(default_factory=dict)
    rays: list[tuple[str, str, float, float]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)

    def add_camera(
        self,
        name: str,
        size: Sequence[float],
        focal: float,
        centre: Sequence[float],
        distortion: Mapping[str, float],
        locked: bool,
    ) -> None:
        """A camera: width, height, focal length, principal point from the upper left corner, all px.

        Raises :class:`Wrong` for what is no camera.
        """
        if not (all(1.0 <= length < 1e6 for length in size) and 1e-3 < focal < 1e9):
            raise Wrong(f"camera {name!r}: found the size {size[0]:g} x {size[1]:g} and the focal length {focal:g} px")
        model, values = _interior(size, focal, centre, distortion)
        status = "fixed" if locked else "free"
        self.cameras[name] = {
            "model": model,
            "unit": "px",
            "coordinates": "corner",
            "image": {"width": f"{size[0]:.0f}", "height": f"{size[1]:.0f}"},
            "interior": {key: {status: repr(float(value))} for key, value in values.items()},
        }
        if model == "fisheye":
            words = f"camera {name}: fx and fy are two unknowns, one focal length in the program"
            self.draft.note(words, self.file.line(name))

    def add_image(self, view: str, name: str, camera: str, R: FloatArray, centre: Sequence[float]) -> None:
        """An image with its pose. Raises :class:`Wrong` if that is none."""
        if camera not in self.cameras:
            raise Wrong(f"image {name!r}: camera {camera!r} is not among the cameras")
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0.0:
            raise Wrong(f"image {name!r}: its rotation matrix is not a rotation")
        own = name if name not in self.images.values() else f"{name} ({view})"
        self.images[view] = own
        numbers = [*centre, *angles_from_rotation(FLIP @ R)]
        self.rows.append(Row([own, camera, *(repr(float(v)) for v in numbers)], self.file.line(name)))

    def add_ray(self, view: str, point: str, xy: Sequence[float]) -> None:
        """An image point, px from the upper left corner, y down."""
        image = self.images.get(view)
        if image is None:
            self.left_out["image points of images without a pose"] += 1
        else:
            self.rays.append((image, point, xy[0], xy[1]))

    def finish(self, title: str) -> None:
        """Put everything into the draft."""
        draft = self.draft
        draft.put("title", title)
        draft.put("units", {"length": "m", "angle": "rad"})
        draft.put("axes", {"xy": "en"})
        used = {str(row.cells[1]) for row in self.rows}
        draft.put("cameras", {name: camera for name, camera in self.cameras.items() if name in used})
        if self.rows:
            draft.table("images", ("id", "camera", "x", "y", "z", "omega", "phi", "kappa"), self.rows)
        else:
            draft.problem("there are no images with a pose")
        seen = dict.fromkeys(point for _, point, _, _ in self.rays)
        self.left_out["points that no image with a pose shows"] += len(self.points.keys() - seen.keys())
        for what, count in self.left_out.items():
            if count:
                draft.note(f"not read: {what} ({count})")
        if not self.rays:
            draft.note("the file has no image points: cameras and poses only")
            return
        xyz = np.array([self.points[name] for name in seen])
        ids = pl.Series("id", list(seen), dtype=pl.String)
        draft.frame("points", "structure", pl.DataFrame({"id": ids, **dict(zip("xyz", xyz.T, strict=True))}))
        frame = pl.DataFrame(self.rays, schema=["image", "point", "x", "y"], orient="row")
        draft.frame("observations", "observations", frame, type="image", units="px", values={"sigma": "1"})
        draft.put("datum", "free")
        draft.put("settings", {"undetermined": "leave_out"})
        draft.note(
            f"σ = 1 px for {counted(len(self.rays), 'image point')}; lengths are called m, whatever the block's unit is"
        )


def _interior(
    size: Sequence[float], focal: float, centre: Sequence[float], distortion: Mapping[str, float]
) -> tuple[str, dict[str, float]]:
    """Model and components: model mor, which has one focal length, or a fisheye."""
    if "k4" in distortion:
        return "fisheye", {"fx": focal, "fy": focal, "cx": centre[0], "cy": centre[1], **distortion}
    values = {"c": focal, "xh": centre[0] - size[0] / 2.0, "yh": size[1] / 2.0 - centre[1]}
    values |= {f"A{k}": distortion[f"k{k}"] / focal ** (2 * k) for k in (1, 2, 3) if f"k{k}" in distortion}
    if "p1" in distortion:
        values |= {"B1": distortion["p2"] / focal, "B2": -distortion["p1"] / focal}
    return "mor", values


def plain(value: Any, what: str) -> float:
    """A finite number, also one that is written as a text. Raises :class:`Wrong`."""
    try:
        number = float(value) if isinstance(value, (int, float, str)) and not isinstance(value, bool) else np.nan
    except (ValueError, OverflowError):
        number = np.nan
    if not abs(number) < 1e30 or (isinstance(value, str) and "_" in value):
        raise Wrong(f"{what}: found {value!r:.60}, expected a number")
    return float(number)


def plain_list(value: Any, count: int, what: str) -> list[float]:
    """So many numbers. Raises :class:`Wrong`."""
    found = list(value) if isinstance(value, list) else []
    if len(found) != count:
        raise Wrong(f"{what}: found {value!r:.60}, expected a list of {count} numbers")
    return [plain(one, what) for one in found]


def entries(value: Any) -> Iterable[dict[str, Any]]:
    """The mappings of a list; nothing if it is none."""
    return (one for one in value if isinstance(one, dict)) if isinstance(value, list) else ()


# ---- AliceVision's and Meshroom's ``.sfm`` and ``.json``: versions 1.0 to 1.2, where every number is a text.
#
# Rotations stand column by column and take object to camera axes. Before version 1.2.1 the principal point
# counts from the upper left corner, since then from the image centre; focal lengths are px
# (``pxFocalLength``) or mm with the width of the sensor. Source: AliceVision, ``sfmDataIO/jsonIO.cpp``.


def read_alicevision(path: Path) -> Document:
    """The project of a file. Raises :class:`InputError` with every mistake found."""
    file = JsonFile(path)
    draft = Draft(file.file)
    block = BlockBuilder(file, draft)
    whole: dict[str, Any] = file.data if isinstance(file.data, dict) else {}
    try:
        version = tuple(int(v) for v in plain_list(whole.get("version"), 3, "version"))
    except Wrong as error:
        draft.problem(str(error), max(file.line("version"), 1))
        return draft.finish()
    for what, read in (
        ("intrinsics", _alicevision_camera),
        ("views", _alicevision_image),
        ("structure", _alicevision_point),
    ):
        context = version if what == "intrinsics" else _poses(whole, draft) if what == "views" else None
        for entry in entries(whole.get(what)):
            try:
                read(block, entry, context)
            except Wrong as error:
                keys = ("intrinsicId", "viewId", "poseId", "landmarkId")
                number = next((entry[key] for key in keys if key in entry), "")
                draft.problem(str(error), file.line(str(number)))
    if entries(whole.get("controlPoints")):
        block.left_out["control points"] += len(list(entries(whole.get("controlPoints"))))
    block.finish(path.stem)
    return draft.finish()


def _alicevision_camera(block: BlockBuilder, given: dict[str, Any], version: Any) -> None:
    name = str(given.get("intrinsicId", ""))
    what = f"intrinsic {name}"
    size = [plain(given.get(key), f"{what}: {key}") for key in ("width", "height")]
    kind = str(given.get("distortionType") or given.get("type"))
    kind = {"pinhole": "", "radialk1": "radial1", "radialk3": "radial3", "none": ""}.get(kind, kind)
    # Parameters of each kind of distortion, in the order of the files.
    distortions = {
        "": (),
        "radial1": ("k1",),
        "radial3": ("k1", "k2", "k3"),
        "brown": ("k1", "k2", "k3", "p1", "p2"),
        "fisheye4": ("k1", "k2", "k3", "k4"),
    }
    if kind not in distortions or str(given.get("type")) == "equidistant":
        known = ", ".join(name for name in distortions if name)
        raise Wrong(f"{what}: type {kind!r} has no counterpart in mor that says exactly the same (known: {known})")
    focal = _focal_length(given, size, what)
    centre = plain_list(given.get("principalPoint"), 2, f"{what}: principalPoint")
    # First version whose principal points count from the image centre.
    if version >= (1, 2, 1):
        centre = [offset + length / 2.0 for offset, length in zip(centre, size, strict=True)]
    names = distortions[kind]
    params = given.get("distortionParams") or []
    params = params if isinstance(params, list) else [params]
    values = [plain(value, f"{what}: distortionParams") for value in params]
    if len(values) != len(names):
        raise Wrong(f"{what}: found {len(values)} distortionParams, expected {len(names)} for {kind or 'pinhole'}")
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


def _alicevision_image(block: BlockBuilder, view: dict[str, Any], poses: Any) -> None:
    number = str(view.get("viewId", ""))
    pose = poses.get(str(view.get("poseId", "")))
    if pose is None or "rigId" in view:
        block.left_out["images without a pose"] += 1
        return
    name = PurePosixPath(str(view.get("path", "")).replace("\\", "/")).name.strip() or number
    transform = mapping(mapping(pose.get("pose"), f"pose of {name!r}").get("transform"), f"pose of {name!r}")
    rotation = np.array(plain_list(transform.get("rotation"), 9, f"pose of {name!r}: rotation")).reshape(3, 3).T
    centre = plain_list(transform.get("center"), 3, f"pose of {name!r}: center")
    block.add_image(number, name, str(view.get("intrinsicId", "")), rotation, centre)


def _alicevision_point(block: BlockBuilder, landmark: dict[str, Any], _: Any) -> None:
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
