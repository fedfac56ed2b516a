"""Every project in every format: a well-formed file without NaN that is read back, or a refusal in words."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from mor.api.pipeline import read_document
from mor.api.project import build
from mor.errors import InputError
from mor.formats import FORMATS, read_foreign, write_foreign
from mor.project.document import Document
from mor.project.schema import without_empty_keys

ROOT = Path(__file__).parents[2]
PROJECTS = sorted([*ROOT.glob("sample_projects/*/project.yaml"), *ROOT.glob("tests/cases/**/*.yaml")])
WRITERS = [key for key, form in FORMATS.items() if form.write is not None]
_NO_NUMBER = re.compile(r"(?<![\w.])[-+]?(nan|inf|infinity)(?![\w.])", re.IGNORECASE)
READERS = {"colmap-binary": "colmap", **{key: key for key in WRITERS if FORMATS[key].read is not None}}


def written(
    document: Document, folder: Path, out: Path, key: str, named: bool = False
) -> tuple[list[Path], list[str]] | None:
    """Write a project in a format, check what was written, and return its files and notes; None if it is refused."""
    suffix = "" if FORMATS[key].folder else next(iter(FORMATS[key].suffixes), ".xml")
    target = out / f"out{suffix}"
    try:
        files, notes = write_foreign(document, folder, target, key)
    except InputError:
        return None
    for path, content in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        if path.suffix != ".bin":
            check(path, content.decode("utf-8"), key, named)
    return list(files), [str(note) for note in notes]


def check(path: Path, text: str, key: str, named: bool) -> None:
    """A text is well-formed, and has no NaN unless something is called so; control has it for unknown heights."""
    found = None if named else _NO_NUMBER.search(text)
    assert found is None or key == "gcp", f"{path}: {text[max(found.start() - 80, 0) : found.end()]}"
    if text.lstrip().startswith("<"):
        ElementTree.fromstring(text)
    if path.suffix in (".geojson", ".json"):
        json.loads(text)
    if key == "opencv":
        yaml.safe_load(re.sub(r"%YAML:1.0|!!opencv-matrix", "", text))


def read_back(files: list[Path], out: Path, key: str) -> None:
    """What has a reader is read back; a list of ground control of a local system names no system, and is not."""
    local = key == "gcp" and any("EPSG:?" in file.read_text(encoding="utf-8") for file in files)
    if key in READERS and not local:
        target = files[0].parent if FORMATS[READERS[key]].folder else files[0]
        assert read_foreign(target, READERS[key]).data["mor"] == "1"


@pytest.mark.parametrize("path", PROJECTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_project_in_every_format(path: Path, tmp_path: Path) -> None:
    """Samples and cases: 20 formats each."""
    document = read_document(path)
    for key in WRITERS:
        found = written(document, path.parent, tmp_path / key, key)
        if found is not None:
            read_back(found[0], tmp_path / key, key)


BLOCK: dict[str, Any] = {
    "mor": 1,
    "title": "block",
    "units": {"length": "m", "angle": "deg"},
    "cameras": {
        "cam": {
            "image": {"width": 4000, "height": 3000, "pixel": "2.4 um"},
            "coordinates": "corner",
            "interior": {"c": 8.8},
        }
    },
    "images": [
        {
            "columns": ["id", "camera", "x", "y", "z", "omega", "phi", "kappa"],
            "rows": [["A", "cam", 0, 0, 50, 0, 0, 0], ["B", "cam", 10, 0, 50, 0, 0, 0]],
        }
    ],
    "points": [{"columns": ["id", "x", "y", "z"], "rows": [["P", 5, 0, 0], ["Q", 4, 3, 0]]}],
    "observations": [
        {
            "type": "image",
            "columns": ["image", "point", "x", "y"],
            "values": {"sigma": 1},
            "rows": [
                ["A", "P", 2366, 1500],
                ["B", "P", 1633, 1500],
                ["A", "Q", 2293, 1280],
                ["B", "Q", 1560, 1280],
            ],
        }
    ],
}
NETWORK: dict[str, Any] = {
    "mor": 1,
    "points": [
        {
            "columns": ["id", "x", "y", "z"],
            "rows": [["A", 0, 0, 0], ["B", 90, 10, 1]],
            "fixed": ["x", "y", "z"],
        },
        {"columns": ["id", "x", "y", "z"], "rows": [["C", 40, 60, 2]]},
    ],
    "stations": [{"columns": ["id", "point", "height"], "rows": [["S", "A", 1.5]]}],
    "observations": [
        {
            "type": "zenith_directions",
            "columns": ["station", "to", "horizontal", "zenith"],
            "rows": [["S", "B", 0, 100.2], ["S", "C", 340, 98.9]],
            "values": {"sigma": 0.001},
        },
        {
            "type": "distance",
            "columns": ["from", "to", "distance"],
            "rows": [["A", "C", 72.1]],
            "values": {"sigma": 0.01},
        },
    ],
}


def changed(project: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """The project with other sections; a function changes the one that is there."""
    found = copy.deepcopy(project)
    for key, change in changes.items():
        found[key] = change(found[key]) if callable(change) else change
    return found


def renamed(project: dict[str, Any], old: str, new: str) -> dict[str, Any]:
    """The project with another name for a point."""
    found = copy.deepcopy(project)
    for section in ("points", "observations"):
        for table in found[section]:
            table["rows"] = [[new if cell == old else cell for cell in row] for row in table["rows"]]
    return found


def with_columns(*cells: tuple[str, Any]) -> Any:
    """A change of the first table of a section: further columns, the same value in every row."""

    def change(tables: list[dict[str, Any]]) -> list[dict[str, Any]]:
        tables[0]["columns"] = [*tables[0]["columns"], *(name for name, _ in cells)]
        tables[0]["rows"] = [[*row, *(value for _, value in cells)] for row in tables[0]["rows"]]
        return tables

    return change


def with_row(number: int, row: list[Any]) -> Any:
    """A change of a section: another row in one of its tables."""

    def change(tables: list[dict[str, Any]]) -> list[dict[str, Any]]:
        tables[number]["rows"] = [*tables[number]["rows"], row]
        return tables

    return change


def with_camera(**keys: Any) -> Any:
    """A change of the camera."""
    return lambda cameras: {"cam": {**cameras["cam"], **keys}}


_PLAIN = ("a b", 'a"b', "a<b&c>'d", "é漢", "nan", "#1", "-99", "a,b;c", "*", "]]>", "=1+1", "a\tb")
CONTROL = ("B\x0bC", "B\x85C", "B\u2028C", "B\ufffeC", "B\x1bC")
NAMES = (*_PLAIN, *CONTROL)
ODD = {
    "as it is": BLOCK,
    "rolling shutter": changed(
        BLOCK,
        cameras=with_camera(readout="20 ms"),
        images=with_columns(("vx", 5), ("vy", 0), ("vz", 0), ("shared_image_velocity", "v")),
    ),
    "line scanner": changed(BLOCK, cameras=with_camera(line_time="2 ms", line="0 mm")),
    "an undeclared point": changed(BLOCK, observations=with_row(0, ["A", "new", 2000, 1500])),
    "undeclared points are mistakes": changed(
        BLOCK, observations=with_row(0, ["A", "new", 2000, 1500]), settings={"undeclared_points": "refuse"}
    ),
    "an unknown image": changed(BLOCK, observations=with_row(0, ["X", "P", 2000, 1500])),
    "one coordinate only": changed(BLOCK, observations=with_row(0, ["A", "P", 2366, None])),
    "a point without coordinates": changed(BLOCK, points=with_row(0, ["R", None, None, None])),
    "a point without a height": changed(BLOCK, points=with_row(0, ["R", 1, 2, None])),
    "no coordinates at all": changed(BLOCK, points=[{"columns": ["id"], "rows": [["P"], ["Q"]]}]),
    "an image without a pose": changed(BLOCK, images=with_row(0, ["C", "cam", *[None] * 6])),
    "no sigma": changed(BLOCK, observations=lambda tables: [{**tables[0], "values": {}}]),
    "no image points": changed(BLOCK, observations=[]),
    "heights of images": changed(BLOCK, images=with_columns(("height", 1.5))),
    "an eccentricity": changed(BLOCK, cameras=with_camera(eccentricity={"rx": 0.1})),
    "image variant": changed(BLOCK, cameras=with_camera(image_variant=["c"])),
    "two cameras": changed(BLOCK, cameras=lambda c: {**c, "a/b": c["cam"]}),
    "title of two lines": changed(BLOCK, title='one\ntwo \x0b <three> & "four"'),
    "network": NETWORK,
    "network on a sphere": changed(NETWORK, curvature=True),
    "network without coordinates": changed(NETWORK, points=lambda t: [t[0], {"columns": ["id"], "rows": [["C"]]}]),
    "network in the plane": changed(
        NETWORK,
        settings={"dimensions": "xy"},
        observations=lambda t: [{**t[1], "type": "horizontal_distance"}],
    ),
    "station with an orientation and an epoch": changed(
        NETWORK, stations=with_columns(("orientation", 12.5), ("sigma_height", 0.001))
    ),
    "network without observations": changed(NETWORK, observations=[]),
    "no points": changed(NETWORK, points=[], stations=[], observations=[]),
    **{
        f"{kind} with {name!r}": renamed(project, old, name)
        for kind, project, old in (("block", BLOCK, "P"), ("network", NETWORK, "C"))
        for name in NAMES
    },
}


@pytest.mark.parametrize("name", ODD)
def test_odd_projects_in_every_format(name: str, tmp_path: Path) -> None:
    """Rolling shutters, missing coordinates, odd names: nothing is written that cannot be read, and nothing crashes."""
    document = without_empty_keys(build(ODD[name]))
    for key in WRITERS:
        found = written(document, tmp_path, tmp_path / key, key, "'nan'" in name)
        if found is not None and name != "no coordinates at all":  # COLMAP has image points without points then
            read_back(found[0], tmp_path / key, key)


@pytest.mark.parametrize("key", ["colmap", "colmap-binary", "metashape", "aicon"])
def test_a_rolling_shutter_is_exported_and_its_loss_counted(key: str, tmp_path: Path) -> None:
    """Columns that the adjustment reads are no mistake; how many values are lost is said."""
    document = without_empty_keys(build(ODD["rolling shutter"]))
    found = written(document, tmp_path, tmp_path, key)
    assert found is not None
    said = " ".join(found[1])
    assert "rolling shutter of 1 camera" in said
    assert "column vx of images (2 values)" in said


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("a point without coordinates", "1 point without coordinates: left out of points3D"),
        ("no coordinates at all", "4 image points of points without coordinates"),
        ("one coordinate only", "image points with one coordinate only (1 value)"),
        ("network on a sphere", "curvature (coordinates are plan coordinates and heights above a sphere)"),
    ],
)
def test_what_is_lost_is_counted(name: str, words: str, tmp_path: Path) -> None:
    """A note for each kind of loss, with its count."""
    key = "gkf" if name.startswith("network") else "colmap"
    found = written(without_empty_keys(build(ODD[name])), tmp_path, tmp_path, key)
    assert found is not None
    assert words in " ".join(found[1])


@pytest.mark.parametrize("key", ["gkf", "metashape", "landxml", "geojson", "colmap", "starnet"])
def test_control_characters_are_refused(key: str, tmp_path: Path) -> None:
    """XML 1.0 has no place for them, and text files break at them: the name is told."""
    project = renamed(NETWORK if key in ("gkf", "starnet", "landxml", "geojson") else BLOCK, "C", "B\x0bC")
    project = renamed(project, "P", "B\x0bC")
    with pytest.raises(InputError, match=r"B\\x0bC.*without control characters"):
        write_foreign(without_empty_keys(build(project)), tmp_path, tmp_path / "out", key)
