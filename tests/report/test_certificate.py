"""The certificate of a camera, and its calibration in other programs' files: seen by those who know nothing of mor."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.stats import t as student

from mor.report.certificate import certificate
from mor.report.layout import WIDTH
from mor.report.view import view_of_folder
from mor.types import FloatArray
from tests.scenarios.small_projects import mor

SAMPLES = Path(__file__).parents[2] / "sample_projects"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificate") / "results"
    assert mor("adjust", SAMPLES / "facade" / "project.yaml", "-o", folder, "--no-html").code == 0
    return folder


def mm_of_model(results: Path, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Image of the rays (u, v, −1) by the equations of docs/camera-models.md, written out; px from the corner."""
    camera = next(c for c in view_of_folder(results).cameras if c["id"] == "D7")
    p = {name: row["value"] for name, row in camera["components"].items()}
    x, y = p["c"] * u, p["c"] * v
    r2, r02 = x * x + y * y, camera["r0"] ** 2
    k = p["A1"] * (r2 - r02) + p["A2"] * (r2**2 - r02**2) + p["A3"] * (r2**3 - r02**3)
    dx = x * k + p["B1"] * (r2 + 2 * x * x) + 2 * p["B2"] * x * y
    dy = y * k + p["B2"] * (r2 + 2 * y * y) + 2 * p["B1"] * x * y
    return 3000.0 + (p["xh"] + x + dx) / 0.006, 2000.0 - (p["yh"] + y + dy) / 0.006


def rays() -> tuple[FloatArray, FloatArray]:
    u, v = np.meshgrid(np.linspace(-0.55, 0.55, 9), np.linspace(-0.35, 0.35, 7))
    return u.ravel(), v.ravel()


