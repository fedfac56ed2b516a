"""The adjusted project of every kind of project: a second run from it converges at once, and to the same result."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.published_schemas import mistakes
from tests.scenarios.kinds_of_projects import KINDS, known_block, write_pixels
from tests.scenarios.small_projects import BLOCK, mor, write_block
from tests.selection import slow

NOT_COMPARED = {"iterations", "iteration_log", "tables", "datum", "identity", "notes"}


def adjust(project: Path, folder: Path) -> dict[str, Any]:
    run = mor("adjust", project, "-o", folder, "--no-html")
    assert run.code == 0, run.err
    assert mistakes(folder / "results.json") == []
    assert mistakes(folder / "adjusted.yaml") == []
    data: dict[str, Any] = json.loads((folder / "results.json").read_text())
    return data


OF_SAMPLES = [kind for kind in KINDS if kind.startswith("sample ") and kind != "sample bridge"]


@pytest.mark.parametrize("kind", [slow(kind) if kind in OF_SAMPLES else kind for kind in KINDS])
def test_second_run_converges_at_once_to_the_same_result(tmp_path: Path, kind: str) -> None:
    first = adjust(KINDS[kind](tmp_path), tmp_path / "first")
    second = adjust(tmp_path / "first" / "adjusted.yaml", tmp_path / "second")
    assert first["redundancy"] > 0
    assert second["iterations"] <= 2
    compare(first, second, kind)


@pytest.mark.parametrize("kind", ["total station", "stereo", "image variant"])
def test_third_run_writes_the_same_project_as_the_second(tmp_path: Path, kind: str) -> None:
    adjust(KINDS[kind](tmp_path), tmp_path / "first")
    adjust(tmp_path / "first" / "adjusted.yaml", tmp_path / "second")
    adjust(tmp_path / "second" / "adjusted.yaml", tmp_path / "third")
    second, third = (sorted((tmp_path / name).glob("start_*.csv")) for name in ("second", "third"))
    assert [path.name for path in second] == [path.name for path in third]


def test_meshes_are_found_from_the_folder_of_the_results(tmp_path: Path) -> None:
    project = write_block(tmp_path)
    (tmp_path / "hall.ply").write_text("ply\n")
    (tmp_path / "faces.csv").write_text("point,nx,ny,nz\n")
    text = project.read_text() + "visibility: {surfaces: [{file: hall.ply}], normals: [{file: faces.csv}]}\n"
    project.write_text(text)
    adjust(project, tmp_path / "deep" / "out")
    written = yaml.safe_load((tmp_path / "deep" / "out" / "adjusted.yaml").read_text())["visibility"]
    for entry in (*written["surfaces"], *written["normals"]):
        assert (tmp_path / "deep" / "out" / entry["file"]).resolve().parent == tmp_path.resolve()


def compare(first: Any, second: Any, where: str) -> None:
    if isinstance(first, dict):
        assert list(first) == list(second), where
        for key in first:
            if key not in NOT_COMPARED:
                compare(first[key], second[key], f"{where}: {key}")
    elif isinstance(first, list):
        assert len(first) == len(second), where
        for k, (one, other) in enumerate(zip(first, second, strict=True)):
            compare(one, other, f"{where}[{k}]")
    elif isinstance(first, float):
        # The influence is a quotient of a small residual: the round-off of coordinates of 1e6 m shows in it first.
        last = 1e-5 if where.endswith(": influence") else 1e-6
        assert second == pytest.approx(first, rel=last, abs=1e-6), where
    else:
        assert first == second, where


def test_original_is_not_touched(tmp_path: Path) -> None:
    project = write_block(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    adjust(project, tmp_path / "out")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_adjusted_project_is_found_from_a_folder_elsewhere(tmp_path: Path) -> None:
    adjust(write_block(tmp_path / "deep" / "project"), tmp_path / "other" / "place")
    assert mor("adjust", tmp_path / "other" / "place" / "adjusted.yaml").code == 0


def test_image_points_in_pixels_are_those_in_millimetres(tmp_path: Path) -> None:
    """The corner, the flip and the pixel size change nothing: opencv without distortion is mor without distortion."""
    plain = adjust(known_block(tmp_path / "mm", BLOCK), tmp_path / "mm" / "out")
    for model, interior in (("mor", "{c: 20}"), ("opencv", "{fx: 20, fy: 20, cx: 1500 px, cy: 1000 px}")):
        project = write_pixels(tmp_path / model, model, interior)
        bar = next(line for line in (tmp_path / "mm" / "project.yaml").read_text().splitlines() if "distance" in line)
        project.write_text(
            project.read_text().replace("observations:", f"observations:\n{bar}").replace("0.2 px", "2 um")
        )
        found = adjust(project, tmp_path / model / "out")
        for key in ("sigma0", "points"):
            compare(found[key], plain[key], f"{model}: {key}")
        assert {row["unit"] for row in found["residuals"] if row["type"].startswith("image")} == {"px"}
