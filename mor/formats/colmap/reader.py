"""Read COLMAP models, binary or text."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.lib.stride_tricks import sliding_window_view

from mor.errors import InputError, Message, counted
from mor.formats.colmap.model import (
    LOST,
    MODELS,
    NO_POINT,
    ColmapCamera,
    ColmapImage,
    ColmapModel,
    QuaternionPose,
    Rig,
    RigFrame,
    Sensor,
    camera_of,
    empty_points,
    has_one_unknown_more,
    ours,
    relative,
)
from mor.formats.draft import Draft, Row, parse_number, read_lines, usable
from mor.formats.recognition import COLMAP_FILES, explain_unknown
from mor.input_files import read_bytes
from mor.model.rotations import angles_from_rotation
from mor.project.document import Document
from mor.types import FloatArray, IntArray

# ---- Rigs of COLMAP as stereo pairs: the images a rig took at one time follow that of its reference camera.


class Follower(NamedTuple):
    """The image that another one follows, and the pair that says how."""

    leader: str
    pair: str


def followers(model: ColmapModel, draft: Draft) -> tuple[list[Row], dict[int, Follower]]:
    """Rows of pairs, and the images by their numbers that follow another one."""
    images = {image.id: image for image in model.images}
    rigs = {rig.id: rig for rig in model.rigs if len(rig.sensors) > 1}
    poses: dict[str, QuaternionPose] = {}
    result: dict[int, Follower] = {}
    for frame in model.frames:
        rig = rigs.get(frame.rig)
        if rig is None:
            continue
        mine = {images[number].camera: images[number] for number in frame.images if number in images}
        leader = mine.get(rig.sensors[0].camera)
        if leader is None:
            draft.note(f"frame {frame.id}: no image of the reference camera of its rig; its images are single")
            continue
        for sensor in rig.sensors[1:]:
            if sensor.camera in mine and sensor.pose is not None:
                pair = f"rig {rig.id} camera {sensor.camera}"
                poses[pair] = sensor.pose
                result[mine[sensor.camera].id] = Follower(leader.name, pair)
    return [_pair(name, pose) for name, pose in poses.items()], result


def _pair(name: str, pose: QuaternionPose) -> Row:
    D, base = relative(pose)
    return Row([name, *(repr(float(v)) for v in (*base, *angles_from_rotation(D)))], 0)


# ---- COLMAP's binary files: little-endian numbers one after the other.

_POINT_SIZE = 51


class Bytes:
    """The content of a file, taken from its beginning to its end."""

    def __init__(self, path: Path):
        self.file, self.content, self.at = str(path), read_bytes(path), 0

    def refuse(self, words: str) -> InputError:
        """Return the error for the position reached in the file."""
        return InputError([Message(f"byte {self.at}: {words}", self.file)])

    def take(self, form: str) -> tuple[int | float, ...]:
        """Numbers of a format of :mod:`struct`. Raises :class:`InputError` if the file ends before."""
        size = struct.calcsize(form)
        self.need(size)
        numbers = struct.unpack_from(form, self.content, self.at)
        self.at += size
        return numbers

    def need(self, size: int) -> None:
        """Raise :class:`InputError` where less than ``size`` bytes are left."""
        left = len(self.content) - self.at
        if size > left:
            raise self.refuse(f"found {left} bytes to the end of the file, expected at least {size} more")

    def count(self, smallest: int) -> int:
        """A number of things that take ``smallest`` bytes each at least."""
        number = int(self.take("<Q")[0])
        self.need(number * smallest)
        return number

    def name(self) -> str:
        """A name up to a zero byte."""
        end = self.content.find(b"\0", self.at)
        if end < 0:
            raise self.refuse("found a name without an end")
        name = self.content[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return name

    def pose(self) -> QuaternionPose:
        """Quaternion and translation."""
        numbers = [float(number) for number in self.take("<7d")]
        return QuaternionPose((numbers[0], numbers[1], numbers[2], numbers[3]), (numbers[4], numbers[5], numbers[6]))

    def finish(self) -> None:
        """Raise :class:`InputError` where something is left."""
        if self.at != len(self.content):
            raise self.refuse(f"found {len(self.content) - self.at} bytes more, expected the end of the file")


def read_cameras(path: Path) -> list[ColmapCamera]:
    """``cameras.bin``."""
    file = Bytes(path)
    numbers = {model.number: name for name, model in MODELS.items()}
    cameras = []
    for _ in range(file.count(24)):
        camera, number, width, height = (int(value) for value in file.take("<IiQQ"))
        if number not in numbers:
            raise file.refuse(f"found camera model {number}, expected one of 0 … {max(numbers)}")
        parameters = file.take(f"<{len(MODELS[numbers[number]].parameters)}d")
        cameras.append(ColmapCamera(camera, numbers[number], width, height, tuple(map(float, parameters))))
    file.finish()
    return cameras


def read_images(path: Path) -> list[ColmapImage]:
    """``images.bin``."""
    file = Bytes(path)
    images = []
    image_point = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
    for _ in range(file.count(73)):
        number = int(file.take("<I")[0])
        pose = file.pose()
        camera, name = int(file.take("<I")[0]), file.name()
        count = file.count(image_point.itemsize)
        found = np.frombuffer(file.content, image_point, count, file.at)
        file.at += count * image_point.itemsize
        images.append(ColmapImage(number, pose, camera, name, found["xy"], found["point"]))
    file.finish()
    return images


def read_points(path: Path) -> tuple[IntArray, FloatArray]:
    """Numbers (n,) and coordinates (n, 3) of ``points3D.bin``; colours, errors and tracks are passed by."""
    file = Bytes(path)
    starts = _starts(file, file.count(_POINT_SIZE))
    file.finish()
    if not len(starts):
        return np.empty(0, dtype=np.int64), np.empty((0, 3))
    content = np.frombuffer(file.content, np.uint8)
    # What is read of a point; its colour (3 bytes) and error (8), the length of its track (8) and the track follow.
    point = np.dtype([("number", "<u8"), ("xyz", "<f8", (3,))])
    found = sliding_window_view(content, point.itemsize)[starts].view(point)[:, 0]
    large = np.flatnonzero(found["number"] >= 1 << 63)
    if len(large):
        file.at = int(starts[large[0]])
        raise file.refuse(f"found point {found['number'][large[0]]}, expected a number below 2⁶³")
    return found["number"].astype(np.int64), found["xyz"].astype(float)


def _starts(file: Bytes, count: int) -> IntArray:
    """(count,) where the points begin: the length of each one's track says where the next one does."""
    content, at, length, end = file.content, file.at, struct.Struct("<Q").unpack_from, len(file.content)
    starts: list[int] = []
    while len(starts) < count and at + _POINT_SIZE <= end:
        starts.append(at)
        at += _POINT_SIZE + 8 * length(content, at + 43)[0]
    if at > end:
        file.at = starts[-1]
        file.need(at - file.at)
    file.at = at
    if len(starts) < count:
        file.need(_POINT_SIZE)
    return np.array(starts, dtype=np.int64)


