"""OpenSfM reconstructions and lists of ground control points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from mor.errors import InputError, Message, counted
from mor.formats.content import content_of, frames, image_points, not_carried, points
from mor.formats.draft import FLIP, Draft, JsonFile, Row, Written, Wrong, json_number, mapping, numbers, read_lines
from mor.formats.recognition import ControlMeasurements, read_control
from mor.model.rotations import angles_from_rotation, exponential
from mor.project.document import Document

# ---- OpenSfM's cameras in mor's: where both say exactly the same.
#
# OpenSfM's image coordinates count from the image centre, x right, y down, in units of the longer side s of
# the image; its camera axes are right, down, forward (OpenSfM documentation, "Geometric Models"). With focal
# length f, c = f s, and px from the upper left corner u = s x + w/2, v = s y + h/2.

Numbers = Mapping[str, float]


def camera_of(name: str, given: dict[str, Any]) -> dict[str, Any]:
    """A camera as a project file says it. Raises :class:`Wrong` if mor has no model that says the same."""
    kind = str(given.get("projection_type", "perspective"))
    # Projection types; OpenSfM's fisheye has one focal length and its principal point in the centre, which is told.
    kinds = {
        "perspective": _perspective,
        "brown": _opencv("k1", "k2", "p1", "p2", "k3"),
        "radial": _opencv("k1", "k2"),
        "simple_radial": _opencv("k1"),
        "fisheye": _opencv("k1", "k2", model="fisheye"),
        "fisheye_opencv": _opencv("k1", "k2", "k3", "k4", model="fisheye"),
    }
    if kind not in kinds:
        words = f"projection type {kind!r} has no counterpart in mor that says exactly the same"
        raise Wrong(f"camera {name!r}: {words} (known: {', '.join(kinds)})")
    values = {
        key: json_number(value, f"camera {name!r}: {key}")
        for key, value in given.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool)
    }
    width, height = (values.get(key, 0.0) for key in ("width", "height"))
    if not (0.0 < width < 1e6 and 0.0 < height < 1e6):
        raise Wrong(f"camera {name!r}: found no width and height above 0")
    model, interior = kinds[kind](values, max(width, height), width, height)
    first = next(iter(interior.values()))
    if not 1e-9 < first < 1e12:
        raise Wrong(f"camera {name!r}: found the focal length {first:g} px, expected it above 0")
    return {
        "model": model,
        "unit": "px",
        "coordinates": "corner",
        "image": {"width": f"{width:.0f}", "height": f"{height:.0f}"},
        "interior": {key: {"free": repr(value)} for key, value in interior.items()},
    }


Interior = tuple[str, dict[str, float]]


def _perspective(values: Numbers, side: float, width: float, height: float) -> Interior:
    c = values.get("focal", 0.0) * side
    square = c * c or 1.0
    radial = {"A1": values.get("k1", 0.0) / square, "A2": values.get("k2", 0.0) / square**2}
    return "mor", {"c": c, **radial}


def _opencv(*names: str, model: str = "opencv") -> Callable[[Numbers, float, float, float], Interior]:
    def interior(values: Numbers, side: float, width: float, height: float) -> Interior:
        fx = values.get("focal_x", values.get("focal", 0.0))
        focal = {
            "fx": fx * side,
            "fy": values.get("focal_y", fx) * side,
            "cx": values.get("c_x", 0.0) * side + width / 2.0,
            "cy": values.get("c_y", 0.0) * side + height / 2.0,
        }
        return model, {**focal, **{name: values.get(name, 0.0) for name in names}}

    return interior


# ---- Control of an image block as OpenDroneMap's ``gcp_list.txt``, with its image points.


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
    # First line of the file, which OpenDroneMap refuses as it is: a project does not know its coordinate system.
    system = "EPSG:?"
    lines, lost = [system], 0
    for image, point, (x, y) in zip(rays.images, rays.points, rays.xy.tolist(), strict=True):
        lost += point not in control
        if point in control:
            lines.append(f"{control[point]} {x - 0.5!r} {y - 0.5!r} {image} {point}")
    odd = [name for name in (*control, *found.ids) if any(sign.isspace() for sign in name)]
    if odd or len(lines) == 1:
        words = f"{odd[0]!r}: names in a gcp_list.txt have no blanks" if odd else "no image shows a control point"
        raise InputError([Message(words, document.file)])
    notes = not_carried(content, ("image",), (), "gcp_list.txt")
    words = f"line 1 says {system}: put the coordinate system of the control there, as EPSG:25832 or WGS84 UTM 32N"
    notes.append(Message(words, str(target), 1))
    if lost:
        words = f"{counted(lost, 'image point')} of points without control in plan, σ, cameras, poses: not written"
        notes.append(Message(words, str(target)))
    return Written({target: ("\n".join(lines) + "\n").encode()}, notes)


# ---- Read camera priors of OpenSfM (``camera_models.json``), with σ from ``config.yaml`` or its defaults.
#
# OpenSfM's own bundle adjustment observes every interior parameter: focal lengths with a relative σ, all
# others in its own units (OpenSfM source, ``config.py`` and ``bundle_adjuster.cc``).

_SIGMA = {
    **dict.fromkeys(("exif_focal_sd", "principal_point_sd"), 0.01),
    **{f"radial_distortion_k{k}_sd": 0.01 for k in (1, 2, 3, 4)},
    **{f"tangential_distortion_p{k}_sd": 0.01 for k in (1, 2)},
}
"""OpenSfM's defaults."""


