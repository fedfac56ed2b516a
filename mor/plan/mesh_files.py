"""Meshes from files: the vertices and faces of PLY and OBJ; what else these formats hold is not looked at.

Sources: G. Turk, The PLY Polygon File Format (1994); Wavefront, Advanced Visualizer, appendix B1 (OBJ).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mor.errors import InputError, Message
from mor.input_files import read_bytes
from mor.types import FloatArray, IntArray


class Mesh(NamedTuple):
    """A mesh as its file has it."""

    vertices: FloatArray
    """(v, 3)."""
    faces: list[IntArray]
    """Numbers of the vertices of each face, in turn."""


def read_mesh(path: Path) -> Mesh:
    """The mesh of a PLY or OBJ file. Raises :class:`InputError` with what is wrong, and where."""
    content = read_bytes(path)
    name = path.name.lower().removesuffix(".gz")
    try:
        if content.startswith(b"ply") or name.endswith(".ply"):
            mesh = _ply(content)
        elif name.endswith(".obj"):
            mesh = _obj(content)
        else:
            raise _MeshError("found neither a PLY nor an OBJ file")
        if not mesh.faces:
            raise _MeshError("the mesh has no faces: a cloud of points hides nothing")
        if not np.isfinite(mesh.vertices).all():
            raise _MeshError("a vertex has a coordinate that is not a finite number")
        count = len(mesh.vertices)
        for number, face in enumerate(mesh.faces, start=1):
            if len(face) < 3 or face.min() < 0 or face.max() >= count:
                raise _MeshError(f"face {number} has {len(face)} corners of {count} vertices: {face.tolist()}")
    except _MeshError as error:
        raise InputError([Message(str(error), str(path), error.line)]) from None
    return mesh


class _MeshError(Exception):
    """Mistake in a mesh, and its line, 0 if there are no lines."""

    def __init__(self, words: str, line: int = 0) -> None:
        super().__init__(words)
        self.line = line


def _obj(content: bytes) -> Mesh:
    vertices: list[list[float]] = []
    faces: list[IntArray] = []
    text = content.decode("utf-8", errors="replace").replace("\\\n", " ")
    for line, words in enumerate(map(str.split, text.splitlines()), start=1):
        if not words or words[0] not in ("v", "f"):
            continue
        try:
            if words[0] == "v":
                vertices.append([float(word) for word in words[1:4]])
                if len(vertices[-1]) < 3:
                    raise ValueError
                continue
            numbers = [int(word.split("/")[0]) for word in words[1:]]
        except ValueError:
            expected = "v x y z" if words[0] == "v" else "f and numbers of vertices"
            raise _MeshError(f"found {' '.join(words)!r}, expected {expected}", line) from None
        faces.append(np.array([k - 1 if k > 0 else len(vertices) + k for k in numbers], dtype=np.int64))
    return Mesh(np.array(vertices, dtype=float).reshape(-1, 3), faces)


class _Property(NamedTuple):
    name: str
    type: str
    counted_by: str = ""
    """Type of the number of entries of a list; empty for a single number."""


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


def _ply(content: bytes) -> Mesh:
    order, elements, rest, line = _ply_header(content)
    read = _ascii_rows if order == "" else _binary_rows
    found: dict[str, list[list[FloatArray]]] = {}
    for element in elements:
        rows, rest = read(element, rest, order, line)
        line += element.rows
        found[element.name] = rows
    by_name = {element.name: [p.name for p in element.properties] for element in elements}
    missing = [c for c in "xyz" if c not in by_name.get("vertex", ())]
    if missing:
        raise _MeshError(f"vertices without {', '.join(missing)}")
    columns = [by_name["vertex"].index(c) for c in "xyz"]
    vertices = np.array([[float(row[k][0]) for k in columns] for row in found["vertex"]]).reshape(-1, 3)
    corners = [k for k, name in enumerate(by_name.get("face", ())) if name in ("vertex_indices", "vertex_index")]
    faces = [row[corners[0]].astype(np.int64) for row in found["face"]] if corners else []
    return Mesh(vertices, faces)


def _ply_header(content: bytes) -> tuple[str, list[_Element], bytes, int]:
    """Byte order ("" for text), elements, what follows the header, and the number of its lines."""
    head, end, rest = content.partition(b"end_header")
    if not end:
        raise _MeshError("the header of the PLY file has no end (end_header)")
    order: str | None = None
    elements: list[_Element] = []
    lines = head.decode("ascii", errors="replace").splitlines()
    numpy_types = {
        **dict.fromkeys(("char", "int8"), "i1"),
        **dict.fromkeys(("uchar", "uint8"), "u1"),
        **dict.fromkeys(("short", "int16"), "i2"),
        **dict.fromkeys(("ushort", "uint16"), "u2"),
        **dict.fromkeys(("int", "int32"), "i4"),
        **dict.fromkeys(("uint", "uint32"), "u4"),
        **dict.fromkeys(("float", "float32"), "f4"),
        **dict.fromkeys(("double", "float64"), "f8"),
    }
    for line, words in enumerate(map(str.split, lines), start=1):
        try:
            match words:
                case ["format", form, _]:
                    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count), []))
                case ["property", "list", counted, kind, name]:
                    elements[-1].properties.append(_Property(name, numpy_types[kind], numpy_types[counted]))
                case ["property", kind, name]:
                    elements[-1].properties.append(_Property(name, numpy_types[kind]))
        except (KeyError, ValueError, IndexError):
            raise _MeshError(f"found {' '.join(words)!r} in the header of the PLY file", line) from None
    if order is None:
        raise _MeshError("the header of the PLY file does not say its format")
    return order, elements, rest[rest.find(b"\n") + 1 :], len(lines) + 1


def _ascii_rows(element: _Element, rest: bytes, order: str, line: int) -> tuple[list[list[FloatArray]], bytes]:
    """Rows of an element in lines of text: the numbers of each property."""
    rows = []
    for number in range(1, element.rows + 1):
        text, _, rest = rest.partition(b"\n")
        try:
            words = [float(word) for word in text.split()]
            row, at = [], 0
            for one in element.properties:
                count = int(words[at]) if one.counted_by else 1
                at += bool(one.counted_by)
                row.append(np.array(words[at : at + count]))
                if len(row[-1]) != count:
                    raise ValueError
                at += count
            rows.append(row)
        except (ValueError, IndexError):
            said = text.decode("ascii", errors="replace").strip()
            raise _MeshError(f"found {said!r}, expected {element.name} {number}", line + number) from None
    return rows, rest


def _binary_rows(element: _Element, rest: bytes, order: str, line: int) -> tuple[list[list[FloatArray]], bytes]:
    rows, at = [], 0
    try:
        if not any(one.counted_by for one in element.properties):
            type_ = np.dtype([(one.name, order + one.type) for one in element.properties])
            table = np.frombuffer(rest, type_, element.rows)
            columns = np.stack([table[one.name].astype(float) for one in element.properties], axis=1)
            return [list(row[:, None]) for row in columns], rest[element.rows * type_.itemsize :]
        for _ in range(element.rows):
            row = []
            for one in element.properties:
                count = 1
                if one.counted_by:
                    counted = np.frombuffer(rest, order + one.counted_by, 1, at)
                    count, at = int(counted[0]), at + counted.nbytes
                row.append(np.frombuffer(rest, order + one.type, count, at).astype(float))
                at += count * np.dtype(one.type).itemsize
            rows.append(row)
    except ValueError:
        raise _MeshError(f"the PLY file ends amidst its {element.rows} {element.name} elements") from None
    return rows, rest[at:]
