"""Results as a user reads them: names kept, units in every header, keys and signs as documented."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenarios.kinds_of_projects import INTERIOR, known_block, local_system, stereo, total_station
from tests.scenarios.small_projects import BLOCK, LEVELLING, block, mor, table, write, write_block

ODD = ("010", "no", "1e3", "12:30")
"""Names that careless readers turn into 8, False, 1000.0 and 750."""
KEYS = {
    "outcome",
    "iterations",
    "observations",
    "unknowns",
    "defect",
    "redundancy",
    "sigma0",
    "points",
    "images",
    "cameras",
}
RESIDUAL_KEYS = {"type", "component", "observed", "adjusted", "v", "sigma", "r", "w"}


def adjust(project: Path, folder: Path) -> dict[str, Any]:
    run = mor("adjust", project, "-o", folder)
    assert run.code == 0, run.err
    data: dict[str, Any] = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    return data


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The block with its points called like its images."""
    folder = tmp_path_factory.mktemp("odd")
    found = block(noise=0.002)
    new = dict(zip((f"P{i}" for i in range(4)), ODD, strict=True))
    odd = found._replace(
        points=[[new.get(row[0], row[0]), *row[1:]] for row in found.points],
        rays=[[row[0], new.get(row[1], row[1]), *row[2:]] for row in found.rays],
    )
    adjust(write_block(folder, rows=odd), folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("json")
    return adjust(known_block(folder, BLOCK.replace(INTERIOR, "{interior: {c: {free: 20}}}")), folder / "out")


class TestNames:
    @pytest.mark.parametrize("name", ["points.csv", "images.csv", "start_points.csv", "start_images.csv"])
    def test_in_tables(self, folder: Path, name: str) -> None:
        assert [row["id"] for row in rows(folder / name)[:4]] == list(ODD)

    def test_in_residuals(self, folder: Path) -> None:
        table_ = rows(folder / "residuals.csv")
        assert set(ODD) == {row["from"] for row in table_}
        assert set(ODD) <= {row["to"] for row in table_}

    def test_in_json(self, folder: Path) -> None:
        data = json.loads((folder / "results.json").read_text())
        assert [point["id"] for point in data["points"][:4]] == list(ODD)
        assert [image["id"] for image in data["images"]] == list(ODD)

    def test_in_the_report(self, folder: Path) -> None:
        report = (folder / "report.txt").read_text()
        points = report.split("Points (")[1].split("Root mean")[0]
        images = report.split("\nImages\n")[1].split("\n\n")[0]
        for name in ODD:
            assert re.search(rf"^{re.escape(name)} ", points, re.M), name
            assert re.search(rf"^{re.escape(name)} ", images, re.M), name

    def test_in_rows_of_the_project_file(self, tmp_path: Path) -> None:
        text = LEVELLING
        for old, new in zip("ABC", ("no", "0x10", "2001-01-01"), strict=True):
            text = re.sub(rf"\b{old}\b", new, text)
        data = adjust(write(tmp_path, text), tmp_path / "out")
        assert [point["id"] for point in data["points"]] == ["no", "0x10", "2001-01-01"]


class TestJson:
    def test_keys(self, data: dict[str, Any]) -> None:
        assert set(data) >= KEYS
        assert (data["schema"], data["schema_version"]) == ("mor-results", 2)
        assert set(data["sigma0"]) >= {"apriori", "aposteriori", "ratio"}
        assert set(data["points"][0]) >= {"id", "x", "y", "z", "sx", "sy", "sz"}
        assert set(data["residuals"][0]) >= RESIDUAL_KEYS

    def test_counts(self, data: dict[str, Any]) -> None:
        assert data["outcome"] == "converged"
        assert (data["observations"], data["unknowns"], data["defect"]) == (97, 61, 6)
        assert data["redundancy"] == 97 - 61 + 6
        assert data["redundancy_sum"] == pytest.approx(data["redundancy"], abs=1e-9)

    def test_sigma0_follows_from_the_residuals(self, data: dict[str, Any]) -> None:
        """Uncorrelated observations: vᵀPv = Σ (v/σ)²."""
        omega = sum((row["v"] / row["sigma"]) ** 2 for row in data["residuals"])
        assert data["global_test"]["statistic"] == pytest.approx(omega, rel=1e-9)
        assert data["sigma0"]["aposteriori"] == pytest.approx((omega / data["redundancy"]) ** 0.5, rel=1e-9)
        assert data["sigma0"]["ratio"] == pytest.approx(omega / data["redundancy"], rel=1e-9)

    def test_residual_is_adjusted_minus_observed(self, data: dict[str, Any]) -> None:
        for row in data["residuals"]:
            assert row["v"] == pytest.approx(row["adjusted"] - row["observed"], abs=1e-12)

    def test_normalised_residual(self, data: dict[str, Any]) -> None:
        for row in data["residuals"]:
            if row["r"] > 1e-6:
                assert row["w"] == pytest.approx(row["v"] / (row["sigma"] * row["r"] ** 0.5), rel=1e-6)

    def test_single_scale_bar_is_not_controlled(self, data: dict[str, Any]) -> None:
        (bar,) = [row for row in data["residuals"] if row["type"] == "distance"]
        assert bar["r"] == pytest.approx(0.0, abs=1e-9)
        assert (bar["w"], bar["flag"]) == (None, "uncontrolled")

    def test_table_and_json_say_the_same(self, tmp_path: Path) -> None:
        data = adjust(write_block(tmp_path), tmp_path / "out")
        for one, other in zip(rows(tmp_path / "out" / "residuals.csv"), data["residuals"], strict=True):
            assert one["from"] == other["from"]
            assert float(one["v"]) == other["v"]

    def test_no_names_of_machines_or_times(self, tmp_path: Path) -> None:
        date = adjust(write_block(tmp_path), tmp_path / "out")["identity"]["date"]
        for path in (tmp_path / "out").iterdir():
            text = path.read_text()
            assert str(tmp_path) not in text
            text = text.replace(date, "")  # of the data, not of the run
            assert not re.search(r"\b20\d\d-\d\d-\d\d\b|\b\d\d:\d\d:\d\d\b", text), path.name


WITHOUT_UNIT = {
    "",
    "id",
    "point",
    "image",
    "camera",
    "points",
    "rays",
    "others",
    "status",
    "group",
    "type",
    "n",
    "sum r",
}
WITHOUT_UNIT |= {"vTPv", "flagged", "kind", "block", "component", "unit", "between", "flag", "feature"}
WITHOUT_UNIT |= {"tested", "name", "status", "p", "weakest", "id", "observation", "nabla"}
BESIDE_UNIT = {"value", "sigma", "observed", "v", "rms v"}
"""Columns of rows of different kinds: their unit is in the column beside."""


def headers(report: str) -> list[list[str]]:
    """Headers of all tables of a report."""
    lines = report.splitlines()
    return [
        re.split(r"\s{2,}", lines[i - 1].strip())
        for i, line in enumerate(lines)
        if re.fullmatch(r"-+( {2}-+)+", line.strip()) and lines[i - 1].strip()
    ]


KINDS = {
    "levelling": lambda folder: write(folder, LEVELLING),
    "calibration": lambda folder: known_block(
        folder, BLOCK.replace(INTERIOR, "{interior: {c: {free: 20}, xh: {free: 0}}}")
    ),
    "image variant": lambda folder: known_block(
        folder, BLOCK.replace(INTERIOR, "{interior: {c: 20, xh: 0}, image_variant: {c: 5 um}}")
    ),
    "stereo": stereo,
    "local system": local_system,
    "total station": lambda folder: write(folder, total_station()),
    "plane": lambda folder: known_block(
        folder, BLOCK + "features: [{type: plane, id: wall, points: [P0, P1, P2, P3], sigma: 0.2}]\n"
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_header_of_the_report_has_its_unit(tmp_path: Path, kind: str) -> None:
    adjust(KINDS[kind](tmp_path), tmp_path / "out")
    found = headers((tmp_path / "out" / "report.txt").read_text(encoding="utf-8"))
    assert len(found) >= 3
    for names in found:
        beside = BESIDE_UNIT if "unit" in names else set()
        for name in names:
            correlations = names[0] == "" or not any("[" in n for n in names)
            has_unit = re.search(r"\[[^\]]+\]$", name) is not None
            assert has_unit or name in WITHOUT_UNIT | beside or correlations, (kind, names, name)


def test_units_of_the_project_are_those_of_the_report(tmp_path: Path) -> None:
    report = tmp_path / "out" / "report.txt"
    adjust(write(tmp_path, LEVELLING.replace("{length: m}", "{length: mm}")), tmp_path / "out")
    assert "sZ [mm]" in report.read_text()
    assert "sZ [m]" not in report.read_text()


class TestUnitsIn:
    """The same levelling in other units is the same levelling."""

    def heights(self, folder: Path, text: str) -> np.ndarray:
        data = adjust(write(folder, text), folder / "out")
        return np.array([[p["z"], p["sz"]] for p in data["points"]])

    def test_cells(self, tmp_path: Path) -> None:
        plain = self.heights(tmp_path / "m", LEVELLING)
        text = LEVELLING.replace("1.001, 0.001", "1001 mm, 1000 um").replace("1.002, 0.001", "100.2 cm, 0.1cm")
        assert self.heights(tmp_path / "mm", text) == pytest.approx(plain, rel=1e-12, abs=1e-12)

    def test_columns(self, tmp_path: Path) -> None:
        plain = self.heights(tmp_path / "m", LEVELLING)
        text = LEVELLING.replace("  - type: height", "  - units: {sigma: mm}\n    type: height").replace(
            ", 0.001]", ", 1]"
        )
        assert self.heights(tmp_path / "mm", text) == pytest.approx(plain, rel=1e-12, abs=1e-12)

    def test_feet(self, tmp_path: Path) -> None:
        plain = self.heights(tmp_path / "m", LEVELLING)
        text = LEVELLING.replace("{length: m}", "{length: ft}").replace("0.001]", "1 mm]")
        for number in ("1.001", "1.002", "-2.001"):
            text = text.replace(f"{number},", f"{number} m,")
        text = (
            text.replace("0, 0, 10]", "0, 0, 10 m]")
            .replace("0, 0, 11]", "0, 0, 11 m]")
            .replace("0, 0, 12]", "0, 0, 12 m]")
        )
        assert self.heights(tmp_path / "ft", text) * 0.3048 == pytest.approx(plain, rel=1e-12, abs=1e-12)

    @pytest.mark.parametrize(
        ("angle", "written"),
        [
            ("gon", "39.5000"),
            ("deg", "35.55"),
            ("dms", "35-33-00"),
            ("dms", "'35:33:00'"),
            ("dms", "35°33'00\""),
            ("mrad", "620.4645490"),
            ("gon", "395000 cc"),
            ("deg", "127980 arcsec"),
        ],
    )
    def test_angles(self, tmp_path: Path, angle: str, written: str) -> None:
        """A bearing of 39.5 gon, however it is written."""
        text = f"""\
mor: 1
units: {{angle: {angle}}}
points:
  - {{columns: [id, x, y, z], rows: [[A, 0, 0, 0]], fixed: [x, y, z]}}
  - {{columns: [id, x, y, z], rows: [[B, 50, 70, 0]], fixed: [z]}}
observations:
  - type: bearing
    columns: [from, to, bearing]
    rows: [[A, B, {json.dumps(written.strip("'"))}]]
    values: {{sigma: 1 mgon}}
  - {{type: horizontal_distance, columns: [from, to, distance, sigma], rows: [[A, B, 100, 0.001]]}}
"""
        data = adjust(write(tmp_path, text), tmp_path / "out")
        t = 39.5 * np.pi / 200.0
        found = [data["points"][1][key] for key in ("x", "y", "sx", "sy")]
        sigma = 0.001 * np.pi / 200.0 * 100.0
        spread = [
            np.hypot(sigma * np.cos(t), 0.001 * np.sin(t)),
            np.hypot(sigma * np.sin(t), 0.001 * np.cos(t)),
        ]
        assert found == pytest.approx([100.0 * np.sin(t), 100.0 * np.cos(t), *spread], rel=1e-7)

    @pytest.mark.parametrize("sigma", ["2 um", "0.002", "0.002 mm", "2um"])
    def test_sigma_of_image_coordinates(self, tmp_path: Path, sigma: str) -> None:
        data = adjust(write_block(tmp_path, BLOCK.replace("2 um", sigma)), tmp_path / "out")
        assert {row["sigma"] for row in data["residuals"]} == {0.002}

    def test_values_with_units_in_a_camera(self, tmp_path: Path) -> None:
        data = adjust(
            known_block(tmp_path, BLOCK.replace(INTERIOR, "{interior: {c: {observed: 2 cm, sigma: 1 um}, xh: 5 um}}")),
            tmp_path / "out",
        )
        components = data["cameras"][0]["components"]
        assert components["c"]["value"] == pytest.approx(20.0, abs=0.01)
        assert components["xh"] == {"value": 0.005, "sigma": None, "status": "fixed"}

    def test_values_with_units_of_a_parameter(self, tmp_path: Path) -> None:
        entry = "  - {type: parameter, columns: [of, component, value, sigma], rows: [[point B, z, 1100 cm, 1 mm]]}\n"
        data = adjust(write(tmp_path, LEVELLING + entry), tmp_path / "out")
        (row,) = [row for row in data["residuals"] if row["type"] == "parameter"]
        assert (row["observed"], row["sigma"], row["unit"]) == (11.0, 0.001, "m")


def test_table_with_skipped_and_renamed_columns(tmp_path: Path) -> None:
    found = block(noise=0.002)
    rays = table("photo,junk,target,u,v", [[r[0], "x", *r[1:]] for r in found.rays])
    columns = "{photo: image, target: point, u: x, v: y, junk: null}"
    text = BLOCK.replace("file: rays.csv", f"file: rays.csv\n    columns: {columns}")
    plain = adjust(write_block(tmp_path / "plain"), tmp_path / "one")
    other = adjust(write_block(tmp_path / "renamed", text, rays=rays), tmp_path / "two")
    assert {**other, "identity": plain["identity"]} == plain


def test_table_without_header_with_comments_and_spaces(tmp_path: Path) -> None:
    found = block(noise=0.002)
    lines = [
        "# image point x y",
        "",
        *(" ".join(map(str, [r[0], r[1], repr(r[2]), repr(r[3])])) for r in found.rays),
    ]
    text = BLOCK.replace("file: rays.csv", "file: rays.csv\n    columns: [image, point, x, y]\n    delimiter: ' '")
    plain = adjust(write_block(tmp_path / "plain"), tmp_path / "one")
    other = adjust(write_block(tmp_path / "bare", text, rays="\n".join(lines) + "\n"), tmp_path / "two")
    assert {**other, "identity": plain["identity"]} == plain
