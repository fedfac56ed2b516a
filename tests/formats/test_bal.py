"""BAL and Bundler: round trips, the same minimum, mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mor
from mor.api.pipeline import read_document, solve_network
from mor.errors import InputError
from mor.formats import format_of, read_foreign, write_foreign
from tests.reference_data import network_of, point_results

from .blocks import MODELS, block, written


def _bal(folder: Path, seed: int = 4) -> tuple[Path, Path]:
    """A block as a project, and as BAL."""
    data = block(seed, "RADIAL", noise=0.5)
    camera = data["cameras"]["7"]
    camera["interior"] = {k: {"free": repr(MODELS["RADIAL"][k])} for k in ("c", "A1", "A2")}
    data["cameras"] = {str(k): dict(camera) for k in range(6)}
    for k, row in enumerate(data["images"][0]["rows"]):
        row[0], row[1] = f"{k}", f"{k}"
    for row in data["observations"][0]["rows"]:
        row[0] = str(int(row[0]) - 1)
    source = written(folder, data)
    out = write_foreign(read_document(source), folder, folder / "problem.txt", "bal")
    for path, content in out.files.items():
        path.write_bytes(content)
    return source, folder / "problem.txt"


def test_a_round_trip_is_an_identity_and_has_the_same_minimum(tmp_path: Path) -> None:
    source, bal = _bal(tmp_path)
    assert format_of(bal) == "bal"
    document, again = read_document(source), read_foreign(bal)
    before, after = network_of(document, tmp_path), network_of(again, tmp_path)
    for kind, values in before.start.items():
        np.testing.assert_allclose(after.start[kind], values, rtol=1e-11, atol=1e-11, err_msg=kind)
    observed = [np.concatenate([group.observed for group in network.groups]) for network in (before, after)]
    np.testing.assert_allclose(np.sort(observed[1], axis=0), np.sort(observed[0], axis=0), rtol=0, atol=1e-9)
    results = [solve_network(network) for network in (before, after)]
    costs = [sum(float((q.v**2).sum()) for q in solved.quality.groups) for solved in results]
    assert costs[1] == pytest.approx(costs[0], rel=1e-9)
    places = [np.array([xyz for xyz, _ in point_results(solved).values()]) for solved in results]
    np.testing.assert_allclose(places[1], places[0], rtol=0, atol=1e-9)


def test_the_minimum_is_that_of_the_published_equation(tmp_path: Path) -> None:
    """At the adjusted values the equation of BAL, evaluated here, has the sum of squares that is reported."""
    _, bal = _bal(tmp_path)
    result = mor.adjust(str(bal))
    cost = sum(float((q.v**2).sum()) for q in result.solved.quality.groups)
    document = result.project.document
    solved, network = result.solved, result.solved.network
    images, points = network.things["image"], network.things["point"]
    total = 0.0
    for image, point, x, y in document.frames["image points"].rows():
        R = solved.adjustment.values["rotation"][images.part(image, "rotation")]
        centre = solved.adjustment.values["point"][images.part(image, "position")]
        X = solved.adjustment.values["point"][points.part(point, "position")]
        names = network.blocks["interior/mor"].kind.names
        interior = dict(
            zip(names, solved.adjustment.values["interior/mor"][images.part(image, "interior")], strict=True)
        )
        P = R @ X - R @ centre
        p = -P[:2] / P[2]
        f = interior["c"]
        r2 = float(p @ p)
        seen = f * (1 + interior["A1"] * f**2 * r2 + interior["A2"] * f**4 * r2**2) * p
        total += float(((seen - [x, y]) ** 2).sum())
    assert total == pytest.approx(cost, rel=1e-9)


def test_bundler(tmp_path: Path) -> None:
    """One image without orientation (f = 0) is left out."""
    path = tmp_path / "bundle.out"
    eye = "1 0 0\n0 1 0\n0 0 1\n"
    path.write_text(
        f"# Bundle file v0.3\n3 2\n500 -0.1 0.01\n{eye}0 0 0\n0 0 0\n{eye}0 0 0\n510 0 0\n{eye}-1 0 0\n"
        "0 0 -5\n255 255 255\n2 0 11 10.5 -20 2 12 3 4\n1 1 -6\n0 0 0\n3 0 1 5 6 1 2 7 8 2 3 9 10\n"
    )
    assert format_of(path) == "bundler"
    document = read_foreign(path)
    assert document.frames["image points"].rows() == [
        ("0", "0", 10.5, -20.0), ("2", "0", 3.0, 4.0), ("0", "1", 5.0, 6.0), ("2", "1", 9.0, 10.0),
    ]  # fmt: skip
    assert [row[:3] for row in document.data["images"][0]["rows"]] == [["0", "0", "-0.0"], ["2", "2", "1.0"]]
    assert "1 images have no focal length" in " ".join(map(str, document.notes))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 1 1\n0 0 1.0 x\n", r"bal:2: found 'x', expected a number"),
        (
            "1 1 1\n0 1 1.0 2.0\n" + "1\n" * 12,
            r"bal:2: found '0', expected a camera below 1 and a point below 1",
        ),
        ("1 1 1\n0 0 1.0 2.0\n1 2 3\n", r"bal:3: found the end of the file, expected 9 numbers"),
        ("1 1 1\n0 0 1.0 2.0\n" + "1\n" * 13, r"bal:15: found '1', expected the end of the file"),
        ("1.5 1 1\n0 0 1 2\n" + "1\n" * 12, r"bal:1: found '1\.5', expected the number of cameras"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.bal"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_foreign(path)


def test_other_cameras_are_refused(tmp_path: Path) -> None:
    source = written(tmp_path, block(3, "OPENCV"))
    with pytest.raises(InputError, match="BAL has c, A1 and A2 of model mor"):
        write_foreign(read_document(source), tmp_path, tmp_path / "x.bal", "bal")
