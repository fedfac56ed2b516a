"""An image block as Metashape's XML: sensors, cameras, and points as markers with their projections."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from mor.errors import InputError, Problem
from mor.formats.colmap.cameras import MODELS, camera_from
from mor.formats.content import (
    Block,
    Content,
    block,
    content_of,
    frames,
    interior_values,
    not_carried,
)
from mor.formats.metashape.sensors import NAMES
from mor.formats.written import Written
from mor.geometry.rotations import rotation_from_angles
from mor.project.edge import image_scale, split
from mor.project.file.model import Camera
from mor.project.file.model_instruments import Value
from mor.project.file.nodes import Document

_FLIP = np.diag([1.0, -1.0, -1.0])


def write_metashape(document: Document, folder: Path, target: Path) -> Written:
    """One XML file. Raises :class:`InputError` for cameras that Metashape cannot say, and images without a pose."""
    content = content_of(document, folder)
    problems: list[Problem] = []
    sensors = []
    for number, (name, camera) in enumerate(content.project.cameras.items()):
        try:
            sensors.append(_sensor(number, name, camera, content))
        except ValueError as error:
            problems.append(content.place("cameras", name).problem(f"camera {name}: {error}"))
    found = frames(content, "Metashape's XML")
    if np.isnan(found.values).any():
        words = "there are images without a pose of their own; convert an adjusted project (adjusted.yaml)"
        problems.append(Problem(words, document.file))
    if problems:
        raise InputError(problems)
    names = list(content.project.cameras)
    cameras = [
        f'<camera id="{k}" sensor_id="{names.index(found.texts["camera"][k])}" label={quoteattr(name)} enabled="true">'
        f"<transform>{_transform(found.values[k])}</transform></camera>"
        for k, name in enumerate(found.ids)
    ]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<document version="2.0.0">',
        f'<chunk label={quoteattr(content.project.title or "mor")} enabled="true">',
        "<sensors>", *sensors, "</sensors>",
        "<cameras>", *cameras, "</cameras>",
        *_markers(block(content, "Metashape's XML", found)),
        "</chunk>", "</document>",
    ]  # fmt: skip
    notes = not_carried(content, ("image",), (), "Metashape's XML")
    notes.append(Problem("points are written as markers; σ of image points have no place", str(target)))
    return Written({target: ("\n".join(lines) + "\n").encode()}, notes)


def _transform(pose: np.ndarray) -> str:
    """Camera axes (right, down, forward) to the object system, row by row."""
    T = np.eye(4)
    T[:3, :3] = rotation_from_angles(pose[3:]).T @ _FLIP
    T[:3, 3] = pose[:3]
    return " ".join(repr(v) for v in T.ravel().tolist())


def _sensor(number: int, name: str, camera: Camera, content: Content) -> str:
    values, free = interior_of(camera, content)
    if camera.image is None:
        raise ValueError("it has no image: {width, height}, which Metashape needs")
    width, height = (round(split(text)[0]) for text in (camera.image.width, camera.image.height))
    size = f'<resolution width="{width}" height="{height}"/>'
    numbers = "".join(f"<{key}>{value!r}</{key}>" for key, value in values.items())
    params = f"<covariance><params>{' '.join(free)}</params></covariance>" if free else ""
    fixed = "false" if free else "true"
    return (
        f'<sensor id="{number}" label={quoteattr(name)} type="frame">{size}<property name="fixed" value="{fixed}"/>'
        f'<calibration type="frame" class="adjusted">{size}{numbers}{params}</calibration></sensor>'
    )


def interior_of(camera: Camera, content: Content) -> tuple[dict[str, float], list[str]]:
    """Metashape's numbers and the names of the free ones. Raises ``ValueError`` where they say something else."""
    free = [
        k for k, s in camera.interior.items() if isinstance(s, Value) and s.fixed is None and s.sigma != "0"
    ]
    if camera.model == "metashape":
        scale = image_scale(camera, content.project.units)
        pixel = 1.0 if np.isnan(scale.pixel) else scale.pixel
        given = interior_values(camera, content.edge, scale)
        values = {name: value / (pixel if name in NAMES[:5] else 1.0) for name, value in given.items()}
        return values, free
    theirs = camera_from(1, camera, content.edge, "Metashape")
    given = dict(zip(MODELS[theirs.model].parameters, theirs.parameters, strict=True))
    if theirs.model == "OPENCV_FISHEYE" or any(given.get(f"k{k}") for k in (4, 5, 6)):
        raise ValueError("Metashape's frame camera cannot say the same")
    fy = given.get("fy", given.get("f", 0.0))
    values = {"f": fy, "cx": given["cx"] - theirs.width / 2.0, "cy": given["cy"] - theirs.height / 2.0}
    values["b1"] = given.get("fx", fy) - fy
    values.update({k: given[k] for k in ("k1", "k2", "k3") if k in given})
    values.update({"p1": given.get("p2", 0.0), "p2": given.get("p1", 0.0)} if "p1" in given else {})
    held = not free
    return values, [] if held else [k for k in values if k not in ("cx", "cy", "b1") or values[k]]


def _markers(whole: Block) -> list[str]:
    found, rays, ids = whole.points, whole.rays, whole.images.ids
    lines = ["<markers>"]
    for k, name in enumerate(found.ids):
        known = (~found.statuses.free[k] | np.isfinite(found.statuses.sigma[k])).all()
        reference = ""
        if np.isfinite(found.values[k]).all():
            sigma = np.nan_to_num(found.statuses.sigma[k]).tolist()
            numbers = found.statuses.values[k] if known else found.values[k]
            inside = [f'{axis}="{value!r}"' for axis, value in zip("xyz", numbers.tolist(), strict=True)]
            inside += (
                [f's{axis}="{value!r}"' for axis, value in zip("xyz", sigma, strict=True)] if known else []
            )
            reference = f'<reference {" ".join(inside)} enabled="{"true" if known else "false"}"/>'
        lines.append(f'<marker id="{k}" label={quoteattr(name)}>{reference}</marker>')
    lines += ["</markers>", '<frames><frame id="0"><markers>']
    image, point = ({name: k for k, name in enumerate(names)} for names in (ids, found.ids))
    seen: dict[int, list[str]] = {}
    for a, b, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        location = f'<location camera_id="{image[a]}" pinned="true" x="{x!r}" y="{y!r}"/>'
        seen.setdefault(point[b], []).append(location)
    lines += [f'<marker marker_id="{k}">{"".join(found_)}</marker>' for k, found_ in seen.items()]
    return [*lines, "</markers></frame></frames>"]