def with_priors(cameras: dict[str, dict[str, Any]], folder: Path, draft: Draft) -> dict[str, dict[str, Any]]:
    """Cameras (by OpenSfM's name) whose interior is observed where ``camera_models.json`` has them."""
    path = folder / "camera_models.json"
    if not path.is_file():
        return cameras
    file = JsonFile(path)
    sigma = {**_SIGMA, **_configured(folder / "config.yaml", draft)}
    result = dict(cameras)
    for name, camera in cameras.items():
        given = file.data.get(name) if isinstance(file.data, dict) else None
        if given is None:
            continue
        try:
            prior = camera_of(name, mapping(given, f"camera {name!r}"))
        except Wrong as error:
            draft.problem(str(error), file.line(name), file.file)
            continue
        if prior["model"] == camera["model"]:
            result[name] = {**camera, "interior": _observed(camera, prior, sigma)}
            draft.note(
                f"camera {name}: its parameters are observed, as in OpenSfM's own adjustment",
                file.line(name),
                file.file,
            )
    return result


def _configured(path: Path, draft: Draft) -> dict[str, float]:
    found = {}
    for line in read_lines(path, draft) if path.is_file() else ():
        key, _, rest = line.partition(":")
        try:
            value = float(rest.split("#")[0])
        except ValueError:
            continue
        if key.strip() in _SIGMA and 0.0 < value < 1e6:
            found[key.strip()] = value
    return found


def _observed(camera: dict[str, Any], prior: dict[str, Any], sigma: dict[str, float]) -> dict[str, Any]:
    side = max(float(camera["image"][key]) for key in ("width", "height"))
    interior = {}
    for name, setting in camera["interior"].items():
        start, value = setting["free"], prior["interior"][name]["free"]
        known = {"observed": value, "sigma": repr(_sigma_of(name, prior, sigma, side))}
        interior[name] = known if start == value else {**known, "start": start}
    return interior


def _sigma_of(name: str, prior: dict[str, Any], sigma: dict[str, float], side: float) -> float:
    if name in ("c", "fx", "fy"):
        return sigma["exif_focal_sd"] * float(prior["interior"][name]["free"])
    if name in ("cx", "cy"):
        return sigma["principal_point_sd"] * side
    if name in ("A1", "A2"):
        c = float(prior["interior"]["c"]["free"])
        return sigma[f"radial_distortion_k{name[1]}_sd"] / (c * c) ** int(name[1])
    kind = "tangential" if name.startswith("p") else "radial"
    return sigma[f"{kind}_distortion_{name}_sd"]