def brown(u: FloatArray, v: FloatArray, k: tuple[float, ...], p: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Normalised coordinates as OpenCV distorts them, y downwards (documentation of calib3d)."""
    r2 = u * u + v * v
    radial = 1.0 + k[0] * r2 + k[1] * r2**2
    x = u * radial + 2 * p[0] * u * v + p[1] * (r2 + 2 * u * u)
    y = v * radial + p[0] * (r2 + 2 * v * v) + 2 * p[1] * u * v
    return x, y


def exported(results: Path, form: str, tmp_path: Path) -> str:
    target = tmp_path / form
    assert mor("certificate", results, "D7", "--to", form, "-o", target).code == 0
    return target.read_text()


def test_colmap_opencv_and_metashape_image_the_same_rays_alike(results: Path, tmp_path: Path) -> None:
    u, v = rays()
    wanted = np.array(mm_of_model(results, u, v))
    fx, fy, cx, cy, k1, k2, p1, p2 = map(float, exported(results, "colmap", tmp_path).split()[4:])
    x, y = brown(u, -v, (k1, k2), (p1, p2))
    np.testing.assert_allclose([fx * x + cx, fy * y + cy], wanted, atol=1e-7)
    lists = re.findall(r"data: \[ (.*?) \]", exported(results, "opencv", tmp_path))
    matrix, distortion = ([float(n) for n in found.split(",")] for found in lists)
    x, y = brown(u, -v, (distortion[0], distortion[1]), (distortion[2], distortion[3]))
    found = [matrix[0] * x + matrix[2] + 0.5, matrix[4] * y + matrix[5] + 0.5]
    np.testing.assert_allclose(found, wanted, atol=1e-7)
    tree = ElementTree.fromstring(exported(results, "metashape", tmp_path))
    m = {child.tag: float(child.text or 0) for child in tree if child.tag != "projection"}
    r2 = u * u + v * v
    radial = 1.0 + m["k1"] * r2 + m["k2"] * r2**2
    x = u * radial + m["p1"] * (r2 + 2 * u * u) + 2 * m["p2"] * u * -v
    y = -v * radial + m["p2"] * (r2 + 2 * v * v) + 2 * m["p1"] * u * -v
    f = m["f"]
    found = [m["width"] / 2 + m["cx"] + x * (f + m["b1"]), m["height"] / 2 + m["cy"] + y * f]
    np.testing.assert_allclose(found, wanted, atol=1e-7)


def test_aicon_says_the_numbers_of_the_model(results: Path, tmp_path: Path) -> None:
    lines = [line.split() for line in exported(results, "aicon", tmp_path).splitlines()]
    camera = next(c for c in view_of_folder(results).cameras if c["id"] == "D7")
    p = {name: row["value"] for name, row in camera["components"].items()}
    numbers = [float(word) for word in [*lines[0][2:], *lines[1], *lines[2], *lines[3]]]
    names = ("xh", "yh", "A1", "A2")
    wanted = [-p["c"], *(p[n] for n in names), camera["r0"], *(p[n] for n in ("A3", "B1", "B2", "C1", "C2"))]
    assert numbers == pytest.approx(wanted, rel=1e-12)
    assert lines[4] == ["36.0", "24.0", "6000", "4000"]


def test_photomodeler_wants_its_own_model(results: Path, tmp_path: Path) -> None:
    run = mor("certificate", results, "D7", "--to", "photomodeler", "-o", tmp_path / "x")
    assert run.code == 2
    assert "PhotoModeler's model is brown; the numbers of mor say other things" in run.err
    assert not (tmp_path / "x").exists()


def test_how_far_out_points_were_measured(results: Path) -> None:
    """Against the image points of the sample, which count from the corner, y down."""
    view = view_of_folder(results)
    one = certificate(view, "D7")
    p = {name: row["value"] for name, row in one.camera["components"].items()}
    rays = view.rays
    x, y = (rays.filter(rays["component"] == name)["observed"].to_numpy() for name in "xy")
    radii = np.hypot((x - 3000) * 0.006 - p["xh"], (2000 - y) * 0.006 - p["yh"])
    assert one.covered == pytest.approx(radii.max(), rel=1e-9)
    corners = [np.hypot(18 * a - p["xh"], 12 * b - p["yh"]) for a in (-1, 1) for b in (-1, 1)]
    assert one.corner == pytest.approx(max(corners), rel=1e-9)
    assert one.rays == len(x)
    assert (one.images, one.table.radius[-1] <= max(corners)) == (14, True)


@pytest.mark.parametrize("language", ["en", "de"])
def test_page_and_text_say_the_same(results: Path, tmp_path: Path, language: str) -> None:
    for name in ("one.html", "one.txt"):
        assert mor("certificate", results, "D7", "-o", tmp_path / name, "--lang", language).code == 0
    page, text = ((tmp_path / name).read_text(encoding="utf-8") for name in ("one.html", "one.txt"))
    assert max(map(len, text.split("\n"))) <= WIDTH
    assert "<script" not in page
    value = "28.37459"
    assert value in page
    assert (value.replace(".", ",") if language == "de" else value) in text
    assert ("Unterschrift" if language == "de" else "signature") in page
    run = mor("certificate", results, "D7", "-o", tmp_path / "one.txt")
    assert run.code == 2


@pytest.mark.parametrize("language", ["en", "de"])
def test_expanded_uncertainties(results: Path, tmp_path: Path, language: str) -> None:
    for name in ("one.html", "one.txt"):
        run = mor("certificate", results, "D7", "-o", tmp_path / name, "--lang", language, "--coverage", "2.5")
        assert run.code == 0
    page, text = ((tmp_path / name).read_text(encoding="utf-8") for name in ("one.html", "one.txt"))
    view = view_of_folder(results)
    sigma = next(c for c in view.cameras if c["id"] == "D7")["components"]["c"]["sigma"]
    p = f"{100.0 * (1.0 - 2.0 * student.sf(2.5, view.summary['redundancy'])):.2f}"
    assert f"<td>{2.5 * sigma:.3g}</td>" in page
    assert ("Überdeckungswahrscheinlichkeit" if language == "de" else "coverage probability") in page
    comma = str.maketrans(".", ",") if language == "de" else {}
    assert f"{2.5 * sigma:.3g}".translate(comma) in text
    assert f" {p.translate(comma)} % " in " ".join(text.split())
    assert max(map(len, text.split("\n"))) <= WIDTH


def test_mistakes(results: Path, tmp_path: Path) -> None:
    run = mor("certificate", results, "D8", "-o", tmp_path / "x.html")
    assert (run.code, run.err) == (2, "unknown camera 'D8' (known: D7)\n")
    assert mor("certificate", results, "D8", "--to", "opencv", "-o", tmp_path / "x").code == 2
    assert "ends in .html" in mor("certificate", results, "D7", "-o", tmp_path / "x.doc").err
    assert mor("certificate", tmp_path, "D7").code == 2


def test_pdf_is_one_sheet(tmp_path: Path) -> None:
    pytest.importorskip("reportlab")
    assert mor("adjust", SAMPLES / "facade" / "project.yaml", "-o", tmp_path / "results", "--no-html").code == 0
    target = tmp_path / "d7.pdf"
    assert mor("certificate", tmp_path / "results", "D7", "-o", target, "--coverage", "2").code == 0
    assert target.read_bytes().startswith(b"%PDF")
    assert b"/Count 1 " in target.read_bytes()
