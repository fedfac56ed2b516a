"""COLMAP's binary files: little-endian numbers one after the other."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mor.arrays import FloatArray, IntArray
from mor.errors import InputError, Problem
from mor.formats.colmap.cameras import MODELS
from mor.formats.colmap.model import ColmapCamera, ColmapImage, Frame, Pose, Rig, Sensor
from mor.input_files import read_bytes

_IMAGE_POINT = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
_POINT = np.dtype([("number", "<u8"), ("xyz", "<f8", (3,))])
"""What is read of a point; its colour (3 bytes) and error (8), the length of its track (8) and the track follow."""
_LENGTH, _LENGTH_AT, _POINT_SIZE = struct.Struct("<Q"), 43, 51
_POSE = "<7d"
_TRACK_ELEMENT = 8


class Bytes:
    """The content of a file, taken from its beginning to its end."""

    def __init__(self, path: Path):
        self.file, self.content, self.at = str(path), read_bytes(path), 0

    def refuse(self, words: str) -> InputError:
        """Return the error for the position reached in the file."""
        return InputError([Problem(f"byte {self.at}: {words}", self.file)])

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

    def pose(self) -> Pose:
        """Quaternion and translation."""
        numbers = [float(number) for number in self.take(_POSE)]
        return Pose((numbers[0], numbers[1], numbers[2], numbers[3]), (numbers[4], numbers[5], numbers[6]))

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
    for _ in range(file.count(73)):
        number = int(file.take("<I")[0])
        pose = file.pose()
        camera, name = int(file.take("<I")[0]), file.name()
        count = file.count(_IMAGE_POINT.itemsize)
        found = np.frombuffer(file.content, _IMAGE_POINT, count, file.at)
        file.at += count * _IMAGE_POINT.itemsize
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
    found = sliding_window_view(content, _POINT.itemsize)[starts].view(_POINT)[:, 0]
    large = np.flatnonzero(found["number"] >= 1 << 63)
    if len(large):
        file.at = int(starts[large[0]])
        raise file.refuse(f"found point {found['number'][large[0]]}, expected a number below 2⁶³")
    return found["number"].astype(np.int64), found["xyz"].astype(float)


def _starts(file: Bytes, count: int) -> IntArray:
    """(count,) where the points begin: the length of each one's track says where the next one does."""
    content, at, length, end = file.content, file.at, _LENGTH.unpack_from, len(file.content)
    starts: list[int] = []
    while len(starts) < count and at + _POINT_SIZE <= end:
        starts.append(at)
        at += _POINT_SIZE + length(content, at + _LENGTH_AT)[0] * _TRACK_ELEMENT
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


def read_frames(path: Path) -> list[Frame]:
    """``frames.bin``."""
    file = Bytes(path)
    frames = []
    for _ in range(file.count(68)):
        number, rig = (int(value) for value in file.take("<II"))
        pose = file.pose()
        count = int(file.take("<I")[0])
        file.need(count * 16)
        images = [int(file.take("<iIQ")[2]) for _ in range(count)]
        frames.append(Frame(number, rig, tuple(images), pose))
    file.finish()
    return frames
