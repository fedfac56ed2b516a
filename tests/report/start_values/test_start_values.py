"""What ``mor approximate`` says: every value, where it comes from, how good it is, and what is missing."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from mor import report, start
from mor.api.pipeline import make_problem, read_document, read_network, solve_network
from mor.report.language import words_of
from mor.report.start_values import StartValue, start_values
from mor.start.assembly import approximate
from tests.scenarios.mixtures.ingredients import mixture
from tests.scenarios.mixtures.project_file import write_project
from tests.scenarios.small_projects import mor, write
from tests.scenarios.undeterminable.plantings import write as write_world
from tests.scenarios.undeterminable.street import street

ROOT = Path(start.__file__).parent
REPORT = Path(report.__file__).parent


def _rows(path: Path) -> tuple[list[StartValue], object]:
    network = read_network(read_document(path), path.parent)
    found = approximate(network)
    return start_values(network, found, make_problem(network, found.start, found.start)), network


def test_every_value_is_said_to_be_given_found_or_missing(tmp_path: Path) -> None:
    nothing, truth = write_project(mixture(3), tmp_path)
    for path, status in ((truth, "given"), (nothing, "found")):
        rows, network = _rows(path)
        unknown = sum(int(blocks.free.any(axis=1).sum()) for blocks in network.blocks.values())
        assert len(rows) == unknown
        images = [row for row in rows if row.kind == "image"]
        assert images
        assert {row.status for row in images} == {status}
        assert all((row.how is not None) == (row.status == "found") for row in rows)
        assert all(row.status != "missing" for row in rows)


@pytest.mark.parametrize("seed", [3, 13])
def test_confidence_is_that_of_the_errors(tmp_path: Path, seed: int) -> None:
    """Errors of points against the adjusted values are of the order of what is said."""
    nothing, _ = write_project(mixture(seed), tmp_path)
    rows, network = _rows(nothing)
    solved = solve_network(network)
    sound = [row for row in rows if row.kind == "point" and np.isfinite(row.sigma).all()]
    number = network.things["point"].numbers
    adjusted = solved.adjustment.values["point"][network.things["point"].parts["position"]]
    start = np.array([row.values for row in sound])
    true = np.array([adjusted[number[row.name]] for row in sound])
    centred = start - start.mean(axis=0), true - true.mean(axis=0)
    left, values, right = np.linalg.svd(centred[0].T @ centred[1])
    scale = values.sum() / np.sum(centred[0] ** 2)
    off = np.linalg.norm(scale * centred[0] @ (left @ right) - centred[1], axis=1)
    said = np.array([np.linalg.norm(row.sigma) for row in sound])
    assert len(sound) > 8
    assert 0.1 < np.median(off / said) < 3.0


def test_json_has_parts_values_and_how_they_joined(tmp_path: Path) -> None:
    nothing, _ = write_project(mixture(4), tmp_path)
    run = mor("approximate", nothing, "-o", tmp_path / "o", "--json", "--quiet")
    assert run.code == 0
    data = json.loads(run.out)
    assert {"counts", "parts", "values", "replaced", "missing"} <= data.keys()
    numbers = {part["part"] for part in data["parts"]} | {0}
    assert all(value["part"] in numbers for value in data["values"] if value["status"] == "found")
    names = {name for part in data["parts"] for name in (*part["frames"], *part["points"])}
    assert any(name.startswith(("image ", "station ")) for name in names)
    assert (tmp_path / "o" / "project.yaml").is_file()
    again = mor("approximate", tmp_path / "o" / "project.yaml", "-o", tmp_path / "p", "--quiet")
    assert again.code == 0
    assert again.out.startswith("All start values are given.")


def test_what_is_missing_stands_in_the_report_and_the_rest_is_written_where_wanted(tmp_path: Path) -> None:
    world = mixture(3)
    lost = world.rays[0][1]
    world.rays = [ray for k, ray in enumerate(world.rays) if ray[1] != lost or k == 0]
    world.directions = [row for row in world.directions if row[1] != lost]
    world.distances = [row for row in world.distances if row[1] != lost]
    nothing, _ = write_project(world, tmp_path)
    refused = mor("approximate", nothing, "-o", tmp_path / "o", "--json", "--quiet")
    assert refused.code == 2
    assert [(m["kind"], m["id"]) for m in json.loads(refused.out)["missing"]] == [("point", lost)]
    assert not (tmp_path / "o").exists()
    with nothing.open("a", encoding="utf-8") as file:
        file.write("settings: {undetermined: leave_out}\n")
    done = mor("approximate", nothing, "-o", tmp_path / "o", "--lang", "de", "--quiet")
    assert done.code == 0
    assert "Fehlende Näherungswerte" in done.out
    assert (tmp_path / "o" / "project.yaml").is_file()


def test_the_picture_is_drawn_and_the_same_again(tmp_path: Path) -> None:
    nothing, _ = write_project(mixture(3), tmp_path)
    pictures = []
    for name in ("a", "b"):
        picture = tmp_path / f"{name}.svg"
        assert mor("approximate", nothing, "-o", tmp_path / name, "--plot", picture, "--quiet").code == 0
        pictures.append(picture.read_bytes())
    assert pictures[0] == pictures[1]
    assert pictures[0].count(b"<use ") > len(mixture(3).points)
    refused = mor("approximate", nothing, "-o", tmp_path / "c", "--plot", tmp_path / "a.svg")
    assert refused.code == 2
    assert "--force replaces it" in refused.err


def test_axes_and_missing_coordinates(tmp_path: Path) -> None:
    """North-East axes: what is told are the coordinates and σ of the project, in its order."""
    text = """\