# ---- An OpenSfM block as a project: east, north, up in metres about its reference point, σ = 1 px.


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
    named = folder / Path(file.file).name.replace("reconstruction", "tracks").replace(".json", ".csv")
    _put_tracks(
        named if named.is_file() else folder / "tracks.csv", set(shots), set(points), cameras, shots, control, draft
    )
    if not weighted and not control.has_coordinates:
        draft.put("datum", "free")
    draft.put("settings", {"undetermined": "leave_out"})
    reference = whole.get("reference_lla")
    if isinstance(reference, dict) and any(reference.values()):
        words = ", ".join(f"{key} {value}" for key, value in reference.items())
        draft.note(f"coordinates are east, north, up of the reference point: {words}")
    if whole.get("rig_instances") and len(whole.get("rig_cameras") or ()) > 1:
        draft.note("rigs are read as single images")
    return draft.finish()


def _largest(file: JsonFile, draft: Draft) -> dict[str, Any]:
    found = file.data if isinstance(file.data, list) else [file.data]
    good = [one for one in found if isinstance(one, dict) and isinstance(one.get("shots"), dict)]
    if not good:
        raise InputError([Message("expected a list of reconstructions with shots, cameras, points", file.file, 1)])
    good.sort(key=lambda one: -len(one["shots"]))
    if len(good) > 1:
        shots = sum(len(one["shots"]) for one in good[1:])
        words = f"{len(good)} reconstructions that nothing ties: only the largest is read, without {shots} images"
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
        if content.get("projection_type") == "fisheye":
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


def _image(name: str, shot: dict[str, Any], cameras: dict[str, str], file: JsonFile, other_system: bool) -> Row:
    camera = str(shot.get("camera"))
    if camera not in cameras:
        raise Wrong(f"shot {name!r}: camera {camera!r} is not among the cameras")
    R = exponential(np.array(numbers(shot.get("rotation"), 3, f"shot {name!r}: rotation")))
    centre = -(R.T @ np.array(numbers(shot.get("translation"), 3, f"shot {name!r}: translation")))
    angles = angles_from_rotation(FLIP @ R)
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
    sigma = json_number(shot["gps_dop"], "gps_dop")
    # Accuracies of positions of images beyond this (m) stand for none: OpenSfM writes 999999.
    return sigma if 0.0 < sigma < 1000.0 else None


def _put_tracks(
    path: Path,
    shots: set[str],
    points: set[str],
    cameras: dict[str, str],
    described: dict[str, Any],
    control: ControlMeasurements,
    draft: Draft,
) -> None:
    if not path.is_file():
        draft.problem("this file does not exist: the image points", file=str(path))
        return
    sizes = _sizes(described, cameras, draft)
    lost: Counter[str] = Counter()
    rows: list[tuple[str, str, float, float]] = []
    for line, text in enumerate(read_lines(path, draft), start=1):
        if not text.strip() or text.startswith("OPENSFM_TRACKS_VERSION"):
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
        draft.note(f"{counted(count, 'image point')} not read: their {what} is not reconstructed", file=str(path))
    rows += [(image, point, u, v) for image, point, u, v in control.rays if image in sizes]
    if not rows:
        draft.problem("there are no image points of reconstructed images and points", file=str(path))
        return
    frame = pl.DataFrame(rows, schema=["image", "point", "x", "y"], orient="row")
    draft.frame("observations", "tracks", frame, type="image", units="px", values={"sigma": "1"})
    draft.note(
        "σ = 1 px for all image points; the scale of features, by which OpenSfM weighs, is not read", file=str(path)
    )


def _coordinate(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1e9:
        raise Wrong(f"found {cell!r}, expected a number")
    return value


def _sizes(shots: dict[str, Any], cameras: dict[str, str], draft: Draft) -> dict[str, tuple[float, float, float]]:
    """Longer side, width and height (px) of each image."""
    sizes = {}
    for name, shot in shots.items():
        camera = draft.data["cameras"].get(cameras.get(str(shot.get("camera")) if isinstance(shot, dict) else "", ""))
        if camera is not None:
            width, height = (float(camera["image"][key]) for key in ("width", "height"))
            sizes[name] = max(width, height), width, height
    return sizes
