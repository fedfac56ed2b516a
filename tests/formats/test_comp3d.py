"""Comp3D's files: a small network of our own, whose readings are computed from the coordinates."""

from __future__ import annotations

from math import atan2, hypot, pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mor
from mor.errors import InputError
from mor.formats import read_foreign
from mor.formats.recognition import format_of
from mor.project.document import Document

PLACES = {"A": (1000.0, 2000.0, 5.0), "B": (1060.0, 2080.0, 8.0), "C": (960.0, 2050.0, 2.0)}
COR = "1 A 1000 2000 5 0 0 0 *held\n2 B 1060 2080 8 0.01 0.02 0\n0 C 960.02 2050.01 2\n-1 Z\n"
COMP = (
    'data=\n{\n"COMP3D_VERSION" : "x",\n"config" : {"center_latitude" : 45.0, "internal_constraints" : false,\n'
    '"local_center" : [\n1000.0,\n2000.0,\n0.0\n],\n"refraction" : 0.0, "root_COR_file" : "n.cor",\n'
    '"use_proj" : false, '
    '"root_OBS_file" : "sub/n.obs"}\n}\n'
)


def _azimuth(one: str, other: str) -> float:
    (e, n, _), (e2, n2, _) = PLACES[one], PLACES[other]
    return atan2(e2 - e, n2 - n) * 200.0 / pi % 400.0


def _slope(one: str, other: str, up: float = 0.0) -> float:
    (e, n, h), (e2, n2, h2) = PLACES[one], PLACES[other]
    return sqrt((e2 - e) ** 2 + (n2 - n) ** 2 + (h2 - h + up) ** 2)


def observed() -> str:
    """The observations file of the network: two rounds, distances, heights."""
    lines = ["* a comment", f"8 A B {_azimuth('A', 'B'):.5f} 0.001"]
    for station, (one, other) in {"A": ("B", "C"), "C": ("A", "B")}.items():
        lines += [f"7 {station} {one} 0.0 0.001 0.002"]
        lines += [
            f"5 {station} {other} {(_azimuth(station, other) - _azimuth(station, one)) % 400.0:.5f} 0.001"
        ]
    lines += [
        f"3 A C {_slope('A', 'C', -0.2):.4f} 0.001 0.00001 1.5 1.3",
        f"1 C B {_slope('C', 'B'):.4f} 0.002",
    ]
    lines += [
        "4 A C -3.0 0.001",
        "-3 A B 5.0 0.001",
        "3 A B 5.0 -0.001",
        "3 A Z 7.0 0.001",
        "11 A @a.xyz V",
        "@more.obs",
    ]
    return "\n".join(lines) + "\n"


def write(folder: Path) -> Path:
    """Write the files of the network; return the project."""
    (folder / "sub").mkdir()
    (folder / "n.cor").write_text(COR)
    (folder / "sub" / "n.obs").write_text(observed())
    (folder / "sub" / "more.obs").write_text("9 C D 0 0.003 0.001\n4 C D 1.5 0.001\n14 A B 60 0.01\n")
    path = folder / "n.comp"
    path.write_text(COMP)
    return path


def _rows(document: Document, type_: str) -> list[dict[str, Any]]:
    tables = [table for table in document.data["observations"] if table["type"] == type_]
    return [dict(zip(table["columns"], row, strict=True)) for table in tables for row in table["rows"]]


def test_a_project_of_comp3d(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert format_of(path) == "comp3d"
    document = read_foreign(path)
    (A, B, C, D) = (
        dict(zip(table["columns"], row, strict=True)) | {"fixed": table.get("fixed")}
        for table in document.data["points"]
        for row in table["rows"]
    )
    assert (A["fixed"], B["sigma_x"], B["sigma_y"], C["fixed"]) == (["x", "y", "z"], "0.01", "0.02", None)
    assert B.get("sigma_z") is None
    assert D["id"] == "D"
    assert document.data["curvature"]["origin"] == {"x": "1000.0", "y": "2000.0", "z": "0"}
    (long, short) = _rows(document, "distance")
    assert float(long["sigma"]) == pytest.approx(0.001 + 1e-5 * hypot(39.98, 50.01, 3.0))
    assert [short[key] for key in ("from", "to", "from_height")] == ["C", "B", "0.0"]
    first, second = (row for row in _rows(document, "directions") if row["station"] == "A")
    assert float(first["sigma"]) == pytest.approx(0.001 + 0.002 / hypot(60.0, 80.0, 3.0) * 200.0 / pi)
    assert (first["set"], second["set"], second["sigma"]) == ("1", "1", "0.001")
    centring, difference = _rows(document, "vector")
    assert [centring[key] for key in ("dx", "dy", "sigma_dx", "sigma_dy")] == ["0.0", "0.0", "0.003", "0.001"]
    assert [difference[key] for key in ("dx", "dy", "sigma_dx")] == ["60.0", None, "0.01"]
    notes = " ".join(map(str, document.notes))
    for words in (
        "switched off not read (2 records)",
        "points that are ignored not read (1 record)",
        "cartesian subframes (11) not read (1",
    ):
        assert words in notes
    values = mor.adjust(str(path))
    points = values.project.network.things["point"]
    place = values.solved.adjustment.values["point"][points.part("C", "position")]
    np.testing.assert_allclose(place, PLACES["C"], atol=2e-3)


def test_a_file_of_observations_takes_the_coordinates_beside_it(tmp_path: Path) -> None:
    write(tmp_path)
    observations = tmp_path / "sub" / "n.obs"
    with pytest.raises(InputError, match=r"found no \.cor file that belongs to it"):
        read_foreign(observations)
    (tmp_path / "sub" / "n.cor").write_text(COR)
    assert format_of(observations) == "comp3d"
    document = read_foreign(observations)
    assert "no .comp file says the coefficient of refraction" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("4 A C -3.0 0.001", "4 A C -3.0", r"n\.obs:9: found '4 A C -3.0', expected a code, origin, target"),
        ("4 A C -3.0 0.001", "4 A C -3.0 0", r"n\.obs:9: found the σ 0, expected more than 0"),
        ("4 A C -3.0 0.001", "@n.obs", "files name each other in a circle"),
        ("4 A C -3.0 0.001", "x A C", r"n\.obs:9: found 'x', expected a code"),
    ],
)
def test_mistakes_are_told_with_their_lines(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write(tmp_path)
    observations = tmp_path / "sub" / "n.obs"
    observations.write_text(observations.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def test_projections_and_projects_without_observations_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(COMP.replace('"use_proj" : false', '"use_proj" : true'))
    with pytest.raises(InputError, match="in a projection"):
        read_foreign(path)
    path.write_text(COMP)
    (tmp_path / "sub" / "n.obs").write_text("12 A @a.xyz\n")
    with pytest.raises(InputError, match=r"no observations that are read; left out: polar subframes \(12\)"):
        read_foreign(path)


def test_points_at_one_place_have_no_part_of_sigma_by_distance_and_deflections_are_refused(
    tmp_path: Path,
) -> None:
    path = write(tmp_path)
    (tmp_path / "n.cor").write_text(COR + "0 E 1000 2000 5\n")
    (tmp_path / "sub" / "more.obs").write_text("5 A E 10.0 0.001 0.002\n")
    notes = " ".join(map(str, read_foreign(path).notes))
    assert "parts of σ that depend on an unknown distance not read (1 record)" in notes
    (tmp_path / "n.cor").write_text(COR + "0 E 1 2 5 0 0 0 1.5 0\n")
    with pytest.raises(InputError, match=r"n\.cor:5: point E: deflections of the vertical are not read"):
        read_foreign(path)