mor: 1
axes: {xy: ne}
units: {length: m}
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 5], [B, 0, 100, 5], [C, 100, 0, 5]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[P, ~, ~, 5]], fixed: [z]}
observations:
  - type: distance
    columns: [from, to, distance, sigma]
    rows: [[A, P, 53.85165, 0.001], [B, P, 94.33981, 0.002], [C, P, 53.85165, 0.002]]
"""
    rows, _ = _rows(write(tmp_path, text))
    (point,) = rows
    assert point.status == "found"
    assert point.found == ("x", "y")
    assert np.isfinite(point.sigma[:2]).all()
    assert np.isnan(point.sigma[2])
    np.testing.assert_allclose(point.values, [50.0, 20.0, 5.0], atol=1e-4)


def _texts(path: Path, *names: str) -> set[str]:
    """First arguments, as far as they are texts, of all calls of functions with these names."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in names:
            found |= {arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)}
    return found


def test_every_rule_and_sentence_is_there_in_german() -> None:
    german = words_of("de", "start values").catalogue
    rules = set().union(*(_texts(path, "rule") for path in ROOT.rglob("*.py")))
    files = [REPORT / "start_values.py"]
    said = set().union(*(_texts(path, "words", "listed", "rule") for path in files))
    assert len(rules) > 15
    assert sorted((rules | said) - set(german)) == []


def test_replaced_values_are_said(tmp_path: Path) -> None:
    _, truth = write_project(mixture(5), tmp_path)
    network = read_network(read_document(truth), tmp_path)
    found = approximate(network)
    start = {kind: values.copy() for kind, values in found.start.items()}
    block_ = network.things["image"].part(network.things["image"].ids[1], "rotation")
    start["rotation"][block_] = np.eye(3)
    changed = found._replace(start=start)
    rows = start_values(network, changed, make_problem(network, start, start))
    assert [(row.kind, row.what) for row in rows if row.status == "replaced"] == [("image", "attitude")]


def test_points_at_infinity_are_called_that_and_do_not_refuse_the_rest(tmp_path: Path) -> None:
    world, far = street(0, 6, 4, 2, free=True)
    world.given = False
    run = mor("approximate", write_world(tmp_path, world, "refuse"), "-o", tmp_path / "o", "--json", "--quiet")
    assert run.code == 0
    missing = json.loads(run.out)["missing"]
    assert {thing["id"] for thing in missing} == far
    assert all("a direction but no distance" in thing["reason"] for thing in missing)


def test_points_whose_rays_part_are_not_at_infinity_but_begin_somewhere(tmp_path: Path) -> None:
    """I1 stands right of I0 and looks farther to the right: of two such rays one is to another point."""
    world, far = street(0, 6, 4, 2, free=True)
    world.given = False
    world.points["PARTED"] = np.array([1.0, 10.0, 1.6])
    for image, right in (("I0", -0.1), ("I1", 0.1)):
        world.ray(image, "PARTED", np.array([right, 1.0, 0.0]))
    run = mor("approximate", write_world(tmp_path, world, "refuse"), "-o", tmp_path / "o", "--json", "--quiet")
    assert run.code == 0
    assert {thing["id"] for thing in json.loads(run.out)["missing"]} == far