def read_rigs(path: Path) -> list[Rig]:
    """``rigs.bin``."""
    file = Bytes(path)
    rigs = []
    for _ in range(file.count(8)):
        number, sensors = (int(value) for value in file.take("<II"))
        file.need(max(sensors, 0) * 8)
        members = []
        for k in range(sensors):
            _, camera = file.take("<iI")
            known = k == 0 or bool(file.take("<?")[0])
            members.append(Sensor(int(camera), file.pose() if known and k > 0 else None))
        rigs.append(Rig(number, tuple(members)))
    file.finish()
    return rigs


def read_frames(path: Path) -> list[RigFrame]:
    """``frames.bin``."""
    file = Bytes(path)
    frames = []
    for _ in range(file.count(68)):
        number, rig = (int(value) for value in file.take("<II"))
        file.pose()  # the images have their own
        count = int(file.take("<I")[0])
        file.need(count * 16)
        images = [int(file.take("<iIQ")[2]) for _ in range(count)]
        frames.append(RigFrame(number, rig, tuple(images)))
    file.finish()
    return frames


# ---- COLMAP's text files: a thing a line, an image on two; lines that begin with # are comments.


class LineError(Exception):
    """A line is not what was expected; the words say how."""


def _lines(path: Path, draft: Draft, most: int = -1) -> Iterator[tuple[int, list[str]]]:
    """Lines and their words; what stands behind the first ``most`` is one."""
    for k, line in enumerate(read_lines(path, draft), start=1):
        words = line.split(maxsplit=most)
        if words and not words[0].startswith("#"):
            yield k, words


def _form(words: list[str], least: int, form: str) -> None:
    if len(words) < least:
        raise LineError(f"found {len(words)} words, expected {form}")


