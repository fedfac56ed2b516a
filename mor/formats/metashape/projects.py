"""Metashape's own projects: ``.psz``, an archive, and ``.psx``, a file beside a folder of archives, as one XML tree.

Source: projects of PhotoScan 1.1 and 1.2; for ``.psx`` programs that read them (``name.files/project.zip``,
``0/chunk.zip``, ``0/0/frame.zip``, ``0/0/point_cloud/point_cloud.zip``, each with a ``doc.xml``).
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from mor.errors import InputError, Problem
from mor.formats.metashape.tie_points import ARCHIVE, UNREADABLE
from mor.formats.xml import Element, parse_xml
from mor.input_files import PROJECT, check_size, read_bytes

_DOCUMENT = "doc.xml"


def is_project(path: Path) -> bool:
    """True for a name that Metashape gives its projects."""
    return path.suffix.lower() in (".psz", ".psx")


def project_tree(path: Path) -> Element:
    """Root of a project with its chunks and frames in place. Raises :class:`InputError`."""
    content = read_bytes(path, PROJECT)
    if path.suffix.lower() == ".psz":
        return parse_xml(_document(content, path), str(path))
    root = parse_xml(content, str(path))
    place = root.attributes.get("path", "").replace("{projectname}", path.stem).replace("\\", "/")
    if not place:
        words = f"found <{root.name}> without path=, expected a .psx of Metashape"
        raise InputError([Problem(words, str(path), root.line)])
    return _archive(path.parent / place, ("chunk", "frame", "point_cloud"))


def _archive(path: Path, inner: tuple[str, ...]) -> Element:
    """The document of an archive, with those that its elements name by ``path`` in their place."""
    root = parse_xml(_document(read_bytes(path, PROJECT), path), str(path))
    if inner:
        _fill(root, path.parent, inner)
    return root


def _fill(element: Element, folder: Path, inner: tuple[str, ...]) -> None:
    for k, child in enumerate(element.children):
        place = child.attributes.get("path", "").replace("\\", "/")
        if child.name == inner[0] and place.endswith(".zip"):
            found = _archive(folder / place, inner[1:])
            child.attributes.update(found.attributes, **{ARCHIVE: str(folder / place)})
            element.children[k] = Element(
                child.name, child.attributes, child.line, found.children, found.text
            )
        else:
            _fill(child, folder, inner)


def _document(content: bytes, path: Path) -> bytes:
    """``doc.xml`` of an archive, up to the limit of what is read."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            check_size(archive.getinfo(_DOCUMENT).file_size, path, PROJECT)
            return archive.read(_DOCUMENT)
    except KeyError:
        words = f"found no {_DOCUMENT} in this archive, expected a project of Metashape"
    except UNREADABLE as error:
        words = f"this archive cannot be read: {error}"
    raise InputError([Problem(words, str(path))])
