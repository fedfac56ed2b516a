"""Several foreign files as one project: control for an image block, units, lines, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import read_together, write_foreign
from mor.formats.combination import combined
from mor.project.document import Document
from tests.reference_data import network_of, point_results
from tests.scenarios.small_projects import mor

from .blocks import block, written

GSI = """*110001+000000000000000A 88..10+0000000000001550
*110002+000000000000000B 21..12+0000000010000000 22..12+0000000009950000 31..10+0000000000060001 87..10+0000000000001300
*110003+000000000000000C 21..12+0000000015000000 22..12+0000000010100000 31..10+0000000000044650 87..10+0000000000001300
"""
TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])


def _model(folder: Path, seed: int) -> dict[str, list[float]]:
    """A COLMAP model in ``folder``/model, control in another system in control.dat; the control."""
    data = block(seed, "SIMPLE_RADIAL")
    source = written(folder, data)
    for path, content in write_foreign(read_document(source), folder, folder / "model", "colmap").files.items():
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    points = {
        row[0]: (2.0 * TURN @ [float(v) for v in row[1:]] + [400.0, 500.0, 10.0]).tolist()
        for row in data["points"][0]["rows"][:6]
    }
    lines = [f"C {name} {y!r} {x!r} {z!r} 0.002 0.002 0.003" for name, (x, y, z) in points.items()]
    (folder / "control.dat").write_text("\n".join([".UNITS METERS DMS", *lines, "C extra 1 2 3 ! ! !"]))
    return points


@pytest.mark.parametrize("seed", [1])
def test_a_block_takes_its_datum_from_control_of_another_file(tmp_path: Path, seed: int) -> None:
    control = _model(tmp_path, seed)
    together = read_together([tmp_path / "model", tmp_path / "control.dat"], ["colmap", "starnet"])
    notes = " ".join(note.message for note in together.notes)
    assert "coordinates and poses, in a system of their own" in notes
    assert "6 points in" in notes
    data = block(seed, "SIMPLE_RADIAL")
    del data["datum"]
    data["images"] = [{"columns": ["id", "camera"], "rows": [row[:2] for row in data["images"][0]["rows"]]}]
    given = [[name, *map(repr, xyz), "0.002", "0.002", "0.003"] for name, xyz in control.items()]
    rest = [[row[0]] for row in data["points"][0]["rows"] if row[0] not in control]
    columns = ["id", "x", "y", "z", "sigma_x", "sigma_y", "sigma_z"]
    data["points"] = [{"columns": ["id"], "rows": rest}, {"columns": columns, "rows": given}]
    direct = solve_network(network_of(read_document(written(tmp_path, data)), tmp_path))
    before, after = point_results(direct), point_results(solve_network(network_of(together, tmp_path)))
    assert set(after) == {*before, "extra"}
    for name, (xyz, sigma) in before.items():
        np.testing.assert_allclose(after[name][0], xyz, rtol=0, atol=1e-8)
        np.testing.assert_allclose(after[name][1], sigma, rtol=1e-6)


def test_the_command_takes_several_sources(tmp_path: Path) -> None:
    _model(tmp_path, 3)
    formats = ["--from", "colmap", "--from", "starnet"]
    sources = [str(tmp_path / name) for name in ("model", "control.dat")]
    assert mor("convert", *sources, str(tmp_path / "all.yaml"), *formats).code == 0
    assert mor("check", str(tmp_path / "all.yaml")).code == 0
    refused = mor("convert", str(tmp_path / "block.yaml"), sources[1], str(tmp_path / "x.yaml"))
    assert refused.code == 2
    assert "a project file is not put together with other files" in refused.err


def test_adjust_and_check_take_the_format(tmp_path: Path) -> None:
    path = tmp_path / "net.txt"
    path.write_text("C A 0 0 ! !\nC B 0 100 ! !\nC P 50 50\nD A-P 70.71 0.01\nD B-P 70.71 0.01\n")
    for command in ("check", "adjust", "approximate"):
        place = [] if command == "check" else ["-o", str(tmp_path / command)]
        assert mor(command, str(path), "--from", "starnet", *place).code == 0
        wrong = mor(command, str(path), "--from", "starnets", *place, *(["--force"] if place else []))
        assert wrong.code == 2
        assert "unknown format 'starnets'; did you mean 'starnet'" in wrong.err


def _document(file: str, units: dict[str, str], **sections: object) -> Document:
    tables = [k for k, v in sections.items() if isinstance(v, list)]
    lines = {(k, 0, "rows", i): 10 + i for k in tables for i in range(len(sections[k][0]["rows"]))}
    return Document({"mor": "1", "units": units, **sections}, lines, file)


def _network(length: float, angle: float, units: dict[str, str]) -> list[Document]:
    """Two files, the second in other units: a polar point from a known station."""
    held = {"columns": ["id", "x", "y", "z"], "fixed": ["x", "y", "z"]}
    rows = [["A", "0", "0", "0"], ["B", "0", "100", "0"]]
    first = _document("a", {"length": "m", "angle": "rad"}, points=[{**held, "rows": rows}])
    columns = ["at", "from", "to", "angle", "sigma"]
    angles = {
        "type": "angle",
        "columns": columns,
        "rows": [["A", "B", "P", repr(0.7 / angle), repr(1e-4 / angle)]],
    }
    names = ["from", "to", "distance", "sigma", "to_height"]
    distances = {
        "type": "distance",
        "columns": names,
        "rows": [["A", "P", repr(50.0 / length), repr(0.01 / length), repr(1.5 / length)]],
    }
    heights = {
        "type": "height_difference",
        "columns": ["from", "to", "dz"],
        "rows": [["A", "P", repr(2.0 / length)]],
    }
    heights["values"] = {"sigma": repr(0.001 / length)}
    free = [{"columns": ["id"], "rows": [["P"]]}]
    return [first, _document("b", units, points=free, observations=[angles, distances, heights])]


def test_units_of_the_second_file_are_kept(tmp_path: Path) -> None:
    found = []
    cases = (
        (1.0, 1.0, ("m", "rad")),
        (1e-3, np.pi / 200, ("mm", "gon")),
        (0.3048, np.pi / 180, ("ft", "deg")),
    )
    for length, angle, names in cases:
        document = combined(_network(length, angle, dict(zip(("length", "angle"), names, strict=True))))
        found.append(point_results(solve_network(network_of(document, tmp_path)))["P"])
    for xyz, sigma in found[1:]:
        np.testing.assert_allclose(xyz, found[0][0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(sigma, found[0][1], rtol=1e-9)


@pytest.mark.parametrize("order", [("book.gsi", "control.dat"), ("control.dat", "book.gsi")])
def test_control_stays_whatever_the_order(tmp_path: Path, order: tuple[str, str]) -> None:
    """A field book that names a point does not take its coordinates away."""
    (tmp_path / "book.gsi").write_text(GSI)
    (tmp_path / "control.dat").write_text("C A 0 0 10 ! ! !\nC B 60 0 10.2 ! ! !\n")
    formats = ["starnet" if name.endswith(".dat") else "gsi" for name in order]
    whole = read_together([tmp_path / name for name in order], formats)
    held = [row for table in whole.data["points"] if "sigma_x" in table["columns"] for row in table["rows"]]
    assert [row[0] for row in held] == ["A", "B"]
    assert sorted(row[0] for table in whole.data["points"] for row in table["rows"]) == ["A", "B", "C"]
    found = point_results(solve_network(network_of(whole, tmp_path)))
    np.testing.assert_allclose(found["B"][0], [0, 60, 10.2], atol=1e-9)
    assert np.linalg.norm(found["C"][0][:2]) == pytest.approx(44.65, abs=0.1)


def test_lines_stay_those_of_the_files() -> None:
    first, second = _network(1.0, 1.0, {"length": "m", "angle": "rad"})
    again = _document("c", {"length": "m", "angle": "rad"}, points=[{"columns": ["id", "x"], "rows": [["A", "1"]]}])
    again.data["points"][0]["fixed"] = ["x"]
    whole = combined([first, second, again])
    assert [table["rows"] for table in whole.data["points"]] == [
        [["B", "0", "100", "0"]],
        [["P"]],
        [["A", "1"]],
    ]
    places = [("points", k, "rows", 0) for k in range(3)]
    assert [(whole.file_of(p), whole.line(p)) for p in places] == [("a", 11), ("b", 10), ("c", 10)]
    assert whole.file_of(("observations", 0, "rows", 0)) == "b"


def test_axes_and_cameras_of_the_same_name_are_refused() -> None:
    first, second = _network(1.0, 1.0, {"length": "m", "angle": "rad"})
    first.data["cameras"], second.data["cameras"] = {"1": {"model": "mor"}}, {"1": {"model": "brown"}}
    second.data["axes"] = {"xy": "ne"}
    with pytest.raises(InputError, match=r"the axes are not those of a.*\n.*camera '1' is in a, too"):
        combined([first, second])


def test_files_of_one_project_may_share_cameras_and_images() -> None:
    """The fuller entry of an image in both files stays. Images that no reading names are left out."""
    camera = {"1": {"model": "mor"}, "2": {"model": "mor"}}
    units = {"length": "m", "angle": "rad"}
    rows = [["i", "1", "5"], ["j", "1", "6"], ["k", "2", "7"]]
    poses = _document("a", units, images=[{"columns": ["id", "camera", "x"], "rows": rows}])
    bare = [["i", "1"], ["j", "1"]]
    measured = [{"type": "image", "columns": ["image", "point", "x", "y"], "rows": [["i", "P", "0", "0"]]}]
    readings = _document("b", units, images=[{"columns": ["id", "camera"], "rows": bare}], observations=measured)
    poses.data["cameras"], readings.data["cameras"] = camera, dict(camera)
    whole = combined([poses, readings])
    assert [table["rows"] for table in whole.data["images"]] == [[["i", "1", "5"]]]
    assert list(whole.data["cameras"]) == ["1"]
    notes = " ".join(map(str, whole.notes))
    assert "2 images in a, too: the fuller entry is taken" in notes
    assert "2 images in which nothing is measured: not read" in notes