def _whole(word: str) -> int:
    if not word.lstrip("-").isdecimal() or len(word) > 19:
        raise LineError(f"found {word!r}, expected a whole number")
    return int(word)


def _pose(words: list[str]) -> QuaternionPose:
    q = [parse_number(word) for word in words]
    return QuaternionPose((q[0], q[1], q[2], q[3]), (q[4], q[5], q[6]))


def read_text_cameras(path: Path, draft: Draft) -> list[ColmapCamera]:
    """``cameras.txt``."""
    cameras = []
    for line, words in _lines(path, draft):
        try:
            _form(words, 4, "number, model, width, height, parameters")
            cameras.append(_camera(words, line))
        except (LineError, ValueError) as error:
            draft.problem(str(error), line, str(path))
    return cameras


def _camera(words: list[str], line: int) -> ColmapCamera:
    name = words[1]
    if name not in MODELS:
        raise LineError(f"found camera model {name!r}, expected one of {', '.join(MODELS)}")
    names = MODELS[name].parameters
    if len(words) != 4 + len(names):
        raise LineError(f"found {len(words) - 4} parameters, expected {len(names)}: {', '.join(names)}")
    size = [_whole(word) for word in (words[0], words[2], words[3])]
    return ColmapCamera(size[0], name, size[1], size[2], tuple(parse_number(word) for word in words[4:]), line)


def read_text_images(path: Path, draft: Draft) -> list[ColmapImage]:
    """``images.txt``: a line with the pose, then one with the image points, which may be empty."""
    images = []
    lines = enumerate(read_lines(path, draft), start=1)
    for line, text in lines:
        words = text.split(maxsplit=9)
        if not words or words[0].startswith("#"):
            continue
        below, points = next(lines, (line, ""))
        try:
            _form(words, 10, "number, qw qx qy qz, tx ty tz, camera, name")
            pose = _pose(words[1:8])
            image, camera = _whole(words[0]), _whole(words[8])
        except (LineError, ValueError) as error:
            draft.problem(str(error), line, str(path))
            continue
        try:
            xy, numbers = _image_points(points.split())
        except (LineError, ValueError) as error:
            draft.problem(str(error), below, str(path))
            continue
        images.append(ColmapImage(image, pose, camera, words[9].strip(), xy, numbers, line))
    return images


