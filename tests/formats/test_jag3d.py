"""JAG3D's column text: its reference network with JAG3D's own results, other networks written and read, mistakes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from tests.reference_data import NETWORKS, missing, network_name, network_of, point_results, reference_folder

REAL = reference_folder("jag3d-net2d")
GON = np.pi / 200


def _reference(folder: Path, scenario: str) -> Path:
    """The reference network as its files would be imported into JAG3D: y, x; from, to, heights, value, σ."""
    assert REAL is not None
    points, observed = (pl.read_csv(REAL / f"{name}.csv", infer_schema=False) for name in ("points", "observations"))
    kinds = {"datum": "datum", "fixed": "reference", "new": "new"}
    files: dict[str, list[str]] = {}
    for row in points.iter_rows(named=True):
        name = f"{kinds[row[f'type_{scenario}']]}_points_2d.txt"
        files.setdefault(name, ["# y x"]).append(f"{row['point']}\t{row['y0_m']}  {row['x0_m']}")
    for row in observed.iter_rows(named=True):
        angular = row["type"] == "direction"
        name = f"directions_{row['group']}.txt" if angular else "horizontal_distances.txt"
        value, sigma = (float(row[key]) / (GON if angular else 1.0) for key in ("value", "sigma"))
        files.setdefault(name, []).append(f"{row['from']} {row['to']} 0 0 {value!r} {sigma!r}")
    for name, lines in files.items():
        (folder / name).write_text("\r\n".join(lines), newline="")
    return folder


@pytest.mark.skipif(REAL is None, reason=missing("jag3d-net2d"))
@pytest.mark.parametrize("scenario", ["free_all", "fixed"])
def test_the_reference_network_has_jag3ds_results(tmp_path: Path, scenario: str) -> None:
    assert REAL is not None
    folder = _reference(tmp_path, scenario)
    assert format_of(folder) == "jag3d"
    solved = solve_network(network_of(read_foreign(folder), folder))
    said = json.loads((REAL / "expected.json").read_text())["scenarios"][scenario]
    expected = pl.read_csv(REAL / "expected" / f"{scenario}-points.csv")
    factor = solved.quality.sigma0**2
    assert factor == pytest.approx(said["variance_factor_aposteriori"], rel=1e-8)
    found = point_results(solved)
    for row in expected.iter_rows(named=True):
        place, sigma = found[row["point"]]
        np.testing.assert_allclose(place[:2], [row["y_m"], row["x_m"]], rtol=0, atol=1e-9)
        expected_sigma = [row["sigma_y_m"], row["sigma_x_m"]]
        np.testing.assert_allclose(sigma[:2] * np.sqrt(factor), expected_sigma, rtol=1e-7, atol=1e-12)


WRITTEN = [path for path in NETWORKS if path.match("gama/[jks]*.yaml")][::2]
WRITTEN += [path for path in NETWORKS if path.match("textbook/[bk]*.yaml")][::2]


@pytest.mark.parametrize("path", WRITTEN, ids=network_name)
def test_written_networks_adjust_to_the_same(path: Path, tmp_path: Path) -> None:
    source = read_document(path)
    try:
        out = write_foreign(source, path.parent, tmp_path / "net", "jag3d")
    except InputError as error:
        if not any(
            words in str(error)
            for words in (
                "correlations",
                "or none",
                "no blanks",
                "no coordinates",
                "inner constraints",
                "none that it",
            )
        ):
            raise
        return
    if any("cannot store" in note.message for note in out.notes):
        return
    (tmp_path / "net").mkdir()
    for file, content in out.files.items():
        file.write_bytes(content)
    first = solve_network(network_of(source, path.parent))
    second = solve_network(network_of(read_foreign(tmp_path / "net"), tmp_path))
    before, after = point_results(first), point_results(second)
    metres, M = first.network.edge.metres, first.network.edge.matrix
    used = ["xyz".index(c) for c in first.network.project.settings.dimensions]
    scale = max(float(np.abs(xyz).max()) for xyz, _ in before.values()) * metres
    for name, (xyz, _) in before.items():
        limit = 1e-9 * max(scale, 1.0)
        np.testing.assert_allclose(after[name][0][used], (M @ xyz * metres)[used], rtol=0, atol=limit)


FILES = {
    "stochastic_points_3d.txt": "A 10 20 5 0.01\nB 110 20 6 0.01 0.02\nC 60 120 7 0.01 0.02 0.03\n",
    "new_points_3d.txt": "P 60 70 5\n",
    "directions_1.txt": "A B 0 0 10.5 0.001\nA P 61.9\n",
    "slope_distances.txt": "A P 1.5 1.3 70.7 0.002\nB P 70.7\nC P 50 0.003\n",
    "zenith_angles.txt": "A P 1.5 1.3 99.8 80\n",
    "leveling.txt": "A B 1.0 0.001\n",
    "readme.txt": "nothing\n",
}


def _write(folder: Path, **changes: str) -> Path:
    for name, text in FILES.items():
        (folder / name).write_text(changes.get(name[:-4], text))
    return folder


def test_what_the_files_say(tmp_path: Path) -> None:
    document = read_foreign(_write(tmp_path))
    stochastic = next(table for table in document.data["points"] if "sigma_x" in table["columns"])
    assert [row[4:] for row in stochastic["rows"]] == [
        ["0.01", "0.01", "0.01"],
        ["0.01", "0.01", "0.02"],
        ["0.01", "0.02", "0.03"],
    ]
    tables = {table["type"]: table["rows"] for table in document.data["observations"]}
    assert tables["distance"][0] == ["A", "P", "70.7", "0.002", "1.5", "1.3"]
    assert [row[3] for row in tables["distance"]] == ["0.002", "0.002", "0.003"]
    assert tables["zenith_angle"][0] == ["A", "P", "99.8", "0.0003", "1.5", "1.3"]
    notes = " ".join(map(str, document.notes))
    assert "readme.txt" in notes
    assert "1 line of zenith_angle without σ" in notes
    network_of(document, tmp_path)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("new_points_3d", "P 60 70\n", r"new_points_3d\.txt:1: found 2 numbers behind the name, expected 3"),
        (
            "new_points_3d",
            "A 60 70 5\n",
            r"point 'A' is in new_points_3d\.txt, too|point 'A' is in stochastic",
        ),
        ("directions_1", "A B\n", r"directions_1\.txt:1: found 2 words"),
        ("directions_1", "A A 10\n", r"directions_1\.txt:1: found 'A' at both ends"),
        ("leveling", "A B 1 1 5\n", r"leveling\.txt:1: found heights of staffs"),
        ("slope_distances", "# x\nA B x\n", r"slope_distances\.txt:2: found 'x', expected a number"),
        ("stochastic_points_3d", "A 1 2 3 -1\n", r"found the σ -1.0, expected up to 3 numbers above 0"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, name: str, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_foreign(_write(tmp_path, **{name: text}))


def test_what_it_cannot_say_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    text = "mor: 1\npoints:\n  - columns: [id, x, y, z]\n    rows: [[A B, 0, 0, 0]]\n    fixed: [x, y]\n"
    rows = "observations:\n  - type: distance\n    columns: [from, to, distance, sigma]\n    rows: [[A B, C, 5, 2]]\n"
    path.write_text(text + rows)
    with pytest.raises(InputError, match=r"no blanks and no #(.|\n)*all coordinates of a point, or none"):
        write_foreign(read_document(path), tmp_path, tmp_path / "net", "jag3d")
    path.write_text(text.replace("A B", "A").replace("[x, y]", "[x, y, z]") + rows.replace("A B", "A"))
    with pytest.raises(InputError, match="JAG3D reads a σ of 1 and more"):
        write_foreign(read_document(path), tmp_path, tmp_path / "net", "jag3d")
