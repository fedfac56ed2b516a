"""COLMAP's binary files: little-endian numbers one after the other."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from mor.arrays import FloatArray, IntArray
from mor.errors import InputError, Problem
from mor.formats.colmap.cameras import MODELS
from mor.formats.colmap.model import ColmapCamera, ColmapImage, Frame, Pose, Rig, Sensor
from mor.input_files import read_bytes

_IMAGE_POINT = np.dtype([("xy", "<f8", (2,)), ("point", "<i8")])
_POINT = struct.Struct("<Q3d3BdQ")
_POSE = "<7d"
_TRACK_ELEMENT = 8


class Bytes:
    """The content of a file, taken from its beginning to its end."""

    def __init__(self, path: Path):
        self.file, self.content, self.at = str(path), read_bytes(path), 0

    def refuse(self, words: str) -> InputError:
        """What is wrong at the place that was reached."""
        return InputError([Problem(f"byte {self.at}: {words}", self.file)])

    def take(self, form: str) -> tuple[int | float, ...]:
        """Numbers of a format of :mod:`struct`. Raises :class:`InputError` where the file ends before."""
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
    count = file.count(_POINT.size)
    numbers, xyz = np.empty(count, dtype=np.int64), np.empty((count, 3))
    for k in range(count):
        file.need(_POINT.size)
        number, x, y, z, _, _, _, _, track = _POINT.unpack_from(file.content, file.at)
        if number >= 1 << 63:
            raise file.refuse(f"found point {number}, expected a number below 2⁶³")
        file.at += _POINT.size
        file.need(track * _TRACK_ELEMENT)
        file.at += track * _TRACK_ELEMENT
        numbers[k], xyz[k] = number, (x, y, z)
    file.finish()
    return numbers, xyz


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
