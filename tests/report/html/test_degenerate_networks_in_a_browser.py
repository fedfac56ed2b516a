"""Networks without extent in one or more directions: everything is in sight, in the view that shows it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.page_in_browser import wait_until
from tests.scenarios.small_projects import LEVELLING, mor, write

pytestmark = pytest.mark.browser

LEVEL_NET = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 900, 40, 14], [C, 820, 870, 17], [D, 20, 880, 12]], fixed: [x, y]}
observations:
  - type: height_difference
    columns: [from, to, dz]
    values: {sigma: 1 mm}
    rows: [[A, B, 4.001], [B, C, 3.002], [C, D, -5.0], [D, A, -2.0], [A, C, 7.001]]
"""
ONE_POINT = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 1, 2, 10]]}
observations:
  - type: coordinates
    columns: [point, x, y, z]
    values: {sigma: 2 mm}
    rows: [[A, 1.001, 2, 10], [A, 1.003, 2.001, 10.002]]
"""
TWO_POINTS = """\
mor: 1
points:
  - {columns: [id, x, y, z], rows: [[A, 0, 0, 10]], fixed: [x, y, z]}
  - {columns: [id, x, y, z], rows: [[B, 100, 0, 10]], fixed: [y, z]}
observations:
  - {type: distance, columns: [from, to, distance], rows: [[A, B, 100.001], [A, B, 100.003]], values: {sigma: 2 mm}}
"""
PLACES = """
const plot = document.querySelector('#chart-space .plot'), scene = plot._fullLayout.scene._scene;
const camera = scene.glplot.cameraParams, trace = plot.data.find((t) => t.meta === 'points');
const times = (m, v) => [0, 1, 2, 3].map((i) => [0, 1, 2, 3].reduce((sum, j) => sum + m[4 * j + i] * v[j], 0));
return trace.x.map((_, k) => {
  let v = [trace.x[k], trace.y[k], trace.z[k]].map((x, i) => x * scene.dataScale[i]).concat(1);
  for (const matrix of [camera.model, camera.view, camera.projection]) v = times(matrix, v);
  return [v[0] / v[3], v[1] / v[3]];
});
"""
"""Where the points of the network in space stand in its chart: −1 to 1 from edge to edge."""


@pytest.mark.parametrize(
    ("text", "plane", "spread"),
    [
        (LEVELLING, "front", 0.5),
        (LEVEL_NET, "front", 0.5),
        (ONE_POINT, "plan", 0.0),
        (TWO_POINTS, "plan", 0.5),
    ],
    ids=["plumb line", "levelling net", "one point", "two points"],
)
def test_every_point_is_in_sight(browser: Any, tmp_path: Path, text: str, plane: str, spread: float) -> None:
    run = mor("adjust", write(tmp_path, text), "--quiet")
    assert run.code == 0, run.err
    browser.get((tmp_path / "project.results" / "report.html").as_uri())
    wait_until(browser, "document.documentElement.dataset.ready === 'all'")
    assert browser.execute_script("return document.getElementById('plane').value") == plane
    places = browser.execute_script(PLACES)
    assert max(abs(x) for place in places for x in place) < 0.95
    across = [max(axis) - min(axis) for axis in zip(*places, strict=True)]
    assert max(across) >= spread
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
