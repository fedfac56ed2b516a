"""COLMAP's text files: a thing a line, an image on two; lines that begin with # are comments."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.formats.colmap.cameras import MODELS
from mor.formats.colmap.model import ColmapCamera, ColmapImage, Frame, Pose, Rig, Sensor, empty_points
from mor.formats.draft import Draft, number
from mor.formats.text import read_lines

_CAMERA = "number, model, width, height, parameters"
_IMAGE = "number, qw qx qy qz, tx ty tz, camera, name"
_POINTS = "x, y and the number of a point (or -1) by turns"
_POINT = "number, X Y Z, R G B, error, track"
_BEFORE_TRACK = 8
"""Words of a point in front of its track."""


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


def _pose(words: list[str]) -> Pose:
    q = [number(word) for word in words]
    return Pose((q[0], q[1], q[2], q[3]), (q[4], q[5], q[6]))


def read_cameras(path: Path, draft: Draft) -> list[ColmapCamera]:
    """``cameras.txt``."""
    cameras = []
    for line, words in _lines(path, draft):
        try:
            _form(words, 4, _CAMERA)
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
    return ColmapCamera(size[0], name, size[1], size[2], tuple(number(word) for word in words[4:]), line)


def read_images(path: Path, draft: Draft) -> list[ColmapImage]:
    """``images.txt``: a line with the pose, then one with the image points, which may be empty."""
    images = []
    lines = enumerate(read_lines(path, draft), start=1)
    for line, text in lines:
        words = text.split(maxsplit=9)
        if not words or words[0].startswith("#"):
            continue
        below, points = next(lines, (line, ""))
        try:
            _form(words, 10, _IMAGE)
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
    if len(words) % 3:
        raise LineError(f"found {len(words)} numbers, expected {_POINTS}")
    try:
        # Python's own conversion takes a fifth of the time of numpy's from text.
        xy = np.array([list(map(float, words[0::3])), list(map(float, words[1::3]))]).T
        points = np.array(list(map(int, words[2::3])), dtype=np.int64)
    except (ValueError, OverflowError) as error:
        raise LineError(f"expected {_POINTS}: {error}") from None
    return xy, points


def read_points(path: Path, draft: Draft) -> tuple[IntArray, FloatArray]:
    """Numbers (n,) and coordinates (n, 3) of ``points3D.txt``; colours, errors and tracks are passed by."""
    numbers, xyz = [], []
    for line, words in _lines(path, draft, _BEFORE_TRACK):
        try:
            _form(words, _BEFORE_TRACK, _POINT)
            numbers.append(_whole(words[0]))
            xyz.append([number(word) for word in words[1:4]])
        except (LineError, ValueError) as error:
            draft.problem(str(error), line, str(path))
            del xyz[len(numbers) :], numbers[len(xyz) :]
    return np.array(numbers, dtype=np.int64), np.array(xyz, dtype=float).reshape(-1, 3)


def read_rigs(path: Path, draft: Draft) -> list[Rig]:
    """``rigs.txt``."""
    rigs = []
    for line, words in _lines(path, draft):
        try:
            rigs.append(_rig(words))
        except (LineError, ValueError, IndexError) as error:
            draft.problem(str(error) if str(error) else "found too few words", line, str(path))
    return rigs


def _rig(words: list[str]) -> Rig:
    rig, rest = _whole(words[0]), words[2:]
    sensors: list[Sensor] = []
    while rest:
        camera, rest = _whole(rest[1]), rest[2:]
        known = False
        if sensors:
            known, rest = rest[0] == "1", rest[1:]
        sensors.append(Sensor(camera, _pose(rest[:7]) if known else None))
        rest = rest[7:] if known else rest
    return Rig(rig, tuple(sensors))


def read_frames(path: Path, draft: Draft) -> list[Frame]:
    """``frames.txt``."""
    frames = []
    for line, words in _lines(path, draft):
        try:
            _form(words, 10, "number, rig, qw qx qy qz, tx ty tz, number of data, (type, sensor, image) …")
            images = tuple(_whole(word) for word in words[12::3])
            frames.append(Frame(_whole(words[0]), _whole(words[1]), images, _pose(words[2:9])))
        except (LineError, ValueError, IndexError) as error:
            draft.problem(str(error) if str(error) else "found too few words", line, str(path))
    return frames