def _image_points(words: list[str]) -> tuple[FloatArray, IntArray]:
    if not words:
        return empty_points()
    expected = "x, y and the number of a point (or -1) by turns"
    if len(words) % 3:
        raise LineError(f"found {len(words)} numbers, expected {expected}")
    try:
        # Python's own conversion takes a fifth of the time of numpy's from text.
        xy = np.array([list(map(float, words[0::3])), list(map(float, words[1::3]))]).T
        points = np.array(list(map(int, words[2::3])), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise LineError(f"expected {expected}: {error}") from None
    return xy, points


def read_text_points(path: Path, draft: Draft) -> tuple[IntArray, FloatArray]:
    """Numbers (n,) and coordinates (n, 3) of ``points3D.txt``; colours, errors and tracks are passed by."""
    numbers, xyz = [], []
    # Words of a point in front of its track.
    before_track = 8
    for line, words in _lines(path, draft, before_track):
        try:
            _form(words, before_track, "number, X Y Z, R G B, error, track")
            numbers.append(_whole(words[0]))
            xyz.append([parse_number(word) for word in words[1:4]])
        except (LineError, ValueError) as error:
            draft.problem(str(error), line, str(path))
            del xyz[len(numbers) :], numbers[len(xyz) :]
    return np.array(numbers, dtype=np.int64), np.array(xyz, dtype=float).reshape(-1, 3)


def read_text_rigs(path: Path, draft: Draft) -> list[Rig]:
    """``rigs.txt``."""
    rigs = []
    for line, words in _lines(path, draft):
        try:
            rig, rest = _whole(words[0]), words[2:]
            sensors: list[Sensor] = []
            while rest:
                camera, rest = _whole(rest[1]), rest[2:]
                known = False
                if sensors:
                    known, rest = rest[0] == "1", rest[1:]
                sensors.append(Sensor(camera, _pose(rest[:7]) if known else None))
                rest = rest[7:] if known else rest
            rigs.append(Rig(rig, tuple(sensors)))
        except (LineError, ValueError, IndexError) as error:
            draft.problem(str(error) if str(error) else "found too few words", line, str(path))
    return rigs


def read_text_frames(path: Path, draft: Draft) -> list[RigFrame]:
    """``frames.txt``."""
    frames = []
    for line, words in _lines(path, draft):
        try:
            _form(words, 10, "number, rig, qw qx qy qz, tx ty tz, number of data, (type, sensor, image) …")
            images = tuple(_whole(word) for word in words[12::3])
            _pose(words[2:9])  # the images have their own
            frames.append(RigFrame(_whole(words[0]), _whole(words[1]), images))
        except (LineError, ValueError, IndexError) as error:
            draft.problem(str(error) if str(error) else "found too few words", line, str(path))
    return frames


# ---- A COLMAP model as a project: an image block with the datum of its points, σ = 1 px.


def read_colmap(path: Path) -> Document:
    """The project of a folder with a model, or of one of its files. Raises :class:`InputError` with every mistake."""
    draft = Draft(str(path))
    folder = path if path.is_dir() else path.parent
    if folder is not path and path.stem not in COLMAP_FILES:
        raise InputError([Message(explain_unknown(path), str(path))])
    model = read_model(folder, draft)
    _check(model, draft)
    if draft.problems:
        return draft.finish()
    draft.put("title", folder.resolve().name)
    draft.put("units", {"length": "m", "angle": "rad"})
    draft.put("axes", {"xy": "en"})
    used = {image.camera for image in model.images}
    cameras = [camera for camera in model.cameras if camera.id in used] or model.cameras
    if len(cameras) < len(model.cameras):
        draft.note(f"{counted(len(model.cameras) - len(cameras), 'camera')} of no image not read")
    pairs, follows = followers(model, draft)
    own = not pairs and 1 < len(cameras) == len(model.images)
    undistorted = own and all(camera.model == "PINHOLE" for camera in cameras)
    draft.put("cameras", {str(camera.id): camera_of(camera, held=undistorted) for camera in cameras})
    if undistorted:
        draft.note("each image has a PINHOLE camera of its own, as COLMAP's undistorter writes: the cameras are held")
    rows = [_image_row(image, follows.get(image.id)) for image in model.images]
    columns = ("id", "camera", "x", "y", "z", "omega", "phi", "kappa", "leader", "pair")
    if pairs:
        draft.table("pairs", ("id", "bx", "by", "bz", "omega", "phi", "kappa"), pairs)
    if rows:
        draft.table("images", columns, rows)
    if len(model.point_ids):
        ids = pl.Series("id", model.point_ids).cast(pl.String)
        frame = pl.DataFrame({"id": ids, **dict(zip("xyz", model.point_xyz.T, strict=True))})
        draft.frame("points", "points3D", frame)
    _put_image_points(model, draft)
    draft.put("datum", "free")
    draft.put("settings", {"undetermined": "leave_out"})
    looser = [str(camera.id) for camera in cameras if has_one_unknown_more(camera.model)]
    if looser:
        words = "fx and fy are two unknowns, one focal length in COLMAP"
        draft.note(f"cameras {', '.join(looser[:10])}: {words}")
    draft.note(
        "σ = 1 px for all image points, principal points fixed, all else free; lengths are called m, "
        "whatever the model's unit is; colours, errors and tracks of the points are not read"
    )
    return draft.finish()


def read_model(folder: Path, draft: Draft) -> ColmapModel:
    """The files of a folder; binary ones where both are whole. Raises :class:`InputError` if one is missing."""
    end = max((".bin", ".txt"), key=lambda end: sum((folder / f"{part}{end}").is_file() for part in COLMAP_FILES))
    missing = [f"{name}{end}" for name in COLMAP_FILES if not (folder / f"{name}{end}").is_file()]
    if missing:
        words = f"this folder has no {', '.join(missing)}; a COLMAP model has {', '.join(COLMAP_FILES)} as .bin or .txt"
        raise InputError([Message(words, str(folder))])
    paths = {name: folder / f"{name}{end}" for name in (*COLMAP_FILES, "rigs", "frames")}
    has_rigs = paths["rigs"].is_file() and paths["frames"].is_file()
    if end == ".bin":
        return ColmapModel(
            read_cameras(paths["cameras"]),
            read_images(paths["images"]),
            *read_points(paths["points3D"]),
            read_rigs(paths["rigs"]) if has_rigs else [],
            read_frames(paths["frames"]) if has_rigs else [],
        )
    return ColmapModel(
        read_text_cameras(paths["cameras"], draft),
        read_text_images(paths["images"], draft),
        *read_text_points(paths["points3D"], draft),
        read_text_rigs(paths["rigs"], draft) if has_rigs else [],
        read_text_frames(paths["frames"], draft) if has_rigs else [],
    )


def _check(model: ColmapModel, draft: Draft) -> None:
    """Everything that is referred to is there once, and every number is one."""
    for what, found in (
        ("camera", [camera.id for camera in model.cameras]),
        ("image", [image.name for image in model.images]),
        ("point", model.point_ids.tolist()),
    ):
        for name in [name for name, times in Counter(found).items() if times > 1][:10]:
            draft.problem(f"{what} {name!r} is there twice")
    cameras = {camera.id for camera in model.cameras}
    for camera in model.cameras:
        if not MODELS[camera.model].ours:
            words = f"camera {camera.id}: model {camera.model} has no counterpart in mor: {LOST[camera.model]}"
            draft.problem(words, camera.line)
        if not usable(camera.parameters) or not 0 < min(camera.width, camera.height) < 1 << 31:
            draft.problem(f"camera {camera.id}: its size or a parameter is not a usable number", camera.line)
        elif abs(camera.parameters[0]) < 1e-9 or abs(camera.parameters[0]) > 1e12:
            words = f"camera {camera.id}: found the focal length {camera.parameters[0]:g}, expected px"
            draft.problem(words, camera.line)
    if not usable(model.point_xyz):
        draft.problem("a coordinate of a point is not a number up to 1e30")
    for image in model.images:
        words = _wrong(image, cameras)
        if words:
            draft.problem(f"image {image.name!r}: {words}", image.line)
    _check_rays(model, draft)


def _wrong(image: ColmapImage, cameras: set[int]) -> str:
    if not image.name.strip():
        return f"image {image.id} has no name"
    if image.camera not in cameras:
        return f"camera {image.camera} is not among the cameras"
    numbers = [*image.pose.quaternion, *image.pose.translation]
    if not usable(numbers) or np.linalg.norm(image.pose.quaternion) < 1e-6:
        return "its pose is invalid: found a number beyond 1e30, or a matrix that is not a rotation"
    if not usable(image.xy[image.points != NO_POINT]):
        return "an image coordinate is not a number up to 1e30"
    return ""


def _check_rays(model: ColmapModel, draft: Draft) -> None:
    """All image points at once: looking the points up image by image sorts them as often as there are images."""
    counts = np.array([len(image.points) for image in model.images], dtype=np.int64)
    points = np.concatenate([np.empty(0, dtype=np.int64), *(image.points for image in model.images)])
    lost = np.flatnonzero((points != NO_POINT) & ~np.isin(points, model.point_ids))
    owners = np.repeat(np.arange(len(counts)), counts)[lost]
    for owner, first in list(zip(*np.unique(owners, return_index=True), strict=True))[:10]:
        name = model.images[owner].name
        draft.problem(f"image {name!r}: point {points[lost[first]]} is not among the points")


def _image_row(image: ColmapImage, follower: Follower | None) -> Row:
    if follower is not None:
        return Row([image.name, str(image.camera), *[None] * 6, follower.leader, follower.pair], image.line)
    D, centre = ours(image.pose)
    numbers = [*centre, *angles_from_rotation(D)]
    return Row([image.name, str(image.camera), *(repr(float(v)) for v in numbers), None, None], image.line)


def _put_image_points(model: ColmapModel, draft: Draft) -> None:
    kept = [image.points != NO_POINT for image in model.images]
    free = sum(int((~mask).sum()) for mask in kept)
    if free:
        draft.note(f"{counted(free, 'image point')} of no object point not read")
    if not sum(int(mask.sum()) for mask in kept):
        draft.problem("there are no image points that belong to an object point")
        return
    names = pl.Series([image.name for image in model.images], dtype=pl.String)
    counts = [int(mask.sum()) for mask in kept]
    rays = zip(model.images, kept, strict=True)
    xy, points = (
        np.concatenate(parts)
        for parts in zip(*((image.xy[mask], image.points[mask]) for image, mask in rays), strict=True)
    )
    frame = pl.DataFrame(
        {
            "image": names.gather(np.repeat(np.arange(len(counts)), counts)),
            "point": pl.Series(points).cast(pl.String),
            "x": xy[:, 0],
            "y": xy[:, 1],
        }
    )
    draft.frame("observations", "images", frame, type="image", units="px", values={"sigma": "1"})
