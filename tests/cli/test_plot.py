"""``mor plot``: every kind in every format, the same bytes twice, mistakes in words."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from mor.cli import run
from mor.cli.plot import KINDS, view_of_source
from mor.report.layout import ellipse_lines
from mor.report.page_data import covariances
from mor.report.summary import SCHEMA_VERSION
from mor.report.view import View
from tests.scenarios.small_projects import LEVELLING, mor
from tests.selection import slow_after

SAMPLES = Path(__file__).parents[2] / "sample_projects"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plots") / "results"
    project = SAMPLES / "building" / "project.yaml"
    assert run(["adjust", str(project), "-o", str(folder), "--quiet", "--no-html"]) == 0
    return folder


@pytest.mark.parametrize("kind", slow_after(1, KINDS))
def test_same_results_same_picture(results: Path, tmp_path: Path, kind: str) -> None:
    for name in ("first.svg", "second.svg"):
        assert run(["plot", kind, str(results), "-o", str(tmp_path / name)]) == 0
    first, second = ((tmp_path / name).read_text() for name in ("first.svg", "second.svg"))
    assert first == second
    assert not re.search(r"<dc:date>", first)


@pytest.mark.parametrize(("suffix", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_formats(results: Path, tmp_path: Path, suffix: str, magic: bytes) -> None:
    paths = [tmp_path / f"{k}.{suffix}" for k in (1, 2)]
    for path in paths:
        assert run(["plot", "histogram", str(results), "-o", str(path)]) == 0
    assert paths[0].read_bytes().startswith(magic)
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_results_on_disk_and_the_project_show_the_same(results: Path) -> None:
    read, made = view_of_source(results), view_of_source(SAMPLES / "building" / "project.yaml")
    assert read.points["id"].to_list() == made.points["id"].to_list()
    np.testing.assert_allclose(covariances(read.points), covariances(made.points), rtol=1e-6, atol=1e-15)
    assert read.residuals.select("from", "to", "flag").equals(made.residuals.select("from", "to", "flag"))
    np.testing.assert_allclose(read.residuals["v"].to_numpy(), made.residuals["v"].to_numpy(), rtol=1e-6, atol=1e-10)


def test_ellipse_has_the_semi_axes_of_the_covariance() -> None:
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    covariance = turn @ np.diag([4.0, 0.25]) @ turn.T
    line = ellipse_lines(np.array([[10.0, 20.0]]), covariance[None], 3.0, 49)[0] - [10.0, 20.0]
    size = np.hypot(*line.T)
    assert size.max() == pytest.approx(6.0)
    assert size.min() == pytest.approx(1.5)
    longest = line[np.argmax(size)] / size.max()
    assert abs(longest @ [0.8, 0.6]) == pytest.approx(1.0)


def test_semi_axes_of_the_table_follow_from_its_sigmas_and_correlations(results: Path) -> None:
    view = view_of_source(results)
    axes = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances(view.points))[:, ::-1], 0.0))
    table = view.points.select("ellipsoid_a", "ellipsoid_b", "ellipsoid_c").to_numpy()
    np.testing.assert_allclose(axes, table, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["network", "{results}", "-o", "{new}/x.bmp"], "unknown format '.bmp'"),
        (
            ["residuals", "{results}", "--of", "B0l", "-o", "{new}/x.svg"],
            "unknown image 'B0l'; did you mean 'B",
        ),
        (["camera", "{results}", "--of", "D7", "-o", "{new}/x.svg"], "unknown camera 'D7'"),
        (["network", "{new}", "-o", "{new}/x.svg"], ""),
        (["network", "{results}", "--of", "B01", "-o", "{new}/x.svg"], "shows everything"),
    ],
)
def test_mistakes(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    places = {"results": str(results), "new": str(tmp_path)}
    assert run(["plot", *(argument.format(**places) for argument in arguments)]) == 2
    assert words in capsys.readouterr().err


def test_a_picture_is_not_replaced_unasked(results: Path, tmp_path: Path) -> None:
    path = tmp_path / "w.svg"
    path.write_text("mine")
    assert run(["plot", "histogram", str(results), "-o", str(path)]) == 2
    assert path.read_text() == "mine"
    assert run(["plot", "histogram", str(results), "-o", str(path), "--force"]) == 0


@pytest.mark.slow
def test_a_long_title_leaves_the_network_its_size(results: Path, tmp_path: Path) -> None:
    from mor.report.plots import network, save

    view: View = view_of_source(results)
    sizes = []
    for title in ("short", "very long " * 40):
        figure = network(replace(view, summary={**view.summary, "title": title}))
        save(figure, tmp_path / "network.png", force=True)
        sizes.append(figure.axes[0].get_position().size)
    assert np.allclose(*sizes, rtol=0.02)


def test_network_without_images_or_stations_is_drawn(results: Path) -> None:
    from mor.report.plots import network

    view: View = view_of_source(results)
    nothing = pl.DataFrame({"id": []}, {"id": pl.String})
    bare = replace(view, images=nothing, stations=nothing)
    assert network(bare).axes[0].get_xlabel() == "X [m]"


@pytest.mark.slow
def test_a_picture_in_german(results: Path, tmp_path: Path) -> None:
    """SVG has the letters of its texts in comments: words of both languages are told apart by them."""
    said = {}
    for language in ("en", "de"):
        path = tmp_path / f"{language}.svg"
        assert run(["plot", "network", str(results), "-o", str(path), "--lang", language]) == 0
        said[language] = set(re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8")))
    assert {"Strahlen", "Bilder", "Standpunkte", "Punkte"} <= said["de"]
    assert {"rays", "images", "stations", "points"} <= said["en"] - said["de"]
    assert any(text.endswith("Datum: fest") for text in said["de"])


def test_ellipses_of_heights_are_drawn_in_elevation(tmp_path: Path) -> None:
    """The plan of a levelling net has none."""
    project = tmp_path / "project.yaml"
    project.write_text(LEVELLING.replace("[B, 0, 0, 11]", "[B, 90, 0, 11]").replace("[C, 0, 0,", "[C, 0, 80,"))
    assert run(["plot", "ellipses", str(project), "-o", str(tmp_path / "e.svg")]) == 0
    assert run(["plot", "network", str(project), "-o", str(tmp_path / "n.svg")]) == 0
    words = [
        set(re.findall(r"<!-- (.*?) -->", (tmp_path / f"{name}.svg").read_text(encoding="utf-8"))) for name in "en"
    ]
    assert {"X [m]", "Z [m]"} <= words[0]
    assert any(text.startswith("1σ ellipses × ") for text in words[0])
    assert {"X [m]", "Y [m]"} <= words[1]


CURRENT = f'{{"schema_version": {SCHEMA_VERSION}'


@pytest.mark.parametrize(
    "content",
    ["[1", "[" * 100_000, "[]", "{}", CURRENT + "}", CURRENT + ', "global_test": 1, "points": 3}'],
)
def test_results_that_are_damaged(tmp_path, content):
    (tmp_path / "results.json").write_text(content)
    run = mor("plot", "network", tmp_path, "-o", tmp_path / "network.svg")
    assert run.code == 2
    assert run.err.startswith(f"{tmp_path / 'results.json'}: ")


def test_results_of_another_version_are_called_that(tmp_path):
    (tmp_path / "results.json").write_text('{"schema_version": 1, "global_test": {}, "points": []}')
    run = mor("plot", "network", tmp_path, "-o", tmp_path / "network.svg")
    words = "these results are of version 1, this program reads version 2; mor adjust --force writes them again"
    assert (run.code, run.err) == (2, f"{tmp_path / 'results.json'}: {words}\n")
